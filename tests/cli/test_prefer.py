"""`hpop prefer`: what is asked on the terminal and on a page, what is kept, and what the other commands make of it."""

from __future__ import annotations

import html
import json
import re
import socket
import struct
import threading
from collections.abc import Callable
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from click.testing import Result
from matplotlib.figure import Figure
from matplotlib.text import Text

import hpop
from hpop.cli import preferring, serving
from hpop.cli.page_words import LANGUAGES, words_of
from hpop.cli.picking import differences
from hpop.criteria.base import criteria
from hpop.errors import OutputError
from hpop.frontier import ItemFront
from hpop.preference import Preference
from tests import preferring as people
from tests.view.explorer.fronts import seeded

Run = Callable[..., Result]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    seeded(60)[1].save(tmp_path / "front.json")
    return tmp_path


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no maps: each takes half a second; one test draws them."""
    monkeypatch.setattr(preferring.Asking, "figure", lambda self, wordless: Figure())


def test_somebody_is_asked_and_the_best_row_is_told_and_kept(folder: Path, run: Run) -> None:
    result = run("prefer", folder, "--seed", "1", "--most", "1", typed="what?\nB\n")
    assert result.exit_code == 0, result.output
    assert result.output.count("Which of the two do you prefer?") == 1
    assert "answer a, b, tie (no difference) or stop" in result.output
    assert "no more questions: 1 question asked" in result.output
    front, person = hpop.Front.load(folder / "front.json"), Preference.load(folder / "preference.json")
    assert [answer.chosen for answer in person.answers] == [person.answers[0].second]
    assert f"for you: trajectory {person.best(front).row}," in result.output
    assert re.search(r"length \(m\) +[0-9.]+ +[0-9.]+ +[ab] has", result.output)  # a cost and its unit in one line
    assert not (folder / "pair.png").exists()


@pytest.mark.usefixtures("without_pictures")
def test_asking_goes_on_where_it_ended_and_the_end_of_the_input_stops(folder: Path, run: Run) -> None:
    assert run("prefer", folder, typed="a\ntie\n").exit_code == 0
    more = run("prefer", folder, typed="b\nstop\n")
    assert "continuing after 2 answers" in more.output
    assert "no more questions: as asked" in more.output
    answers = Preference.load(folder / "preference.json").answers
    assert [answer.chosen is None for answer in answers] == [False, True, False]
    other = run("prefer", folder, "--question", "comfort", typed="a\n")
    assert other.exit_code == 17
    assert "another question (prefer); give another --out" in other.output


@pytest.mark.usefixtures("without_pictures")
def test_who_cannot_go_on_is_told_before_the_first_question(folder: Path, run: Run) -> None:
    nowhere = run("prefer", folder, "--out", folder / "none" / "p.json", typed="a\n")
    assert nowhere.exit_code == 12
    assert "its folder does not exist; create it" in nowhere.output
    assert "Which of the two" not in nowhere.output
    assert run("prefer", folder, "--seed", "1", typed="a\n").exit_code == 0
    again = run("prefer", folder, "--seed", "2", typed="a\n")
    assert again.exit_code == 17
    assert "was begun with --seed 1, got 2; leave out --seed to continue" in again.output


@pytest.mark.usefixtures("without_pictures")
def test_a_test_of_the_fit_asks_more_questions_and_its_result_is_printed(folder: Path, run: Run) -> None:
    result = run("prefer", folder, "--seed", "1", "--most", "2", "--check", typed="a\n" * 40)
    assert result.exit_code == 0, result.output
    more = int(re.findall(r"(\d+) questions of the test", result.output)[0])
    assert 3 <= more <= 24
    assert result.output.count("Which of the two do you prefer?") == 2 + more
    assert len(Preference.load(folder / "preference.json").answers) == 2 + more


@pytest.mark.usefixtures("without_pictures")
def test_who_answers_at_random_and_a_front_of_one_are_told(folder: Path, run: Run) -> None:
    apart = [(0, 59), (5, 50), (10, 40), (20, 55), (3, 30), (15, 45)]
    person = Preference.fit(seeded(60)[1], [pair for a, b in apart for pair in ((a, b), (b, a))], ties=True)
    person.save(folder / "preference.json")  # each pair answered this way and that
    told = run("prefer", folder, "--most", "13", typed="b\n").output
    assert "no preference can be seen (prefer, from 13 answers)" in told
    seeded(60)[1][:1].save(folder / "one.json")
    alone = run("prefer", folder / "one.json", "--out", folder / "new.json")
    assert alone.exit_code == 17
    assert "a preference needs a front of at least two points, got 1 point" in alone.output


@pytest.mark.usefixtures("without_pictures")
def test_ctrl_c_keeps_what_was_answered(folder: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    words = iter(["a", "b"])

    def answered() -> str:
        for word in words:
            return word
        raise KeyboardInterrupt

    monkeypatch.setattr(preferring, "_answered", answered)
    result = run("prefer", folder)
    assert result.exit_code == 130
    assert "for you: trajectory" in result.output
    assert len(Preference.load(folder / "preference.json").answers) == 2


@pytest.mark.usefixtures("without_pictures")
def test_what_was_learnt_is_marked_and_picked(folder: Path, run: Run) -> None:
    problem, front = seeded(60)
    weights = 30 * np.array([0.0, 0.9, 0.1, 0.0, 0.0])
    person = people.asked(Preference.fit(front), 8, weights, np.random.default_rng(0))
    person.save(folder / "p.json")
    row = person.best().row
    picked = run("pick", folder, "--preference", folder / "p.json")
    assert f"picked trajectory {row} of 60" in picked.output
    assert "best for you (prefer)" in picked.output
    assert run("pick", folder, "--preference", folder / "p.json", "--knee").exit_code == 2
    page = hpop.view.save_explorer(problem, front, folder / "page.html", preference=person).read_text()
    named = {name: mark["row"] for mark in marks_of(page) for name in mark["names"]}
    assert named["for you"] == row
    assert marks_of(page)[0]["names"][0] == "for you"  # in view, also where the names of a row are cut off
    missing = run("pick", folder, "--preference", folder / "none.json")
    assert missing.exit_code == 12
    assert "cannot read" in missing.output


def marks_of(page: str) -> list[dict[str, Any]]:
    """Return the marks in the data of a page."""
    (data,) = re.findall(r'<script[^>]*type="application/json"[^>]*>(.*?)</script>', page, re.DOTALL)
    return list(json.loads(data)["marks"])


def test_differences_are_told_in_words() -> None:
    front: ItemFront[int] = ItemFront.of(
        [[30.0, 2.0, 5.0], [30.5, 1.0, 5.0], [40.0, 0.0, 5.0]],
        names=["length", "turns", "height"], units=["m", "1", "m"], quanta=[0.001, 1.0, 0.001],
    )  # fmt: skip
    near = [one.words for one in differences(front, (0, 1))]  # type: ignore[arg-type]
    assert near == ["a has a little less, by 0.500 m", "b has less, by 1", "the same"]
    assert differences(front, (2, 0))[0].words == "b has much less, by 10.000 m"  # type: ignore[arg-type]
    alike: ItemFront[int] = ItemFront.of([[30.0, 2.0], [30.1, 1.0]], names=["length", "turns"], units=["m", "1"])
    words = differences(alike, (0, 1))[0].words  # type: ignore[arg-type]
    assert words.startswith("a has a little less"), "all that the front differs by, and nobody would notice it"


class Questions:
    """Stand-in for a page: two questions and a result."""

    texts = words_of("en")

    def __init__(self) -> None:
        self.given: list[str] = []
        self.disk_is_full = False
        self.drawing, self.drawn = threading.Event(), threading.Event()
        self.drawn.set()

    @property
    def number(self) -> int:
        return len(self.given) + 1

    @property
    def words(self) -> str:
        return "Which <b>?"

    @property
    def is_over(self) -> bool:
        return len(self.given) == 2

    def differences(self) -> list[object]:
        return []

    def picture(self) -> bytes:
        if not self.drawn.is_set():
            self.drawing.set()
        self.drawn.wait(30)
        return b"PNG"

    def result(self) -> list[str]:
        return ["For you: trajectory 7."]

    def answer(self, word: str) -> None:
        if self.disk_is_full:
            raise OutputError("cannot write p07.json: <no> space left")
        self.given.append(word)


def test_the_page_asks_takes_each_answer_once_and_tells_the_end_to_who_knows_its_address(
    capfd: pytest.CaptureFixture[str],
) -> None:
    asked, said = Questions(), list[str]()
    told = threading.Event()

    def say(line: str) -> None:
        said.append(line)
        told.set()

    thread = threading.Thread(target=serving.serve, args=(asked, 0, say), daemon=True)
    thread.start()
    assert told.wait(30)
    port, token = re.findall(r"127\.0\.0\.1:(\d+)/(\S+)", said[0])[0]

    def request(how: str, path: str, also: dict[str, str] | None = None, **form: object) -> tuple[int, str]:
        connection = HTTPConnection("127.0.0.1", int(port), timeout=30)
        headers = {"Content-Type": "application/x-www-form-urlencoded"} | (also or {})
        connection.request(how, path, urlencode(form) if form else None, headers)
        response = connection.getresponse()
        page = response.read().decode()
        connection.close()
        return response.status, page

    here = f"/{token}"
    assert request("GET", "/")[0] == 404
    assert request("POST", "/wrong", answer="a", question=1)[0] == 404
    assert request("GET", here, {"Host": "evil.example"})[0] == 403  # DNS that leads here
    status, page = request("GET", here)
    assert (status, "Which &lt;b&gt;?" in page, "I prefer a" in page) == (200, True, True)
    assert request("POST", here, answer="a", question=1)[0] == 303
    request("POST", here, answer="b", question=1)  # sent twice
    request("POST", here, answer="rm", question=2)
    assert request("POST", here, answer="x" * 5_000, question=2)[0] == 413
    assert request("POST", here, {"Content-Length": "9" * 5_000}, answer="a")[0] == 400
    asked.disk_is_full = True
    assert (
        "answer was not saved: cannot write p07.json: &lt;no&gt; space"
        in request("POST", here, answer="a", question=2)[1]
    )
    assert said[1:] == ["cannot write p07.json: <no> space left"]
    asked.disk_is_full = False
    asked.drawn.clear()
    with socket.create_connection(("127.0.0.1", int(port))) as closed:  # while the picture is drawn
        closed.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        closed.sendall(f"GET {here} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        assert asked.drawing.wait(30)
    asked.drawn.set()
    assert asked.given == ["a"]
    request("POST", here, answer="tie", question=2)
    assert "For you: trajectory 7." in request("GET", here)[1]
    thread.join(30)
    assert not thread.is_alive()
    assert asked.given == ["a", "tie"]
    assert capfd.readouterr().err == ""


def visible(page: str) -> str:
    """Return what a participant can read or hear on a page: text, the title, and the text for screen readers."""
    without = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    heard = re.findall(r"alt='([^']*)'", without)
    return html.unescape(" ".join([re.sub(r"<[^>]*>", " ", without), *heard]))


def read_words(text: str) -> set[str]:
    """Return the words of at least two letters in a text, in small letters."""
    return set(re.findall(r"[^\W\d_]{2,}", text.lower()))


@pytest.mark.parametrize("language", [language for language in LANGUAGES if language != "en"])
def test_no_english_word_remains_on_a_page_in_another_language(language: str, tmp_path: Path) -> None:
    """Every text is read: both questions, the results, the page of a loss, and the names of all criteria of hpop."""
    names = ["clearance", "length", "turns"]
    front: Any = ItemFront.of(people.front(30).costs, names=names, units=["m"] * 3, quanta=[1e-6] * 3)
    pages: dict[str, str] = {}
    own = [name for name, criterion in criteria.items() if criterion.__module__.startswith("hpop.")]
    for spoken in (language, "en"):
        texts, shown = words_of(spoken), list[str]()
        for question in (preferring.PREFER, preferring.COMFORT):
            person = Preference.fit(front, question=question, ties=True, seed=1)
            asking = preferring.Asking(person, None, front, tmp_path / "p.json", 2, True, spoken)  # type: ignore[arg-type]
            asking.picture = lambda: b""  # type: ignore[method-assign]
            shown.append(serving.page_of(asking))
            while not asking.is_over:
                asking.answer("a")
            shown.append(serving.page_of(asking))
        assert asking.check is not None
        shown += [texts.say("unfit", row=3), texts.say("unseen"), texts.say("same"), *map(texts.cost, own)]
        shown += [texts.say(less, which="a", amount=1) for less in ("less", "less_little", "less_much")]
        shown.append(serving._page_of_loss(texts, "", "/x"))
        pages[spoken] = " ".join(map(visible, shown)).replace("_", " ")
        assert f"<html lang={spoken}>" in shown[0]
    assert (read_words(pages[language]) & read_words(pages["en"])) - ALIKE[language] == set()
    assert texts.texts.keys() == words_of(language).texts.keys() - {f"cost_{name}" for name in criteria}


ALIKE = {"de": {"die", "hand", "in"}, "fi": {"on"}}
"""Words that are written alike in English and in another language."""


def test_the_map_of_the_page_has_no_words_but_start_goal_and_a_scale(folder: Path) -> None:
    problem, front = seeded(60)
    asking = preferring.Asking(Preference.fit(front, ties=True, seed=1), problem, front, folder / "p.json", 1)
    drawn = asking.figure(wordless=True)
    drawn.canvas.draw()
    said = {text.get_text() for text in drawn.findobj(Text) if text.get_visible()} - {""}
    ticks = {label.get_text() for axis in (drawn.axes[0].xaxis, drawn.axes[0].yaxis) for label in axis.get_ticklabels()}
    ticks |= {drawn.axes[0].get_xlabel(), drawn.axes[0].get_ylabel()}
    assert not drawn.axes[0].axison
    assert said - ticks == {"S", "G", "5 m"}


def test_a_language_is_that_of_the_page(folder: Path, run: Run) -> None:
    result = run("prefer", folder, "--language", "de")
    assert result.exit_code == 2
    assert "--language is that of the page: give --web too" in result.output
