"""Serve one page to a headset: over https with a temporary certificate, or over a cable.

Headsets show pages in VR only over a secure connection: https, or http from their own 127.0.0.1, which `adb reverse`
connects to a port of this machine. Only the page is served, and only to requests that carry the token and address this
machine by one of its names.
"""

from __future__ import annotations

import datetime
import ipaddress
import secrets
import socket
import ssl
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from starlette.responses import HTMLResponse
from starlette.routing import Route

from hpop.errors import OutputError
from hpop.runtime.page_server import LOCAL as LOCAL
from hpop.runtime.page_server import PageServer

EVERYWHERE = "0.0.0.0"
DAYS = 7
"""Days for which a certificate is valid."""


class Certificate(NamedTuple):
    """Self-signed certificate for some IP addresses, with its private key (both PEM) and its SHA-256 fingerprint."""

    pem: bytes
    key: bytes
    fingerprint: str


class OnePage(PageServer):
    """Server of one page, at an address that contains a secret token.

    page   HTML, as bytes
    names  further names of this machine that requests may use
    """

    def __init__(
        self, page: bytes, *, host: str, port: int, names: Sequence[str] = (), certificate: Certificate | None = None
    ) -> None:
        super().__init__(
            [Route("/", lambda request: HTMLResponse(page))],
            host=host,
            port=port,
            names=names,
            token=secrets.token_urlsafe(9),
            secured=None if certificate is None else context_of(certificate),
        )

    def address(self, host: str) -> str:
        """Return the address of the page, as typed into a browser."""
        return f"{self.root(host)}/{self.token}"


def own_address() -> str:
    """Return the IP address of this machine in its network, or 127.0.0.1 without a network. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address of documentation (RFC 5737)
            return str(probe.getsockname()[0])
        except OSError:
            return LOCAL


def certificate_for(*hosts: str) -> Certificate:
    """Create a self-signed certificate for IP addresses; browsers warn about it once.

    Raises OutputError if `cryptography` is not installed.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as error:
        raise OutputError(
            f"https needs the package cryptography, which is missing ({error}); pip install 'hpop[serve]', or use a "
            "headset on a cable (hpop ride --cable), which needs no https"
        ) from None
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "hpop ride")])
    now = datetime.datetime.now(datetime.UTC)
    addresses = [x509.IPAddress(ipaddress.ip_address(host)) for host in dict.fromkeys((*hosts, LOCAL))]
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # clocks differ
        .not_valid_after(now + datetime.timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost"), *addresses]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    return Certificate(
        made.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
        made.fingerprint(hashes.SHA256()).hex(":").upper(),
    )


def context_of(certificate: Certificate) -> ssl.SSLContext:
    """Return an SSL context with a certificate and its key.

    Python's ssl module reads keys only from files, so a temporary file holds it meanwhile, which
    only its owner may read.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    with TemporaryDirectory(prefix="hpop-") as folder:
        paths = [Path(folder) / name for name in ("certificate.pem", "key.pem")]
        for path, data in zip(paths, (certificate.pem, certificate.key), strict=True):
            path.write_bytes(data)
        context.load_cert_chain(str(paths[0]), str(paths[1]))
    return context
