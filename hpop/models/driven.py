"""Motion law "drive": curves of a differential drive with constant wheel accelerations.

In one motion the acceleration a and the angular acceleration α are constant, and so are the wheel accelerations
a ± α b/2, where b is the distance between the wheels. Speed v and yaw rate ω therefore change linearly with time, and
the yaw θ quadratically. The base moves along its heading: x' = v cos θ and y' = v sin θ. These integrals have no closed
form. Gauss-Legendre quadrature with six nodes computes them. Its error is less than 1e-9 of the path length if a motion
turns by at most a radian, and less than 2e-6 for half a turn.

States of such motions have three columns beside x, y and yaw: ``speed`` (m/s), ``turn_rate`` (rad/s) and ``clock`` (s,
from any zero; its difference is the duration of a motion).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.math import smooth_abs
from hpop.motions import LawDefaults, Model, Phase, States
from hpop.trajectories.trajectory import Trajectory

__all__ = ["driven"]


def gauss(count: int) -> tuple[tuple[float, float], ...]:
    """Return pairs of node and weight of Gauss-Legendre quadrature with ``count`` nodes on [0, 1]."""
    roots, weights = np.polynomial.legendre.leggauss(count)
    return tuple(zip((0.5 * (roots + 1.0)).tolist(), (0.5 * weights).tolist(), strict=True))


NODES = gauss(6)


@dataclass(frozen=True)
class Drive(LawDefaults):
    """Law of curves with constant wheel accelerations.

    The end position and heading should be those that follow from the start and from the speeds, turn rates and clock
    of both ends. They may differ by a solver's tolerance; this difference is spread evenly over the motion, which then
    begins and ends exactly in the given states.
    """

    kind: str = "drive"

    varies = frozenset({"x", "y", "yaw", "speed", "turn_rate", "clock"})
    extra = ("speed", "turn_rate", "clock")
    even = frozenset({"yaw", "speed", "turn_rate", "clock"})
    nodes = NODES

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        begin = getattr(start, name)
        if name in ("x", "y"):
            return begin + self._displacement(name, start, end, share) + share * self.defect(name, start, end)
        displacement = (getattr(end, name) - begin) * share
        if name == "yaw":
            return begin + displacement - 0.5 * _rotation_change(start, end) * share * (1.0 - share)
        return begin + displacement

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of state ``name`` with respect to the share of the motion's time."""
        span = getattr(end, name) - getattr(start, name)
        if name == "yaw":
            return span - _rotation_change(start, end) * (0.5 - share), _rotation_change(start, end) + 0.0 * share
        if name not in ("x", "y"):
            return span, 0.0 * span
        lasts, gain = end.clock - start.clock, end.speed - start.speed
        speed, yaw = start.speed + gain * share, self.interpolate("yaw", start, end, share)
        turning = self.slopes("yaw", start, end, share)[0]
        along, aside = (np.cos(yaw), -np.sin(yaw)) if name == "x" else (np.sin(yaw), np.cos(yaw))
        off = self.defect(name, start, end)
        return lasts * speed * along + off, lasts * (gain * along + speed * turning * aside)

    def travel(self, start: States, end: States, lever: Column) -> Column:
        """Return an upper bound (M,), m, on the path length of a point of the robot ``lever`` metres from its axis."""
        length = _absolute_integral(end.clock - start.clock, start.speed, end.speed)
        return length + lever * self.swept(start, end) if lever else length

    def turned(self, start: States, end: States) -> Column:
        return 0.5 * (end.clock - start.clock) * (start.turn_rate + end.turn_rate)

    def swept(self, start: States, end: States) -> Column:
        """Return the absolute rotation (M,), rad: ∫ |ω| dt, which is right also if ω changes its sign."""
        return _absolute_integral(end.clock - start.clock, start.turn_rate, end.turn_rate)

    def pieces(self, start: States, end: States, reach: float, bulge: float) -> Column:
        """Return the number (M,) of equal times Δ into which curves must be cut for collision tests.

        A point at distance r from the axis accelerates by at most A = |a| + |v ω| + r (|α| + ω²), so it is at most
        A Δ²/8 from its chord. For r up to ``reach``, m, that must be within ``bulge``, m.
        """
        lasts = end.clock - start.clock
        per_second = np.divide(1.0, lasts, out=np.zeros(lasts.shape), where=lasts > 0)
        speed, turning = (
            np.maximum(np.abs(getattr(start, n)), np.abs(getattr(end, n))) for n in ("speed", "turn_rate")
        )
        gain, bend = (np.abs(getattr(end, n) - getattr(start, n)) * per_second for n in ("speed", "turn_rate"))
        most = gain + speed * turning + reach * (bend + turning * turning)
        return np.ceil(lasts * np.sqrt(most / (8.0 * bulge)))

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the signed rotations (M,), rad, before and after the yaw rate changes its sign.

        If it keeps its sign, these are the whole rotation and 0.
        """
        before, after, lasts = start.turn_rate, end.turn_rate, end.clock - start.clock
        changes = before * after < 0
        share = np.where(changes, before / np.where(changes, before - after, 1.0), 0.0)
        first = np.where(changes, 0.5 * lasts * before * share, self.turned(start, end))
        return first, np.where(changes, 0.5 * lasts * after * (1.0 - share), 0.0)

    def strays(self, start: States, end: States) -> Column:
        """Return the error (M,) of the given end states against the computed ones; inf if the clock runs backwards.

        The error is the largest of those in x and y, m, and yaw, rad.
        """
        x, y, yaw = (np.abs(self.defect(name, start, end)) for name in ("x", "y", "yaw"))
        return np.where(end.clock >= start.clock, np.maximum(np.maximum(x, y), yaw), np.inf)

    def defect(self, name: str, start: States, end: States) -> Column:
        """Return the given end value of x, y or yaw minus the value computed from the speeds (M,), m or rad."""
        travelled = self.turned(start, end) if name == "yaw" else self._displacement(name, start, end, 1.0)
        return getattr(end, name) - getattr(start, name) - travelled

    def _displacement(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return how far (M,), m, the base gets along the world's axis ``name`` in a share (0 to 1) of the time.

        This is ∫ v cos θ dt for x, and ∫ v sin θ dt for y.
        """
        projection, component = np.cos if name == "x" else np.sin, 0.0
        gain, span, half = end.speed - start.speed, end.yaw - start.yaw, 0.5 * _rotation_change(start, end)
        for node, weight in self.nodes:
            at = node * share
            yaw = start.yaw + span * at - half * at * (1.0 - at)  # as in `interpolate`
            component = component + weight * (start.speed + gain * at) * projection(yaw)
        return (end.clock - start.clock) * share * component


def _rotation_change(start: States, end: States) -> Column:
    """Return α T², rad: the change of the yaw rate within a motion, times its duration T."""
    return (end.clock - start.clock) * (end.turn_rate - start.turn_rate)


def _absolute_integral(duration: Column, begin: Column, end: Column) -> Column:
    """Return ∫ |r| dt for a rate r that changes linearly from ``begin`` to ``end``.

    As a function of begin and end it has a kink only where both are zero, which suits gradient-based solvers.
    """
    same = begin * end >= 0
    whole = smooth_abs(0.5 * duration * (begin + end))
    gap = np.where(same, 1.0, np.abs(begin - end))
    split = 0.5 * duration * (begin * begin + end * end) / gap
    return np.where(same, whole, split)


def states_after(start: States, acceleration: Column, turn_acceleration: Column, duration: Column) -> States:
    """Return the states (M,) after driving for ``duration`` seconds with constant accelerations, m/s² and rad/s².

    start  states (M,) with columns x, y, yaw, speed, turn_rate and clock
    """
    speed, turn_rate = start.speed + acceleration * duration, start.turn_rate + turn_acceleration * duration
    yaw = start.yaw + 0.5 * duration * (start.turn_rate + turn_rate)
    columns = {"yaw": yaw, "speed": speed, "turn_rate": turn_rate, "clock": start.clock + duration}
    straight = States(x=start.x, y=start.y, **columns)
    x, y = (getattr(start, axis) + Drive()._displacement(axis, start, straight, 1.0) for axis in ("x", "y"))
    return States(x=x, y=y, **columns)


@checked_arguments
def driven(
    model: Model, pose: Sequence[float], controls: Sequence[tuple[float, float, float]], *, speed: float = 0.0
) -> Trajectory:
    """Return the trajectory that a differential drive follows under given accelerations.

    pose      (x m, y m, yaw rad) at the start
    controls  for each interval of time: acceleration m/s², angular acceleration rad/s², duration s
    speed     m/s, at the start

    >>> from hpop.models import DifferentialDrive
    >>> goes = driven(DifferentialDrive(), (0, 0, 0), [(1, 0, 1), (0, 0, 2), (-1, 0, 1)])
    >>> goes.duration, round(float(goes.states.x[-1]), 9)
    (4.0, 3.0)
    """
    names = ("x", "y", "yaw", *Drive.extra)
    states = [States(**{n: np.array([float(v)]) for n, v in zip(names, (*pose, speed, 0.0, 0.0), strict=True)})]
    for acceleration, turn_acceleration, duration in controls:
        one = (np.array([float(value)]) for value in (acceleration, turn_acceleration, duration))
        states.append(states_after(states[-1], *one))
    columns = {name: np.concatenate([getattr(state, name) for state in states]) for name in names}
    return Trajectory(model, States(**columns), (Drive().kind,) * len(controls))
