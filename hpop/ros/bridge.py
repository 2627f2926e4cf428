"""Action server for ComputePathToPose, and the websocket connection that connects it to rosbridge.

Goals are accepted at once, and planned one at a time in a thread. A new goal replaces older ones. The connection
reconnects whenever it breaks. Incoming messages are limited in size, number and rate; further ones wait at the sender.
A bridge that accepts no data is disconnected after a while.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from socket import SO_SNDTIMEO, SOL_SOCKET
from threading import Condition, Event, Lock, Thread
from time import monotonic
from typing import Any
from urllib.parse import urlsplit

from hpop.base.arguments import checked_arguments
from hpop.base.lazy import library
from hpop.base.text import printable, shown
from hpop.errors import OptionError, RosError
from hpop.ros import protocol
from hpop.ros.messages import Message, PlanarPose, planar_pose
from hpop.ros.planning import GoalPlanner
from hpop.ros.protocol import ErrorCode, Failure, GoalResult, canceled, failed
from hpop.runtime.interrupts import WAKING, interrupts_noted, waited
from hpop.runtime.limits import Progress, log

ALIVE = 1.0  # least time between two feedback messages, s
FAREWELL = 10.0  # s to wait until planning stops


class _GivenUp(Exception):
    """Signal that stops planning because no client waits for the result any more."""


@dataclass(eq=False)
class _Goal:
    """Goal that the server has accepted.

    id    text by which the bridge names the goal
    args  fields of the goal, as received
    open  whether its result is still to be sent
    """

    id: str
    args: Any
    open: bool = True


@checked_arguments
class PathServer(protocol.MessageServer):
    """Action server that plans goals; a bridge passes messages to and from it.

    A new goal aborts the goal that is being planned, because Nav2 sends a new goal every second.

    Parameters
    ----------
    planning : planner of the goals
    say : called with a line of text for each event
    """

    def __init__(self, planning: GoalPlanner, *, say: Callable[[str], None] = log.info) -> None:
        super().__init__(say=say)
        self.planning, self.known = planning, planning.known
        self._changed = Condition()
        self._robot: PlanarPose | None = None
        self._next: _Goal | None = None
        self._now: _Goal | None = None
        self._closed = False
        self._thread = Thread(target=self._plan, name="hpop-ros-planning", daemon=True)
        self._thread.start()

    # Called by the bridge

    @property
    def offers(self) -> str:
        """Offered actions, for a line of text."""
        return f"goals of {self.known.action} are planned"

    def greetings(self) -> list[Message]:
        """Return the messages that open a connection."""
        return protocol.greetings(self.known)

    def farewells(self) -> list[Message]:
        """Return the rosbridge messages that withdraw the action and topics, sent before a connection is closed."""
        return protocol.farewells(self.known)

    def lost(self) -> None:
        """Drop all goals, and the pose of the robot."""
        with self._changed:
            for goal in (self._next, self._now):
                if goal is not None:
                    goal.open = False
            self._next = self._robot = None

    def close(self) -> None:
        """Stop planning and end the thread; wait for it for at most `FAREWELL` s."""
        with self._changed:
            self._closed = True
        self.disconnected()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(FAREWELL)

    def ops(self) -> Mapping[str, Callable[[Mapping[str, Any]], None]]:
        """Return the methods that handle incoming messages, by the message's ``op``."""
        return {"send_action_goal": self._accept, "cancel_action_goal": self._cancel, "publish": self._heard}

    def _accept(self, message: Mapping[str, Any]) -> None:
        """Accept a new goal, abort older goals that are planned or wait, and send first feedback."""
        self._check_action(message)
        goal = _Goal(protocol.goal_id(message), message.get("args"))
        with self._changed:
            replaced = [old for old in (self._now, self._next) if old is not None and old.open]
            self._next = goal
            self._changed.notify_all()
        why = Failure(ErrorCode.UNKNOWN, "a newer goal took its place")
        for old in replaced:
            self._end(old, failed(self.known, why, 0.0))
        self.tell(protocol.feedback(self.known, goal.id))

    def _cancel(self, message: Mapping[str, Any]) -> None:
        """Cancel a goal that is planned or waits; RosError if there is none with its id."""
        self._check_action(message)
        asked = protocol.goal_id(message)
        with self._changed:
            found = [one for one in (self._now, self._next) if one is not None and one.open and one.id == asked]
        if not found:
            planned = [shown(one.id) for one in (self._now, self._next) if one is not None and one.open]
            raise RosError(
                f"cancel_action_goal must name a goal that is being planned, {' or '.join(planned) or 'none now'}, "
                f"got {shown(asked)}"
            )
        for one in found:
            self._end(one, canceled(self.known))

    def _heard(self, message: Mapping[str, Any]) -> None:
        """Store the robot's pose that was published on the pose topic."""
        if message.get("topic") != self.known.pose_topic:
            raise RosError(f"a message of topic {shown(message.get('topic'))}, which was not subscribed to")
        pose = planar_pose(message.get("msg"), "the robot's pose")
        if pose.frame != self.known.frame_id:
            raise RosError(f"a pose of the robot in the frame {shown(pose.frame)}, expected {self.known.frame_id}")
        with self._changed:
            self._robot = pose

    def _check_action(self, message: Mapping[str, Any]) -> None:
        """Raise RosError unless a message is for the offered action."""
        if message.get("action") != self.known.action:
            raise RosError(
                f"action must be the one that is offered here, {self.known.action}, got {shown(message.get('action'))}"
            )

    # In the planning thread

    def _plan(self) -> None:
        """Plan one goal after another, until the server is closed."""
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

    def _answer(self, goal: _Goal, robot: PlanarPose | None) -> GoalResult | None:
        """Plan a goal and return its result; None if no client waits for it any more.

        An error in planning becomes a result with this error. ``robot`` is the pose of the robot, if known.
        """
        told = monotonic()

        def follow(progress: Progress) -> None:
            nonlocal told
            if not goal.open:
                raise _GivenUp
            if monotonic() - told >= ALIVE:
                told = monotonic()
                self.tell(protocol.feedback(self.known, goal.id))

        try:
            return self.planning.answer(goal.args, robot, follow)
        except _GivenUp:
            return None
        except Exception as error:  # a bug, or code of the user's own: this goal fails, and no other
            log.exception("planning failed")
            said = printable(f"{type(error).__name__}: {error}")
            return failed(self.known, Failure(ErrorCode.UNKNOWN, f"planning failed ({said})"), 0.0)

    def _end(self, goal: _Goal, answer: GoalResult) -> None:
        """Send the result of a goal, unless it was sent before."""
        with self._changed:
            if not goal.open:
                return
            goal.open = False
        self.tell(protocol.result(self.known, goal.id, answer.status, answer.values))
        if answer.options is not None:
            self.tell(protocol.publication(self.known, {"goal": goal.id, **answer.options}))
        self.say(_line(goal, answer))


def _line(goal: _Goal, answer: GoalResult) -> str:
    """Return a line of text that reports the end of a goal."""
    poses = len(answer.values["path"]["poses"])
    seconds = answer.values["planning_time"]["sec"] + 1e-9 * answer.values["planning_time"]["nanosec"]
    if answer.options is not None:
        told = answer.options
        names = [name for name, row in told["named"].items() if row == told["chosen"]]
        what = f"row {told['chosen']} of {told['points']:,}{f' ({names[0]})' if names else ''}, {poses:,} poses"
    else:
        what = answer.values.get("error_msg", "")
    return printable(f"goal {goal.id}: {answer.status.name.lower()} after {seconds:.2f} s; {what}".rstrip("; "))


MOST_WAITING = 16  # most unread websocket frames
MOST_A_SECOND = 500  # messages
OPENING, CLOSING, SENDING = 10.0, 2.0, 10.0  # s
# First and longest delay before connecting again, s. Each delay is twice the one before, also if a bridge accepts the
# connection and closes it at once.
DELAYS = (0.5, 30.0)
QUIET = logging.Logger("hpop.ros.websockets", logging.CRITICAL + 1)  # silent: this module itself reports errors


class Pace:
    """Limit on the number of messages per second; the caller waits when the limit is reached."""

    def __init__(self, most: int, clock: Callable[[], float], wait: Callable[[float], Any]) -> None:
        self.most, self.clock, self.wait = most, clock, wait
        self.since, self.count = clock(), 0

    def step(self) -> None:
        """Count a message; if ``most`` were counted in this second before it, first wait until the second is over."""
        now = self.clock()
        if now - self.since >= 1.0:
            self.since, self.count = now, 0
        elif self.count >= self.most:
            self.wait(self.since + 1.0 - now)
            self.since, self.count = self.clock(), 0
        self.count += 1


@checked_arguments
class Bridge:
    """Client of rosbridge that passes messages between it and a server until it is stopped.

    Parameters
    ----------
    url : such as ws://localhost:9090, or wss://
    server : answers goals that come, such as a :class:`PathServer`, or sends one (:class:`.GoalSender`)
    say : called with a line of text for each event
    delays : (first, longest), s, before attempts to connect again; each delay is twice the one before

    Raises OptionError for an invalid url, ImportError without the extra ``ros``.
    """

    def __init__(
        self,
        url: str,
        server: protocol.MessageServer,
        *,
        say: Callable[[str], None] = log.info,
        delays: tuple[float, float] = DELAYS,
    ) -> None:
        self.url, self.server, self.say, self.delays = checked_url(url), server, say, delays
        self._client: Any = library("websockets.sync.client", "a bridge to ROS", "ros")
        self._errors: Any = library("websockets.exceptions", "a bridge to ROS", "ros")
        self._stopped = Event()
        self._leaving = Lock()
        self._connection: Any = None  # None while disconnected

    def run(self) -> None:
        """Connect, serve, and reconnect whenever the connection breaks, until :meth:`stop` or Ctrl-C."""
        first, most = self.delays
        delay = first
        while not self._stopped.is_set():
            since = inf
            try:
                with self._connected() as connection:
                    since = monotonic()
                    self.say(f"connected to {self.url}: {self.server.offers}")
                    why = self._serve(connection)
            except (OSError, self._errors.WebSocketException, EOFError, ValueError) as error:
                why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            if not self._stopped.is_set():
                if monotonic() - since > most:  # the connection was stable
                    delay = first
                self.say(printable(f"no connection to {self.url} ({why}); trying again in {delay:g} s"))
                waited(self._stopped, delay)
                delay = min(2.0 * delay, most)

    def stop(self) -> None:
        """Make :meth:`run` return; may be called from any thread."""
        self._stopped.set()
        self._leave()

    def _connected(self) -> Any:
        """Open a websocket connection to the bridge."""
        return self._client.connect(
            self.url,
            compression=None,  # not needed in one network, and no message grows when unpacked
            proxy=None,
            max_size=self.server.most_bytes,
            max_queue=MOST_WAITING,
            open_timeout=OPENING,
            close_timeout=CLOSING,
            logger=QUIET,
        )

    def _serve(self, connection: Any) -> str:
        """Pass messages to the server until the connection is closed or `stop` is called; return why it ended."""
        # With a time-out, sending to a bridge that reads nothing fails instead of blocking for ever.
        seconds, rest = divmod(SENDING, 1.0)
        connection.socket.setsockopt(SOL_SOCKET, SO_SNDTIMEO, struct.pack("ll", int(seconds), int(1e6 * rest)))
        closed = self._errors.ConnectionClosed

        def send(text: str) -> None:
            with suppress(closed):  # the goals ended with the connection
                connection.send(text)

        pace = Pace(MOST_A_SECOND, monotonic, self._stopped.wait)
        self._connection = connection
        try:
            with interrupts_noted() as check:
                self.server.connected(send)
                while not self._stopped.is_set():
                    check()
                    try:
                        message = connection.recv(WAKING)
                    except TimeoutError:
                        continue
                    self.server.received(message)
                    pace.step()
            self._leave()
            return "stopped"
        except closed as error:
            return str(error)
        except KeyboardInterrupt:
            self._leave()
            raise
        finally:
            self.server.disconnected()

    def _leave(self) -> None:
        """Withdraw the action and close the connection, if there is one; only the first of several threads does so."""
        with self._leaving:
            connection, self._connection = self._connection, None
            if connection is None:
                return
            with suppress(self._errors.ConnectionClosed):
                for message in self.server.farewells():
                    connection.send(protocol.encoded(message))
            connection.close()


def checked_url(url: Any) -> str:
    """Return a valid websocket address; raise OptionError for another value.

    >>> checked_url("ws://localhost:9090")
    'ws://localhost:9090'
    """
    try:
        parts = urlsplit(url) if isinstance(url, str) else None
        fits = parts is not None and parts.scheme in ("ws", "wss") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # an invalid port
        fits = False
    if not fits or not url.isprintable() or not url.isascii():
        raise OptionError(f"url must be the address of a bridge, such as ws://localhost:9090, got {shown(url)}")
    return str(url)
