"""Server of a study: it serves each participant's page, and saves each answer at once.

It serves the pages, the stimuli and, to each page, the events recorded so far, and no other file. Requests are checked
by :mod:`hpop.runtime.page_server`.
"""

from __future__ import annotations

import base64
import hmac
import html
import os
import re
import secrets
import ssl
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from threading import Lock
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from hpop.base.files import open_regular
from hpop.errors import HpopError, OutputError, StudyError
from hpop.frontier.strict_json import parse
from hpop.runtime.page_server import LOCAL, PageServer, body, same
from hpop.study.answers import Ledger
from hpop.study.conditions import FILE, PEOPLE
from hpop.study.design import Design
from hpop.study.documents import (
    ANSWERS,
    Words,
    locked_for_changes,
    read_bytes,
    release,
    serve_alone,
    words,
    write_bytes,
)
from hpop.study.markers import Markers
from hpop.study.page import MOST_BYTES, Rides, rides_of, session_page

MOST_BODY = 16_384
"""Largest size of a request, in bytes: one event, and a description of the device."""
MOST_VIDEO = 2**33
"""Largest size of a video, in bytes."""
TOKEN, TOKEN_BYTES, MOST_TOKEN = "token", 9, 100
TOKEN_LETTERS = 12
"""Length of a participant's token."""
KEYS = {"design", "tab", "device"}
"""Keys of the JSON object that a page sends; "event", and "now", the page's own time in ms, are optional."""
LONGEST_TAB = 64
PAGE = """<!doctype html>
<html lang="{language}">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<link rel="icon" href="data:,">
<style>
:root {{ color-scheme: light dark; background: #fff; color: #1c2126 }}
body {{ font: 18px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 36em; padding: 0 1em }}
a {{ display: inline-block; min-width: 4em; line-height: 2.5; color: #14507a }}
@media (prefers-color-scheme: dark) {{ :root {{ background: #15191d; color: #e9ecef }} a {{ color: #8ec5ee }} }}
</style>
<title>hpop: {title}</title>
</head>
<body><main><h1>{title}</h1><p>{said}</p>{rest}</main></body>
</html>
"""
"""Page without scripts, for the list of sessions and for refusals."""


class Refusal(Exception):
    """Error that refuses a request of a page: an HTTP status, the reason in words, and a key for the page's script."""

    def __init__(self, status: HTTPStatus, said: str, why: str = "") -> None:
        super().__init__(said)
        self.status, self.said, self.why = status, said, why


@dataclass(eq=False)
class Study:
    """Folder of a study as the server sees it; files are read again when they change.

    folder  folder of the study
    tabs    by participant, the browser window that may record: the last one opened
    markers stream of Lab Streaming Layer to which each new event is sent; None for none
    """

    folder: Path
    tabs: dict[str, str] = field(default_factory=dict)
    markers: Markers | None = None
    _lock: Lock = field(default_factory=Lock)
    _known: tuple[tuple[int, ...], Design] | None = None
    _rides: tuple[tuple[int, ...], Rides] | None = None

    @property
    def design(self) -> Design:
        """Return the design; if its files have changed, such as after a participant was withdrawn, it is read again."""
        state = _state(self.folder / FILE, self.folder / PEOPLE)
        if self._known is None or self._known[0] != state:
            self._known = (state, Design.load(self.folder))
        return self._known[1]

    def page(self, participant: str) -> str:
        """Return the HTML of a participant's session page; Refusal if the participant is unknown or withdrew."""
        design = self._with(participant)
        public = design.public(participant)
        state = _state(*(self.folder / one.stimulus for one in design.conditions if one.stimulus))
        if self._rides is None or self._rides[0] != state:
            self._rides = (state, rides_of(public, self.folder))
        return session_page(public, self.folder, served=True, rides=self._rides[1])

    def stimulus(self, name: str) -> Path:
        """Return the path of a stimulus file by its name in the design; Refusal for any other name."""
        for condition in self.design.conditions:
            if name and condition.stimulus == name:
                return self.folder / name
        raise Refusal(HTTPStatus.NOT_FOUND, "the study has no such stimulus")

    def taken(self, participant: str, sent: Any) -> dict[str, Any]:
        """Save the event that a page sent, or open the session if it sent none.

        Returns whether the event is new; or, when a session is opened, all events so far. Raises Refusal if the session
        has since been opened in another window, or the request is invalid.
        """
        if not isinstance(sent, dict) or not KEYS <= sent.keys() <= {*KEYS, "event", "now"}:
            raise Refusal(
                HTTPStatus.BAD_REQUEST, "expected an object of design, tab, device, and of an event if there is one"
            )
        tab, event = sent["tab"], sent.get("event")
        if not isinstance(tab, str) or not 0 < len(tab) <= LONGEST_TAB or not isinstance(sent["device"], dict):
            raise Refusal(HTTPStatus.BAD_REQUEST, "expected a short text as tab and an object as device")
        with self._lock, locked_for_changes(self.folder):  # no event is added while a participant is withdrawn
            design = self._with(participant)
            if sent["design"] != design.digest:
                raise Refusal(
                    HTTPStatus.CONFLICT,
                    "this page belongs to another design than the one that is served; reload it",
                    "design",
                )
            ledger = Ledger(self.folder / ANSWERS / f"{participant}.json", design, participant)
            if event is None:
                self.tabs[participant] = tab
                return {"events": ledger.events}
            if self.tabs.setdefault(participant, tab) != tab:
                raise Refusal(HTTPStatus.CONFLICT, "the session has since been opened in another window", "elsewhere")
            if not isinstance(event, dict):
                raise Refusal(HTTPStatus.BAD_REQUEST, "expected an object as event")
            added = ledger.add(event, sent["device"])
        if added and self.markers is not None:
            self.markers.push(participant, event, sent.get("now"))
        return {"added": added}

    def _with(self, participant: str) -> Design:
        """Return the design; Refusal if it has no such participant, or the participant withdrew."""
        design = self.design
        if participant not in {person.id for person in design.participants}:
            raise Refusal(HTTPStatus.NOT_FOUND, "the study has no such participant")
        if participant in design.withdrawn:
            raise Refusal(HTTPStatus.GONE, "this session is closed", "withdrawn")
        return design


class StudyServer(PageServer):
    """Web server for the sessions of a study.

    Parameters
    ----------
    port : 0 for any free port
    host : an address of this machine; other addresses than 127.0.0.1 need ``secured`` and ``token``
    names : further names that requests may use
    token : required first part of the address of the list of sessions. Each participant's own token is derived from it
        and the id, and is the first part of the address of the participant's page
    secured : context that encrypts the connections
    tell : called with messages for the experimenter, such as that answers cannot be written
    markers : stream to which each event is sent as a marker (:class:`hpop.study.markers.Markers`)

    Raises StudyError if the folder has no study, lacks stimuli or is served already, OutputError if the port is taken.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        port: int = 0,
        host: str = LOCAL,
        names: Sequence[str] = (),
        token: str = "",
        secured: ssl.SSLContext | None = None,
        tell: Callable[[str], None] | None = None,
        markers: Markers | None = None,
    ) -> None:
        self.study = Study(Path(folder), markers=markers)
        self.tell = tell
        self.study.page(self.study.design.expected[0].id)  # reports faults now, not to the first participant
        answers = self.study.folder / ANSWERS
        try:
            answers.mkdir(exist_ok=True)
        except OSError as error:
            raise StudyError(
                f"cannot create {answers}, the folder for answers: {error.strerror or error}; allow writing to the "
                "study's folder"
            ) from None
        self._held = serve_alone(answers)
        try:
            routes = [
                Route("/answers/{participant:path}", self._take, methods=["POST"]),
                Route("/stimuli/{name:path}", self._stimulus),
                Route("/{participant:path}", self._page),
            ]
            errors = {Refusal: self._refuse, HpopError: self._fail}
            super().__init__(routes, errors=errors, host=host, port=port, names=names, token=token, secured=secured)
        except OutputError:
            release(self._held)
            raise

    def server_close(self) -> None:
        """Release the port and the folder."""
        super().server_close()
        held, self._held = self._held, None
        release(held)

    def address(self, name: str = LOCAL) -> str:
        """Return the address of the list of sessions.

        With a participant's id appended it leads to that participant's page.
        """
        return f"{self.root(name)}/{self.token}{'/' if self.token else ''}"

    def token_of(self, participant: str) -> str:
        """Return the token in the address of a participant's page, or "" if the server has none.

        It does not reveal the tokens of others.
        """
        if not self.token:
            return ""
        made = hmac.digest(self.token.encode(), participant.encode(), "sha256")
        return base64.urlsafe_b64encode(made)[:TOKEN_LETTERS].decode()

    def address_of(self, participant: str) -> str:
        """Return the path of a participant's page on this server."""
        token = self.token_of(participant)
        return f"/{token}/{participant}" if token else f"/{participant}"

    def is_open(self, token: str) -> bool:
        """Return whether a token in a request is valid: the experimenter's or a participant's.

        It is True for any token if the design cannot be read, so that the page can say why.
        """
        try:
            return same(token, self.token) or self._owner(token) is not None
        except HpopError:
            return True  # the page says what is wrong with the design

    def refused(self, method: str, status: HTTPStatus, reason: str, why: str = "") -> Response:
        """Return the response to a refused request: a readable page for GET, JSON for a POST by a page's script."""
        if method == "POST":
            return JSONResponse({"error": reason, "why": why}, status)
        language, texts = self._texts()
        about = html.escape(texts["nowhere_about"].format(reason=reason))
        call = f"<p>{html.escape(texts['nowhere_call'])}</p>"
        page = PAGE.format(language=language, title=html.escape(texts["nowhere_title"]), said=about, rest=call)
        return HTMLResponse(page.encode(errors="backslashreplace"), status)

    def _texts(self) -> tuple[str, Words]:
        """Return the language of the study, and its texts; English if the design or its texts cannot be read."""
        try:
            language = self.study.design.language
            return language, words(language, self.study.folder)
        except HpopError:
            return "en", words("en")

    def _owner(self, token: str) -> str | None:
        """Return the id of the participant who owns a token; None if there is none."""
        people = (person.id for person in self.study.design.participants)
        return next((participant for participant in people if same(token, self.token_of(participant))), None)

    def _check_owner(self, request: Request, participant: str) -> None:
        """Raise Refusal unless a request has the participant's own token; a server without tokens refuses none."""
        if self.token and self._owner(request.scope["token"]) != participant:
            raise Refusal(HTTPStatus.NOT_FOUND, "there is nothing here")

    def _page(self, request: Request) -> Response:
        """Return a participant's page, or, for an address without a participant, the list of sessions.

        With the experimenter's token, a participant's address redirects to the participant's own address.
        """
        participant = request.path_params["participant"]
        if not self.token or same(request.scope["token"], self.token):
            if not participant:
                return HTMLResponse(self._list())
            if self.token:
                return self._redirection(participant)
        self._check_owner(request, participant)
        return HTMLResponse(self.study.page(participant).encode(errors="backslashreplace"))

    def _redirection(self, participant: str) -> Response:
        """Return a redirection to the address of a participant's page."""
        if participant not in {person.id for person in self.study.design.participants}:
            raise Refusal(HTTPStatus.NOT_FOUND, "the study has no such participant")
        return RedirectResponse(self.address_of(participant), HTTPStatus.FOUND)

    def _list(self) -> str:
        """Return a page with links to the sessions of all expected participants, which does not show their progress."""
        names = [person.id for person in self.study.design.expected]
        links = " ".join(f'<a href="{self.address_of(name)}">{html.escape(name)}</a>' for name in names)
        said = "A page for each participant. schedule.csv says who is next."
        return PAGE.format(language="en", title="Sessions", said=said, rest=f"<nav>{links}</nav>")

    def _stimulus(self, request: Request) -> Response:
        """Return a stimulus file, or the requested range of a video."""
        path = self.study.stimulus(f"stimuli/{request.path_params['name']}")
        is_page = path.suffix == ".html"
        try:
            open_regular(path, MOST_BYTES if is_page else MOST_VIDEO).close()
        except OSError:
            raise Refusal(
                HTTPStatus.NOT_FOUND, "the file of this stimulus is missing or cannot be read; restore the file"
            ) from None
        return FileResponse(path, media_type="text/html" if is_page else "video/mp4")

    async def _take(self, request: Request) -> Response:
        """Save an event that a page sent, or open a session."""
        participant = request.path_params["participant"]
        sent = await _posted_value(request)

        def take() -> dict[str, Any]:
            self._check_owner(request, participant)
            return self.study.taken(participant, sent)

        return JSONResponse(await run_in_threadpool(take))

    def _refuse(self, request: Request, refusal: Exception) -> Response:
        """Return the response for a Refusal."""
        assert isinstance(refusal, Refusal)
        return self.refused(request.method, refusal.status, refusal.said, refusal.why)

    def _fail(self, request: Request, error: Exception) -> Response:
        """Return the response for an error: status 500 for one of this machine, such as a full disk, else 422.

        After a status 500 a page tries again; after 422, an invalid request, it gives up.
        """
        is_ours = isinstance(error.__context__, OSError) or isinstance(error, OutputError)
        status = HTTPStatus.INTERNAL_SERVER_ERROR if is_ours else HTTPStatus.UNPROCESSABLE_ENTITY
        if is_ours and self.tell is not None:
            self.tell(str(error))
        return self.refused(request.method, status, str(error), "disk" if is_ours else "answer")


async def _posted_value(request: Request) -> Any:
    """Return the JSON value in the body of a request; Refusal if it is not JSON, or too long."""
    if request.headers.get("Content-Type", "").partition(";")[0].strip().lower() != "application/json":
        raise Refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
    if not request.headers.get("Content-Length", ""):
        raise Refusal(HTTPStatus.LENGTH_REQUIRED, "expected Content-Length")
    data = await body(request, MOST_BODY)
    if data is None:
        raise Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MOST_BODY:,} bytes")
    try:
        return parse(data)
    except (ValueError, RecursionError):
        raise Refusal(HTTPStatus.BAD_REQUEST, "expected JSON") from None


def token_of(folder: str | os.PathLike[str]) -> str:
    """Return the token of a study's addresses, which is created once and stored in the folder to stay valid."""
    path = Path(folder) / TOKEN
    if not path.exists():
        write_bytes(path, secrets.token_urlsafe(TOKEN_BYTES).encode())
    token = read_bytes(path, MOST_TOKEN).decode("ascii", "replace").strip()
    if not re.fullmatch(r"[A-Za-z0-9_-]{8,64}", token):
        raise StudyError(
            f"{path} must hold a token of at least 8 letters, digits, - and _; remove it, and a new one is made"
        )
    return token


def _state(*paths: Path) -> tuple[int, ...]:
    """Return a key that changes when one of some files changes: their modification times."""
    return tuple(path.stat().st_mtime_ns if path.exists() else 0 for path in paths)
