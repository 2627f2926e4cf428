"""A trajectory as messages of ROS 2, in a bag that rosbags writes; it needs the extra ``bags``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.lazy import library
from hpop.base.text import printable
from hpop.export.base import Exported
from hpop.export.turning import back, matrices, product
from hpop.ros.messages import DIAGNOSTICS, PATH, STAMPED, TRANSFORMS, Message, header, pose_stamped, transform
from hpop.ros.paths import message_of
from hpop.ros.spaced import spaced
from hpop.ros.typed import typed
from hpop.trajectories.poses import Poses, nanoseconds, on_one_side

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
    message: Message


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
            for sent in messages(given):
                message = typed(sent.message, sent.type, store)
                writer.write(connections[sent.topic], sent.time, store.serialize_cdr(message, sent.type))
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


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


def messages(given: Exported) -> Iterator[Sent]:
    """All messages, in the order of their times."""
    seen, frame = given.poses, given.frames.world
    times = nanoseconds(seen.times).tolist()
    yield Sent("/costs", DIAGNOSTICS, 0, _diagnostics(given))
    body = "base" if given.has_base else given.body
    path = spaced(given.run, body, planned=given.planned, timed=True)
    yield Sent("/plan", PATH, 0, message_of(path, frame, stamped=True))
    moving, fixed = _transforms(given)
    still = [transform(0, edge.frame, edge.child, *edge.first()) for edge in fixed]
    yield Sent("/tf_static", TRANSFORMS, 0, {"transforms": still})
    rows = [list(zip(edge.positions.tolist(), edge.quaternions.tolist(), strict=True)) for edge in moving]
    stream = zip(times, seen.positions.tolist(), seen.quaternions.tolist(), strict=True)
    for i, (time, place, turned) in enumerate(stream):
        now = [transform(time, edge.frame, edge.child, *row[i]) for edge, row in zip(moving, rows, strict=True)]
        yield Sent("/tf", TRANSFORMS, time, {"transforms": now})
        yield Sent(f"/{given.body}_pose", STAMPED, time, pose_stamped(time, frame, place, turned))


class _Edge(NamedTuple):
    """A frame in another: positions (N, 3) and quaternions (N, 4)."""

    frame: str
    child: str
    positions: FloatArray
    quaternions: FloatArray

    def first(self) -> tuple[list[float], list[float]]:
        """Where it is at the start, which for a fixed one is where it stays."""
        return self.positions[0].tolist(), self.quaternions[0].tolist()


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


def _diagnostics(given: Exported) -> Message:
    """Costs as keys and values."""
    values = [{"key": name, "value": value} for name, value in given.values.items()]
    status = {"level": 0, "name": given.title, "message": printable(given.claim), "hardware_id": "hpop"}
    return {"header": header(0, ""), "status": [{**status, "values": values}]}


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
