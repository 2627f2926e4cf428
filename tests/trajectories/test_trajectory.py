"""Trajectories: timing laws, sampling, execution, wheels, and what cannot be a trajectory."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from hpop.criteria.base import make_criterion
from hpop.criteria.costs import motion_costs, trajectory_cost, trajectory_costs
from hpop.errors import ModelError, OptionError
from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.motions.by_law import batches
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

ROBOT = DifferentialDrive(speed=0.7, acceleration=0.9, turn_rate=1.1, turn_acceleration=2.0, wheel_base=0.5)
WORLD = World.from_polygons([shapely.box(4, 4, 5, 5)], extent=shapely.box(-20, -20, 20, 20))

coordinate = st.integers(-12, 12).map(lambda i: i / 2)
poses = st.lists(st.tuples(coordinate, coordinate, st.floats(-7.0, 7.0)), min_size=1, max_size=6)


def turn_time(robot, angle):
    ramped = robot.turn_rate**2 / robot.turn_acceleration
    if angle < ramped:
        return 2 * np.sqrt(angle / robot.turn_acceleration)
    return angle / robot.turn_rate + robot.turn_rate / robot.turn_acceleration


def states(*rows):
    return States(**dict(zip(("x", "y", "yaw"), np.array(rows, float).T, strict=True)))


def test_a_move_lasts_its_length_over_speed_and_a_turn_its_rest_to_rest_time_and_the_loss():
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0), (3, 0, 0.2), (3, 0, 2.2)])
    assert trajectory.kinds == ("move", "turn", "turn")
    loss = 0.7 / 0.9
    expected = [3 / 0.7, turn_time(ROBOT, 0.2) + loss, turn_time(ROBOT, 2.0) + loss]
    assert trajectory.durations == pytest.approx(expected, rel=1e-12)
    assert trajectory.duration == pytest.approx(sum(expected))


def test_a_3_4_5_triangle():
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0), (3, 4, np.pi / 2), (0, 0, 0)])
    assert trajectory.kinds == ("move", "turn", "move", "turn", "move", "turn")
    costs = {n: trajectory_cost(make_criterion(n), trajectory, WORLD) for n in ("length", "turns", "rotation")}
    assert costs["length"] == pytest.approx(12.0, rel=1e-15)
    assert costs["turns"] == 3
    # Exterior angles of any triangle that is walked round once add up to a full turn.
    assert costs["rotation"] == pytest.approx(2 * np.pi)
    assert trajectory.states.yaw[-1] == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("time", [np.nan, [0.0, np.nan], "soon", None, [[0.0, 1.0]]])
def test_what_is_no_time_is_refused(time):
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0)])
    for sample in (trajectory.at, trajectory.rates):
        with pytest.raises(OptionError, match=r"expected a time in s, or times \(N,\)"):
            sample(time)


def test_before_all_time_it_stands_at_the_start_and_after_it_at_the_goal():
    assert Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0)]).at([-np.inf, np.inf]).x.tolist() == [0.0, 3.0]


@pytest.mark.parametrize("wrong", [[], 3, "x", [(0, 0)], [(0, 0, 0), None]])
def test_what_are_no_poses_is_refused(wrong):
    with pytest.raises(ModelError, match=r"at least one pose \(x m, y m, yaw rad\), got"):
        Trajectory.from_poses(ROBOT, wrong)


def test_a_trajectory_is_told_in_one_line():
    trajectory = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (3, 0, 0), (5, 0, 0)])
    assert repr(trajectory) == "<Trajectory: 2 motions (2 move), 5.000 s>"
    assert repr(Trajectory.from_poses(ROBOT, [(1, 2, 3)])) == "<Trajectory: 0 motions (start is goal), 0.000 s>"


def test_start_is_goal():
    trajectory = Trajectory.from_poses(ROBOT, [(1, 2, 3)])
    assert len(trajectory) == 0
    assert trajectory.duration == 0.0
    sampled = trajectory.at([-1.0, 0.0, 5.0])
    assert (sampled.x.tolist(), sampled.yaw.tolist()) == ([1.0] * 3, [3.0] * 3)
    assert trajectory.rates(0.0)[0].x.tolist() == [0.0]
    assert trajectory.execution().kinds == ()
    names = ("length", "turns", "obstruction", "clearance", "duration")
    criteria = [make_criterion(name) for name in names]
    assert trajectory_costs(criteria, [trajectory], WORLD).tolist() == [[0.0] * 5]
    assert list(batches([trajectory], WORLD)) == list(batches([], WORLD)) == []


@given(poses)
def test_from_poses_visits_every_pose_and_yaw_is_continuous(where):
    trajectory = Trajectory.from_poses(ROBOT, where)
    s = trajectory.states
    for x, y, yaw in where:
        near = np.hypot(s.x - x, s.y - y) + np.abs(np.exp(1j * s.yaw) - np.exp(1j * yaw))
        assert near.min() < 1e-5
    assert np.abs(np.diff(s.yaw)).max(initial=0.0) <= np.pi + 1e-12
    for i, kind in enumerate(trajectory.kinds):
        dx, dy = s.x[i + 1] - s.x[i], s.y[i + 1] - s.y[i]
        if kind == "turn":
            assert (dx, dy) == (0.0, 0.0)
        else:  # moves go where the robot looks
            assert dx * np.cos(s.yaw[i]) + dy * np.sin(s.yaw[i]) == pytest.approx(np.hypot(dx, dy))


@pytest.mark.parametrize("execute", [False, True])
@given(where=poses.filter(lambda p: len(p) > 1), data=st.data())
def test_rates_are_the_derivatives_of_the_states(execute, where, data):
    trajectory = Trajectory.from_poses(ROBOT, where)
    trajectory = trajectory.execution() if execute else trajectory
    t, h = data.draw(st.floats(0.0, 1.0)) * trajectory.duration, 1e-4
    velocity, acceleration = trajectory.rates([t])
    before, middle, after = (trajectory.rates([t + d])[1] for d in (-h, 0, h))
    for name in ("x", "y", "yaw"):
        if t < h or t > trajectory.duration - h:
            continue
        if len({getattr(part, name)[0] for part in (before, middle, after)}) > 1:
            continue  # a change of phase within the difference
        slow, here, fast = (getattr(trajectory.at([t + d]), name)[0] for d in (-h, 0, h))
        if not execute and abs((fast - here) - (here - slow)) > 1e-4 * h:
            continue  # the planning law changes speed at once
        assert (fast - slow) / (2 * h) == pytest.approx(getattr(velocity, name)[0], abs=1e-6)
        change = (fast - 2 * here + slow) / h**2
        assert change == pytest.approx(getattr(acceleration, name)[0], abs=1e-4)


@given(where=poses, fraction=st.floats(-0.5, 1.5))
def test_samples_are_continuous_and_stand_before_the_start_and_after_the_goal(where, fraction):
    for trajectory in (Trajectory.from_poses(ROBOT, where), Trajectory.from_poses(ROBOT, where).execution()):
        t = fraction * trajectory.duration
        here, next_ = trajectory.at(np.array([t, t + 1e-6])), trajectory.states
        assert abs(np.diff(here.x)[0]) <= 0.7e-6 * (1 + 1e-6) + 1e-12
        assert abs(np.diff(here.yaw)[0]) <= 1.1e-6 * (1 + 1e-6) + 1e-12
        for end, outside in ((0, -3.0), (-1, trajectory.duration + 3.0)):
            assert trajectory.at(outside).x[0] == pytest.approx(next_.x[end], abs=1e-12)
            assert trajectory.at(outside).yaw[0] == pytest.approx(next_.yaw[end], abs=1e-12)
        assert trajectory.at(trajectory.times).y == pytest.approx(next_.y, abs=1e-9)


def test_a_turn_stands_half_the_loss_before_and_half_after():
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, 1.0)])
    half = 0.5 * 0.7 / 0.9
    T = trajectory.duration
    yaw = trajectory.at([half - 1e-3, half + 1e-2, T / 2, T - half - 1e-2, T - half + 1e-3]).yaw
    assert yaw[0] == 0.0
    assert 0.0 < yaw[1] < yaw[3] < 1.0
    assert yaw[2] == pytest.approx(0.5)
    assert yaw[4] == 1.0


@given(st.lists(st.tuples(st.floats(0.6, 5.0), st.floats(0.05, 3.1), st.booleans()), min_size=1, max_size=6))
def test_an_execution_lasts_the_plan_and_one_ramp_if_runs_are_long_and_the_ends_are_straight(legs):
    x = y = yaw = 0.0
    where = [(x, y, yaw)]
    for i, (length, angle, left) in enumerate(legs):  # 0.6 m >= v²/a = 0.54 m
        yaw += (angle if left else -angle) * (i > 0)
        x, y = x + length * np.cos(yaw), y + length * np.sin(yaw)
        where.append((x, y, yaw))
    planned = Trajectory.from_poses(ROBOT, where)
    assert planned.kinds[0] == planned.kinds[-1] == "move"
    assert planned.execution().duration == pytest.approx(planned.duration + 0.7 / 0.9, rel=1e-9)


@given(poses)
def test_an_execution_is_never_longer_than_the_plan_and_one_ramp(where):
    planned = Trajectory.from_poses(ROBOT, where)
    executed = planned.execution()
    assert executed.duration <= planned.duration + 0.7 / 0.9 + 1e-9
    assert set(executed.kinds) <= {"run", "spin"}
    names = ("length", "rotation")
    for name in names:
        same = [trajectory_cost(make_criterion(name), t, WORLD) for t in (planned, executed)]
        assert same[0] == pytest.approx(same[1], abs=1e-4)


def test_moves_in_one_line_become_one_run_and_others_do_not():
    straight = Trajectory.from_poses(
        ROBOT, [(0, 0, 0.5), *((i * np.cos(0.5), i * np.sin(0.5), 0.5) for i in (1, 2, 5))]
    )
    assert straight.kinds == ("move",) * 3
    executed = straight.execution()
    assert executed.kinds == ("run",)
    assert executed.duration == pytest.approx(5 / 0.7 + 0.7 / 0.9)
    assert executed.execution().kinds == ("run",)
    corner = Trajectory.from_poses(ROBOT, [(0, 0, 0), (1, 0, 0), (1, 1, np.pi / 2)])
    assert corner.execution().kinds == ("run", "spin", "run")


@given(poses.filter(lambda p: Trajectory.from_poses(ROBOT, p).duration > 0))
def test_wheels_stay_within_limits_and_integrate_back_to_the_path(where):
    executed = Trajectory.from_poses(ROBOT, where).execution()
    edges = np.linspace(0.0, executed.duration, 20001)
    track = ROBOT.wheels(executed, (edges[1:] + edges[:-1]) / 2)
    half = 0.25
    v, omega = (track.left_speed + track.right_speed) / 2, (track.right_speed - track.left_speed) / (2 * half)
    speed_limit, turn_limit = max(0.7, 1.1 * half), max(0.9, 2.0 * half)
    for side in ("left", "right"):
        assert np.abs(getattr(track, f"{side}_speed")).max() <= speed_limit + 1e-9
        assert np.abs(getattr(track, f"{side}_acceleration")).max() <= turn_limit + 1e-9
    assert (v >= -1e-9).all()  # it never drives backwards
    dt = np.diff(edges)
    yaw = executed.states.yaw[0] + np.cumsum(omega * dt)
    assert yaw[-1] == pytest.approx(executed.states.yaw[-1], abs=1e-2)
    middle = yaw - omega * dt / 2
    x, y = (
        executed.states.x[0] + (v * np.cos(middle) * dt).sum(),
        executed.states.y[0] + (v * np.sin(middle) * dt).sum(),
    )
    assert (x, y) == pytest.approx((executed.states.x[-1], executed.states.y[-1]), abs=3e-2)
    # Accelerations integrate to speeds, but for the intervals in which a ramp begins or ends.
    ramp_ends = 4 * len(executed)
    for side in ("left", "right"):
        gained = np.cumsum(getattr(track, f"{side}_acceleration") * dt)
        assert np.abs(gained - getattr(track, f"{side}_speed")).max() <= (ramp_ends + 1) * turn_limit * dt.max()


@given(st.lists(poses, min_size=1, max_size=4))
@settings(max_examples=settings.default.max_examples // 2)
def test_batches_over_many_trajectories_add_up_to_the_values_of_each(many):
    trajectories = [Trajectory.from_poses(ROBOT, where) for where in many]
    criteria = [make_criterion(n) for n in ("length", "turns", "duration", "obstruction", "clearance")]
    together = trajectory_costs(criteria, trajectories, WORLD)
    for row, trajectory in zip(together, trajectories, strict=True):
        single = np.zeros((len(trajectory), len(criteria)))
        for i in range(len(trajectory)):
            part = trajectory.states.take(slice(i, i + 2))
            for _, motions in Trajectory(ROBOT, part, trajectory.kinds[i : i + 1]).batches(WORLD):
                single[i] = [motion_costs(c, motions)[0] for c in criteria]
        expected = single.sum(axis=0)
        expected[3] /= max(trajectory.duration, 1e-300)
        expected[4] = single[:, 4].max(initial=0.0)
        assert row == pytest.approx(expected, rel=1e-9, abs=1e-12)
        assert row[2] == pytest.approx(trajectory.duration)


def test_batches_know_the_time_at_which_each_motion_starts():
    trajectory = Trajectory.from_poses(ROBOT, [(0, 0, 0), (3, 0, 0), (3, 4, np.pi / 2), (0, 0, 0)])
    seen = np.full(len(trajectory), np.nan)
    for index, motions in trajectory.batches(WORLD):
        seen[index] = motions.t0
    assert seen.tolist() == trajectory.times[:-1].tolist()


@given(poses)
def test_a_description_survives_json_exactly(where):
    trajectory = Trajectory.from_poses(ROBOT, where)
    again = Trajectory.from_description(ROBOT, json.loads(json.dumps(trajectory.describe())))
    assert again.kinds == trajectory.kinds
    for name in ("x", "y", "yaw"):
        assert getattr(again.states, name).tolist() == getattr(trajectory.states, name).tolist()


@pytest.mark.parametrize(
    ("given_states", "kinds", "message"),
    [
        (States(x=np.zeros(2), y=np.zeros(2)), ("move",), "need states with the columns"),
        (states((0, 0, 0), (1, 0, 0)), ("move", "turn"), "2 motions need 3 states"),
        (states((0, 0, 0), (1, 0, np.nan)), ("move",), "finite"),
        (states((0, 0, 0), (1, 0, np.inf)), ("move",), "finite"),
        (states((0, 0, 0), (1, 0, 0)), ("fly",), "must be motion laws"),
        (states((0, 0, 0), (1, 0, 1)), ("move",), "a move must not change yaw"),
        (states((0, 0, 0), (0, 1, 1)), ("turn",), "a turn must not change y"),
        (states((0, 0, 0), (1, 0, 0), (5, 0, 1)), ("run", "spin"), "a spin must not change x"),
    ],
)
def test_what_is_no_trajectory_is_refused(given_states, kinds, message):
    with pytest.raises(ModelError, match=message):
        Trajectory(ROBOT, given_states, kinds)


def test_no_poses_make_no_trajectory():
    with pytest.raises(ModelError, match="at least one pose"):
        Trajectory.from_poses(ROBOT, [])


@pytest.mark.parametrize(
    "description",
    [
        {},
        {"kinds": []},
        None,
        {"kinds": ["move"], "states": []},
        {"kinds": ["move"], "states": {"x": ["a"]}},
        {"kinds": 3, "states": {}},
        {"kinds": ["move"], "states": {"x": [0, 1], "y": [0, 0], "yaw": [0]}},
    ],
)
def test_what_describes_no_trajectory_is_refused(description):
    with pytest.raises(ModelError):
        Trajectory.from_description(ROBOT, description)


def test_a_trajectory_is_frozen_and_keeps_a_copy():
    x = np.array([0.0, 1.0])
    trajectory = Trajectory(ROBOT, States(x=x, y=np.zeros(2), yaw=np.zeros(2)), ("move",))
    x[1] = 9.0
    assert trajectory.states.x[1] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.states.x[1] = 2.0


def test_a_trajectory_goes_through_states_as_the_model_connects_them():
    """With the turns and moves of a path through poses; half a turn and more adds up without a jump."""
    poses = [(0.0, 0.0, 3.0), (2.0, 0.0, -3.0), (2.0, 3.0, -2.0), (2.0, 3.0, 1.0)]
    columns = np.array(poses).T
    states = States(**dict(zip(("x", "y", "yaw"), columns, strict=True)))
    through, expected = (
        Trajectory.through(DifferentialDrive(), states),
        Trajectory.from_poses(DifferentialDrive(), poses),
    )
    assert through.kinds == expected.kinds
    for name in ("x", "y", "yaw"):
        np.testing.assert_allclose(getattr(through.states, name), getattr(expected.states, name), atol=1e-12)
    with pytest.raises(ModelError, match=r"with the columns \(x m, y m, yaw rad\) of its model, got <States: 1 of x>"):
        Trajectory.through(DifferentialDrive(), States(x=np.zeros(1)))
