"""`hpop plan --web` serves the page of a running search to clients that know its address, and to no others."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from threading import Thread

import pytest
from click.testing import Result

from hpop.cli.beside import HOST, LivePage
from hpop.cli.live_server import LiveFront, server_of
from hpop.errors import OutputError
from tests.view.explorer.decoder import Page
from tests.view.explorer.fronts import seeded

TOKEN = "the-token"
PAYLOAD = {"title": "</script><b>", "n": 1}


class Client:
    """Asks a server and keeps nothing."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._open: list[HTTPConnection | HTTPResponse] = []

    def __call__(self, path: str, method: str = "GET", **headers: str) -> HTTPResponse:
        connection = HTTPConnection(HOST, self.port, timeout=60)
        self._open.append(connection)
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        self._open.append(answer)
        return answer

    def close(self) -> None:
        for each in self._open:
            each.close()


@pytest.fixture
def shown() -> LiveFront:
    return LiveFront()


@pytest.fixture
def ask(shown: LiveFront) -> Iterator[Client]:
    with socket.socket() as listening:
        listening.bind((HOST, 0))
        listening.listen()
        with server_of(listening, TOKEN, shown) as server:
            thread = Thread(target=server.serve_forever)
            thread.start()
            client = Client(listening.getsockname()[1])
            yield client
            client.close()
            server.shutdown()
            thread.join()


def event(stream: HTTPResponse) -> dict[str, str]:
    """Wait for the next event of a stream and return it."""
    found: dict[str, str] = {}
    while line := stream.readline().decode().rstrip("\n"):
        name, _, value = line.partition(":")
        found[name] = value.removeprefix(" ")
    return found if found.keys() - {"retry", ""} else event(stream)


def test_until_something_is_found_the_page_waits_and_asks_again(ask: Client) -> None:
    answer = ask(f"/{TOKEN}/")
    said = answer.read().decode()
    assert answer.status == 200
    assert 'http-equiv="refresh"' in said
    assert "search has begun" in said


@pytest.mark.parametrize(
    "path",
    ["/", "/the-tokem/", "/the-token-too/", "//", "/favicon.ico", f"/{TOKEN}/front.json", f"/{TOKEN}/../../etc/passwd",
     f"/{TOKEN}/events/x", "/%2e%2e/", "/%C3%A9tranger/"],
)  # fmt: skip
def test_whoever_does_not_know_the_token_and_whatever_is_no_part_of_the_page_is_not_found(
    ask: Client, shown: LiveFront, path: str
) -> None:
    shown.publish(PAYLOAD)
    answer = ask(path)
    assert answer.status == 404
    assert b"payload" not in answer.read()


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "localhost.evil.example:{port}", ""]
)
def test_a_page_that_calls_this_machine_by_another_name_is_refused(ask: Client, shown: LiveFront, host: str) -> None:
    shown.publish(PAYLOAD)
    for path in (f"/{TOKEN}/", f"/{TOKEN}/events"):
        answer = ask(path, Host=host.format(port=ask.port))
        assert answer.status == 403
        assert b"hpop" not in answer.read()


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "CONNECT"])
def test_nothing_but_looking_is_possible(ask: Client, method: str) -> None:
    assert ask(f"/{TOKEN}/", method).status == 405


def test_the_page_holds_what_is_shown_and_may_connect_to_its_own_server_alone(ask: Client, shown: LiveFront) -> None:
    shown.publish(PAYLOAD)
    for host in (f"{HOST}:{ask.port}", f"localhost:{ask.port}"):
        answer = ask(f"/{TOKEN}/", Host=host)
        said = answer.read().decode()
        held = re.search(r'id="payload">(.*?)</script>', said)
        assert held is not None
        assert json.loads(held[1]) == {**PAYLOAD, "live": 1}
        assert "connect-src 'self'" in said
        assert answer.getheader("Cache-Control") == "no-store"
        assert answer.getheader("Referrer-Policy") == "same-origin"
        assert answer.getheader("Access-Control-Allow-Origin") is None
    assert ask(f"/{TOKEN}").getheader("Location") == f"/{TOKEN}/"


def test_a_page_is_whole_though_another_front_comes_while_it_is_sent(
    ask: Client, shown: LiveFront, monkeypatch: pytest.MonkeyPatch
) -> None:
    several = iter([b"<p>longer</p>", b"<p>short</p>", b"<p>", b""])
    monkeypatch.setattr(LiveFront, "page", property(lambda _: next(several)), raising=False)
    assert ask(f"/{TOKEN}/").read() == b"<p>longer</p>"


def test_fronts_are_told_as_they_come_and_the_end_is_told_last(ask: Client, shown: LiveFront) -> None:
    early = ask(f"/{TOKEN}/events?after=0")
    assert (early.getheader("Content-Type") or "").startswith("text/event-stream")
    for number in (1, 2):
        shown.publish({**PAYLOAD, "n": number})
        assert event(early) == {
            "id": str(number),
            "event": "front",
            "data": json.dumps({**PAYLOAD, "n": number}, separators=(",", ":")),
        }
    late, again = ask(f"/{TOKEN}/events?after=1"), ask(f"/{TOKEN}/events?after=0", Last_Event_ID="2")
    assert event(late)["id"] == "2"
    shown.end()
    assert [event(stream) for stream in (early, late, again)] == [{"event": "end", "data": ""}] * 3
    assert not any(stream.read() for stream in (early, late, again))


def test_a_number_that_is_none_and_a_page_that_was_closed_are_no_errors(ask: Client, shown: LiveFront) -> None:
    shown.publish(PAYLOAD)
    stream = ask(f"/{TOKEN}/events?after=-1&after=%D9%A3&after=x", Last_Event_ID="none")
    assert event(stream)["id"] == "1"
    ask.close()
    shown.publish(PAYLOAD)
    assert ask(f"/{TOKEN}/").status == 200


def test_what_cannot_be_shown_is_told_until_something_can(ask: Client, shown: LiveFront) -> None:
    shown.failed(ValueError("no such <criterion>"))
    said = ask(f"/{TOKEN}/").read().decode()
    assert "cannot be shown: no such &lt;criterion&gt;" in said
    assert 'http-equiv="refresh"' in said
    shown.publish(PAYLOAD)
    shown.failed(ValueError("later"))
    assert b"later" not in ask(f"/{TOKEN}/").read()


# The command


def test_a_port_in_use_is_told_before_the_search_begins(run: Callable[..., Result], room: Path) -> None:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = run("plan", room / "room.yaml", "--out", room / "out", "--web", port)
    assert result.exit_code == OutputError.exit_code
    assert re.search(rf"port {port} .*in use.*choose another", result.stderr)
    assert not (room / "out").exists()


@pytest.mark.proof
@pytest.mark.usefixtures("no_pictures")
def test_a_plan_says_where_it_is_shown_and_is_gone_with_the_command(run: Callable[..., Result], room: Path) -> None:
    result = run("plan", room / "room.yaml", "--out", room / "out", "--web", "0")
    assert result.exit_code == 0
    found = re.search(r"http://127\.0\.0\.1:(\d+)/[\w-]{20,}/", result.stderr)
    assert found is not None
    client = Client(int(found[1]))
    with pytest.raises(ConnectionRefusedError):
        client("/")
    client.close()


@pytest.mark.usefixtures("no_pictures")
def test_an_address_is_told_only_where_something_answers(
    run: Callable[..., Result], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.executable", str(room / "nothing"))
    with LivePage(0, room) as live:
        assert not live.is_served
    result = run("plan", room / "room.yaml", "--out", room / "out", "--web", "0")
    assert (result.exit_code, "http://" in result.output) == (0, False)
    assert "could not be started" in result.output


def commands() -> bytes:
    """Return the command lines of all processes, as every user of this machine sees them."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            found.append(path.read_bytes())
    return b"\n".join(found)


def test_another_process_shows_the_front_that_was_saved_and_tells_when_all_is_over(tmp_path: Path) -> None:
    _, front = seeded(20)
    front.save(tmp_path / "front.json")
    with LivePage(0, tmp_path) as live:
        found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)(/.*)", live.address)
        assert found is not None
        client = Client(int(found[1]))
        assert b"search has begun" in client(found[2]).read()
        assert found[2].strip("/").encode() not in commands()
        stream = client(f"{found[2]}events?after=0")
        live.saved()
        page = Page(json.loads(event(stream)["data"]))
        assert page.columns["length"].tolist() == front.costs[:, 2].tolist()
        assert page.raw["saved"] == str(tmp_path / "front.json")
        live.stop()
        assert event(stream)["event"] == "end"
        client.close()
