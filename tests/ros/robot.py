"""A small differential drive that integrates the commands it gets, and its follower in simulated time."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from typing import Any

from hpop.ros import PlanarPose
from hpop.ros.follow_plans import Ended


class Robot:
    """A unicycle that moves at the last commanded speeds; it counts the jumps of its commands."""

    def __init__(self, x: float, y: float, yaw: float) -> None:
        self.x, self.y, self.yaw = x, y, yaw
        self.v = self.w = 0.0
        self.fastest = self.hardest = 0.0
        self.passed = [(x, y)]

    def drive(self, v: float, w: float, seconds: float) -> None:
        self.fastest = max(self.fastest, abs(v))
        self.hardest = max(self.hardest, abs(v - self.v) / seconds)
        self.v, self.w = v, w
        middle = self.yaw + 0.5 * w * seconds
        self.x += v * math.cos(middle) * seconds
        self.y += v * math.sin(middle) * seconds
        self.yaw += w * seconds
        self.passed.append((self.x, self.y))


class AtOnce(Executor):
    """Runs what is submitted at once, so that a simulation takes no real time."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Trip:
    """A robot and its follower in simulated time: 20 steps a second, each with a pose unless ``blind``."""

    def __init__(self, follower: Any, robot: Robot) -> None:
        self.follower, self.robot = follower, robot
        self.now, self.blind = 0.0, False
        self.events: list[Any] = []

    def go(self, seconds: float, until: Any = None) -> bool:
        """Drive for some seconds, or until something is so; return whether it became so."""
        end = self.now + seconds
        while self.now < end:
            robot = self.robot
            if not self.blind:
                self.follower.located(PlanarPose(robot.x, robot.y, robot.yaw, "map"), self.now)
            step = self.follower.step(self.now)
            self.events += step.events
            robot.drive(*(step.command or (0.0, 0.0)), 0.05)
            self.now += 0.05
            if until is not None and until():
                return True
        return False

    def go_until_ended(self, seconds: float = 120.0) -> Ended:
        """Drive until the goal has ended, and return the event."""
        assert self.go(seconds, lambda: any(isinstance(event, Ended) for event in self.events)), self.state()
        return next(event for event in self.events if isinstance(event, Ended))

    def state(self) -> Any:
        return self.follower.state(self.now)

    @property
    def stands(self) -> bool:
        return self.robot.v == self.robot.w == 0.0
