"""`hpop plan` as a user meets it: what it prints, what it leaves behind, and its exit codes."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import hpop.view
from hpop.base import registry
from hpop.cli.beside import PicturesBeside
from hpop.criteria.base import criterion
from hpop.motions import Motions
from hpop.planners.base import Candidates
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import ProgressCallback

EXAMPLES = Path(__file__).parents[2] / "examples"


# Planning


def test_plan_writes_the_front_and_pictures_and_prints_both(plan: Callable[..., Result], room: Path) -> None:
    result = plan(room)
    assert result.exit_code == 0
    written = {path.name for path in (room / "out").iterdir()}
    assert written == {"front.json", "front.html", "map.png", "front.png", "trace.png", "where.png"}
    front = Front.load(room / "out" / "front.json")
    assert front.status == "complete"
    assert verify(Problem.from_description(front.problem or {}), front) == []
    for word in ("turns", "length\n", "(m)", "knee", "least turns", "least length", "planned", "executed", "complete"):
        assert word.strip() in result.stdout


@pytest.mark.usefixtures("no_pictures")
def test_without_out_the_folder_has_the_scenarios_name(
    run: Callable[..., Result], room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("plan", room / "room.yaml")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "room" / "front.json").exists()


@pytest.mark.usefixtures("no_pictures")
def test_show_verifies_what_plan_wrote(run: Callable[..., Result], plan: Callable[..., Result], room: Path) -> None:
    plan(room)
    for path in (room / "out", room / "out" / "front.json"):
        result = run("show", path)
        assert result.exit_code == 0
        assert "verified" in result.stdout


@pytest.mark.cases("aws_bookstore")
@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("name", ["pal_office", "aws_bookstore", "nav2_depot"])
def test_the_same_command_plans_in_real_buildings(
    plan: Callable[..., Result], tmp_path: Path, shared_data: Callable[[str], Path], name: str
) -> None:
    data = shared_data(name).parent
    text = (EXAMPLES / f"{name}.yaml").read_text()
    assert "step: 0.25" in text
    (tmp_path / "room.yaml").write_text(text.replace("../../shared/data", str(data)).replace("step: 0.25", "step: 0.5"))
    result = plan(tmp_path)
    assert result.exit_code == 0, result.output
    front = Front.load(tmp_path / "out" / "front.json")
    assert len(front) > 1
    assert verify(Problem.from_description(front.problem or {}), front) == []


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("name", ["pal_office", "aws_bookstore", "nav2_depot", "museum"])
def test_examples_find_their_maps_from_where_they_are(name: str, shared_data: Callable[[str], Path]) -> None:
    from hpop.scenario import load_scenario

    if name != "museum" and shared_data(name).resolve() != (EXAMPLES / "../../shared/data" / name).resolve():
        pytest.skip("the public data are elsewhere (HPOP_DATA)")
    assert len(load_scenario(EXAMPLES / f"{name}.yaml").problem.criteria) == 3


def test_no_path_says_what_separates_and_still_writes_the_front_and_the_map(
    run: Callable[..., Result],
    plan: Callable[..., Result],
    write: Callable[..., None],
    write_map: Callable[..., None],
    room: Path,
) -> None:
    write_map(room, door=0.3)
    write(room, ("radius: 0.2", "radius: 0.3"))
    result = plan(room)
    assert result.exit_code == 6
    assert {path.name for path in (room / "out").iterdir()} == {"front.json", "front.html", "map.png"}
    assert "no path: " in result.stdout
    assert len(Front.load(room / "out" / "front.json")) == 0
    assert run("show", room / "out").exit_code == 0


# Bad input: each has its own message and exit code, and nothing is left behind


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (("[0.5, 0.5, 0]", "[2.0, 0.5, 0]"), 5, "the start (2.000, 0.500) is not usable: it is inside an obstacle"),
        (("[3.5, 0.5, 0]", "[40, 0.5, 0]"), 5, "outside the map"),
        (("radius: 0.2", "radius: 3"), 5, "the robot reaches 3.000 m"),
        (("map.yaml", "office.yaml"), 3, "office.yaml"),
        (("turns,", "turnz,"), 7, "Did you mean 'turns'?"),
        (("lattice:", "latice:"), 7, "Did you mean 'lattice'?"),
        (("step: 0.5", "step: 0"), 10, "line 9, planner.lattice"),
        (("step: 0.5", "step: 1.0e-6"), 10, "take a larger step"),
        (("step: 0.5", "headings: 7"), 10, "one of 4, 8, 16"),
        (("turns,", "turns, turns,"), 8, "turns more than once"),
        (("goal:", "gaol:"), 4, "did you mean 'goal'?"),
    ],
)
def test_a_wrong_scenario(
    plan: Callable[..., Result],
    refused: Callable[..., None],
    write: Callable[..., None],
    room: Path,
    change: tuple[str, str],
    code: int,
    said: str,
) -> None:
    write(room, change)
    refused(plan(room), code, said)
    assert not (room / "out").exists()


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot be opened"),
        (b"", "empty (0 bytes)"),
        (b"P5\n40 20\n255\n" + bytes(100), "file is complete"),
        (b"P5\n50000 50000\n255\n", "too large"),
        (b"no image", "no image that can be read"),
    ],
)
def test_a_broken_map_image(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, content: bytes | None, said: str
) -> None:
    (room / "map.pgm").unlink()
    if content is not None:
        (room / "map.pgm").write_bytes(content)
    refused(plan(room), 3, said, "map.pgm", "line 2, world.ros_map")


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("resolution", [0, -1, float("nan"), float("inf"), "fine", True])
def test_a_map_without_a_usable_resolution(
    plan: Callable[..., Result],
    refused: Callable[..., None],
    write_map: Callable[..., None],
    room: Path,
    resolution: object,
) -> None:
    write_map(room, resolution=resolution)
    refused(plan(room), 3, "resolution must be")


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("name", ["map.yaml", "room.yaml"])
def test_a_yaml_that_would_run_code_runs_none(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, name: str
) -> None:
    with (room / name).open("a") as file:
        file.write(f"x: !!python/object/apply:os.mkdir ['{room / 'mine'}']\n")
    refused(plan(room), {"map.yaml": 3, "room.yaml": 4}[name], "python/object/apply:os.mkdir")
    assert not (room / "mine").exists()


@pytest.mark.usefixtures("no_pictures")
def test_deeply_nested_yaml_does_not_end_the_process(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path
) -> None:
    (room / "room.yaml").write_text("world: " + "[" * 100_000)
    refused(plan(room), 4, "nested")


def test_a_scenario_that_is_a_folder_or_missing(
    run: Callable[..., Result], refused: Callable[..., None], tmp_path: Path
) -> None:
    refused(run("plan", tmp_path, "--out", tmp_path / "out"), 4, "found a folder")
    refused(run("plan", tmp_path / "gone.yaml", "--out", tmp_path / "out"), 4, "no such file")


@pytest.mark.usefixtures("no_pictures")
def test_an_output_folder_that_cannot_be_written_is_found_before_planning(
    run: Callable[..., Result], refused: Callable[..., None], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Problem, "fronts", lambda *a, **k: pytest.fail("planned before looking"))
    (room / "dangling").symlink_to(room / "gone")
    for out in (room / "dangling", room / "map.pgm", room / "map.pgm" / "below", Path("/proc/hpop/out")):
        refused(run("plan", room / "room.yaml", "--out", out), 12, "cannot write to", "choose another --out")


def test_an_empty_name_of_the_output_folder_is_refused(run: Callable[..., Result], room: Path) -> None:
    result = run("plan", room / "room.yaml", "--out", "")
    assert result.exit_code == 2
    assert "expected a folder, got ''" in result.stderr


@pytest.mark.parametrize("name", ["front.json", "map.png"])
def test_a_folder_where_a_file_is_to_be_written_is_found_before_planning(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(Problem, "fronts", lambda *a, **k: pytest.fail("planned before looking"))
    (room / "out" / name).mkdir(parents=True)
    refused(plan(room), 12, f"cannot write to {room / 'out' / name}: it is a folder", "choose another --out")


@pytest.mark.usefixtures("no_pictures")
def test_a_disk_that_is_full_is_said_and_leaves_no_half_a_front(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    monkeypatch.setattr(tempfile, "tempdir", str(room))
    refused(plan(room), 12, "No space left on device")
    assert not (room / "out").exists()
    assert not list(room.glob("hpop-*"))


@pytest.mark.usefixtures("no_pictures")
def test_a_front_that_cannot_be_saved_where_it_should_is_saved_elsewhere(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(room))
    fronts = Problem.fronts

    def then_in_the_way(self: Problem, *arguments: Any, **options: Any) -> Iterator[Front]:
        (room / "out").rmdir()
        (room / "out").touch()
        yield from fronts(self, *arguments, **options)

    monkeypatch.setattr(Problem, "fronts", then_in_the_way)
    result = plan(room)
    (rescued,) = room.glob("hpop-*/front.json")
    refused(result, 12, "cannot write to", f"the front is saved in {rescued}")
    assert len(Front.load(rescued)) > 0


def test_when_pictures_fail_the_front_is_there_and_the_error_says_so(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (room / "out").mkdir()
    for name in ("map.png", "trace.png", "front.html"):
        (room / "out" / name).write_text("of an earlier front")

    def broken(*arguments: object, **options: object) -> None:
        raise ValueError("no ink")

    monkeypatch.setattr(hpop.view, "save_pictures", broken)
    result = plan(room)
    refused(result, 12, "the front is saved in", "no ink")
    assert "knee" in result.stdout
    assert [path.name for path in (room / "out").iterdir()] == ["front.json"]  # no picture of an earlier front


@pytest.mark.parametrize(
    ("limit", "said"), [("", "complete and saved"), (", max_labels: 1", "saved")], ids=["complete", "at a limit"]
)
def test_an_interruption_while_drawing_says_where_the_front_is_and_that_pictures_are_left_out(
    plan: Callable[..., Result],
    room: Path,
    write: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
    limit: str,
    said: str,
) -> None:
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    begun: list[tuple[Path, str]] = []
    monkeypatch.setattr(hpop.view, "save_pictures", interrupted)
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: begun.append((pictures.folder, which)))
    write(room, ("step: 0.5", f"step: 0.5{limit}"))
    result = plan(room)
    assert (result.exit_code, begun) == (130, [])
    assert result.stderr == (
        f"interrupted: the front is {said} in {room / 'out' / 'front.json'}; pictures are missing; "
        f"`hpop show {room / 'out'}` prints the front\n"
    )
    assert len(Front.load(room / "out" / "front.json")) > 0


def test_an_interruption_while_the_table_is_printed_says_where_the_front_is(
    plan: Callable[..., Result], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hpop.cli.report.print_front", interrupted)
    result = plan(room)
    assert result.exit_code == 130
    assert "the front is complete and saved in" in result.stderr
    assert len(Front.load(room / "out" / "front.json")) > 0


@dataclass(frozen=True)
class Stub:
    """A planner that is interrupted, or fails, before it finds anything."""

    error: BaseException
    name: str = "stub"

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        raise self.error


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    ("error", "code"),
    [(KeyboardInterrupt(), 130), (hpop.errors.OptionError("second thoughts"), 10), (MemoryError(), 1)],
)
def test_what_one_planner_found_survives_the_failure_of_the_next(
    plan: Callable[..., Result], room: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int
) -> None:
    fronts = Problem.fronts
    monkeypatch.setattr(
        Problem, "fronts", lambda self, planners, **k: fronts(self, [*planners, Stub(error), *planners], **k)
    )
    result = plan(room)
    assert result.exit_code == code
    assert len(Front.load(room / "out" / "front.json")) > 0
    if code == 130:
        assert "complete | interrupted" in result.stdout
    else:
        assert "the front found before is saved in" in result.stderr


@pytest.mark.usefixtures("no_pictures")
def test_an_interruption_before_anything_is_found_leaves_nothing(
    plan: Callable[..., Result], refused: Callable[..., None], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fronts = Problem.fronts
    monkeypatch.setattr(Problem, "fronts", lambda self, p, **k: fronts(self, [Stub(KeyboardInterrupt())], **k))
    refused(plan(room), 130, "interrupted")
    assert not (room / "out").exists()


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("cost", [-1.0, float("nan"), float("inf")])
def test_a_criterion_with_a_cost_that_is_none_is_named(
    plan: Callable[..., Result],
    refused: Callable[..., None],
    write: Callable[..., None],
    room: Path,
    monkeypatch: pytest.MonkeyPatch,
    cost: float,
) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria))

    @criterion("mood", group="C", unit="1", aggregate="sum")
    @dataclass(frozen=True)
    class Mood:
        def cost(self, m: Motions) -> np.ndarray:
            return np.full(len(m), cost)

    write(room, ("turns,", "mood,"))
    refused(plan(room), 8, "criterion 'mood' must cost a finite number >= 0", str(cost))


@pytest.mark.usefixtures("no_pictures")
def test_seven_costs_are_more_than_the_exact_search_takes(
    plan: Callable[..., Result],
    refused: Callable[..., None],
    write: Callable[..., None],
    room: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria))
    names = [f"mood{i}" for i in range(7)]
    for name in names:

        @criterion(name, group="C", unit="1", aggregate="sum")
        @dataclass(frozen=True)
        class Mood:
            def cost(self, m: Motions) -> np.ndarray:
                return np.ones(len(m))

        registry.criteria._types[name] = Mood
    write(room, ("turns, length", ", ".join(names)))
    refused(plan(room), 10, f"at most 6 costs, got 7: {', '.join(names)}; leave some out")


@pytest.mark.parametrize(("limit", "value"), [("time_limit", "10"), ("max_memory", "100000")])
def test_a_limit_that_leaves_nothing_found_is_no_success_and_is_named(
    plan: Callable[..., Result],
    room: Path,
    no_pictures: None,
    limit: str,
    value: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seconds = count()  # one more whenever planning looks: some to read the map, hundreds to build
    monkeypatch.setattr("hpop.planners.spending.perf_counter", lambda: float(next(seconds)))
    text = (room / "room.yaml").read_text()
    assert "lattice: {step: 0.5" in text
    (room / "room.yaml").write_text(text.replace("lattice: {step: 0.5", f"lattice: {{{limit}: {value}, step: 0.1"))
    result = plan(room)
    assert result.exit_code == 13
    status = limit.replace("max_memory", "memory_limit").replace("_", " ")
    assert f"nothing was found: {status}: raise {limit} (" in result.stderr
    assert status in result.stdout
    assert (room / "out/front.json").exists()
