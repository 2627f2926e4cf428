"""Motion of base and camera: lengths of paths, angle between view and motion, acceleration, jerk, changes of speed."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import hpop
from hpop.base.math import angle_between
from hpop.criteria import (
    CameraLength,
    FeltAcceleration,
    HeadingMismatch,
    Jerk,
    Length,
    MeanHeadingMismatch,
    SpeedChanges,
    SquaredAcceleration,
    motion_costs,
    trajectory_cost,
)
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.models.driven import driven
from hpop.motions import Motions, States
from hpop.motions.symbolic import lift
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from tests.jointed import Jointed, agrees_everywhere, camera_at, tour

WORLD_LENGTH = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
ROBOT = DifferentialDrive(camera_offset=(0.5, 0.2))
points = st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=6)


@given(points)
def test_length_is_that_of_the_polyline_through_the_positions(where):
    trajectory = Trajectory.from_poses(ROBOT, [(x, y, 0.3) for x, y in where])
    expected = shapely.LineString(where).length if len(where) > 1 else 0.0
    assert trajectory_cost(Length(), trajectory, WORLD_LENGTH) == pytest.approx(expected, abs=1e-9)
    assert trajectory_cost(Length(), trajectory.execution(), WORLD_LENGTH) == pytest.approx(expected, abs=1e-5)


def test_turning_in_place_has_no_length_though_the_camera_swings():
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, np.pi / 2)])
    assert trajectory_cost(Length(), trajectory, WORLD_LENGTH) == 0.0


def test_length_is_a_comfort_criterion_in_metres():
    assert (Length.group, Length.unit, Length.aggregate, Length.smooth) == ("C", "m", "sum", True)


WORLD_CAMERA_LENGTH = hpop.World.from_polygons([], extent=shapely.box(-5, -5, 5, 5))


def test_in_a_hand_it_is_the_length_of_the_places_one_after_another():
    trajectory = tour(Jointed())
    place, _ = camera_at(trajectory, np.linspace(0, trajectory.duration, 1_001))
    expected = np.linalg.norm(np.diff(place, axis=1), axis=0).sum()
    assert agrees_everywhere(CameraLength(), Jointed(), WORLD_CAMERA_LENGTH) == pytest.approx(expected, rel=1e-4)


def test_a_turn_of_the_base_swings_a_camera_beside_its_axis():
    model = hpop.DifferentialDrive(camera_offset=(0.3, -0.4))
    walk = hpop.Trajectory.from_poses(model, [(0, 0, 0), (2, 0, 0), (2, 0, 1.2)])
    assert trajectory_cost(CameraLength(), walk, WORLD_CAMERA_LENGTH) == pytest.approx(2.0 + 0.5 * 1.2)


def test_what_it_declares():
    assert (CameraLength.group, CameraLength.unit, CameraLength.aggregate) == ("C", "m", "sum")


WORLD_HEADING_MISMATCH = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))
SQUARE = [(0, 0, 0), (3, 0, np.pi / 2), (3, 4, np.pi / 2)]  # 3 m east, 4 m north


def driving(*poses, unwound=None, **robot):
    model = DifferentialDrive(speed=0.5, **robot)
    return Trajectory.from_poses(model if unwound is None else hpop.ViewModel(model, yaw=unwound), poses)


def cost(trajectory, criterion=None):
    return trajectory_cost(criterion or HeadingMismatch(), trajectory, WORLD_HEADING_MISMATCH)


def test_who_looks_where_she_is_driven_pays_nothing():
    assert cost(driving(*SQUARE)) == pytest.approx(0.0, abs=1e-12)
    curve = driven(DifferentialDrive(), (0, 0, 0.3), [(1, 0.6, 1), (0, -1, 2), (-1, 0.2, 1)])
    assert cost(curve) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("view_yaw", [0.0, 0.4, -2.5, 9.0])
def test_a_view_that_stays_pays_the_angle_to_each_way_for_as_long_as_it_lasts(view_yaw):
    off = [abs(np.angle(np.exp(1j * (heading - view_yaw)))) for heading in (0.0, np.pi / 2)]
    path = driving(*SQUARE, unwound=view_yaw)
    expected = off[0] * 3 / 0.5 + off[1] * 4 / 0.5
    assert cost(path) == pytest.approx(expected, rel=1e-9)
    assert cost(path, MeanHeadingMismatch()) == pytest.approx(expected / path.duration, rel=1e-9)


def test_a_turn_about_the_camera_moves_it_nowhere_and_one_beside_it_swings_it_sideways():
    poses = [(0, 0, 0), (0, 0, 2.0)]
    assert cost(driving(*poses)) == 0.0
    # 0.2 m ahead of the axis it goes to the left: a right angle, while it is faster than slow; the turn itself lasts
    # 2 / 1.5 + 1.5 / 3 s, of which it is slower than 0.1 m/s, 0.5 rad/s, for 1/6 s at either end, half of that counted.
    swung = driving(*poses, camera_offset=(0.2, 0.0))
    assert cost(swung) == pytest.approx(np.pi / 2 * (2 / 1.5 + 1.5 / 3 - 1 / 6), rel=1e-2)


def test_a_motion_slower_than_slow_counts_in_proportion():
    path = driving((0, 0, 0), (1, 0, 0), unwound=np.pi)
    for slow, share in ((0.5, 1.0), (1.0, 0.5), (5.0, 0.1)):
        assert cost(path, HeadingMismatch(slow=slow)) == pytest.approx(share * np.pi * 1 / 0.5, rel=1e-9)


def test_the_angle_is_one_in_space():
    down = np.array([np.cos(0.6)]), 0.0, np.array([-np.sin(0.6)])
    v = np.array([0.3])
    for velocity, angle in (
        ((v, 0.0, 0.0), 0.6),
        ((0.0, v, 0.0), np.pi / 2),
        ((0.0, 0.0, v), np.pi / 2 + 0.6),
        ((0.0 * v, 0.0 * v, 0.0), 0.0),
    ):
        assert angle_between(down, velocity) == pytest.approx([angle])
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 3, 50))
    one /= np.linalg.norm(one, axis=0)
    expected = np.arccos(np.sum(one * other, axis=0) / np.linalg.norm(other, axis=0))
    np.testing.assert_allclose(angle_between(tuple(one), tuple(other)), expected, atol=1e-9)


def test_on_symbols_it_has_the_values_and_the_gradient_of_numbers():
    model = hpop.ViewModel(yaw=0.3)
    ends = np.array([1.0, 0.4, -0.7, 0.9])  # x, y of two moves from the origin

    def of(columns):
        zeros = 0.0 * columns[0]
        start = States(x=zeros, y=zeros, yaw=zeros)
        return Motions(
            WORLD_HEADING_MISMATCH, model, model.laws["move"], start, States(x=columns[0], y=columns[1], yaw=zeros)
        )

    def number(e):
        return motion_costs(HeadingMismatch(), of((e[::2], e[1::2]))).sum()

    x, y = casadi.MX.sym("x", 2), casadi.MX.sym("y", 2)
    total = casadi.sum1(casadi.MX(HeadingMismatch().cost(of((lift(x, 2), lift(y, 2))))))
    f = casadi.Function("f", [x, y], [total, casadi.gradient(total, x), casadi.gradient(total, y)])
    value, gx, gy = (np.array(part).ravel() for part in f(ends[::2], ends[1::2]))
    assert value == pytest.approx(number(ends), rel=1e-9)
    steps = 1e-6 * np.eye(4)
    slopes = np.array([(number(ends + s) - number(ends - s)) / 2e-6 for s in steps])
    np.testing.assert_allclose(np.stack([gx, gy], axis=1).ravel(), slopes, rtol=1e-5)


def test_the_mean_stands_for_its_integral():
    assert MeanHeadingMismatch(0.2).integral == HeadingMismatch(0.2)
    assert (HeadingMismatch.unit, HeadingMismatch.aggregate) == ("rad s", "sum")
    assert (MeanHeadingMismatch.unit, MeanHeadingMismatch.aggregate) == ("rad", "time-mean")


@pytest.mark.parametrize("slow", [0.0, -1.0, np.nan, np.inf])
def test_bad_parameters_are_named(slow):
    with pytest.raises(CriterionError, match="slow must be a speed"):
        HeadingMismatch(slow=slow)


@pytest.mark.parametrize(("angle", "rate", "change"), [(0.138, 2.1, 7.25), (0.02, 1.5, 3.0), (2.0, 0.3, 0.5)])
def test_a_camera_that_a_turn_swings_round_counts_by_its_speed_on_ramps_too(angle, rate, change):
    """From rest r alpha t rises to 0.1 m/s, counted in proportion; view and swing keep their angle."""
    ahead, left = -0.25, 0.49
    robot = DifferentialDrive(turn_rate=rate, turn_acceleration=change, camera_offset=(ahead, left))
    turn = Trajectory.from_poses(robot, [(0, 0, 0), (0, 0, angle)])
    ramp = min(rate / change, math.sqrt(angle / change))
    cruise = (angle - change * ramp**2) / rate
    radius = math.hypot(ahead, left)
    slow = min(ramp, 0.1 / (radius * change))
    counted = 2 * (radius * change * slow**2 / 0.2 + ramp - slow) + cruise * min(radius * change * ramp / 0.1, 1)
    expected = abs(math.atan2(ahead, -left)) * counted
    assert cost(turn) == pytest.approx(expected, rel=2e-3)


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
