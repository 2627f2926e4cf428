"""Export formats for ROS 2: messages in a bag or an MCAP file (extra ``bags``), and a goal of Nav2's FollowPath."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.lazy import library
from hpop.base.text import printable
from hpop.errors import OptionError
from hpop.export.base import Exported, back, export_format, matrices, product
from hpop.export.streams import joint_states, joint_trajectory_message
from hpop.motions.bodies import JOINTS
from hpop.ros.messages import DIAGNOSTICS, PATH, STAMPED, TRANSFORMS, Message, header, pose_stamped, transform, typed
from hpop.ros.paths import message_of, spaced
from hpop.trajectories.poses import Poses, nanoseconds, on_one_side

FOLDER = "poses"  # temporary folder of the bag, which names the file in it
JOINT_TRAJECTORY, JOINT_STATE = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState"
FIXED = 1e-9  # m, and quaternion components: a body that moves less relative to the base is fixed to it
AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternions x, y, z, w of bodies (x ahead, y left, z up); "
    "stamps in s and ns from the start"
)


class Sent(NamedTuple):
    """Message of a bag, with its topic, its type and the time at which it is sent."""

    topic: str
    type: str
    time: int  # ns
    message: Message


def bag_files(given: Exported) -> dict[str, bytes]:
    """Return the files of a ROS 2 bag by name: metadata.yaml (version 9) and poses.mcap, with messages of Jazzy."""
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


LATCHED = ("/plan", "/tf_static", "/costs", "/joint_trajectory")


def topics(given: Exported) -> list[tuple[str, str]]:
    """Return the topics of a bag, each with the type of its messages."""
    if given.body == JOINTS:
        return [("/costs", DIAGNOSTICS), ("/joint_trajectory", JOINT_TRAJECTORY), ("/joint_states", JOINT_STATE)]
    return [
        ("/costs", DIAGNOSTICS),
        ("/plan", PATH),
        ("/tf_static", TRANSFORMS),
        ("/tf", TRANSFORMS),
        (f"/{given.body}_pose", STAMPED),
    ]


def messages(given: Exported) -> Iterator[Sent]:
    """Yield all messages of a bag, in the order of their times."""
    yield Sent("/costs", DIAGNOSTICS, 0, _diagnostics(given))
    if given.body == JOINTS:
        yield Sent("/joint_trajectory", JOINT_TRAJECTORY, 0, joint_trajectory_message(given.joints))
        for time, state in joint_states(given.joints):
            yield Sent("/joint_states", JOINT_STATE, time, state)
        return
    seen, frame = given.poses, given.frames.world
    times = nanoseconds(seen.times).tolist()
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
    """Poses of a child frame in a parent frame over time: positions (N, 3), m, and quaternions (N, 4)."""

    frame: str
    child: str
    positions: FloatArray
    quaternions: FloatArray

    def first(self) -> tuple[list[float], list[float]]:
        """Return position and quaternion of the first pose; for a fixed frame this is the pose at all times."""
        return self.positions[0].tolist(), self.quaternions[0].tolist()


def _transforms(given: Exported) -> tuple[list[_Edge], list[_Edge]]:
    """Return the transforms for tf that move, and those that are fixed to the base.

    For a robot without a base, the only transform is that of the exported body in the world.
    """
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
    """Return the positions (N, 3), m, and quaternions (N, 4) of a body relative to the base."""
    turned = matrices(base.quaternions)
    places = np.einsum("nji,nj->ni", turned, body.positions - base.positions)
    return places, on_one_side(product(back(base.quaternions), body.quaternions))


def _diagnostics(given: Exported) -> Message:
    """Return the costs as a DiagnosticArray message, one key and value for each cost."""
    values = [{"key": name, "value": value} for name, value in given.values.items()]
    status = {"level": 0, "name": given.title, "message": printable(given.claim), "hardware_id": "hpop"}
    return {"header": header(0, ""), "status": [{**status, "values": values}]}


def _qos() -> list[Any]:
    """Return the quality of service of latched topics: later subscribers still receive the last message."""
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


@export_format("bag", suffix="_bag", axes=AXES)
def bag(given: Exported) -> Mapping[str, bytes]:
    """Return a bag of ROS 2, a folder with ``metadata.yaml`` (version 9) and an MCAP file; needs the extra ``bags``.

    Topics, axes, units and times are those of the format ``mcap``. ``ros2 bag play knee_70_bag`` plays the bag.
    """
    return bag_files(given)


@export_format("mcap", suffix=".mcap", axes=AXES)
def mcap(given: Exported) -> bytes:
    """Return an MCAP file of ROS 2 messages, for Foxglove and MCAP readers; needs the extra ``bags``.

    The file has these topics:

    - ``/plan`` (nav_msgs/Path): the path of the base, or of the exported body if the robot has no base. It has poses at
      the ends of motions, and between them about every 5 cm or 45 degrees. A hold (a wait) has two equal poses, at its
      begin and at its end.
    - ``/camera_pose`` (geometry_msgs/PoseStamped), or ``/base_pose`` if the base is exported: the poses along the way.
    - ``/tf``: the base in ``map``, and moving bodies on it. ``/tf_static``: the camera, if it is fixed to the base.
    - ``/costs`` (diagnostic_msgs/DiagnosticArray): a key and a value for each criterion.

    For the body "joints" it has ``/costs``, ``/joint_trajectory`` (trajectory_msgs/JointTrajectory), and
    ``/joint_states`` (sensor_msgs/JointState), rad or m and s.

    Axes are right-handed with z up (REP-103), in m; quaternions are x, y, z, w. The frame ``camera_link`` looks along
    its x axis, with y left and z up. ROS cameras also have an optical frame, which looks along its z axis; this file
    has none. Stamps, and the times at which messages are sent, count in s and ns from the start.
    """
    return bag_files(given)[f"{FOLDER}.mcap"]


GOAL_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; orientation x, y, z, w of the base (x ahead, y left); "
    "components that are left out are 0; no times"
)
DIGITS = 9  # behind the point: 1 nm, without exponents, which YAML 1.1 reads as text


@export_format("nav2-yaml", suffix=".nav2.yaml", axes=GOAL_AXES)
def nav2_yaml(given: Exported) -> bytes:
    """Return the goal of Nav2's ``FollowPath`` action: the path of the base as YAML, ready to be sent.

    Send it with ``ros2 action send_goal --stdin /follow_path nav2_msgs/action/FollowPath < knee_70.nav2.yaml``.

    ``path`` is a nav_msgs/Path in the frame of the world (``map``). It has poses of the base at both ends of each
    motion, and between them about every 5 cm or 45 degrees. A turn in place is a sequence of poses at one position.
    Axes are right-handed with z up (REP-103), in m; quaternions are x, y, z, w. Components that are left out are 0.
    The file has no times, which controllers ignore anyway. So speeds and holds (waits) are lost.

    Raises OptionError for a robot without a base.
    """
    if not given.has_base:
        raise OptionError("nav2-yaml needs a robot with a base, but this one has none; use mcap, bag, tum or csv")
    path = spaced(given.run, "base", planned=given.planned)
    frame = "'" + printable(given.frames.world).replace("'", "''") + "'"
    lines = [f"# {line}" for line in given.statement(GOAL_AXES, "the path of the base")]
    lines += ["path:", f"  header: {{frame_id: {frame}}}", "  poses:"]
    for place, turned in zip(path.positions.tolist(), path.quaternions.tolist(), strict=True):
        position, orientation = _components("xyz", place, "xy"), _components("xyzw", turned, "zw")
        pose = f"{{position: {position}, orientation: {orientation}}}"
        lines.append(f"  - {{header: {{frame_id: {frame}}}, pose: {pose}}}")
    lines += ["controller_id: ''", "goal_checker_id: ''"]
    return ("\n".join(lines) + "\n").encode()


def _components(names: str, values: Sequence[float], always: str) -> str:
    """Return components of a vector as YAML with 9 decimals; zeros are left out unless named in ``always``.

    >>> _components("xyz", (1, 0, 0), ""), _components("xy", (0.5, 0), "y")
    ('{x: 1.000000000}', '{x: 0.500000000, y: 0.000000000}')
    """
    rounded = {name: round(value, DIGITS) + 0.0 for name, value in zip(names, values, strict=True)}  # no -0.0
    told = [f"{name}: {value:.{DIGITS}f}" for name, value in rounded.items() if value or name in always]
    return f"{{{', '.join(told)}}}"
