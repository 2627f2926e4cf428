"""Length: D of the base, whatever the camera does."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Length, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive(camera_offset=(0.5, 0.2))
points = st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=6)


@given(points)
def test_length_is_that_of_the_polyline_through_the_positions(where):
    trajectory = Trajectory.from_poses(ROBOT, [(x, y, 0.3) for x, y in where])
    expected = shapely.LineString(where).length if len(where) > 1 else 0.0
    assert trajectory_cost(Length(), trajectory, WORLD) == pytest.approx(expected, abs=1e-9)
    assert trajectory_cost(Length(), trajectory.execution(), WORLD) == pytest.approx(expected, abs=1e-5)


def test_turning_in_place_has_no_length_though_the_camera_swings():
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, np.pi / 2)])
    assert trajectory_cost(Length(), trajectory, WORLD) == 0.0


def test_length_is_a_comfort_criterion_in_metres():
    assert (Length.group, Length.unit, Length.aggregate, Length.smooth) == ("C", "m", "sum", True)
