"""`hpop drive`: events of a file happen to a plan of a saved front; options are printed, drawn and recorded."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import hpop.drive
from hpop.cli import main
from tests.drive.rooms import planned
from tests.tours import tour_front, tour_problem

EVENTS = """\
choice: least turns
events:
  - {at: 1, close: north}
  - {at: 1, close: south}
  - {at: 60, open: south}
  - {at: 62, wish: fewer turns}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("hall")
    planned()[1].save(place / "front.json")
    return place


def drive(folder: Path, out: Path, text: str = EVENTS, *more: str) -> Result:
    out.mkdir(parents=True, exist_ok=True)
    (out / "events.yaml").write_text(text)
    return CliRunner().invoke(
        main, ["drive", str(folder), "--events", str(out / "events.yaml"), "--out", str(out), *more]
    )


def test_what_happens_is_printed_drawn_and_can_be_told_again(folder: Path, tmp_path: Path) -> None:
    done = drive(folder, tmp_path)
    assert done.exit_code == 0, done.output
    for words in (
        "1.0 s, at",
        "close: 'north'",
        "no options: none is open",
        "the robot waits before the closed part of its path",
        "open: 'south'",
    ):
        assert words in done.output
    assert (tmp_path / "drive.png").read_bytes().startswith(b"\x89PNG")
    again = hpop.drive.load(tmp_path / "drive.json")
    ended = re.search(r"the robot arrives after ([\d.]+) s", done.output)
    assert ended is not None
    assert float(ended[1]) == pytest.approx(again.plan.duration, abs=0.06)
    assert float(ended[1]) > 60
    assert [event["event"] for event in again.record].count("close") == 2


def test_options_that_are_printed_are_those_of_the_drive(folder: Path, tmp_path: Path) -> None:
    done = drive(folder, tmp_path, "events: [{at: 1, options: true}]", "--deadline", "2")
    problem, front = planned()
    options = hpop.follow(problem, front, "knee").options(1.0, 2.0)
    assert f"{len(options)} options from {options.commit.time:.1f} s on, complete" in done.output
    rows = [line.split() for line in done.output.splitlines() if re.match(r"\s{3,}\d+ ", line)]
    assert rows
    for number, *values in rows:
        np.testing.assert_allclose([float(v) for v in values[:3]], options.front.costs[int(number)], rtol=1e-4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("events: [{at: 1, close: west}]", "west"),
        ("events: [{at: 2, options: true}, {at: 1, options: true}]", "line 1.*before the event above"),
        ("choice: least pain\nevents: [{at: 1, options: true}]", "least pain"),
        ("events: [{at: 1000, options: true}]", "comes too late"),
        ("events: [{at: 1, wish: fewer pains}]", "pains"),
        ("event: []", "event"),
    ],
)
def test_a_mistake_is_one_message(folder: Path, tmp_path: Path, text: str, words: str) -> None:
    done = drive(folder, tmp_path, text)
    assert done.exit_code not in (0, 1)
    assert re.search(f"(?s)error: .*{words}", done.output)
    assert "Traceback" not in done.output


def test_what_happened_before_a_mistake_is_kept(folder: Path, tmp_path: Path) -> None:
    done = drive(folder, tmp_path, "events: [{at: 1, close: north}, {at: 900, options: true}]")
    assert done.exit_code != 0
    assert hpop.drive.load(tmp_path / "drive.json").record[0]["event"] == "close"
    assert (tmp_path / "drive.png").exists()


def test_a_tour_is_driven_with_its_stops_named(tmp_path: Path) -> None:
    problem = tour_problem()
    tour_front(problem).save(tmp_path / "front.json")
    text = "choice: knee\nevents: [{at: 1, options: true}, {at: 2, skip: north}, {at: 25, skip: east}]"
    done = drive(tmp_path, tmp_path / "out", text)
    assert done.exit_code == 0, done.output
    assert "stops: 1 east, 2 north, 3 vase, 4 passed" in done.output
    assert re.search(r"yes +1 3 4 2 +.*present plan", done.output)
    assert "stop 'east' was visited already" in done.output
    assert re.search(r"visited: east \(.* s\).*; skipped: north \(required\)", done.output)
    again = hpop.drive.load(tmp_path / "out" / "drive.json")
    assert [event["event"] for event in again.record if event["event"] in ("skip", "visited")][:2] == [
        "skip",
        "visited",
    ]
    walls = "close: [[0, 4.4], [8, 4.4], [8, 4.6], [0, 4.6]], name: wall"
    stuck = drive(tmp_path, tmp_path / "out", f"choice: least stops_missed\nevents: [{{at: 0.5, {walls}}}]").output
    assert (
        "cannot reach stop 'north'; closed: 'wall'. Open what is closed, or skip with the event `skip: north`" in stuck
    )
    assert re.search(r"; not visited: north \(required\), .*\(optional\)\ngoal not reached: the robot stands", stuck)
    wrong = drive(tmp_path, tmp_path / "out", "events: [{at: 2, skip: nort}]")
    assert wrong.exit_code == 16
    assert "no stop is called 'nort'. Did you mean 'north'? The stops are east, north" in wrong.output


def test_without_a_file_of_events_it_says_what_that_is(folder: Path) -> None:
    done = CliRunner().invoke(main, ["drive", str(folder)])
    assert done.exit_code == 2
    assert "give --events YAML, a file of what happens on the way" in done.stderr
    assert "{at: 3, wish: fewer turns}" in done.stderr
