"""A trajectory as a nav_msgs/Path and back, by rosbags' serialisation; poses and paths that are none."""

from __future__ import annotations

import copy
import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

import hpop
from hpop.errors import ModelError, OptionError, RosError
from hpop.ros import PlanarPose, path_message, plain, planar_pose, pose_message, trajectory_of, typed
from hpop.trajectories.trajectory import Trajectory
from tests.export.given import DRIVE, robots

PATH = "nav_msgs/msg/Path"

types = cache(get_typestore)  # what serialises is made once


def through_ros(message, kind=PATH, distribution=Stores.ROS2_JAZZY):
    """Serialise a message as ROS does, and read it again."""
    store = types(distribution)
    data = store.serialize_cdr(typed(message, kind, store), kind)
    return plain(store.deserialize_cdr(data, kind))


def same(found, asked):
    assert found.kinds == asked.kinds
    for name in asked.states.names:
        np.testing.assert_allclose(getattr(found.states, name), getattr(asked.states, name), atol=2e-9)
    np.testing.assert_allclose(found.times, asked.times, atol=1e-8)


steps = st.lists(
    st.tuples(st.sampled_from(["ahead", "hold", "turn"]), st.integers(1, 12), st.booleans()), min_size=1, max_size=8
)


@given(steps)
def test_a_plan_comes_back_from_its_timed_path(walk):
    """Any walk of moves, turns of up to 360 degrees and holds; motions that go on as the one before are one."""
    x, y, yaw, holds, last = 2.0, -3.0, 0.5, [], ""
    states, kinds = [(x, y, yaw)], []
    for kind, size, left in walk:
        if kind == "hold" and not (holds and holds[-1][0] == len(states) - 1):
            holds.append((len(states) - 1, size / 8))
            last = kind
        elif kind == "ahead" and last != kind:
            x, y = x + size / 7 * math.cos(yaw), y + size / 7 * math.sin(yaw)
            states.append((x, y, yaw))
            kinds.append("move")
            last = kind
        elif kind == "turn" and last != kind:
            yaw += math.radians(30 * size) * (1 if left else -1)
            states.append((x, y, yaw))
            kinds.append("turn")
            last = kind
    columns = dict(zip(("x", "y", "yaw"), np.array(states).T, strict=True))
    asked = Trajectory(DRIVE, hpop.motions.States(**columns), tuple(kinds))
    for at, seconds in reversed(holds):
        asked = asked.with_hold(at=at, seconds=seconds)
    found = trajectory_of(through_ros(path_message(asked, planned=True, timed=True)), DRIVE)
    same(found, asked)


@pytest.mark.parametrize("distribution", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_an_execution_has_the_geometry_of_its_plan(distribution):
    asked = robots()["holds"]
    path = through_ros(path_message(asked, frame_id="hall"), distribution=distribution)
    same(trajectory_of(path, DRIVE), asked.without_holds())
    assert {one["header"]["frame_id"] for one in path["poses"]} == {path["header"]["frame_id"]} == {"hall"}
    assert {tuple(one["header"]["stamp"].values()) for one in path["poses"]} == {(0, 0)}
    places = [tuple(one["pose"].items()) for one in path["poses"]]
    assert all(a != b for a, b in pairwise(places))


def test_a_timed_path_says_when_a_hold_begins_and_ends():
    goes = Trajectory.from_poses(DRIVE, [(0, 0, 0), (1, 0, 0), (1, 1, math.pi / 2)])
    held = goes.with_hold(at=1, seconds=2.5)
    for planned, run in ((True, held), (False, held.execution())):
        path = path_message(held, planned=planned, timed=True)
        stamps = [one["header"]["stamp"]["sec"] + 1e-9 * one["header"]["stamp"]["nanosec"] for one in path["poses"]]
        (i,) = [i for i in range(1, len(stamps)) if path["poses"][i]["pose"] == path["poses"][i - 1]["pose"]]
        begin = run.kinds.index("hold")
        assert stamps[i - 1 : i + 1] == pytest.approx(run.times[begin : begin + 2], abs=2e-9)
        assert stamps[i] - stamps[i - 1] == pytest.approx(2.5, abs=2e-9)
        assert stamps[-1] == pytest.approx(run.duration, abs=2e-9)


def test_a_path_of_somebody_else_is_turned_to_and_driven():
    """Places alone, as planners on grids give them: the robot turns to each next one, and to the last heading."""
    corners = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (2, 1, math.pi)]
    found = trajectory_of({"poses": [pose_message(*one) for one in corners]}, DRIVE)
    assert found.kinds == ("move", "turn", "move", "turn", "turn")
    assert found.states.yaw.tolist() == pytest.approx([0, 0, math.pi / 2, math.pi / 2, 0, math.pi])


def test_a_path_there_and_back_is_driven_there_and_back():
    """In one line, so that only the distance tells that it goes back."""
    there = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (1.5, 0, math.pi), (1, 0, math.pi), (3, 0, 0)]
    found = trajectory_of({"poses": [pose_message(*one) for one in there]}, DRIVE)
    assert found.kinds == ("move", "turn", "move", "turn", "move")
    assert found.states.x.tolist() == [0, 2, 2, 1, 1, 3]
    assert found.without_holds() is found


def test_a_turn_in_very_small_steps_is_a_turn():
    steps = [pose_message(0, 0, 4e-7 * i) for i in range(5000)]
    found = trajectory_of({"poses": steps}, DRIVE)
    assert found.kinds == ("turn",)
    assert found.states.yaw[-1] == pytest.approx(4e-7 * 4999, abs=2e-6)


def test_a_path_backwards_is_driven_forwards():
    found = trajectory_of({"poses": [pose_message(0, 0, 0), pose_message(-1, 0, 0)]}, DRIVE)
    assert found.kinds == ("turn", "move", "turn")
    assert found.states.x.tolist() == [0, 0, -1, -1]


@given(*[st.floats(-1e3, 1e3)] * 2, st.floats(-math.pi, math.pi), st.floats(0.95, 1.05))
def test_a_pose_comes_back(x, y, yaw, length):
    message = through_ros(pose_message(x, y, yaw), "geometry_msgs/msg/PoseStamped")
    for axis, value in message["pose"]["orientation"].items():
        message["pose"]["orientation"][axis] = length * value
    pose = planar_pose(message)
    assert (pose.x, pose.y, pose.frame) == (x, y, "map")
    assert math.remainder(pose.yaw - yaw, math.tau) == pytest.approx(0, abs=1e-9)


@given(st.floats(-3, 3), st.floats(-1.4, 1.4), st.floats(-3, 3))
def test_the_heading_of_a_body_that_leans_is_where_it_points(yaw, pitch, roll):
    """By scipy: the body's x, on the floor."""
    turned = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    message = pose_message(0, 0, 0)
    message["pose"]["orientation"] = dict(zip("xyzw", turned.as_quat().tolist(), strict=True))
    assert math.remainder(planar_pose(message).yaw - yaw, math.tau) == pytest.approx(0, abs=1e-9)


def test_poses_of_other_messages_are_found():
    pose = pose_message(1, 2, 3)
    amcl = {"header": pose["header"], "pose": {"pose": pose["pose"], "covariance": [0.0] * 36}}
    odometry = amcl | {"child_frame_id": "base_link", "twist": {}}
    assert planar_pose(amcl) == planar_pose(odometry) == planar_pose(pose) == PlanarPose(1, 2, pytest.approx(3), "map")


def changed(message, *keys, value):
    made = copy.deepcopy(message)
    place = made
    for key in keys[:-1]:
        place = place[key]
    if value is None:
        del place[keys[-1]]
    else:
        place[keys[-1]] = value
    return made


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("pose",), None, "pose of the pose must be a message with fields, got None"),
        (("pose", "position", "x"), float("nan"), "position.x of the pose must be a number"),
        (("pose", "position", "y"), 10**400, "position.y of the pose must be a number"),
        (("pose", "position", "y"), True, "position.y of the pose must be a number"),
        (("pose", "orientation", "w"), "1", "orientation.w of the pose must be a number"),
        (("pose", "orientation", "w"), 0.0, "a quaternion of length 1, got length 0"),
        (("header",), 3, "header of the pose must be a message"),
        (("header", "frame_id"), "m" * 1000, "frame_id of the pose must be text of at most 200 characters"),
    ],
)
def test_what_is_no_pose_names_the_field(keys, value, said):
    with pytest.raises(RosError, match=said):
        planar_pose(changed(pose_message(1, 2, 0), *keys, value=value))


def test_a_pose_that_looks_up_has_no_heading():
    half = math.sqrt(0.5)
    message = changed(pose_message(0, 0, 0), "pose", "orientation", value={"x": 0.0, "y": -half, "z": 0.0, "w": half})
    with pytest.raises(RosError, match="straight up or down"):
        planar_pose(message)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ([], "the path must be a message"),
        ({}, "a list of 1 to 20,000 poses, got none"),
        ({"poses": []}, "got 0"),
        ({"poses": [{}] * 20_001}, "got 20,001"),
        ({"poses": [pose_message(0, 0, 0), {"pose": 3}]}, "pose of pose 1 must be a message"),
        (
            {"poses": [changed(pose_message(0, 0, 0), "header", "stamp", value={"sec": -1})]},
            "sec of the stamp of pose 0",
        ),
        ({"poses": [changed(pose_message(0, 0, 0), "header", "stamp", value={"sec": 1.5})]}, "must be a whole number"),
    ],
)
def test_what_is_no_path_says_why(path, said):
    with pytest.raises(RosError, match=said):
        trajectory_of(path, DRIVE)


def test_a_path_is_that_of_a_base_and_of_a_robot_that_turns_and_moves():
    with pytest.raises(OptionError, match="a robot with a base, but this one has none"):
        path_message(robots()["serial arm"])
    path = path_message(robots()["pan-tilt"])
    with pytest.raises(ModelError, match="expected a model with the states x m"):
        trajectory_of(path, hpop.PanTilt())
    assert trajectory_of(path, DRIVE).kinds == ("move", "turn")


@pytest.mark.parametrize(
    ("message", "kind", "said"),
    [
        ({"x": 1.0}, "geometry_msgs/msg/Point", "must have the fields x, y, z, got {'x': 1.0}"),
        ({"x": 1.0, "y": 2.0, "z": 0.0, "w": 1}, "geometry_msgs/msg/Point", "must have the fields x, y, z"),
        ({"x": 1.0, "y": "2", "z": 0.0}, "geometry_msgs/msg/Point", "Point.y must be of type float64, got '2'"),
        ({"sec": 1.5, "nanosec": 0}, "builtin_interfaces/msg/Time", "Time.sec must be of type int32, got 1.5"),
        ({"data": 3}, "std_msgs/msg/String", "String.data must be of type string, got 3"),
        ({"header": pose_message(0, 0, 0)["header"], "poses": 3}, PATH, "Path.poses must be a list, got 3"),
        ({"header": pose_message(0, 0, 0)["header"], "poses": np.array(3)}, PATH, "Path.poses must be a list, got arr"),
        ({}, "nav2_msgs/msg/Nothing", "the type store has no type 'nav2_msgs/msg/Nothing'"),
    ],
)
def test_what_does_not_fit_a_type_says_why(message, kind, said):
    with pytest.raises(RosError, match=said):
        typed(message, kind, types(Stores.ROS2_JAZZY))


def test_arrays_of_numbers_are_those_of_the_type():
    amcl = {
        "header": pose_message(0, 0, 0)["header"],
        "pose": {"pose": pose_message(1, 2, 0)["pose"], "covariance": [float(i) for i in range(36)]},
    }
    assert through_ros(amcl, "geometry_msgs/msg/PoseWithCovarianceStamped") == amcl
