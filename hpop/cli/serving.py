"""One page of this machine for a headset: over https with a certificate made for the occasion, or to a cable alone.

Headsets show pages in three dimensions only where the connection is secure: https, or http from their own 127.0.0.1,
to which `adb reverse` brings a port of this machine. Nothing is served but the page, and that only to who knows the
token in its address and asks for this machine by its own name.
"""

from __future__ import annotations

import datetime
import ipaddress
import secrets
import socket
import ssl
from collections.abc import Sequence
from http import HTTPStatus
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from hpop.errors import OutputError
from hpop.runtime.page_server import LOCAL, PageHandler, PageServer

EVERYWHERE = "0.0.0.0"
DAYS = 7
"""For which a certificate holds."""


class Certificate(NamedTuple):
    """A key, and who says of itself that it is that of some addresses; both as PEM."""

    pem: bytes
    key: bytes
    fingerprint: str


class OnePage(PageServer):
    """Serves one page under a token, on a port of one address of this machine or of all.

    page     to be served
    names    by which this machine may be asked for it, besides its own
    """

    def __init__(
        self, page: bytes, *, host: str, port: int, names: Sequence[str] = (), certificate: Certificate | None = None
    ) -> None:
        self.page = page
        self.token = secrets.token_urlsafe(9)
        secured = None if certificate is None else context_of(certificate)
        super().__init__(_Handler, host=host, port=port, names=names, secured=secured)

    def address(self, host: str) -> str:
        """Return where the page is, as it is typed into a browser."""
        return f"{self.root(host)}/{self.token}"


class _Handler(PageHandler):
    """Answers with the page, or not at all."""

    server: OnePage

    def answer(self) -> None:
        """Send the page to a request that names its token."""
        asked = self.path.partition("?")[0].strip("/")
        if secrets.compare_digest(asked.encode("utf-8", "replace"), self.server.token.encode()):
            self.page(self.server.page)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)


def own_address() -> str:
    """Return the address of this machine in its network, or 127.0.0.1; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address of documentation (RFC 5737)
            return str(probe.getsockname()[0])
        except OSError:
            return LOCAL


def certificate_for(*hosts: str) -> Certificate:
    """Return a certificate of this machine's own for some IP addresses; browsers warn of it once.

    Raises OutputError where there is no `cryptography`.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as error:
        raise OutputError(
            f"certificates are made with cryptography, the extra hpop[serve] ({error}); pip install 'hpop[serve]', or "
            "take --cable, which needs no certificate"
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
    """Make an SSL context of a certificate; its key is on the disk only while it is read, only for its owner."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    with TemporaryDirectory(prefix="hpop-") as folder:
        paths = [Path(folder) / name for name in ("certificate.pem", "key.pem")]
        for path, data in zip(paths, (certificate.pem, certificate.key), strict=True):
            path.write_bytes(data)
        context.load_cert_chain(str(paths[0]), str(paths[1]))
    return context
