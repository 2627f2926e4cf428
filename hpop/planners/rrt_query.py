"""Motions of the RRT planner: drives with constant wheel accelerations, braking, and closing the gap to the goal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.models.driven import NODES, driven, states_after
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.motions import Wheeled
    from hpop.world import World
    from hpop.world.geometry.planar import FreeSpace

STEP = 0.4  # s during which wheel accelerations are constant
NEAR, NEAR_YAW = 0.8, 0.3  # m, rad: largest gap between the end of braking and the goal
SHARE = 0.95  # share of each limit that trees may use; the remainder serves to close the gap
SHARES = np.array([0.25, 0.5, 0.75, 1.0])  # shares of a drive at which its clearance is checked
ROUNDING = 1e-9  # m/s: a speed may be this much below 0

T = TypeVar("T", float, FloatArray)

_at, _weight = (np.array(column) for column in zip(*NODES, strict=True))
_TIMES = SHARES[:, None] * _at  # (4, nodes) shares of the drive: quadrature nodes of the velocity up to each of SHARES


class WheelLimits(NamedTuple):
    """Limits of the wheels and of the base that they drive.

    If the wheels keep these limits, the base keeps the model's accelerations. The wheels may be as fast as the model's
    straight moves and turns in place need.

    speed               m/s    of the base
    turn_rate           rad/s  of the base
    wheel_speed         m/s    of each wheel
    wheel_acceleration  m/s²   of each wheel
    """

    speed: float  # m/s, of the base; it never goes backwards
    turn_rate: float  # rad/s
    wheel_speed: float  # m/s
    wheel_acceleration: float  # m/s²

    @classmethod
    def of(cls, model: Wheeled, share: float = 1.0) -> WheelLimits:
        """Return the limits that follow from a robot model, each multiplied by ``share``."""
        half = 0.5 * model.wheel_base
        return cls(
            share * model.speed,
            share * model.turn_rate,
            share * max(model.speed, model.turn_rate * half),
            share * min(model.acceleration, model.turn_acceleration * half),
        )


class Base(NamedTuple):
    """State of the base: x, m; y, m; yaw, rad; speed, m/s; turn rate, rad/s."""

    x: float
    y: float
    yaw: float
    speed: float
    turn_rate: float


@dataclass(frozen=True, eq=False)
class TreeQuery:
    """Start, goal and limits that all runs share, and the motions from which trees are made; picklable.

    start       (x m, y m, yaw rad)
    goal        (x m, y m, yaw rad); yaw is None if any heading will do
    extensions  largest number of attempts to extend a tree
    until       s since 1970: time at which unfinished trees are dropped in all workers; None for no limit
    """

    model: Wheeled
    world: World
    start: tuple[float, float, float]
    goal: tuple[float, float, float | None]
    extensions: int
    until: float | None = None

    @cached_property
    def limits(self) -> WheelLimits:
        """Limits of wheels and base that the trees keep: a bit less than those of the model."""
        return WheelLimits.of(self.model, SHARE)

    @property
    def arrived(self) -> bool:
        """True if the start is already the goal."""
        turn = 0.0 if self.goal[2] is None else float(wrap(self.goal[2] - self.start[2]))
        return self.start[:2] == self.goal[:2] and turn == 0.0

    def trajectory(self, controls: FloatArray) -> Trajectory:
        """Return the trajectory that begins at rest at the start and follows controls (n, 3); n may be 0.

        Each row is one drive, with three columns: acceleration (m/s²), angular acceleration (rad/s²) and duration (s).
        With n = 0, the robot stays at the start.
        """
        if not len(controls):
            return Trajectory.from_poses(self.model, [self.start])
        return driven(self.model, self.start, controls.tolist())

    @cached_property
    def spaces(self) -> tuple[tuple[FreeSpace, float], ...]:
        """Free space for each part of the robot, with the radius of the circle that the part sweeps in turning, m."""
        return tuple((self.world.free_space((part.z_min, part.z_max)), part.reach) for part in self.model.platform)

    def clear(self, x: FloatArray, y: FloatArray, margin: float) -> bool:
        """Return whether the robot, at all positions (P,) and any heading, keeps ``margin`` m from obstacles."""
        return all(bool((space.clearance(x, y) >= reach + margin).all()) for space, reach in self.spaces)

    def drive(self, base: Base, acceleration: float, turn_acceleration: float, duration: float) -> Base | None:
        """Return the state at the end of a drive from ``base``; None if the drive breaks a limit or may collide.

        The drive has a constant acceleration, m/s², and angular acceleration, rad/s², for a duration, s. It is checked
        at four samples, with a margin: any position between two samples is at most half their distance from one of
        them. The numerical integration may err slightly; complete trajectories are checked exactly later.
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
        """Return controls (n, 3) that stop both wheels at the same time, as quickly as ``limits`` allow."""
        wheel = base.speed + 0.5 * self.model.wheel_base * abs(base.turn_rate)
        lasts = wheel / self.limits.wheel_acceleration
        if lasts == 0.0:
            return np.empty((0, 3))
        count = math.ceil(lasts / STEP)
        return np.tile([-base.speed / lasts, -base.turn_rate / lasts, lasts / count], (count, 1))

    def distance(self, base: Base) -> float:
        """Return how far from the goal the robot stops if it brakes now; at most 1 if that is near enough.

        The unit is NEAR for the position, and NEAR_YAW for the heading if the goal has one; the larger value counts.
        The result is inf if the robot cannot brake without a collision. Where braking is too short to reach the goal,
        it is not tried, and the result is the present distance in units of NEAR.
        """
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
    """Convert the accelerations of left and right wheel to acceleration, m/s², and angular one, rad/s², of the base."""
    return 0.5 * (left + right), (right - left) / model.wheel_base


CLOSED = 1e-9  # m, rad, m/s, rad/s: a smaller gap counts as closed
LEAST_CHANGED = 16  # number of drives that are changed first to close the gap
NEWTON = 12  # largest number of steps of Newton's method; gaps up to NEAR usually need four to six
SLOPE = 1e-6  # m/s²: step of difference quotients; Newton's method corrects their error


def close_gap(query: TreeQuery, controls: FloatArray) -> FloatArray | None:
    """Close the gap to the goal: change controls (n, 3) slightly so that they end at rest exactly at the goal.

    The last 16 drives are changed, else the last 32 and so on, until the trajectory is free of collisions. The result
    is None if even changing all drives fails.
    """
    trajectory = query.trajectory(controls)
    n, changed = len(controls), 0
    while changed < n:
        changed = min(n, max(LEAST_CHANGED, 2 * changed))
        unchanged, last = controls[: n - changed], controls[n - changed :]
        base = Base(*(float(getattr(trajectory.states, name)[n - changed]) for name in Base._fields))
        ending = _controls_to_goal(query, base, last)
        if ending is not None:
            closed = np.concatenate([unchanged, ending])
            if _is_free(query, closed):
                return closed
    return None


def _is_free(query: TreeQuery, controls: FloatArray) -> bool:
    """Return whether the trajectory of controls (n, 3) is free of collisions, by the exact check."""
    collision = query.model.collision(query.world)
    trajectory = query.trajectory(controls)
    return all(bool(collision.motions_free(motions).all()) for _, motions in trajectory.batches(query.world))


def _controls_to_goal(query: TreeQuery, base: Base, controls: FloatArray) -> FloatArray | None:
    """Return controls (k, 3) near the given ones that lead from the state ``base`` to rest at the goal.

    Controls are as in :meth:`TreeQuery.trajectory`. The result is None if a limit would be broken or Newton's method
    does not converge. The method adjusts all wheel accelerations until the end state is the goal; durations stay. There
    are more accelerations than state variables, so each step is the one of least norm, which spreads the gap over all
    drives.
    """
    half, lasts = 0.5 * query.model.wheel_base, controls[:, 2]
    wheels = np.stack([controls[:, 0] - half * controls[:, 1], controls[:, 0] + half * controls[:, 1]], axis=1)
    tried = np.concatenate([np.zeros((1, wheels.size)), SLOPE * np.eye(wheels.size)]).reshape(-1, *wheels.shape)
    goal = np.array([*query.goal[:2], query.goal[2] or 0.0, 0.0, 0.0])
    counts = np.array([1.0, 1.0, query.goal[2] is not None, 1.0, 1.0])
    for _ in range(NEWTON):
        ends = _end_states(query.model, base, wheels + tried, lasts)
        off = counts * (ends[0] - goal)
        off[2] = wrap(off[2])
        if np.abs(off).max() < CLOSED:
            return _within_limits(query, base, wheels, lasts)
        slopes = counts[:, None] * (ends[1:] - ends[0]).T / SLOPE  # (5, 2k)
        wheels = wheels - np.linalg.lstsq(slopes, off)[0].reshape(wheels.shape)
    return None


def _end_states(model: Wheeled, base: Base, wheels: FloatArray, lasts: FloatArray) -> FloatArray:
    """Return the end states (B, 5), as in :class:`Base`, of B sequences of k drives that all begin at state ``base``.

    wheels  (B, k, 2)  accelerations of both wheels, m/s²
    lasts   (k,)       durations, s
    """
    acceleration, turn_acceleration = of_wheels(model, wheels[..., 0], wheels[..., 1])
    speed = _running_sums(base.speed, acceleration * lasts)  # (B, k + 1)
    turn_rate = _running_sums(base.turn_rate, turn_acceleration * lasts)
    yaw = _running_sums(base.yaw, 0.5 * (turn_rate[:, 1:] + turn_rate[:, :-1]) * lasts)
    still = np.zeros(acceleration.size)
    columns = {"yaw": yaw, "speed": speed, "turn_rate": turn_rate}
    begins = States(x=still, y=still, clock=still, **{name: c[:, :-1].ravel() for name, c in columns.items()})
    reached = states_after(begins, acceleration.ravel(), turn_acceleration.ravel(), np.tile(lasts, len(wheels)))
    x, y = (column.reshape(acceleration.shape).sum(axis=1) for column in (reached.x, reached.y))
    return np.stack([base.x + x, base.y + y, yaw[:, -1], speed[:, -1], turn_rate[:, -1]], axis=1)


def _within_limits(query: TreeQuery, base: Base, wheels: FloatArray, lasts: FloatArray) -> FloatArray | None:
    """Convert wheel accelerations (k, 2) to controls (k, 3); return None if they break a limit of the model.

    Speeds are extreme at the ends of drives, so they are checked there.
    """
    limits = WheelLimits.of(query.model)
    acceleration, turn_acceleration = of_wheels(query.model, wheels[:, 0], wheels[:, 1])
    speed = base.speed + np.cumsum(acceleration * lasts)
    turn_rate = np.abs(base.turn_rate + np.cumsum(turn_acceleration * lasts))
    over = (
        -speed,
        speed - limits.speed,
        turn_rate - limits.turn_rate,
        speed + 0.5 * query.model.wheel_base * turn_rate - limits.wheel_speed,
        np.abs(wheels) - limits.wheel_acceleration,
    )
    if max(float(excess.max()) for excess in over) > CLOSED:
        return None
    return np.stack([acceleration, turn_acceleration, lasts], axis=1)


def _running_sums(first: float, rows: FloatArray) -> FloatArray:
    """Return the running sums (B, k + 1) of rows (B, k), starting from ``first``."""
    return np.cumsum(np.concatenate([np.full((len(rows), 1), first), rows], axis=1), axis=1)
