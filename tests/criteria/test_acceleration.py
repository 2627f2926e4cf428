"""Acceleration of the camera, its square, jerk, and changes of speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import FeltAcceleration, Jerk, SpeedChanges, SquaredAcceleration, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.models.driven import driven
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD_FELT_ACCELERATION = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT_FELT_ACCELERATION = DifferentialDrive(speeds=(0.5, 1.0))


def run(robot=ROBOT_FELT_ACCELERATION, speeds=(0, 1.0, 0.5, 1.0, 0), long=3.0):
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
        assert trajectory_cost(FeltAcceleration(), one, WORLD_FELT_ACCELERATION) == pytest.approx(1.0 + 0.5 + 0.5 + 1.0)


@given(st.floats(0.01, 3.0), st.floats(0.2, 3.0))
def test_an_execution_costs_no_more_than_its_plan(long, acceleration):
    plan = run(DifferentialDrive(speeds=(0.5, 1.0), acceleration=acceleration), long=long)
    planned, executed = (
        trajectory_cost(FeltAcceleration(), one, WORLD_FELT_ACCELERATION) for one in (plan, plan.execution())
    )
    assert executed <= planned + 1e-9
    done = plan.execution()  # a short one is only as fast as its way allows
    speed = plan.model.wheels(done, np.linspace(0, done.duration, 5001)).left_speed
    assert executed == pytest.approx(np.abs(np.diff(speed)).sum() + speed[0] + speed[-1], abs=0.01)


def test_one_speed_costs_nothing_as_planned_and_twice_the_speed_as_executed():
    plan = Trajectory.from_poses(DifferentialDrive(speed=0.8), [(0, 0, 0), (3, 0, 0)])
    assert trajectory_cost(FeltAcceleration(), plan, WORLD_FELT_ACCELERATION) == 0.0
    assert trajectory_cost(FeltAcceleration(), plan.execution(), WORLD_FELT_ACCELERATION) == pytest.approx(1.6)


def test_a_camera_off_the_axis_goes_round_a_circle_as_its_base_turns_for_felt_acceleration():
    robot = DifferentialDrive(camera_offset=(0.2, 0.0), turn_rate=1.5, turn_acceleration=3.0)
    turn = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, 2.0)]).execution()
    times = np.linspace(0, turn.duration, 200_001)
    middle = 0.5 * (times[1:] + times[:-1])
    velocity, change = turn.rates(middle)
    wanted = np.sum(0.2 * np.hypot(change.yaw, velocity.yaw**2)) * (times[1] - times[0])
    assert trajectory_cost(FeltAcceleration(), turn, WORLD_FELT_ACCELERATION) == pytest.approx(wanted, rel=1e-3)


def test_it_is_a_comfort_criterion_in_metres_per_second():
    assert (FeltAcceleration.group, FeltAcceleration.unit, FeltAcceleration.aggregate) == ("C", "m/s", "sum")


WORLD_SQUARED_ACCELERATION = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))


@pytest.mark.parametrize(("speed", "acceleration", "long"), [(1.0, 1.0, 3.0), (0.8, 2.0, 5.0), (2.0, 0.5, 1.0)])
def test_a_run_costs_the_acceleration_squared_times_the_time_of_its_ramps(speed, acceleration, long):
    plan = Trajectory.from_poses(DifferentialDrive(speed=speed, acceleration=acceleration), [(0, 0, 0), (long, 0, 0)])
    assert trajectory_cost(SquaredAcceleration(), plan, WORLD_SQUARED_ACCELERATION) == 0.0
    fastest = min(speed, np.sqrt(acceleration * long))
    wanted = acceleration**2 * 2.0 * fastest / acceleration
    assert trajectory_cost(SquaredAcceleration(), plan.execution(), WORLD_SQUARED_ACCELERATION) == pytest.approx(wanted)


def test_a_camera_off_the_axis_goes_round_a_circle_as_its_base_turns_for_squared_acceleration():
    robot = DifferentialDrive(camera_offset=(0.2, 0.0), turn_rate=1.5, turn_acceleration=3.0)
    turn = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, 2.0)]).execution()
    times = np.linspace(0, turn.duration, 200_001)
    velocity, change = turn.rates(0.5 * (times[1:] + times[:-1]))
    wanted = np.sum(0.04 * (change.yaw**2 + velocity.yaw**4)) * (times[1] - times[0])
    assert trajectory_cost(SquaredAcceleration(), turn, WORLD_SQUARED_ACCELERATION) == pytest.approx(wanted, rel=1e-3)


def test_planned_changes_of_speed_cost_what_their_ramps_cost():
    robot = DifferentialDrive(speeds=(0.5, 1.0), acceleration=2.0)
    x, speed = np.array([(0, 0), (0, 1), (3, 1), (3, 0.5), (6, 0.5), (6, 0)], float).T
    kinds = ("speed_change", "move", "speed_change", "move", "speed_change")
    plan = Trajectory(robot, States(x=x, y=0 * x, yaw=0 * x, speed=speed), kinds)
    for one in (plan, plan.execution()):
        assert trajectory_cost(SquaredAcceleration(), one, WORLD_SQUARED_ACCELERATION) == pytest.approx(
            2.0 * (1.0 + 0.5 + 0.5)
        )


def test_it_is_a_comfort_criterion():
    assert (SquaredAcceleration.group, SquaredAcceleration.unit) == ("C", "m²/s³")
    assert SquaredAcceleration.aggregate == "sum"


WORLD_JERK = World.from_polygons([], extent=shapely.box(0, 0, 10, 10))


@pytest.mark.parametrize(("acceleration", "smoothing"), [(0.7, 0.1), (0.4, 0.1), (0.5, 0.05), (0.5, 0.2)])
def test_a_run_costs_four_jumps_of_the_acceleration(acceleration, smoothing):
    # A jump by a is an impulse of jerk; smoothed by a quadratic B-spline of support 3 h it squares to 11/20 a²/h.
    path = Trajectory.from_poses(
        DifferentialDrive(acceleration=acceleration), [(1, 1, 0.6), (7, 1 + 6 * math.tan(0.6), 0.6)]
    )
    expected = 4 * 11 / 20 * acceleration**2 / smoothing
    assert trajectory_cost(Jerk(smoothing), path, WORLD_JERK) == pytest.approx(expected, rel=2e-3)


def test_turning_about_the_camera_is_no_jerk_but_about_another_axis_it_is():
    poses = [(1, 1, 0), (1, 1, 2.5)]
    assert trajectory_cost(Jerk(), Trajectory.from_poses(DifferentialDrive(), poses), WORLD_JERK) == 0.0
    robot = DifferentialDrive(camera_offset=(0.3, -0.1))
    spin = Trajectory.from_poses(robot, poses)
    # Independently: the moving mean of 0.1 s three times over the second differences of a fine sampling.
    step = 1e-3
    yaw = spin.execution().at(np.arange(-1.0, spin.execution().duration + 1.0, step)).yaw
    positions = np.stack([0.3 * np.cos(yaw) + 0.1 * np.sin(yaw), 0.3 * np.sin(yaw) - 0.1 * np.cos(yaw)])
    jerk = np.diff(positions, n=3, axis=1) / step**3
    for _ in range(3):
        jerk = np.stack([np.convolve(row, np.full(100, 0.01), mode="valid") for row in jerk])
    assert trajectory_cost(Jerk(), spin, WORLD_JERK) == pytest.approx((jerk**2).sum() * step, rel=5e-3)


def test_stopping_to_turn_costs_as_much_as_two_runs():
    robot = DifferentialDrive()
    straight = Trajectory.from_poses(robot, [(1, 1, 0), (7, 1, 0)])
    bent = Trajectory.from_poses(robot, [(1, 1, 0), (4, 1, 0), (4, 4, np.pi / 2)])
    costs = [trajectory_cost(Jerk(), path, WORLD_JERK) for path in (straight, bent)]
    assert costs[1] == pytest.approx(2 * costs[0], rel=2e-3)


def test_the_running_value_grows_to_the_cost():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (4, 1, 0), (4, 4, 1.0)])
    running = running_costs(Jerk(), path, WORLD_JERK)
    assert (np.diff(running) >= 0).all()
    assert running[-1] == trajectory_cost(Jerk(), path, WORLD_JERK)


@pytest.mark.parametrize("smoothing", [0, -1, 1e-5, math.inf, math.nan])
def test_smoothing_is_a_time(smoothing):
    with pytest.raises(CriterionError, match="smoothing must be"):
        Jerk(smoothing)


def test_its_group_unit_and_aggregate():
    assert (Jerk.group, Jerk.unit, Jerk.aggregate) == ("C", "m²/s⁵", "trajectory")


WORLD_SPEED_CHANGES = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT_SPEED_CHANGES = DifferentialDrive(speeds=(0.5, 1.0, 1.5))
KINDS = {"c": "speed_change", "m": "move", "t": "turn"}


@pytest.mark.parametrize(
    ("kinds", "speeds", "changes"),
    [
        ("cmc", (0, 1, 1, 0), 0),
        ("cmcmc", (0, 1, 1, 0.5, 0.5, 0), 1),
        ("cmcmcmc", (0, 1, 1, 1.5, 1.5, 1, 1, 0), 2),
        ("cmctcmc", (0, 1, 1, 0, 0, 0.5, 0.5, 0), 0),  # it stops between the two speeds
        ("cmccmc", (0, 0.5, 0.5, 1, 1.5, 1.5, 0), 2),  # one change to each neighbouring speed
    ],
)
def test_each_change_between_two_speeds_counts(kinds, speeds, changes):
    x = np.cumsum([0.0, *(3.0 * (kind == "m") for kind in kinds)])
    yaw = np.cumsum([0.0, *(np.pi / 2 * (kind == "t") for kind in kinds)])
    y = 0 * x
    if "t" in kinds:  # the second run goes up
        turned = kinds.index("t") + 1
        y[turned:] = x[turned:] - x[turned]
        x[turned:] = x[turned]
    states = States(x=x, y=y, yaw=yaw, speed=np.array(speeds, float))
    plan = Trajectory(ROBOT_SPEED_CHANGES, states, tuple(KINDS[kind] for kind in kinds))
    assert trajectory_cost(SpeedChanges(), plan, WORLD_SPEED_CHANGES) == changes
    executed = {"cmccmc": 1}.get(kinds, changes)  # two changes at one position are one ramp
    assert trajectory_cost(SpeedChanges(), plan.execution(), WORLD_SPEED_CHANGES) == executed


def test_neither_one_speed_nor_a_curve_changes_it():
    plan = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (3, 0, 0), (3, 4, 1)])
    curve = driven(DifferentialDrive(), (0, 0, 0), [(1, 0, 1), (0.5, 0.3, 1), (-0.5, 0, 3)])
    for one in (plan, plan.execution(), curve):
        assert trajectory_cost(SpeedChanges(), one, WORLD_SPEED_CHANGES) == 0


def test_it_is_a_count_of_comfort():
    assert (SpeedChanges.group, SpeedChanges.unit, SpeedChanges.quantum) == ("C", "1", 1.0)
