"""Felt acceleration: of planned changes of speed, and of what a robot executes."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import FeltAcceleration, trajectory_cost
from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive(speeds=(0.5, 1.0))


def run(robot=ROBOT, speeds=(0, 1.0, 0.5, 1.0, 0), long=3.0):
    """Return a straight run through speeds, m/s, with a move of some metres at each of them but 0."""
    rows, kinds = [(0.0, 0.0)], []
    for speed in speeds[1:]:
        rows.append((rows[-1][0], speed))
        kinds.append("speed_change")
        if speed:
            rows.append((rows[-1][0] + long, speed))
            kinds.append("move")
    x, speed = np.array(rows).T
    return Trajectory(robot, States(x=x, y=0 * x, yaw=0 * x, speed=speed), tuple(kinds))


def test_a_run_costs_all_changes_of_its_speed_as_planned_and_as_executed():
    for one in (run(), run().execution()):
        assert trajectory_cost(FeltAcceleration(), one, WORLD) == pytest.approx(1.0 + 0.5 + 0.5 + 1.0)


@given(st.floats(0.01, 3.0), st.floats(0.2, 3.0))
def test_an_execution_costs_no_more_than_its_plan(long, acceleration):
    plan = run(DifferentialDrive(speeds=(0.5, 1.0), acceleration=acceleration), long=long)
    planned, executed = (trajectory_cost(FeltAcceleration(), one, WORLD) for one in (plan, plan.execution()))
    assert executed <= planned + 1e-9
    done = plan.execution()  # a short one is only as fast as its way allows
    speed = plan.model.wheels(done, np.linspace(0, done.duration, 5001)).left_speed
    assert executed == pytest.approx(np.abs(np.diff(speed)).sum() + speed[0] + speed[-1], abs=0.01)


def test_one_speed_costs_nothing_as_planned_and_twice_the_speed_as_executed():
    plan = Trajectory.from_poses(DifferentialDrive(speed=0.8), [(0, 0, 0), (3, 0, 0)])
    assert trajectory_cost(FeltAcceleration(), plan, WORLD) == 0.0
    assert trajectory_cost(FeltAcceleration(), plan.execution(), WORLD) == pytest.approx(1.6)


def test_a_camera_off_the_axis_goes_round_a_circle_as_its_base_turns():
    robot = DifferentialDrive(camera_offset=(0.2, 0.0), turn_rate=1.5, turn_acceleration=3.0)
    turn = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, 2.0)]).execution()
    times = np.linspace(0, turn.duration, 200_001)
    middle = 0.5 * (times[1:] + times[:-1])
    velocity, change = turn.rates(middle)
    wanted = np.sum(0.2 * np.hypot(change.yaw, velocity.yaw**2)) * (times[1] - times[0])
    assert trajectory_cost(FeltAcceleration(), turn, WORLD) == pytest.approx(wanted, rel=1e-3)


def test_it_is_a_comfort_criterion_in_metres_per_second():
    assert (FeltAcceleration.group, FeltAcceleration.unit, FeltAcceleration.aggregate) == ("C", "m/s", "sum")
