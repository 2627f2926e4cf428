"""`hpop check`, the lists of criteria and planners, and how light the command is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from hpop.base import registry
from hpop.cli import user_code

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
    monkeypatch.setattr(registry.criteria, "_types", dict(registry.criteria))
    return tmp_path


def test_a_good_criterion_of_this_folder_passes_every_check(run: Callable[..., Result], here: Path) -> None:
    (here / "good_plugin.py").write_text(PLUGIN.format(name="way", cost="m.base.length"))
    result = run("check", "good_plugin:Mine")
    assert result.exit_code == 0
    assert run("check", "good_plugin:Mien").stderr.rstrip().endswith("Did you mean 'Mine'?")
    assert "FAIL" not in result.stdout
    assert result.stdout.count("ok") > 5


def test_a_criterion_is_found_in_its_file_by_the_name_that_it_is_registered_by(
    run: Callable[..., Result], here: Path
) -> None:
    (here / "named_plugin.py").write_text(PLUGIN.format(name="stretch", cost="m.base.length"))
    assert run("check", "named_plugin.py:stretch").exit_code == 0
    assert run("check", "stretch").exit_code == 0  # imported by now


def test_a_criterion_at_home_that_its_package_does_not_import_is_told(
    run: Callable[..., Result], refused: Callable[..., None], here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "criteria/comfort").mkdir(parents=True)
    (here / "criteria/comfort/glint.py").touch()
    monkeypatch.setattr(user_code, "HOME", here)
    refused(run("check", "glint"), 7, "glint.py exists, but hpop.criteria does not import it: add its class to")


def test_a_criterion_with_negative_costs_fails_by_name(
    run: Callable[..., Result], refused: Callable[..., None], here: Path
) -> None:
    (here / "bad_plugin.py").write_text(PLUGIN.format(name="gain", cost="-m.base.length"))
    result = run("check", "bad_plugin:Mine")
    refused(result, 8, "criterion 'gain' fails 1 check")
    assert "must cost a finite number >= 0" in result.stdout


@pytest.mark.parametrize(
    ("spec", "code", "said"),
    [
        ("turnz", 7, "Did you mean 'turns'?"),
        ("glare", 7, "for a class of your own, give FILE.py:NAME, or its name with --import FILE.py"),
        ("odd_plugin", 7, "odd_plugin.py is in this folder: give odd_plugin.py:NAME"),
        ("whole", 7, "`hpop criteria`, `hpop models` and `hpop planners` list what there is"),
        ("odd_plugin:Gone", 8, "Gone"),
        ("odd_plugin:number", 8, "declare a class of your own with @hpop.criterion"),
        ("odd_plugin:Needy", 8, "only if all its parameters have defaults"),
        ("serial_arm", 9, "there is none for urdf, tip, acceleration. Create one in a file"),
        ("hpop.models:MobileArm", 9, "there is none for arm."),
        ("no_such_plugin:Mine", 14, "cannot import 'no_such_plugin'"),
        (":Mine", 14, "cannot import"),
        ("broken_plugin:Mine", 14, "SyntaxError"),
        ("raising_plugin:Mine", 14, "ZeroDivisionError"),
        ("odd_plugin:", 8, "MODULE:NAME"),
    ],
)
def test_what_cannot_be_checked_says_why(
    run: Callable[..., Result], refused: Callable[..., None], here: Path, spec: str, code: int, said: str
) -> None:
    (here / "odd_plugin.py").write_text(PLUGIN.format(name="odd", cost="m.base.length"))
    (here / "broken_plugin.py").write_text("class :")
    (here / "raising_plugin.py").write_text("1 / 0")
    sys.modules.pop("odd_plugin", None)
    refused(run("check", spec), code, said)


def test_criteria_and_planners_are_listed_with_their_parameters(run: Callable[..., Result]) -> None:
    listed = run("criteria").stdout
    assert all(f"  {name}  " in listed for name in registry.criteria)
    assert "radius=2.0" in listed
    listed = run("planners").stdout
    assert all(f"  {name}  " in listed for name in registry.planners)
    assert "step=0.25" in listed
    assert max(map(len, listed.splitlines())) <= 80


def test_models_are_listed_with_what_they_provide_and_planners_with_what_they_need(run: Callable[..., Result]) -> None:
    listed = " ".join(run("models").stdout.split())
    assert all(f" {name} " in listed for name in registry.models)
    assert "radius=0.3" in listed
    assert "States (x m, y m, yaw rad). Provides base, camera, heading, plane, rigid, turn-move, wheels." in listed
    assert "Needs plane, rigid, turn-move, wheels." in " ".join(run("planners").stdout.split())


ROBOT = """\
from dataclasses import dataclass, replace
import hpop
from hpop.planners import Lattice, planner

@hpop.model("{name}")
@dataclass(frozen=True)
class Robot(hpop.DifferentialDrive):
    def extent(self, motions):
        farthest, turned = super().extent(motions)
        return {share} * farthest, turned

@planner("{name}-planner")
@dataclass(frozen=True)
class Mine:
    needs = Lattice.needs | {{"rigid"}}
    def solve(self, problem, progress=None):
        found = Lattice(step=0.5).solve(problem, progress)
        return replace(found, planned={share} * found.planned)
"""


@pytest.mark.cases("0.5")
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_robots_and_planners_are_checked_as_criteria_are(
    run: Callable[..., Result], refused: Callable[..., None], here: Path, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    for known in (registry.models, registry.planners):
        monkeypatch.setattr(known, "_types", dict(known))
    name = f"robot_{share:g}".replace(".", "_")
    (here / f"{name}.py").write_text(ROBOT.format(name=name, share=share))
    for cls, error, said in (
        ("Robot", f"model '{name}' fails 1 check", "moves no body farther than its extent: the base moves"),
        (
            "Mine",
            f"planner '{name}-planner' fails",
            "reports costs that a re-evaluation confirms for differential_drive: length of",
        ),
    ):
        done = run("check", f"{name}:{cls}")
        if share == 1.0:
            assert done.exit_code == 0, done.output
            assert {line.split()[0] for line in done.stdout.splitlines()} == {"ok"}
        else:
            refused(done, done.exit_code, error)
            assert f"FAIL  {said}" in done.stdout


SLIP = """\
from dataclasses import dataclass
import hpop

@hpop.model("slip")
@dataclass(frozen=True)
class Slip(hpop.DifferentialDrive):
    @property
    def mounts(self):
        return 1 / 0
"""


def test_a_robot_that_fails_before_it_can_be_checked_is_told_with_file_and_line(
    run: Callable[..., Result], refused: Callable[..., None], here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.models, "_types", dict(registry.models))
    (here / "slip.py").write_text(SLIP)
    refused(run("check", "slip.py:Slip"), 14, "slip.py, line 9): ZeroDivisionError: division by zero")


def test_lists_show_no_markup_of_docstrings(run: Callable[..., Result]) -> None:
    assert "`" not in run("criteria").stdout + run("planners").stdout


def python(*arguments: str, code: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


HEAVY = {
    "numpy",
    "scipy",
    "numba",
    "casadi",
    "cvxpy",
    "highspy",
    "matplotlib",
    "pydantic",
    "shapely",
    "networkx",
    "rich",
    "yaml",
}
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
    assert (
        loaded("import hpop; hpop.Problem, hpop.Front") & {"casadi", "cvxpy", "numba", "matplotlib", "pydantic"}
        == set()
    )


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


def test_python_dash_m_is_the_command_and_runs_nothing_of_the_current_folder(tmp_path: Path) -> None:
    (tmp_path / "click.py").write_text("raise SystemExit('a stranger')")
    command = Path(sys.executable).with_name("hpop")
    done = [
        subprocess.run([*each, "plan", "--help"], cwd=tmp_path, capture_output=True, text=True, check=True)
        for each in ([command], [sys.executable, "-m", "hpop"])
    ]
    assert done[0].stdout == done[1].stdout
    assert done[0].stdout.startswith("Usage: hpop plan [OPTIONS] SCENARIO")


@pytest.mark.parametrize(("epoch", "noted"), [("abc", True), ("", True), ("1700000000", False)])
def test_an_epoch_that_is_no_number_is_left_out_with_a_note(epoch, noted):
    code = "import sys; sys.argv = ['hpop', '--version']; from hpop.entry import main; main()"
    environment = {**os.environ, "SOURCE_DATE_EPOCH": epoch}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert ("SOURCE_DATE_EPOCH must be a whole number of seconds" in done.stderr) == noted
