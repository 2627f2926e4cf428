"""The motion law of an arm: all joints from rest to rest in one time, straight in the space of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import is_symbolic, smooth_abs
from hpop.models.laws import TINY, linear
from hpop.models.serial_arm.limits import Extremes
from hpop.motions import LawDefaults, Phase, States


@dataclass(frozen=True)
class Reach(LawDefaults):
    """Every joint has done the same share of its way at each moment.

    names          of the joints
    speeds         rad/s or m/s, of each
    accelerations  rad/s² or m/s², of each

    The share keeps what the joint that is worst off allows: with the ways D, its speed is min v/|D| and its
    acceleration min a/|D|. Reaches are executed as they are planned, and their durations add up.
    """

    names: tuple[str, ...]
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...]
    kind: str = "reach"

    quadrature = "adaptive"
    reversible = True  # back through the same states in the same times

    @property
    def varies(self) -> frozenset[str]:
        """All joints."""
        return frozenset(self.names)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Speeding up, going on evenly and slowing down; a short way has nothing between."""
        lasts, square = self._least_times(start, end)
        safe = np.where(square > TINY, square, TINY) if is_symbolic(square) else square
        moves = lasts > 0
        to_speed = square / np.where(moves, lasts, 1.0)  # s, until the greatest speed is reached
        ramp = np.minimum(to_speed, np.sqrt(safe))
        share = np.where(moves, 0.5 * ramp * ramp / np.where(moves, square, 1.0), 0.5)
        cruise = np.maximum(1.0 - 2.0 * share, 0.0) * lasts
        nothing = 0.0 * share
        return (
            Phase(ramp, nothing, share, "speed-up"),
            Phase(cruise, share, 1.0 - share, "cruise"),
            Phase(ramp, 1.0 - share, 1.0 + nothing, "slow-down"),
        )

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """A joint where a share of the motion is done."""
        return linear(name, start, end, share)

    def ways(self, name: str, start: States, end: States) -> Column:
        """How far (M,), rad or m, a joint goes."""
        return smooth_abs(getattr(end, name) - getattr(start, name))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Of a joint along each motion (M,): from end to end, fastest when the arm has sped up."""
        ramp, (begin, stop) = self.phases(start, end)[0], (getattr(states, name) for states in (start, end))
        lasts = ramp.duration > 0
        rate = np.where(lasts, 2.0 * ramp.end / np.where(lasts, ramp.duration, 1.0), 0.0)
        change = np.where(lasts, rate / np.where(lasts, ramp.duration, 1.0), 0.0)
        way = np.abs(stop - begin)
        return Extremes(np.minimum(begin, stop), np.maximum(begin, stop), rate * way, change * way)

    def _least_times(self, start: States, end: States) -> tuple[Column, Column]:
        """Squares and times that the joints ask for: the greatest |D|/v (M,), s, and |D|/a (M,), s²."""
        lasts: Column = None
        square: Column = None
        for name, speed, acceleration in zip(self.names, self.speeds, self.accelerations, strict=True):
            way = smooth_abs(getattr(end, name) - getattr(start, name))
            by_speed, by_acceleration = way / speed, way / acceleration
            lasts = by_speed if lasts is None else np.maximum(lasts, by_speed)
            square = by_acceleration if square is None else np.maximum(square, by_acceleration)
        return lasts, square
