"""Every server of pages answers its own names and pages alone, and a silent client keeps no other waiting."""

from __future__ import annotations

import errno
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path
from threading import Event, Thread, active_count
from time import sleep
from types import SimpleNamespace

import pytest
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

import hpop
from hpop import study
from hpop.cli import serving
from hpop.cli.live_server import LiveFront, server_of
from hpop.cli.serving import OnePage
from hpop.runtime.page_server import CONNECTIONS, LOCAL, PageServer, body, no_port
from hpop.study.server import StudyServer
from tests.study.conftest import CONSENT, front

__all__ = ["front"]  # a fixture


async def posted(request: Request) -> Response:
    return PlainTextResponse(await body(request, 100) or b"nothing")


WORDS = [
    Route("/", posted, methods=["POST"]),
    Route("/{path:path}", lambda request: PlainTextResponse(request.url.path)),
]
"""Answers with the path, and with what was posted."""


@contextmanager
def running(server: PageServer) -> Iterator[PageServer]:
    with server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def status(server: PageServer, method: str, path: str, **headers: str) -> tuple[int, str]:
    connection = HTTPConnection(LOCAL, server.server_address[1], timeout=60)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    reply = connection.getresponse()
    said = reply.read().decode()
    connection.close()
    return reply.status, said


def of_study(front: hpop.Front, folder: Path) -> tuple[PageServer, str]:
    design = study.Design.of(front, ["knee", "least turns"], participants=2, consent=CONSENT)
    study.prepare(design, front, folder)
    server = StudyServer(folder, token="the-secret")
    return server, server.address_of("p01")


def of_ride(front: hpop.Front, folder: Path) -> tuple[PageServer, str]:
    server = OnePage(b"<p>a page</p>", host=LOCAL, port=0)
    server.token = "the-secret"
    return server, "/the-secret"


def of_search(front: hpop.Front, folder: Path) -> tuple[PageServer, str]:
    listening = socket.socket()
    listening.bind((LOCAL, 0))
    listening.listen()
    return server_of(listening, "the-secret", LiveFront()), "/the-secret/"


@pytest.mark.parametrize("made", [of_study, of_ride, of_search])
def test_each_server_answers_to_its_own_names_and_pages_alone_and_tells_no_secret(
    front: hpop.Front, tmp_path: Path, made: Callable[[hpop.Front, Path], tuple[PageServer, str]]
) -> None:
    server, path = made(front, tmp_path / "folder")
    with running(server):
        here = f"{LOCAL}:{server.server_address[1]}"
        assert status(server, "GET", path, Host=here)[0] == 200
        assert status(server, "GET", path, Host=here.replace(LOCAL, "LocalHost"))[0] == 200
        assert status(server, "GET", path, Host=here, Origin=f"http://{here}")[0] == 200
        assert status(server, "HEAD", path, Host=here) == (200, "")
        for method in ("GET", "HEAD", "POST"):
            for host in ("evil.example", LOCAL, f"{LOCAL}:1", ""):
                code, said = status(server, method, path, Host=host)
                assert (code, "the-secret" in said) == (403, False)
            for origin in ("http://evil.example", "null", f"https://{here}"):
                code, said = status(server, method, path, Host=here, Origin=origin)
                assert (code, "the-secret" in said) == (403, False)


def test_a_page_of_another_origin_answers_no_question_of_a_preference() -> None:
    given: list[str] = []
    asked = SimpleNamespace(number=1, words="Which?", is_over=False, answer=given.append)
    said, told = [], Event()

    def say(line: str) -> None:
        said.append(line)
        told.set()

    Thread(target=serving.serve, args=(asked, 0, say), daemon=True).start()
    assert told.wait(60)
    port, path = re.findall(r":(\d+)(/\S+)", said[0])[0]
    for origin, code in (("http://evil.example", 403), ("null", 403), (f"http://{LOCAL}:{port}", 303)):
        connection = HTTPConnection(LOCAL, int(port), timeout=60)
        connection.request("POST", path, "answer=a&question=1", {"Origin": origin})
        assert connection.getresponse().status == code
        connection.close()
    assert given == ["a"]


def test_who_says_half_a_sentence_keeps_nobody_waiting_and_takes_few_threads() -> None:
    before = active_count()
    with running(PageServer(WORDS)) as server, ExitStack() as stack:
        here = f"{LOCAL}:{server.server_address[1]}"
        for _ in range(3 * CONNECTIONS):
            stack.enter_context(socket.create_connection((LOCAL, server.server_address[1]))).sendall(
                b"GET / HTTP/1.1\r"
            )
            assert active_count() <= before + CONNECTIONS + 10
        assert status(server, "GET", "/page", Host=here) == (200, "/page")


@pytest.mark.parametrize(
    "begun", [b"", b"POST / HTTP/1.1\r\nHost: %b\r\nContent-Length: 99\r\n\r\n"], ids=["head", "body"]
)
def test_who_drips_is_let_go_however_often(begun: bytes) -> None:
    with running(PageServer(WORDS, reading=0.2)) as server:
        here = f"{LOCAL}:{server.server_address[1]}".encode()
        with socket.create_connection((LOCAL, server.server_address[1])) as slow:
            slow.sendall(begun.replace(b"%b", here))
            slow.settimeout(0.02)  # a drop each: the socket is never silent for long
            ended = False
            while not ended:
                try:
                    slow.sendall(b"x")
                    ended = slow.recv(1) == b""
                except TimeoutError:
                    continue
                except OSError:
                    ended = True


def test_what_has_come_whole_may_take_longer_to_answer() -> None:
    gate = Event()

    def slow(request: Request) -> Response:
        assert gate.wait(60)
        return PlainTextResponse("at last")

    with running(PageServer([Route("/", slow)], reading=0.2)) as server:
        here = f"{LOCAL}:{server.server_address[1]}".encode()
        with socket.create_connection((LOCAL, server.server_address[1])) as quick:
            quick.sendall(b"GET / HTTP/1.1\r\nHost: %b\r\n\r\n" % here)
            with socket.create_connection((LOCAL, server.server_address[1])) as late:
                assert late.recv(1) == b""  # a silent connection that began later has been dropped
            gate.set()
            quick.settimeout(60)
            assert b"".join(iter(lambda: quick.recv(1000), b"")).endswith(b"at last")


def test_a_complete_request_is_answered_although_the_server_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hpop.runtime.page_server, "FAREWELL", 60.0)
    come, ending = Event(), Event()

    def slow(request: Request) -> Response:
        come.set()
        assert ending.wait(60)
        return PlainTextResponse("at last")

    server = PageServer([Route("/", slow)])
    Thread(target=server.serve_forever, daemon=True).start()
    with server, socket.create_connection((LOCAL, server.server_address[1])) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: %b:%d\r\n\r\n" % (LOCAL.encode(), server.server_address[1]))
        assert come.wait(60)
        end = Thread(target=server.shutdown)
        end.start()
        end.join(0.1)  # the server has begun to end
        ending.set()
        client.settimeout(60)
        assert b"".join(iter(lambda: client.recv(1000), b"")).endswith(b"at last")
        end.join(60)
    assert not end.is_alive()


def test_a_client_that_takes_nothing_of_its_answer_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hpop.runtime.page_server, "SENDING", 0.1)
    page = bytes(2**25)  # more than sockets hold
    with running(PageServer([Route("/", lambda request: Response(page))])) as server:
        with socket.create_connection((LOCAL, server.server_address[1])) as idle:
            idle.sendall(b"GET / HTTP/1.1\r\nHost: %b:%d\r\n\r\n" % (LOCAL.encode(), server.server_address[1]))
            while not server.connections:
                sleep(0.01)
            while server.connections:
                sleep(0.01)
            received = 0
            with suppress(ConnectionResetError):
                while piece := idle.recv(2**20):
                    received += len(piece)
        assert received < len(page)


def test_what_is_posted_is_bounded_and_browsers_leave_out_usual_ports() -> None:
    with running(PageServer(WORDS)) as server:
        connection = HTTPConnection(LOCAL, server.server_address[1], timeout=60)
        connection.request("POST", "/", b"x" * 100)
        assert connection.getresponse().read() == b"x" * 100
        connection = HTTPConnection(LOCAL, server.server_address[1], timeout=60)
        connection.request("POST", "/", headers={"Content-Length": "101"})
        assert connection.getresponse().read() == b"nothing"
    with socket.socket() as usual, pytest.MonkeyPatch.context() as patch:
        usual.bind((LOCAL, 0))
        usual.listen()
        patch.setitem(hpop.runtime.page_server.PLAIN_PORTS, "http", usual.getsockname()[1])
        assert PageServer(WORDS, listening=usual).refusal("localhost", "http://localhost") == ""


def test_why_a_port_cannot_be_had_is_said() -> None:
    assert "ports below 1024 are reserved for the system; choose another --port" in no_port(
        443, PermissionError(errno.EACCES, "x")
    )
    assert "Cannot assign" in no_port(8000, OSError(errno.EADDRNOTAVAIL, "Cannot assign"))
