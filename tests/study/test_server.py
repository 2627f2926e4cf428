"""Claims: the server takes what the design asks for, from its own pages alone, and has it on the disk at once."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from email.message import Message
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

import pytest

import hpop
from hpop import study
from hpop.errors import OutputError, StudyError
from hpop.study.server import MOST_BODY, StudyServer
from tests.study.conftest import CONSENT


class Reply(NamedTuple):
    status: int
    headers: Message
    body: bytes

    @property
    def said(self) -> Any:
        return json.loads(self.body)


class Client:
    """Talks to a server as a page does, or as one that should not."""

    def __init__(self, server: StudyServer, design: study.Design) -> None:
        self.port = server.server_address[1]
        self.host = f"127.0.0.1:{self.port}"
        self.design = design.digest

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> Reply:
        connection = HTTPConnection("127.0.0.1", self.port, timeout=20)
        sent = {"Host": self.host, **{name.replace("_", "-"): value for name, value in headers.items()}}
        connection.request(method, path, body, sent)
        reply = connection.getresponse()
        found = Reply(reply.status, reply.headers, reply.read())
        connection.close()
        return found

    def post(self, event: Any = None, who: str = "p01", tab: str = "one", **changes: Any) -> Reply:
        sent = {"design": self.design, "tab": tab, "device": {"browser": "none"}, **changes}
        if event is not None:
            sent["event"] = event
        return self.ask("POST", f"/answers/{who}", json.dumps(sent).encode(), Content_Type="application/json")


@pytest.fixture(scope="module")
def made(front: hpop.Front, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, study.Design]:
    folder = tmp_path_factory.mktemp("served")
    rows = ["knee", "least turns"]
    design = study.Design.of(front, rows, participants=4, consent=CONSENT, forms=("comfort",), language="fi")
    design.save(folder)
    study.save_stimuli(hpop.Problem.from_description(front.problem or {}), front, design.conditions, folder / "stimuli")
    return folder, design


@pytest.fixture
def folder(made: tuple[Path, study.Design]) -> Path:
    for file in (made[0] / "answers").glob("*"):
        file.unlink()
    return made[0]


@pytest.fixture
def client(made: tuple[Path, study.Design], folder: Path) -> Iterator[Client]:
    with StudyServer(folder) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield Client(server, made[1])
        server.shutdown()
        thread.join()


def event(t: float, kind: str, **rest: Any) -> dict[str, Any]:
    return {"t": t, "at": f"2026-11-23T10:00:{t:06.3f}Z", "kind": kind, **rest}


AGREED = event(0, "consent", value=True)


def test_each_event_is_on_the_disk_when_its_reply_comes_and_is_given_to_who_reloads(
    client: Client, folder: Path, made: tuple[Path, study.Design]
) -> None:
    first = made[1].participant("p01").order[0]
    said = [
        AGREED,
        event(0.5, "start"),
        event(1, "stimulus", place=1, condition=first, value="begin"),
        event(2, "frames", place=1, condition=first, value={"count": 60, "seconds": 1.0, "slow": 0.0, "longest": 17.0}),
        event(3, "answer", place=1, condition=first, form="comfort", item="comfort", value=7),
        event(4, "compare", value={"question": "prefer", "pair": ["A", "B"], "chosen": "none"}),
        event(5, "remark", place=3, value="a\nb"),
    ]
    assert client.post().said == {"events": []}
    for i, one in enumerate(said, 1):
        assert client.post(one).said == {"added": True}
        stored = json.loads((folder / "answers" / "p01.json").read_text())
        assert stored["events"] == said[:i]
        assert stored["participant"] == "p01"
        assert stored["design"] == made[1].digest
    assert client.post(tab="two").said == {"events": said}
    answers = study.Answers.load(folder)
    assert [row.value for row in answers.table] == [7.0]


def test_an_event_that_comes_twice_is_kept_once(client: Client, folder: Path) -> None:
    client.post()
    assert client.post(AGREED).said == {"added": True}
    assert client.post(AGREED).said == {"added": False}
    assert len(json.loads((folder / "answers" / "p01.json").read_text())["events"]) == 1


def test_of_two_windows_the_first_is_told(client: Client) -> None:
    client.post(tab="one")
    client.post(AGREED, tab="one")
    client.post(tab="two")
    late = client.post(event(1, "start"), tab="one")
    assert (late.status, late.said["why"]) == (409, "elsewhere")
    assert client.post(event(1, "start"), tab="two").status == 200


def test_a_server_that_was_begun_again_goes_on(client: Client) -> None:
    """The page that has recorded so far knows nothing of it."""
    assert client.post(AGREED, tab="one").status == 200


RATED: dict[str, Any] = {"form": "comfort", "item": "comfort"}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (event(1, "answer", place=1, **RATED, value=11), "expected 0 to 10"),
        (event(1, "answer", place=1, **RATED, value=1.5), "expected 0 to 10"),
        (event(1, "answer", place=1, **RATED, value="7"), "expected 0 to"),
        (event(1, "answer", place=0, **RATED, value=5), "not asked at place 0"),
        (event(1, "answer", place=1, form="comfort", item="other", value=5), "has no item"),
        (event(1, "answer", place=1, form="ssq", item="nausea", value=1), "has no form"),
        (event(1, "applause"), "kind"),
        (event(0, "start"), "events must rise in time"),
        ({**event(1, "start"), "name": "Ada"}, "name"),
        ({**event(1, "start"), "at": "2026-11-23T12:00:00+02:00"}, "at"),
        (event(1, "compare", value={"question": "prefer", "pair": ["A", "B"], "chosen": "C"}), "chosen"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_the_design_does_not_ask_for_is_refused_and_nothing_is_changed(
    wrong: dict[str, Any], said: str, client: Client, folder: Path, made: tuple[Path, study.Design]
) -> None:
    client.post(AGREED)
    before = (folder / "answers" / "p01.json").read_bytes()
    if wrong.get("place") == 1:
        wrong = {**wrong, "condition": made[1].participant("p01").order[0]}
    reply = client.post(wrong)
    assert reply.status == 422
    assert said in reply.said["error"]
    assert (folder / "answers" / "p01.json").read_bytes() == before


def test_an_answer_before_consent_is_refused(client: Client, folder: Path, made: tuple[Path, study.Design]) -> None:
    first = made[1].participant("p01").order[0]
    reply = client.post(event(1, "answer", place=1, condition=first, **RATED, value=5))
    assert (reply.status, "before consent" in reply.said["error"]) == (422, True)
    assert not (folder / "answers" / "p01.json").exists()


def test_who_is_no_page_of_it_is_told_nothing(client: Client) -> None:
    good = json.dumps({"design": client.design, "tab": "one", "device": {}}).encode()
    kind = {"Content_Type": "application/json"}
    assert client.ask("GET", "/p01", Host="evil.example").status == 403
    assert client.ask("GET", "/p01", Host=f"127.0.0.1:{client.port + 1}").status == 403
    assert client.ask("POST", "/answers/p01", good, **kind, Host="evil.example").status == 403
    assert client.ask("POST", "/answers/p01", good, **kind, Origin="https://evil.example").status == 403
    assert client.ask("POST", "/answers/p01", good, **kind, Origin="null").status == 403
    assert client.ask("POST", "/answers/p01", good, Content_Type="text/plain").status == 415
    assert client.ask("POST", "/answers/p01", b"{" * 1000, **kind).status == 400
    assert client.ask("POST", "/answers/p01", b"x", **kind, Content_Length=str(MOST_BODY + 1)).status == 413
    assert client.ask("POST", "/answers/p01", b"x", **kind, Content_Length="9" * 5000).status == 400
    assert client.ask("POST", "/p01", good, **kind).status == 405
    assert client.ask("POST", "/answers/p01", b"[]", **kind).status == 400
    assert client.ask("POST", "/answers/p01", good, **kind).status == 200


def test_ids_and_files_that_are_none_of_the_study_are_not_found(client: Client, folder: Path) -> None:
    (folder / "stimuli" / "secret.html").write_text("x")
    for path in ("/p05", "/Ada", "/../design.json", "/design.json", "/answers/p01.json", "/stimuli/secret.html"):
        assert client.ask("GET", path).status == 404, path
    assert (
        b"<p>Tutkimuksen tietokone ilmoittaa: the study has no such participant.</p>" in client.ask("GET", "/p05").body
    )
    for who in ("p05", "../p01", "Ada", ""):
        assert client.post(who=who).status == 404, who
    assert client.post(design="0" * 64).said["why"] == "design"


def test_pages_stimuli_and_the_list_are_given_with_what_protects_them(
    client: Client, made: tuple[Path, study.Design]
) -> None:
    folder, design = made
    for path in ("/", "/p01", "/stimuli/A.html"):
        reply = client.ask("GET", path)
        assert reply.status == 200
        assert reply.headers["Cache-Control"] == "no-store"
        assert reply.headers["X-Content-Type-Options"] == "nosniff"
        assert reply.headers["X-Frame-Options"] == "DENY"
        assert b"Content-Security-Policy" in reply.body
    assert client.ask("GET", "/").body.count(b"<a ") == len(design.participants)
    whole = (folder / "stimuli" / "A.html").read_bytes()
    assert client.ask("GET", "/stimuli/A.html").body == whole
    part = client.ask("GET", "/stimuli/A.html", Range="bytes=5-9")
    assert (part.status, part.body, part.headers["Content-Range"]) == (206, whole[5:10], f"bytes 5-9/{len(whole)}")
    for impossible in ("bytes=9-5", "bytes=\u00b2-", "bytes=0-" + "9" * 5000, f"bytes={len(whole)}-"):
        assert client.ask("GET", "/stimuli/A.html", Range=impossible).status in (400, 416)


def test_each_participant_has_a_token_that_opens_no_other_page(folder: Path, made: tuple[Path, study.Design]) -> None:
    with StudyServer(folder, token="secret-of-the-study") as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        client = Client(server, made[1])
        listed = re.findall(r'href="(/[^"]+/p0[0-9])"', client.ask("GET", "/secret-of-the-study/").body.decode())
        assert [path[-3:] for path in listed] == [person.id for person in made[1].participants]
        first, second = (path.rpartition("/")[0] for path in listed[:2])
        assert client.ask("GET", f"{first}/p01").status == 200
        assert client.ask("GET", f"{first}/stimuli/A.html").status == 200
        assert client.ask("GET", "/secret-of-the-study/p01").headers["Location"] == f"{first}/p01"
        for path in (f"{first}/p02", f"{first}/", f"{second}/p01", "/p01", "/wrong/p01", "/wrong/"):
            assert client.ask("GET", path).status == 404, path
        sent = json.dumps({"design": client.design, "tab": "one", "device": {}}).encode()
        for token, status in ((first, 200), (second, 404), ("/secret-of-the-study", 404)):
            reply = client.ask("POST", f"{token}/answers/p01", sent, Content_Type="application/json")
            assert reply.status == status
        server.shutdown()
        thread.join()


def test_a_study_without_stimuli_or_with_a_port_in_use_is_said_at_once(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "design.json").write_bytes((folder / "design.json").read_bytes())
    with pytest.raises(StudyError, match="stimulus"):
        StudyServer(tmp_path)
    shutil.copytree(folder, other := tmp_path / "other")
    with (
        StudyServer(folder) as server,
        pytest.raises(OutputError, match="another program uses it; end that program, or choose"),
    ):
        StudyServer(other, port=server.server_address[1])


def test_a_study_is_served_once(folder: Path, tmp_path: Path) -> None:
    """Two servers would know nothing of each other's windows."""
    with StudyServer(folder), pytest.raises(StudyError, match="is served already, by another"):
        StudyServer(folder)
    StudyServer(folder).server_close()  # whoever held it has ended


def test_a_wrong_address_is_told_in_the_language_of_the_study(client: Client) -> None:
    reply = client.ask("GET", "/p99")
    assert reply.status == 404
    assert '<html lang="fi">' in reply.body.decode()
    assert "Kutsu tutkija paikalle." in reply.body.decode()
