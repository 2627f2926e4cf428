"""Messages of the rosbridge v2 protocol, as far as an action server needs them; pure.

Written from ROSBRIDGE_PROTOCOL.md of RobotWebTools/rosbridge_suite, commit 01cc6a1, sections 3.2.1 to 3.2.5 (topics)
and 3.2.10 to 3.2.15 (actions). What comes in is bounded before it is parsed, and is an object with an ``op``, or
nothing.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import IntEnum
from typing import Any

from hpop.base.text import shown
from hpop.errors import RosError
from hpop.frontier import strict_json
from hpop.ros.interface import Interface
from hpop.ros.messages import Message

ACTION = "nav2_msgs/action/ComputePathToPose"
TEXT = "std_msgs/msg/String"
MOST_BYTES = 2**20  # of a message that comes in: a goal has 1 kB
LONGEST_ID = 1000  # characters
THROTTLE = 100  # ms between two poses of the robot, at least


class GoalStatus(IntEnum):
    """Ends of a goal, as in action_msgs/msg/GoalStatus."""

    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


def parsed(data: str | bytes) -> Mapping[str, Any]:
    """A message that came in: an object whose ``op`` is text. Raises RosError for anything else, however it is made."""
    if isinstance(data, bytes):
        raise RosError("a binary message, which is asked for nowhere")
    if len(data) > MOST_BYTES:
        raise RosError(f"a message of {len(data):,} characters, more than the {MOST_BYTES:,} that are taken")
    try:
        message = strict_json.parse(data.encode())
    except RecursionError:
        raise RosError("brackets nested too deeply") from None
    except ValueError as error:  # no JSON, no UTF-8, a number too large
        raise RosError(f"a message that is no JSON: {shown(str(error))}") from None
    if not isinstance(message, dict) or not isinstance(message.get("op"), str):
        raise RosError(f"expected an object with an op, got {shown(message)}")
    return message


def goal_id(message: Mapping[str, Any]) -> str:
    """The id of a goal, which the protocol lets be text or a whole number; RosError for what is neither."""
    given = message.get("id")
    if isinstance(given, int) and not isinstance(given, bool):
        given = str(given)
    if not isinstance(given, str) or not 0 < len(given) <= LONGEST_ID:
        raise RosError(f"a goal has an id, got {shown(given)}")
    return given


def encoded(message: Message) -> str:
    """A message as it is sent."""
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


def greetings(known: Interface) -> list[Message]:
    """What is said when a connection is there: what is offered, and what is listened to."""
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
    """What is said before a connection is closed."""
    return [
        {"op": "unadvertise_action", "action": known.action},
        {"op": "unsubscribe", "topic": known.pose_topic},
        {"op": "unadvertise", "topic": known.options_topic},
    ]


def feedback(known: Interface, goal: str) -> Message:
    """That a goal is being planned: the feedback of ComputePathToPose has no fields."""
    return {"op": "action_feedback", "id": goal, "action": known.action, "values": {}}


def result(known: Interface, goal: str, status: GoalStatus, values: Message) -> Message:
    """How a goal ended.

    ``result`` is true whatever the status: where it is false the bridge throws the values away, error code and all, and
    aborts the goal (rosbridge_library/capabilities/action_result.py, commit 1101795); it takes the status from here.
    """
    told = {"op": "action_result", "id": goal, "action": known.action, "values": values}
    return {**told, "status": int(status), "result": True}


def publication(known: Interface, told: Message) -> Message:
    """What is told on the topic of options."""
    return {"op": "publish", "topic": known.options_topic, "msg": {"data": encoded(told)}}
