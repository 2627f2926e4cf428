"""The command line as a user meets it: what it prints, what it leaves behind, and its exit codes."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result

import hpop.view
from hpop import registry
from hpop.cli import main
from hpop.criteria.base import criterion
from hpop.front import Front
from hpop.motions import Motions
from hpop.planners.base import Candidates
from hpop.problem import Problem
from hpop.status import ProgressCallback
from hpop.verify import verify

EXAMPLES = Path(__file__).parents[1] / "examples"
ROOM = """\
world:
  ros_map: {path: map.yaml}
model:
  differential_drive: {radius: 0.2}
start: [0.5, 0.5, 0]
goal: [3.5, 0.5, 0]
criteria: [turns, length]
planner:
  lattice: {step: 0.5}
"""
MAP = {
    "image": "map.pgm",
    "resolution": 0.1,
    "origin": [0, 0, 0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.2,
}


def write_map(folder: Path, door: float = 1.0, **keys: object) -> None:
    """A room of 4 x 2 m with a wall in the middle; the door in it (m wide) is at the top."""
    pixels = np.full((20, 40), 255, dtype=np.uint8)
    pixels[round(10 * door) :, 19:21] = 0
    (folder / "map.pgm").write_bytes(b"P5\n40 20\n255\n" + pixels.tobytes())
    (folder / "map.yaml").write_text(yaml.safe_dump(MAP | keys))


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    text = ROOM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "room.yaml").write_text(text)
    return folder / "room.yaml"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """Folder with a map and a scenario that has a front."""
    write_map(tmp_path)
    write(tmp_path)
    return tmp_path


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are tested elsewhere and take a second each."""
    monkeypatch.setattr(hpop.view, "save_pictures", lambda problem, front, folder: [])


def run(*arguments: object) -> Result:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "Traceback" not in result.output
    return result


def plan(folder: Path) -> Result:
    return run("plan", folder / "room.yaml", "--out", folder / "out")


def refused(result: Result, code: int, *said: str) -> None:
    """It ends with this exit code, and all this is said on standard error."""
    assert (result.exit_code, [text for text in said if text not in result.stderr]) == (code, []), result.stderr
    assert result.stderr.startswith("error: ")


# Planning


def test_plan_writes_the_front_and_pictures_and_prints_both(room: Path) -> None:
    result = plan(room)
    assert result.exit_code == 0
    written = {path.name for path in (room / "out").iterdir()}
    assert written == {"front.json", "map.png", "front.png", "trace.png", "where.png"}
    front = Front.load(room / "out" / "front.json")
    assert front.status == "complete"
    assert verify(Problem.from_description(front.problem or {}), front) == []
    for word in ("turns", "length\n", "(m)", "knee", "least turns", "least length", "planned", "executed", "complete"):
        assert word.strip() in result.stdout


@pytest.mark.usefixtures("no_pictures")
def test_show_verifies_what_plan_wrote(room: Path) -> None:
    plan(room)
    for path in (room / "out", room / "out" / "front.json"):
        result = run("show", path)
        assert result.exit_code == 0
        assert "verified" in result.stdout


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("name", ["pal_office", "aws_bookstore", "nav2_depot"])
def test_the_same_command_plans_in_real_buildings(
    tmp_path: Path, shared_data: Callable[[str], Path], name: str
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


def test_no_path_says_what_separates_and_still_writes_the_front_and_the_map(room: Path) -> None:
    write_map(room, door=0.3)
    write(room, ("radius: 0.2", "radius: 0.3"))
    result = plan(room)
    assert result.exit_code == 6
    assert {path.name for path in (room / "out").iterdir()} == {"front.json", "map.png"}
    assert "no path: " in result.stdout
    assert len(Front.load(room / "out" / "front.json")) == 0
    assert run("show", room / "out").exit_code == 0


# Bad input: each has its own message and exit code, and nothing is left behind


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (("[0.5, 0.5, 0]", "[2.0, 0.5, 0]"), 5, "the start (2.000, 0.500) is not usable: it is inside an obstacle"),
        (("[0.5, 0.5, 0]", "[0.5, 0.5, 0.3]"), 5, "start heading"),
        (("[3.5, 0.5, 0]", "[40, 0.5, 0]"), 5, "outside the map"),
        (("radius: 0.2", "radius: 3"), 5, "the robot reaches 3.000 m"),
        (("map.yaml", "office.yaml"), 3, "office.yaml"),
        (("turns,", "turnz,"), 7, "Did you mean 'turns'?"),
        (("lattice:", "latice:"), 7, "Did you mean 'lattice'?"),
        (("step: 0.5", "step: 0"), 10, "line 9, planner.lattice"),
        (("step: 0.5", "step: 1.0e-6"), 10, "take a larger step"),
        (("step: 0.5", "headings: 7"), 10, "[4, 8, 16]"),
        (("turns,", "turns, turns,"), 8, "turns more than once"),
        (("goal:", "gaol:"), 4, "did you mean 'goal'?"),
    ],
)
def test_a_wrong_scenario(room: Path, change: tuple[str, str], code: int, said: str) -> None:
    write(room, change)
    refused(plan(room), code, said)
    assert not (room / "out").exists()


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot be opened"),
        (b"", "empty (0 bytes)"),
        (b"P5\n40 20\n255\n" + bytes(100), "cut off"),
        (b"P5\n50000 50000\n255\n", "too large"),
        (b"no image", "no image that can be read"),
    ],
)
def test_a_broken_map_image(room: Path, content: bytes | None, said: str) -> None:
    (room / "map.pgm").unlink()
    if content is not None:
        (room / "map.pgm").write_bytes(content)
    refused(plan(room), 3, said, "map.pgm", "line 2, world.ros_map")


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("resolution", [0, -1, float("nan"), float("inf"), "1e-3", True])
def test_a_map_without_a_usable_resolution(room: Path, resolution: object) -> None:
    write_map(room, resolution=resolution)
    refused(plan(room), 3, "resolution must be")


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("name", ["map.yaml", "room.yaml"])
def test_a_yaml_that_would_run_code_runs_none(room: Path, name: str) -> None:
    with (room / name).open("a") as file:
        file.write(f"x: !!python/object/apply:os.mkdir ['{room / 'mine'}']\n")
    refused(plan(room), {"map.yaml": 3, "room.yaml": 4}[name], "python/object/apply:os.mkdir")
    assert not (room / "mine").exists()


@pytest.mark.usefixtures("no_pictures")
def test_deeply_nested_yaml_does_not_end_the_process(room: Path) -> None:
    (room / "room.yaml").write_text("world: " + "[" * 100_000)
    refused(plan(room), 4, "nested")


def test_a_scenario_that_is_a_folder_or_missing(tmp_path: Path) -> None:
    refused(run("plan", tmp_path, "--out", tmp_path / "out"), 4, "is a folder")
    refused(run("plan", tmp_path / "gone.yaml", "--out", tmp_path / "out"), 4, "no such file")


@pytest.mark.usefixtures("no_pictures")
def test_an_output_folder_that_cannot_be_written_is_found_before_planning(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Problem, "fronts", lambda *a, **k: pytest.fail("planned before looking"))
    (room / "dangling").symlink_to(room / "gone")
    for out in (room / "dangling", room / "map.pgm", room / "map.pgm" / "below", Path("/proc/hpop/out")):
        refused(run("plan", room / "room.yaml", "--out", out), 12, "cannot write to", "choose another --out")


@pytest.mark.usefixtures("no_pictures")
def test_a_disk_that_is_full_is_said_and_leaves_no_half_a_front(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    monkeypatch.setattr(tempfile, "tempdir", str(room))
    refused(plan(room), 12, "No space left on device")
    assert list((room / "out").iterdir()) == []
    assert not list(room.glob("hpop-*"))


@pytest.mark.usefixtures("no_pictures")
def test_a_front_that_cannot_be_saved_where_it_should_is_saved_elsewhere(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(room))
    fronts = Problem.fronts

    def then_in_the_way(self: Problem, *arguments: Any, **options: Any) -> Iterator[Front]:
        (room / "out").touch()
        yield from fronts(self, *arguments, **options)

    monkeypatch.setattr(Problem, "fronts", then_in_the_way)
    result = plan(room)
    (rescued,) = room.glob("hpop-*/front.json")
    refused(result, 12, "cannot write to", f"the front is saved in {rescued}")
    assert len(Front.load(rescued)) > 0


def test_when_pictures_fail_the_front_is_there_and_the_error_says_so(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan(room)

    def broken(*arguments: object) -> None:
        raise ValueError("no ink")

    monkeypatch.setattr(hpop.view, "save_pictures", broken)
    result = plan(room)
    refused(result, 12, "the front is saved in", "no ink")
    assert "knee" in result.stdout
    assert [path.name for path in (room / "out").iterdir()] == ["front.json"]  # no picture of an earlier front


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
    room: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int
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
        assert "what was found before is saved in" in result.stderr


@pytest.mark.usefixtures("no_pictures")
def test_an_interruption_before_anything_is_found_leaves_nothing(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fronts = Problem.fronts
    monkeypatch.setattr(Problem, "fronts", lambda self, p, **k: fronts(self, [Stub(KeyboardInterrupt())], **k))
    refused(plan(room), 130, "interrupted")
    assert not (room / "out").exists()


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("cost", [-1.0, float("nan"), float("inf")])
def test_a_criterion_with_a_cost_that_is_none_is_named(
    room: Path, monkeypatch: pytest.MonkeyPatch, cost: float
) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria._types))

    @criterion("mood", group="C", unit="1", aggregate="sum")
    @dataclass(frozen=True)
    class Mood:
        def cost(self, m: Motions) -> np.ndarray:
            return np.full(len(m), cost)

    write(room, ("turns,", "mood,"))
    refused(plan(room), 8, "criterion 'mood' must cost a finite number >= 0", str(cost))


@pytest.mark.usefixtures("no_pictures")
def test_seven_costs_are_more_than_the_exact_search_takes(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria._types))
    names = [f"mood{i}" for i in range(7)]
    for name in names:

        @criterion(name, group="C", unit="1", aggregate="sum")
        @dataclass(frozen=True)
        class Mood:
            def cost(self, m: Motions) -> np.ndarray:
                return np.ones(len(m))

        registry.criteria._types[name] = Mood
    write(room, ("turns, length", ", ".join(names)))
    refused(plan(room), 10, "at most 6 costs, got 7")


# Showing


def edited(path: Path, change: Callable[[dict], object]) -> None:
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def moved(data: dict, name: str, by: float) -> None:
    """Shift one state along the whole first trajectory."""
    states = data["points"][0]["item"]["states"]
    states[name] = [value + by for value in states[name]]


@pytest.fixture
def saved(room: Path, no_pictures: None) -> Path:
    plan(room)
    return room / "out" / "front.json"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["points"][0]["costs"].__setitem__(1, d["points"][0]["costs"][1] - 0.5), "length is saved as"),
        (lambda d: moved(d, "y", 0.05), "does not begin at the start"),
        (lambda d: moved(d, "x", 1e12), "leaves the map"),
        (lambda d: moved(d, "yaw", 0.5), "does not go ahead"),
        (lambda d: d["points"][0]["item"]["states"]["y"].__setitem__(0, 0.7), "turn does not change y"),
        (lambda d: d["criteria"][1].__setitem__("unit", "km"), "km"),
        (lambda d: d["problem"].__setitem__("goal", [0.5, 1.0, 0.0]), "from the goal"),
    ],
)
def test_a_front_edited_by_hand_is_found_out(saved: Path, change: Callable[[dict], object], said: str) -> None:
    edited(saved, change)
    result = run("show", saved)
    assert result.exit_code == 12
    assert said in result.stderr
    assert "does not hold what it claims" in result.stderr or "cannot be decoded" in result.stderr
    assert "knee" not in result.stdout  # what is wrong is not shown as if it were right


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda d: d.pop("status"), 12),
        (lambda d: d.update(version=99), 12),
        (lambda d: d.update(schema="other"), 12),
        (lambda d: d.update(problem=None), 12),
        (lambda d: d["problem"].update(model=5), 12),
        (lambda d: d["problem"].update(model={"differential_drive": 5}), 12),
        (lambda d: d["problem"].update(model={"differential_drive": {"radius": "wide"}}), 12),
        (lambda d: d["problem"].update(criteria=5), 5),
        (lambda d: d["problem"].update(criteria=[{"turns": 5}]), 5),
        (lambda d: d["problem"].update(criteria=["turnz"]), 7),
        (lambda d: d["problem"].update(start="here"), 5),
        (lambda d: d["problem"].pop("goal"), 5),
        (lambda d: d["problem"].update(world=[]), 3),
        (lambda d: d["points"][0].update(item=[1, 2]), 12),
        (lambda d: d["points"][0]["item"].update(kinds=["fly"]), 12),
        (lambda d: d["points"][0]["item"]["states"].update(x=[0.0]), 12),
        (lambda d: d["points"].append(d["points"][0]), 12),
        (lambda d: d["criteria"][0].update(name="[/bold]"), 12),
        (lambda d: d["runs"].append({"notes": 5, "planner": "[/red]"}), 0),
    ],
)
def test_a_front_that_is_no_front_is_refused_without_a_traceback(
    saved: Path, change: Callable[[dict], object], code: int
) -> None:
    edited(saved, change)
    result = run("show", saved.parent)
    assert result.exit_code == code
    assert result.stderr.startswith(("error: ", "fault: ") if code else "")


@pytest.mark.parametrize("content", [b"", b"{", b"[" * 100_000, b"null", b'{"schema": NaN}', b"\xff\xfe"])
def test_a_file_that_is_no_json_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "front.json").write_bytes(content)
    refused(run("show", tmp_path), 12, "front.json")


def test_showing_what_is_not_there(tmp_path: Path) -> None:
    refused(run("show", tmp_path), 12, "No such file", "the folder that `hpop plan` wrote")
    refused(run("show", tmp_path / "gone"), 12, "No such file")


def test_a_map_that_changed_since_the_front_was_saved(saved: Path, room: Path) -> None:
    write_map(room, door=1.2)
    refused(run("show", saved), 3, "has changed since this was saved")


# Checking and listing

PLUGIN = """\
from dataclasses import dataclass
import hpop

@hpop.criterion("{name}", group="C", unit="m", aggregate="sum")
@dataclass(frozen=True)
class Mine:
    def cost(self, m):
        return {cost}

@hpop.criterion("{name}-needy", group="C", unit="m", aggregate="sum")
@dataclass(frozen=True)
class Needy:
    much: float
    def cost(self, m):
        return m.base.length

number = 3
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria._types))
    return tmp_path


def test_a_good_criterion_of_this_folder_passes_every_check(here: Path) -> None:
    (here / "good_plugin.py").write_text(PLUGIN.format(name="way", cost="m.base.length"))
    result = run("check", "good_plugin:Mine")
    assert result.exit_code == 0
    assert "FAIL" not in result.stdout
    assert result.stdout.count("ok") > 5


def test_a_criterion_with_negative_costs_fails_by_name(here: Path) -> None:
    (here / "bad_plugin.py").write_text(PLUGIN.format(name="gain", cost="-m.base.length"))
    result = run("check", "bad_plugin:Mine")
    refused(result, 8, "criterion 'gain' fails")
    assert "must cost a finite number >= 0" in result.stdout


@pytest.mark.parametrize(
    ("spec", "code", "said"),
    [
        ("turnz", 7, "Did you mean 'turns'?"),
        ("odd_plugin:Gone", 8, "Gone"),
        ("odd_plugin:number", 8, "declare a class with @hpop.criterion"),
        ("odd_plugin:Needy", 8, "needs defaults"),
        ("no_such_plugin:Mine", 8, "cannot import 'no_such_plugin'"),
        (":Mine", 8, "cannot import"),
        ("broken_plugin:Mine", 8, "SyntaxError"),
        ("raising_plugin:Mine", 8, "ZeroDivisionError"),
        ("odd_plugin:", 8, "MODULE:NAME"),
    ],
)
def test_what_cannot_be_checked_says_why(here: Path, spec: str, code: int, said: str) -> None:
    (here / "odd_plugin.py").write_text(PLUGIN.format(name="odd", cost="m.base.length"))
    (here / "broken_plugin.py").write_text("class :")
    (here / "raising_plugin.py").write_text("1 / 0")
    sys.modules.pop("odd_plugin", None)
    refused(run("check", spec), code, said)


def test_criteria_and_planners_are_listed_with_their_parameters() -> None:
    listed = run("criteria").stdout
    assert all(f"  {name}  " in listed for name in registry.criteria)
    assert "radius=2.0" in listed
    listed = run("planners").stdout
    assert all(f"  {name}  " in listed for name in registry.planners)
    assert "step=0.25" in listed
    assert max(map(len, listed.splitlines())) <= 80


# Real processes


def python(*arguments: str, code: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


HEAVY = {"numpy", "scipy", "numba", "casadi", "cvxpy", "matplotlib", "pydantic", "shapely", "networkx", "rich", "yaml"}
LOADED = "\nimport sys; print('loaded:', *sorted({name.partition('.')[0] for name in sys.modules}))"


def loaded(code: str, *arguments: str) -> set[str]:
    done = python(*arguments, code=code + LOADED)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize("arguments", [["--help"], ["plan", "--help"], ["--version"]])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    code = "from hpop.cli import main\ntry: main()\nexcept SystemExit as end: assert not end.code"
    modules = loaded(code, *arguments)
    assert "hpop" in modules
    assert modules & HEAVY == set()


def test_importing_the_package_is_light() -> None:
    assert loaded("import hpop") & HEAVY == set()
    assert loaded("import hpop; hpop.Problem") & {"casadi", "cvxpy", "numba", "matplotlib", "pydantic"} == set()


def test_the_installed_command_answers(room: Path) -> None:
    command = Path(sys.executable).with_name("hpop")
    if not command.exists():
        pytest.skip("the console script is not installed beside this Python")
    done = subprocess.run(
        [command, "plan", room / "gone.yaml", "--out", room / "out"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (4, "")
    assert done.stderr.startswith("error: ")
    assert subprocess.run([command, "plan"], capture_output=True, check=False).returncode == 2


def until(terminal: int, pattern: bytes, seconds: float) -> bytes:
    """What a terminal shows until some pattern appears."""
    seen, end = b"", time.monotonic() + seconds
    while not re.search(pattern, seen) and time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            seen += os.read(terminal, 65536)
    assert re.search(pattern, seen), seen[-2000:]
    return seen


def test_ctrl_c_keeps_what_a_running_search_has_found(tmp_path: Path) -> None:
    """Six costs in a large room with scattered pillars: a search that would take far longer than this test."""
    pillars = [(x + 0.37 * (y % 3), y) for x in range(2, 28, 3) for y in range(2, 18, 3)]
    boxes = [{"corners": [[x, y], [x + 0.6, y], [x + 0.6, y + 0.7], [x, y + 0.7]]} for x, y in pillars]
    scenario = {
        "world": {"polygons": {"extent": [[0, 0], [30, 0], [30, 20], [0, 20]], "obstacles": boxes}},
        "start": [1.0, 1.0, 0],
        "goal": [29.0, 19.0, "any"],
        "criteria": ["exposure", "turns", "length", "duration", "rotation", "clearance"],
        "planner": {"lattice": {"step": 0.25}},
    }
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(scenario))
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", "from hpop.cli import main; main()", "plan", "room.yaml", "--out", "out"]
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs, env=environment, text=True)
    os.close(theirs)
    try:
        # Only the exact search has millions of labels: first answers take a fraction of a second.
        seen = until(ours, rb"\d,\d{3},\d{3} labels, [\d,]+ open, front [1-9]", 60)
        assert b"search" in seen
        assert b" MB" in seen
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    assert process.returncode == 130
    assert "status: interrupted" in output
    assert "incomplete (interrupted)" in output
    front = Front.load(tmp_path / "out" / "front.json")
    assert len(front) > 0
    assert front.status == "interrupted"
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"front.json", "map.png", "front.png", "trace.png", "where.png"}


def test_a_limit_that_leaves_nothing_found_is_no_success(room: Path, no_pictures: None) -> None:
    text = (room / "room.yaml").read_text()
    assert "lattice: {" in text
    (room / "room.yaml").write_text(text.replace("lattice: {", "lattice: {time_limit: 1.0e-9, "))
    result = plan(room)
    assert result.exit_code == 13
    assert "nothing was found within the planner's limits" in result.stderr
    assert "time limit" in result.stdout
    assert (room / "out/front.json").exists()
