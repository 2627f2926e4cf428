"""Web server of a live session: its page, and the websocket through which pages and session talk.

There are two tokens: one for those who may drive, one for those who only watch. Each is the first part of an address.
"""

from __future__ import annotations

import asyncio
import secrets
import ssl
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from http import HTTPStatus
from typing import Any

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from hpop.live.scene import WHEP, video_origin
from hpop.live.viewer import Audience, Viewer
from hpop.runtime.page_server import LOCAL, PageServer, same
from hpop.view.explorer import SCRIPT as EXPLORER
from hpop.view.single_page import bundle, single_page

GREETING = 10.0
"""Time, s, within which a page must say hello; other messages do not count."""
READS = 10.0
"""Time, s, within which a page must read a message."""
GOING = 1008
"""Code with which a socket is closed that breaks the rules."""
NO_FRONT = "there are no ways to explore now; choose a destination on the live page, then try again"
PLACEHOLDER = """<!doctype html><html lang="en"><meta charset="utf-8"><title>hpop live</title>
<p>The page of live sessions is not built. The websocket at <code>socket</code> works.</p></html>"""


class LiveServer(PageServer):
    """Server of a live session.

    session  the session; it runs while the server serves
    driving, watching  secret tokens in the addresses of viewers who may drive, and of those who watch; random if ""
    """

    def __init__(
        self,
        session: Audience,
        *,
        port: int = 0,
        host: str = LOCAL,
        names: Sequence[str] = (),
        secured: ssl.SSLContext | None = None,
        driving: str = "",
        watching: str = "",
    ) -> None:
        self.session, self.greeting = session, GREETING
        self.watching = watching or secrets.token_urlsafe(9)
        routes = [
            Route("/", self._page),
            Route("/explore", self._explore),
            WebSocketRoute("/socket", self._connect),
        ]
        token = driving or secrets.token_urlsafe(9)
        super().__init__(routes, host=host, port=port, names=names, token=token, secured=secured, sockets=True)

    def address(self, name: str = LOCAL, *, drives: bool = True) -> str:
        """Return the address of the page, for a viewer who may drive or for one who watches."""
        return f"{self.root(name)}/{self.token if drives else self.watching}/"

    def is_open(self, token: str) -> bool:
        """Return whether a token is one of the two of this server."""
        return same(token, self.token) or same(token, self.watching)

    @asynccontextmanager
    async def alongside(self) -> AsyncIterator[None]:
        """Run the session while the server serves; if the session fails, the server ends and raises its error."""
        task = asyncio.create_task(self.session.run())
        task.add_done_callback(lambda _: self.ends())
        try:
            yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    def _page(self, request: Request) -> Response:
        token = request.scope["token"]
        if not request.scope["raw_path"].endswith(b"/"):  # the page needs the last slash to find its socket
            return RedirectResponse(f"/{token}/")
        role = "drive" if same(token, self.token) else "watch"
        payload = {"schema": "hpop-live", "version": 1, "title": self.session.scene["title"], "role": role}
        try:
            bundle("live.js")
        except OSError:
            return HTMLResponse(PLACEHOLDER)
        camera = video_origin(self.session.scene.get("video", ""))
        connect = "'self'" + (f" {camera}" if self.session.scene.get("video", "").startswith(WHEP) else "")
        page = single_page("live.js", payload["title"], {**payload, "token": token}, connect=connect, images=camera)
        return HTMLResponse(page.encode(errors="backslashreplace"))

    async def _explore(self, request: Request) -> Response:
        """Return the explorer with the front of the ways that were offered last, to those who may drive."""
        data = await self.session.explorer() if same(request.scope["token"], self.token) else None
        if data is None:
            return self.refused(request.method, HTTPStatus.NOT_FOUND, NO_FRONT)
        return HTMLResponse(single_page(EXPLORER, data["title"], data).encode(errors="backslashreplace"))

    async def _connect(self, socket: WebSocket) -> None:
        """Connect a page with the session until one of them ends it."""
        await socket.accept()
        token = socket.scope["token"]
        viewer = self.session.join(may_drive=same(token, self.token))
        if viewer is None:
            await socket.close(GOING, "there are too many viewers")
            return
        tasks = [asyncio.create_task(work) for work in (self._read(socket, viewer), self._write(socket, viewer))]
        try:
            with suppress(asyncio.CancelledError):  # the server ends
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self.session.leave(viewer)
        if viewer.gone:
            with suppress(RuntimeError, WebSocketDisconnect, TimeoutError):
                await asyncio.wait_for(socket.close(GOING, viewer.gone), 1.0)

    async def _read(self, socket: WebSocket, viewer: Viewer) -> None:
        last = asyncio.get_running_loop().time() + self.greeting
        with suppress(WebSocketDisconnect):
            while not viewer.gone:
                wait = None if viewer.greeted else last - asyncio.get_running_loop().time()
                try:
                    message: Any = await asyncio.wait_for(socket.receive(), wait)
                except TimeoutError:
                    viewer.gone = f"did not say hello within {self.greeting:g} s"
                    return
                if message["type"] == "websocket.disconnect":
                    return
                if (text := message.get("text")) is None:
                    viewer.refuse("expected JSON as text")
                else:
                    self.session.receive(viewer, text)

    async def _write(self, socket: WebSocket, viewer: Viewer) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):
            while not viewer.gone:
                await viewer.wakes.wait()
                viewer.wakes.clear()
                while viewer.waiting and not viewer.gone:
                    await self._send(socket, viewer, viewer.next_text())
                state, viewer.state = viewer.state, ""
                if state and not viewer.gone:
                    await self._send(socket, viewer, state)

    async def _send(self, socket: WebSocket, viewer: Viewer, text: str) -> None:
        try:
            await asyncio.wait_for(socket.send_text(text), READS)
        except TimeoutError:
            viewer.gone = "reads too slowly"
