"""Motion law of an arm in time: a reach that takes a given time, or a wait."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hpop.base.arrays import Column
from hpop.models.serial_arm.laws import CLOCK, Extremes, JointSpline, rate_of
from hpop.motions import LawDefaults, Phase, States

TIME = "time"  # s since the working arm began its motion; a state of the viewing arm
PACE = "pace"  # speed of the joint that is nearest to its top speed, as a share of it; a state of the viewing arm
PEAK = (
    1.5,
    6.0,
)  # largest speed and acceleration of a motion from rest to rest that takes 1 s, as multiples of its length


@dataclass(frozen=True)
class ReachInTime(LawDefaults):
    """Law "reach" of an arm whose states have a time: along a straight line in joint space, from rest to rest.

    spline  law of the joints: cubic polynomials of time

    The states say when the motion begins and ends. At each moment all joints have done an equal share of their changes,
    which is a cubic polynomial of time. Without a change of the joints, the motion is a wait. A motion that is cut into
    parts follows this law in each part. Such a part need not begin and end at rest: states at its ends have a pace.
    """

    spline: JointSpline
    kind: str = "reach"

    quadrature: ClassVar[str] = "adaptive"
    even: ClassVar[frozenset[str]] = frozenset({TIME})  # states with a constant second time derivative

    @property
    def varies(self) -> frozenset[str]:
        """Names of the states that change: all joints, the pace and the time."""
        return frozenset((*self.spline.names, PACE, TIME))

    def least(self, start: States, end: States) -> Column:
        """Return the least time (M,), s, that a motion from rest to rest takes; 0 if no joint changes."""
        spline, (speed, acceleration) = self.spline, PEAK
        ways = [self.ways(name, start, end) for name in spline.names]
        by_speed = (speed * way / limit for way, limit in zip(ways, spline.speeds, strict=True))
        by_change = (np.sqrt(acceleration * way / a) for way, a in zip(ways, spline.accelerations, strict=True))
        return np.maximum.reduce([*by_speed, *by_change])

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the share of the motion done is the share of its time."""
        duration = end.time - start.time
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the time, the pace, or the value of a joint, when ``share`` (0 to 1) of the time is over."""
        if name == TIME:
            return start.time + (end.time - start.time) * share
        ends = self._knots(start, end)
        if name != PACE:
            return self.spline.interpolate(name, *ends, share)
        rates = (np.abs(self.spline.interpolate(rate_of(joint), *ends, share)) for joint in self.spline.names)
        return np.maximum.reduce([rate / speed for rate, speed in zip(rates, self.spline.speeds, strict=True)])

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the time; 0 for the pace."""
        if name == TIME:
            return end.time - start.time + 0.0 * share, 0.0 * (end.time + share)
        if name == PACE:
            return 0.0 * (end.time + share), 0.0 * (end.time + share)
        return self.spline.slopes(name, *self._knots(start, end), share)

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return zeros (M,), because an arm has no heading and so makes no turns."""
        none = 0.0 * (end.time - start.time)
        return none, none

    def strays(self, start: States, end: States) -> Column:
        """Return the error (M,) of the given end states: 0 if the time advances, inf if it runs backwards.

        If the time stands still, the error is the largest jump of a joint value or speed.
        """
        return self.spline.strays(*self._knots(start, end))

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return how far (M,), rad or m, a joint travels."""
        return np.abs(getattr(end, name) - getattr(start, name))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the exact extremes of a joint along each motion (M,)."""
        return self.spline.extremes(name, *self._knots(start, end))

    def _knots(self, start: States, end: States) -> tuple[States, States]:
        """Return both ends as states of the spline, with the joint speeds that follow from their paces."""
        names, speeds = self.spline.names, self.spline.speeds
        ways = [getattr(end, name) - getattr(start, name) for name in names]
        longest = np.maximum.reduce([np.abs(way) / speed for way, speed in zip(ways, speeds, strict=True)])
        scale = np.where(longest > 0.0, 1.0 / np.where(longest > 0.0, longest, 1.0), 0.0)
        return self._knot(start, ways, scale), self._knot(end, ways, scale)

    def _knot(self, state: States, ways: list[Column], scale: Column) -> States:
        names = self.spline.names
        rates = {rate_of(name): state.pace * scale * way for name, way in zip(names, ways, strict=True)}
        return States(**{name: getattr(state, name) for name in names}, **rates, **{CLOCK: state.time})
