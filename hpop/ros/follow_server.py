"""Robots over rosbridge: topics of poses, maps and people in, velocity commands out; and Nav2's navigation actions.

:class:`RobotServer` is what a :class:`.Bridge` connects; :class:`FollowServer` also offers the actions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from threading import Condition, Event, Thread
from time import monotonic, time_ns
from typing import Any

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.errors import RosError
from hpop.ros import protocol
from hpop.ros.follow_plans import Ended, FollowPlanner, FollowSettings, Planned
from hpop.ros.following import Follower
from hpop.ros.messages import SECOND, Message, mapping, time_of
from hpop.ros.navigation import FollowInterface, Hearing, Listener
from hpop.ros.protocol import GoalStatus, MessageServer
from hpop.runtime.limits import log
from hpop.simulation.tracking import Command

MOST_BYTES = 2**25  # largest incoming message: a map of 8 million cells as JSON
TOLD = 0.2  # s between messages of the state and of feedback
CLOCK, STATIC = "/clock", "/tf_static"
MOST_EARLY = 200  # messages that are kept until a simulation begins
THROTTLE = 5  # least time between messages of the clock, ms: more a second than are read would wait
CLOCK_SUBSCRIPTION: Message = {
    "op": "subscribe",
    "topic": CLOCK,
    "type": "rosgraph_msgs/msg/Clock",
    "throttle_rate": THROTTLE,
    "queue_length": 1,
}
BACK = 0.5  # s by which simulated time is before the next command if it was set back
WAKES = 0.1  # s after which a thread looks whether it is to end


class WallClock:
    """Time of this machine, s, of which only differences count."""

    @property
    def has_begun(self) -> bool:
        """True if there is a time."""
        return True

    def now(self) -> float:
        """Return the time, s."""
        return monotonic()

    def stamp(self) -> int:
        """Return the time for stamps of messages, ns."""
        return time_ns()

    def wait(self, due: float, closed: Event) -> float | None:
        """Wait until a time ``due``, s, and return the time; None if ``closed`` was set meanwhile."""
        return None if closed.wait(max(0.0, due - monotonic())) else monotonic()


class SimulatedClock(WallClock):
    """Time of a simulation, s, as the topic /clock says it: it may be paused, run at any rate, and be set back."""

    def __init__(self) -> None:
        self._condition, self._now = Condition(), -math.inf

    def hear(self, message: Any) -> bool:
        """Take a message of /clock; return True if its time is before the last one. RosError for an invalid message."""
        now = time_of({"header": {"stamp": mapping(message, "the clock").get("clock")}}, "the clock") / SECOND
        with self._condition:
            before, self._now = self._now, now
            self._condition.notify_all()
        return now < before

    @property
    def has_begun(self) -> bool:
        """True once a message has come."""
        return self._now > -math.inf

    def now(self) -> float:
        """Return the time, s; RosError if no message has come yet."""
        if self._now == -math.inf:
            raise RosError(f"no time has come on {CLOCK}; start the simulation, or follow without simulated time")
        return self._now

    def stamp(self) -> int:
        """Return the time for stamps of messages, ns."""
        return round(self.now() * SECOND)

    def wait(self, due: float, closed: Event) -> float | None:
        """Wait until a time, s, and return the time; None if ``closed`` was set.

        If no time is known yet, wait for the first message. If the time is set back by more than `BACK` s before
        ``due``, return at once.
        """
        with self._condition:
            while not closed.is_set() and (self._now == -math.inf or due - BACK <= self._now < due):
                self._condition.wait(WAKES)
            return None if closed.is_set() else self._now


class RobotServer(MessageServer):
    """Server that commands a robot over a bridge: it hears the topics of ``known``, and sends velocity commands.

    A thread sends commands at the rate of ``known``, from :meth:`begin` on. When the connection is lost the base must
    stop by itself, as it gets no commands.

    listener  is told what the robot's topics say
    known     names of topics and frames
    say       called with a line of text for each event
    clock     gives the times; a :class:`SimulatedClock` listens to the topic /clock
    told, heard, actions  topics that are published and subscribed to, and offered actions, with their types
    """

    def __init__(
        self,
        listener: Listener,
        known: FollowInterface,
        *,
        say: Callable[[str], None],
        clock: WallClock | None = None,
    ) -> None:
        super().__init__(say=say, most_bytes=MOST_BYTES)
        self.known, self.hearing, self.clock = known, Hearing(listener, known), clock or WallClock()
        self.told, self.heard = known.told, known.heard
        self.actions: dict[str, str] = {}
        self._early: list[tuple[str, Any]] = []  # messages that came before the first time of a simulation
        self._closed = Event()
        self._thread = Thread(target=self._run, name="hpop-ros-commands", daemon=True)

    def greetings(self) -> list[Message]:
        """Return the messages that open a connection."""
        return [
            *({"op": "advertise", "topic": topic, "type": kind} for topic, kind in self.told.items()),
            *([CLOCK_SUBSCRIPTION] if isinstance(self.clock, SimulatedClock) else []),
            *({"op": "subscribe", "topic": topic, "type": kind} for topic, kind in self.heard.items()),
            *({"op": "advertise_action", "action": action, "type": kind} for action, kind in self.actions.items()),
        ]

    def farewells(self) -> list[Message]:
        """Return the messages that end a connection; the first one commands the robot to stand."""
        known = self.known
        return [
            self.publication(known.cmd_topic, known.twist(Command(0.0, 0.0), 0)),
            *({"op": "unadvertise_action", "action": action} for action in self.actions),
            *({"op": "unsubscribe", "topic": topic} for topic in self.heard),
            *({"op": "unadvertise", "topic": topic} for topic in self.told),
        ]

    def ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        """Return the methods that handle incoming messages, by the message's ``op``."""
        return {"publish": self._heard}

    def begin(self) -> None:
        """Begin to send commands."""
        self._thread.start()

    def close(self) -> None:
        """Send nothing more, and end the thread."""
        self._closed.set()
        self._thread.join(10.0)

    def turn(self, now: float) -> Command | None:
        """Return the command at a time, s; None for none. Called at the rate of ``known`` while there is a connection.

        After an error the robot is commanded to stand.
        """
        raise NotImplementedError

    def failed(self, error: Exception) -> None:
        """Report an error in :meth:`turn`, which is a bug."""
        log.exception("following failed")
        self.remark(f"following failed ({type(error).__name__}: {error})")

    def set_back(self) -> None:
        """Forget what has been heard, but for maps and static transforms, because simulated time was set back."""
        self.hearing.forget_times()

    def _heard(self, message: Mapping[str, Any]) -> None:
        topic, told = str(message.get("topic")), message.get("msg")
        if topic == CLOCK and isinstance(self.clock, SimulatedClock):
            if self.clock.hear(told):
                self.set_back()
            early, self._early = self._early, []
            for before, what in early:
                try:
                    self.hearing.hear(before, what, self.clock.now())
                except RosError as error:
                    self.remark(str(error))
            return
        if self.clock.has_begun:
            self.hearing.hear(topic, told, self.clock.now())
        else:
            self._keep(topic, told)

    def _keep(self, topic: str, told: Any) -> None:
        """Keep a message that came before the first time of a simulation: the last of each topic, all static frames."""
        if topic not in self.heard:
            raise RosError(f"a message of topic {shown(topic)}, which was not subscribed to")
        kept = [one for one in self._early if one[0] != topic or topic == STATIC]
        self._early = [*kept[-MOST_EARLY:], (topic, told)]

    def _run(self) -> None:
        """Send commands at a fixed rate, until closed."""
        period, due = 1.0 / self.known.rate, -math.inf
        while not self._closed.is_set():
            now = self.clock.wait(due, self._closed)
            if now is None:
                continue
            due = max(due + period, now) if now >= due > -math.inf else now + period
            if not self.is_connected:
                continue
            try:
                command = self.turn(now)
            except Exception as error:
                self.failed(error)
                command = Command(0.0, 0.0)
            if command is not None:
                self.tell(self.publication(self.known.cmd_topic, self.known.twist(command, self.clock.stamp())))

    @staticmethod
    def publication(topic: str, message: Message) -> Message:
        """Return the message that publishes a message on a topic."""
        return {"op": "publish", "topic": topic, "msg": message}


@checked_arguments
class FollowServer(RobotServer):
    """Action server that drives a robot to goals over a bridge.

    A new goal aborts the one before. When the connection is lost the goal is given up.

    Parameters
    ----------
    planner : plans the goals
    settings : limits and the choice among trajectories
    known : names of actions, topics and frames
    say : called with a line of text for each event
    clock : gives the times; None for the time of this machine
    """

    def __init__(
        self,
        planner: FollowPlanner,
        settings: FollowSettings,
        known: FollowInterface,
        *,
        say: Callable[[str], None],
        clock: WallClock | None = None,
    ) -> None:
        self._executor = ThreadPoolExecutor(1, "hpop-ros-planning")
        self.follower = Follower(planner, settings, self._executor, say=say)
        super().__init__(self.follower, known, say=say, clock=clock)
        self.actions = known.actions
        self._open: dict[str, str] = {}  # actions of the goals whose results are still to be sent
        self._state_sent = -math.inf
        self.begin()

    @property
    def offers(self) -> str:
        """Offered actions, for a line of text."""
        return f"goals of {' and '.join(self.known.actions)} are driven"

    def ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        """Return the methods that handle incoming messages, by the message's ``op``."""
        return {**super().ops(), "send_action_goal": self._accept, "cancel_action_goal": self._cancel}

    def lost(self) -> None:
        """Give up the goal, and forget poses and transforms, after the connection is lost."""
        self.follower.drop()
        self.hearing.reset()
        self._open.clear()

    def set_back(self) -> None:
        """Give up the goal, because simulated time was set back."""
        self.follower.drop("the simulated time was set back")
        super().set_back()

    def close(self) -> None:
        """Stop following and end the threads."""
        self.follower.drop()
        super().close()
        self._executor.shutdown(wait=False, cancel_futures=True)

    def _accept(self, message: Mapping[str, Any]) -> None:
        """Follow the goal of an action message; an invalid goal is aborted at once."""
        action = self._checked_action(message)
        goal = protocol.goal_id(message)
        try:
            poses, now = self.known.goal_poses(message.get("args")), self.clock.now()
        except RosError as error:
            self._send_result(action, Ended(goal, False, str(error)))
            raise
        self._open[goal] = action
        self.follower.follow(goal, poses, now)

    def _cancel(self, message: Mapping[str, Any]) -> None:
        self._checked_action(message)
        self.follower.cancel(protocol.goal_id(message))

    def _checked_action(self, message: Mapping[str, Any]) -> str:
        action = message.get("action")
        if action not in self.known.actions:
            raise RosError(
                f"action must be one that is offered here, {', '.join(self.known.actions)}, got {shown(action)}"
            )
        return str(action)

    def turn(self, now: float) -> Command | None:
        """Return the command at a time, s, None for none; send what has happened, and the state every `TOLD` s."""
        step = self.follower.step(now)
        for event in step.events:
            self._send_event(event)
        if abs(now - self._state_sent) >= TOLD:  # simulated time may be set back
            self._state_sent = now
            self._send_state(self.follower.state(now))
        return step.command

    def failed(self, error: Exception) -> None:
        """Report a bug, and give up the goal."""
        super().failed(error)
        self.follower.drop()

    def _send_state(self, state: Message) -> None:
        self.tell(self.publication(self.known.own("state"), {"data": protocol.encoded(state)}))
        action = self._open.get(state["goal"])
        if action is not None:
            values = self.known.feedback(action, state)
            self.tell(protocol.action_feedback(action, state["goal"], values))

    def _send_event(self, event: Ended | Planned) -> None:
        if isinstance(event, Ended):
            self._send_result(self._open.pop(event.goal, self.known.action), event)
            return
        self.tell(self.publication(self.known.own("options"), {"data": protocol.encoded(event.options)}))
        if event.path is not None:
            self.tell(self.publication(self.known.own("path"), event.path))

    def _send_result(self, action: str, ended: Ended) -> None:
        failed = GoalStatus.CANCELED if ended.canceled else GoalStatus.ABORTED
        status = GoalStatus.SUCCEEDED if ended.reached else failed
        self.tell(protocol.action_result(action, ended.goal, status, self.known.result(action, ended)))
