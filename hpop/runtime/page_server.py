"""HTTP server of all web pages of hpop: a Starlette application behind a guard, run by uvicorn's HTTP protocol.

The guard lets a request pass only if it names one of the server's own hosts and was not sent by a page of another
origin. The first rule prevents DNS rebinding, by which another page in the browser pretends to come from this server. A
request that is not complete within :data:`READING` seconds is dropped. If there are more than :data:`CONNECTIONS`
connections, the oldest incomplete one is dropped. The text of a refusal never contains the secret token of the
server's pages; of their address it has at most the host name and the port.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import secrets
import socket
import ssl
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from http import HTTPStatus
from threading import Event
from typing import Any

from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from hpop.errors import OutputError
from hpop.runtime.interrupts import WAKING, interrupts_noted

LOCAL = "127.0.0.1"
READING = 20.0
"""Time, s, within which a request, including its body, must be complete."""
SENDING = 30.0
"""Time, s, within which a client must read data that wait to be sent."""
FAREWELL = 5.0
"""Time, s, that remains for responses when the server ends."""
CONNECTIONS = 128
"""Largest number of connections at a time."""
MOST_SOCKET = 2**16
"""Largest size of a message that comes through a websocket, bytes."""
PLAIN_PORTS = {"http": 80, "https": 443}
"""Default ports, which browsers leave out of addresses."""
HEADERS = {
    "Cache-Control": "no-store",
    "Connection": "close",  # a connection carries one request, so that its deadline is that of the request
    "Referrer-Policy": "same-origin",  # addresses hold tokens
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}

logging.getLogger("uvicorn.error").setLevel(logging.ERROR)  # the user need not know of malformed requests


class PageServer:
    """HTTP server of one web application, for few users.

    Parameters
    ----------
    routes : routes of the Starlette application
    errors : handlers of exceptions that its endpoints raise
    host, port : address of this machine on which to listen; port 0 takes any free port
    names : host names of this server besides 127.0.0.1 and localhost
    token : secret text with which each path must begin; routes do not contain it
    secured : TLS context, to encrypt connections
    listening : listening socket to use in place of ``host`` and ``port``
    reading : s, time within which a request must be complete
    sockets : whether there are websockets among the routes

    Raises OutputError if the port is not available.
    """

    def __init__(
        self,
        routes: Sequence[BaseRoute],
        *,
        errors: Mapping[Any, Any] = {},  # not changed
        host: str = LOCAL,
        port: int = 0,
        names: Iterable[str] = (),
        token: str = "",
        secured: ssl.SSLContext | None = None,
        listening: socket.socket | None = None,
        reading: float = READING,
        sockets: bool = False,
    ) -> None:
        self.token, self.reading = token, reading
        self.connections: dict[Any, bool] = {}  # oldest first; True if the request is complete
        self._secured = secured
        self._socket = _listen(host, port) if listening is None else listening
        self.server_address: tuple[str, int] = self._socket.getsockname()[:2]
        self.scheme = "http" if secured is None else "https"
        own_port = self.server_address[1]
        own_names = dict.fromkeys((LOCAL, "localhost", *(name.lower() for name in names)))
        self.hosts = {f"{name}:{own_port}" for name in own_names}
        if own_port == PLAIN_PORTS[self.scheme]:
            self.hosts |= set(own_names)
        app = Starlette(routes=routes, exception_handlers={HTTPException: self._failed, **errors})
        app.router.redirect_slashes = False
        self._config = Config(
            _Guard(app, self),
            ws=_socket_protocol(self) if sockets else "none",
            ws_max_size=MOST_SOCKET,
            lifespan="off",
            log_config=None,
        )
        self._ending = Event()
        self._ended = Event()
        self._stop: asyncio.Event | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    def root(self, name: str = LOCAL) -> str:
        """Return the address of the server up to the port: "http://127.0.0.1:8000"."""
        return f"{self.scheme}://{name}:{self.server_address[1]}"

    def refusal(self, host: str, origin: str | None) -> str:
        """Return why a request to ``host``, sent by a page of ``origin``, must be refused; "" if it may pass."""
        if host.lower() not in self.hosts:
            return f"this host name is not served; use the address {self.root()}"
        if origin is not None and origin.lower() != f"{self.scheme}://{host.lower()}":
            return "requests must come from pages of this server, but this one comes from another origin"
        return ""

    def is_open(self, token: str) -> bool:
        """Return whether a text, the first part of a request's path, is the token of this server."""
        return same(token, self.token)

    def refused(self, method: str, status: HTTPStatus, reason: str) -> Response:
        """Return the response to a request that is refused."""
        return PlainTextResponse(reason, status)

    def serve_forever(self) -> None:
        """Serve requests until :meth:`shutdown` is called, or until Ctrl-C in the main thread."""
        try:
            asyncio.run(self._serve())
        finally:
            self._ended.set()

    def shutdown(self) -> None:
        """End :meth:`serve_forever`, which runs in another thread, and wait for its end."""
        self.ends()
        self._ended.wait()

    def ends(self) -> None:
        """Let :meth:`serve_forever` end soon."""
        self._ending.set()
        if self._loop is not None and self._stop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._stop.set)

    def server_close(self) -> None:
        """Release the port."""
        self._socket.close()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.server_close()

    @asynccontextmanager
    async def alongside(self) -> AsyncIterator[None]:
        """Context that is open while requests are served; a subclass runs its own tasks in it."""
        yield

    def _failed(self, request: Request, error: Exception) -> Response:
        """Return the response to a request with an unknown path or method, or whose endpoint failed."""
        status = HTTPStatus(error.status_code if isinstance(error, HTTPException) else 500)
        return self.refused(request.method, status, status.phrase)

    async def _serve(self) -> None:
        """Accept connections until the server shall end, then wait shortly for the responses to complete requests."""
        self._config.load()
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        state = ServerState()
        server = await self._loop.create_server(
            lambda: _Connection(self, self._config, state),
            sock=self._socket.dup(),
            ssl=self._secured,
            ssl_handshake_timeout=None if self._secured is None else self.reading,
            backlog=CONNECTIONS,
        )
        if self._ending.is_set():  # set before the loop ran
            self._stop.set()
        try:
            async with self.alongside():
                with interrupts_noted() as check:
                    while not self._stop.is_set():
                        check()
                        with suppress(TimeoutError):
                            await asyncio.wait_for(self._stop.wait(), WAKING)
        finally:
            server.close()
            for connection in list(self.connections):
                connection.end()
            last = self._loop.time() + FAREWELL
            while self.connections and self._loop.time() < last:
                await asyncio.sleep(0.01)


class _Connection(H11Protocol):
    """HTTP connection with two deadlines: for a complete request, and for a client that does not read the response."""

    def __init__(self, server: PageServer, config: Config, state: ServerState) -> None:
        super().__init__(config, state, {})
        self._server = server
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection; if there are too many, drop one.

        Dropped is the oldest one with an incomplete request, or else this one.
        """
        super().connection_made(transport)
        connections = self._server.connections
        if len(connections) >= CONNECTIONS:
            oldest = next((one for one, is_complete in connections.items() if not is_complete), None)
            if oldest is None:
                transport.abort()
                return
            oldest._drop()
        connections[self] = False
        self._expect(self._server.reading)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._expect(None)
        self._server.connections.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read a part of a request. Once the request is complete, there is no deadline for the response."""
        super().data_received(data)
        if self.cycle is not None and not self.cycle.more_body and self in self._server.connections:
            self._server.connections[self] = True
            self._expect(None)

    def pause_writing(self) -> None:
        """Note that sent data wait for a slow client; drop the connection if they still wait after `SENDING` s."""
        super().pause_writing()
        self._expect(SENDING)

    def resume_writing(self) -> None:
        """Continue to send, and cancel the deadline."""
        super().resume_writing()
        self._expect(None)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Hand the connection over to the protocol of websockets, which counts it from now on."""
        self._expect(None)
        self._server.connections.pop(self, None)
        super().handle_websocket_upgrade(event)

    def end(self) -> None:
        """Close the connection once waiting data are sent, unless the response to a complete request is still to come.

        After that response the connection closes by itself, since each carries one request.
        """
        if not self._server.connections[self] or self.cycle is None or self.cycle.response_started:
            self.transport.close()

    def _expect(self, seconds: float | None) -> None:
        """Set the deadline of the connection, in s from now; None cancels it."""
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None if seconds is None else self.loop.call_later(seconds, self._drop)

    def _drop(self) -> None:
        """Close the connection without sending waiting data."""
        self._server.connections.pop(self, None)
        self.transport.abort()


def _socket_protocol(server: PageServer) -> Any:
    """Return the protocol of websockets for a server; each connection counts among those of the server."""
    from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol  # few servers need it

    class SocketConnection(WebSocketsSansIOProtocol):
        """Connection of a websocket, with a deadline for a client that does not read."""

        _deadline: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            """Count the connection."""
            super().connection_made(transport)
            server.connections[self] = True

        def connection_lost(self, exc: Exception | None) -> None:
            """Forget the connection."""
            server.connections.pop(self, None)
            self.resume_writing()
            super().connection_lost(exc)

        def pause_writing(self) -> None:
            """Note that sent data wait for a slow client; drop the connection if they still wait after `SENDING` s."""
            super().pause_writing()
            self._deadline = self.loop.call_later(SENDING, self.transport.abort)

        def resume_writing(self) -> None:
            """Continue to send, and cancel the deadline."""
            super().resume_writing()
            if self._deadline is not None:
                self._deadline.cancel()

        def end(self) -> None:
            """Close the connection, because the server ends."""
            self.shutdown()

    return SocketConnection


class _Guard:
    """ASGI application that refuses requests of other hosts and origins, or without the token.

    It adds :data:`HEADERS` to each response.
    """

    def __init__(self, app: ASGIApp, server: PageServer) -> None:
        self._app, self._server = app, server

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, or respond with a refusal."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        headers, server = Headers(scope=scope), self._server
        first, _, rest = scope["path"].removeprefix("/").partition("/")
        app = self._app
        method = scope.get("method", "GET")  # a websocket has none
        if reason := server.refusal(headers.get("host", ""), headers.get("origin")):
            app = server.refused(method, HTTPStatus.FORBIDDEN, reason)
        elif server.token and not server.is_open(first):
            app = server.refused(method, HTTPStatus.NOT_FOUND, "there is no page at this address")
        elif server.token:
            scope = {**scope, "path": f"/{rest}", "token": first}
        await app(scope, receive, send_with_headers)


def same(text: str, secret: str) -> bool:
    """Return whether a text equals a secret; the comparison time does not reveal how much of the text is right."""
    return secrets.compare_digest(text.encode("utf-8", "replace"), secret.encode())


async def body(request: Request, most: int) -> bytes | None:
    """Return the body of a POST request; None, without reading it, if its length is unknown or above ``most`` bytes."""
    length = request.headers.get("Content-Length", "")
    if not (length.isascii() and length.isdigit()) or len(length) > len(str(most)) or int(length) > most:
        return None
    return await request.body()


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address; OutputError if the port is not available."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(CONNECTIONS)
    except OSError as error:
        listening.close()
        raise OutputError(no_port(port, error)) from None
    return listening


def no_port(port: int, error: OSError) -> str:
    """Return a message on a port that is not available: the reason, and what to do."""
    hint = "choose another --port; 0 takes any that is free"
    if error.errno == errno.EADDRINUSE:
        return f"cannot serve on port {port}: another program uses it; end that program, or {hint}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"cannot serve on port {port}: ports below 1024 are reserved for the system; {hint}"
    return f"cannot serve on port {port}: {error.strerror or error}; {hint}"
