"""Motion laws of an arm, the limits of its joints, and the motion of a body at the tip along a reach.

A reach is straight in the space of the joints. With the changes D of the joints and the Jacobian J of a body, ∫|ω| dt =
∫ |J_ω(q(s)) D| ds over the share s done: one smooth integrand instead of three phases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import is_symbolic, norm, smooth_abs
from hpop.models.laws import TINY, linear
from hpop.models.serial_arm.chain import Chain
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.motions import Body, Law, LawDefaults, Motions, Phase, States, Twist
from hpop.motions.quadrature import adaptive_integrals, evenly, pieces_of

BEYOND = 1e-6  # rad or m: tolerance of limits
FASTER = 1e-6  # relative tolerance of limits of speed and acceleration
CLOCK = "clock"
PIECES = 3  # of a reach on symbols, unless its batch sets another number
NODES = [0.5 + 0.5 * place for place in (-math.sqrt(6 / 7), -math.sqrt(1 / 3), 0.0, math.sqrt(1 / 3), math.sqrt(6 / 7))]
KRONROD = [49 / 495, 27 / 110, 14 / 45, 27 / 110, 49 / 495]
"""Weights of Kronrod's rule (1965) with five nodes on [0, 1], on Gauss' rule of two nodes, exact to degree 7."""


class Extremes(NamedTuple):
    """Extremes of one joint along motions (M,).

    Its least and greatest value, and its greatest absolute speed and acceleration.
    """

    low: FloatArray
    high: FloatArray
    speed: FloatArray
    acceleration: FloatArray


class JointLaw(Law, Protocol):
    """Motion law of an arm."""

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return a bound (M,), rad or m, on the total travel of a joint, back and forth."""

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the exact extremes of a joint along each motion (M,)."""


class Excess(NamedTuple):
    """Excess of motions (M,) over one limit of one joint.

    joint     name of the joint
    quantity  limited quantity in words; "" for the joint value itself
    unit      unit of the quantity
    limit     the limit
    value     (M,)
    over      (M,)  excess over the limit; at most 0 within it
    """

    joint: str
    quantity: str
    unit: str
    limit: float
    value: FloatArray
    over: FloatArray


def excesses(chain: Chain, law: JointLaw, start: States, end: States) -> Iterator[Excess]:
    """Yield the excess of each joint at each of its limits."""
    for i, name in enumerate(chain.names):
        found, unit = law.extremes(name, start, end), "m" if chain.sliding[i] else "rad"
        if not chain.turning[i]:
            low, high = float(chain.low[i]), float(chain.high[i])
            yield Excess(name, "", unit, low, found.low, low - found.low - BEYOND)
            yield Excess(name, "", unit, high, found.high, found.high - high - BEYOND)
        speed, acceleration = float(chain.speed[i]), float(chain.acceleration[i])
        yield Excess(name, "a speed of ", f"{unit}/s", speed, found.speed, found.speed - speed * (1 + FASTER))
        over = found.acceleration - acceleration * (1 + FASTER)
        yield Excess(name, "an acceleration of ", f"{unit}/s²", acceleration, found.acceleration, over)


def doubtful(chain: Chain, law: JointLaw, start: States, end: States) -> BoolArray:
    """Return which motions (M,) break a limit."""
    broken = [excess.over > 0.0 for excess in excesses(chain, law, start, end)]
    return np.asarray(np.any(broken, axis=0))


def faults(chain: Chain, law: JointLaw, start: States, end: States, motions: IntArray) -> Iterator[str]:
    """Yield each limit that motions of a trajectory break, with the motion that exceeds the limit most.

    motions  (M,)  indices of the motions in the trajectory
    """
    for excess in excesses(chain, law, start, end):
        if excess.over.max(initial=0.0) > 0.0:
            i = int(np.argmax(excess.over))
            yield (
                f"has joint {excess.joint} at {excess.quantity}{excess.value[i]:.6g} {excess.unit} in motion "
                f"{motions[i]}, beyond its limit of {excess.limit:.6g}"
            )


@dataclass(frozen=True)
class Reach(LawDefaults):
    """Motion of an arm from rest to rest that is straight in joint space.

    At each moment all joints have done an equal share.

    names          of the joints
    speeds         rad/s or m/s, greatest speed of each joint
    accelerations  rad/s² or m/s², greatest acceleration of each joint

    The most restricted joint limits the share: with the changes D, its speed is min v/|D| and its acceleration min
    a/|D|.
    Reaches are executed as planned, and their durations add up.
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
        """Return a trapezoidal profile; a triangle for a short motion."""
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
        """Return a joint where a share of the motion is done."""
        return linear(name, start, end, share)

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return the distance (M,), rad or m, that a joint travels."""
        return smooth_abs(getattr(end, name) - getattr(start, name))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the extremes of a joint along each motion (M,); it is fastest at the end of the ramp."""
        ramp, (begin, stop) = self.phases(start, end)[0], (getattr(states, name) for states in (start, end))
        lasts = ramp.duration > 0
        rate = np.where(lasts, 2.0 * ramp.end / np.where(lasts, ramp.duration, 1.0), 0.0)
        change = np.where(lasts, rate / np.where(lasts, ramp.duration, 1.0), 0.0)
        way = np.abs(stop - begin)
        return Extremes(np.minimum(begin, stop), np.maximum(begin, stop), rate * way, change * way)

    def _least_times(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the greatest |D|/v (M,), s, and |D|/a (M,), s², over the joints."""
        lasts: Column = None
        square: Column = None
        for name, speed, acceleration in zip(self.names, self.speeds, self.accelerations, strict=True):
            way = smooth_abs(getattr(end, name) - getattr(start, name))
            by_speed, by_acceleration = way / speed, way / acceleration
            lasts = by_speed if lasts is None else np.maximum(lasts, by_speed)
            square = by_acceleration if square is None else np.maximum(square, by_acceleration)
        return lasts, square


def rate_of(name: str) -> str:
    """Return the name of the column with a joint's speed at a knot."""
    return f"{name}_rate"


@dataclass(frozen=True)
class JointSpline:
    """Piece of a spline: cubic Hermite polynomials through the joint values and speeds at both ends.

    names          of the joints
    speeds         rad/s or m/s, greatest speed of each joint
    accelerations  rad/s² or m/s², greatest acceleration of each joint

    A state needs further columns: ``<joint>_rate``, rad/s or m/s, for each joint, and ``clock`` (s, from any zero; the
    difference is the motion's duration). The law leads to any given state at a later clock.
    """

    names: tuple[str, ...]
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...]
    kind: str = "spline"

    quadrature = "adaptive"
    reversible = False

    @cached_property
    def extra(self) -> tuple[str, ...]:
        """Columns of joint speeds, and the clock."""
        return (*map(rate_of, self.names), CLOCK)

    @cached_property
    def varies(self) -> frozenset[str]:
        """All columns."""
        return frozenset((*self.names, *self.extra))

    @cached_property
    def even(self) -> frozenset[str]:
        """Columns that need no finer sampling: speeds are parabolas of time."""
        return frozenset(self.extra)

    @cached_property
    def _joint_of(self) -> dict[str, str]:
        return {rate_of(name): name for name in self.names}

    def knots(self, values: Sequence[Column], rates: Sequence[Column], clock: Column) -> States:
        """Return states from joint values and speeds, columns of numbers or symbols, at times, s."""
        speeds = dict(zip(map(rate_of, self.names), rates, strict=True))
        return States(**dict(zip(self.names, values, strict=True)), **speeds, clock=clock)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return a single phase, in which the share is that of the time."""
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the value of a joint, of its speed or of the clock after a share of the motion's time."""
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
        """Return first and second derivative by the share."""
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
        """Return zeros: an arm has no heading, so no turns are counted."""
        none = 0.0 * (end.clock - start.clock)
        return none, none

    def strays(self, start: States, end: States) -> Column:
        """Return 0 (M,), or inf if time runs backwards; where no time passes, the jump of a joint value or speed."""
        jump = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in self.varies - {CLOCK}], axis=0)
        return np.where(end.clock > start.clock, 0.0, np.where(end.clock == start.clock, jump, np.inf))

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return a bound (M,), rad or m, on a joint's travel: the length of the control polygon of its cubic."""
        first, last = self._tangents(name, start, end)
        span = getattr(end, name) - getattr(start, name)
        return (smooth_abs(first) + smooth_abs(last) + smooth_abs(3.0 * span - first - last)) / 3.0

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the exact extremes of a joint along each motion (M,), also at zeros of speed and acceleration."""
        lasts = end.clock - start.clock
        safe = np.where(lasts > 0, lasts, 1.0)
        first, (begin, last) = (
            self.slopes(name, start, end, 0.0)[0],
            (self.slopes(name, start, end, u)[1] for u in (0.0, 1.0)),
        )
        fractions = [np.zeros(lasts.size), np.ones(lasts.size), _ratios_in_unit_interval(begin, begin - last)]
        root = np.sqrt(np.maximum(0.0, begin * begin - 2.0 * first * (last - begin)))
        values = [*fractions]
        for sign in (1.0, -1.0):  # first + begin u + (last - begin) u² / 2 = 0, without cancellation
            half = -(begin + sign * np.where(begin >= 0, 1.0, -1.0) * root)
            values += [_ratios_in_unit_interval(half, last - begin), _ratios_in_unit_interval(2.0 * first, half)]
        places = np.array([self.interpolate(name, start, end, share) for share in values])
        speeds = np.array([np.abs(self.slopes(name, start, end, share)[0]) for share in fractions])
        return Extremes(
            places.min(axis=0),
            places.max(axis=0),
            speeds.max(axis=0) / safe,
            np.maximum(np.abs(begin), np.abs(last)) / safe**2,
        )

    def _tangents(self, name: str, start: States, end: States) -> tuple[Column, Column]:
        """Return the slopes by the share at both ends."""
        lasts = end.clock - start.clock
        return lasts * getattr(start, rate_of(name)), lasts * getattr(end, rate_of(name))


def _ratios_in_unit_interval(above: FloatArray, below: FloatArray) -> FloatArray:
    """Return the quotients (M,) of ``above`` and ``below`` that lie in [0, 1], and 0 for others."""
    some = below != 0.0
    quotient = np.where(some, above / np.where(some, below, 1.0), 0.0)
    return np.where((quotient > 0.0) & (quotient < 1.0), quotient, 0.0)


class ArmBody(Body):
    """Motion of a body at the tip of an arm along reaches; only attributes that are read are integrated."""

    def __init__(self, name: str, kinematics: Kinematics, motions: Motions) -> None:
        ends = {key: kinematics.pose(name, states) for key, states in (("start", motions.start), ("end", motions.end))}
        self.__dict__.update(ends, _name=name, _kinematics=kinematics, _ends=(motions.start, motions.end))
        self.__dict__.update(_motions=motions)

    _name: str
    _kinematics: Kinematics
    _ends: tuple[States, States]
    _motions: Motions

    @cached_property
    def length(self) -> Column:
        return self._along(lambda twist: norm(twist.velocity), self._motions.twins)

    @cached_property
    def turned(self) -> Column:
        return self._along(lambda twist: norm(twist.rotation), self._motions.twins)

    @cached_property
    def rotation(self) -> Column:
        return self._along(lambda twist: twist.rotation[2], np.arange(len(self._motions)))

    @property
    def turns(self) -> tuple[Column, ...]:
        return (self.rotation,)

    def _along(self, amount: Callable[[Twist], Column], twins: IntArray) -> Column:
        """Return the integral of a quantity of the twists along motions (M,); twins share the result."""
        start, end = self._ends
        names = self._kinematics.chain.names
        ways = States(**{name: getattr(end, name) - getattr(start, name) for name in names})

        def at(share: Column, owner: IntArray | None = None) -> Column:
            begin, way = (start, ways) if owner is None else (start.take(owner), ways.take(owner))
            there = States(**{name: getattr(begin, name) + getattr(way, name) * share for name in names})
            return amount(self._kinematics.twist(self._name, there, way))

        symbolic = any(is_symbolic(getattr(ways, name)) for name in names)
        if not symbolic and self._motions.panels is None:
            _, turned = self._motions.model.extent(self._motions)
            return adaptive_integrals(at, evenly, np.unique(twins), pieces_of(turned))[twins]
        count = self._motions.panels or PIECES
        return sum(
            weight / count * at((i + node) / count)
            for i in range(count)
            for node, weight in zip(NODES, KRONROD, strict=True)
        )
