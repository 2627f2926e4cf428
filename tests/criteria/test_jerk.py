"""Jerk at a stated bandwidth: closed form for impulses, and differences of sampled positions."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import Jerk, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))


@pytest.mark.parametrize(("acceleration", "smoothing"), [(0.7, 0.1), (0.4, 0.1), (0.5, 0.05), (0.5, 0.2)])
def test_a_run_costs_four_jumps_of_the_acceleration(acceleration, smoothing):
    # A jump by a is an impulse of jerk; smoothed by a quadratic B-spline of support 3 h it squares to 11/20 a²/h.
    path = Trajectory.from_poses(
        DifferentialDrive(acceleration=acceleration), [(1, 1, 0.6), (7, 1 + 6 * math.tan(0.6), 0.6)]
    )
    expected = 4 * 11 / 20 * acceleration**2 / smoothing
    assert trajectory_cost(Jerk(smoothing), path, WORLD) == pytest.approx(expected, rel=2e-3)


def test_turning_about_the_camera_is_no_jerk_but_about_another_axis_it_is():
    poses = [(1, 1, 0), (1, 1, 2.5)]
    assert trajectory_cost(Jerk(), Trajectory.from_poses(DifferentialDrive(), poses), WORLD) == 0.0
    robot = DifferentialDrive(camera_offset=(0.3, -0.1))
    spin = Trajectory.from_poses(robot, poses)
    # Independently: the moving mean of 0.1 s three times over the second differences of a fine sampling.
    step = 1e-3
    yaw = spin.execution().at(np.arange(-1.0, spin.execution().duration + 1.0, step)).yaw
    positions = np.stack([0.3 * np.cos(yaw) + 0.1 * np.sin(yaw), 0.3 * np.sin(yaw) - 0.1 * np.cos(yaw)])
    jerk = np.diff(positions, n=3, axis=1) / step**3
    for _ in range(3):
        jerk = np.stack([np.convolve(row, np.full(100, 0.01), mode="valid") for row in jerk])
    assert trajectory_cost(Jerk(), spin, WORLD) == pytest.approx((jerk**2).sum() * step, rel=5e-3)


def test_stopping_to_turn_costs_as_much_as_two_runs():
    robot = DifferentialDrive()
    straight = Trajectory.from_poses(robot, [(1, 1, 0), (7, 1, 0)])
    bent = Trajectory.from_poses(robot, [(1, 1, 0), (4, 1, 0), (4, 4, np.pi / 2)])
    costs = [trajectory_cost(Jerk(), path, WORLD) for path in (straight, bent)]
    assert costs[1] == pytest.approx(2 * costs[0], rel=2e-3)


def test_the_running_value_grows_to_the_cost():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (4, 1, 0), (4, 4, 1.0)])
    running = running_costs(Jerk(), path, WORLD)
    assert (np.diff(running) >= 0).all()
    assert running[-1] == trajectory_cost(Jerk(), path, WORLD)


@pytest.mark.parametrize("smoothing", [0, -1, 1e-5, math.inf, math.nan])
def test_smoothing_is_a_time(smoothing):
    with pytest.raises(CriterionError, match="smoothing must be"):
        Jerk(smoothing)


def test_its_group_unit_and_aggregate():
    assert (Jerk.group, Jerk.unit, Jerk.aggregate) == ("C", "m²/s⁵", "trajectory")
