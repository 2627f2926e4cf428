"""Angular acceleration above the threshold: closed forms, and the executed rates sampled."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import AngularAcceleration, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))
ROBOT = DifferentialDrive(turn_rate=1.5, turn_acceleration=3.0)


def turn(angle, robot=ROBOT):
    return Trajectory.from_poses(robot, [(1, 1, 0), (1, 1, angle)])


@pytest.mark.parametrize("angle", [1.0, -2.0, 3.0])
def test_a_turn_that_reaches_its_rate_costs_two_ramps_above_the_threshold(angle):
    cost = trajectory_cost(AngularAcceleration(threshold=0.6), turn(angle), WORLD)
    assert cost == pytest.approx(2 * 1.5 * (1 - 0.6 / 3.0))


def test_a_short_turn_accelerates_all_the_time():
    cost = trajectory_cost(AngularAcceleration(threshold=1.0), turn(0.3), WORLD)
    assert cost == pytest.approx((3.0 - 1.0) * 2 * math.sqrt(0.3 / 3.0))


def test_accelerations_below_the_threshold_are_not_felt():
    assert trajectory_cost(AngularAcceleration(threshold=3.0), turn(2.0), WORLD) == 0.0


def test_the_default_threshold_is_one_degree_a_second_squared():
    gentle = DifferentialDrive(turn_rate=0.05, turn_acceleration=math.radians(0.99))
    assert trajectory_cost(AngularAcceleration(), turn(1.0, gentle), WORLD) == 0.0
    assert AngularAcceleration().threshold == pytest.approx(math.radians(1))


def test_a_path_agrees_with_its_sampled_accelerations():
    path = Trajectory.from_poses(ROBOT, [(1, 1, 0), (4, 1, 0), (4, 5, 2.0), (8, 8, 2.2)])
    times = np.linspace(0, path.duration, 400_001)
    excess = np.maximum(np.abs(path.rates(times)[1].yaw) - 0.7, 0)
    expected = excess.mean() * path.duration
    assert trajectory_cost(AngularAcceleration(0.7), path, WORLD) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("threshold", [-0.1, math.inf, math.nan])
def test_a_threshold_is_an_acceleration(threshold):
    with pytest.raises(CriterionError, match="threshold must be"):
        AngularAcceleration(threshold)


def test_its_group_unit_and_aggregate():
    kind = AngularAcceleration
    assert (kind.group, kind.unit, kind.aggregate) == ("C", "rad/s", "sum")
