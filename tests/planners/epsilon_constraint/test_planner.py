"""The epsilon-constraint planner against a known front, the lattice that warm-starts it, and wrong questions."""

import dataclasses
import json
import math
import os
import re
import signal
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Clearance, Exposure, Length
from hpop.criteria.costs import trajectory_costs
from hpop.frontier import hypervolume
from hpop.models import DifferentialDrive
from hpop.planners import EpsilonConstraint, Lattice
from hpop.planners.programs.epsilon_constraint.program import PolylineProgram
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.runtime.sweep import processes
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
PAPER = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, 0), ["exposure", "turns", "length"])
HALF, DISC = 4.0, 1.0  # m
MUSEUM = Path(__file__).parents[3] / "examples" / "museum.geojson"


@pytest.fixture(scope="module", params=[1.0, pytest.param(0.5, marks=pytest.mark.proof)])
def paper(request):
    """Return the candidates of the paper's three costs round one block, and the lattice's front."""
    return EpsilonConstraint(step=request.param).solve(PAPER), PAPER.solve("lattice", step=request.param)


def covered(points, by):
    """Check that each cost vector is matched by one that is no worse in any cost, within a thousandth."""
    return np.array([(by <= row + 1e-3 * np.maximum(row, 1e-3)).all(axis=1).any() for row in points])


# What it finds


@pytest.mark.proof
def test_length_against_clearance_round_a_disc_is_the_analytic_front():
    """Shortest polylines of n segments at distance R: two tangents, and 2 R tan(angle / 2) round each vertex."""
    world = World.from_polygons([shapely.Point(0, 0).buffer(DISC, quad_segs=64)], extent=shapely.box(-8, -8, 8, 8))
    problem = Problem(world, ROBOT, (-HALF, 0, 0), (HALF, 0, None), [Length(), Clearance(enough=2.5), "turns"])
    front = problem.solve("epsilon-constraint", step=0.5, rounds=4)
    assert front.runs[0]["failed"] == {}
    assert front.costs[:, 1].min() <= 1e-3
    with_first_turn = 0
    for (length, shortfall, turns), trajectory in zip(front.costs, front.trajectories, strict=True):
        radius, segments = DISC + 2.5 - shortfall, trajectory.kinds.count("move")
        between = (math.pi - 2 * math.acos(radius / HALF)) / (segments - 1)
        least = 2 * math.sqrt(HALF**2 - radius**2) + (segments - 1) * 2 * radius * math.tan(between / 2)
        assert turns <= segments
        assert length >= least * (1 - 1e-3)
        if trajectory.kinds[0] == "turn" and shortfall > 0.01:  # else the first heading is not free, and the way longer
            assert length <= least * 1.015
            with_first_turn += 1
    assert with_first_turn >= 5


def test_no_lattice_point_is_better_although_none_is_among_the_candidates(paper):
    candidates, lattice = paper
    front = PAPER.front(candidates)
    assert covered(lattice.costs, front.costs).all()
    slack = 1e-3 * np.maximum(lattice.costs, 1e-3)
    pairs = zip(lattice.costs, slack, strict=True)
    better = [((front.costs <= y + s).all(axis=1) & (front.costs < y - s).any(axis=1)).any() for y, s in pairs]
    assert np.mean(better) > 0.5
    assert all(p["planner"] == "epsilon-constraint" for p in candidates.provenance)


OBLONG = DifferentialDrive(footprint=((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)), camera_offset=(0.1, 0.05))
STEPS = pytest.mark.parametrize("step", [1.0, pytest.param(0.5, marks=pytest.mark.proof)])  # m


@pytest.mark.proof
@pytest.mark.parametrize("most", [3, None])
@pytest.mark.parametrize("robot", [ROBOT, OBLONG])
@STEPS
def test_candidates_are_what_they_claim(robot, most, step):
    problem = Problem(OPEN, robot, (1, 2, 0), (5, 2, 0), ["exposure", "turns", "length", "rotation"])
    candidates = EpsilonConstraint(step=step, max_points=most).solve(problem)
    assert candidates.trajectories
    front = problem.front(candidates)
    assert verify(problem, front) == []
    assert "NOT VALID" not in front.certificate
    assert "local optima" in front.certificate
    json.dumps(candidates.provenance)
    names = [c.name for c in candidates.objectives]
    costs = trajectory_costs(candidates.objectives, candidates.trajectories, OPEN)
    for row, provenance in zip(costs, candidates.provenance, strict=True):
        assert provenance["left"] <= 1e-3
        for name, bound in provenance["epsilon"].items():
            assert row[names.index(name)] <= bound * (1 + 1e-3) + 1e-6


def test_the_union_is_never_worse_than_the_lattice(paper):
    candidates, lattice = paper
    joined = lattice | PAPER.front(candidates)
    reference = lattice.costs.max(axis=0) * 1.01
    assert hypervolume(joined.costs, reference) > hypervolume(lattice.costs, reference)
    for row in lattice.integers:
        assert (joined.integers <= row).all(axis=1).any()


@pytest.mark.proof
def test_the_museum_without_lattice_points():
    world = World.from_geojson(MUSEUM)
    problem = Problem(world, DifferentialDrive(radius=0.3), (2, 10, 0), (28, 10, 0), ["exposure", "turns", "length"])
    lattice = problem.solve("lattice", step=1.0)
    front = problem.solve("epsilon-constraint", step=1.0)
    assert covered(lattice.costs, front.costs).all()
    assert verify(problem, front) == []


@pytest.mark.proof
@pytest.mark.parametrize("step", [1.0, 0.5])
def test_divisions_find_trade_offs_between_the_known_ones(step):
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, None), ["exposure", "length"])
    coarse, fine = (problem.solve("epsilon-constraint", step=step, divisions=d) for d in (0, 2))
    assert len(fine) > len(coarse)
    assert covered(coarse.costs, fine.costs).all()
    assert any(p["level"] > 0 for p in fine.provenance)


@STEPS
def test_a_goal_off_the_grid_is_reached_exactly(step):
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (4.87, 2.13, 0), ["exposure", "turns", "length"])
    candidates = EpsilonConstraint(step=step, max_points=2).solve(problem)
    assert candidates.trajectories
    for trajectory in candidates.trajectories:
        s = trajectory.states
        assert (s.x[-1], s.y[-1]) == pytest.approx((4.87, 2.13), abs=1e-12)
        assert math.remainder(s.yaw[-1], 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@STEPS
def test_a_time_mean_is_reported_and_its_integral_minimised(step):
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, None), ["obstruction", "length"])
    front = problem.solve("epsilon-constraint", step=step, minimise="exposure", max_points=1)
    assert front.names == ("exposure", "length")
    assert front.reported_names == ("obstruction",)
    assert {p["minimise"] for p in front.provenance} == {"exposure"}


def test_start_is_goal():
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (1, 2, math.pi / 2), ["turns", "length"])
    front = problem.solve("epsilon-constraint", step=1.0)
    assert front.costs.tolist() == [[1.0, 0.0]]


@pytest.mark.proof
@pytest.mark.parametrize("most", [3, None])
@STEPS
def test_every_bound_on_a_worst_moment_has_a_candidate(step, most):
    """A sampled clearance is off by 3 cm where the path between block and border is as clear as possible."""
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, None), ["clearance", "length"])
    candidates = EpsilonConstraint(step=step, max_points=most).solve(problem)
    assert candidates.stats["failed"] == {}
    assert candidates.stats["dropped"] == {}
    assert len(candidates.trajectories) == candidates.stats["tried"]
    front = problem.front(candidates)
    assert verify(problem, front) == []
    assert all(provenance["left"] <= 1e-3 for provenance in candidates.provenance)


@hpop.criterion("low_sun", group="C", unit="s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class LowSun:
    """Time spent looking into the sun: what a turn costs changes much within it."""

    azimuth: float = 1.0

    def cost(self, m):
        return m.integrate(lambda s: np.maximum(np.cos(s.camera.yaw - self.azimuth), 0.0) ** 4)


@pytest.mark.parametrize(
    ("step", "most"),
    [(1.0, 1), *(pytest.param(step, None, marks=pytest.mark.proof) for step in (1.0, 0.5))],
)
def test_costs_that_change_much_within_a_turn_are_planned_as_they_are(step, most):
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, 0), [LowSun(), "turns", "length"])
    candidates = EpsilonConstraint(step=step, max_points=most).solve(problem)
    assert candidates.trajectories
    assert candidates.stats["dropped"] == {}
    assert verify(problem, problem.front(candidates)) == []


# Budgets


def test_the_cap_on_points_is_said_when_it_binds(paper):
    candidates = EpsilonConstraint(step=1.0, max_points=2).solve(PAPER)
    assert candidates.status is Status.POINT_LIMIT
    assert candidates.stats["tried"] == 2
    assert any(note.startswith("max_points") for note in candidates.notes)
    assert paper[0].status is Status.COMPLETE
    assert not any(note.startswith("max_points") for note in paper[0].notes)


class Stop:
    """A progress callback that does something, once, when so many candidates are found."""

    def __init__(self, found, act):
        self.found, self.act, self.seen, self.done = found, act, [], False

    def __call__(self, progress):
        if progress.stage == "epsilon-constraint":
            self.seen.append(progress)
            if progress.front == self.found and not self.done:
                self.done = True
                self.act()


def ctrl_c():
    raise KeyboardInterrupt


def test_ctrl_c_keeps_what_is_finished():
    stop = Stop(2, ctrl_c)
    candidates = EpsilonConstraint(step=1.0).solve(PAPER, stop)
    assert candidates.status is Status.INTERRUPTED
    assert [origin["planner"] for origin in candidates.provenance].count("epsilon-constraint") == 2
    assert [p.labels for p in stop.seen] == list(range(len(stop.seen)))


def test_ctrl_c_while_the_solver_runs_is_obeyed(monkeypatch):
    """CasADi by itself takes it for a failed evaluation, and goes on."""
    solve, calls = PolylineProgram.solve, []

    def interrupted(program, *arguments, **options):
        calls.append(program)
        if len(calls) == 3:
            threading.Timer(0.005, os.kill, (os.getpid(), signal.SIGINT)).start()
        return solve(program, *arguments, **options)

    monkeypatch.setattr(PolylineProgram, "solve", interrupted)
    candidates = EpsilonConstraint(step=1.0).solve(PAPER)
    assert candidates.status is Status.INTERRUPTED
    found = [origin["planner"] for origin in candidates.provenance].count("epsilon-constraint")
    assert 0 < found < candidates.stats["warm_starts"]
    returned, left = candidates.notes
    assert re.fullmatch(
        r"interrupted: [0-9]+ warm starts that were not improved by then .* returned unchanged", returned
    )
    assert re.fullmatch(r"interrupted: [0-9]+ bounds were not tried", left)


def test_ctrl_c_in_the_warm_starts_keeps_their_front(monkeypatch):
    first = Lattice(step=1.0).solve(PAPER)
    stopped = dataclasses.replace(first, status=Status.INTERRUPTED)
    monkeypatch.setattr(Lattice, "stages", lambda planner, problem, progress=None: iter([stopped]))
    candidates = EpsilonConstraint(step=1.0).solve(PAPER)
    assert candidates.status is Status.INTERRUPTED
    assert candidates.trajectories == first.trajectories
    known = f"{len(first.trajectories)} warm starts"
    note = f"interrupted: the result has the warm starts found by then ({known}), none of them improved"
    assert note in candidates.notes
    lengths = first.planned[:, 2]
    bound = float(np.median(lengths))
    bounded = EpsilonConstraint(step=1.0, epsilon={"length": bound}).solve(PAPER)
    assert len(bounded.trajectories) == np.count_nonzero(lengths <= bound * 1.001) < len(lengths)


def test_warm_starts_that_are_not_all_are_said(monkeypatch):
    first = Lattice(step=1.0).solve(PAPER)
    two = {name: getattr(first, name)[:2] for name in ("trajectories", "planned", "tolerance", "provenance")}
    stopped = dataclasses.replace(first, status=Status.LABEL_LIMIT, **two)
    monkeypatch.setattr(Lattice, "stages", lambda planner, problem, progress=None: iter([stopped]))
    candidates = EpsilonConstraint(step=1.0).solve(PAPER)
    assert candidates.status is Status.LABEL_LIMIT
    assert "the warm starts are incomplete: label limit" in candidates.notes


def test_time_that_runs_out_is_said(monkeypatch):
    clock = iter(range(100_000))
    monkeypatch.setattr("hpop.runtime.limits.time.perf_counter", lambda: float(next(clock)))
    candidates = EpsilonConstraint(step=1.0, time_limit=15.0).solve(PAPER)
    assert candidates.status is Status.TIME_LIMIT
    assert any(note.startswith("time limit") for note in candidates.notes)


# Workers


@pytest.mark.proof
def test_two_workers_find_the_same_and_whatever_happens_nothing_finished_is_lost():
    options = {"step": 0.5, "max_points": 5}  # work enough that a worker is killed at work
    serial = EpsilonConstraint(**options).solve(PAPER)
    with processes(2) as pool:
        there = EpsilonConstraint(**options).solve(PAPER, executor=pool)
        assert there.planned.tolist() == serial.planned.tolist()
        assert there.provenance == serial.provenance
        assert there.notes == serial.notes

        stop = Stop(3, ctrl_c)
        stopped = EpsilonConstraint(**options).solve(PAPER, stop, executor=pool)
        assert stopped.status is Status.INTERRUPTED
        assert sum(p in serial.provenance for p in stopped.provenance) == 3

        killed = Stop(2, lambda: os.kill(next(iter(pool._processes)), signal.SIGKILL))
        survived = EpsilonConstraint(**options).solve(PAPER, killed, executor=pool)
    assert killed.done
    assert survived.status is serial.status
    assert survived.provenance == serial.provenance
    assert any("BrokenProcessPool" in note for note in survived.notes)


# What goes wrong


@pytest.mark.proof
def test_programs_that_are_not_kept_are_built_again_and_find_the_same(monkeypatch):
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, None), ["exposure", "length"])
    kept = EpsilonConstraint(step=1.0, divisions=1, max_points=4).solve(problem)
    monkeypatch.setattr("hpop.planners.programs.epsilon_constraint.job.CACHED", 1)
    again = EpsilonConstraint(step=1.0, divisions=1, max_points=4).solve(problem)
    np.testing.assert_array_equal(again.planned, kept.planned)
    assert again.stats["programs"] > kept.stats["programs"]


def test_a_warm_start_that_does_not_converge_is_tried_again_displaced(monkeypatch):
    solve, calls = PolylineProgram.solve, []

    def stubborn(program, warm, epsilon, **options):
        calls.append(warm)
        solution = solve(program, warm, epsilon, **options)
        first = len(calls) == 1 and program.freedom
        return (
            dataclasses.replace(solution, converged=False, status="Maximum_Iterations_Exceeded") if first else solution
        )

    monkeypatch.setattr(PolylineProgram, "solve", stubborn)
    problem = Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, None), [Exposure(), "length"])
    candidates = EpsilonConstraint(step=1.0, max_points=1, rounds=1).solve(problem)
    assert candidates.stats["perturbed"] == 1
    assert candidates.stats["saved by perturbation"] == 1
    assert candidates.provenance[0]["perturbed"]
    moved = np.abs(calls[1].vertices - calls[0].vertices)
    assert moved[[0, -1]].max() == 0
    assert 0 < moved.max() < 0.5


def test_what_never_converges_is_counted_and_the_corners_move_without_it(monkeypatch):
    solve = PolylineProgram.solve

    def never(program, warm, epsilon, **options):
        return dataclasses.replace(
            solve(program, warm, epsilon, **options), converged=False, status="Restoration_Failed"
        )

    monkeypatch.setattr(PolylineProgram, "solve", never)
    candidates = EpsilonConstraint(step=1.0, max_points=2).solve(PAPER)
    assert [origin["status"] for origin in candidates.provenance] == ["not converged (Restoration_Failed)"] * 2
    assert candidates.stats["without a program"] == 2  # their corners went on from the warm start


def test_solutions_that_collide_are_dropped_and_the_corners_move_without_them(monkeypatch):
    """A solver that goes straight through the block, and cannot be talked out of it."""
    solve = PolylineProgram.solve

    def through(program, warm, epsilon, **options):
        solution = solve(program, warm, epsilon, **options)
        vertices = solution.polyline.vertices.copy()
        vertices[1:-1, 1] = 2.0
        return dataclasses.replace(solution, polyline=dataclasses.replace(solution.polyline, vertices=vertices))

    monkeypatch.setattr(PolylineProgram, "solve", through)
    candidates = EpsilonConstraint(step=1.0, max_points=1).solve(PAPER)
    assert ["collides" in origin["status"] for origin in candidates.provenance] == [True]
    assert verify(PAPER, PAPER.front(candidates)) == []
