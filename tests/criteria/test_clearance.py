"""Clearance and proximity."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Clearance, Proximity, motion_costs, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

BOXES = [shapely.box(2, 2, 3, 5), shapely.box(6, 1, 7, 2), shapely.Polygon([(6, 6), (8, 7), (5, 8)])]
WORLD = World.from_polygons(BOXES, extent=shapely.box(0, 0, 10, 10))
ROBOT = DifferentialDrive(camera_offset=(0.5, 0.0))
BLOCKED = shapely.union_all([*BOXES, shapely.box(-9, -9, 19, 19).difference(shapely.box(0, 0, 10, 10))])
inside = st.floats(0.1, 9.9)


@given(inside, inside, inside, inside, st.floats(0.1, 3.0))
def test_the_cost_of_a_move_is_the_shortfall_at_its_nearest_point(x0, y0, x1, y1, enough):
    start, end = (
        States(x=np.array([x]), y=np.array([y]), yaw=np.array([math.atan2(y1 - y0, x1 - x0)]))
        for x, y in ((x0, y0), (x1, y1))
    )
    found = motion_costs(Clearance(enough), Motions(WORLD, ROBOT, ROBOT.laws["move"], start, end))[0]
    # shapely knows the distance of the whole segment at once; samples may miss a quarter of a cell
    expected = max(enough - shapely.LineString([(x0, y0), (x1, y1)]).distance(BLOCKED), 0.0)
    assert expected - WORLD.cell / 4 - 1e-9 <= found <= expected + 1e-9


@given(inside, inside, st.floats(-3, 3))
def test_turning_costs_the_shortfall_of_the_axis_exactly(x, y, turn):
    start, end = (States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw])) for yaw in (0.0, turn))
    found = motion_costs(Clearance(), Motions(WORLD, ROBOT, ROBOT.laws["turn"], start, end))[0]
    assert found == pytest.approx(max(1.0 - shapely.Point(x, y).distance(BLOCKED), 0.0), abs=1e-9)


def test_a_path_costs_its_worst_motion_and_nothing_where_there_is_room():
    path = Trajectory.from_poses(ROBOT, [(1, 1, 0), (4.5, 1, 0), (4.5, 3, 0)])
    assert trajectory_cost(Clearance(1.2), path, WORLD) == pytest.approx(1.2 - 1.0, abs=WORLD.cell / 4)
    assert trajectory_cost(Clearance(0.5), path, WORLD) == 0.0


@pytest.mark.parametrize("enough", [0, -1.0, math.inf, math.nan])
def test_what_is_enough_must_be_a_positive_distance(enough):
    with pytest.raises(CriterionError, match="enough must be a positive distance"):
        Clearance(enough)


def test_clearance_is_a_worst_moment_of_the_robot_in_metres():
    assert (Clearance.group, Clearance.unit, Clearance.aggregate) == ("R", "m", "max")


WALL = World.from_polygons([shapely.box(0, 0, 1, 40)], extent=shapely.box(0, 0, 40, 40))
MODEL = DifferentialDrive()


def cost(poses, criterion=None, world=WALL, model=MODEL):
    return trajectory_cost(criterion or Proximity(), Trajectory.from_poses(model, poses), world)


def test_driving_from_a_wall_costs_the_logarithm_of_the_ratio_of_distances():
    assert cost([(2, 20, 0), (5, 20, 0)]) == pytest.approx(np.log(4.0), rel=1e-4)


def test_driving_along_a_wall_costs_the_length_over_the_distance():
    assert cost([(3, 18, np.pi / 2), (3, 23, np.pi / 2)]) == pytest.approx(5.0 / 2.0, rel=1e-9)


def test_nearer_than_least_counts_as_least():
    expected = 0.15 / 0.2 + np.log(1.0 / 0.2)  # from 0.05 m to 0.2 m capped, then on to 1 m
    assert cost([(1.05, 20, 0), (2.0, 20, 0)], Proximity(least=0.2)) == pytest.approx(expected, rel=5e-3)
    assert cost([(0.2, 20, 0), (0.8, 20, 0)], Proximity(least=0.2)) == pytest.approx(0.6 / 0.2, rel=1e-9)


def test_turning_in_place_costs_nothing_however_near():
    assert cost([(1.2, 20, 0), (1.2, 20, 2.0)]) == 0.0


def test_the_way_counts_not_the_time():
    poses = [(2, 20, 0), (5, 20, 0), (5, 23, 1)]
    slow = DifferentialDrive(speed=0.2, acceleration=0.3)
    assert cost(poses, model=slow) == pytest.approx(cost(poses), rel=1e-9)
    execution = Trajectory.from_poses(MODEL, poses).execution()
    assert trajectory_cost(Proximity(), execution, WALL) == pytest.approx(cost(poses), rel=1e-3)


def test_among_boxes_it_is_near_the_sum_over_exact_distances():
    boxes = [shapely.box(4, 1, 5, 4), shapely.box(7, 5, 8, 9), shapely.box(2, 7, 3, 8)]
    world = World.from_polygons(boxes, extent=shapely.box(0, 0, 10, 10))
    x, y = np.linspace(1, 9, 200_001), np.linspace(4.8, 4.6, 200_001)
    blocked = shapely.union_all([*boxes, shapely.box(0, 0, 10, 10).exterior])
    exact = np.mean(1 / shapely.distance(blocked, shapely.points(x, y))) * np.hypot(8, 0.2)
    assert cost([(1, 4.8, 0), (9, 4.6, 0)], world=world) == pytest.approx(exact, rel=0.02)


def test_straight_ways_anywhere_are_near_a_dense_sum_over_the_field():
    boxes = [shapely.box(4, 1, 5, 4), shapely.box(7, 5, 8, 9), shapely.box(2, 7, 3, 8)]
    world = World.from_polygons(boxes, extent=shapely.box(0, 0, 10, 10))
    rng, share = np.random.default_rng(0), (np.arange(50_000) + 0.5) / 50_000
    for _ in range(20):  # some of them through boxes
        (ax, ay), (bx, by) = rng.uniform(0.3, 9.7, (2, 2))
        yaw = np.arctan2(by - ay, bx - ax)
        distances = world.clearance_field()(ax + share * (bx - ax), ay + share * (by - ay))
        dense = np.mean(1 / np.maximum(distances, 0.1)) * np.hypot(bx - ax, by - ay)
        assert cost([(ax, ay, yaw), (bx, by, yaw)], world=world) == pytest.approx(dense, rel=1e-3)


@pytest.mark.parametrize("least", [0.0, -1.0, np.inf, np.nan])
def test_least_must_be_a_length(least):
    with pytest.raises(CriterionError, match="least must be a positive distance"):
        Proximity(least=least)


def test_costs_are_finite_inside_obstacles_too():
    for _, motions in Trajectory.from_poses(MODEL, [(0.5, 20, 0), (-3, 20, 0)]).batches(WALL):
        assert np.isfinite(motion_costs(Proximity(), motions)).all()
