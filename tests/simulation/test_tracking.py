"""Tracking of a plan: on the plan, within the limits of the base, braking as asked."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hpop
from hpop.errors import ModelError
from hpop.simulation import Command, DriveLimits, Tracker
from tests.models.serial_arm.arms import arm6

STEP = 0.02  # s
ROBOT = hpop.DifferentialDrive(radius=0.3)
PLAN = hpop.Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0), (3, 2, 1.0), (1, 4, -2.0)])


def moved(pose: tuple[float, float, float], command: Command) -> tuple[float, float, float]:
    """Return the pose of a perfect base after one step."""
    x, y, yaw = pose
    middle = yaw + 0.5 * STEP * command.w
    return (
        x + STEP * command.v * math.cos(middle),
        y + STEP * command.v * math.sin(middle),
        yaw + STEP * command.w,
    )


def test_a_perfect_base_drives_the_plan_in_its_time_and_within_all_limits() -> None:
    tracker, t, pose, last = Tracker(PLAN), 0.0, (0.0, 0.0, 0.0), Command(0.0, 0.0)
    while not tracker.finished(t):
        command = tracker.command(t, pose)
        dv, dw = abs(command.v - last.v), abs(command.w - last.w)
        assert abs(command.v) + 0.5 * ROBOT.wheel_base * abs(command.w) <= ROBOT.wheel_speed + 1e-9
        assert abs(command.w) <= ROBOT.turn_rate + 1e-9
        assert dv <= ROBOT.acceleration * STEP + 1e-9
        assert dw <= ROBOT.turn_acceleration * STEP + 1e-9
        assert dv + 0.5 * ROBOT.wheel_base * dw <= ROBOT.wheel_acceleration * STEP + 1e-9
        pose, last, t = moved(pose, command), command, t + STEP
        assert tracker.off(t, pose) < 0.05
    assert t < PLAN.execution().duration + 0.5
    assert np.hypot(pose[0] - 1, pose[1] - 4) < 0.02


@pytest.mark.parametrize("begins", [0.3, 1.5, 2.9, 4.0, 6.0])
def test_braking_stops_on_the_plan_at_the_deceleration_and_the_drive_goes_on_from_there(begins: float) -> None:
    tracker, t, pose = Tracker(PLAN), 0.0, (0.0, 0.0, 0.0)
    speeds = list[float]()
    while t < begins:
        command = tracker.command(t, pose)
        pose, t = moved(pose, command), t + STEP
    tracker.stop()
    before = command
    while t < begins + 2.0:
        command = tracker.command(t, pose)
        speeds.append(command.v)
        pose, t = moved(pose, command), t + STEP
        assert tracker.off(t, pose) < 0.05
    assert command == (0.0, 0.0)
    least = max(before.v / ROBOT.acceleration, abs(before.w) / ROBOT.turn_acceleration)
    assert STEP * np.count_nonzero(speeds) <= least + 3 * STEP
    tracker.go()
    while not tracker.finished(t) and t < 60.0:
        pose, t = moved(pose, tracker.command(t, pose)), t + STEP
        assert tracker.off(t, pose) < 0.05
    assert np.hypot(pose[0] - 1, pose[1] - 4) < 0.02


def test_a_robot_that_is_held_up_makes_up_for_it_where_the_plan_stands() -> None:
    plan = PLAN.with_hold(at=1, seconds=5.0)
    tracker, t, pose = Tracker(plan), 0.0, (0.0, 0.0, 0.0)
    while t < 4.0:
        if t > 2.0:
            tracker.go()
        elif t > 1.0:
            tracker.stop()
        pose, t = moved(pose, tracker.command(t, pose)), t + STEP
    assert tracker.late > 0.9
    while t < 8.0:
        pose, t = moved(pose, tracker.command(t, pose)), t + STEP
    assert tracker.late < 0.05


def test_a_base_that_is_faster_than_its_plan_catches_up() -> None:
    slow = hpop.DifferentialDrive(speed=0.8, acceleration=0.8, turn_rate=1.2, turn_acceleration=2.0)
    plan = hpop.Trajectory.from_poses(slow, [(0, 0, 0), (9, 0, 0)])
    tracker, t, pose = Tracker(plan, limits=DriveLimits.of(ROBOT)), 0.0, (0.0, 0.0, 0.0)
    while not tracker.finished(t):
        tracker.stop() if 2.0 < t < 2.5 else tracker.go()
        pose, t = moved(pose, tracker.command(t, pose)), t + STEP
    assert t < plan.execution().duration + 0.1


def test_a_robot_without_wheels_is_refused() -> None:
    with pytest.raises(ModelError, match="drives straight ahead"):
        DriveLimits.of(arm6())
