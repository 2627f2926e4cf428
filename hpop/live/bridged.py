"""Robot of a live session over rosbridge: its base, and what it tells of its pose, the map and people.

It shares its law, its topics and its checks with :mod:`hpop.ros.following`; plans come from the session.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from threading import Thread
from time import monotonic

import shapely

from hpop.live.simulator import RADIUS, WATCHDOG, LiveRobot, Pose
from hpop.problems.problem import Problem
from hpop.ros.bridge import Bridge
from hpop.ros.follow_plans import Sighting, StatesAhead
from hpop.ros.follow_server import RobotServer
from hpop.ros.following import SLOWEST, STAND
from hpop.ros.navigation import FollowInterface
from hpop.ros.observations import FilterScale, OccupancyGrid, new_areas
from hpop.ros.planning import GoalPlanner
from hpop.ros.protocol import Interface
from hpop.simulation import Command, DriveLimits, Walking
from hpop.trajectories.trajectory import Trajectory

LATE = 0.5
"""Age, s, from which a pose is too old to drive by."""
OFF = 0.5
"""Distance, m, from its plan from which the robot stops."""
REACTION = 0.3
"""Time, s, that is added to the time in which the robot can stop, to look ahead at obstacles."""
MOST_AREAS = 16
"""Blocked areas of the robot's map that the planner is told of; before others the robot stops."""
FAREWELL = 1.0
"""Time, s, for the last messages, after the robot has braked."""


class RobotSighting(Sighting):
    """Latest knowledge of the robot and its surroundings, as it tells them.

    halted    whether a message of its topic ``stop`` has stopped it
    areas     corners (x, y), m, by name, of areas that are blocked on its map or mask, but not in the scenario
    """

    halted = False
    areas: Mapping[str, list[list[float]]] = {}

    def mapped(self, grid: OccupancyGrid) -> None:
        """Take a map; RosError if it cannot be used."""
        super().mapped(grid)
        self._compare()

    def filtered(self, mask: OccupancyGrid, scale: FilterScale) -> None:
        """Take the mask of a costmap filter."""
        super().filtered(mask, scale)
        self._compare()

    def _compare(self) -> None:
        """Compare the map with the scenario: keep the `MOST_AREAS` largest areas that are new."""
        parts = shapely.get_parts(new_areas(self.planner.problem.world, self._grid, self._keep_out))
        largest = sorted(parts, key=shapely.area, reverse=True)[:MOST_AREAS]
        self.areas = {
            f"on the map at {part.centroid.x:.1f}, {part.centroid.y:.1f}": shapely.get_coordinates(
                shapely.get_exterior_ring(part)
            )[:-1]
            .round(3)
            .tolist()
            for part in largest
        }

    def halt(self, stopped: bool) -> None:
        """Stop the robot, or let it go again."""
        self.halted = stopped

    def take(self, option: str, now: float) -> None:
        """Ignore an option: viewers choose on the page."""


class RosBase(RobotServer):
    """Base behind rosbridge, which is sent the newest command of the session.

    Without a new command for `WATCHDOG` s the base is told to brake; without a connection it must stop by itself.
    """

    def __init__(self, problem: Problem, known: FollowInterface, *, say: Callable[[str], None]) -> None:
        self.seen = RobotSighting(GoalPlanner(problem, (), Interface(frame_id=known.frame_id)))
        super().__init__(self.seen, known, say=say)
        self.told = {known.cmd_topic: known.cmd_type}
        del self.heard[known.own("take")]
        self.limits = DriveLimits.of(problem.model)
        values = dict(zip(problem.model.space.names, problem.start, strict=True))
        self.pose: Pose = (values["x"], values["y"], values["yaw"])
        self.velocity = STAND
        self._next, self._at = STAND, -math.inf

    @property
    def offers(self) -> str:
        """Offers, for a line of text."""
        return "the viewer of the live session drives"

    @property
    def measured(self) -> Pose | None:
        """Measured pose; None if none has come for `LATE` s."""
        found = self.seen.pose(monotonic(), LATE)
        if found is None:
            return None
        self.pose = found[:3]
        return self.pose

    def command(self, v: float, w: float, t: float) -> None:
        """Send a command, m/s and rad/s, as the newest."""
        self._next, self._at = Command(v, w), monotonic()

    def advance(self, t: float) -> None:
        """Read the pose; the robot moves by itself."""
        _ = self.measured

    def turn(self, now: float) -> Command | None:
        """Return the newest command, or one that brakes if it is old; None once a robot that stands was told so."""
        wanted = self._next
        if now - self._at > WATCHDOG:
            wanted = self.limits.reached(self.velocity, 0.0, 0.0, 1.0 / self.known.rate)
        before, self.velocity = self.velocity, wanted
        return None if before == wanted == STAND else wanted

    def lost(self) -> None:
        """Forget the robot's pose and the people, as the connection is lost; the base must then stop by itself."""
        self.seen.forget()
        self.hearing.reset()
        self.velocity, self._at = STAND, -math.inf

    def brake(self) -> None:
        """Brake, because the session ends, and wait until the robot stands."""
        self._at = -math.inf
        last = monotonic() + self.limits.time_to_stop + FAREWELL
        while self.is_connected and self.velocity != STAND and not self._closed.wait(0.02) and monotonic() < last:
            pass


class SeenPeople:
    """People around the robot, as it tells them."""

    radius = RADIUS

    def __init__(self, base: RosBase) -> None:
        self._base = base

    def advance(self, t: float, robot_pose: Pose) -> list[Walking]:
        """Return the people, as they walk now."""
        people = self._base.seen.people_here(monotonic())
        return [(person.x, person.y, *person.velocity) for person in people]


class RosRobot(LiveRobot):
    """Robot over rosbridge, which follows the plans of a session.

    url    of rosbridge, such as ws://localhost:9090
    delay  s, after which a command takes effect
    """

    base: RosBase

    def __init__(
        self,
        problem: Problem,
        url: str,
        known: FollowInterface,
        *,
        delay: float = 0.0,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        base = RosBase(problem, known, say=say)
        super().__init__(problem.model, base, delay)
        self._bridge = Bridge(url, base, say=say)
        self._ahead: StatesAhead | None = None

    @contextmanager
    def running(self) -> Iterator[None]:
        """Connect with the robot; at the end it brakes, and is left."""
        thread = Thread(target=self._bridge.run, name="hpop-live-bridge", daemon=True)
        thread.start()
        self.base.begin()
        try:
            yield
        finally:
            self.base.brake()
            self._bridge.stop()
            self.base.close()
            thread.join(FAREWELL)

    @property
    def areas(self) -> Mapping[str, list[list[float]]]:
        """Corners (x, y), m, by name, of blocked areas that the scenario does not have."""
        return self.base.seen.areas

    def follow(self, trajectory: Trajectory, elapsed: float, *, arrives: bool) -> None:
        """Continue with a plan; see :class:`.LiveRobot`."""
        self._ahead = StatesAhead.of(trajectory)
        super().follow(trajectory, elapsed, arrives=arrives)

    def advance(self, now: float, *, brakes: bool) -> None:
        """Follow the plan, or brake; not faster than a speed limit of the map."""
        if self._tracker is not None:
            limits = self.base.limits
            limit = self.base.seen.speed_limit(self.base.seen.pose(monotonic(), LATE), limits.speed)
            self._tracker.limits = replace(limits, speed=max(SLOWEST, min(limits.speed, limit)))
        super().advance(now, brakes=brakes)

    @property
    def is_lost(self) -> bool:
        """Return whether there is no connection to the robot."""
        return not self.base.is_connected

    @property
    def is_astray(self) -> bool:
        """Return whether the robot is more than `OFF` off its plan."""
        pose, tracker = self.base.measured, self._tracker
        return pose is not None and tracker is not None and tracker.off(self._now - self._zero, pose) > OFF

    def trouble(self) -> str:
        """Return in words why the robot cannot drive now; "" if it can."""
        base = self.base
        if self.is_lost:
            return "the robot is not connected"
        if base.seen.halted:
            return f"the robot was stopped by its topic {base.known.own('stop')}"
        if base.measured is None:
            return "the robot does not know where it is"
        if self._ahead is None or self.arrived:
            return ""
        if self.is_astray:
            return f"the robot is more than {OFF:g} m off its plan"
        soon, _ = self._ahead.blocked(base.seen, self.clock, base.limits.time_to_stop + REACTION)
        return "an obstacle is in the way" if soon else ""
