"""Sampled poses are the model's, at the times that were asked for, and their rates are the derivatives of that."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import hpop
from hpop.errors import OptionError
from hpop.motions import States
from hpop.trajectories.poses import on_one_side, poses, quaternions_of
from hpop.trajectories.trajectory import Trajectory
from tests.jointed import Jointed
from tests.models.serial_arm.arms import arm6
from tests.view.robots import Lift, Reacher

GOES = Trajectory.from_poses(hpop.DifferentialDrive(camera_offset=(0.2, -0.1)), [(1, 1, 0), (5, 1, 0), (5, 5, 3)])


def through(model, *rows):
    return Trajectory.through(model, States(**dict(zip(model.space.names, np.array(rows, float).T, strict=True))))


ROBOTS = {
    "differential drive": GOES,
    "with a hold": GOES.with_hold(at=2, seconds=1.3),
    "whose view is turned back": Trajectory.from_poses(hpop.ViewModel(yaw=0.7), [(0, 0, 0), (1, 1, 2)]),
    "pan-tilt": through(hpop.PanTilt(), (1, 1, 0, 0, 0), (2, 1, 1, 1, 0.2), (2, 1, 1, -2, -0.3)),
    "serial arm": through(arm6(), (0.1,) * 6, (0.4,) * 6, (0.2,) * 6),
    "mobile arm": through(hpop.MobileArm(arm6()), (1, 1, 0, *(0.1,) * 6), (2, 2, 3, *(0.4,) * 6)),
    "of no class of the house": through(Jointed(), (0, 0, 0), (1, 0.5, 0.5)),
    "of upright parts": through(Lift(), (1, 1, 0, 0), (2, 1, 1, 1)),
}
BODIES = {"mobile arm": ["base", "camera", "tool"], "differential drive": ["base", "camera"]}
CASES = [(name, body) for name in ROBOTS for body in BODIES.get(name, ["camera"])]


def rows(vector, size):
    return np.stack([np.broadcast_to(column, (size,)) for column in vector], axis=1)


def matrices(trajectory, body, times):
    """Axes of a body as columns, of the model itself."""
    pose = trajectory.model.pose(body, trajectory.at(times))
    return np.stack([rows(axis, times.size) for axis in (pose.ahead, pose.left, pose.up)], axis=2)


@pytest.mark.parametrize(("robot", "body"), CASES)
@pytest.mark.parametrize("planned", [False, True], ids=["executed", "planned"])
def test_they_are_the_models_poses_and_their_rates_are_the_derivatives(robot, body, planned):
    trajectory = ROBOTS[robot]
    found = poses(trajectory, body=body, planned=planned)
    run = trajectory if planned else trajectory.execution()
    assert (found.times[0], found.times[-1]) == (0.0, run.duration)
    np.testing.assert_allclose(np.diff(found.times)[:-1], 0.05)
    assert 0.0005 <= found.times[-1] - found.times[-2] <= 0.0505
    pose = run.model.pose(body, run.at(found.times))
    np.testing.assert_allclose(found.positions, rows((pose.x, pose.y, pose.z), len(found)), atol=1e-12)
    axes = matrices(run, body, found.times)
    np.testing.assert_allclose(Rotation.from_quat(found.quaternions).as_matrix(), axes, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(found.quaternions, axis=1), 1.0, atol=1e-12)
    assert found.quaternions[0, 3] >= 0.0
    assert (np.sum(found.quaternions[1:] * found.quaternions[:-1], axis=1) >= 0.0).all()
    np.testing.assert_allclose(np.exp(1j * found.yaws), np.exp(1j * np.broadcast_to(pose.yaw, len(found))), atol=1e-12)
    assert (np.abs(np.diff(found.yaws)) <= np.pi + 1e-9).all()  # half a turn where it looks straight up

    moment, ends = 1e-5, run.times
    inside = np.flatnonzero(np.abs(found.times[:, None] - ends).min(axis=1) > 0.1)
    at = found.times[inside]
    before, after = (run.model.pose(body, run.at(at + shift)) for shift in (-moment, moment))
    moved = rows((after.x - before.x, after.y - before.y, after.z - before.z), at.size) / (2 * moment)
    np.testing.assert_allclose(found.velocities[inside], moved, atol=1e-4)
    np.testing.assert_allclose(found.speeds[inside], np.sum(moved * axes[inside, :, 0], axis=1), atol=1e-4)
    several = [Rotation.from_matrix(matrices(run, body, at + shift)) for shift in (-moment, moment)]
    turned = (several[1] * several[0].inv()).as_rotvec() / (2 * moment)
    np.testing.assert_allclose(found.rotations[inside], turned, atol=1e-4)
    np.testing.assert_array_equal(found.yaw_rates, found.rotations[:, 2])


def test_an_execution_begins_and_ends_at_rest_and_what_is_planned_does_not():
    run, plan = poses(GOES), poses(GOES, planned=True)
    assert run.speeds[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert plan.speeds[0] == pytest.approx(1.0)
    assert (run.planned, plan.planned) == (False, True)
    assert run.times[-1] == pytest.approx(GOES.execution().duration)
    assert plan.times[-1] == pytest.approx(GOES.duration)


@pytest.mark.parametrize("rate", [0.1, 0.7, 2.0, 30.0])
def test_yaw_is_continuous_at_any_rate_and_however_often_it_goes_round(rate):
    """A waist without end stops turns five times round, and a base three times; both are known by their states."""
    waist = np.linspace(0.0, 10.0 * np.pi, 16)
    arm = Trajectory(Reacher(), States(waist=waist, shoulder=0.0 * waist), ("reach",) * 15)
    yaw = np.linspace(0.0, -6.0 * np.pi, 10)
    base = Trajectory(hpop.DifferentialDrive(), States(x=0.0 * yaw, y=0.0 * yaw, yaw=yaw), ("turn",) * 9)
    for run, ends, body in ((arm, waist[-1], "camera"), (base, yaw[-1], "base")):
        found = poses(run, rate=rate, body=body)
        assert found.yaws[[0, -1]] == pytest.approx([0.0, ends])
        assert (np.diff(found.yaws) * np.sign(ends) >= -1e-9).all()


def test_the_yaw_of_an_arms_camera_is_continuous_where_its_angle_wraps():
    model = Jointed(yaw=3.0)  # its yaw is an arctangent: from 3 to 3.8 rad it jumps
    found = poses(through(model, (0, 0, 0), (0.8, 0, 0)), rate=5)
    assert found.yaws[[0, -1]] == pytest.approx([3.0, 3.8])


def test_a_robot_that_stays_has_one_pose():
    found = poses(Trajectory.from_poses(hpop.DifferentialDrive(), [(2, 3, np.pi)]))
    assert found.times.tolist() == [0.0]
    np.testing.assert_allclose(found.positions, [[2.0, 3.0, 1.2]])
    np.testing.assert_allclose(np.abs(found.quaternions), [[0.0, 0.0, 1.0, 0.0]], atol=1e-15)
    assert "1 of the camera in 0.000 s, as executed" in repr(found)


@given(st.floats(1e-9, 50.0), st.floats(0.2, 200.0))
def test_the_times_are_those_of_the_rate_and_the_end(lasts, rate):
    standing = Trajectory.from_poses(hpop.DifferentialDrive(), [(0, 0, 0)]).with_hold(at=0, seconds=max(lasts, 1e-6))
    times = poses(standing, rate=rate).times
    assert (times[0], times[-1]) == (0.0, standing.duration)
    assert (np.diff(times) > 0.0).all()
    assert (np.diff(times) <= (1.01 + 1e-9) / rate).all()
    np.testing.assert_allclose(times[:-1] * rate, np.arange(times.size - 1), rtol=1e-12)


@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 4), min_size=1, max_size=30))
def test_quaternions_are_those_of_the_axes_whichever_of_the_four_is_large(numbers):
    given_ = np.array([q if np.linalg.norm(q) > 1e-3 else (0, 0, 0, 1) for q in numbers], float)
    rotations = Rotation.from_quat(given_)
    found = on_one_side(quaternions_of(rotations.as_matrix()))
    same = np.abs(np.sum(found * rotations.as_quat(), axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    assert found[0, 3] >= 0.0
    assert (np.sum(found[1:] * found[:-1], axis=1) >= 0.0).all()


def test_poses_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        poses(GOES).positions[0] = 0.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rate": 0}, "rate must be a number of poses a second, in Hz, from 1e-06 to 1,000,000, got 0"),
        ({"rate": "fast"}, "got 'fast'"),
        ({"rate": 1e6}, "at most 1,000,000 poses, but 1e\\+06 Hz gives more in 1[0-9.]+ s; choose a lower rate"),
        ({"body": "tool"}, r"no body 'tool'\. body must be one of base, camera$"),
        ({"body": "camara"}, "Did you mean 'camera'"),
    ],
)
def test_what_makes_no_sense_is_refused(options, said):
    with pytest.raises(OptionError, match=said):
        poses(GOES, **options)


def test_a_law_is_no_body():
    with pytest.raises(OptionError, match=r"body must be one of camera, tool$"):
        poses(ROBOTS["serial arm"], body="spline")
