"""Server of a study: it serves each participant's page, and saves each answer at once.

It serves the pages, the stimuli and, to each page, the events recorded so far, and no other file. Requests are checked
by :mod:`hpop.runtime.page_server`.
"""

from __future__ import annotations

import base64
import hmac
import html
import json
import os
import re
import secrets
import ssl
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from threading import Lock
from typing import Any

from hpop.base.files import open_regular
from hpop.errors import HpopError, OutputError, StudyError
from hpop.frontier.strict_json import parse
from hpop.runtime.page_server import LOCAL, PIECE, PageHandler, PageServer
from hpop.study.answers import FOLDER, Ledger
from hpop.study.design import Design
from hpop.study.design_file import FILE, PEOPLE
from hpop.study.documents import changing, read_bytes, release, serve_alone, write_bytes
from hpop.study.page import MOST_BYTES, Rides, rides_of, session_page

MOST_BODY = 16_384
"""Bytes of what a page sends: one event, and what it is seen on."""
MOST_VIDEO = 2**33
"""Bytes of a video."""
TOKEN, TOKEN_BYTES, MOST_TOKEN = "token", 9, 100
TOKEN_LETTERS = 12
"""Of a participant's token."""
KEYS = {"design", "tab", "device"}
"""Of what a page sends; with an event where there is one."""
LONGEST_TAB = 64
PART = re.compile(r"bytes=([0-9]{1,18})-([0-9]{1,18})?")
PAGE = """<!doctype html>
<html lang="en">
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
"""A page with no script: the list of sessions, and what a browser is told that asks for what there is not."""


class Refusal(Exception):
    """Refusal of a page's request: a status, and the reason in words."""

    def __init__(self, status: HTTPStatus, said: str, why: str = "") -> None:
        super().__init__(said)
        self.status, self.said, self.why = status, said, why


@dataclass(eq=False)
class Study:
    """Folder of a study as its pages see it; files are read again when they change.

    folder  of the study
    tabs    recording window by participant: the last one opened
    """

    folder: Path
    tabs: dict[str, str] = field(default_factory=dict)
    _lock: Lock = field(default_factory=Lock)
    _known: tuple[tuple[int, ...], Design] | None = None
    _rides: tuple[tuple[int, ...], Rides] | None = None

    @property
    def design(self) -> Design:
        """Return the design, read again if its files have changed because a participant left."""
        state = _state(self.folder / FILE, self.folder / PEOPLE)
        if self._known is None or self._known[0] != state:
            self._known = (state, Design.load(self.folder))
        return self._known[1]

    def page(self, participant: str) -> str:
        """Return the page of a participant; Refusal if there is none."""
        design = self._with(participant)
        public = design.public(participant)
        state = _state(*(self.folder / condition.stimulus for condition in design.conditions))
        if self._rides is None or self._rides[0] != state:
            self._rides = (state, rides_of(public, self.folder))
        return session_page(public, self.folder, served=True, rides=self._rides[1])

    def stimulus(self, name: str) -> Path:
        """Return the file of a stimulus, by its name in the design; Refusal for another name."""
        for condition in self.design.conditions:
            if condition.stimulus == name:
                return self.folder / name
        raise Refusal(HTTPStatus.NOT_FOUND, "there is no such stimulus")

    def taken(self, participant: str, sent: Any) -> dict[str, Any]:
        """Save an event of a page, or open the page; return all events after opening, else whether it was added."""
        if not isinstance(sent, dict) or not KEYS <= sent.keys() <= {*KEYS, "event"}:
            raise Refusal(
                HTTPStatus.BAD_REQUEST, "expected an object of design, tab, device, and of an event if there is one"
            )
        tab, event = sent["tab"], sent.get("event")
        if not isinstance(tab, str) or not 0 < len(tab) <= LONGEST_TAB or not isinstance(sent["device"], dict):
            raise Refusal(HTTPStatus.BAD_REQUEST, "expected a short text as tab and an object as device")
        with self._lock, changing(self.folder):  # no event is added while a participant is withdrawn
            design = self._with(participant)
            if sent["design"] != design.digest:
                raise Refusal(
                    HTTPStatus.CONFLICT,
                    "this page is of another design than the one that is served; reload it",
                    "design",
                )
            ledger = Ledger(self.folder / FOLDER / f"{participant}.json", design, participant)
            if event is None:
                self.tabs[participant] = tab
                return {"events": ledger.events}
            if self.tabs.setdefault(participant, tab) != tab:
                raise Refusal(HTTPStatus.CONFLICT, "the session was opened in another window since", "elsewhere")
            if not isinstance(event, dict):
                raise Refusal(HTTPStatus.BAD_REQUEST, "expected an object as event")
            return {"added": ledger.add(event, sent["device"])}

    def _with(self, participant: str) -> Design:
        """Return the design, if it has the participant; Refusal otherwise."""
        design = self.design
        if participant not in {person.id for person in design.participants}:
            raise Refusal(HTTPStatus.NOT_FOUND, "the study has no such participant")
        if participant in design.withdrawn:
            raise Refusal(HTTPStatus.GONE, "this session is closed", "withdrawn")
        return design


class StudyServer(PageServer):
    """Server of the sessions in a study's folder.

    Parameters
    ----------
    port : 0 for any free port
    host : an address of this machine; other addresses than 127.0.0.1 need ``secured`` and ``token``
    names : further names that requests may use
    token : required first part of the address of the list of sessions; participants' tokens are derived from it and the
        id, and are the first part of the address of their page
    secured : context that encrypts the connections
    tell : called with messages for the experimenter, such as that answers cannot be written

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
    ) -> None:
        self.study = Study(Path(folder))
        self.tell = tell
        self.study.page(self.study.design.expected[0].id)  # reports faults now, not to the first participant
        self.token = token
        answers = self.study.folder / FOLDER
        try:
            answers.mkdir(exist_ok=True)
        except OSError as error:
            raise StudyError(f"cannot make {answers}, where answers go: {error.strerror or error}") from None
        self._held = serve_alone(answers)
        try:
            super().__init__(_StudyHandler, host=host, port=port, names=names, secured=secured)
        except OutputError:
            release(self._held)
            raise

    def server_close(self) -> None:
        """Release the port and the folder."""
        super().server_close()
        held, self._held = self._held, None
        release(held)

    def address(self, name: str = LOCAL) -> str:
        """Return the address of the list of sessions, as typed into a browser; a participant's has the id appended."""
        return f"{self.root(name)}/{self.token}{'/' if self.token else ''}"

    def token_of(self, participant: str) -> str:
        """Return the token of a participant's address, or ""; it reveals no other token."""
        if not self.token:
            return ""
        made = hmac.digest(self.token.encode(), participant.encode(), "sha256")
        return base64.urlsafe_b64encode(made)[:TOKEN_LETTERS].decode()

    def address_of(self, participant: str) -> str:
        """Return the path of a participant's page."""
        token = self.token_of(participant)
        return f"/{token}/{participant}" if token else f"/{participant}"


class _StudyHandler(PageHandler):
    """Handler of one request."""

    server: StudyServer
    _is_own: bool = True
    """Whether the request has the experimenter's token, or no token is required."""
    _owner: str | None = None
    """Participant of the request's token."""

    def answer(self) -> None:
        """Send a page or a stimulus."""
        with self._told():
            name = self._asked()
            if name == "" and self._is_own:
                self.page(self._list())
            elif name.startswith("stimuli/"):
                self._file(self.server.study.stimulus(name))
            elif self._is_own and self.server.token:
                self._send_on(name)
            else:
                self._check_owner(name)
                self.page(self.server.study.page(name).encode(errors="backslashreplace"))

    def take(self) -> None:
        """Save an event of a session, or open its page."""
        with self._told():
            folder, _, participant = self._asked().partition("/")
            if folder != FOLDER:
                raise Refusal(HTTPStatus.NOT_FOUND, "nothing is taken here")
            self._check_owner(participant)
            self._reply(HTTPStatus.OK, self.server.study.taken(participant, self._body()))

    def _asked(self) -> str:
        """Return the requested path without its token; Refusal for a wrong token."""
        path = self.path.partition("?")[0].removeprefix("/")
        if self.server.token:
            given, _, path = path.partition("/")
            self._is_own = _same(given, self.server.token)
            people = [person.id for person in self.server.study.design.participants]
            self._owner = next((one for one in people if _same(given, self.server.token_of(one))), None)
            if not self._is_own and self._owner is None:
                raise Refusal(HTTPStatus.NOT_FOUND, "there is nothing here")
        return path

    def _check_owner(self, participant: str) -> None:
        """Raise Refusal if the token belongs to another participant."""
        if self.server.token and self._owner != participant:
            raise Refusal(HTTPStatus.NOT_FOUND, "there is nothing here")

    def _send_on(self, participant: str) -> None:
        """Redirect the experimenter from an id to the address of the participant's page."""
        if participant not in {person.id for person in self.server.study.design.participants}:
            raise Refusal(HTTPStatus.NOT_FOUND, "the study has no such participant")
        self.page(b"", status=HTTPStatus.FOUND, Location=self.server.address_of(participant))

    def _body(self) -> Any:
        """Return the posted value; Refusal if it is no JSON or too long."""
        if self.headers.get_content_type() != "application/json":
            raise Refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
        if not self.headers.get("Content-Length", ""):
            raise Refusal(HTTPStatus.LENGTH_REQUIRED, "expected Content-Length")
        data = self.body(MOST_BODY)
        if data is None:
            raise Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MOST_BODY:,} bytes")
        try:
            return parse(data)
        except (ValueError, RecursionError):
            raise Refusal(HTTPStatus.BAD_REQUEST, "expected JSON") from None

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Send refusals and errors to the client."""
        try:
            yield
        except Refusal as refused:
            self._refuse(refused.status, refused.said, refused.why)
        except HpopError as error:
            # After an invalid request the page gives up; after a full disk it tries again.
            is_ours = isinstance(error.__context__, OSError) or isinstance(error, OutputError)
            status = HTTPStatus.INTERNAL_SERVER_ERROR if is_ours else HTTPStatus.UNPROCESSABLE_ENTITY
            if is_ours and self.server.tell is not None:
                self.server.tell(str(error))
            self._refuse(status, str(error), "disk" if is_ours else "answer")

    def refused(self, status: HTTPStatus, said: str) -> None:
        self._refuse(status, said, "")

    def _refuse(self, status: HTTPStatus, said: str, why: str) -> None:
        """Send a refusal: a readable page for GET, JSON for a page's POST."""
        if self.command == "POST":
            self._reply(status, {"error": said, "why": why})
            return
        told = html.escape(f"The study's computer says: {said}.")
        advice = "<p>Please call the person who runs the study.</p>"
        page = PAGE.format(title="There is no session here", said=told, rest=advice)
        self.page(page.encode(errors="backslashreplace"), status=status)

    def _reply(self, status: HTTPStatus, values: dict[str, Any]) -> None:
        self.page(json.dumps(values, allow_nan=False).encode(), "application/json", status)

    def _list(self) -> bytes:
        """Return links to the expected sessions, without their progress."""
        names = [person.id for person in self.server.study.design.expected]
        links = " ".join(f'<a href="{self.server.address_of(name)}">{html.escape(name)}</a>' for name in names)
        said = "A page for each participant. schedule.csv says who is next."
        return PAGE.format(title="Sessions", said=said, rest=f"<nav>{links}</nav>").encode()

    def _file(self, path: Path) -> None:
        """Send a stimulus, or the requested part of a video."""
        is_page = path.suffix == ".html"
        try:
            file = open_regular(path, MOST_BYTES if is_page else MOST_VIDEO)
        except OSError:
            raise Refusal(HTTPStatus.NOT_FOUND, "there is no such stimulus") from None
        with file:
            size = os.fstat(file.fileno()).st_size
            begin, end = _range(self.headers.get("Range"), size)
            is_part = (begin, end) != (0, size)
            self.send_response(HTTPStatus.PARTIAL_CONTENT if is_part else HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8" if is_page else "video/mp4")
            self.send_header("Content-Length", str(end - begin))
            self.send_header("Accept-Ranges", "bytes")
            if is_part:
                self.send_header("Content-Range", f"bytes {begin}-{end - 1}/{size}")
            self.end_headers()
            file.seek(begin)
            while begin < end and (piece := file.read(min(PIECE, end - begin))):
                self.send(piece)
                begin += len(piece)


def _same(given: str, token: str) -> bool:
    return secrets.compare_digest(given.encode("utf-8", "replace"), token.encode())


def token_of(folder: str | os.PathLike[str]) -> str:
    """Return the token of a study's addresses, created once and kept in its folder, so that addresses stay valid."""
    path = Path(folder) / TOKEN
    if not path.exists():
        write_bytes(path, secrets.token_urlsafe(TOKEN_BYTES).encode())
    token = read_bytes(path, MOST_TOKEN).decode("ascii", "replace").strip()
    if not re.fullmatch(r"[A-Za-z0-9_-]{8,64}", token):
        raise StudyError(
            f"{path} holds no token of at least 8 letters, digits, - and _; remove it, and another is made"
        )
    return token


def _range(asked: str | None, size: int) -> tuple[int, int]:
    """Return begin and end of a byte range such as "bytes=0-" or "bytes=5-9"; the whole file otherwise."""
    part = PART.fullmatch(asked or "")
    if part is None:
        return 0, size
    begin, end = int(part[1]), min(int(part[2]) + 1, size) if part[2] else size
    return (begin, end) if begin < end else (0, size)


def _state(*paths: Path) -> tuple[int, ...]:
    """Return a key that changes when one of the files changes."""
    return tuple(path.stat().st_mtime_ns if path.exists() else 0 for path in paths)
