"""Motion law of an arm in time: a reach that takes a given time, or a wait."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from hpop.base.arrays import Column
from hpop.models.serial_arm.laws import Extremes, Reach
from hpop.motions import LawDefaults, Phase, States

TIME = "time"  # s from the start of the working arm: the state that says when the arm is where
SOON = 1e-9  # relative: by how much a motion may be quicker than its joints allow, for rounding errors


@dataclass(frozen=True)
class ReachInTime(LawDefaults):
    """Law "reach" of an arm whose states have a time: from rest to rest along a straight line in joint space.

    reach  the same motion in the least time that the joints allow

    The states say when the motion begins and ends. If that is longer than the least time, the motion has all its speeds
    lower by one factor. Without a change of the joints it is a wait.
    """

    reach: Reach
    kind: str = "reach"

    quadrature: ClassVar[str] = "adaptive"
    even: ClassVar[frozenset[str]] = frozenset({TIME})  # states with a constant second time derivative

    @cached_property
    def varies(self) -> frozenset[str]:
        """Names of the states that change: all joints and the time."""
        return frozenset((*self.reach.names, TIME))

    def least(self, start: States, end: States) -> Column:
        """Return the least time (M,), s, that the joints need."""
        return sum(phase.duration for phase in self.reach.phases(start, end))

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the share of the motion done is the share of its time."""
        duration = end.time - start.time
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def _ramp(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the share of the time, up to a half, and the share of the way that the speed-up takes; both (M,)."""
        speed_up, cruise, _ = self.reach.phases(start, end)
        lasts = 2.0 * speed_up.duration + cruise.duration
        moves = lasts > 0.0
        time = np.where(moves, speed_up.duration / np.where(moves, lasts, 1.0), 0.5)
        return time, np.where(moves, speed_up.end, 0.5)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the time, or the value of a joint, when ``share`` (0 to 1) of the time is over."""
        begin, span = getattr(start, name), getattr(end, name) - getattr(start, name)
        if name == TIME:
            return begin + span * share
        time, way = self._ramp(start, end)
        middle = way + 2.0 * way / time * (share - time)
        first, last = way * (share / time) ** 2, 1.0 - way * ((1.0 - share) / time) ** 2
        done = np.where(share < time, first, np.where(share > 1.0 - time, last, middle))
        return np.where(share >= 1.0, getattr(end, name), begin + span * done)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the time."""
        span = getattr(end, name) - getattr(start, name)
        if name == TIME:
            return span + 0.0 * share, 0.0 * (span + share)
        time, way = self._ramp(start, end)
        bend, cruise = 2.0 * way / time**2, 2.0 * way / time
        early, late = share < time, share > 1.0 - time
        first = np.where(early, bend * share, np.where(late, bend * (1.0 - share), cruise))
        return span * first, span * np.where(early, bend, np.where(late, -bend, 0.0))

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return zeros (M,), because an arm has no heading and so makes no turns."""
        none = 0.0 * (end.time - start.time)
        return none, none

    def strays(self, start: States, end: States) -> Column:
        """Return the error (M,) of the given end states: 0, or inf if they leave less than the least time."""
        return np.where(end.time - start.time >= (1.0 - SOON) * self.least(start, end), 0.0, np.inf)

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return how far (M,), rad or m, a joint travels."""
        return self.reach.ways(name, start, end)

    def most_bend(self, name: str, start: States, end: States) -> Column:
        """Return the largest second derivative (M,) of a joint with respect to the share of the time, absolute."""
        time, way = self._ramp(start, end)
        return 2.0 * way / time**2 * np.abs(getattr(end, name) - getattr(start, name))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the extremes of a joint along each motion (M,); it is fastest at the end of the speed-up."""
        begin, stop, lasts = getattr(start, name), getattr(end, name), end.time - start.time
        time, way = self._ramp(start, end)
        inverse = np.divide(1.0, lasts, out=np.zeros(lasts.shape), where=lasts > 0.0)
        fastest = 2.0 * way / time * np.abs(stop - begin) * inverse
        change = self.most_bend(name, start, end) * inverse**2
        return Extremes(np.minimum(begin, stop), np.maximum(begin, stop), fastest, change)
