"""Follower over rosbridge: Nav2's navigation actions, topics of poses, maps and people in, velocity commands out.

:class:`FollowServer` is what a :class:`.Bridge` connects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from threading import Event, Thread
from time import monotonic, time_ns
from typing import Any

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.errors import RosError
from hpop.ros import protocol
from hpop.ros.follow_plans import Ended, FollowPlanner, FollowSettings, Planned
from hpop.ros.following import Follower
from hpop.ros.messages import Message
from hpop.ros.navigation import FollowInterface, Hearing
from hpop.ros.protocol import GoalStatus, MessageServer
from hpop.runtime.status import log
from hpop.simulation.tracking import Command

MOST_BYTES = 2**25  # largest incoming message: a map of 8 million cells as JSON
TOLD = 0.2  # s between messages of the state and of feedback


@checked_arguments
class FollowServer(MessageServer):
    """Action server that drives a robot to goals over a bridge.

    A thread sends commands at the rate of ``known``. A new goal aborts the one before. When the connection is lost the
    goal is given up; the base must stop by itself then, as it gets no commands.

    Parameters
    ----------
    planner : plans the goals
    settings : limits and the choice among trajectories
    known : names of actions, topics and frames
    say : called with a line of text for each event
    """

    def __init__(
        self,
        planner: FollowPlanner,
        settings: FollowSettings,
        known: FollowInterface,
        *,
        say: Callable[[str], None],
    ) -> None:
        super().__init__(say=say, most_bytes=MOST_BYTES)
        self.known = known
        self._executor = ThreadPoolExecutor(1, "hpop-ros-planning")
        self.follower = Follower(planner, settings, self._executor, say=say)
        self.hearing = Hearing(self.follower, known)
        self._actions: dict[str, str] = {}  # of the goals whose results are still to be sent
        self._closed = Event()
        self._thread = Thread(target=self._run, name="hpop-ros-commands", daemon=True)
        self._thread.start()

    @property
    def offers(self) -> str:
        """Offered actions, for a line of text."""
        return f"goals of {' and '.join(self.known.actions)} are driven"

    def greetings(self) -> list[Message]:
        """Return the messages that open a connection."""
        known = self.known
        return [
            *({"op": "advertise", "topic": topic, "type": kind} for topic, kind in known.told.items()),
            *({"op": "subscribe", "topic": topic, "type": kind} for topic, kind in known.heard.items()),
            *({"op": "advertise_action", "action": action, "type": kind} for action, kind in known.actions.items()),
        ]

    def farewells(self) -> list[Message]:
        """Return the messages that end a connection; the first one commands the robot to stand."""
        known = self.known
        return [
            self._publication(known.cmd_topic, known.twist(Command(0.0, 0.0), 0)),
            *({"op": "unadvertise_action", "action": action} for action in known.actions),
            *({"op": "unsubscribe", "topic": topic} for topic in known.heard),
            *({"op": "unadvertise", "topic": topic} for topic in known.told),
        ]

    def ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        """Return the methods that handle incoming messages, by the message's ``op``."""
        return {"send_action_goal": self._accept, "cancel_action_goal": self._cancel, "publish": self._heard}

    def lost(self) -> None:
        """Give up the goal, and forget poses and transforms, after the connection is lost."""
        self.follower.drop()
        self.hearing.reset()
        self._actions.clear()

    def close(self) -> None:
        """Stop following and end the threads."""
        self._closed.set()
        self.follower.drop()
        self._thread.join(10.0)
        self._executor.shutdown(wait=False, cancel_futures=True)

    def _accept(self, message: Mapping[str, Any]) -> None:
        """Follow the goal of an action message; an invalid goal is aborted at once."""
        action = self._checked_action(message)
        goal = protocol.goal_id(message)
        try:
            poses = self.known.goal_poses(message.get("args"))
        except RosError as error:
            self._send_result(action, Ended(goal, False, str(error)))
            raise
        self._actions[goal] = action
        self.follower.follow(goal, poses, monotonic())

    def _cancel(self, message: Mapping[str, Any]) -> None:
        self._checked_action(message)
        self.follower.cancel(protocol.goal_id(message))

    def _heard(self, message: Mapping[str, Any]) -> None:
        self.hearing.hear(str(message.get("topic")), message.get("msg"), monotonic())

    def _checked_action(self, message: Mapping[str, Any]) -> str:
        action = message.get("action")
        if action not in self.known.actions:
            raise RosError(
                f"action must be one that is offered here, {', '.join(self.known.actions)}, got {shown(action)}"
            )
        return str(action)

    def _run(self) -> None:
        """Send commands at a fixed rate, and the state now and then, until closed."""
        period, told = 1.0 / self.known.rate, -math.inf
        due = monotonic()
        while not self._closed.wait(max(0.0, due - monotonic())):
            now = monotonic()
            due = max(due + period, now)
            if not self.is_connected:
                continue
            try:
                step = self.follower.step(now)
            except Exception as error:  # a bug: the robot stands, and the goal ends
                log.exception("following failed")
                self.remark(f"following failed ({type(error).__name__}: {error})")
                self.follower.drop()
                self.tell(self._publication(self.known.cmd_topic, self.known.twist(Command(0.0, 0.0), time_ns())))
                continue
            if step.command is not None:
                self.tell(self._publication(self.known.cmd_topic, self.known.twist(step.command, time_ns())))
            for event in step.events:
                self._send_event(event)
            if now - told >= TOLD:
                told = now
                self._send_state(self.follower.state(now))

    def _send_state(self, state: Message) -> None:
        self.tell(self._publication(self.known.own("state"), {"data": protocol.encoded(state)}))
        action = self._actions.get(state["goal"])
        if action is not None:
            values = self.known.feedback(action, state)
            self.tell(protocol.action_feedback(action, state["goal"], values))

    def _send_event(self, event: Ended | Planned) -> None:
        if isinstance(event, Ended):
            self._send_result(self._actions.pop(event.goal, self.known.action), event)
            return
        self.tell(self._publication(self.known.own("options"), {"data": protocol.encoded(event.options)}))
        if event.path is not None:
            self.tell(self._publication(self.known.own("path"), event.path))

    def _send_result(self, action: str, ended: Ended) -> None:
        failed = GoalStatus.CANCELED if ended.canceled else GoalStatus.ABORTED
        status = GoalStatus.SUCCEEDED if ended.reached else failed
        self.tell(protocol.action_result(action, ended.goal, status, self.known.result(action, ended)))

    def _publication(self, topic: str, message: Message) -> Message:
        return {"op": "publish", "topic": topic, "msg": message}
