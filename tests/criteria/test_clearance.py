"""Clearance: the worst shortfall along a path, against distances by shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Clearance, motion_costs, trajectory_cost
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
