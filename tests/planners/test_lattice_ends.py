"""Start and goal of the lattice planner: snapped, told, or refused with the reason."""

import math
import re

import numpy as np
import pytest
import shapely

from hpop.errors import QueryError
from hpop.models import DifferentialDrive
from hpop.planners.lattice import Lattice
from hpop.problem import Problem
from hpop.status import Status
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


@pytest.mark.parametrize("seed", range(8))
def test_the_goal_is_snapped_to_the_nearest_position_and_the_note_says_how_far(seed):
    step = 0.5
    gx, gy = np.random.default_rng(seed).uniform((4.0, 1.0), (5.5, 4.0))
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (gx, gy, None), ["length"])
    found = solve(problem, step=step)
    nearest = 1.0 + step * round((gx - 1.0) / step), 2.0 + step * round((gy - 2.0) / step)
    end = found.trajectories[0].states
    assert (end.x[-1], end.y[-1]) == pytest.approx(nearest)
    distance = math.dist(nearest, (gx, gy))
    text = f"snapped to ({nearest[0]:.3f}, {nearest[1]:.3f}), {distance:.3f} m away"
    assert any(text in note for note in found.notes)


def test_planners_that_end_at_different_places_are_noted():
    """The goal is a step away from the fine lattice's start, but half a step from the coarse one's positions."""
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (2.5, 2.0, 0.0), ["length"])
    front = problem.solve([{"lattice": {"step": 0.5}}, {"lattice": {"step": 1.0}}])
    assert any("end up to 0.500 m away from those of planners before" in note for note in front.notes)
    same = problem.solve([{"lattice": {"step": 0.5}}, {"lattice": {"step": 0.25}}])
    assert same.notes == problem.solve("lattice", step=0.5).notes


def test_a_goal_on_a_position_is_not_snapped_and_a_blocked_corner_gives_way_to_the_next():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), ["length"])
    assert solve(problem, step=0.1).notes == ()
    # Positions are at x = 2.5 (0.4 m from the wall at 2.9) and 2.75 (too near).
    near = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (2.64, 2.0, 0.0), ["length"])
    assert solve(near, step=0.25).trajectories[0].states.x[-1] == pytest.approx(2.5)


def test_a_goal_is_never_snapped_through_a_wall():
    # The goal stands between a thin wall and a thick one; the nearest free position is beyond the thin one.
    walls = [shapely.box(4.99, 0, 5.01, 8), shapely.box(5.3, 0, 5.5, 8)]
    world = World.from_polygons(walls, extent=shapely.box(0, 0, 10, 10))
    problem = Problem(world, DifferentialDrive(radius=0.1), (1.35, 1.0, 0.0), (5.12, 1.0, 0.0), ["length"])
    with pytest.raises(QueryError, match=r"no lattice position within 0\.354 m can reach it; take a smaller step"):
        solve(problem, step=0.5)
    found = solve(problem, step=0.05)
    assert found.trajectories[0].states.x[-1] in (pytest.approx(5.1 + 0.05 / 2, abs=0.026), pytest.approx(5.15))


@pytest.mark.parametrize(
    ("goal", "step", "taken"),
    [
        ((2.0, 4.5, 0.0), 50.0, "(1.000, 2.000), 2.693 m from the goal"),  # the start itself
        ((2.0, 4.5, None), 5.1, "(1.000, 2.000), 2.693 m from the goal"),
        ((1.2, 2.2, 0.0), 0.5, "(1.000, 2.000), 0.283 m from the goal"),
        ((1.3, 2.0, 0.0), 0.5, "(1.500, 2.000), 0.200 m from the goal"),
    ],
)
def test_a_step_so_large_that_the_goal_becomes_another_is_refused_and_the_one_that_is_named_does(goal, step, taken):
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), goal, ["length"])
    with pytest.raises(
        QueryError, match=rf"a step of {step:g} m is too large for this goal.*{re.escape(taken)}"
    ) as said:
        solve(problem, step=step)
    smaller = float(re.search(r"such as (\S+) m", str(said.value))[1])
    end = solve(problem, step=smaller).trajectories[0].states
    assert math.dist((end.x[-1], end.y[-1]), goal[:2]) <= smaller / math.sqrt(2)


def test_a_goal_that_differs_from_the_start_by_rounding_is_the_start():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (1.0 + 1e-12, 2.0, 0.0), ["length"])
    assert solve(problem, step=0.5).planned.tolist() == [[0.0]]


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        (
            (3.1, 2.0, 0.0),
            (5.0, 2.0, 0.0),
            r"the start \(3.100, 2.000\) is not usable: it is inside an obstacle\. Move it\.$",
        ),
        ((-1.0, 2.0, 0.0), (5.0, 2.0, 0.0), r"the start .* outside the map, .* m\. Move it\.$"),
        (
            (0.1, 2.0, 0.0),
            (5.0, 2.0, 0.0),
            r"the start .* 0.100 m away and the robot reaches 0.250 m\. Move it, or take a",
        ),
        ((1.0, 2.0, 0.0), (3.1, 2.0, 0.0), r"the goal .* inside an obstacle\. Move it\.$"),
        ((1.0, 2.0, 0.0), (2.8, 2.0, 0.0), "the goal .* is 0.100 m away and the robot reaches 0.250 m"),
        ((1.0, 2.0, 0.0), (5.0, 9.0, 0.0), "the goal .* outside the map"),
        ((1.0, 2.0, 0.3), (5.0, 2.0, 0.0), r"start heading 0.300000 rad \(17.19 deg\) .* 0.000000 .* or 0.785398"),
        ((1.0, 2.0, 0.0), (5.0, 2.0, -0.5), r"goal heading .* nearest are 5.497787 \(315.00 deg\) or 0.000000"),
    ],
)
@pytest.mark.parametrize("step", [0.5, 0.3])
def test_a_start_or_goal_that_cannot_be_used_is_refused_with_the_reason(start, goal, message, step):
    with pytest.raises(QueryError, match=message):
        solve(Problem(OPEN, ROBOT, start, goal, ["length"]), step=step)


def test_a_heading_written_with_three_decimals_is_on_its_heading():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.785), (5.0, 2.0, -2.356), ["length"])
    assert solve(problem, step=0.5).status is Status.COMPLETE
