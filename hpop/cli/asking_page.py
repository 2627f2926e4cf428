"""``hpop prefer --web``: the questions on a page, served to this machine alone; without scripts, as forms.

Whoever does not know the token in the page's address is shown nothing. An answer names the question that it answers, so
that one that is sent twice counts once.
"""

from __future__ import annotations

import html
import secrets
from base64 import b64encode
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import parse_qs

from hpop.errors import OutputError
from hpop.text import printable

if TYPE_CHECKING:
    from hpop.cli.preferred import Difference

HOST = "127.0.0.1"
PATIENCE = 30.0
"""s, for who connects and says nothing."""
MOST_BYTES, MOST_DIGITS = 1_000, 4
"""Of an answer, and of how long it says that it is."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; img-src data:; style-src 'unsafe-inline'; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
# Under a and b are their lines as on the map: its first two colours and dashes.
STYLE = """body{font:17px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1b1b1b}
body{background:#fff}table{border-collapse:collapse;margin:1rem 0}td,th{padding:.3rem .9rem .3rem 0;text-align:right}
td:first-child,td:last-child,th:first-child{text-align:left}td:last-child{color:#555}img{max-width:100%;max-height:60vh}
button{font:inherit;padding:.6rem 1.2rem;margin:.3rem .5rem .3rem 0;border:1px solid #555;border-radius:.4rem}
button{background:#fff;color:#1b1b1b;cursor:pointer}button:focus-visible{outline:3px solid #1a6fb0}
form{position:sticky;bottom:0;background:#fff;padding:.3rem 0}button{min-height:44px}h1{font-size:1.6rem}
button.main{background:#1a6fb0;color:#fff;border-color:#1a6fb0}
th.a{border-bottom:3px solid #000}th.b{border-bottom:3px dashed #d55e00}
@media(max-width:560px){body{margin:.5rem auto}h1{font-size:1.25rem}table{margin:.5rem 0}td{font-size:.9rem}
form{padding:.5rem 0;display:grid;grid-template-columns:1fr 1fr;gap:.5rem}
button{margin:0}}"""
HEAD = (
    "<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content='width=device-width'>"
    f"<title>Which do you prefer?</title><style>{STYLE}</style>"
)
LABELS = {"a": "I prefer a", "b": "I prefer b", "tie": "No difference", "stop": "Stop here"}


class Asked(Protocol):
    """What a page shows: the question that is open, or what came out."""

    @property
    def number(self) -> int: ...
    @property
    def words(self) -> str: ...
    @property
    def is_over(self) -> bool: ...
    def differences(self) -> list[Difference]: ...
    def picture(self) -> bytes: ...
    def result(self) -> list[str]: ...
    def answer(self, word: str) -> None: ...


def page_of(asked: Asked) -> str:
    """The page as it is now."""
    if asked.is_over:
        said = "".join(f"<p>{html.escape(printable(line))}</p>" for line in asked.result())
        return f"{HEAD}<h1>Thank you</h1>{said}<p>This page can be closed.</p>"
    rows = "".join(
        "<tr>"
        + "".join(f"<td>{html.escape(printable(cell))}</td>" for cell in (one.label, one.a, one.b, one.words))
        + "</tr>"
        for one in asked.differences()
    )
    image = b64encode(asked.picture()).decode()
    buttons = "".join(
        f"<button name=answer value={word}{' class=main' * (word in 'ab')}>{label}</button>"
        for word, label in LABELS.items()
    )
    return (
        f"{HEAD}<h1>{html.escape(asked.words)}</h1>"
        f"<img alt='Both ways on the map, a and b' src='data:image/png;base64,{image}'>"
        f"<table><tr><td></td><th class=a scope=col>a</th><th class=b scope=col>b</th><td></td></tr>{rows}</table>"
        f"<form method=post><input type=hidden name=question value={asked.number}>{buttons}</form>"
    )


def _page_of_loss(why: str, address: str) -> str:
    """What is said of an answer that could not be kept: its question is still open."""
    said = html.escape(printable(why))
    return (
        f"{HEAD}<h1>Once more, please</h1><p>The answer was not kept: {said}</p><p><a href={address}>Ask again</a></p>"
    )


class _Server(ThreadingHTTPServer):
    """Of one page."""

    daemon_threads = True
    timeout = 0.2

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that was closed is no error."""


def serve(asked: Asked, port: int, say: Callable[[str], None]) -> None:
    """Serve the page until all is answered and what came out was shown; OutputError where the port cannot be had."""
    token, lock, over = secrets.token_urlsafe(16), Lock(), Event()

    class Handler(BaseHTTPRequestHandler):
        timeout = PATIENCE
        server_version, sys_version = "hpop", ""

        def do_GET(self) -> None:
            """The question, or what came out; then the command ends."""
            if self._is_known():
                with lock:
                    page = page_of(asked).encode()
                    is_over = asked.is_over
                self._send(HTTPStatus.OK, page)
                if is_over:
                    over.set()

        def do_POST(self) -> None:
            """An answer, then the page again."""
            if not self._is_known():
                return
            length = self.headers.get("Content-Length", "")
            if not (length.isascii() and length.isdigit() and len(length) <= MOST_DIGITS and int(length) <= MOST_BYTES):
                self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, b"")
                return
            given = parse_qs(self.rfile.read(int(length)).decode("ascii", "replace"))
            word, number = given.get("answer", [""])[0], given.get("question", [""])[0]
            try:
                with lock:
                    if word in LABELS and number == str(asked.number) and not asked.is_over:
                        asked.answer(word)
            except OutputError as error:
                say(str(error))
                self._send(HTTPStatus.INTERNAL_SERVER_ERROR, _page_of_loss(str(error), f"/{token}").encode())
                return
            self.send_response(HTTPStatus.SEE_OTHER)
            self.send_header("Location", f"/{token}")
            self._end(0)

        def _is_known(self) -> bool:
            """Whether who asks knows the address of the page, and asks this machine for it by its own name."""
            names = {f"{name}:{server.server_address[1]}" for name in (HOST, "localhost")}
            known = secrets.compare_digest(self.path.encode("utf-8", "replace"), f"/{token}".encode())
            if self.headers.get("Host") in names and known:
                return True
            self._send(HTTPStatus.NOT_FOUND, b"")
            return False

        def _send(self, status: HTTPStatus, page: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self._end(len(page))
            self.wfile.write(page)

        def _end(self, length: int) -> None:
            self.send_header("Content-Length", str(length))
            for name, value in HEADERS.items():
                self.send_header(name, value)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            """Nothing: nobody reads it."""

    try:
        server = _Server((HOST, port), Handler)
    except OSError as error:
        raise OutputError(
            f"--web: port {port} of this machine cannot be had: {error.strerror or error}; choose another --port, or 0 "
            "for any that is free"
        ) from None
    with server:
        say(f"the questions are at http://{HOST}:{server.server_address[1]}/{token}")
        while not over.is_set():
            server.handle_request()
