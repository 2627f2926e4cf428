"""Motion laws: their timing, their protocols, and the hold, which every robot has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column
from hpop.motions.states import States, StateSpace

if TYPE_CHECKING:
    pass


INSTANT = 1e-12  # s: shorter phases are rounding errors, such as the cruise of a short turn
_FOUND: dict[tuple[type, type], bool] = {}
CLOCK = "clock"  # s, from any zero: the state with the durations of holds and curves as differences
LONGEST = 3600.0  # s: longest holds of a trajectory in all; more must be a mistake in the unit


@checked_arguments
class Phase(NamedTuple):
    """Smooth part of a law's timing: the share of the motion done goes from ``begin`` to ``end``.

    duration  (M,)  s
    begin     (M,)  share of the motion done when the phase begins
    end       (M,)  share done when it ends
    shape     growth of the share within the phase: hold, cruise, speed-up or slow-down (constant acceleration); drive:
              even, but the states do not change in proportion to it; ramp: part of a speed-up or slow-down
    change    (M,)  of a ramp: relative excess of the speed at its end over the mean; -1 to 1
    """

    duration: Column
    begin: Column
    end: Column
    shape: str
    change: Column = 0.0

    def share(self, u: Column) -> Column:
        """Return the share of the motion done at fraction ``u`` of the phase's time."""
        if self.shape == "ramp":
            return self.begin + (self.end - self.begin) * u * (1.0 + self.change * (u - 1.0))
        grown = {"hold": 0.0 * u, "cruise": u, "drive": u, "speed-up": u * u, "slow-down": u * (2.0 - u)}[self.shape]
        return self.begin + (self.end - self.begin) * grown

    def share_rates(self, u: Column) -> tuple[Column, Column]:
        """Return the first and second time derivatives of the share, 1/s and 1/s², at fraction ``u`` of the time."""
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
        """Return the part between two fractions (M,) of the phase's time."""
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

    extra       names of the states that the law needs beside the model's own; default (). If a law stores a duration
                in its states, it is the difference of ``clock``, s, from any zero
    reversible  whether the motion from b to a passes the states of the motion from a to b; default False
    quadrature  "adaptive" for integrals by :mod:`hpop.motions.quadrature`, None for panels; default None
    """

    @property
    def kind(self) -> str:
        """Name of the law: "move", "turn"."""

    @property
    def varies(self) -> frozenset[str]:
        """Names of the states that change within a motion; all others keep their start value."""

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return the phases in order; their durations add up to the motion's duration."""

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return state ``name`` where ``share`` of the motion is done."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def extra(self) -> tuple[str, ...]: ...

        @property
        def reversible(self) -> bool: ...

        @property
        def quadrature(self) -> str | None: ...


class LawDefaults:
    """Defaults of a law's optional members."""

    extra: ClassVar[tuple[str, ...]] = ()
    reversible: ClassVar[bool] = False
    quadrature: ClassVar[str | None] = None


@runtime_checkable
class Coupled(Law, Protocol):
    """Law with states that depend on one another, so that not every end can be reached from a start."""

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the motion done."""

    def strays(self, start: States, end: States) -> Column:
        """Return the distance (M,), m or rad, between each given end and the end computed by the law from the start."""


@runtime_checkable
class Curve(Coupled, Protocol):
    """Law of curves: its states are not in proportion to the share done, and its yaw rate may change its sign.

    All other laws change their states evenly with the share, and each of their motions is one whole turn.
    """

    @property
    def extra(self) -> tuple[str, ...]:
        """Names of the states that the law needs beside the model's own."""

    @property
    def even(self) -> frozenset[str]:
        """Names of the states with a constant second derivative by time within a motion."""

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the signed rotation (M,), rad, before and after the yaw rate changes sign, at most once."""


@checked_arguments
def is_curve(law: Law) -> TypeGuard[Curve]:
    """Return whether a law is a law of curves."""
    return follows(law, Curve)


@checked_arguments
def is_coupled(law: Law) -> TypeGuard[Coupled]:
    """Return whether the states of a law depend on each other."""
    return follows(law, Coupled)


def follows(law: Law, protocol: type) -> bool:
    """Return whether a law follows a protocol; the answer is cached by class."""
    found = _FOUND.get((type(law), protocol))
    if found is None:
        found = _FOUND[type(law), protocol] = isinstance(law, protocol)
    return found


@checked_arguments
def slopes(law: Law, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
    """Return the first and second derivatives of a state with respect to the share of the motion done."""
    if is_coupled(law):
        return law.slopes(name, start, end, share)
    return getattr(end, name) - getattr(start, name), 0.0


@checked_arguments
def onward(law: Law, space: StateSpace, start: States, end: States) -> States:
    """Return states ``end`` (M,) with turning columns changed so that a law leads there the shorter way (+pi if equal).

    The other states of a coupled law follow from these: a head turns back half a turn clockwise.
    """
    turning = law.varies & space.turning
    end = space.onward(start, end) if turning else end
    if not is_coupled(law):
        return end
    return States(**end.__dict__ | {name: law.interpolate(name, start, end, np.float64(1.0)) for name in turning})


class Leg(NamedTuple):
    """One motion in each of M chains of motions from state to state.

    kind     kind of the motion's law
    end      states (M,) at the end of the motion
    present  (M,)  whether the chain has this motion; otherwise its end is the chain's state before it
    """

    kind: str
    end: States
    present: BoolArray


@checked_arguments
@dataclass(frozen=True)
class Hold(LawDefaults):
    """Hold: nothing changes but the clock, and its difference is the duration.

    Motions of other laws carry the clock along unread.
    """

    kind: str = "hold"

    varies = frozenset({CLOCK})
    extra = (CLOCK,)

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return a single phase, in which the share of the motion done is the share of the time."""
        duration = end.clock - start.clock
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the clock after a share of the motion's time."""
        begin = getattr(start, name)
        return begin + (getattr(end, name) - begin) * share


HOLD = Hold()


@checked_arguments
def stands(law: Law) -> bool:
    """Return whether a robot stands still under a law, as in a hold."""
    return law.varies <= {CLOCK}
