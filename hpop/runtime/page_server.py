"""HTTP server of all pages that hpop serves; it checks the sender of a request and bounds connections and their time.

A request is answered if it names one of the server's own hosts and was not sent by a page of another origin. The first
rule stops DNS rebinding, by which another page in the browser pretends to come from here. A request that is not
complete within :data:`READING` seconds is dropped, however slowly it drips. Of more than :data:`CONNECTIONS`
connections the oldest incomplete one is dropped. A refusal reveals nothing of the address beyond name and port.
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
"""Seconds within which a request, including its body, must be complete."""
SENDING = 30.0
"""Seconds within which a piece of an answer must be sent."""
CONNECTIONS = 128
"""Largest number of connections at a time, each with a thread."""
PIECE = 2**18
"""Bytes that are sent in one piece."""
PLAIN_PORTS = {"http": 80, "https": 443}
"""Ports that browsers leave out of the address."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "same-origin",  # addresses hold tokens
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class PageServer(ThreadingHTTPServer):
    """Server of pages for few users, with a thread for each connection.

    Parameters
    ----------
    handler : a :class:`PageHandler`
    host, port : an address of this machine; port 0 takes any free port
    names : host names of this server besides 127.0.0.1 and localhost
    secured : TLS context, to encrypt connections
    listening : a listening socket to use in place of ``host`` and ``port``
    reading : s within which a request must be complete

    Raises OutputError if the port is not available.
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
        self._open: dict[Any, float] = {}  # connections in order, with deadlines for the request; inf once complete
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
        own_port = self.server_address[1]
        own_names = dict.fromkeys((LOCAL, "localhost", *(name.lower() for name in names)))
        self.hosts = {f"{name}:{own_port}" for name in own_names}
        if own_port == PLAIN_PORTS[self.scheme]:
            self.hosts |= set(own_names)
        if secured is not None:
            # Each connection shakes hands in its own thread, so that a silent one does not block the server.
            self.socket = secured.wrap_socket(self.socket, server_side=True, do_handshake_on_connect=False)

    def server_bind(self) -> None:
        """Bind without looking up the name of this machine, for which http.server asks the network and may wait."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def root(self, name: str = LOCAL) -> str:
        """Return the address up to the port."""
        return f"{self.scheme}://{name}:{self.server_address[1]}"

    def refusal(self, host: str, origin: str | None) -> str:
        """Return why a request to a host, sent by a page of an origin, is refused; "" if it is not."""
        if host.lower() not in self.hosts:
            return f"ask for {self.root()}"
        if origin is not None and origin.lower() != f"{self.scheme}://{host.lower()}":
            return "only pages of this server may ask"
        return ""

    def process_request(self, request: Any, client_address: Any) -> None:
        """Accept a connection; if there are too many, drop the oldest incomplete one, or else this one."""
        with self._lock:
            if len(self._open) >= CONNECTIONS:
                oldest = next((request for request, deadline in self._open.items() if deadline < inf), None)
                if oldest is None:
                    self.shutdown_request(request)
                    return
                self._drop(oldest)
            self._open[request] = monotonic() + self._reading
        super().process_request(request, client_address)

    def whole(self, request: Any) -> None:
        """Note that a request is complete: its answer may take longer."""
        with self._lock:
            if request in self._open:
                self._open[request] = inf

    def service_actions(self) -> None:
        """Drop requests that are not complete in time."""
        now = monotonic()
        with self._lock:
            for late in [request for request, deadline in self._open.items() if deadline < now]:
                self._drop(late)

    def close_request(self, request: Any) -> None:
        """Forget a connection."""
        with self._lock:
            self._open.pop(request, None)
        super().close_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a closed page, or one that mistrusts the certificate, is no error."""

    def _drop(self, request: Any) -> None:
        """Shut a connection down; its thread, which waits for it, closes it."""
        del self._open[request]
        with suppress(OSError):
            request.shutdown(socket.SHUT_RDWR)


class PageHandler(BaseHTTPRequestHandler):
    """Handler of one request of any method, answered unless :meth:`PageServer.refusal` gives a reason."""

    timeout = SENDING
    server: PageServer
    server_version, sys_version = "hpop", ""

    def parse_request(self) -> bool:
        """Read the head of a request; return False, after answering, if it is refused."""
        if not super().parse_request():
            return False
        if self.command != "POST":
            self.server.whole(self.connection)
        reason = self.server.refusal(self.headers.get("Host", ""), self.headers.get("Origin"))
        if reason:
            self.refused(HTTPStatus.FORBIDDEN, reason)
        return not reason

    def do_GET(self) -> None:
        """Answer a GET request."""
        self.answer()

    def do_HEAD(self) -> None:
        """Answer a HEAD request."""
        self.answer()

    def do_POST(self) -> None:
        """Accept a POST request."""
        self.take()

    def answer(self) -> None:
        """Answer a GET or HEAD request for ``self.path``."""
        self.send_error(HTTPStatus.NOT_FOUND)

    def take(self) -> None:
        """Accept the data posted to ``self.path``, and answer."""
        self.send_error(HTTPStatus.NOT_IMPLEMENTED)

    def refused(self, status: HTTPStatus, reason: str) -> None:
        """Answer with the reason for a refusal."""
        self.page(reason.encode(), "text/plain; charset=utf-8", status)

    def body(self, most: int) -> bytes | None:
        """Return the posted data; None if its length is not stated or exceeds ``most`` bytes."""
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()) or len(length) > len(str(most)) or int(length) > most:
            self.close_connection = True  # without reading the data
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
        """Send bytes in pieces, so that a slow reader has time for each; send none in answer to HEAD."""
        for begin in range(0, len(data) if self.command != "HEAD" else 0, PIECE):
            self.wfile.write(data[begin : begin + PIECE])

    def end_headers(self) -> None:
        for name, value in HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Print no log of requests."""


def no_port(port: int, error: OSError) -> str:
    """Return why a port is not available, and what to do."""
    hint = "choose another --port; 0 takes any that is free"
    if error.errno == errno.EADDRINUSE:
        return f"cannot serve on port {port}: another program uses it; end that program, or {hint}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"cannot serve on port {port}: ports below 1024 are the system's; {hint}"
    return f"cannot serve on port {port}: {error.strerror or error}; {hint}"
