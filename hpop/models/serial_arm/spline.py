"""The motion law of smoothed ways of an arm: every joint a cubic of time from knot to knot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import smooth_abs
from hpop.models.serial_arm.limits import Extremes
from hpop.motions import Phase, States

CLOCK = "clock"


def rate_of(name: str) -> str:
    """Name of the column that has a joint's speed at a knot."""
    return f"{name}_rate"


@dataclass(frozen=True)
class Spline:
    """One piece of a spline: Hermite cubics through the joints and their speeds at both ends.

    names          of the joints
    speeds         rad/s or m/s, of each, the greatest
    accelerations  rad/s² or m/s², of each, the greatest

    A state needs more columns than the joints: ``<joint>_rate``, rad/s or m/s, of each, and ``clock`` (s, from any
    zero; its difference is the motion's duration). It leads to whatever state is given, if the clock goes on.
    """

    names: tuple[str, ...]
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...]
    kind: str = "spline"

    quadrature = "adaptive"
    reversible = False

    @cached_property
    def extra(self) -> tuple[str, ...]:
        """The speeds, and the clock."""
        return (*map(rate_of, self.names), CLOCK)

    @cached_property
    def varies(self) -> frozenset[str]:
        """All columns."""
        return frozenset((*self.names, *self.extra))

    @cached_property
    def even(self) -> frozenset[str]:
        """Speeds are parabolas of time."""
        return frozenset(self.extra)

    @cached_property
    def _joint_of(self) -> dict[str, str]:
        return {rate_of(name): name for name in self.names}

    def knots(self, values: Sequence[Column], rates: Sequence[Column], clock: Column) -> States:
        """States with the joints at their speeds, columns of numbers or symbols, at times, s."""
        speeds = dict(zip(map(rate_of, self.names), rates, strict=True))
        return States(**dict(zip(self.names, values, strict=True)), **speeds, clock=clock)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """One, in which the share is that of the time."""
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """A joint, its speed or the clock where a share of the time has passed."""
        if name in self._joint_of:
            slope, _ = self.slopes(self._joint_of[name], start, end, share)
            lasts = end.clock - start.clock
            return slope / np.where(lasts > 0, lasts, 1.0)
        begin, span = getattr(start, name), getattr(end, name) - getattr(start, name)
        if name == CLOCK:
            return begin + span * share
        first, last = self._tangents(name, start, end)
        rest = 1.0 - share
        return begin + span * share + share * rest * (rest * (first - span) - share * (last - span))

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """First and second derivative by the share."""
        if name in self._joint_of:
            joint, lasts = self._joint_of[name], end.clock - start.clock
            safe = np.where(lasts > 0, lasts, 1.0)
            first, last = self._tangents(joint, start, end)
            span = getattr(end, joint) - getattr(start, joint)
            third = 6.0 * (first + last - 2.0 * span)
            return self.slopes(joint, start, end, share)[1] / safe, third / safe
        span = getattr(end, name) - getattr(start, name)
        if name == CLOCK:
            return span, 0.0 * span
        first, last = self._tangents(name, start, end)
        bend, twist = 6.0 * span - 4.0 * first - 2.0 * last, first + last - 2.0 * span
        return first + share * (bend + 3.0 * twist * share), bend + 6.0 * twist * share

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """No turns are counted: an arm has no heading."""
        none = 0.0 * (end.clock - start.clock)
        return none, none

    def strays(self, start: States, end: States) -> Column:
        """0 (M,); infinite where time runs backwards, and where none passes, how far a joint or its speed jumps."""
        jump = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in self.varies - {CLOCK}], axis=0)
        return np.where(end.clock > start.clock, 0.0, np.where(end.clock == start.clock, jump, np.inf))

    def ways(self, name: str, start: States, end: States) -> Column:
        """How far (M,), rad or m, a joint goes at most, there and back: between the control points of its cubic."""
        first, last = self._tangents(name, start, end)
        span = getattr(end, name) - getattr(start, name)
        return (smooth_abs(first) + smooth_abs(last) + smooth_abs(3.0 * span - first - last)) / 3.0

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Of a joint along each motion (M,): exact, where speed or acceleration are zero within it too."""
        lasts = end.clock - start.clock
        safe = np.where(lasts > 0, lasts, 1.0)
        first, (begin, last) = (
            self.slopes(name, start, end, 0.0)[0],
            (self.slopes(name, start, end, u)[1] for u in (0.0, 1.0)),
        )
        fractions = [np.zeros(lasts.size), np.ones(lasts.size), _inside(begin, begin - last)]
        root = np.sqrt(np.maximum(0.0, begin * begin - 2.0 * first * (last - begin)))
        values = [*fractions]
        for sign in (1.0, -1.0):  # first + begin u + (last - begin) u² / 2 = 0, without cancellation
            half = -(begin + sign * np.where(begin >= 0, 1.0, -1.0) * root)
            values += [_inside(half, last - begin), _inside(2.0 * first, half)]
        places = np.array([self.interpolate(name, start, end, share) for share in values])
        speeds = np.array([np.abs(self.slopes(name, start, end, share)[0]) for share in fractions])
        return Extremes(
            places.min(axis=0),
            places.max(axis=0),
            speeds.max(axis=0) / safe,
            np.maximum(np.abs(begin), np.abs(last)) / safe**2,
        )

    def _tangents(self, name: str, start: States, end: States) -> tuple[Column, Column]:
        """Slopes by the share at both ends."""
        lasts = end.clock - start.clock
        return lasts * getattr(start, rate_of(name)), lasts * getattr(end, rate_of(name))


def _inside(above: FloatArray, below: FloatArray) -> FloatArray:
    """Quotients (M,) that lie in [0, 1]; 0 in the place of others."""
    some = below != 0.0
    quotient = np.where(some, above / np.where(some, below, 1.0), 0.0)
    return np.where((quotient > 0.0) & (quotient < 1.0), quotient, 0.0)
