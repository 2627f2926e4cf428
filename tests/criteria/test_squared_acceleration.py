"""Squared acceleration: of executed runs and turns, and of planned changes of speed."""

import numpy as np
import pytest
import shapely

from hpop.criteria import SquaredAcceleration, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))


@pytest.mark.parametrize(("speed", "acceleration", "long"), [(1.0, 1.0, 3.0), (0.8, 2.0, 5.0), (2.0, 0.5, 1.0)])
def test_a_run_costs_the_acceleration_squared_times_the_time_of_its_ramps(speed, acceleration, long):
    plan = Trajectory.from_poses(DifferentialDrive(speed=speed, acceleration=acceleration), [(0, 0, 0), (long, 0, 0)])
    assert trajectory_cost(SquaredAcceleration(), plan, WORLD) == 0.0
    fastest = min(speed, np.sqrt(acceleration * long))
    wanted = acceleration**2 * 2.0 * fastest / acceleration
    assert trajectory_cost(SquaredAcceleration(), plan.execution(), WORLD) == pytest.approx(wanted)


def test_a_camera_off_the_axis_goes_round_a_circle_as_its_base_turns():
    robot = DifferentialDrive(camera_offset=(0.2, 0.0), turn_rate=1.5, turn_acceleration=3.0)
    turn = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, 2.0)]).execution()
    times = np.linspace(0, turn.duration, 200_001)
    velocity, change = turn.rates(0.5 * (times[1:] + times[:-1]))
    wanted = np.sum(0.04 * (change.yaw**2 + velocity.yaw**4)) * (times[1] - times[0])
    assert trajectory_cost(SquaredAcceleration(), turn, WORLD) == pytest.approx(wanted, rel=1e-3)


def test_planned_changes_of_speed_cost_what_their_ramps_cost():
    robot = DifferentialDrive(speeds=(0.5, 1.0), acceleration=2.0)
    x, speed = np.array([(0, 0), (0, 1), (3, 1), (3, 0.5), (6, 0.5), (6, 0)], float).T
    kinds = ("speed_change", "move", "speed_change", "move", "speed_change")
    plan = Trajectory(robot, States(x=x, y=0 * x, yaw=0 * x, speed=speed), kinds)
    for one in (plan, plan.execution()):
        assert trajectory_cost(SquaredAcceleration(), one, WORLD) == pytest.approx(2.0 * (1.0 + 0.5 + 0.5))


def test_it_is_a_comfort_criterion():
    assert (SquaredAcceleration.group, SquaredAcceleration.unit) == ("C", "m²/s³")
    assert SquaredAcceleration.aggregate == "sum"
