"""The action server: goals are accepted at once and planned in a thread, one at a time, the newest first.

It knows messages, and no network: :mod:`hpop.ros.bridge` brings them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from threading import Condition, Thread
from time import monotonic
from typing import Any

from hpop.base.arguments import checked_arguments
from hpop.base.text import printable, shown
from hpop.errors import RosError
from hpop.ros import protocol
from hpop.ros.messages import Message, PlanarPose, planar_pose
from hpop.ros.planning import Planning
from hpop.ros.protocol import Answer, ErrorCode, Failure, canceled, failed
from hpop.runtime.status import Progress, log

Send = Callable[[str], None]
ALIVE = 1.0  # s between two pieces of feedback, at least
MOST_REMARKS = 20  # on messages that make no sense; who sends more does so on purpose
FAREWELL = 10.0  # s for planning to be given up


class _GivenUp(Exception):
    """Planning that nobody waits for any more."""


@dataclass(eq=False)
class _Goal:
    """A goal that was accepted.

    id    of the protocol
    args  its fields, as they came
    open  whether its end is still to be told
    """

    id: str
    args: Any
    open: bool = True


@checked_arguments
class PathServer:
    """Answers the messages of a bridge; ``connected``, ``received`` and ``disconnected`` are called by one thread.

    A goal that comes while another is planned takes its place, which is aborted: Nav2 asks anew every second. Messages
    that make no sense are told once each, and ignored.

    Parameters
    ----------
    say : is told, in a line of text, what happens
    """

    def __init__(self, planning: Planning, *, say: Callable[[str], None] = log.info) -> None:
        self.planning, self.known, self.say = planning, planning.known, say
        self._changed = Condition()
        self._send: Send | None = None
        self._robot: PlanarPose | None = None
        self._next: _Goal | None = None
        self._now: _Goal | None = None
        self._closed = False
        self._remarks: set[str] = set()
        self._thread = Thread(target=self._plan, name="hpop-ros-planning", daemon=True)
        self._thread.start()

    # Called with what the bridge brings

    def connected(self, send: Send) -> None:
        """Offer the action on a new connection. ``send`` may be called by any thread, and raises nothing."""
        with self._changed:
            self._send, self._robot = send, None
        for message in protocol.greetings(self.known):
            send(protocol.encoded(message))

    def received(self, data: str | bytes) -> None:
        """Take a message; one that makes no sense is remarked on and ignored."""
        try:
            message = protocol.parsed(data)
            take = self._ops().get(message["op"])
            if take is None:
                raise RosError(f"op {shown(message['op'])}, which an action server is not told")
            take(message)
        except RosError as error:
            self._remark(f"ignored {error}")

    def disconnected(self) -> None:
        """Drop all goals when the connection is lost: the bridge has aborted them."""
        with self._changed:
            self._send = None
            for goal in (self._next, self._now):
                if goal is not None:
                    goal.open = False
            self._next = None

    def close(self) -> None:
        """Give up what is planned, and end."""
        with self._changed:
            self._closed = True
        self.disconnected()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(FAREWELL)

    def _ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        return {"send_action_goal": self._accept, "cancel_action_goal": self._cancel, "publish": self._heard}

    def _accept(self, message: Mapping[str, Any]) -> None:
        self._check_action(message)
        goal = _Goal(protocol.goal_id(message), message.get("args"))
        with self._changed:
            replaced = [one for one in (self._now, self._next) if one is not None and one.open]
            self._next = goal
            self._changed.notify_all()
        why = Failure(ErrorCode.UNKNOWN, "a newer goal took its place")
        for one in replaced:
            self._end(one, failed(self.known, why, 0.0))
        self._tell(protocol.feedback(self.known, goal.id))

    def _cancel(self, message: Mapping[str, Any]) -> None:
        self._check_action(message)
        asked = protocol.goal_id(message)
        with self._changed:
            found = [one for one in (self._now, self._next) if one is not None and one.open and one.id == asked]
        if not found:
            raise RosError(f"cancel_action_goal of {shown(asked)}, which is not being planned")
        for one in found:
            self._end(one, canceled(self.known))

    def _heard(self, message: Mapping[str, Any]) -> None:
        if message.get("topic") != self.known.pose_topic:
            raise RosError(f"a message of topic {shown(message.get('topic'))}, which was not asked for")
        pose = planar_pose(message.get("msg"), "the robot's pose")
        if pose.frame != self.known.frame_id:
            raise RosError(f"a pose of the robot in the frame {shown(pose.frame)}, expected {self.known.frame_id}")
        with self._changed:
            self._robot = pose

    def _check_action(self, message: Mapping[str, Any]) -> None:
        if message.get("action") != self.known.action:
            raise RosError(f"a goal of action {shown(message.get('action'))}, which is not offered here")

    # What is planned

    def _plan(self) -> None:
        """Plan one goal after the other, until all is over."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._next is not None)
                if self._closed:
                    return
                goal, self._next, robot = self._next, None, self._robot
                self._now = goal
            assert goal is not None
            answer = self._answer(goal, robot)
            if answer is not None:
                self._end(goal, answer)
            with self._changed:
                self._now = None

    def _answer(self, goal: _Goal, robot: PlanarPose | None) -> Answer | None:
        """Return the result of planning, None where no client waits for it; the server survives any error."""
        told = monotonic()

        def follow(progress: Progress) -> None:
            nonlocal told
            if not goal.open:
                raise _GivenUp
            if monotonic() - told >= ALIVE:
                told = monotonic()
                self._tell(protocol.feedback(self.known, goal.id))

        try:
            return self.planning.answer(goal.args, robot, follow)
        except _GivenUp:
            return None
        except Exception as error:  # a bug, or code of the user's own: this goal fails, and no other
            log.exception("planning failed")
            said = printable(f"{type(error).__name__}: {error}")
            return failed(self.known, Failure(ErrorCode.UNKNOWN, f"planning failed ({said})"), 0.0)

    def _end(self, goal: _Goal, answer: Answer) -> None:
        """Tell how a goal ended, once."""
        with self._changed:
            if not goal.open:
                return
            goal.open = False
        self._tell(protocol.result(self.known, goal.id, answer.status, answer.values))
        if answer.options is not None:
            self._tell(protocol.publication(self.known, {"goal": goal.id, **answer.options}))
        self.say(_line(goal, answer))

    def _tell(self, message: Message) -> None:
        """Send a message, where there is somebody to send it to."""
        with self._changed:
            send = self._send
        if send is not None:
            send(protocol.encoded(message))

    def _remark(self, text: str) -> None:
        """Tell what is wrong with messages, each kind once and not for ever."""
        if text in self._remarks or len(self._remarks) > MOST_REMARKS:
            return
        self._remarks.add(text)
        self.say(text if len(self._remarks) <= MOST_REMARKS else "of messages that make no sense no more are told")


def _line(goal: _Goal, answer: Answer) -> str:
    """Return how a goal ended, in words."""
    poses = len(answer.values["path"]["poses"])
    seconds = answer.values["planning_time"]["sec"] + 1e-9 * answer.values["planning_time"]["nanosec"]
    if answer.options is not None:
        told = answer.options
        names = [name for name, row in told["named"].items() if row == told["chosen"]]
        what = f"row {told['chosen']} of {told['points']:,}{f' ({names[0]})' if names else ''}, {poses:,} poses"
    else:
        what = answer.values.get("error_msg", "")
    return printable(f"goal {goal.id}: {answer.status.name.lower()} after {seconds:.2f} s; {what}".rstrip("; "))
