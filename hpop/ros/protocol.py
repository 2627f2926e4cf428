"""Messages of the rosbridge v2 protocol between the bridge and an action server, such as of ComputePathToPose.

Written from ROSBRIDGE_PROTOCOL.md of RobotWebTools/rosbridge_suite, commit 01cc6a1, sections 3.2.1 to 3.2.5 (topics)
and 3.2.10 to 3.2.15 (actions). An incoming message is limited in size before it is parsed, and refused unless it is an
object with an ``op``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.base.options import one_of
from hpop.base.text import printable, shown
from hpop.errors import OptionError, RosError
from hpop.frontier import strict_json
from hpop.ros.messages import SECOND, Message, header, stamp

NAME = re.compile(r"[A-Za-z/][A-Za-z0-9_/]{0,199}")
FRAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_/.-]{0,99}")  # it is repeated in each pose of a path
POSES = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
)
LONGEST_CHOICE = 200  # characters
FIELDS = {
    "humble": ("path", "planning_time"),
    "iron": ("path", "planning_time", "error_code"),
    "jazzy": ("path", "planning_time", "error_code", "error_msg"),
    "kilted": ("path", "planning_time", "error_code", "error_msg"),
    "rolling": ("path", "planning_time", "error_code", "error_msg"),
}
"""Fields of the result of ComputePathToPose, by ROS distribution: a bridge drops a result with other fields."""


@checked_arguments
@dataclass(frozen=True)
class Interface:
    """Names of the action, topics and frames by which ROS reaches the planner.

    action         name of the action, which no other server may have
    distribution   distribution of ROS 2 with the nav2_msgs of the bridge, a key of `FIELDS`
    frame_id       frame of the map, of goals and paths
    pose_topic     topic of the robot's pose in that frame, for goals with ``use_start`` false
    pose_type      type of its messages, one of `POSES`
    options_topic  topic for the front of each plan, as JSON in a std_msgs/msg/String
    choice         which trajectory of the front an empty planner_id chooses, such as "knee" or "fewest turns"

    Raises OptionError for an invalid name.
    """

    action: str = "/hpop/compute_path_to_pose"
    distribution: str = "jazzy"
    frame_id: str = "map"
    pose_topic: str = "/amcl_pose"
    pose_type: str = POSES[0]
    options_topic: str = "/hpop/options"
    choice: str = "knee"

    def __post_init__(self) -> None:
        for option in fields(self):
            value = getattr(self, option.name)
            if option.name in ("action", "pose_topic", "options_topic") and (
                not isinstance(value, str) or not NAME.fullmatch(value) or "//" in value or value.endswith("/")
            ):
                raise OptionError(f"{option.name} must be a name of ROS, such as {option.default}, got {shown(value)}")
        one_of("distribution", self.distribution, FIELDS)
        one_of("pose_type", self.pose_type, POSES)
        frame = self.frame_id
        if not isinstance(frame, str) or not FRAME.fullmatch(frame):
            raise OptionError(f"frame_id must be the name of a frame, such as map, got {shown(frame)}")
        if not isinstance(self.choice, str) or not 0 < len(self.choice) <= LONGEST_CHOICE:
            raise OptionError(f"choice must be a name such as knee or 'fewest turns', got {shown(self.choice)}")


ACTION = "nav2_msgs/action/ComputePathToPose"
TEXT = "std_msgs/msg/String"
MOST_BYTES = 2**20  # largest incoming message; a goal has 1 kB
LONGEST_ID = 1000  # characters
THROTTLE = 100  # least time between two poses of the robot, ms


class GoalStatus(IntEnum):
    """Final status of a goal, as in action_msgs/msg/GoalStatus."""

    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


def parsed(data: str | bytes, most: int = MOST_BYTES) -> Mapping[str, Any]:
    """Parse an incoming message, which must be a JSON object with a text ``op``; raise RosError for anything else.

    ``most`` is the limit of its size, characters.
    """
    if isinstance(data, bytes):
        raise RosError("a binary message, which was not requested")
    if len(data) > most:
        raise RosError(f"a message of {len(data):,} characters, more than the limit of {most:,}")
    try:
        message = strict_json.parse(data.encode())
    except RecursionError:
        raise RosError("brackets nested too deeply") from None
    except ValueError as error:  # no JSON, no UTF-8, a number too large
        raise RosError(f"a message that is not JSON: {shown(str(error))}") from None
    if not isinstance(message, dict) or not isinstance(message.get("op"), str):
        raise RosError(f"expected an object with an op, got {shown(message)}")
    return message


def goal_id(message: Mapping[str, Any]) -> str:
    """Return the id of a goal as text (the protocol also allows whole numbers); raise RosError if it has none."""
    identifier = message.get("id")
    if isinstance(identifier, int) and not isinstance(identifier, bool):
        identifier = str(identifier)
    if not isinstance(identifier, str) or not 0 < len(identifier) <= LONGEST_ID:
        raise RosError(f"a goal must have an id, got {shown(identifier)}")
    return identifier


def encoded(message: Message) -> str:
    """Encode a message as JSON text."""
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


def greetings(known: Interface) -> list[Message]:
    """Return the messages that open a connection: they offer the action and the options topic, and ask for poses."""
    return [
        {"op": "advertise", "topic": known.options_topic, "type": TEXT},
        {
            "op": "subscribe",
            "topic": known.pose_topic,
            "type": known.pose_type,
            "throttle_rate": THROTTLE,
            "queue_length": 1,
        },
        {"op": "advertise_action", "action": known.action, "type": ACTION},
    ]


def farewells(known: Interface) -> list[Message]:
    """Return the messages that withdraw the action and the topics before a connection is closed."""
    return [
        {"op": "unadvertise_action", "action": known.action},
        {"op": "unsubscribe", "topic": known.pose_topic},
        {"op": "unadvertise", "topic": known.options_topic},
    ]


def action_feedback(action: str, goal: str, values: Message) -> Message:
    """Return a feedback message of a goal."""
    return {"op": "action_feedback", "id": goal, "action": action, "values": values}


def feedback(known: Interface, goal: str) -> Message:
    """Return the feedback message that is sent while a goal is planned: it has the goal's id, and no values."""
    return action_feedback(known.action, goal, {})


def action_result(action: str, goal: str, status: GoalStatus, values: Message) -> Message:
    """Return the message with the result of a goal: its final status, and the fields ``values``.

    ``result`` is always true, because for false the bridge drops the values with the error code, and aborts the goal
    (rosbridge_library/capabilities/action_result.py, commit 1101795). The bridge takes the status from ``status``.
    """
    message = {"op": "action_result", "id": goal, "action": action, "values": values}
    return {**message, "status": int(status), "result": True}


def result(known: Interface, goal: str, status: GoalStatus, values: Message) -> Message:
    """Return the message with the result of a goal of ComputePathToPose."""
    return action_result(known.action, goal, status, values)


def publication(known: Interface, options: Message) -> Message:
    """Return the message that publishes a front on the options topic."""
    return {"op": "publish", "topic": known.options_topic, "msg": {"data": encoded(options)}}


LONGEST = 1000  # characters of an error's message


class ErrorCode(IntEnum):
    """Error codes of nav2_msgs since Iron (docs.ros.org: Iron, Jazzy and Kilted); Humble has none."""

    NONE = 0
    UNKNOWN = 200
    INVALID_PLANNER = 201
    TF_ERROR = 202
    START_OUTSIDE_MAP = 203
    GOAL_OUTSIDE_MAP = 204
    START_OCCUPIED = 205
    GOAL_OCCUPIED = 206
    TIMEOUT = 207
    NO_VALID_PATH = 208


class Failure(Exception):
    """Error that ends a goal without a path, with the ROS error code and the reason as text."""

    def __init__(self, code: ErrorCode, why: str) -> None:
        super().__init__(why)
        self.code, self.why = code, why


class GoalResult(NamedTuple):
    """Result of a goal: its status, the fields of the result message, and the front to publish, if any."""

    status: GoalStatus
    values: Message
    options: Message | None = None


def values_of(
    known: Interface, path: Message | None, seconds: float, code: ErrorCode = ErrorCode.NONE, why: str = ""
) -> Message:
    """Return the fields of a result message that the ROS distribution has; without a path, the path is empty.

    ``seconds`` is the planning time, ``why`` the text of an error.
    """
    whole: Message = {
        "path": path or {"header": header(0, known.frame_id), "poses": []},
        "planning_time": stamp(round(seconds * SECOND)),
        "error_code": int(code),
        "error_msg": printable(why)[:LONGEST],
    }
    return {name: whole[name] for name in FIELDS[known.distribution]}


def failed(known: Interface, failure: Failure, seconds: float) -> GoalResult:
    """Return the result of an aborted goal, with the reason."""
    return GoalResult(GoalStatus.ABORTED, values_of(known, None, seconds, failure.code, failure.why))


def canceled(known: Interface) -> GoalResult:
    """Return the result of a goal that its client canceled."""
    return GoalResult(GoalStatus.CANCELED, values_of(known, None, 0.0))


MOST_REMARKS = 20  # most complaints about invalid messages


class MessageServer:
    """Server of actions behind a :class:`.Bridge`, which passes messages to it and from it.

    The bridge calls ``connected``, ``received`` and ``disconnected`` from one thread. Invalid messages are ignored, and
    reported once for each wording, up to `MOST_REMARKS`. Subclasses say what they offer, and handle messages.

    say         called with a line of text for each event
    most_bytes  size limit of an incoming message
    """

    def __init__(self, *, say: Callable[[str], None], most_bytes: int = MOST_BYTES) -> None:
        self.say, self.most_bytes = say, most_bytes
        self._send: Callable[[str], None] | None = None
        self._remarks: set[str] = set()

    @property
    def offers(self) -> str:
        """Offered actions, for a line of text."""
        return ""

    def greetings(self) -> list[Message]:
        """Return the messages that open a connection."""
        return []

    def farewells(self) -> list[Message]:
        """Return the messages that withdraw what is offered, before a connection is closed."""
        return []

    def ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        """Return the methods that handle incoming messages, by the message's ``op``; they may raise RosError."""
        return {}

    def lost(self) -> None:
        """Drop all goals after the connection is lost, because the bridge has aborted them."""

    def close(self) -> None:
        """Stop serving, and end all threads."""

    @property
    def is_connected(self) -> bool:
        """True while there is a connection."""
        return self._send is not None

    def connected(self, send: Callable[[str], None]) -> None:
        """Offer the actions on a new connection.

        ``send`` sends a message; any thread may call it, and it raises nothing.
        """
        for message in self.greetings():
            send(encoded(message))
        self._send = send

    def received(self, data: str | bytes) -> None:
        """Handle one incoming message; an invalid one is reported and ignored."""
        try:
            message = parsed(data, self.most_bytes)
            take = self.ops().get(message["op"])
            if take is None:
                raise RosError(f"a message with op {shown(message['op'])}, which an action server does not handle")
            take(message)
        except RosError as error:
            self.remark(f"ignored {error}")

    def disconnected(self) -> None:
        """Send nothing more, and drop all goals."""
        self._send = None
        self.lost()

    def tell(self, message: Message) -> None:
        """Send a message to the bridge, if there is a connection."""
        send = self._send
        if send is not None:
            send(encoded(message))

    def remark(self, text: str) -> None:
        """Report an invalid message by ``say``: each text once, and at most `MOST_REMARKS` texts."""
        if text in self._remarks or len(self._remarks) > MOST_REMARKS:
            return
        self._remarks.add(text)
        self.say(text if len(self._remarks) <= MOST_REMARKS else "further invalid messages are not reported")
