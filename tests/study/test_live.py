"""A live session is a stimulus of a study: its record is among the answers, counted in the report, and withdrawn."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import hpop
from hpop import study
from hpop.errors import StudyError
from hpop.study.folder import check
from hpop.study.live import live_table, record_name, summary
from tests.study.sessions import answered

CARDS = [{"option": 0, "name": "quickest"}, {"option": 2, "name": "gentlest"}]


def event(t: float, name: str, **values: Any) -> dict[str, Any]:
    return {"at": 1000.0 * t, "t": t, "event": name, **values}


def told(t: float, kind: str, **values: Any) -> dict[str, Any]:
    return event(t, "told", message={"type": kind, **values})


def state(t: float, x: float, y: float, *, moving: bool) -> dict[str, Any]:
    return event(t, "state", x=x, y=y, theta=0.0, moving=moving)


# A viewer chooses twice, is followed by one of two pushes, and looks a quarter to the left and back within 2 s.
EVENTS = [
    event(0.0, "session", schema="hpop-live-record", version=1, scenario="rooms/visit.yaml"),
    event(0.5, "drives", viewer=1),
    event(1.0, "destination", viewer=1, x=3.0, y=4.0),
    told(1.5, "options", cards=CARDS, all=[{}, {}, {}]),
    event(2.0, "take", viewer=1, option=2),
    told(2.1, "taken", option=2, by="choice", words=""),
    state(2.1, 0.0, 0.0, moving=False),
    state(3.1, 0.3, 0.4, moving=True),
    state(4.1, 0.6, 0.8, moving=True),
    state(6.1, 0.6, 0.8, moving=False),
    event(4.2, "push", viewer=1, direction=0.5),
    told(4.3, "pushed", followed=True, option=1, words="", milliseconds=20.0),
    told(4.3, "taken", option=1, by="push", words=""),
    event(5.0, "push", viewer=1, direction=2.0),
    told(5.1, "pushed", followed=False, option=1, words="", milliseconds=20.0),
    told(5.5, "options", cards=CARDS, all=[{}]),
    event(6.0, "take", viewer=1, option=1),
    told(6.1, "taken", option=1, by="choice", words=""),
    event(7.0, "why", viewer=1, x=1.0, y=1.0),
    event(7.5, "head", viewer=1, samples=[[7000, 3.0, 0.0], [8000, 3.0 + math.pi / 2 - math.tau, 0.0]]),
    event(8.5, "head", viewer=1, samples=[[9000, 3.0, 0.1]]),
    event(8.6, "head", viewer=2, samples=[[7000, 0.0, 0.0], [8000, 3.0, 0.0]]),  # watches
    event(9.0, "stop", viewer=1),
    event(10.0, "end"),
]


def test_a_summary_counts_what_the_viewer_did() -> None:
    found = summary(EVENTS)
    assert found == {
        "scenario": "visit.yaml",
        "seconds": 10.0,
        "driving": pytest.approx(2.0),
        "metres": pytest.approx(1.0),
        "destinations": 1,
        "offers": 2,
        "ways": 2.0,
        "choices": 2,
        "chosen": "gentlest 1, another way 1",
        "pushes": 2,
        "followed": 1,
        "questions": 1,
        "wishes": 0,
        "stops": 1,
        "head": pytest.approx(90.0),
    }


def test_a_choice_is_named_by_the_card_of_the_offer_that_was_asked() -> None:
    """A newer offer may come before the page's choice does; its way 2 has another name."""
    old = [told(1.0, "options", asked=1.0, cards=CARDS, all=[{}, {}, {}])]
    new = [told(2.0, "options", asked=2.0, cards=[{"option": 2, "name": "quickest"}], all=[{}, {}, {}])]
    chosen = [event(2.1, "take", viewer=1, option=2, asked=1.0), told(2.2, "taken", option=2, by="choice", words="")]
    assert summary([*EVENTS[:1], *old, *new, *chosen])["chosen"] == "gentlest 1"


def test_a_session_that_ended_at_once_has_a_summary() -> None:
    found = summary(EVENTS[:1])
    assert (found["metres"], found["offers"], found["chosen"]) == (0.0, 0, "none")
    assert math.isnan(float(found["head"]))


@pytest.fixture
def begun(front: hpop.Front, tmp_path: Path) -> tuple[study.Design, Path]:
    design = study.Design.of(
        front, ["knee", "live"], participants=2, consent="You may stop.", forms=["comfort"], seed=3
    )
    return design, study.prepare(design, front, tmp_path / "study")


def write(folder: Path, name: str, events: list[dict[str, Any]] = EVENTS) -> Path:
    path = folder / "answers" / name
    path.write_text("".join(json.dumps(one) + "\n" for one in events))
    return path


def test_records_are_reported_missed_and_withdrawn(begun: tuple[study.Design, Path]) -> None:
    design, folder = begun
    assert [condition.kind for condition in design.conditions if condition.row is None] == ["live"]
    assert design.pairs("p01") == []  # one ride alone
    assert study.Design.load(folder).digest == design.digest
    answered(design, folder, ["p01", "p02"])
    assert check(folder).faults == (
        "p01 has no record of the live session; it is made by `hpop study live`",
        "p02 has no record of the live session; it is made by `hpop study live`",
    )
    name = record_name(design, "p01")
    write(folder, name)
    write(folder, "p02-live-20261128T100000Z.jsonl")
    assert check(folder).faults == ()
    result = study.analyse(design, study.Answers.load(folder), score=("comfort", "comfort"))
    assert [row["participant"] for row in result.tables["live"]] == ["p01", "p02"]
    assert "what each participant did" in result.text()
    page = result.save(folder / "report").read_text()
    assert "gentlest 1, another way 1" in page
    assert (folder / "report" / "live.csv").exists()
    assert f"answers/{name}" in study.withdraw(folder, "p01").removed
    assert [row["participant"] for row in live_table(folder, study.Design.load(folder))] == ["p02"]


@pytest.mark.parametrize(
    ("name", "events", "said"),
    [
        ("p77-live-1.jsonl", EVENTS, "no participant p77"),
        ("p01-live-1.jsonl", [{"event": "state"}], "is not the record of a live session"),
    ],
)
def test_other_files_are_refused(begun: tuple[study.Design, Path], name: str, events: list[Any], said: str) -> None:
    design, folder = begun
    write(folder, name, events)
    with pytest.raises(hpop.errors.HpopError, match=said):
        live_table(folder, design)


def test_a_study_without_a_live_session_runs_none(design: study.Design) -> None:
    with pytest.raises(StudyError, match=r"has no live session among its stimuli.*--rows knee,live"):
        record_name(design, "p01")
