"""What the trees of the RRT planner may do: drives of constant wheel accelerations, where there is room for them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.models.driven import NODES, driven
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.motions import Wheeled
    from hpop.world import World
    from hpop.world.geometry.planar import FreeSpace

STEP = 0.4  # s: wheel accelerations are constant for so long
NEAR, NEAR_YAW = 0.8, 0.3  # m, rad: from the goal to where braking ends; the rest is closed
SHARE = 0.95  # of each limit is for the trees; the rest is for closing
SHARES = np.array([0.25, 0.5, 0.75, 1.0])  # of a drive, where its clearance is looked at
ROUNDING = 1e-9  # m/s

T = TypeVar("T", float, FloatArray)

_at, _weight = (np.array(column) for column in zip(*NODES, strict=True))
_TIMES = SHARES[:, None] * _at  # (4, nodes) shares of the drive at which its velocity is summed up to each of SHARES


class WheelLimits(NamedTuple):
    """What the wheels and the base keep.

    Wheels that accelerate by no more than this neither accelerate nor turn the base by more than the model allows; they
    reach the speeds that its runs and spins need.
    """

    speed: float  # m/s, of the base; it never goes back
    turn_rate: float  # rad/s
    wheel_speed: float  # m/s
    wheel_acceleration: float  # m/s²

    @classmethod
    def of(cls, model: Wheeled, share: float = 1.0) -> WheelLimits:
        """The limits that follow from a model's, or a share of each."""
        half = 0.5 * model.wheel_base
        return cls(
            share * model.speed,
            share * model.turn_rate,
            share * max(model.speed, model.turn_rate * half),
            share * min(model.acceleration, model.turn_acceleration * half),
        )


class Base(NamedTuple):
    """A state: m, m, rad, m/s and rad/s."""

    x: float
    y: float
    yaw: float
    speed: float
    turn_rate: float


@dataclass(frozen=True, eq=False)
class Query:
    """What all runs share, and how their trees may move; picklable.

    start       (x m, y m, yaw rad)
    goal        (x m, y m, yaw rad); a yaw of None is free
    extensions  of a tree before a run gives up
    until       s since 1970, which workers share: a tree that still grows then is dropped; None for never
    """

    model: Wheeled
    world: World
    start: tuple[float, float, float]
    goal: tuple[float, float, float | None]
    extensions: int
    until: float | None = None

    @cached_property
    def limits(self) -> WheelLimits:
        """Limits that trees keep."""
        return WheelLimits.of(self.model, SHARE)

    @property
    def arrived(self) -> bool:
        """Whether the start is the goal."""
        turn = 0.0 if self.goal[2] is None else float(wrap(self.goal[2] - self.start[2]))
        return self.start[:2] == self.goal[:2] and turn == 0.0

    def trajectory(self, controls: FloatArray) -> Trajectory:
        """The trajectory from the start of some drives, or of none."""
        if not len(controls):
            return Trajectory.from_poses(self.model, [self.start])
        return driven(self.model, self.start, controls.tolist())

    @cached_property
    def spaces(self) -> tuple[tuple[FreeSpace, float], ...]:
        """The free space of each part of the robot, and the radius, m, of the circle that the part sweeps."""
        return tuple((self.world.free_space((part.z_min, part.z_max)), part.reach) for part in self.model.platform)

    def clear(self, x: FloatArray, y: FloatArray, margin: float) -> bool:
        """Whether the circles that the robot's parts sweep about positions (P,) have a margin, m."""
        return all(bool((space.clearance(x, y) >= reach + margin).all()) for space, reach in self.spaces)

    def drive(self, base: Base, acceleration: float, turn_acceleration: float, duration: float) -> Base | None:
        """Where a drive ends; None if it breaks a limit or is not clear.

        What lies between two places that are looked at is as near to one as half the way between. This may err by the
        little that the quadrature does: trajectories are judged exactly when they are complete.
        """
        speed, turn_rate = base.speed + acceleration * duration, base.turn_rate + turn_acceleration * duration
        limits, half = self.limits, 0.5 * self.model.wheel_base
        if not (
            -ROUNDING <= speed <= limits.speed
            and abs(turn_rate) <= limits.turn_rate
            and speed + half * abs(turn_rate) <= limits.wheel_speed
        ):
            return None
        t = duration * _TIMES
        yaw = base.yaw + (base.turn_rate + 0.5 * turn_acceleration * t) * t
        velocity = base.speed + acceleration * t
        lasts = duration * SHARES
        x = base.x + lasts * ((velocity * np.cos(yaw)) @ _weight)
        y = base.y + lasts * ((velocity * np.sin(yaw)) @ _weight)
        if not self.clear(x, y, 0.5 * max(base.speed, speed) * duration / SHARES.size):
            return None
        turned = 0.5 * (base.turn_rate + turn_rate) * duration
        return Base(float(x[-1]), float(y[-1]), base.yaw + turned, max(0.0, speed), turn_rate)

    def braking(self, base: Base) -> FloatArray:
        """Controls (n, 3) that stop the robot, both wheels at once, as quickly as a tree may."""
        wheel = base.speed + 0.5 * self.model.wheel_base * abs(base.turn_rate)
        lasts = wheel / self.limits.wheel_acceleration
        if lasts == 0.0:
            return np.empty((0, 3))
        count = math.ceil(lasts / STEP)
        return np.tile([-base.speed / lasts, -base.turn_rate / lasts, lasts / count], (count, 1))

    def distance(self, base: Base) -> float:
        """How far from the goal braking ends, 1 or less for near enough; infinite if it does not end."""
        off = math.hypot(base.x - self.goal[0], base.y - self.goal[1])
        braking = self.braking(base)
        if off > NEAR + base.speed * braking[:, 2].sum():  # braking cannot make up for that
            return off / NEAR
        for control in braking:
            stopping = self.drive(base, *control.tolist())
            if stopping is None:
                return math.inf
            base = stopping
        apart = math.hypot(base.x - self.goal[0], base.y - self.goal[1]) / NEAR
        return apart if self.goal[2] is None else max(apart, abs(float(wrap(base.yaw - self.goal[2]))) / NEAR_YAW)


def of_wheels(model: Wheeled, left: T, right: T) -> tuple[T, T]:
    """Acceleration, m/s², and angular acceleration, rad/s², of the base."""
    return 0.5 * (left + right), (right - left) / model.wheel_base
