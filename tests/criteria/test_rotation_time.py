"""Rotation time: against closed forms of a turn from rest to rest and against sampled yaw rates."""

import numpy as np
import pytest
import shapely

from hpop.criteria import RotationTime, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
ROBOT = DifferentialDrive(turn_rate=1.5, turn_acceleration=3.0)


@pytest.mark.parametrize("angle", [np.pi, -np.pi / 2, 0.75])
def test_a_turn_that_reaches_its_rate_takes_its_angle_over_the_rate_and_one_ramp(angle):
    path = Trajectory.from_poses(ROBOT, [(1, 1, 0), (1, 1, angle)])
    assert trajectory_cost(RotationTime(), path, WORLD) == pytest.approx(abs(angle) / 1.5 + 1.5 / 3.0)


def test_a_short_turn_only_speeds_up_and_slows_down():
    path = Trajectory.from_poses(ROBOT, [(1, 1, 0), (1, 1, 0.3)])
    assert trajectory_cost(RotationTime(), path, WORLD) == pytest.approx(2 * np.sqrt(0.3 / 3.0))


def test_with_fast_ramps_it_is_the_total_rotation_over_the_turn_rate():
    robot = DifferentialDrive(turn_rate=0.5, turn_acceleration=1e6)
    path = Trajectory.from_poses(robot, [(1, 1, 0), (1, 3, np.pi), (5, 3, 0)])
    assert trajectory_cost(RotationTime(), path, WORLD) == pytest.approx(
        (np.pi / 2 + np.pi / 2 + np.pi) / 0.5, rel=1e-5
    )


def test_only_the_time_with_a_yaw_rate_counts_not_standing_before_and_after():
    path = Trajectory.from_poses(ROBOT, [(1, 1, 0), (4, 1, 0), (4, 5, 2.0), (8, 8, 2.0)])
    times = np.linspace(0, path.duration, 200_001)
    turning = np.abs(path.rates(times)[0].yaw) > 1e-9
    assert trajectory_cost(RotationTime(), path, WORLD) == pytest.approx(turning.mean() * path.duration, abs=1e-3)
    assert trajectory_cost(RotationTime(), path, WORLD) < path.durations[np.array(path.kinds) == "turn"].sum()


def test_moves_are_free_and_arcs_turn_all_the_time(arcs):
    assert trajectory_cost(RotationTime(), Trajectory.from_poses(ROBOT, [(1, 1, 0), (9, 1, 0)]), WORLD) == 0.0
    curve = arcs([2.0], [0.5])
    assert trajectory_cost(RotationTime(), curve, WORLD) == pytest.approx(curve.duration)


def test_its_group_unit_and_aggregate():
    assert (RotationTime.group, RotationTime.unit, RotationTime.aggregate) == ("C", "s", "sum")
