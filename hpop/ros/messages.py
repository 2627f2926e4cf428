"""ROS 2 messages as dictionaries, as rosbridge sends them, and as instances of the types of rosbags.

Incoming messages are not trusted: every field that is used is checked, and a :class:`RosError` names a wrong field.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import FARTHEST
from hpop.base.text import is_number, is_whole, python_value, shown
from hpop.errors import RosError

Message = dict[str, Any]

PATH, STAMPED, TRANSFORMS = "nav_msgs/msg/Path", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
LONGEST_NAME = 200  # characters of a frame's name
UNIT = 0.1  # tolerance of a quaternion's length, for senders of float32 or rounded numbers
SECOND = 10**9  # ns
MOST_SECONDS = 2**31 - 1  # of a stamp, an int32


class PlanarPose(NamedTuple):
    """Pose on the floor, with the name of its frame ("" if the message gives none)."""

    x: float  # m
    y: float  # m
    yaw: float  # rad, counter-clockwise from x, of the direction ahead
    frame: str


def stamp(time: int) -> Message:
    """Return a time or duration in ns as a builtin_interfaces/Time."""
    seconds, rest = divmod(time, SECOND)
    return {"sec": seconds, "nanosec": rest}


def header(time: int, frame: str) -> Message:
    """Return a std_msgs/Header; time in ns."""
    return {"stamp": stamp(time), "frame_id": frame}


def vector(values: Sequence[float]) -> Message:
    """Return three numbers as a geometry_msgs/Point or Vector3."""
    return dict(zip("xyz", values, strict=True))


def quaternion(values: Sequence[float]) -> Message:
    """Return a quaternion x, y, z, w as a geometry_msgs/Quaternion."""
    return dict(zip("xyzw", values, strict=True))


def pose_stamped(time: int, frame: str, place: Sequence[float], turned: Sequence[float]) -> Message:
    """Return a geometry_msgs/PoseStamped; time in ns, position in m, quaternion x, y, z, w."""
    return {"header": header(time, frame), "pose": {"position": vector(place), "orientation": quaternion(turned)}}


def transform(time: int, frame: str, child: str, place: Sequence[float], turned: Sequence[float]) -> Message:
    """Return a geometry_msgs/TransformStamped: the pose of the frame ``child`` in ``frame``."""
    moved = {"translation": vector(place), "rotation": quaternion(turned)}
    return {"header": header(time, frame), "child_frame_id": child, "transform": moved}


@checked_arguments
def pose_message(x: float, y: float, yaw: float, *, frame_id: str = "map") -> Message:
    """Return a pose on the floor (m, rad) as a geometry_msgs/PoseStamped with time stamp 0.

    >>> pose_message(1.0, 2.0, 0.0)["pose"]["orientation"]
    {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0}
    """
    return pose_stamped(0, frame_id, (x, y, 0.0), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))


@checked_arguments
def planar_pose(message: Any, where: str = "the pose") -> PlanarPose:
    """Read the pose on the floor from a PoseStamped, a PoseWithCovarianceStamped or an Odometry message.

    The height is dropped; the yaw is the horizontal direction of the body's x axis. ``where`` names the message in
    errors. Raises RosError for another message, for invalid numbers, and for a quaternion that is not a rotation.

    >>> planar_pose(pose_message(1.0, 2.0, 0.5, frame_id="odom"))
    PlanarPose(x=1.0, y=2.0, yaw=0.5, frame='odom')
    """
    fields_of = mapping(message, where)
    frame = text(mapping(fields_of.get("header", {}), f"header of {where}").get("frame_id", ""), f"frame_id of {where}")
    pose = mapping(fields_of.get("pose"), f"pose of {where}")
    if "pose" in pose:  # with its covariance
        pose = mapping(pose["pose"], f"pose of {where}")
    position = mapping(pose.get("position"), f"position of {where}")
    x, y = (number(position.get(axis), f"position.{axis} of {where}", FARTHEST) for axis in "xy")
    return PlanarPose(x, y, yaw_of(pose.get("orientation"), where), frame)


def yaw_of(orientation: Any, where: str) -> float:
    """Return the yaw, rad, of an orientation; RosError if it is not a rotation, or has no horizontal direction."""
    told = mapping(orientation, f"orientation of {where}")
    x, y, z, w = (number(told.get(axis), f"orientation.{axis} of {where}", 2.0) for axis in "xyzw")
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(length - 1.0) > UNIT:
        raise RosError(
            f"orientation of {where} must be a quaternion of length 1, got length {length:.3g}; if the heading does "
            "not matter, give x 0, y 0, z 0, w 1"
        )
    ahead = (w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z))
    if math.hypot(*ahead) < 1e-3:
        raise RosError(f"orientation of {where} must have a heading, but it looks straight up or down")
    return math.atan2(ahead[1], ahead[0])


def time_of(message: Any, where: str) -> int:
    """Return the time stamp of a message with a header, ns; 0 without a stamp, RosError for an invalid one."""
    told = mapping(mapping(message, where).get("header", {}), f"header of {where}").get("stamp", {})
    given = mapping(told, f"stamp of {where}")
    seconds, rest = (given.get(name, 0) for name in ("sec", "nanosec"))
    for name, value, most in (("sec", seconds, MOST_SECONDS), ("nanosec", rest, SECOND - 1)):
        if not is_whole(value) or not 0 <= value <= most:
            raise RosError(
                f"{name} of the stamp of {where} must be a whole number from 0 to {most:,}, got {shown(value)}"
            )
    return int(seconds) * SECOND + int(rest)


def mapping(value: Any, where: str) -> Mapping[str, Any]:
    """Return a value if it is a message with fields (a mapping); raise RosError otherwise.

    ``where`` names the value in the error.
    """
    if not isinstance(value, Mapping):
        raise RosError(f"{where} must be a message with fields, got {shown(value)}")
    return value


def number(value: Any, where: str, most: float) -> float:
    """Return a number within +-``most`` as a float; RosError otherwise, also for null, which bridges send for NaN."""
    if not is_number(value) or not -most <= value <= most:
        raise RosError(f"{where} must be a number from {-most:g} to {most:g}, got {shown(value)}")
    return float(value)


def text(value: Any, where: str) -> str:
    """Return a value if it is a short text; raise RosError otherwise."""
    if not isinstance(value, str) or len(value) > LONGEST_NAME:
        raise RosError(f"{where} must be text of at most {LONGEST_NAME} characters, got {shown(value)}")
    return value


KINDS = {"string": str, "bool": bool}  # all other types are numbers


@checked_arguments
def typed(message: Mapping[str, Any], kind: str, store: Any) -> Any:
    """Convert a message to a type, such as "nav_msgs/msg/Path", of a rosbags type store, which can serialise it.

    Raises RosError for an invalid type store, for a type that is not in the store, and for a field that is missing,
    unknown, or of another type.

    >>> from rosbags.typesys import Stores, get_typestore
    >>> typed({"x": 1.0, "y": 2.0, "z": 0.0}, "geometry_msgs/msg/Point", get_typestore(Stores.ROS2_JAZZY)).y
    2.0
    """
    if not hasattr(store, "fielddefs"):
        raise RosError(f"store must be a type store of rosbags, as get_typestore returns it, got {shown(store)}")
    if kind not in store.fielddefs:
        raise RosError(f"the type store has no type {shown(kind)}; give the store of a distribution that has it")
    declared = dict(store.fielddefs[kind][1])
    given = message if isinstance(message, Mapping) else {}
    if set(given) != set(declared):
        raise RosError(f"{kind} must have the fields {', '.join(declared) or 'none'}, got {shown(message)}")
    return store.types[kind](
        **{name: _value(given[name], of, f"{kind}.{name}", store) for name, of in declared.items()}
    )


@checked_arguments
def plain(message: Any) -> Message:
    """Convert a message of rosbags to dictionaries and lists, as rosbridge sends it.

    >>> from rosbags.typesys import Stores, get_typestore
    >>> plain(get_typestore(Stores.ROS2_JAZZY).types["builtin_interfaces/msg/Time"](1, 2))
    {'sec': 1, 'nanosec': 2}
    """
    names = [field.name for field in fields(message) if not field.name.startswith("_")]
    return {name: _plain(getattr(message, name)) for name in names}


def _plain(value: Any) -> Any:
    """Convert a value in a rosbags message to dictionaries, lists and plain values."""
    if is_dataclass(value):
        return plain(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _value(value: Any, declared: Any, where: str, store: Any) -> Any:
    """Convert the value of a message's field to the type that rosbags declares for it.

    declared  pair of rosbags: the kind of type ("BASE", "NAME" of a message, "ARRAY" or "SEQUENCE"), and its details
    where     name of the field for the error, "nav_msgs/msg/Path.poses"

    Raises RosError for a value of another type.
    """
    kind_of_type, of = declared
    if kind_of_type.name == "NAME":
        return typed(value, of, store)
    if kind_of_type.name in ("ARRAY", "SEQUENCE"):
        inner = of[0]
        if not (isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim)):
            raise RosError(f"{where} must be a list, got {shown(value)}")
        made = [_value(item, inner, where, store) for item in value]
        is_number = inner[0].name == "BASE" and inner[1][0] not in KINDS
        return np.array(made, inner[1][0]) if is_number else made
    value, kind = python_value(value), KINDS.get(of[0], float if of[0].startswith("float") else int)
    if not isinstance(value, int | float if kind is float else kind) or (isinstance(value, bool) and kind is not bool):
        raise RosError(f"{where} must be of type {of[0]}, got {shown(value)}")
    return kind(value)
