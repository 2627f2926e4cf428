"""Motion laws of an arm, checks of its joint limits, and the motion of tool or camera along a reach.

A reach is a motion that is straight in joint space. Let D be the changes of the joints, J_ω the Jacobian of a body's
angular velocity ω, and s the share of the motion done. Then ∫|ω| dt = ∫ |J_ω(q(s)) D| ds, which needs one smooth
integral instead of one for each phase of the timing.
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

BEYOND = 1e-6  # rad or m: tolerance of joint limits
FASTER = 1e-6  # relative tolerance of limits of speed and acceleration
CLOCK = "clock"
PIECES = 3  # quadrature pieces of a reach on CasADi symbols, unless the batch sets another number
NODES = [0.5 + 0.5 * place for place in (-math.sqrt(6 / 7), -math.sqrt(1 / 3), 0.0, math.sqrt(1 / 3), math.sqrt(6 / 7))]
KRONROD = [49 / 495, 27 / 110, 14 / 45, 27 / 110, 49 / 495]
"""Weights of the Gauss-Kronrod rule (1965) with five nodes on [0, 1], two of them Gauss nodes; exact to degree 7."""


class Extremes(NamedTuple):
    """Extremes of one joint along motions (M,): lowest and highest value, largest absolute speed and acceleration."""

    low: FloatArray
    high: FloatArray
    speed: FloatArray
    acceleration: FloatArray


class JointLaw(Law, Protocol):
    """Motion law of an arm, which also knows how far and how fast each joint moves."""

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return an upper bound (M,), rad or m, on how far a joint travels in all, back and forth."""

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the exact extremes of a joint's value, speed and acceleration along each motion (M,)."""


class Excess(NamedTuple):
    """Comparison of motions (M,) with one limit of one joint.

    joint     name of the joint
    quantity  limited quantity for a message, "a speed of "; "" for the value of the joint
    unit      unit of the quantity
    limit     value of the limit, in this unit
    value     (M,)  extreme value of the quantity in each motion
    over      (M,)  by how much it exceeds the limit and its tolerance; 0 or less if it does not
    """

    joint: str
    quantity: str
    unit: str
    limit: float
    value: FloatArray
    over: FloatArray


def excesses(chain: Chain, law: JointLaw, start: States, end: States) -> Iterator[Excess]:
    """Yield a comparison of the motions with each limit of each joint: range, speed and acceleration."""
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
    """Return a mask (M,) of the motions that exceed some limit of a joint."""
    broken = [excess.over > 0.0 for excess in excesses(chain, law, start, end)]
    return np.asarray(np.any(broken, axis=0))


def faults(chain: Chain, law: JointLaw, start: States, end: States, motions: IntArray) -> Iterator[str]:
    """Yield a text for each limit of a joint that motions exceed; it names the motion that exceeds it most.

    motions  (M,)  indices of the motions in their trajectory
    """
    for excess in excesses(chain, law, start, end):
        if excess.over.max(initial=0.0) > 0.0:
            i = int(np.argmax(excess.over))
            yield (
                f"has joint {excess.joint} at {excess.quantity}{excess.value[i]:.6g} {excess.unit} in motion "
                f"{motions[i]}, beyond its limit of {excess.limit:.6g} {excess.unit}"
            )


@dataclass(frozen=True)
class Reach(LawDefaults):
    """Law "reach": a motion of an arm from rest to rest along a straight line in joint space.

    names          names of the joints
    speeds         rad/s or m/s, largest speed of each joint
    accelerations  rad/s² or m/s², largest acceleration of each joint

    At each moment all joints have done an equal share of their changes. The share grows as fast as the joints allow:
    with changes D and limits v and a of the joints, its largest speed is min v/|D| and its acceleration min a/|D|.
    Reaches are executed as planned, and their durations add up.
    """

    names: tuple[str, ...]
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...]
    kind: str = "reach"

    quadrature = "adaptive"
    reversible = True  # the way back passes the same states and takes equal time

    @property
    def varies(self) -> frozenset[str]:
        """Names of the states that change: all joints."""
        return frozenset(self.names)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return the timing: speed up, cruise, slow down; a short motion has no cruise."""
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
        """Return the value of a joint when ``share`` (0 to 1) of the motion is done."""
        return linear(name, start, end, share)

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return how far (M,), rad or m, a joint travels."""
        return smooth_abs(getattr(end, name) - getattr(start, name))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return lowest and highest value, largest speed and acceleration of a joint along each motion (M,).

        The joint is fastest at the end of the speed-up.
        """
        ramp, (begin, stop) = self.phases(start, end)[0], (getattr(states, name) for states in (start, end))
        lasts = ramp.duration > 0
        rate = np.where(lasts, 2.0 * ramp.end / np.where(lasts, ramp.duration, 1.0), 0.0)
        change = np.where(lasts, rate / np.where(lasts, ramp.duration, 1.0), 0.0)
        way = np.abs(stop - begin)
        return Extremes(np.minimum(begin, stop), np.maximum(begin, stop), rate * way, change * way)

    def _least_times(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the largest |D|/v (M,), s, and the largest |D|/a (M,), s², of all joints with changes D.

        The first is the time that the slowest joint needs at its largest speed.
        """
        lasts: Column = None
        square: Column = None
        for name, speed, acceleration in zip(self.names, self.speeds, self.accelerations, strict=True):
            way = smooth_abs(getattr(end, name) - getattr(start, name))
            by_speed, by_acceleration = way / speed, way / acceleration
            lasts = by_speed if lasts is None else np.maximum(lasts, by_speed)
            square = by_acceleration if square is None else np.maximum(square, by_acceleration)
        return lasts, square


def rate_of(name: str) -> str:
    """Return the name of the state column that holds a joint's speed."""
    return f"{name}_rate"


@dataclass(frozen=True)
class JointSpline:
    """Law "spline": each joint follows the cubic polynomial of time with given values and speeds at both ends.

    names          names of the joints
    speeds         rad/s or m/s, largest speed of each joint
    accelerations  rad/s² or m/s², largest acceleration of each joint

    States need further columns: ``<joint>_rate``, rad/s or m/s, for each joint, and ``clock`` (s, from any zero; the
    difference is the motion's duration). A motion can lead from any state to any state with a later clock.
    """

    names: tuple[str, ...]
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...]
    kind: str = "spline"

    quadrature = "adaptive"
    reversible = False

    @cached_property
    def extra(self) -> tuple[str, ...]:
        """Names of the further state columns: the joint speeds, and the clock."""
        return (*map(rate_of, self.names), CLOCK)

    @cached_property
    def varies(self) -> frozenset[str]:
        """Names of the states that change: joints, joint speeds and clock."""
        return frozenset((*self.names, *self.extra))

    @cached_property
    def even(self) -> frozenset[str]:
        """Names of the states with a constant second time derivative: the joint speeds and the clock."""
        return frozenset(self.extra)

    @cached_property
    def _joint_of(self) -> dict[str, str]:
        return {rate_of(name): name for name in self.names}

    def knots(self, values: Sequence[Column], rates: Sequence[Column], clock: Column) -> States:
        """Return states with given joint values, joint speeds and clock, s; each is a column of numbers or symbols."""
        speeds = dict(zip(map(rate_of, self.names), rates, strict=True))
        return States(**dict(zip(self.names, values, strict=True)), **speeds, clock=clock)

    def ends_turn(self, start: States, end: States) -> BoolArray:
        """Return a mask (M,) that is False: an arm has no turns of a base."""
        return np.zeros(start.size, dtype=np.bool_)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the share of the motion done grows evenly with time."""
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the column ``name``, a joint, a joint speed or the clock, after ``share`` (0 to 1) of the time."""
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
        """Return the first and second derivatives of a state with respect to the share of the motion's time."""
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
        """Return zeros (M,), because an arm has no heading and so makes no turns."""
        none = 0.0 * (end.clock - start.clock)
        return none, none

    def strays(self, start: States, end: States) -> Column:
        """Return the error (M,) of the given end states: 0 if the clock advances, inf if it runs backwards.

        If the clock stands still, the error is the largest jump of a joint value or speed.
        """
        jump = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in self.varies - {CLOCK}], axis=0)
        return np.where(end.clock > start.clock, 0.0, np.where(end.clock == start.clock, jump, np.inf))

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return an upper bound (M,), rad or m, on how far a joint travels: the control polygon length of its cubic."""
        first, last = self._tangents(name, start, end)
        span = getattr(end, name) - getattr(start, name)
        return (smooth_abs(first) + smooth_abs(last) + smooth_abs(3.0 * span - first - last)) / 3.0

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the exact extremes of a joint along each motion (M,).

        They are at the ends of the motion, or where the speed or the acceleration is zero.
        """
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
        """Return the derivatives of a joint with respect to the share of the motion's time, at both ends."""
        lasts = end.clock - start.clock
        return lasts * getattr(start, rate_of(name)), lasts * getattr(end, rate_of(name))


def _ratios_in_unit_interval(above: FloatArray, below: FloatArray) -> FloatArray:
    """Return the quotients ``above``/``below`` (M,), with 0 in place of those that are not between 0 and 1."""
    some = below != 0.0
    quotient = np.where(some, above / np.where(some, below, 1.0), 0.0)
    return np.where((quotient > 0.0) & (quotient < 1.0), quotient, 0.0)


class ArmBody(Body):
    """Motion of tool or camera along reaches; path length and rotations are integrated when they are first read."""

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
        """Return the integral over each motion (M,) of a quantity computed from the body's velocities.

        twins  (M,)  for each motion, the index of the motion whose integral it shares, such as its reverse
        """
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
