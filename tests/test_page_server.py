"""Every server of pages answers its own names and pages alone, and a silent client keeps no other waiting."""

from __future__ import annotations

import errno
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from threading import Event, Thread, active_count
from types import SimpleNamespace

import pytest

import hpop
from hpop import study
from hpop.cli import asking_page
from hpop.cli.live_server import LiveFront, server_of
from hpop.cli.serving import OnePage
from hpop.runtime.page_server import CONNECTIONS, LOCAL, PageHandler, PageServer, no_port
from hpop.study.server import StudyServer
from tests.study.conftest import CONSENT, front

__all__ = ["front"]  # a fixture


class Words(PageHandler):
    """Answers with the path, and with what was posted."""

    def answer(self) -> None:
        self.page(self.path.encode())

    def take(self) -> None:
        self.page(self.body(100) or b"nothing")


@contextmanager
def running(server: PageServer) -> Iterator[PageServer]:
    with server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
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

    Thread(target=asking_page.serve, args=(asked, 0, say), daemon=True).start()
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
    with running(PageServer(Words)) as server, ExitStack() as stack:
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
    with running(PageServer(Words, reading=0.2)) as server:
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

    class Slow(Words):
        def answer(self) -> None:
            assert gate.wait(60)
            super().answer()

    class Counted(PageServer):
        def service_actions(self) -> None:
            super().service_actions()
            self.looked = getattr(self, "looked", 0) + 1
            if self.looked > 60:  # 0.6 s at the least, three times as long as may be waited for a request
                gate.set()

    with running(Counted(Slow, reading=0.2)) as server:
        assert status(server, "GET", "/page", Host=f"{LOCAL}:{server.server_address[1]}") == (200, "/page")


def test_what_is_posted_is_bounded_and_browsers_leave_out_usual_ports() -> None:
    with running(PageServer(Words)) as server:
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
        assert PageServer(Words, listening=usual).refusal("localhost", "http://localhost") == ""


def test_why_a_port_cannot_be_had_is_said() -> None:
    assert "below 1024 are the system's; choose another --port" in no_port(443, PermissionError(errno.EACCES, "x"))
    assert "Cannot assign" in no_port(8000, OSError(errno.EADDRNOTAVAIL, "Cannot assign"))
