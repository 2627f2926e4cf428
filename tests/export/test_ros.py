"""Messages of ROS, as rosbags and the readers of MCAP's makers decode them: paths, transforms, costs; Nav2's goal."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from hpop.export import Frames, save, write
from hpop.trajectories.poses import poses
from hpop.trajectories.trajectory import Trajectory
from tests.export.given import DRIVE, ODD, front, problem, robots
from tests.export.readers import messages

FOLLOW_PATH = """\
nav_msgs/Path path
string controller_id
string goal_checker_id
"""  # goal of nav2_msgs/action/FollowPath, as of Humble; later ones have more fields, all with defaults


def transforms(path):
    """Sent transforms by topic: (ns, frame, child, matrix (4, 4))."""
    found = {"/tf": [], "/tf_static": []}
    for topic, time, message in messages(path):
        for one in message.transforms if topic in found else ():
            place, turned = one.transform.translation, one.transform.rotation
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat([getattr(turned, axis) for axis in "xyzw"]).as_matrix()
            matrix[:3, 3] = [getattr(place, axis) for axis in "xyz"]
            found[topic].append((time, one.header.frame_id, one.child_frame_id, matrix))
            assert one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == time
    return found


@pytest.mark.cases(2)
@pytest.mark.parametrize("robot", ["differential drive", "pan-tilt", "mobile arm", "serial arm"])
def test_the_tree_of_transforms_leads_from_the_map_to_the_camera(robot, tmp_path):
    trajectory = robots()[robot]
    frames = Frames(world="hall", base="platform", camera="eye")
    sent = transforms(write(trajectory, tmp_path / "any.mcap", rate=5, frames=frames))
    asked = poses(trajectory, rate=5)
    has_base, fixed = "base" in trajectory.model.provides, robot == "differential drive"
    edges = {(frame, child) for _, frame, child, _ in sent["/tf"] + sent["/tf_static"]}
    assert edges == ({("hall", "platform"), ("platform", "eye")} if has_base else {("hall", "eye")})
    assert [child for _, _, child, _ in sent["/tf_static"]] == ["eye"] * fixed
    leads = {}
    for time, frame, child, matrix in sent["/tf"]:
        assert 0 <= time < 2**63
        leads[time, child] = matrix if frame == "hall" else leads[time, frame] @ matrix
    for i, time in enumerate(np.rint(asked.times * 1e9).astype(int).tolist()):
        whole = leads[time, "platform"] @ sent["/tf_static"][0][3] if fixed else leads[time, "eye"]
        np.testing.assert_allclose(whole[:3, 3], asked.positions[i], atol=1e-9)
        np.testing.assert_allclose(whole[:3, :3], Rotation.from_quat(asked.quaternions[i]).as_matrix(), atol=1e-9)


def test_the_readers_of_rosbags_and_of_mcap_decode_the_same(tmp_path):
    path = write(robots()["differential drive"], tmp_path / "any_bag", rate=5)
    store, first = get_typestore(Stores.ROS2_JAZZY), []
    with Reader(path) as reader:
        assert {connection.topic for connection in reader.connections} == {
            "/camera_pose", "/costs", "/plan", "/tf", "/tf_static",
        }  # fmt: skip
        for connection, time, data in reader.messages():
            first.append((connection.topic, time, repr_of(store.deserialize_cdr(data, connection.msgtype))))
        assert reader.message_count == len(first)
        assert reader.duration == first[-1][1] + 1
    other = [(topic, time, repr_of(message)) for topic, time, message in messages(path / "poses.mcap")]
    assert sorted(first) == sorted(other)
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (metadata["version"], metadata["storage_identifier"]) == (9, "mcap")
    assert metadata["relative_file_paths"] == ["poses.mcap"]
    assert "right-handed" in metadata["custom_data"]["hpop_1"]
    latched = {
        each["topic_metadata"]["name"]
        for each in metadata["topics_with_message_count"]
        if [qos["durability"] for qos in each["topic_metadata"]["offered_qos_profiles"]] == ["transient_local"]
    }
    assert latched == {"/costs", "/plan", "/tf_static"}


def repr_of(message):
    """All numbers and texts of a message, whoever decoded it."""
    if isinstance(message, int | float | str):
        return repr(message)
    if isinstance(message, list | tuple | np.ndarray):
        return [repr_of(one) for one in message]
    names = getattr(message, "__slots__", None) or vars(message)
    return [
        (name, repr_of(getattr(message, name))) for name in sorted(names) if not name.startswith("_") and name.islower()
    ]


def test_costs_are_keys_and_values_as_they_are_printed(tmp_path):
    save(None, front(), tmp_path, rows=["knee"], formats=["mcap"], rate=2)
    (costs,) = [message for topic, _, message in messages(tmp_path / "knee_1.mcap") if topic == "/costs"]
    (status,) = costs.status
    assert status.name == "knee (row 1)"
    values = {each.key: each.value for each in status.values}
    assert values["length (m)"] == repr(front()[1].costs["length"])
    assert len(values) == 2
    assert not any(letter in "".join(values) + status.message for letter in "\n\x1b\u202e")


def path_of(message):
    """Positions (N, 3), yaws (N,) of a nav_msgs/Path."""
    places = np.array([[getattr(one.pose.position, axis) for axis in "xyz"] for one in message.poses])
    turned = Rotation.from_quat([[getattr(one.pose.orientation, axis) for axis in "xyzw"] for one in message.poses])
    return places, np.unwrap(turned.as_euler("ZYX")[:, 0])


def still(message):
    """Return a mask (N,) of the poses that repeat the pose before: the ends of holds."""
    places, yaws = path_of(message)
    moved = np.abs(np.diff(places, axis=0)).max(axis=1, initial=0.0) + np.abs(np.diff(yaws))
    return np.append(False, moved < 1e-8)


@pytest.mark.cases(2)
@pytest.mark.parametrize("robot", ["differential drive", "holds", "stays", "mobile arm"])
def test_a_path_has_the_ends_of_all_motions_and_is_nowhere_coarse(robot, tmp_path):
    trajectory = robots()[robot]
    goal = yaml.safe_load(write(trajectory, tmp_path / "any.nav2.yaml").read_text())
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(FOLLOW_PATH, "nav2_msgs/action/FollowPath_Goal"))
    made = from_yaml(store, "nav2_msgs/action/FollowPath_Goal", goal)
    kind = "nav2_msgs/action/FollowPath_Goal"
    again = store.deserialize_cdr(store.serialize_cdr(made, kind), kind)
    assert {one.header.frame_id for one in again.path.poses} == {again.path.header.frame_id} == {"map"}
    places, yaws = path_of(again.path)
    run = trajectory.execution()
    ends = np.stack([run.states.x, run.states.y, run.states.yaw], axis=1)
    found = np.stack([places[:, 0], places[:, 1], yaws - yaws[0] + ends[0, 2]], axis=1)
    for end in ends:
        assert np.abs(found - end).max(axis=1).min() < 1e-8
    np.testing.assert_allclose(found[[0, -1]], ends[[0, -1]], atol=1e-8)
    assert (np.hypot(*np.diff(places[:, :2], axis=0).T) < 0.1).all()
    assert (np.abs(np.diff(yaws)) < np.pi / 2).all()
    moved, turned = np.diff(places, axis=0).any(axis=1), np.abs(np.diff(yaws)) > 1e-6
    assert not (moved & turned).any()  # a turn in place is poses at one position, digit for digit
    assert (moved | turned).all()  # and no pose is there twice in a row
    (plan,) = [m for topic, _, m in messages(write(trajectory, tmp_path / "any.mcap", rate=2)) if topic == "/plan"]
    stamped, stays = path_of(plan)[0], still(plan)
    np.testing.assert_allclose(stamped[~stays], places, atol=1e-8)
    if robot == "holds":
        assert stays.sum() == 1  # for 1.5 s
        times = np.array([one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in plan.poses])
        assert times[stays] - times[np.flatnonzero(stays) - 1] == pytest.approx([1.5], abs=2e-9)


def from_yaml(store, kind, values):
    """Return a message with the values of a YAML text, and ROS's defaults elsewhere: 0, empty, w = 1."""
    fields = store.fielddefs[kind][1]
    made = {}
    for name, (code, of) in fields:
        given = values.get(name) if isinstance(values, dict) else None
        if code.name == "NAME":
            made[name] = from_yaml(store, of, given or {})
        elif code.name == "SEQUENCE":
            made[name] = [from_yaml(store, of[0][1], one) for one in given or []]
        else:
            kind_of = {"string": str}.get(of[0], float if of[0].startswith("float") else int)
            assert given is None or isinstance(given, kind_of), (name, given)
            made[name] = given if given is not None else kind_of()
    assert not isinstance(values, dict) or set(values) <= set(made)
    return store.types[kind](**made)


def test_numbers_in_a_goal_are_numbers_to_yaml_however_small(tmp_path):
    tiny = Trajectory.from_poses(DRIVE, [(-1e-13, 1e-13, -1e-12), (1, 1e-7, 0)])
    text = write(tiny, tmp_path / "any.nav2.yaml").read_text()
    assert "-0.000000000" not in text
    first = yaml.safe_load(text)["path"]["poses"][0]["pose"]
    assert first == {"position": {"x": 0.0, "y": 0.0}, "orientation": {"z": 0.0, "w": 1.0}}


def test_a_frame_that_yaml_would_take_for_something_else_stays_text(tmp_path):
    for name in ("no", "1e3", "it's", "{x:1}", "#map", ODD.split()[0]):
        goal = yaml.safe_load(
            write(robots()["stays"], tmp_path / "any.nav2.yaml", frames=Frames(world=name)).read_text()
        )
        assert goal["path"]["header"]["frame_id"] == name


def test_poses_of_a_problem_are_those_of_its_front(tmp_path):
    """The world is no part of messages: with the problem or without it they are the same bytes."""
    for given, folder in ((problem(), "with"), (None, "without")):
        save(given, front(), tmp_path / folder, rows=[0], formats=["mcap", "json"], rate=2)
    for name in ("row_0.mcap", "row_0.json"):
        assert (tmp_path / "with" / name).read_bytes() == (tmp_path / "without" / name).read_bytes()
    assert json.loads((tmp_path / "with/row_0.json").read_text())["costs"] == front()[0].costs
