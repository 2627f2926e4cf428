"""Batches give the fronts that each problem gives alone; failures, kills and deaths of workers lose nothing else."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
import shapely

import hpop
from hpop.batches import Results, batch
from hpop.batches.results import JOURNAL
from hpop.batches.running import DIED
from hpop.errors import OptionError, OutputError, ScenarioError
from hpop.runtime.sweep import dask, ray
from hpop.trajectories.trajectory import Trajectory
from tests.batches.deadly import DeadlyLength

WORLD = hpop.World.from_polygons([shapely.box(3, 0, 4, 3)], extent=shapely.box(0, 0, 8, 6))
ROBOT = hpop.DifferentialDrive(radius=0.3)
LATTICE = {"lattice": {"step": 1.0}}
FINE = {"lattice": {"step": 0.25}}  # so that cases end one after the other


def problems(goals=((7, 1, None), (7, 5, None), (1, 5, None))):
    return [hpop.Problem(WORLD, ROBOT, (1, 1, 0), goal, ["turns", "length"]) for goal in goals]


def costs_of(results):
    """Rows of costs by case."""
    table = results.table(["case", "cost_turns", "cost_length"]).to_pydict()
    found = {}
    for case, turns, length in zip(*table.values(), strict=True):
        found.setdefault(case, []).append([turns, length])
    return {case: np.array(rows) for case, rows in found.items()}


@pytest.mark.proof
@pytest.mark.parametrize("workers", [None, 2])
def test_rows_are_the_fronts_that_each_problem_has_alone(tmp_path, workers):
    asked = problems()
    results = batch(asked, LATTICE, out=tmp_path, workers=workers)
    found = costs_of(results)
    for case, problem in enumerate(asked):
        np.testing.assert_array_equal(found[case], problem.solve(LATTICE).costs)
    rows = results.table().to_pylist()
    front = asked[0].solve(LATTICE)
    first = Trajectory.from_description(ROBOT, json.loads(rows[0]["trajectory"]))
    assert first.states.x.tolist() == front.trajectories[0].states.x.tolist()
    assert rows[0]["status"] == "complete"
    assert rows[0]["certificate"] == front.certificate
    assert rows[0]["points"] == len(front)
    assert rows[0]["labels"] > 0
    assert rows[0]["memory"] > 1e6
    assert "hpop 0" in rows[0]["versions"]


def test_each_planner_solves_each_problem_by_itself(tmp_path):
    planners = {"coarse": LATTICE, "drawn": {"roadmap": {"samples": 60, "seed": 3}}}
    rows = batch(problems()[:2], planners, out=tmp_path).table().to_pylist()
    assert {(row["case"], row["planner"], row["seed"]) for row in rows} == {
        (0, "coarse", None),
        (1, "drawn", 3),
        (2, "coarse", None),
        (3, "drawn", 3),
    }
    assert len({row["problem"] for row in rows}) == 2


def test_a_case_that_fails_is_a_row_with_its_error_and_solved_again_on_request(tmp_path):
    within = hpop.Problem(WORLD, ROBOT, (1, 1, 0), (3.5, 1, None), ["turns", "length"])
    enclosed = hpop.World.from_polygons([shapely.box(3, 0, 4, 6)], extent=shapely.box(0, 0, 8, 6))
    apart = hpop.Problem(enclosed, ROBOT, (1, 1, 0), (7, 1, None), ["turns", "length"])
    results = batch([within, *problems()[:1], apart], LATTICE, out=tmp_path)
    failed, *found, none = results.table().to_pylist()
    assert (failed["status"], failed["row"]) == ("error", None)
    assert failed["error"].startswith("QueryError: the goal (3.500, 1.000)")
    assert all(row["error"] is None and row["row"] is not None for row in found)
    assert (none["status"], none["row"], none["error"], none["points"]) == ("no path", None, None, 0)


def test_a_batch_that_is_there_already_is_not_solved_again(tmp_path):
    batch(problems()[:2], LATTICE, out=tmp_path)
    seen = []
    batch(problems(), LATTICE, out=tmp_path, progress=seen.append)
    assert [(p.done, p.count) for p in seen] == [(2, 3), (3, 3)]
    assert sorted(costs_of(Results(tmp_path))) == [0, 1, 2]


def test_a_problem_that_is_given_twice_is_solved_once(tmp_path):
    assert len(costs_of(batch([*problems(), *problems()], LATTICE, out=tmp_path))) == 3


def test_wrong_workers_are_told(tmp_path):
    with ThreadPoolExecutor() as executor, pytest.raises(OptionError, match="workers or an executor"):
        batch(problems(), LATTICE, out=tmp_path, workers=2, executor=executor)
    with pytest.raises(OptionError, match="workers"):
        batch(problems(), LATTICE, out=tmp_path, workers=0)
    with pytest.raises(ScenarioError):
        batch(tmp_path / "none.yaml", out=tmp_path)


def test_a_worker_that_dies_costs_its_case_alone(tmp_path):
    """Its goal is where no path leads that does not kill the worker; the others never come there."""
    low = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 4))
    here = [hpop.Problem(low, ROBOT, (1, 1, 0), (x, 1, None), [DeadlyLength()]) for x in (3, 4, 5)]
    there = hpop.Problem(WORLD, ROBOT, (1, 1, 0), (7, 1, None), [DeadlyLength()])
    rows = batch([*here, there], LATTICE, out=tmp_path, workers=2).table(["case", "error", "row"]).to_pylist()
    assert rows == [
        *({"case": case, "error": None, "row": 0} for case in range(3)),
        {"case": 3, "error": DIED, "row": None},
    ]


SPECIFICATION = """\
world: {polygons: {extent: [[0, 0], [8, 0], [8, 6], [0, 6]], obstacles: [{corners: [[3, 0], [4, 0], [4, 3], [3, 3]]}]}}
model: {differential_drive: {radius: 0.3}}
start: [1, 1, 0]
criteria: [turns, length]
planner: {lattice: {step: 1.0}}
vary: {goal.x: [5, 6, 7], goal.y: [1, 2, 3, 4, 5], goal.yaw: [any], planner.lattice.step: [1.0, 0.5]}
"""


def kept(folder):
    """Return the identifiers of the cases with rows on the disk, each once."""
    found = [row["id"] for row in Results(folder).table(["id", "row"]).to_pylist() if row["row"] in (0, None)]
    assert len(set(found)) == len(found)
    return set(found)


@pytest.mark.parametrize(
    ("lines", "workers"),
    [(2, 2), *(pytest.param(n, w, marks=pytest.mark.proof) for n in range(1, 10, 2) for w in (1, 2))],
)
def test_a_batch_that_is_killed_loses_no_finished_row(tmp_path, lines, workers):
    specification, out = tmp_path / "batch.yaml", tmp_path / "out"
    specification.write_text(SPECIFICATION)
    command = [sys.executable, "-P", "-m", "hpop", "batch", str(specification), "--out", str(out)]
    with subprocess.Popen([*command, "--workers", str(workers)], stdout=subprocess.DEVNULL) as killed:
        while not (out / JOURNAL).exists() or (out / JOURNAL).read_bytes().count(b"\n") < lines:
            assert killed.poll() is None
            time.sleep(0.005)
        killed.kill()
    before = kept(out)
    assert len(before) >= lines
    done = batch(specification, out=out)
    assert before < kept(out)
    assert len(kept(out)) == 30
    whole = batch(specification, out=tmp_path / "whole")
    assert done.table(["id", "cost_length"]).to_pylist() == whole.table(["id", "cost_length"]).to_pylist()


@pytest.mark.proof
def test_dask_workers_solve_the_same_and_one_that_is_killed_loses_nothing(tmp_path):
    distributed = pytest.importorskip("distributed")
    asked = problems([(x, y, None) for x in (5, 6, 7) for y in (1, 2, 3, 4, 5)])
    here = costs_of(batch(asked, LATTICE, out=tmp_path / "here"))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0", protocol="tcp"
    ) as local:

        def kill(progress):
            if progress.done == 4:
                with local.get_client() as client:
                    os.kill(min(client.run(os.getpid).values()), signal.SIGKILL)

        with dask(local.scheduler_address) as executor:
            there = costs_of(batch(asked, LATTICE, out=tmp_path / "there", executor=executor, progress=kill))
    assert {case: rows.tolist() for case, rows in there.items()} == {case: rows.tolist() for case, rows in here.items()}


@pytest.mark.proof
def test_ray_workers_solve_the_same(tmp_path):
    pytest.importorskip("ray")
    asked = problems([(x, y, None) for x in (5, 6, 7) for y in (1, 5)])
    here = costs_of(batch(asked, LATTICE, out=tmp_path / "here"))
    with ray("local") as executor:
        there = costs_of(batch(asked, LATTICE, out=tmp_path / "there", executor=executor))
    assert {case: rows.tolist() for case, rows in there.items()} == {case: rows.tolist() for case, rows in here.items()}


@contextmanager
def cluster(port):
    """Run a Dask scheduler and a worker as processes of their own; kill both at the end."""
    with ExitStack() as stack:
        for role in (
            ["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
            ["worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--no-dashboard", "--no-nanny"],
        ):
            command = [sys.executable, "-m", "distributed.cli.dask_" + role[0], *role[1:]]
            process = stack.enter_context(subprocess.Popen(command, stderr=subprocess.DEVNULL))
            stack.callback(process.kill)
            if role[0] == "scheduler":
                scheduler = process
        yield scheduler


@pytest.mark.proof
def test_a_batch_goes_on_after_its_scheduler_was_killed_and_started_again(tmp_path):
    pytest.importorskip("distributed")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    asked = problems([(x, y, None) for x in (5, 6, 7) for y in (1, 2, 3, 4, 5)])
    here = costs_of(batch(asked, FINE, out=tmp_path / "here"))
    with cluster(port) as scheduler:

        def kill(progress):
            if progress.done == 2:
                scheduler.kill()

        with (
            pytest.raises(OutputError, match="running the batch again continues from there"),
            dask(f"tcp://127.0.0.1:{port}") as executor,
        ):
            batch(asked, FINE, out=tmp_path / "there", executor=executor, progress=kill)
    before = costs_of(Results(tmp_path / "there"))
    assert 2 <= len(before) < 15
    seen = []
    with cluster(port), dask(f"tcp://127.0.0.1:{port}") as executor:
        done = batch(asked, FINE, out=tmp_path / "there", executor=executor, progress=seen.append)
    assert seen[0].done == len(before)
    assert {case: rows.tolist() for case, rows in costs_of(done).items()} == {
        case: rows.tolist() for case, rows in here.items()
    }


@pytest.mark.proof
def test_a_ray_cluster_of_two_nodes_solves_the_same_also_if_one_node_is_lost(tmp_path):
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    asked = problems([(x, y, None) for x in (5, 6, 7) for y in (1, 2, 3, 4, 5)])
    here = costs_of(batch(asked, LATTICE, out=tmp_path / "here"))
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    second = nodes.add_node(num_cpus=1)

    def lose(progress):
        if progress.done == 4:
            nodes.remove_node(second, allow_graceful=False)

    try:
        with ray(nodes.address) as executor:
            there = costs_of(batch(asked, LATTICE, out=tmp_path / "there", executor=executor, progress=lose))
    finally:
        nodes.shutdown()
    assert {case: rows.tolist() for case, rows in there.items()} == {case: rows.tolist() for case, rows in here.items()}
