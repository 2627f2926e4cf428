"""Polylines in the place of curves: near them, free, and what planners that move corners make of them."""

import math

import numpy as np
import pytest
import shapely

from hpop.models import DifferentialDrive
from hpop.models.driven import driven
from hpop.planners.judgement import judge
from hpop.planners.programs.polyline import DEVIATIONS, straightened
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
ROOM = World.from_polygons([shapely.box(2.6, 0.0, 3.0, 2.4)], extent=shapely.box(0, 0, 6, 5))


def to_the_left(world=ROOM):
    """Return a curve to the left from (0.6, 1), and the problem of driving from its start to its end."""
    left = [(0.0, 1.0, 0.5), (0.0, 0.0, 1.8), (0.0, -1.0, 0.5)]
    curve = driven(ROBOT, (0.6, 1.0, 0.0), [(0.5, 0.0, 1.0), *left, (-0.5, 0.0, 1.0)])
    x, y, yaw = (float(getattr(curve.states, name)[-1]) for name in ("x", "y", "yaw"))
    return curve, Problem(world, ROBOT, (0.6, 1, 0), (x, y, yaw), ["length"])


def line(trajectory):
    states = trajectory.at(np.linspace(0, trajectory.duration, 500))
    return shapely.LineString(np.stack([states.x, states.y], axis=1))


def test_a_curve_gives_way_to_a_free_polyline_near_it_with_its_ends():
    curve, problem = to_the_left()
    (polyline,), notes = straightened([curve], problem)
    assert set(polyline.kinds) <= {"move", "turn"}
    assert polyline.kinds.count("move") < 6
    assert judge(problem, problem.criteria, [polyline]).reasons == ("",)
    assert shapely.hausdorff_distance(line(curve), line(polyline)) <= max(DEVIATIONS) + 0.02
    assert notes == ["1 of the warm starts are curves, and were replaced by polylines at most 0.4 m away"]


def test_it_stays_nearer_where_there_is_less_room():
    curve, _ = to_the_left()
    walls = line(curve).buffer(0.4)
    _, problem = to_the_left(World.from_polygons([ROOM.extent - walls], extent=ROOM.extent))
    (polyline,), notes = straightened([curve], problem)
    assert judge(problem, problem.criteria, [polyline]).reasons == ("",)
    assert shapely.hausdorff_distance(line(curve), line(polyline)) < 0.15 + 0.02
    assert "within 0.4 m" not in notes[0]


def test_without_room_for_any_polyline_a_curve_is_left_out_and_counted():
    curve, _ = to_the_left()
    walls = line(curve).buffer(0.2505, quad_segs=64)
    _, problem = to_the_left(World.from_polygons([ROOM.extent - walls], extent=ROOM.extent))
    assert straightened([curve], problem) == (
        [],
        ["1 of the warm starts are curves, and were left out: even a polyline within 0.05 m of the curve collides"],
    )


def test_moves_and_turns_stay_as_they_are():
    trajectory = Trajectory.from_poses(ROBOT, [(1, 1, 0), (1, 3, 0), (5, 1, math.pi)])
    problem = Problem(ROOM, ROBOT, (1, 1, 0), (5, 1, None), ["length"])
    assert straightened([trajectory], problem) == ([trajectory], [])


@pytest.mark.cases("epsilon-constraint")
@pytest.mark.parametrize("planner", ["epsilon-constraint", "weighted-sum-corridor", "smoothing"])
def test_the_trees_of_rrt_are_warm_starts(planner):
    pytest.importorskip("ompl")
    problem = Problem(ROOM, ROBOT, (1, 1, 0), (5, 1, 0), ["turns", "length"])
    front = problem.solve(planner, warm_start={"rrt": {"runs": 4, "seed": 3, "keep": "all"}})
    assert len(front)
    assert any("of the warm starts are curves, and were replaced by polylines" in note for note in front.notes)
