"""The HTTP server of all pages that hpop serves: who may ask is checked, connections and their time are bounded.

A request is answered if it asks for one of the server's own names (another page in the same browser that DNS rebinding
makes look as if it came from here does not), and if no page of another origin sent it. A request that is not whole
within :data:`READING` seconds is dropped, however it drips; of more than :data:`CONNECTIONS` the oldest that is not
whole yet is. Whatever is refused learns nothing of the address beyond name and port.
"""

from __future__ import annotations

import errno
import socket
import ssl
from collections.abc import Iterable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import inf
from socketserver import TCPServer
from threading import RLock
from time import monotonic
from typing import Any

from hpop.errors import OutputError

LOCAL = "127.0.0.1"
READING = 20.0
"""Seconds within which a request, its body included, must have come."""
SENDING = 30.0
"""Seconds that a piece of an answer may take to be sent."""
CONNECTIONS = 128
"""At the same time, at most: a thread each."""
PIECE = 2**18
"""Bytes that are sent at once."""
PLAIN_PORTS = {"http": 80, "https": 443}
"""Ports that browsers leave out of the name."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "same-origin",  # addresses hold tokens; without an Origin of its own a form could not be told
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class PageServer(ThreadingHTTPServer):
    """A server of pages for few, each connection in a thread of its own.

    Parameters
    ----------
    handler : a :class:`PageHandler`
    host, port : an address of this machine; port 0 takes any that is free
    names : by which it may be asked for, besides 127.0.0.1 and localhost
    secured : what encrypts the connections
    listening : a socket that listens already, in the place of ``host`` and ``port``
    reading : s within which a request must have come

    Raises OutputError where the port cannot be had.
    """

    daemon_threads = True
    request_queue_size = CONNECTIONS

    def __init__(
        self,
        handler: type[PageHandler],
        *,
        host: str = LOCAL,
        port: int = 0,
        names: Iterable[str] = (),
        secured: ssl.SSLContext | None = None,
        listening: socket.socket | None = None,
        reading: float = READING,
    ) -> None:
        self._reading = reading
        self._lock = RLock()
        self._open: dict[Any, float] = {}  # connections in order, until when each must be whole: inf once it is
        if listening is not None:
            super().__init__(listening.getsockname()[:2], handler, bind_and_activate=False)
            self.socket.close()
            self.socket = listening
        else:
            try:
                super().__init__((host, port), handler)
            except OSError as error:
                raise OutputError(no_port(port, error)) from None
        self.scheme = "http" if secured is None else "https"
        here = self.server_address[1]
        known = dict.fromkeys((LOCAL, "localhost", *(name.lower() for name in names)))
        self.hosts = {f"{name}:{here}" for name in known}
        if here == PLAIN_PORTS[self.scheme]:
            self.hosts |= set(known)
        if secured is not None:
            # Each connection greets in a thread of its own: one that says nothing keeps nobody waiting.
            self.socket = secured.wrap_socket(self.socket, server_side=True, do_handshake_on_connect=False)

    def server_bind(self) -> None:
        """Bind without the name of this machine, for which http.server would ask the network, and may wait long."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def root(self, name: str = LOCAL) -> str:
        """Return the address without what follows the port."""
        return f"{self.scheme}://{name}:{self.server_address[1]}"

    def refusal(self, host: str, origin: str | None) -> str:
        """Return why a request to a host, sent by a page of an origin, is not answered; "" where it is."""
        if host.lower() not in self.hosts:
            return f"ask for {self.root()}"
        if origin is not None and origin.lower() != f"{self.scheme}://{host.lower()}":
            return "only pages of this server may ask"
        return ""

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin with a connection; where there are too many, drop the oldest that is not whole, else this one."""
        with self._lock:
            if len(self._open) >= CONNECTIONS:
                oldest = next((one for one, until in self._open.items() if until < inf), None)
                if oldest is None:
                    self.shutdown_request(request)
                    return
                self._drop(oldest)
            self._open[request] = monotonic() + self._reading
        super().process_request(request, client_address)

    def whole(self, request: Any) -> None:
        """Note that a request has come whole: its answer may take longer."""
        with self._lock:
            if request in self._open:
                self._open[request] = inf

    def service_actions(self) -> None:
        """Drop requests that have not come in time."""
        now = monotonic()
        with self._lock:
            for late in [one for one, until in self._open.items() if until < now]:
                self._drop(late)

    def close_request(self, request: Any) -> None:
        """Let go of a connection."""
        with self._lock:
            self._open.pop(request, None)
        super().close_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a page that was closed, or that mistrusts the certificate, is no error."""

    def _drop(self, request: Any) -> None:
        """End a connection; its thread, which waits for it, closes it."""
        del self._open[request]
        with suppress(OSError):
            request.shutdown(socket.SHUT_RDWR)


class PageHandler(BaseHTTPRequestHandler):
    """One request, answered if :meth:`PageServer.refusal` has nothing against it, whatever its method."""

    timeout = SENDING
    server: PageServer
    server_version, sys_version = "hpop", ""

    def parse_request(self) -> bool:
        """Read the head of a request; False where it is refused, which was said then."""
        if not super().parse_request():
            return False
        if self.command != "POST":
            self.server.whole(self.connection)
        said = self.server.refusal(self.headers.get("Host", ""), self.headers.get("Origin"))
        if said:
            self.refused(HTTPStatus.FORBIDDEN, said)
        return not said

    def do_GET(self) -> None:
        """Answer a question."""
        self.answer()

    def do_HEAD(self) -> None:
        """Answer a question with its head alone."""
        self.answer()

    def do_POST(self) -> None:
        """Take what is posted."""
        self.take()

    def answer(self) -> None:
        """Answer a question for ``self.path``."""
        self.send_error(HTTPStatus.NOT_FOUND)

    def take(self) -> None:
        """Take what is posted to ``self.path``, and answer."""
        self.send_error(HTTPStatus.NOT_IMPLEMENTED)

    def refused(self, status: HTTPStatus, said: str) -> None:
        """Say why a request is not answered."""
        self.page(said.encode(), "text/plain; charset=utf-8", status)

    def body(self, most: int) -> bytes | None:
        """Return what was posted; None where it does not say how long it is, ``most`` bytes at the most."""
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()) or len(length) > len(str(most)) or int(length) > most:
            self.close_connection = True  # without reading what it sends
            return None
        data = self.rfile.read(int(length))
        self.server.whole(self.connection)
        return data

    def page(
        self, data: bytes, kind: str = "text/html; charset=utf-8", status: HTTPStatus = HTTPStatus.OK, **more: str
    ) -> None:
        """Send an answer, with ``more`` headers."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        for name, value in more.items():
            self.send_header(name, value)
        self.end_headers()
        self.send(data)

    def send(self, data: bytes) -> None:
        """Send bytes, piece by piece, so that a slow reader has the time for each; none to who asks for the head."""
        for begin in range(0, len(data) if self.command != "HEAD" else 0, PIECE):
            self.wfile.write(data[begin : begin + PIECE])

    def end_headers(self) -> None:
        for name, value in HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing of who asks for what."""


def no_port(port: int, error: OSError) -> str:
    """Say why a port cannot be had, and what to do."""
    way = "choose another --port; 0 takes any that is free"
    if error.errno == errno.EADDRINUSE:
        return f"cannot serve on port {port}: another program has it; end that, or {way}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"cannot serve on port {port}: ports below 1024 are the system's; {way}"
    return f"cannot serve on port {port}: {error.strerror or error}; {way}"
