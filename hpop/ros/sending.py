"""Goals of arms, as `hpop export` writes them, sent to the action of a controller or of MoveIt through rosbridge."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.base.text import printable, shown
from hpop.errors import OptionError, RosError
from hpop.ros.messages import Message, mapping
from hpop.ros.protocol import NAME, GoalStatus, MessageServer

MOST_BYTES = 2**26  # of a file
ACTIONS = {
    ".follow.yaml": (
        "/joint_trajectory_controller/follow_joint_trajectory",
        "control_msgs/action/FollowJointTrajectory",
    ),
    ".moveit.yaml": ("/execute_trajectory", "moveit_msgs/action/ExecuteTrajectory"),
}
"""Action and its type, by the ending of a file of `hpop export`."""


class ArmGoal(NamedTuple):
    """Goal of an action: its name, its type, and the fields of the goal."""

    action: str
    kind: str
    fields: Message

    @classmethod
    def from_file(cls, path: Path, action: str = "") -> ArmGoal:
        """Read a goal that `hpop export` wrote as follow-joint-trajectory or moveit; OptionError for another file.

        ``action`` is the name of the action; "" for the usual one.
        """
        import yaml  # start-up time

        usual, kind = next((found for end, found in ACTIONS.items() if path.name.endswith(end)), ("", ""))
        if not kind:
            raise OptionError(
                f"expected a file that ends in {' or '.join(ACTIONS)}, got {shown(path.name)}; write it with hpop "
                "export FOLDER --body joints --format follow-joint-trajectory,moveit"
            )
        name = action or usual
        if not NAME.fullmatch(name) or "//" in name or name.endswith("/"):
            raise OptionError(f"action must be a name of ROS, such as {usual}, got {shown(action)}")
        try:
            if path.stat().st_size > MOST_BYTES:
                raise OptionError(f"{path} has more than {MOST_BYTES:,} bytes; export it with a lower rate")
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            fields = yaml.load(path.read_text(encoding="utf-8"), loader)
        except (OSError, ValueError, yaml.YAMLError) as error:
            raise OptionError(f"{path} cannot be read ({printable(str(error))}); export it again") from None
        if not isinstance(fields, dict) or "trajectory" not in fields:
            raise OptionError(f"{path} has no trajectory; export it again")
        return cls(name, kind, fields)


@checked_arguments
class GoalSender(MessageServer):
    """Client of an action behind a :class:`.Bridge`, which sends one goal and waits for its result.

    A goal is sent once: if the connection is lost meanwhile, the robot's controller decides what happens.

    Parameters
    ----------
    goal : the goal
    ended : called once with how it ended: "" if it succeeded, else the reason
    say : called with a line of text for each event
    """

    def __init__(self, goal: ArmGoal, ended: Callable[[str], None], *, say: Callable[[str], None]) -> None:
        super().__init__(say=say)
        self.goal, self._ended = goal, ended
        self._id = f"hpop-{uuid.uuid4().hex}"
        self._is_open = False

    @property
    def offers(self) -> str:
        """Goal that is sent, for a line of text."""
        return f"a goal of {self.goal.action} is sent"

    def greetings(self) -> list[Message]:
        """Return the message that sends the goal."""
        self._is_open = True
        goal = {"action": self.goal.action, "action_type": self.goal.kind, "args": self.goal.fields}
        return [{"op": "send_action_goal", "id": self._id, **goal, "feedback": False}]

    def farewells(self) -> list[Message]:
        """Return the message that cancels the goal, unless it has ended."""
        cancel = {"op": "cancel_action_goal", "id": self._id, "action": self.goal.action}
        return [cancel] if self._is_open else []

    def ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        """Return the methods that handle incoming messages, by the message's ``op``."""
        return {"action_result": self._result, "action_feedback": lambda message: None, "status": self._status}

    def lost(self) -> None:
        """Report that the connection was lost before the result."""
        self._end("the connection was lost; it is not known whether the arm moves on")

    def _result(self, message: Mapping[str, Any]) -> None:
        if message.get("id") != self._id:
            raise RosError(f"a result of {shown(message.get('id'))}, which was not sent")
        if message.get("result") is not True:  # then the values are a text
            self._end(printable(f"the goal failed: {message.get('values')}"))
        else:
            self._end(outcome(message.get("status"), mapping(message.get("values"), "the result")))

    def _status(self, message: Mapping[str, Any]) -> None:
        if message.get("level") == "error":
            self._end(printable(f"the bridge refused the goal: {message.get('msg')}"))

    def _end(self, why: str) -> None:
        if self._is_open:
            self._is_open = False
            self._ended(why)


def outcome(status: Any, values: Mapping[str, Any]) -> str:
    """Return "" if a goal was reached, else the reason why not.

    status  final status of the action's goal (`GoalStatus`)
    values  fields of the result, such as "error_code"
    """
    if status != GoalStatus.SUCCEEDED:
        said = values.get("error_string") or values.get("error_code") or ""
        known = next((one.name.lower() for one in GoalStatus if one == status), shown(status))
        return printable(f"the goal was {known}: {said}".rstrip(": "))
    code = values.get("error_code", 0)
    code = code.get("val", 0) if isinstance(code, Mapping) else code
    fine = code in (0, 1)  # SUCCESSFUL of control_msgs, SUCCESS of moveit_msgs
    return "" if fine else printable(f"the goal ended with the error code {shown(code)}")
