"""Protocols and timing of motion laws, and the law "hold" (standing still), which every robot has.

A motion law says how one kind of motion, such as a straight move, leads from its start state to its end state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column
from hpop.motions.states import States, StateSpace

if TYPE_CHECKING:
    pass


INSTANT = 1e-12  # s: shorter phases are rounding errors, such as the cruise of a short turn
_FOUND: dict[tuple[type, type], bool] = {}
SPEED = "speed"  # m/s: the state with the speed of a base that has several (:mod:`hpop.models.speeds`)
PACE = "pace"  # share of full speed: the state with the speed along a path (:mod:`hpop.models.ramps`)
CHANGE = "speed_change"  # kind of the law by which such a base changes its speed
CLOCK = "clock"  # s, from any zero: a state whose difference over a hold or a curve is the duration of that motion
LONGEST = 3600.0  # s: all holds of a trajectory together last at most this long; more must be a mistake in the unit


@checked_arguments
class Phase(NamedTuple):
    """One phase of the timing of motions, such as speeding up: the share of the motion done grows smoothly in it.

    duration  (M,)  s
    begin     (M,)  share of the motion done, 0 to 1, when the phase begins
    end       (M,)  share done when it ends
    shape     how the share grows: "hold" (not), "cruise" (evenly), "speed-up" or "slow-down" (constant acceleration),
              "ramp" (a part of a speed-up or slow-down), or "drive" (evenly, but the states of a curve do not change in
              proportion to the share)
    change    (M,)  for a ramp: (speed at its end - mean speed) / mean speed, -1 to 1
    """

    duration: Column
    begin: Column
    end: Column
    shape: str
    change: Column = 0.0

    def share(self, u: Column) -> Column:
        """Return the share of the motion done, 0 to 1, after the fraction ``u`` of the phase's time."""
        if self.shape == "ramp":
            return self.begin + (self.end - self.begin) * u * (1.0 + self.change * (u - 1.0))
        grown = {"hold": 0.0 * u, "cruise": u, "drive": u, "speed-up": u * u, "slow-down": u * (2.0 - u)}[self.shape]
        return self.begin + (self.end - self.begin) * grown

    def share_rates(self, u: Column) -> tuple[Column, Column]:
        """Return the first and second time derivatives, 1/s and 1/s², of the share of the motion done.

        u  fraction of the phase's time
        """
        first, second = {
            "hold": (0.0 * u, 0.0),
            "cruise": (1.0 + 0.0 * u, 0.0),
            "drive": (1.0 + 0.0 * u, 0.0),
            "speed-up": (2.0 * u, 2.0),
            "slow-down": (2.0 - 2.0 * u, -2.0),
            "ramp": (1.0 + self.change * (2.0 * u - 1.0), 2.0 * self.change),
        }[self.shape]
        lasts = self.duration > INSTANT
        frequency = np.where(lasts, 1.0 / np.where(lasts, self.duration, 1.0), 0.0)
        scale = (self.end - self.begin) * frequency
        return scale * first, scale * frequency * second

    def part(self, first: Column, last: Column) -> Phase:
        """Return the part of this phase between two fractions (M,) of its time, as a phase of its own."""
        ends = self.share(first), self.share(last)
        change = {"speed-up": 1.0, "slow-down": -1.0, "ramp": self.change}.get(self.shape)
        if change is None:
            return Phase(self.duration * (last - first), *ends, self.shape)
        mean = 1.0 + change * (first + last - 1.0)  # speed in the part, as a share of that in the phase
        change = np.where(mean > 0, change * (last - first) / np.where(mean > 0, mean, 1.0), 0.0)
        return Phase(self.duration * (last - first), *ends, "ramp", change)


class Law(Protocol):
    """Motion law: how one kind of motion goes from its start state to its end state.

    These members are optional:

    extra       names of state columns that the law needs beside the model's own; default (). A law that stores its
                duration in states uses the column ``clock``, s, from any zero: the difference is the duration
    reversible  True if the motion from b to a passes the same states as the motion from a to b; default False
    ends_turn   method: takes states start and end (M,), returns a mask (M,): for curves, True where a turn ends with
                the motion although the next motion turns the same way; default all False
    quadrature  "adaptive" if costs are integrated adaptively (:mod:`hpop.motions.quadrature`); default None: with
                intervals of fixed length
    """

    @property
    def kind(self) -> str:
        """Name of the law: "move", "turn"."""

    @property
    def varies(self) -> frozenset[str]:
        """Names of the states that change within a motion; all others keep their start value."""

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return the timing of motions as phases in order, such as speed-up, cruise and slow-down.

        Their durations add up to the duration of the motion.
        """

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the column ``name`` of the state in which ``share`` (0 to 1) of the motion is done."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def extra(self) -> tuple[str, ...]: ...

        @property
        def reversible(self) -> bool: ...

        @property
        def quadrature(self) -> str | None: ...

        def ends_turn(self, start: States, end: States) -> BoolArray: ...


class LawDefaults:
    """Defaults of a law's optional members."""

    extra: ClassVar[tuple[str, ...]] = ()
    reversible: ClassVar[bool] = False
    quadrature: ClassVar[str | None] = None

    def ends_turn(self, start: States, end: States) -> BoolArray:
        """Return a mask (M,): True where no turn along curves goes on beyond the end of a motion; here none."""
        return np.zeros(start.size, dtype=np.bool_)


@runtime_checkable
class Coupled(Law, Protocol):
    """Law whose states depend on each other, so that a motion cannot lead from every start to every end.

    An example is a base that turns while its camera turns back by the same angle.
    """

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the motion done."""

    def strays(self, start: States, end: States) -> Column:
        """Return the distance (M,), m or rad, between each given end and the end computed by the law from the start."""


@runtime_checkable
class Curve(Coupled, Protocol):
    """Law of curves: its states do not change in proportion to the share of the motion done.

    Its yaw rate may change its sign within a motion. Under all other laws the yaw changes in proportion to the share,
    so that each motion is a single turn in one direction.
    """

    @property
    def extra(self) -> tuple[str, ...]:
        """Names of the states that the law needs beside the model's own."""

    @property
    def even(self) -> frozenset[str]:
        """Names of the states whose second time derivative is constant within a motion."""

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the signed rotations (M,), rad, before and after the yaw rate changes its sign.

        It does so at most once in a motion. If it does not, the second rotation is 0.
        """


@checked_arguments
def is_curve(law: Law) -> TypeGuard[Curve]:
    """Return whether a law follows the protocol :class:`Curve`."""
    return follows(law, Curve)


@checked_arguments
def is_coupled(law: Law) -> TypeGuard[Coupled]:
    """Return whether a law follows the protocol :class:`Coupled`: its states depend on each other."""
    return follows(law, Coupled)


def follows(value: Any, protocol: type) -> bool:
    """Return whether a law or another value follows a protocol; the answer is cached by class."""
    found = _FOUND.get((type(value), protocol))
    if found is None:
        found = _FOUND[type(value), protocol] = isinstance(value, protocol)
    return found


@checked_arguments
def slopes(law: Law, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
    """Return the first and second derivatives of a state with respect to the share of the motion done."""
    if is_coupled(law):
        return law.slopes(name, start, end, share)
    return getattr(end, name) - getattr(start, name), 0.0


@checked_arguments
def onward(law: Law, space: StateSpace, start: States, end: States) -> States:
    """Return states ``end`` (M,) with whole turns added to turning columns, so that motions turn the shorter way.

    For half a turn that is +pi, counter-clockwise. Under a coupled law, turning columns follow from the other ones: if
    the base turns by +pi, a head that keeps its view turns back by -pi.
    """
    turning = law.varies & space.turning
    end = space.onward(start, end) if turning else end
    if not is_coupled(law):
        return end
    return States(**end.__dict__ | {name: law.interpolate(name, start, end, np.float64(1.0)) for name in turning})


class Leg(NamedTuple):
    """One step of M sequences of motions: the next motion in each sequence.

    kind     name of the law of all M motions, such as "move"
    end      states (M,) at the end of the motion
    present  (M,)  False where a sequence skips this step; ``end`` is then the state before the step
    """

    kind: str
    end: States
    present: BoolArray


@checked_arguments
@dataclass(frozen=True)
class Hold(LawDefaults):
    """Law of a hold: the robot stands still, and only the state ``clock`` changes.

    The difference of the clock between end and start, s, is the duration of the hold. Curves use their clock in the
    same way. The states of other motions may have a clock, too, but their laws do not use it.
    """

    kind: str = "hold"

    varies = frozenset({CLOCK})
    extra = (CLOCK,)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the share of the motion done grows evenly with time."""
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the clock, s, when ``share`` (0 to 1) of the hold is over."""
        begin = getattr(start, name)
        return begin + (getattr(end, name) - begin) * share


HOLD = Hold()


@checked_arguments
def stands(law: Law) -> bool:
    """Return whether the robot stands still under a law: no state but the clock changes."""
    return law.varies <= {CLOCK}
