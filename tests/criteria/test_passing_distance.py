"""Passing distance: distances by shapely at eye level, and what sets it apart from clearance."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Clearance, PassingDistance, motion_costs, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

KERB, TABLE, SIGN, LAMP = (
    shapely.box(2, 2, 8, 3),
    shapely.box(2, 7, 4, 8),
    shapely.box(7, 6, 8, 8),
    shapely.box(4, 4, 6, 5),
)
OBJECTS = [(KERB, (0.0, 0.2)), (TABLE, (0.0, 0.8)), (SIGN, (1.0, 1.6)), (LAMP, (2.0, 2.4))]
WORLD = World.from_polygons(OBJECTS, extent=shapely.box(0, 0, 10, 10))
EYE_LEVEL = shapely.union_all([TABLE, SIGN])  # 1.2 m ± 0.5 m
inside = st.floats(0.1, 9.9)


@given(inside, inside, inside, inside, st.floats(0.1, 4.0))
def test_a_move_costs_the_shortfall_where_the_camera_is_nearest_to_something_at_eye_level(x0, y0, x1, y1, enough):
    robot = DifferentialDrive(camera_offset=(0.2, 0.1))
    yaw = math.atan2(y1 - y0, x1 - x0)
    start, end = (States(x=np.array([x]), y=np.array([y]), yaw=np.array([yaw])) for x, y in ((x0, y0), (x1, y1)))
    motions = Motions(WORLD, robot, robot.laws["move"], start, end)
    dx, dy = 0.2 * math.cos(yaw) - 0.1 * math.sin(yaw), 0.2 * math.sin(yaw) + 0.1 * math.cos(yaw)
    line = shapely.LineString([(x0 + dx, y0 + dy), (x1 + dx, y1 + dy)])
    expected = max(enough - line.distance(EYE_LEVEL), 0.0) if line.length > 0 else 0.0
    found = motion_costs(PassingDistance(enough), motions)[0]
    assert expected - WORLD.cell / 4 - 1e-9 <= found <= expected + 1e-9


def test_the_band_says_which_heights_are_eye_level():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1.8, 0), (9, 1.8, 0)])  # 0.2 m past the kerb
    costs = [trajectory_cost(PassingDistance(1.0, band), path, WORLD) for band in (0.5, 1.1)]
    assert costs == pytest.approx([0.0, 0.8], abs=WORLD.cell / 4)


def test_turning_close_to_a_wall_is_no_passing_unless_the_camera_moves():
    turn = [(6.8, 7, 0), (6.8, 7, 2)]
    on_axis, off_axis = (DifferentialDrive(camera_offset=offset) for offset in ((0, 0), (-0.1, 0)))
    assert trajectory_cost(PassingDistance(), Trajectory.from_poses(on_axis, turn), WORLD) == 0.0
    # The camera starts 0.3 m from the sign and ends at 0.2 m minus 0.1 m cos 2, nearest of all.
    expected = 1.0 - (0.2 - 0.1 * math.cos(math.pi - 2))
    found = trajectory_cost(PassingDistance(), Trajectory.from_poses(off_axis, turn), WORLD)
    assert found == pytest.approx(expected, abs=1e-9)


def test_unlike_clearance_it_sees_no_zones_nor_borders_nor_what_lies_below_and_above():
    world = World.from_polygons(
        [(LAMP, (2.0, 2.4)), (KERB, (0.0, 0.2))],
        extent=shapely.box(0, 0, 10, 10),
        keep_out=shapely.box(0, 7, 10, 8),
    )
    path = Trajectory.from_poses(DifferentialDrive(), [(0.1, 6.5, 0), (9, 6.5, 0)])
    assert trajectory_cost(PassingDistance(), path, world) == 0.0
    assert trajectory_cost(Clearance(), path, world) > 0.5


def test_walls_beyond_the_extent_of_a_map_are_passed():
    world = World.from_cells(np.zeros((40, 40), dtype=bool), 0.1)
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 0.4, 0), (3, 0.4, 0)])
    assert trajectory_cost(PassingDistance(), path, world) == pytest.approx(0.6)


@pytest.mark.parametrize(("enough", "band"), [(0, 0.5), (5.1, 0.5), (math.nan, 0.5), (1, -0.1), (1, math.inf)])
def test_parameters_are_checked(enough, band):
    with pytest.raises(CriterionError, match="must be a"):
        PassingDistance(enough, band)


def test_its_group_unit_and_aggregate():
    kind = PassingDistance
    assert (kind.group, kind.unit, kind.aggregate) == ("C", "m", "max")
