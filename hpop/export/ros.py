"""A trajectory as messages of ROS 2, in a bag that rosbags writes; it needs the extra ``bags``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from hpop.arrays import FloatArray
from hpop.export.base import Exported, nanoseconds
from hpop.export.spaced import spaced
from hpop.export.turning import back, matrices, product
from hpop.lazy import library
from hpop.poses import Poses, on_one_side
from hpop.text import printable

FOLDER = "poses"  # the bag's, until it is where it belongs: the file in it is called so
FIXED = 1e-9  # m and 1: what moves less on the base is fixed to it
AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternions x, y, z, w of bodies (x ahead, y left, z up); "
    "stamps in s and ns from the start"
)


class Sent(NamedTuple):
    """A message, where and when it is sent."""

    topic: str
    type: str
    time: int  # ns
    message: Any


def bag_files(given: Exported) -> dict[str, bytes]:
    """The files of a bag (version 9, storage MCAP, messages of Jazzy) by name: metadata.yaml and poses.mcap."""
    rosbag2: Any = library("rosbags.rosbag2", "a bag", "bags")
    stores: Any = library("rosbags.typesys", "a bag", "bags")
    store = stores.get_typestore(stores.Stores.ROS2_JAZZY)
    with TemporaryDirectory(prefix="hpop-") as scratch:
        folder = Path(scratch, FOLDER)
        with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            for line, text in enumerate(given.statement(AXES)):
                writer.set_custom_data(f"hpop_{line}", text)
            connections: dict[str, Any] = {}
            for topic, kind in topics(given):
                qos = _qos() if topic in LATCHED else []
                connections[topic] = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=qos)
            for sent in messages(given, store.types):
                writer.write(connections[sent.topic], sent.time, store.serialize_cdr(sent.message, sent.type))
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


PATH, STAMPED, TRANSFORMS = "nav_msgs/msg/Path", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
LATCHED = ("/plan", "/tf_static", "/costs")


def topics(given: Exported) -> list[tuple[str, str]]:
    """Topics and the types of their messages; the same whatever the trajectory."""
    return [
        ("/costs", DIAGNOSTICS),
        ("/plan", PATH),
        ("/tf_static", TRANSFORMS),
        ("/tf", TRANSFORMS),
        (f"/{given.body}_pose", STAMPED),
    ]


def messages(given: Exported, types: Any) -> Iterator[Sent]:
    """All messages, in the order of their times."""
    make = _Messages(types, given.frames.world)
    seen = given.poses
    times = nanoseconds(seen.times).tolist()
    yield Sent("/costs", DIAGNOSTICS, 0, make.diagnostics(given))
    path = spaced(given, "base" if given.has_base else given.body)
    stamped = zip(nanoseconds(path.times).tolist(), path.positions.tolist(), path.quaternions.tolist(), strict=True)
    along = [make.pose_stamped(*one) for one in stamped]
    yield Sent("/plan", PATH, 0, types[PATH](make.header(0), along))
    moving, fixed = _transforms(given)
    still = [make.transform(0, frame, child, place[0], turned[0]) for frame, child, place, turned in fixed]
    yield Sent("/tf_static", TRANSFORMS, 0, types[TRANSFORMS](still))
    for i, time in enumerate(times):
        now = [make.transform(time, frame, child, place[i], turned[i]) for frame, child, place, turned in moving]
        yield Sent("/tf", TRANSFORMS, time, types[TRANSFORMS](now))
        own = make.pose_stamped(time, seen.positions[i].tolist(), seen.quaternions[i].tolist())
        yield Sent(f"/{given.body}_pose", STAMPED, time, own)


class _Edge(NamedTuple):
    """A frame in another: positions (N, 3) and quaternions (N, 4)."""

    frame: str
    child: str
    positions: FloatArray
    quaternions: FloatArray


def _transforms(given: Exported) -> tuple[list[_Edge], list[_Edge]]:
    """The tree of frames: what moves, and what is fixed to the base; without a base the body is in the world's."""
    frames, seen = given.frames, given.poses
    child = frames.of(given.body)
    if not given.has_base:
        return [_Edge(frames.world, child, seen.positions, seen.quaternions)], []
    base = given.of("base")
    moving = [_Edge(frames.world, frames.base, base.positions, base.quaternions)]
    if given.body == "base":
        return moving, []
    carried = _Edge(frames.base, child, *_relative(base, seen))
    still = np.ptp(carried.positions, axis=0).max() < FIXED and np.ptp(carried.quaternions, axis=0).max() < FIXED
    return (moving, [carried]) if still else ([*moving, carried], [])


def _relative(base: Poses, body: Poses) -> tuple[FloatArray, FloatArray]:
    """Positions (N, 3) and quaternions (N, 4) of a body in the frame of the base."""
    turned = matrices(base.quaternions)
    places = np.einsum("nji,nj->ni", turned, body.positions - base.positions)
    return places, on_one_side(product(back(base.quaternions), body.quaternions))


class _Messages:
    """Messages of ROS, from numbers; times in ns."""

    def __init__(self, types: Any, world: str) -> None:
        self.types = types
        self.world = world

    def of(self, name: str, *values: Any) -> Any:
        package, message = name.split("/")
        return self.types[f"{package}/msg/{message}"](*values)

    def header(self, time: int, frame: str | None = None) -> Any:
        stamp = self.of("builtin_interfaces/Time", *divmod(time, 10**9))
        return self.of("std_msgs/Header", stamp, self.world if frame is None else frame)

    def pose_stamped(self, time: int, place: Any, turned: Any) -> Any:
        pose = self.of(
            "geometry_msgs/Pose", self.of("geometry_msgs/Point", *place), self.of("geometry_msgs/Quaternion", *turned)
        )
        return self.of("geometry_msgs/PoseStamped", self.header(time), pose)

    def transform(self, time: int, frame: str, child: str, place: FloatArray, turned: FloatArray) -> Any:
        moved = self.of("geometry_msgs/Vector3", *place.tolist())
        rotated = self.of("geometry_msgs/Quaternion", *turned.tolist())
        transform = self.of("geometry_msgs/Transform", moved, rotated)
        return self.of("geometry_msgs/TransformStamped", self.header(time, frame), child, transform)

    def diagnostics(self, given: Exported) -> Any:
        values = [self.of("diagnostic_msgs/KeyValue", name, value) for name, value in given.values.items()]
        status = self.of("diagnostic_msgs/DiagnosticStatus", 0, given.title, printable(given.claim), "hpop", values)
        return self.of("diagnostic_msgs/DiagnosticArray", self.header(0, ""), [status])


def _qos() -> list[Any]:
    """What is sent once is kept for who comes later, as maps and static transforms are."""
    kinds: Any = library("rosbags.interfaces", "a bag", "bags")
    for_ever = kinds.QosTime(*divmod(2**63 - 1, 10**9))
    return [
        kinds.Qos(
            kinds.QosHistory.KEEP_LAST,
            1,
            kinds.QosReliability.RELIABLE,
            kinds.QosDurability.TRANSIENT_LOCAL,
            for_ever,
            for_ever,
            kinds.QosLiveliness.AUTOMATIC,
            for_ever,
            False,
        )
    ]
