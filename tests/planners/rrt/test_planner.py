"""The RRT planner: its trajectories against the exact geometry and the wheels' limits, its selection recomputed."""

from __future__ import annotations

import json
import math
import sys
from itertools import count

import numpy as np
import pytest
import shapely

from hpop.errors import OptionError, QueryError
from hpop.models import DifferentialDrive
from hpop.planners import RRT, Lattice
from hpop.planners.judgement import judge
from hpop.planners.rrt import TreeRun
from hpop.planners.rrt_query import Base, TreeQuery, WheelLimits, close_gap
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.runtime.sweep import processes
from hpop.world import World
from hpop.world.content.content import Person

ROBOT = DifferentialDrive(radius=0.25)
ROOM = World.from_polygons([shapely.box(2.6, 0.0, 3.0, 2.4)], extent=shapely.box(0, 0, 6, 5))
PROBLEM = Problem(ROOM, ROBOT, (1, 1, 0), (5, 1, 0), ["exposure", "turns", "length"])
RUNS = 4
SEVERAL = RRT(runs=RUNS, seed=3, keep="all")


@pytest.fixture(scope="module")
def several():
    """All runs round a wall."""
    return SEVERAL.solve(PROBLEM)


def wiggles(trajectory, spacing=0.25, least=0.05):
    """Curvature sign changes from samples alone, without turns in place: the heading is that of the path's pieces.

    The samples are so dense that the cuts of the path into even pieces are found to a fraction of a millimetre.
    """
    times = np.linspace(0.0, trajectory.duration, 20_001)
    states = trajectory.at(times)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(states.x), np.diff(states.y)))])
    count = math.ceil(way[-1] / spacing)
    ends = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1)).clip(0, times.size - 1)
    curvature = np.diff(states.yaw[ends]) / (way[-1] / count)
    signs = np.sign(curvature[np.abs(curvature) >= least])
    return int((np.diff(signs) != 0).sum())


# What it finds


@pytest.mark.proof
def test_most_runs_reach_the_goal(several):
    assert several.status is Status.COMPLETE
    assert len(several.trajectories) >= 3
    assert several.stats["runs"] == RUNS
    assert several.stats["reached"] + sum(several.stats["failed"].values()) == RUNS


def test_trajectories_are_free_on_the_exact_geometry_and_end_where_they_should(several):
    assert judge(PROBLEM, several.objectives, several.trajectories).rejection_counts == {}
    front = PROBLEM.front(several)
    assert verify(PROBLEM, front) == []
    assert "NOT VALID" not in front.certificate
    for trajectory in several.trajectories:
        s = trajectory.states
        assert (s.x[0], s.y[0], s.yaw[0]) == (1, 1, 0)
        assert (s.x[-1], s.y[-1]) == pytest.approx((5, 1), abs=1e-8)
        assert math.remainder(s.yaw[-1], 2 * math.pi) == pytest.approx(0, abs=1e-8)


def test_samples_keep_the_radius_from_the_wall(several):
    """Distances by shapely, at moments that the planner knows nothing of."""
    blocked = shapely.union(ROOM.extent.boundary, shapely.box(2.6, 0.0, 3.0, 2.4))
    for trajectory in several.trajectories:
        states = trajectory.at(np.linspace(0.0, trajectory.duration, 2003))
        distance = shapely.distance(blocked, shapely.points(states.x, states.y))
        assert distance.min() >= 0.25 - 1e-9


def test_wheels_and_base_keep_their_limits_from_rest_to_rest(several):
    limits = WheelLimits.of(ROBOT)
    for trajectory in several.trajectories:
        times = np.linspace(0.0, trajectory.duration, 5001)
        wheels, (velocity, acceleration) = ROBOT.wheels(trajectory, times), trajectory.rates(times)
        for change in (wheels.left_acceleration, wheels.right_acceleration):
            assert np.abs(change).max() <= limits.wheel_acceleration + 1e-6
        for speed in (wheels.left_speed, wheels.right_speed):
            assert np.abs(speed).max() <= limits.wheel_speed + 1e-6
            assert speed[[0, -1]] == pytest.approx([0, 0], abs=1e-6)
        forward = 0.5 * (wheels.left_speed + wheels.right_speed)
        assert forward.min() >= -1e-6
        assert forward.max() <= ROBOT.speed + 1e-6
        assert np.abs(velocity.yaw).max() <= ROBOT.turn_rate + 1e-6
        assert np.abs(acceleration.yaw).max() <= ROBOT.turn_acceleration + 1e-6
        along = 0.5 * (wheels.left_acceleration + wheels.right_acceleration)
        assert np.abs(along).max() <= ROBOT.acceleration + 1e-6


@pytest.mark.parametrize("wheel_base", [0.2, 0.4, 1.0])
def test_wheel_limits_allow_what_the_model_allows_and_no_more(wheel_base):
    model = DifferentialDrive(wheel_base=wheel_base)
    limits = WheelLimits.of(model)
    assert limits.wheel_acceleration <= model.acceleration
    assert 2 * limits.wheel_acceleration / wheel_base <= model.turn_acceleration + 1e-12
    assert limits.wheel_speed >= max(model.speed, model.turn_rate * wheel_base / 2)


def test_the_selected_one_has_the_fewest_sign_changes_and_of_those_is_shortest(several):
    selected = RRT(runs=RUNS, seed=3).solve(PROBLEM)
    assert len(selected.trajectories) == 1
    counts = [wiggles(trajectory) for trajectory in several.trajectories]
    assert counts == [p["curvature_sign_changes"] for p in several.provenance]
    assert max(counts) > min(counts)
    lengths = several.planned[:, [c.name for c in several.objectives].index("length")]
    best = min(range(len(counts)), key=lambda i: (counts[i], lengths[i]))
    assert selected.provenance[0] == several.provenance[best]
    assert selected.trajectories[0].states.x.tolist() == several.trajectories[best].states.x.tolist()
    assert selected.stats["curvature_sign_changes"] == counts


@pytest.mark.proof
def test_ties_are_broken_by_length(several):
    """With the problem's own idea of a curve nothing is one, and all trajectories have none."""
    problem = Problem(ROOM, ROBOT, PROBLEM.start, PROBLEM.goal, [{"curvature_sign_changes": {"least": 1e6}}, "length"])
    selected = RRT(runs=RUNS, seed=3).solve(problem)
    assert selected.provenance[0]["curvature_sign_changes"] == 0
    lengths = several.planned[:, [c.name for c in several.objectives].index("length")]
    assert selected.planned[0].tolist() == [lengths.min()]
    assert [c.name for c in selected.filters] == ["curvature_sign_changes"]


@pytest.mark.proof
def test_the_front_joins_the_lattices_and_never_gets_worse():
    lattice, joined = PROBLEM.fronts([Lattice(step=0.5), SEVERAL])
    assert joined.names == lattice.names
    assert "rrt: a baseline" in joined.certificate
    for row in lattice.integers:
        assert (joined.integers <= row).all(axis=1).any()


def test_a_saved_front_is_the_same_when_loaded(several, tmp_path):
    front = PROBLEM.front(several)
    front.save(tmp_path / "front.json")
    loaded = Front.load(tmp_path / "front.json")
    assert loaded.costs.tolist() == front.costs.tolist()
    assert verify(PROBLEM, loaded) == []


def test_a_free_heading_at_the_goal():
    problem = Problem(ROOM, ROBOT, (1, 1, 0), (5, 1, None), ["length"])
    front = problem.solve("rrt", runs=2, seed=1)
    assert len(front) == 1
    assert verify(problem, front) == []


def test_start_is_goal():
    problem = Problem(ROOM, ROBOT, (1, 1, 0), (1, 1, None), ["turns", "length"])
    front = problem.solve("rrt", runs=2)
    assert front.costs.tolist() == [[0.0, 0.0]]


def test_every_provenance_is_json_and_tells_the_run(several):
    assert json.loads(json.dumps(several.provenance)) == list(several.provenance)
    assert len({p["run_seed"] for p in several.provenance}) == len(several.provenance)
    assert {p["planner"] for p in several.provenance} == {"rrt"}


# Random, but the same again


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.proof)])
def test_processes_and_the_order_of_runs_change_nothing(several, workers):
    with processes(workers) as pool:
        there = SEVERAL.solve(PROBLEM, executor=pool)
    assert there.provenance == several.provenance
    assert there.planned.tolist() == several.planned.tolist()
    for here, other in zip(several.trajectories, there.trajectories, strict=True):
        for name in here.states.names:
            assert getattr(here.states, name).tolist() == getattr(other.states, name).tolist()


def test_fewer_runs_are_the_first_of_more_and_another_seed_gives_others(several):
    first = RRT(runs=2, seed=3, keep="all").solve(PROBLEM)
    assert first.provenance == several.provenance[: len(first.provenance)]
    other = RRT(runs=1, seed=4, keep="all").solve(PROBLEM)
    assert {p["run_seed"] for p in other.provenance}.isdisjoint(p["run_seed"] for p in several.provenance)


# Closing


def open_query(goal):
    return TreeQuery(ROBOT, World.from_polygons([], extent=shapely.box(-9, -9, 9, 9)), (0.0, 0.0, 0.0), goal, 1)


@pytest.mark.parametrize("goal", [(2.0, 0.3, 0.2), (1.7, -0.2, -0.1), (1.6, -0.3, None)])
def test_closing_ends_exactly_at_the_goal(goal):
    """Straight ahead for 6 s, to (2.04, 0), and what is missing is made up for."""
    query = open_query(goal)
    controls = np.array([[0.2, 0.0, 0.4]] * 6 + [[0.0, 0.0, 0.4]] * 5 + [[-0.2, 0.0, 0.4]] * 6)
    closed = close_gap(query, controls)
    states = query.trajectory(closed).states
    assert (states.x[-1], states.y[-1]) == pytest.approx(goal[:2], abs=1e-8)
    assert (states.speed[-1], states.turn_rate[-1]) == pytest.approx((0, 0), abs=1e-8)
    if goal[2] is not None:
        assert states.yaw[-1] == pytest.approx(goal[2], abs=1e-8)


def test_a_gap_that_the_limits_do_not_let_be_closed_is_not_closed():
    controls = np.array([[0.5, 0.0, 0.4], [-0.5, 0.0, 0.4]])
    assert close_gap(open_query((0.3, 0.0, 0.0)), controls) is None


def test_a_gap_behind_the_robot_is_not_closed_by_going_back():
    standing = np.tile([0.0, 0.0, 0.4], (16, 1))
    assert close_gap(open_query((0.05, 0.0, 0.0)), standing) is not None
    assert close_gap(open_query((-0.05, 0.0, 0.0)), standing) is None


def test_a_closing_that_would_collide_is_not_taken():
    """The goal is straight behind a thin wall, which the robot cannot pass."""
    wall = World.from_polygons([shapely.box(1.0, -9, 1.05, 9)], extent=shapely.box(-9, -9, 9, 9))
    query = TreeQuery(ROBOT, wall, (0.0, 0.0, 0.0), (2.0, 0.1, 0.0), 1)
    controls = np.array([[0.2, 0.0, 0.4]] * 6 + [[0.0, 0.0, 0.4]] * 5 + [[-0.2, 0.0, 0.4]] * 6)
    assert close_gap(query, controls) is None
    assert close_gap(open_query((2.0, 0.1, 0.0)), controls) is not None


def test_a_drive_of_the_tree_is_that_of_the_motion_law():
    query, base = open_query((5.0, 0.0, 0.0)), Base(0.0, 0.0, 0.0, 0.0, 0.0)
    controls = [(0.5, 1.0, 0.4), (0.2, -2.0, 0.4), (-0.1, 1.5, 0.4), (0.3, 1.0, 0.4)]
    states = query.trajectory(np.array(controls)).states
    for i, control in enumerate(controls, start=1):
        base = query.drive(base, *control)
        assert base == pytest.approx(tuple(getattr(states, name)[i] for name in Base._fields), abs=1e-7)


# What it says when there is nothing


def test_no_solution_within_the_extensions_is_said_and_is_no_proof():
    wall = World.from_polygons([shapely.box(2.6, 0, 3.0, 5)], extent=shapely.box(0, 0, 6, 5))
    problem = Problem(wall, ROBOT, (1, 1, 0), (5, 1, 0), ["length"])
    candidates = RRT(runs=2, max_extensions=200).solve(problem)
    assert candidates.trajectories == ()
    assert candidates.status is Status.RUN_LIMIT
    assert candidates.stats["failed"] == {"did not reach the goal": 2}
    assert "rrt: 2 of 2 runs did not reach the goal" in candidates.notes
    assert any("does not mean that there is none. The best tree ended about" in n for n in candidates.notes)
    assert len(problem.front(candidates)) == 0


def test_time_that_is_up_before_a_run_is_finished_is_said():
    candidates = RRT(runs=5, time_limit=1e-9).solve(PROBLEM)
    assert candidates.status is Status.TIME_LIMIT
    assert candidates.trajectories == ()
    assert any("no path before the time limit" in note for note in candidates.notes)


def test_time_that_runs_out_keeps_what_is_finished(monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr("hpop.runtime.limits.time.perf_counter", lambda: float(next(clock)))
    candidates = RRT(runs=8, seed=3, keep="all", time_limit=2.5).solve(PROBLEM)
    assert candidates.status is Status.TIME_LIMIT
    assert 0 < candidates.stats["runs"] < 8
    assert candidates.trajectories


def test_a_tree_that_still_grows_when_time_is_up_is_dropped(monkeypatch):
    """There is no way, so each tree would grow to 100,000 extensions; time goes by a second an extension."""
    wall = World.from_polygons([shapely.box(2.6, 0, 3.0, 5)], extent=shapely.box(0, 0, 6, 5))
    problem = Problem(wall, ROBOT, (1, 1, 0), (5, 1, 0), ["length"])
    clock = count(1e9)
    monkeypatch.setattr("hpop.planners.rrt.time", lambda: float(next(clock)))
    candidates = RRT(runs=2, max_extensions=100_000, time_limit=50.0).solve(problem)
    assert next(clock) < 1e9 + 120
    assert candidates.status is Status.TIME_LIMIT
    assert candidates.stats["runs"] == 0
    assert candidates.stats["failed"] == {}
    assert any("no path before the time limit" in note for note in candidates.notes)


@pytest.mark.parametrize("at", [0, 2])
def test_ctrl_c_keeps_what_is_finished(at, several):
    def interrupt(progress):
        if progress.stage == "rrt" and progress.labels == at:
            raise KeyboardInterrupt

    candidates = SEVERAL.solve(PROBLEM, interrupt)
    assert candidates.status is Status.INTERRUPTED
    assert candidates.stats["runs"] == at
    assert candidates.provenance == tuple(p for p in several.provenance if p["run"] < at)


def test_trajectories_that_collide_are_dropped_and_counted(monkeypatch):
    """A run that believes itself free, straight through the wall."""
    through = np.array([[0.25, 0.0, 4.0], [0.0, 0.0, 0.0], [-0.25, 0.0, 4.0]])
    monkeypatch.setattr("hpop.planners.rrt.run", lambda query, seed: TreeRun(through, "", 1))
    candidates = RRT(runs=3).solve(PROBLEM)
    assert candidates.trajectories == ()
    assert candidates.stats["dropped"] == {"collides": 3}
    assert "rrt: 3 of 3 candidates were rejected: collides (3)" in candidates.notes


# Wrong questions


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"runs": 0}, "runs"),
        ({"runs": 2.0}, "runs"),
        ({"runs": 10**9}, "runs must be a whole number from 1 to 100,000"),
        ({"seed": -1}, "seed"),
        ({"seed": True}, "seed"),
        ({"max_extensions": 0}, "max_extensions"),
        ({"keep": "best"}, "keep must be one of selected, all, got 'best'"),
        ({"time_limit": 0}, "time_limit"),
    ],
)
def test_wrong_options_are_refused(options, match):
    with pytest.raises(OptionError, match=match):
        RRT(**options)


def test_without_ompl_the_error_says_what_to_install(monkeypatch):
    for name in ("ompl", "ompl.base", "ompl.control", "ompl.util"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(OptionError, match=r"pip install 'hpop\[rrt\]'"):
        PROBLEM.solve("rrt", runs=1)


@pytest.mark.parametrize("what", ["start", "goal"])
def test_a_blocked_end_is_refused(what):
    ends = {"start": (1, 1, 0), "goal": (5, 1, 0)} | {what: (2.8, 1, 0)}
    with pytest.raises(QueryError, match=f"the {what} .* inside an obstacle"):
        RRT(runs=1).solve(Problem(ROOM, ROBOT, ends["start"], ends["goal"], ["length"]))


def test_a_long_robot_needs_room_to_turn_at_its_ends():
    long = DifferentialDrive(footprint=((0.5, 0.1), (-0.5, 0.1), (-0.5, -0.1), (0.5, -0.1)))
    problem = Problem(ROOM, long, (1, 0.2, 0), (5, 1, 0), ["length"])
    with pytest.raises(QueryError, match=r"rrt needs room at the start .* is too near an obstacle"):
        RRT(runs=1).solve(problem)


def test_people_who_move_are_refused():
    world = ROOM.with_content(people=[Person(1.0, 4.0, 0.0, velocity=(0.5, 0.0), name="Ada")])
    with pytest.raises(QueryError, match="but Ada moves"):
        RRT(runs=1).solve(Problem(world, ROBOT, (1, 1, 0), (5, 1, 0), ["length"]))
