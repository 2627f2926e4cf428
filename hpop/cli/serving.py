"""One page of this machine for a headset: over https with a certificate made for the occasion, or to a cable alone.

Headsets show pages in three dimensions only where the connection is secure: https, or http from their own 127.0.0.1,
to which `adb reverse` brings a port of this machine. Nothing is served but the page, and that only to who knows the
token in its address.
"""

from __future__ import annotations

import datetime
import ipaddress
import secrets
import socket
import ssl
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socketserver import TCPServer
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from hpop.errors import OutputError

LOCAL = "127.0.0.1"
EVERYWHERE = "0.0.0.0"
DAYS = 7
"""For which a certificate holds."""
PATIENCE = 30.0
"""s, for who connects and says nothing."""


class Certificate(NamedTuple):
    """A key, and who says of itself that it is that of some addresses; both as PEM."""

    pem: bytes
    key: bytes
    fingerprint: str


class PageServer(ThreadingHTTPServer):
    """Serves one page under a token, on a port of one address of this machine or of all."""

    daemon_threads = True

    def __init__(self, page: bytes, *, host: str, port: int, certificate: Certificate | None = None) -> None:
        self.page = page
        self.token = secrets.token_urlsafe(9)
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            raise OutputError(
                f"cannot serve on port {port}: {error.strerror or error}; choose another --port"
            ) from None
        if certificate is not None:
            # Each connection greets in a thread of its own: one that says nothing keeps nobody waiting.
            self.socket = context_of(certificate).wrap_socket(
                self.socket, server_side=True, do_handshake_on_connect=False
            )
        self.scheme = "http" if certificate is None else "https"

    def server_bind(self) -> None:
        """Without the name of this machine, for which http.server would ask the network, and may wait long."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def address(self, host: str) -> str:
        """Where the page is, as it is typed into a browser."""
        return f"{self.scheme}://{host}:{self.server_address[1]}/{self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Who breaks off, or mistrusts the certificate, is no error of ours."""


class _Handler(BaseHTTPRequestHandler):
    """Answers with the page, or not at all."""

    timeout = PATIENCE
    server: PageServer

    def do_GET(self) -> None:
        """The page, to who knows its token."""
        self._answer(self.server.page)

    def do_HEAD(self) -> None:
        """The same without the page."""
        self._answer(b"")

    def _answer(self, page: bytes) -> None:
        asked = self.path.partition("?")[0].strip("/")
        if not secrets.compare_digest(asked.encode("utf-8", "replace"), self.server.token.encode()):
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.page)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        self.wfile.write(page)

    def version_string(self) -> str:
        """Of the server, which is nobody's business."""
        return "hpop"

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is printed of who asks for what."""


def own_address() -> str:
    """The address of this machine in its network, or 127.0.0.1 where there is none; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address of documentation (RFC 5737)
            return str(probe.getsockname()[0])
        except OSError:
            return LOCAL


def certificate_for(*hosts: str) -> Certificate:
    """A certificate of this machine's own for some IP addresses; browsers warn of it once.

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
    """What a server needs of a certificate; its key is on the disk only while it is read, and only for its owner."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    with TemporaryDirectory(prefix="hpop-") as folder:
        paths = [Path(folder) / name for name in ("certificate.pem", "key.pem")]
        for path, data in zip(paths, (certificate.pem, certificate.key), strict=True):
            path.write_bytes(data)
        context.load_cert_chain(str(paths[0]), str(paths[1]))
    return context
