"""Laws of free speed (ramps): motions with constant acceleration along a straight line of states.

Speed profiles (:func:`hpop.retime`) of bases that carry a head or an arm consist of them. Beside each executed law
NAME, such a robot has the law NAME_ramp of equal geometry. Its states have one more column, ``pace``: how fast the
robot follows its path, as a share of full speed. The length of a motion is the Euclidean norm of the times, s, that
its states need at their largest speeds. At a pace of 1, this is the duration of the motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import norm
from hpop.models.laws import InPlaceGeometry, JointMove, Run, Spin, StraightGeometry, Unwind, linear
from hpop.models.serial_arm.laws import Extremes, Reach
from hpop.models.speeds import SLOW, SpeedChange, SpeedRamp
from hpop.motions import Law, LawDefaults, Model, Phase, States, laws_of
from hpop.motions.laws import PACE

if TYPE_CHECKING:
    from hpop.trajectories.trajectory import Trajectory

SUFFIX = "_ramp"
WAY = "way"
BEYOND = 1e-6  # relative tolerance of limits of speed and acceleration
Limits = Mapping[str, tuple[float, float]]
"""Largest speed and acceleration by the name of a state; `WAY` is the distance driven, m."""


class Ramp(LawDefaults):
    """Timing with constant acceleration, from the pace of the start to that of the end; a base class of ramps.

    The pace of a state is a share of full speed: at 1, the motion takes the time that is its :meth:`length`.
    """

    extra = (PACE,)

    @property
    def limits(self) -> Limits:
        """Largest speeds and accelerations of the states that change."""
        raise NotImplementedError

    def changes(self, start: States, end: States) -> dict[str, Column]:
        """Return by how much (M,) the states of `limits` change."""
        return {name: getattr(end, name) - getattr(start, name) for name in self.limits}

    def length(self, start: States, end: States) -> Column:
        """Return the length (M,) of each motion, s: the norm of the times that its changes take at full speed.

        With one changing state, it is the duration at full speed.
        """
        ways = self.changes(start, end)
        return norm([ways[name] / speed for name, (speed, _) in self.limits.items()])

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the speed grows or falls evenly with time."""
        total = start.pace + end.pace
        positive = total > 0
        safe = np.where(positive, total, 1.0)
        duration = np.where(positive, 2.0 * self.length(start, end) / safe, 0.0)
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "ramp", (end.pace - start.pace) / safe),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the column ``name`` after a share (0 to 1) of the way; the squared pace grows evenly along it."""
        if name == PACE:
            return np.sqrt(np.maximum(start.pace**2 + (end.pace**2 - start.pace**2) * share, 0.0))
        return linear(name, start, end, share)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the way."""
        if name != PACE:
            return getattr(end, name) - getattr(start, name), 0.0
        pace = self.interpolate(PACE, start, end, share)
        grows, moves = 0.5 * (end.pace**2 - start.pace**2), pace > SLOW
        slope = np.where(moves, grows / np.where(moves, pace, 1.0), 0.0)
        return slope, -np.where(moves, slope**2 / np.where(moves, pace, 1.0), 0.0)

    def strays(self, start: States, end: States) -> Column:
        """Return 0 (M,) for possible paces; inf if one is negative, or if both are 0 although the robot moves."""
        wrong = (start.pace < 0) | (end.pace < 0)
        wrong |= (start.pace + end.pace <= 0) & (self.length(start, end) > BEYOND)
        return np.where(wrong, np.inf, 0.0)

    def excess(self, start: States, end: States) -> FloatArray:
        """Return the largest ratio (M,), in each motion, of a speed or acceleration to its limit.

        Above 1 a limit is exceeded; 0 for a motion of length 0.
        """
        length = np.asarray(self.length(start, end))
        safe, fastest = np.where(length > 0, length, 1.0), np.maximum(start.pace, end.pace)
        change = np.abs(end.pace**2 - start.pace**2) / (2.0 * safe)
        used = np.zeros(length.shape)
        for name, way in self.changes(start, end).items():
            speed, acceleration = self.limits[name]
            slope = np.abs(way) / safe
            used = np.maximum(used, np.maximum(slope * fastest / speed, slope * change / acceleration))
        return np.where(length > 0, used, 0.0)


@dataclass(frozen=True)
class RunRamp(Ramp, StraightGeometry):
    """Straight move of a base with a constant acceleration, from the ``pace`` of its start to that of its end."""

    speed: float  # m/s
    acceleration: float  # m/s²
    kind: str = "run_ramp"

    varies = frozenset({"x", "y", PACE})

    @property
    def limits(self) -> Limits:
        return {WAY: (self.speed, self.acceleration)}

    def changes(self, start: States, end: States) -> dict[str, Column]:
        return {WAY: self.travel(start, end, 0.0)}


@dataclass(frozen=True)
class SpinRamp(Ramp, InPlaceGeometry):
    """Turn in place with a constant angular acceleration, from the ``pace`` of its start to that of its end."""

    turn_rate: float  # rad/s
    turn_acceleration: float  # rad/s²
    kind: str = "spin_ramp"

    varies = frozenset({"yaw", PACE})

    @property
    def limits(self) -> Limits:
        return {"yaw": (self.turn_rate, self.turn_acceleration)}


@dataclass(frozen=True)
class JointRamp(Ramp, JointMove):
    """Motion of one joint with a constant acceleration, while the base stands."""

    @property
    def varies(self) -> frozenset[str]:
        return frozenset({self.joint, PACE})

    @property
    def limits(self) -> Limits:
        return {self.joint: (self.speed, self.acceleration)}


@dataclass(frozen=True)
class UnwindRamp(Ramp, Unwind):
    """Turn in place with a constant angular acceleration, during which the head turns back by the same angle."""

    varies = frozenset({"yaw", "pan", PACE})

    @property
    def limits(self) -> Limits:
        both = (self.turn_rate, self.turn_acceleration)
        return {"yaw": both, "pan": both}

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return (Ramp if name == PACE else Unwind).interpolate(self, name, start, end, share)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        return (Ramp if name == PACE else Unwind).slopes(self, name, start, end, share)

    def strays(self, start: States, end: States) -> Column:
        return np.maximum(Ramp.strays(self, start, end), Unwind.strays(self, start, end))


@dataclass(frozen=True)
class ReachRamp(Ramp, Reach):
    """Motion of an arm along a straight line in joint space, with accelerations of joints that are constant."""

    quadrature = "adaptive"

    @property
    def varies(self) -> frozenset[str]:
        return frozenset({*self.names, PACE})

    @property
    def limits(self) -> Limits:
        return dict(zip(self.names, zip(self.speeds, self.accelerations, strict=True), strict=True))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        (phase,) = self.phases(start, end)
        lasts = np.where(phase.duration > 0, phase.duration, np.inf)
        begin, stop = getattr(start, name), getattr(end, name)
        way = np.abs(stop - begin)
        rate, change = (1.0 + np.abs(phase.change)) / lasts, 2.0 * np.abs(phase.change) / lasts**2
        return Extremes(np.minimum(begin, stop), np.maximum(begin, stop), rate * way, change * way)


def ramps_of(laws: Mapping[str, Law], change: Law | None = None, speeds: Sequence[float] = ()) -> dict[str, Law]:
    """Return the ramps that belong to executed laws, by kind; a law that hpop does not know has none.

    change  law of changes of speed, for a base with several speeds
    speeds  m/s, rising, for such a base
    """
    made: list[Law] = []
    for kind, law in laws.items():
        name = kind + SUFFIX
        if isinstance(law, Run):
            made.append(RunRamp(law.speed, law.acceleration, name))
        elif isinstance(law, SpeedRamp):
            made.append(RunRamp(speeds[-1], cast(SpeedChange, change).acceleration, name))
        elif isinstance(law, Spin):
            made.append(SpinRamp(law.turn_rate, law.turn_acceleration, name))
        elif isinstance(law, Unwind):
            made.append(UnwindRamp(law.turn_rate, law.turn_acceleration, kind=name))
        elif isinstance(law, JointMove):
            made.append(JointRamp(name, law.joint, law.speed, law.acceleration))
        elif isinstance(law, Reach):
            made.append(ReachRamp(law.names, law.speeds, law.accelerations, name))
    return {law.kind: law for law in made}


def limits_of(model: Model) -> dict[str, tuple[float, float]]:
    """Return the largest speed and acceleration of each state that some ramp changes, by name.

    The distance driven counts as a state called "way", in m. A model without ramps gives an empty dict.
    """
    found = dict[str, tuple[float, float]]()
    for law in model.laws.values():
        if isinstance(law, Ramp):
            for name, (speed, acceleration) in law.limits.items():
                known = found.get(name, (0.0, 0.0))
                found[name] = max(known[0], speed), max(known[1], acceleration)
    return found


def doubtful_ramps(law: Law, start: States, end: States) -> BoolArray:
    """Return a mask (M,) of motions that exceed a speed or an acceleration of their law; all False for other laws."""
    if not isinstance(law, Ramp):
        return np.zeros(start.size, np.bool_)
    return np.asarray(law.excess(start, end) > 1.0 + BEYOND)


def ramp_faults(trajectory: Trajectory) -> Iterator[str]:
    """Yield a text for the first ramp of each kind that is too fast, or speeds up too hard."""
    kinds, laws = np.array(trajectory.kinds, dtype=object), laws_of(trajectory.model)
    for kind in dict.fromkeys(trajectory.kinds):
        motions = np.flatnonzero(kinds == kind)
        states = trajectory.states
        wrong = doubtful_ramps(laws[kind], states.take(motions), states.take(motions + 1))
        if wrong.any():
            yield f"is faster or speeds up harder than its limits in motion {motions[np.argmax(wrong)]}, a {kind}"
