"""Claims: a study's folder is made whole or not at all, keeps what it was made of, and forgets whoever withdraws."""

from __future__ import annotations

import os
import re
import shutil
import struct
from pathlib import Path
from typing import Any

import pytest

import hpop
from hpop import study
from hpop.errors import StudyError
from hpop.study import Answers, Design, folder
from hpop.study.documents import write_bytes
from hpop.study.folder import check
from tests.study.sessions import answered, events_of, put, session

WORD = re.compile(rb"(?<![A-Za-z0-9+/])p02(?![A-Za-z0-9+/])")  # not by chance, in what is written as base64


@pytest.fixture(scope="module")
def prepared(front: hpop.Front, design: Design, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a study without participants."""
    return folder.prepare(design, front, tmp_path_factory.mktemp("studies") / "begun")


@pytest.fixture
def begun(prepared: Path, tmp_path: Path) -> Path:
    """Return a copy of the prepared study."""
    return Path(shutil.copytree(prepared, tmp_path / "study"))


def files_of(path: Path) -> list[str]:
    return sorted(str(file.relative_to(path)) for file in path.rglob("*") if file.is_file())


def test_all_that_a_study_needs_is_there(prepared: Path, design: Design) -> None:
    people = [f"pages/p{i:02d}.html" for i in range(1, 13)]
    stimuli = ["stimuli/A.html", "stimuli/B.html", "stimuli/C.html"]
    assert files_of(prepared) == ["design.json", "front.json", *people, "schedule.csv", *stimuli]
    assert prepared.stat().st_mode & 0o077 == 0  # its owner's alone
    assert os.listdir(prepared.parent) == ["begun"]
    found = check(prepared)
    assert found.faults == ()
    assert found.notes[-1] == "0 of 12 sessions are complete"
    assert len(folder.front_of(prepared, design)) == 6


def test_a_page_knows_what_its_participant_may_know(prepared: Path, design: Design) -> None:
    """Neither the criteria nor the costs of any row are in it."""
    text = (prepared / "pages" / "p02.html").read_text()
    assert design.digest in text
    assert "exposure" not in text
    for condition in design.conditions:
        assert str(condition.costs["exposure"]) not in text
        assert str(condition.costs["length"]) not in text


@pytest.mark.parametrize("name", ["full", "file", "link"])
def test_a_folder_in_use_is_refused_and_left_as_it_is(
    front: hpop.Front, design: Design, tmp_path: Path, name: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("x")
    (tmp_path / "file").write_text("x")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(StudyError, match="in use, but a study must begin in a new or empty folder"):
        folder.prepare(design, front, tmp_path / name)
    assert sorted(os.listdir(tmp_path)) == before
    assert files_of(tmp_path / "full") == ["thesis.txt"]


def test_nothing_is_left_of_a_study_that_could_not_be_made(
    front: hpop.Front, design: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However late it fails."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder, "write_pages", fail)
    with pytest.raises(StudyError, match="No space left on device"):
        folder.prepare(design, front, tmp_path / "deep" / "study")
    assert os.listdir(tmp_path / "deep") == []


def test_what_cannot_be_written_is_called_by_the_name_of_the_study(
    front: hpop.Front, design: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not by that of the folder it is made in, which is gone when this is read."""

    def fill(design: Design, made: Path, people: list[str]) -> None:
        (made / "pages").mkdir()
        write_bytes(made / "pages", b"a folder lies here")

    monkeypatch.setattr(folder, "write_pages", fill)
    with pytest.raises(StudyError) as told:
        folder.prepare(design, front, tmp_path / "study")
    assert str(told.value).startswith(f"cannot write {tmp_path / 'study' / 'pages'}: ")
    assert os.listdir(tmp_path) == []


def test_only_the_front_of_the_design_and_whole_texts_are_taken(
    front: hpop.Front, design: Design, tmp_path: Path
) -> None:
    with pytest.raises(StudyError, match="expected the front from which the design was made"):
        folder.prepare(design, front[1:], tmp_path / "study")
    (tmp_path / "en.json").write_text('{"stop": "Halt"}')
    with pytest.raises(StudyError, match=r"en.json lacks the texts agree, "):
        folder.prepare(design, front, tmp_path / "study", words=tmp_path / "en.json")
    assert os.listdir(tmp_path) == ["en.json"]


def test_a_front_that_changed_since_is_told(front: hpop.Front, begun: Path, design: Design) -> None:
    front[1:].save(begun / "front.json")
    with pytest.raises(StudyError, match="has changed since the study began"):
        folder.front_of(begun, design)
    (fault,) = check(begun).faults
    assert "has changed since the study began" in fault
    (begun / "front.json").unlink()
    assert "cannot be read" in check(begun).faults[0]


def test_all_faults_are_told_at_once(begun: Path, design: Design) -> None:
    (begun / "stimuli" / "B.html").unlink()
    (begun / "pages" / "p04.html").unlink()
    put(begun, session(design, "p01", events_of(design, "p01")[:30]))
    put(begun, {**session(design, "p02"), "design": "0" * 64})
    put(begun, session(design, "p03"), "p03 (1)")
    put(begun, session(design, "p05"))
    said = "\n".join(check(begun).faults)
    for part in (
        "B.html is missing",
        "p04.html is missing",
        "p02.json: these are answers to another design",
        "p03 (1).json: these are the answers of p03; rename the file to p03.json",
        "the session of p01 is incomplete",
    ):
        assert part in said
    assert len(check(begun).faults) == 5


def test_nothing_is_kept_of_whoever_withdraws(
    begun: Path, design: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Byte for byte, the folder is as if the place had gone to a person who withdrew before answering."""
    monkeypatch.setattr("hpop.study.report.DPI", 30)

    def rule(who: str, place: int, form: str, item: str) -> float:
        return float(int(who[1:]) % 4)

    never = Path(shutil.copytree(begun, tmp_path / "never"))
    study.withdraw(never, "p02")
    answered(design, never, ["p01", "p03"], rule)
    answered(design, begun, ["p01", "p03"], rule)
    events = [{**one, "t": one["t"] + 0.718281} for one in events_of(design, "p02", rule, remark="I know the robot")]
    put(begun, {**session(design, "p02", events), "device": {"browser": "Lynx 2.9"}})
    for at in (begun, never):
        Answers.load(at).save_tables(at)
        study.analyse(Design.load(at), Answers.load(at), score=("comfort", "comfort")).save(at / "report")
    assert any(b".71828" in path.read_bytes() for path in begun.glob("*.csv"))
    assert "p02" in (begun / "scores.csv").read_text()
    put(begun, session(design, "p02"), "copy")
    left = f".{'0123456789abcdef' * 2}.tmp"  # of writers that were killed
    for name in (f"answers/.p02.json{left}", f".answers.csv{left}", f"report/.scores.csv{left}"):
        (begun / name).write_text("p02,2.718281")
    (begun / "p02_preference.json").write_text("{}")
    (begun / "backup.csv").write_text("p01,1\np02,2.718281\n")
    done = study.withdraw(begun, "p02")
    assert (done.successor, study.withdraw(begun, "p02").removed) == ("p13", ())  # again, as after a crash
    gone = {"answers/p02.json", "answers/copy.json", f"answers/.p02.json{left}", "p02_preference.json"}
    assert set(done.removed) == {*gone, "pages/p02.html"}
    assert {"answers.sqlite", "report/"} <= set(done.remade)
    (note,) = done.notes
    assert note.startswith(f"{begun / 'backup.csv'} names p02")
    (begun / "backup.csv").unlink()
    assert files_of(begun) == files_of(never)
    for name in files_of(begun):
        data = (begun / name).read_bytes()
        assert data == (never / name).read_bytes(), name
        for trace in (b".71828", struct.pack(">d", 2 + 0.718281), b"I know the robot", b"Lynx 2.9"):
            assert trace not in data, name
        if name not in ("design.json", "people.json", "schedule.csv") and "report" not in name:
            assert not WORD.search(data), name
    assert check(begun).faults == ()


def test_who_dropped_out_keeps_what_was_answered(begun: Path, design: Design) -> None:
    answered(design, begun, ["p02"])
    assert study.replace(begun, "p02") == "p13"
    assert Answers.load(begun).people == ("p02",)
    with pytest.raises(StudyError, match="p02 dropped out already; p13 has the place"):
        study.replace(begun, "p02")
    assert (begun / "pages" / "p13.html").is_file()
    assert check(begun).faults == ()


@pytest.mark.parametrize("given", ["Anna", "p99", "../p01", "p1"])
@pytest.mark.parametrize("act", [study.replace, study.withdraw])
def test_nobody_else_is_removed(begun: Path, act: Any, given: str) -> None:
    before = files_of(begun)
    with pytest.raises(StudyError, match=r"names and initials|no participant p99"):
        act(begun, given)
    assert files_of(begun) == before


def test_a_baseline_is_ridden_as_rows_are(front: hpop.Front, tmp_path: Path) -> None:
    """Its name is not on the page; without its trajectory nothing is made."""
    other = study.Baseline("what RRT does", front.trajectories[2], front[2].costs)
    rows = ["knee", "least length"]
    design = Design.of(front, rows, participants=2, order="latin", baselines=[other], forms=["comfort"], consent="Yes")
    with pytest.raises(StudyError, match="the design's baselines are what RRT does, got none"):
        folder.prepare(design, front, tmp_path / "study")
    folder.prepare(design, front, tmp_path / "study", baselines=[other])
    assert check(tmp_path / "study").faults == ()
    assert not any(b"what RRT does" in path.read_bytes() for path in tmp_path.rglob("*.html"))
