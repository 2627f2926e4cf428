"""The result of nav2_msgs/action/ComputePathToPose, and what went wrong in its numbers."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from hpop.base.text import printable
from hpop.ros.interface import FIELDS, Interface
from hpop.ros.messages import SECOND, Message, header, stamp
from hpop.ros.protocol import GoalStatus

LONGEST = 1000  # characters of an error's message


class ErrorCode(IntEnum):
    """What went wrong, as numbered since Iron (docs.ros.org, nav2_msgs of Iron, Jazzy and Kilted); Humble has none."""

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
    """A goal that has no path: the code, and why, in words."""

    def __init__(self, code: ErrorCode, why: str) -> None:
        super().__init__(why)
        self.code, self.why = code, why


class Answer(NamedTuple):
    """How a goal ended: its status, the fields of the result, and the front that is told beside it, if there is one."""

    status: GoalStatus
    values: Message
    options: Message | None = None


def values_of(
    known: Interface, path: Message | None, seconds: float, code: ErrorCode = ErrorCode.NONE, why: str = ""
) -> Message:
    """The fields of a result that the distribution has; without a path an empty one."""
    whole: Message = {
        "path": path or {"header": header(0, known.frame_id), "poses": []},
        "planning_time": stamp(round(seconds * SECOND)),
        "error_code": int(code),
        "error_msg": printable(why)[:LONGEST],
    }
    return {name: whole[name] for name in FIELDS[known.distribution]}


def failed(known: Interface, failure: Failure, seconds: float) -> Answer:
    """A goal that was aborted, and why."""
    return Answer(GoalStatus.ABORTED, values_of(known, None, seconds, failure.code, failure.why))


def canceled(known: Interface) -> Answer:
    """A goal that was given up because its client asked for that."""
    return Answer(GoalStatus.CANCELED, values_of(known, None, 0.0))
