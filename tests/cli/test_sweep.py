"""``hpop plan --workers`` and ``--dask``: the same front as on one core, and what each planner added to it."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

import hpop.runtime.limits
import hpop.view
from hpop.cli import main
from hpop.cli.beside import PicturesBeside
from hpop.runtime.limits import Progress

SCENARIO = """\
world:
  polygons:
    extent: [[0, 0], [4.9, 0], [4.9, 3.8], [0, 3.8]]
    obstacles:
      - {corners: [[1.2, 0.9], [2.2, 0.9], [2.2, 2.2], [1.2, 2.2]]}
      - {corners: [[3.0, 1.6], [3.6, 1.6], [3.6, 3.0], [3.0, 3.0]]}
model:
  differential_drive: {radius: 0.2}
start: [0.5, 0.5, 0]
goal: [4.0, 3.5, any]
criteria: [exposure, turns, length]
planner:
  - weighted-sum: {step: 0.5}
  - lattice: {step: 0.5}
  - epsilon-constraint: {step: 1.0, max_points: 4}
"""


@pytest.fixture
def scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the scenario of a room with two planners; pictures are tested elsewhere."""
    monkeypatch.setattr(hpop.view, "save_pictures", lambda problem, front, folder, **options: [])
    monkeypatch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)
    (tmp_path / "room.yaml").write_text(SCENARIO)
    return tmp_path / "room.yaml"


def plan(scenario: Path, out: str, *options: str) -> Result:
    result = CliRunner().invoke(main, ["plan", str(scenario), "--out", str(scenario.parent / out), *options])
    assert "Traceback" not in result.output
    return result


def points(scenario: Path, out: str) -> Any:
    """Return the points of a saved front, trajectories included."""
    saved = json.loads((scenario.parent / out / "front.json").read_text())
    return saved["points"] | saved["items"]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Points of the front that one core finds."""
    scenario = tmp_path_factory.mktemp("alone") / "room.yaml"
    scenario.write_text(SCENARIO)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hpop.view, "save_pictures", lambda problem, front, folder, **options: [])
        patch.setattr(PicturesBeside, "_begin", lambda pictures, which: None)
        assert plan(scenario, "out").exit_code == 0
    return points(scenario, "out")


def test_two_workers_find_the_same_front_and_the_report_says_what_each_planner_added(
    scenario: Path, alone: Any
) -> None:
    there = plan(scenario, "two", "--workers", "2")
    assert there.exit_code == 0, there.output
    assert "no planner of the scenario" not in there.output
    assert points(scenario, "two") == alone
    assert alone["count"] > 1
    assert "What each planner added" in there.stdout
    added = there.stdout.split("What each planner added")[1]
    assert "weighted-sum" in added
    assert "lattice" in added
    assert "epsilon-constraint" in added
    planners = {origin["planner"] for origin in points(scenario, "two")["origins"]}
    assert "epsilon-constraint" in planners


@pytest.mark.proof
def test_a_dask_scheduler_may_be_named(scenario: Path, alone: Any) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, host="127.0.0.1", dashboard_address=":0", protocol="tcp"
    ) as cluster:
        there = plan(scenario, "dask", "--dask", cluster.scheduler_address)
    assert there.exit_code == 0, there.output
    assert points(scenario, "dask") == alone


def test_workers_without_a_planner_that_sweeps_are_noted(scenario: Path) -> None:
    scenario.write_text(SCENARIO.replace("weighted-sum: {step: 0.5}", "any-angle: {step: 0.5}").split("  - epsilon")[0])
    assert (
        "no planner of the scenario (any-angle, lattice) can use several"
        in plan(scenario, "out", "--workers", "2").output
    )


@pytest.mark.proof
def test_where_no_workers_can_be_had_one_process_plans_and_says_so(
    scenario: Path, alone: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where /dev/shm cannot be written: no process can share a lock with another one."""

    def refused(*given: Any) -> Any:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("multiprocessing.synchronize._multiprocessing.SemLock", refused)
    there = plan(scenario, "here", "--workers", "2")
    assert there.exit_code == 0, there.output
    assert "note: --workers: cannot start worker processes (Read-only file system)" in there.stderr
    assert points(scenario, "here") == alone


@pytest.mark.parametrize(
    ("stage", "least", "workers"),
    [
        ("weights", 2, ()),
        ("weights", 2, ("--workers", "2")),
        pytest.param("epsilon-constraint", 2, (), marks=pytest.mark.proof),
        pytest.param("epsilon-constraint", 2, ("--workers", "2"), marks=pytest.mark.proof),  # the planner's own tests
    ],
)
def test_ctrl_c_in_a_sweep_keeps_what_is_finished(
    scenario: Path, monkeypatch: pytest.MonkeyPatch, stage: str, least: int, workers: tuple[str, ...]
) -> None:
    """The interrupt comes with the first result after the second; what is saved is a front, and says so."""

    def interrupt(progress: Progress) -> None:
        if progress.stage == stage and progress.front >= least:
            raise KeyboardInterrupt

    monkeypatch.setattr(hpop.runtime.limits, "progress_bar", lambda: nullcontext(interrupt))
    planner = {"weights": "weighted-sum", "epsilon-constraint": "epsilon-constraint"}[stage]
    scenario.write_text(SCENARIO.split("planner:")[0] + f"planner: {{{planner}: {{step: 0.5}}}}\n")
    result = plan(scenario, "out", *workers)
    saved = json.loads((scenario.parent / "out" / "front.json").read_text())
    assert saved["status"] == "interrupted"
    assert "interrupted" in result.stdout
    assert saved["points"]["count"] >= least
    origins = {origin["planner"] for origin in saved["points"]["origins"]}
    assert planner in origins
    assert origins <= {planner, "lattice"}, "a program that is interrupted leaves what it began with, the lattice's"


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--workers", "0"), 2, "1<=x"),
        (("--workers", "two"), 2, "integer"),
        (("--workers", "2", "--dask", "tcp://127.0.0.1:9"), 2, "not both"),
        (("--dask", "nonsense://"), 10, "no Dask scheduler answers at 'nonsense://'"),
    ],
)
def test_what_makes_no_sense_is_refused(scenario: Path, options: tuple[str, ...], code: int, said: str) -> None:
    if "nonsense://" in options:
        pytest.importorskip("distributed")
    result = plan(scenario, "out", *options)
    assert (result.exit_code, said in result.stderr) == (code, True), result.stderr
    assert not (scenario.parent / "out").exists()
