"""Start and goal of the lattice planner: exactly where they were asked for, or refused with the reason."""

import math

import numpy as np
import pytest
import shapely

from hpop.errors import QueryError
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))


def solve(problem, **options):
    return Lattice(**options).solve(problem)


def test_start_is_goal():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (1.0, 2.0, 0.0), ["exposure", "turns", "length", "clearance"])
    found = solve(problem, step=0.5)
    assert found.status is Status.COMPLETE
    assert found.planned.tolist() == [[0.0] * 4]
    assert len(found.trajectories[0]) == 0
    assert found.notes == ()


@pytest.mark.parametrize("step", [0.25, 1.0, 5.1, 50.0])
def test_the_goal_is_where_it_was_asked_for_whatever_the_step(step):
    """With a step larger than the room the start is the only position, and joined to the goal."""
    gx, gy = np.random.default_rng(0).uniform((1.0, 4.2), (5.5, 4.5))
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (gx, gy, None), ["length"])
    found = solve(problem, step=step)
    end = found.trajectories[0].states
    assert (end.x[-1], end.y[-1]) == (gx, gy)
    assert found.notes == ()
    assert found.planned[0, 0] >= math.dist((1.0, 2.0), (gx, gy))


def test_a_goal_between_a_position_and_one_that_is_blocked_is_joined_to_the_free_ones():
    """Positions are at x = 2.5 (0.4 m from the wall at 2.9) and 2.75 (too near)."""
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (2.64, 2.0, 0.0), ["length", "turns"])
    found = solve(problem, step=0.25)
    assert found.planned == pytest.approx(np.array([[1.64, 0.0]]), abs=1e-4)
    assert found.trajectories[0].states.x[-1] == 2.64


def test_a_goal_is_never_joined_through_a_wall():
    # The goal stands between a thin wall and a thick one; the nearest free position is beyond the thin one.
    walls = [shapely.box(4.99, 0, 5.01, 8), shapely.box(5.3, 0, 5.5, 8)]
    world = World.from_polygons(walls, extent=shapely.box(0, 0, 10, 10))
    problem = Problem(world, DifferentialDrive(radius=0.1), (1.35, 1.0, 0.0), (5.12, 1.0, 0.0), ["length"])
    with pytest.raises(
        QueryError, match=r"cannot drive to it by at most a turn, .* any position of .* within 0\.750 m"
    ):
        solve(problem, step=0.5)
    found = solve(problem, step=0.1)
    assert found.trajectories[0].states.x[-1] == 5.12
    assert found.planned[0, 0] > 2 * 7.0  # round the wall


@pytest.mark.parametrize("headings", [4, 8, 16])
def test_headings_may_be_any_at_start_and_goal(headings):
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.3), (5.0, 4.0, -0.5), ["length", "turns"])
    for trajectory in solve(problem, step=0.5, headings=headings).trajectories:
        assert trajectory.states.yaw[0] == 0.3
        assert math.remainder(trajectory.states.yaw[-1] + 0.5, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_a_goal_that_differs_from_the_start_by_rounding_is_the_start():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (1.0 + 1e-12, 2.0, 0.0), ["length"])
    assert solve(problem, step=0.5).planned.tolist() == [[0.0]]


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        (
            (3.1, 2.0, 0.0),
            (5.0, 2.0, 0.0),
            r"the start \(3.100, 2.000\) is not usable: it is inside an obstacle\. Move it\. The nearest place where",
        ),
        ((-1.0, 2.0, 0.0), (5.0, 2.0, 0.0), r"the start .* outside the map, .* m\. Move it\. The nearest"),
        (
            (0.1, 2.0, 0.0),
            (5.0, 2.0, 0.0),
            r"the start .* 0.100 m away and the robot reaches 0.250 m\. Move it, or take a",
        ),
        ((1.0, 2.0, 0.0), (3.1, 2.0, 0.0), r"the goal .* inside an obstacle\. Move it\. The nearest"),
        ((1.0, 2.0, 0.0), (2.8, 2.0, 0.0), "the goal .* is 0.100 m away and the robot reaches 0.250 m"),
        ((1.0, 2.0, 0.0), (5.0, 9.0, 0.0), "the goal .* outside the map"),
    ],
)
@pytest.mark.parametrize("step", [0.5, 0.3])
def test_a_start_or_goal_that_cannot_be_used_is_refused_with_the_reason(start, goal, message, step):
    with pytest.raises(QueryError, match=message):
        solve(Problem(OPEN, ROBOT, start, goal, ["length"]), step=step)


def test_a_heading_written_with_three_decimals_is_on_its_heading():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.785), (5.0, 2.0, -2.356), ["length"])
    assert solve(problem, step=0.5).status is Status.COMPLETE
