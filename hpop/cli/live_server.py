"""Server process for the page of a running search: ``python -P -m hpop.cli.live_server SOCKET FOLDER ...``.

SOCKET is the number of an inherited listening socket. The arguments after FOLDER name the user's own code. The token is
in the environment, because command lines are visible to all users of a machine. Each line on standard input announces a
new front saved in FOLDER. If several come while the process is busy, only the newest is shown. At the end of the input
the process shows the last front and ends.

It answers only requests with the token, see :mod:`hpop.runtime.page_server`, and serves only the page and its events.
"""

from __future__ import annotations

import html
import json
import os
import socket
import sys
from asyncio import get_running_loop
from collections.abc import AsyncIterator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from threading import Condition, Thread

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route

from hpop import cli
from hpop.base.text import printable
from hpop.cli import results
from hpop.cli.beside import NICENESS, TOKEN
from hpop.runtime.page_server import CONNECTIONS, PageServer

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

ALIVE = 15.0  # s between keep-alive messages to a waiting page
FAREWELL = 2.0  # s for open pages to receive the end of the search
WAITING = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="refresh" content="1">
<link rel="icon" href="data:,">
<style>
:root {{ color-scheme: light dark }}
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 20vh auto; max-width: 36em; padding: 1em }}
</style>
<title>hpop: searching</title>
</head>
<body><main><h1>hpop: searching</h1><p role="status">{words}</p></main></body>
</html>
"""
SEARCHING = "The search has begun. Its first trajectories will be shown here as soon as they are found."


@dataclass(eq=False)
class LiveFront:
    """Newest front of a running search, shared by all open pages; pages wait here for the next front.

    number   number of fronts published so far
    page     HTML page of the newest front
    payload  data of the newest front, as one line of JSON
    ended    whether the search has ended
    streams  number of open pages that receive events
    """

    number: int = 0
    page: bytes = WAITING.format(words=SEARCHING).encode()
    payload: bytes = b""
    ended: bool = False
    streams: int = 0
    changed: Condition = field(default_factory=Condition)

    def publish(self, payload: dict[str, object]) -> None:
        """Replace the front on the page by a new one, and wake the requests that wait for it."""
        from hpop.view.explorer import SCRIPT
        from hpop.view.single_page import single_page

        live = {**payload, "live": self.number + 1}
        page = single_page(SCRIPT, str(payload["title"]), live, connect="'self'")
        text = json.dumps(payload, allow_nan=False, separators=(",", ":"))
        with self.changed:
            self.number += 1
            self.page, self.payload = page.encode(errors="backslashreplace"), text.encode()
            self.changed.notify_all()

    def failed(self, error: Exception) -> None:
        """Show an error on the page, but only if it has no front yet; otherwise the last front stays on the page."""
        said = html.escape(printable(f"{SEARCHING} The front found so far cannot be shown: {error!s:.600}"))
        with self.changed:
            if not self.number:
                self.page = WAITING.format(words=said).encode(errors="backslashreplace")

    def since(self, seen: int) -> tuple[int, bytes, bool]:
        """Wait until a front newer than number ``seen`` is published, the search ends, or `ALIVE` s pass.

        Return the number and payload of the newest front, and whether the search has ended.
        """
        with self.changed:
            self.changed.wait_for(lambda: self.number > seen or self.ended, ALIVE)
            return self.number, self.payload, self.ended

    @contextmanager
    def stream(self) -> Iterator[None]:
        """Count one more open page while the ``with`` block runs."""
        with self.changed:
            self.streams += 1
        try:
            yield
        finally:
            with self.changed:
                self.streams -= 1
                self.changed.notify_all()

    def end(self) -> None:
        """Notify all open pages that the search has ended, and wait up to `FAREWELL` s until they have received it."""
        with self.changed:
            self.ended = True
            self.changed.notify_all()
            self.changed.wait_for(lambda: self.streams == 0, FAREWELL)


def server_of(listening: socket.socket, token: str, shown: LiveFront) -> PageServer:
    """Return a server of the page with the current front, and of a stream of events that sends the page new fronts.

    listening  socket on which the server listens
    token      secret first part of the path in the page's address
    shown      the front
    """
    waiting = ThreadPoolExecutor(CONNECTIONS)  # each open page waits for the next front in a thread

    def page(request: Request) -> Response:
        if not request.scope["raw_path"].endswith(b"/"):  # the page needs the last slash to find its events
            return RedirectResponse(f"/{token}/", HTTPStatus.MOVED_PERMANENTLY)
        return HTMLResponse(shown.page)

    def events(request: Request) -> Response:
        """Send fronts as server-sent events, beginning with those published since the page was made."""
        known = [request.headers.get("Last-Event-ID", ""), *request.query_params.getlist("after")]
        seen = max((int(number) for number in known if number.isascii() and number.isdigit()), default=0)
        return StreamingResponse(messages(seen), media_type="text/event-stream")

    async def messages(seen: int) -> AsyncIterator[bytes]:
        with shown.stream():
            yield b"retry: 1000\n\n"
            while True:
                number, payload, ended = await get_running_loop().run_in_executor(waiting, shown.since, seen)
                if number > seen:
                    yield b"id: %d\nevent: front\ndata: %s\n\n" % (number, payload)
                    seen = number
                elif ended:
                    yield b"event: end\ndata:\n\n"
                    return
                else:
                    yield b":\n\n"

    return PageServer([Route("/", page), Route("/events", events)], token=token, listening=listening)


def follow(shown: LiveFront, folder: Path, imports: Sequence[str], pipe: int) -> None:
    """Publish the front saved in a folder after each message on a pipe; return when the pipe is closed."""
    cli.user_code.register(imports)
    while os.read(pipe, 2**16):  # messages that came meanwhile count as one
        try:
            shown.publish(results.page_payload(folder / results.SAVED))
        except Exception as error:
            shown.failed(error)


def main(number: int, token: str, folder: Path, imports: Sequence[str]) -> None:
    """Serve the front saved in a folder until the command that started this process ends.

    number  file descriptor of the listening socket
    token   secret part of the page's address
    """
    shown = LiveFront()
    with socket.socket(fileno=number) as listening, server_of(listening, token, shown) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        if hasattr(os, "nice"):
            os.nice(NICENESS)  # the search comes first
        follow(shown, folder, imports, sys.stdin.fileno())
        shown.end()


if __name__ == "__main__":
    main(int(sys.argv[1]), os.environ[TOKEN], Path(sys.argv[2]), sys.argv[3:])
