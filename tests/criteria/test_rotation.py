"""Rotation: the sum of absolute angles, either way round."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import Rotation, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive()


@given(st.lists(st.floats(0.01, 3.1).flatmap(lambda a: st.sampled_from([a, -a])), max_size=6))
def test_rotation_adds_the_absolute_angles(angles):
    yaw = np.cumsum([0.5, *angles])
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, a) for a in yaw])
    assert trajectory_cost(Rotation(), trajectory, WORLD) == pytest.approx(np.abs(angles).sum(), abs=1e-9)


def test_a_polygon_walked_round_turns_once_in_all_and_a_straight_line_never():
    square = [(0, 0, 0), (1, 0, np.pi / 2), (1, 1, np.pi), (0, 1, -np.pi / 2), (0, 0, 0)]
    assert trajectory_cost(Rotation(), Trajectory.from_poses(ROBOT, square), WORLD) == pytest.approx(2 * np.pi)
    assert trajectory_cost(Rotation(), Trajectory.from_poses(ROBOT, [(0, 0, 1), (2, 0, 1)]), WORLD) > 1.9
    assert trajectory_cost(Rotation(), Trajectory.from_poses(ROBOT, [(0, 0, 0), (9, 0, 0)]), WORLD) == 0.0


def test_a_spin_rotates_as_much_as_the_turn_that_planned_it():
    planned = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, -2.5)])
    assert trajectory_cost(Rotation(), planned.execution(), WORLD) == pytest.approx(2.5)


def test_rotation_is_a_comfort_criterion_in_radians_and_needs_a_camera():
    assert (Rotation.group, Rotation.unit, Rotation.aggregate, Rotation.requires) == ("C", "rad", "sum", ("camera",))
