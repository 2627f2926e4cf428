"""Every format, read by independent readers and turned back into the world's frame: x and y on the floor, z up.

Nothing of hpop is used here: the turns between frames are matrices, and rotations are scipy's.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pygltflib
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

RUF = np.array([[0, -1, 0], [0, 0, 1], [1, 0, 0]])  # Unity's right, up, forward of ahead, left, up
MIRROR = np.diag([1, -1, 1])  # Unreal's
GLTF = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
CAMERA = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])  # right, up, back of a camera, by ahead, left, up


class Read(NamedTuple):
    """Times (N,) s, positions (N, 3) m, rotations (N, 3, 3): columns ahead, left, up."""

    times: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray


def _table(path: Path, comment: str | None = "#") -> Any:
    import pandas  # takes a second, which each process of `make test` would spend

    return pandas.read_csv(path, comment=comment)


def csv(path: Path) -> Read:
    table = _table(path)
    turned = Rotation.from_quat(table[["qx", "qy", "qz", "qw"]].to_numpy())
    return Read(table["t"].to_numpy(), table[["x", "y", "z"]].to_numpy(), turned.as_matrix())


def pose_json(path: Path) -> Read:
    told = json.loads(path.read_text())
    return Read(
        np.array(told["times"]), np.array(told["positions"]), Rotation.from_quat(told["quaternions"]).as_matrix()
    )


def unity(path: Path) -> Read:
    table = _table(path)
    turned = Rotation.from_quat(table[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
    return Read(table["t"].to_numpy(), table[["x", "y", "z"]].to_numpy() @ RUF, RUF.T @ turned @ RUF)


def unreal(path: Path) -> Read:
    """By the quaternion that Unreal's FRotator gives."""
    table = _table(path)
    half = 0.5 * np.radians(table[["pitch", "yaw", "roll"]].to_numpy().T)
    (sp, sy, sr), (cp, cy, cr) = np.sin(half), np.cos(half)
    quaternions = np.column_stack(
        [
            cr * sp * sy - sr * cp * cy,
            -cr * sp * cy - sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
    turned = Rotation.from_quat(quaternions).as_matrix()
    return Read(table["t"].to_numpy(), table[["x", "y", "z"]].to_numpy() / 100.0 @ MIRROR, MIRROR @ turned @ MIRROR)


def tum(path: Path) -> Read:
    from evo.tools.file_interface import read_tum_trajectory_file

    return _of_evo(read_tum_trajectory_file(str(path)))


def euroc(path: Path) -> Read:
    from evo.tools.file_interface import read_euroc_csv_trajectory

    return _of_evo(read_euroc_csv_trajectory(str(path)))


def _of_evo(read) -> Read:
    assert read.check()[0]
    return Read(read.timestamps, read.positions_xyz, np.array(read.poses_se3)[:, :3, :3])


def messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Topic, time in ns and content of each message of an MCAP file, by the readers of its makers."""
    with path.open("rb") as file:
        for _, channel, message, content in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            yield channel.topic, message.log_time, content


def mcap(path: Path) -> Read:
    """Read the stream of poses, whatever the body."""
    times, places, turned = [], [], []
    for topic, time, message in messages(path):
        if topic.endswith("_pose"):
            stamp, pose = message.header.stamp, message.pose
            times.append(stamp.sec * 10**9 + stamp.nanosec)
            assert time == times[-1]
            places.append([getattr(pose.position, axis) for axis in "xyz"])
            turned.append([getattr(pose.orientation, axis) for axis in "xyzw"])
    return Read(np.array(times) / 1e9, np.array(places), Rotation.from_quat(turned).as_matrix())


def bag(path: Path) -> Read:
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    times, places, turned = [], [], []
    with Reader(path) as reader:
        for connection, time, data in reader.messages():
            if connection.topic.endswith("_pose"):
                pose = store.deserialize_cdr(data, connection.msgtype).pose
                times.append(time / 1e9)
                places.append([getattr(pose.position, axis) for axis in "xyz"])
                turned.append([getattr(pose.orientation, axis) for axis in "xyzw"])
    return Read(np.array(times), np.array(places), Rotation.from_quat(turned).as_matrix())


def nav2(path: Path) -> Read:
    """Read a path: its times are numbers of poses."""
    goal = yaml.safe_load(path.read_text())
    poses = [pose["pose"] for pose in goal["path"]["poses"]]
    places = [[pose["position"].get(axis, 0.0) for axis in "xyz"] for pose in poses]
    turned = [[pose["orientation"].get(axis, 0.0) for axis in "xyzw"] for pose in poses]
    return Read(np.arange(len(poses)), np.array(places), Rotation.from_quat(turned).as_matrix())


def glb(path: Path) -> Read:
    """By pygltflib: the animation of the first node, a camera's as its axes are."""
    file = pygltflib.GLTF2().load(path)
    values = {"camera": file.nodes[0].camera is not None}
    for channel in file.animations[0].channels:
        if channel.target.node == 0:
            sampler = file.animations[0].samplers[channel.sampler]
            values |= {"time": accessor(file, sampler.input), channel.target.path: accessor(file, sampler.output)}
    turned = GLTF.T @ Rotation.from_quat(values["rotation"]).as_matrix()
    return Read(values["time"].ravel(), values["translation"] @ GLTF, turned @ CAMERA.T if values["camera"] else turned)


def accessor(file: pygltflib.GLTF2, index: int) -> np.ndarray:
    """Return the rows of an accessor as float64."""
    one = file.accessors[index]
    view = file.bufferViews[one.bufferView]
    begin, width = view.byteOffset + (one.byteOffset or 0), {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[one.type]
    data = io.BytesIO(file.binary_blob()[begin : begin + 4 * width * one.count]).getvalue()
    assert one.componentType == pygltflib.FLOAT
    return np.frombuffer(data, "<f4").reshape(one.count, width).astype(float)


class Joints(NamedTuple):
    """Names of n joints; times (N,) s; positions, velocities, accelerations (N, n)."""

    names: list[str]
    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray


def joint_csv(path: Path) -> Joints:
    table = _table(path)
    names = [name[: -len("_rate")] for name in table if name.endswith("_rate")]
    parts = (table[[f"{name}{end}" for name in names]].to_numpy() for end in ("", "_rate", "_acceleration"))
    return Joints(names, table["t"].to_numpy(), *parts)


def joint_yaml(path: Path, *within: str) -> Joints:
    """Read a JointTrajectory within some fields, by PyYAML, as ros2cli does."""
    told = yaml.safe_load(path.read_text())
    for name in within:
        told = told[name]
    points = told["points"]
    times = [point["time_from_start"]["sec"] + point["time_from_start"]["nanosec"] / 1e9 for point in points]
    parts = (np.array([point[part] for point in points]) for part in ("positions", "velocities", "accelerations"))
    return Joints(told["joint_names"], np.array(times), *parts)


def joint_mcap(path: Path) -> Joints:
    """Read the JointTrajectory, and compare it with the joint states."""
    sent = list(messages(path))
    ((time, told),) = [(time, message) for topic, time, message in sent if topic == "/joint_trajectory"]
    times = [point.time_from_start.sec + point.time_from_start.nanosec / 1e9 for point in told.points]
    parts = (np.array([getattr(point, part) for point in told.points]) for part in Joints._fields[2:])
    found = Joints(list(told.joint_names), np.array(times), *parts)
    states = [(time, message) for topic, time, message in sent if topic == "/joint_states"]
    assert time == 0
    assert [list(message.name) for _, message in states] == [found.names] * len(states)
    np.testing.assert_allclose([time / 1e9 for time, _ in states], found.times, atol=1e-9)
    np.testing.assert_allclose([message.position for _, message in states], found.positions, atol=1e-9)
    np.testing.assert_allclose([message.velocity for _, message in states], found.velocities, atol=1e-9)
    return found


OF_JOINTS: dict[str, Callable[[Path], Joints]] = {
    "csv": joint_csv,
    "joint-trajectory": joint_yaml,
    "follow-joint-trajectory": lambda path: joint_yaml(path, "trajectory"),
    "moveit": lambda path: joint_yaml(path, "trajectory", "joint_trajectory"),
    "mcap": joint_mcap,
}
"""Readers of files with the body "joints"."""
READERS: dict[str, Callable[[Path], Read]] = {
    "bag": bag,
    "csv": csv,
    "euroc": euroc,
    "glb": glb,
    "json": pose_json,
    "mcap": mcap,
    "nav2-yaml": nav2,
    "tum": tum,
    "unity-csv": unity,
    "unreal-csv": unreal,
}
