"""`hpop plan` while a search goes on: each stage saved, told in a line and drawn by another process."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely
from click.testing import CliRunner, Result

import hpop.view
from hpop.cli import main, report
from hpop.cli.beside import PicturesBeside
from hpop.errors import OptionError
from hpop.planners.base import Candidates
from hpop.planners.graph_planners import Lattice
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.limits import ProgressCallback, Status
from tests.worlds import TWO_WALLS

LINE = re.compile(
    r"^(\d+\.\d\d) s  (\S+): ([\d,]+) traject(?:ory|ories), hypervolume (\d+\.\d{4}|beyond)[^,]*, (.*)$",
    re.MULTILINE,
)


def slowly(last: Callable[[Candidates], Candidates]) -> Callable[..., Iterator[Candidates]]:
    """Stages of a lattice: its front a few points at a time, then what is asked of the last one."""

    def stages(planner: Lattice, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
        exact = planner.solve(problem)
        for count in (2, 4):
            yield replace(
                exact,
                trajectories=exact.trajectories[:count],
                planned=exact.planned[:count],
                tolerance=exact.tolerance[:count],
                provenance=exact.provenance[:count],
                status=Status.UNFINISHED,
            )
        yield last(exact)

    return stages


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(hpop.view, "save_pictures", lambda problem, front, folder, **options: [])
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)
    (tmp_path / "room.yaml").write_text(TWO_WALLS)
    return tmp_path


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Status and size of what is saved whenever another process shall draw it."""
    begun: list[tuple[str, int]] = []

    def begin(pictures: PicturesBeside) -> None:
        front = Front.load(pictures.folder / "front.json")
        begun.append((front.status, len(front)))
        for name in ("map.png", "front.png"):
            assert not (pictures.folder / name).exists()  # those of the front before are gone
            (pictures.folder / name).touch()

    monkeypatch.setattr(PicturesBeside, "stage", begin)
    monkeypatch.setattr(PicturesBeside, "start", begin)
    return begun


def plan(room: Path, monkeypatch: pytest.MonkeyPatch, last: Callable[[Candidates], Candidates]) -> Result:
    monkeypatch.setattr(Lattice, "stages", slowly(last))
    result = CliRunner().invoke(main, ["plan", str(room / "room.yaml"), "--out", str(room / "out")])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def lines(result: Result) -> list[tuple[int, str]]:
    return [(int(count), status) for _, _, count, _, status in LINE.findall(result.stdout)]


def test_each_stage_is_saved_drawn_and_told(
    room: Path, drawn: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    result = plan(room, monkeypatch, lambda exact: exact)
    front = Front.load(room / "out" / "front.json")
    assert result.exit_code == 0
    assert front.status == "complete"
    assert len(front) > 4
    assert drawn == [("unfinished", 2), ("unfinished", 4)]  # the last is drawn here, at the end
    assert lines(result) == [(2, "unfinished"), (4, "unfinished"), (len(front), "complete")]
    told = LINE.findall(result.stdout)
    assert {planner for _, planner, *_ in told} == {"lattice"}
    volumes = [math.inf if volume.startswith("beyond") else float(volume) for *_, volume, _ in told]
    assert volumes == sorted(volumes)
    seconds = [float(began) for began, *_ in told]
    assert seconds == sorted(seconds)


@pytest.mark.parametrize(
    ("error", "code", "status"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "unfinished"),
        (OptionError("no"), 10, "unfinished"),
    ],
)
def test_a_stage_that_fails_leaves_the_front_before_it(
    room: Path,
    drawn: list[tuple[str, int]],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    status: str,
) -> None:
    def fail(exact: Candidates) -> Candidates:
        raise error

    result = plan(room, monkeypatch, fail)
    front = Front.load(room / "out" / "front.json")
    assert result.exit_code == code
    assert (front.status, len(front)) == (status, 4)
    # Who stops a search gets the prompt back: what was found is drawn by another process.
    assert drawn[2:] == [("interrupted", 4)] * (status == "interrupted")
    assert ("written to" in result.stdout) is (status == "interrupted")
    assert ("the front found before is saved in" in result.stderr) is (status == "unfinished")


def test_ctrl_c_while_a_stage_is_saved_keeps_it(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain, calls = Front.save, []

    def interrupted_once(front: Front, path: Path) -> None:
        calls.append(path)
        if len(calls) == 2:
            raise KeyboardInterrupt
        plain(front, path)

    monkeypatch.setattr(Front, "save", interrupted_once)
    result = plan(room, monkeypatch, lambda exact: exact)
    front = Front.load(room / "out" / "front.json")
    assert result.exit_code == 130
    assert (front.status, len(front)) == ("interrupted", 4)


# Another process


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 3, 2))
    problem = Problem(world, hpop.DifferentialDrive(radius=0.25), (1, 1, 0), (2, 1, None), ["turns", "length"])
    problem.solve(Lattice(step=0.5)).save(tmp_path / "front.json")
    return tmp_path


@pytest.mark.proof  # a real plan draws all of them in tests/cli/test_current_folder.py
def test_another_process_draws_what_is_saved(saved: Path) -> None:
    with PicturesBeside(saved) as pictures:
        pictures.start()
        assert pictures._process is not None
        assert pictures._process.wait() == 0
    names = {"front.json", "front.html", "map.png", "front.png", "trace.png", "where.png"}
    assert {path.name for path in saved.iterdir()} == names


@pytest.mark.proof
def test_of_a_stage_that_stands_the_map_is_drawn_and_of_others_nothing(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with PicturesBeside(saved) as pictures:
        pictures.stage()  # the next front comes at once
    assert pictures._process is None
    monkeypatch.setattr("hpop.cli.beside.STANDS", 0.0)
    with PicturesBeside(saved) as pictures:
        pictures.stage()
        assert pictures._timer is not None
        pictures._timer.join()
        assert pictures._process is not None
        assert pictures._process.wait() == 0
    assert {path.name for path in saved.iterdir()} == {"front.json", "map.png"}


def test_what_is_stopped_draws_no_more_and_leaves_no_half_of_a_picture(saved: Path) -> None:
    with PicturesBeside(saved) as pictures:
        pictures.start()
        process = pictures._process
        (saved / ".map.png.123.tmp").touch()
    assert process is not None
    assert process.returncode not in (0, None)
    assert [path.name for path in saved.iterdir()] == ["front.json"]
    pictures.stop()  # again does no harm


def test_without_another_process_there_are_no_pictures_and_no_error(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.executable", str(saved / "python"))
    with PicturesBeside(saved) as pictures:
        pictures.start()
        assert pictures._process is None
    assert [path.name for path in saved.iterdir()] == ["front.json"]


# The line of a stage


def test_hypervolumes_are_told_in_the_scale_of_the_first_front(capsys: pytest.CaptureFixture[str]) -> None:
    """(0, 1) and (1, 0) cover 1.1² - 1 of the box up to (1.1, 1.1); (-1, -1) covers 2.1², more than the box."""

    def front(*costs: tuple[float, float]) -> Front:
        return Front.of(
            costs,
            [None] * len(costs),  # type: ignore[list-item]
            names=["a", "b"],
            units=["1", "1"],
            quanta=[1e-6, 1e-6],
            status="unfinished",
            certificate="none",
            runs=[{"planner": "p"}],
        )

    say = report.StageLines()
    for told in (front(), front((0, 2), (4, 0)), front((0, 2), (4, 0), (-4, 4)), front((-4, -2))):
        say(told)
    printed = capsys.readouterr().out
    said = LINE.findall(printed)
    assert re.findall(r"\d (traject\w+)", printed) == [*["trajectories"] * 3, "trajectory"]
    assert [volume for *_, volume, _ in said] == ["0.0000", "0.2100", "0.2100", "beyond"]
    assert printed.count("the scale of this run's first front") == 4  # another run may have another first front
    assert say.last is told
    report.StageLines()(replace(told, status=Status.COMPLETE))  # alone, so there is nothing to compare it with
    assert capsys.readouterr().out.endswith("s  p: 1 trajectory, complete\n")


def test_saved_stages_are_valid_fronts(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As another program sees them that reads the file whenever it changes."""
    seen: list[dict[str, Any]] = []
    monkeypatch.setattr(
        PicturesBeside, "stage", lambda pictures: seen.append(json.loads((pictures.folder / "front.json").read_text()))
    )
    plan(room, monkeypatch, lambda exact: exact)
    assert [document["points"]["count"] for document in seen] == [2, 4]
    assert all(document["status"] == "unfinished" for document in seen)
