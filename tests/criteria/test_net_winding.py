"""Net winding: left and right cancel, whole turns do not."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import NetWinding, Rotation, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
SQUARE = [(1, 1, 0), (5, 1, np.pi / 2), (5, 5, np.pi), (1, 5, -np.pi / 2), (1, 1, 0)]


def test_round_a_block_is_a_whole_turn_though_the_heading_is_as_before():
    path = Trajectory.from_poses(DifferentialDrive(), SQUARE)
    assert trajectory_cost(NetWinding(), path, WORLD) == pytest.approx(2 * np.pi)


def test_there_and_back_the_other_way_is_unwound():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (1, 1, 2), (1, 1, -1), (1, 1, 0)])
    assert trajectory_cost(Rotation(), path, WORLD) == pytest.approx(6)
    assert trajectory_cost(NetWinding(), path, WORLD) == pytest.approx(0, abs=1e-12)


def test_the_running_value_is_how_far_the_user_is_twisted_so_far():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (1, 1, -2), (1, 1, 1)])
    assert running_costs(NetWinding(), path, WORLD) == pytest.approx([2, 1])


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=8))
def test_it_is_the_unwrapped_change_of_heading(turns):
    yaw = np.concatenate([[0.4], 0.4 + np.cumsum(turns)])
    path = Trajectory(DifferentialDrive(), States(x=0 * yaw, y=0 * yaw, yaw=yaw), ("turn",) * len(turns))
    assert trajectory_cost(NetWinding(), path, WORLD) == pytest.approx(abs(yaw[-1] - yaw[0]), abs=1e-9)


def test_its_group_unit_and_aggregate():
    assert (NetWinding.group, NetWinding.unit, NetWinding.aggregate) == ("C", "rad", "trajectory")
