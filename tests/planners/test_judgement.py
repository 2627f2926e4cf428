"""A result of a continuous solver is judged by its trajectory alone."""

import numpy as np
import pytest
import shapely

from hpop.criteria import make_criterion
from hpop.models import DifferentialDrive
from hpop.planners.judgement import judge
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
WORLD = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))
PROBLEM = Problem(WORLD, ROBOT, (1, 2, 0), (5, 2, None), ["length", "turns"])
OBJECTIVES = PROBLEM.criteria


def through(*points):
    return Trajectory.from_poses(ROBOT, [(1, 2, 0), *points])


ABOVE = through((1.5, 3.8, 1.3), (4.5, 3.8, 0), (5, 2, -1.3))


def test_a_good_trajectory_is_kept_with_its_exact_costs():
    judged = judge(PROBLEM, OBJECTIVES, [ABOVE])
    assert judged.reasons == ("",)
    assert judged.accepted_rows.tolist() == [0]
    assert judged.rejection_counts == {}
    assert judged.notes("x") == ()
    assert judged.costs[0, 0] == pytest.approx(2 * np.hypot(0.5, 1.8) + 3.0)


@pytest.mark.parametrize(
    ("trajectory", "reason"),
    [
        (through((5, 2, 0)), "collides"),
        (through((1.5, 3.8, 1.3), (5, 2.1, -1.3)), "misses the goal"),
        (Trajectory.from_poses(ROBOT, [(1.001, 2, 0), (1.5, 3.8, 1.3), (5, 2, 0)]), "misses the start"),
        (Trajectory.from_poses(ROBOT, [(1, 2, 0.01), (1.5, 3.8, 1.3), (5, 2, 0)]), "misses the start"),
        (through((3, 7, 1.3), (5, 2, 0)), "leaves the map"),
    ],
)
def test_what_is_wrong_is_named(trajectory, reason):
    judged = judge(PROBLEM, OBJECTIVES, [ABOVE, trajectory])
    assert judged.reasons == ("", reason)
    assert judged.rejection_counts == {reason: 1}
    assert judged.notes("p") == (f"p: 1 of 2 candidates were rejected: {reason} (1)",)


def test_a_collision_between_two_samples_of_any_spacing_is_found():
    """The corner is cut by a tenth of a millimetre, over three millimetres of the way."""
    blocked = WORLD.blocked()
    corner = np.array([2.9, 3.0])
    for inside, free in ((1e-4, False), (-1e-4, True)):
        middle = corner + (ROBOT.radius - inside) * np.array([-np.sqrt(0.5), np.sqrt(0.5)])
        ends = [middle + side * np.array([0.5, 0.5]) for side in (-1, 1)]
        problem = Problem(WORLD, ROBOT, (*ends[0], np.pi / 4), (*ends[1], None), ["length"])
        trajectory = Trajectory.from_poses(ROBOT, [(*ends[0], np.pi / 4), (*ends[1], np.pi / 4)])
        assert (shapely.LineString(ends).distance(blocked) >= ROBOT.radius) is free
        assert (judge(problem, problem.criteria, [trajectory]).reasons[0] == "") is free


def test_bounds_hold_within_a_thousandth():
    length = judge(PROBLEM, OBJECTIVES, [ABOVE]).costs[0, 0]
    for bound, reason in ((length / 1.0005, ""), (length / 1.002, "exceeds the bound on length"), (np.inf, "")):
        assert judge(PROBLEM, OBJECTIVES, [ABOVE], epsilon=np.array([[bound, 9.0]])).reasons == (reason,)


def test_a_count_one_above_its_bound_exceeds_it():
    assert judge(PROBLEM, OBJECTIVES, [ABOVE], epsilon=np.array([[np.inf, 3.0]])).reasons == ("",)
    judged = judge(PROBLEM, OBJECTIVES, [ABOVE], epsilon=np.array([[np.inf, 2.0]]))
    assert judged.reasons == ("exceeds the bound on turns",)


def test_planned_costs_that_are_off_are_named():
    costs = judge(PROBLEM, OBJECTIVES, [ABOVE]).costs
    for off, reason in ((0.0, ""), (0.02, "planned and re-evaluated length differ too much")):
        judged = judge(PROBLEM, OBJECTIVES, [ABOVE], planned=costs - [[off, 0.0]], tolerance=np.full((1, 2), 0.01))
        assert judged.reasons == (reason,)


def test_nothing_to_judge():
    judged = judge(PROBLEM, OBJECTIVES, [])
    assert judged.costs.shape == (0, 2)
    assert judged.notes("p") == ()


def test_the_goals_heading_counts_where_it_is_asked_for():
    asked = Problem(WORLD, ROBOT, (1, 2, 0), (5, 2, 0.5), [make_criterion("length")])
    assert judge(asked, asked.criteria, [ABOVE]).reasons == ("misses the goal",)
