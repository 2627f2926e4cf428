"""Faults that were there once: each stands here as the test that shows it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import CriterionError
from hpop.motions import Motions, States
from hpop.problems.verify import collision_free, verify
from hpop.trajectories.history import History
from hpop.world.content.content import Person, Zone

ROBOT = hpop.DifferentialDrive()
HALL = hpop.World.from_polygons([shapely.box(4, 2, 6, 6)], extent=shapely.box(0, 0, 10, 8))
PLAIN = hpop.World.from_polygons([], extent=shapely.box(0, 0, 10, 6))


@pytest.mark.parametrize(
    "content",
    [{"people": [Person(5.0, 3.0)]}, {"zones": [Zone("keep-out", shapely.box(4.0, 2.5, 5.0, 3.5))]}],
    ids=["person", "zone"],
)
def test_nobody_is_run_over_unnoticed(content):
    world = PLAIN.with_content(**content)
    problem = hpop.Problem(world, ROBOT, (1, 3, 0), (9, 3, 0), ["length"])
    through = hpop.Trajectory.from_poses(ROBOT, [(1, 3, 0), (9, 3, 0)])
    assert not collision_free(problem, [through])[0]
    here = States(x=np.array([4.9]), y=np.array([3.0]), yaw=np.array([0.0]))
    for geometry in (ROBOT.collision(world), ROBOT.judge(world)):
        assert "keep-out zone or in a standing person" in geometry.why_blocked(here)


def test_a_front_that_never_leaves_the_start_is_no_answer():
    problem = hpop.Problem(PLAIN, ROBOT, (1, 3, 0), (9, 3, 0), ["length"])
    still = hpop.Trajectory.from_poses(ROBOT, [(1, 3, 0)])
    front = hpop.Front.of(
        [[0.0]], [still], names=["length"], units=["m"], quanta=[1e-6], groups=["C"], status="complete",
        certificate="made up", provenance=[{"goal_offset": 8.0, "step": 0.5}],
    )  # fmt: skip
    assert any("from the goal" in fault for fault in verify(problem, front))


@pytest.mark.parametrize("criteria", [["length"], ["obstruction", "length"]])
def test_where_turning_costs_nothing_the_robot_does_not_spin(criteria):
    front = hpop.Problem(HALL, ROBOT, (1, 4, 0), (9, 4, np.pi), criteria).solve("lattice", step=0.5)
    asked = hpop.Problem(HALL, ROBOT, (1, 4, 0), (9, 4, np.pi), [*criteria, "turns"]).solve("lattice", step=0.5)
    fewest: dict[tuple[int, ...], float] = {}
    for row, turns in zip(asked.integers[:, :-1].tolist(), asked.costs[:, -1], strict=True):
        fewest[tuple(row)] = min(turns, fewest.get(tuple(row), np.inf))
    assert len(front) > 0
    for row, trajectory in zip(front.integers.tolist(), front.trajectories, strict=True):
        assert sum(kind == "turn" for kind in trajectory.kinds) == fewest[tuple(row)]


def test_a_rate_that_reads_more_in_some_places_takes_no_shortcut():
    def rate(s):
        near = s.camera.x > 5.0
        return np.where(near, s.camera.yaw**2, 0.0) if near.any() else 0.0 * s.camera.x

    x = np.array([1.0, 9.0])
    start = States(x=x, y=np.ones(2), yaw=np.zeros(2))
    both = Motions(HALL, ROBOT, ROBOT.laws["turn"], start, States(x=x, y=start.y, yaw=np.ones(2)))
    last = slice(1, 2)
    alone = Motions(HALL, ROBOT, ROBOT.laws["turn"], start.take(last), both.end.take(last))
    assert both.integrate(rate)[1] == pytest.approx(alone.integrate(rate)[0])
    assert both.integrate(rate)[1] > 0.1


@dataclass(frozen=True)
class _Table:
    """A criterion whose parameter no front can save."""

    table: np.ndarray = field(default_factory=lambda: np.ones(2))
    name = "table"
    group = "C"
    unit = "1"
    aggregate = "sum"
    requires = ()
    smooth = True
    quantum = 1e-6

    def cost(self, m):
        return m.base.length


def test_what_cannot_be_saved_is_refused_before_it_is_planned():
    with pytest.raises(CriterionError, match="'table' must be a dataclass whose fields"):
        hpop.Problem(PLAIN, ROBOT, (1, 3, 0), (9, 3, 0), [_Table()])


def test_standing_still_can_be_traced_with_criteria_that_have_memory():
    problem = hpop.Problem(PLAIN, ROBOT, (1, 3, 0), (1, 3, 0), ["length", "jerk", "curvature_sign_changes"])
    trace = problem.trace(hpop.Trajectory.from_poses(ROBOT, [(1, 3, 0)]))
    assert trace.cost.tolist() == [0.0, 0.0, 0.0]


def test_certificates_of_two_lattices_are_both_kept():
    problem = hpop.Problem(PLAIN, ROBOT, (1, 3, 0), (9, 3, 0), ["turns", "length"])
    front = problem.solve([hpop.Lattice(step=1.0), hpop.Lattice(step=0.5)])
    assert "step 1 m" in front.certificate
    assert "step 0.5 m" in front.certificate


@dataclass(frozen=True)
class _Seconds:
    """The duration, counted in whole seconds."""

    name = "seconds"
    group = "R"
    unit = "s"
    aggregate = "sum"
    requires = ()
    smooth = True
    quantum = 0.6

    def cost(self, m):
        return m.duration


def test_a_quantum_that_hides_a_cost_is_said():
    problem = hpop.Problem(PLAIN, ROBOT, (1, 3, 0), (9, 3, 0), ["length", _Seconds()])
    notes = problem.solve("lattice", step=0.5).notes
    assert any("seconds of each edge is rounded to 0.6 s" in note and "smaller quantum" in note for note in notes)
    assert not any("length of each edge is rounded" in note for note in notes)


def test_a_move_that_goes_nowhere_does_not_disturb_when_states_are_passed():
    x = np.array([0.0, 1.0, 1.0, 2.0, 2.0])
    states = States(x=x, y=np.zeros(5), yaw=np.array([0, 0, 0, 0, 1.5]))
    history = History(PLAIN, hpop.Trajectory(ROBOT, states, ("move", "move", "move", "turn")))
    assert history.executed.kinds == ("run", "spin")
    there = history.executed.at(history.passed)
    np.testing.assert_allclose(there.x, x, atol=1e-3)
    np.testing.assert_allclose(there.yaw, states.yaw, atol=1e-9)


def test_a_stopped_search_whose_ties_turns_break_claims_no_more_than_it_may():
    """A point may tie with one not yet found in the first cost and lose in another: then it is not optimal."""
    problem = hpop.Problem(HALL, ROBOT, (1, 4, 0), (9, 4, np.pi), ["length", "obstruction"])
    exact = problem.solve("lattice", step=0.5).integers
    stopped = 0
    for labels in (200, 400, 800, 1600, 3200):
        front = problem.solve("lattice", step=0.5, max_labels=labels)
        if front.status == "complete":
            continue
        assert "every point is optimal" not in front.certificate
        if "the search itself found none" in front.certificate:
            continue
        stopped += 1
        assert "no path is better in every cost" in front.certificate
        for point in front.integers:
            assert not (exact < point).all(axis=1).any()
    assert stopped > 0


def test_a_stopped_search_in_which_turns_cost_finds_optimal_points_only():
    problem = hpop.Problem(HALL, ROBOT, (1, 4, 0), (9, 4, np.pi), ["turns", "length", "obstruction"])
    front = problem.solve("lattice", step=0.5, max_labels=800)
    assert front.status == "label limit"
    assert "every point is optimal" in front.certificate
    exact = problem.solve("lattice", step=0.5).integers.tolist()
    assert all(point in exact for point in front.integers.tolist())
