"""Motion laws of robots in the plane: straight moves and turns in place, as planned and as executed.

All planners plan with two laws whose durations add up along the edges of a graph. With cruise speed v and acceleration
a of the base:

- :class:`Move`, a straight move of length L at cruise speed, lasts L/v.
- :class:`Turn` lasts as long as a turn from rest to rest, plus v/a. This is the time that the robot loses by stopping
  before the turn and starting again after it; the plan stands half of it before the turn and half after. If the
  straight moves are at least v²/a long, the sum is exact, otherwise it is an upper bound.

The robot really makes other motions: :class:`Run`, a straight move from rest to rest, and :class:`Spin`, a turn from
rest to rest, both with trapezoidal speed profiles. Speeding up at the start and slowing down at the goal add the
constant v/a to the planned duration.

Curves are planned as they are executed, by the law in :mod:`hpop.models.driven`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hypot, is_symbolic, smooth_abs, wrap
from hpop.models.joints import Joint
from hpop.motions import LawDefaults, Leg, Model, Phase, States, StateSpace

TINY = 1e-12  # m or rad: for shorter distances the derivative of the rest-to-rest time is too large to be used
UNMOVED = 1e-6  # m: tolerance for equal positions
ALIGNED = 1e-9  # rad: smallest angle that counts as a turn


def rest_to_rest(distance: Column, speed: float, acceleration: float) -> tuple[Phase, ...]:
    """Return the phases of a motion from rest to rest over a distance: speed up, cruise, slow down.

    distance      (M,)  m or rad
    speed         m/s or rad/s, largest
    acceleration  m/s² or rad/s²

    The speed profile is a trapezoid; for a distance d below speed²/a it is a triangle, without cruise. Each ramp lasts
    min(speed/a, sqrt(d/a)), so the motion lasts d/speed + speed/a, or 2 sqrt(d/a) for short distances.
    """
    safe = np.where(distance > TINY, distance, TINY) if is_symbolic(distance) else distance
    ramp = np.minimum(speed / acceleration, np.sqrt(safe / acceleration))
    ramped = 0.5 * acceleration * ramp * ramp  # distance covered by one ramp
    cruise = np.maximum(distance - 2.0 * ramped, 0.0) / speed
    positive = distance > TINY
    share = np.where(positive, ramped / np.where(positive, distance, 1.0), 0.5)
    nothing = 0.0 * share
    return (
        Phase(ramp, nothing, share, "speed-up"),
        Phase(cruise, share, 1.0 - share, "cruise"),
        Phase(ramp, 1.0 - share, 1.0 + nothing, "slow-down"),
    )


def with_waits(motion: tuple[Phase, ...], loss: Column) -> tuple[Phase, ...]:
    """Return the phases of a motion in place with a wait before and a wait after it, each ``loss``/2 s long.

    ``loss`` is the time that the robot loses by stopping before the motion and starting again after it.
    """
    nothing = 0.0 * motion[0].begin
    wait = 0.5 * loss + nothing
    stand = Phase(wait, nothing, nothing, "hold")
    stand_again = Phase(wait, 1.0 + nothing, 1.0 + nothing, "hold")
    return (stand, *motion, stand_again)


def linear(name: str, start: States, end: States, share: Column) -> Column:
    """Return the column ``name`` when ``share`` (0 to 1) of a motion is done, linear between start and end."""
    begin = getattr(start, name)
    return begin + (getattr(end, name) - begin) * share


class StraightGeometry(LawDefaults):
    """Geometry of a straight move: x and y change in proportion to the share done, and the heading is constant."""

    varies = frozenset({"x", "y"})

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return linear(name, start, end, share)

    def travel(self, start: States, end: States, lever: Column) -> Column:
        return hypot(end.x - start.x, end.y - start.y)

    def turned(self, start: States, end: States) -> Column:
        return 0.0 * (end.yaw - start.yaw)


class InPlaceGeometry(LawDefaults):
    """Geometry of a turn in place: the yaw changes in proportion to the share done, and x and y are constant."""

    varies = frozenset({"yaw"})

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return linear(name, start, end, share)

    def travel(self, start: States, end: States, lever: Column) -> Column:
        return lever * smooth_abs(end.yaw - start.yaw)

    def turned(self, start: States, end: States) -> Column:
        return end.yaw - start.yaw


@dataclass(frozen=True)
class Move(StraightGeometry):
    """Planned law of a straight move, whose whole length is driven at cruise speed, m/s."""

    speed: float
    kind: str = "move"

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        duration = self.travel(start, end, 0.0) / self.speed
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)


@dataclass(frozen=True)
class Turn(InPlaceGeometry):
    """Planned law of a turn in place: from rest to rest, with a wait of half the ``loss`` before and after it."""

    turn_rate: float  # rad/s
    turn_acceleration: float  # rad/s²
    loss: float  # s, time that the robot loses by stopping before the turn and starting again
    kind: str = "turn"

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        spin = rest_to_rest(smooth_abs(end.yaw - start.yaw), self.turn_rate, self.turn_acceleration)
        return with_waits(spin, self.loss)


@dataclass(frozen=True)
class Run(StraightGeometry):
    """Executed law of a straight move: from rest to rest."""

    speed: float  # m/s
    acceleration: float  # m/s²
    kind: str = "run"

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        return rest_to_rest(self.travel(start, end, 0.0), self.speed, self.acceleration)


@dataclass(frozen=True)
class Spin(InPlaceGeometry):
    """Executed law of a turn in place: from rest to rest."""

    turn_rate: float  # rad/s
    turn_acceleration: float  # rad/s²
    kind: str = "spin"

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        return rest_to_rest(smooth_abs(end.yaw - start.yaw), self.turn_rate, self.turn_acceleration)


@dataclass(frozen=True)
class JointMove(LawDefaults):
    """Law by which one joint moves from rest to rest while the base stands.

    kind          name of the law
    joint         name of the state that changes
    speed         rad/s or m/s
    acceleration  rad/s² or m/s²
    loss          s, time that the base loses by stopping and starting again; half of it is a wait before the motion of
                  the joint, half a wait after it
    """

    kind: str
    joint: str
    speed: float
    acceleration: float
    loss: float = 0.0

    @property
    def varies(self) -> frozenset[str]:
        """Name of the only state that changes: that of the joint."""
        return frozenset({self.joint})

    def change(self, start: States, end: States) -> Column:
        """Return the signed change (M,), rad or m, of the joint."""
        change: Column = getattr(end, self.joint) - getattr(start, self.joint)
        return change

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return the timing: speed up, cruise and slow down, between two waits if the law has a ``loss``."""
        motion = rest_to_rest(smooth_abs(self.change(start, end)), self.speed, self.acceleration)
        return with_waits(motion, self.loss) if self.loss else motion

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the column ``name`` when ``share`` (0 to 1) of the joint's change is done."""
        return linear(name, start, end, share)

    def travel(self, start: States, end: States, lever: Column) -> Column:
        """Return zero: the base does not move."""
        return 0.0 * start.x

    def turned(self, start: States, end: States) -> Column:
        """Return zero: the base does not turn."""
        return 0.0 * start.yaw


def joint_laws(joints: Iterable[Joint], loss: float) -> dict[str, JointMove]:
    """Return two laws for each joint: the planned law, named as the joint, and the executed law, named NAME_run.

    loss  s, time that the base loses by stopping and starting again; only planned laws contain it
    """
    laws = dict[str, JointMove]()
    for joint in joints:
        for kind, lost in ((joint.name, loss), (f"{joint.name}_run", 0.0)):
            laws[kind] = JointMove(kind, joint.name, joint.speed, joint.acceleration, lost)
    return laws


def turn_move_turn(space: StateSpace, a: States, b: States, *, turn: str = "turn", move: str = "move") -> list[Leg]:
    """Return the motions from states a (M,) to states b: a turn towards b, a straight move, a turn to b's heading.

    turn, move  names of the laws for turns and moves

    The last turn is left out where the heading of b is NaN (any heading).
    """
    apart = np.hypot(b.x - a.x, b.y - a.y) > UNMOVED
    arrives = np.where(np.isnan(b.yaw), a.yaw, b.yaw)
    ahead = np.where(apart, np.arctan2(b.y - a.y, b.x - a.x), arrives)
    last = np.where(np.isnan(b.yaw), ahead, b.yaw)
    first, second = (np.where(np.abs(by) > ALIGNED, by, 0.0) for by in (wrap(ahead - a.yaw), wrap(last - ahead)))
    place = {"x": np.where(apart, b.x, a.x), "y": np.where(apart, b.y, a.y)}
    own = {name: getattr(a, name) for name in space.names}
    return [
        Leg(turn, States(**own | {"yaw": a.yaw + first}), first != 0.0),
        Leg(move, States(**own | place | {"yaw": a.yaw + first}), apart),
        Leg(turn, States(**own | place | {"yaw": a.yaw + first + second}), second != 0.0),
    ]


def cruise_speed(base: Model) -> float:
    """Return the speed, m/s, at which a base in the plane is planned to drive straight ahead, over one metre."""
    move = base.laws.get("move")
    if isinstance(move, Move):
        return move.speed
    begin, end = (States(x=np.full(1, x), y=np.zeros(1), yaw=np.zeros(1)) for x in (0.0, 1.0))
    lasts = 0.0
    for leg in base.connect(begin, end):
        phases = base.laws[leg.kind].phases(begin, leg.end)
        lasts += float(sum(phase.duration for phase in phases)[0]) if leg.present[0] else 0.0
        begin = leg.end
    return 1.0 / lasts


@dataclass(frozen=True)
class Unwind(Turn):
    """Law of a turn in place during which the head turns back by the same angle, so that the view does not change.

    Base and head turn with one speed profile, so ``turn_rate`` and ``turn_acceleration`` must be within the limits of
    both.
    """

    loss: float = 0.0
    kind: str = "unwind"

    varies = frozenset({"yaw", "pan"})

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return the timing of the base's turn: from rest to rest, between two waits if the law has a ``loss``."""
        spin = rest_to_rest(smooth_abs(end.yaw - start.yaw), self.turn_rate, self.turn_acceleration)
        return with_waits(spin, self.loss) if self.loss else spin

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the column ``name`` when ``share`` (0 to 1) of the turn is done; the pan changes by minus the yaw."""
        return start.pan - (end.yaw - start.yaw) * share if name == "pan" else linear(name, start, end, share)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the derivatives of a state with respect to the share done; those of pan and yaw add up to 0 exactly.

        Then the yaw of the view is constant without any rounding error.
        """
        return (start.yaw - end.yaw if name == "pan" else end.yaw - start.yaw), 0.0

    def strays(self, start: States, end: States) -> Column:
        """Return the error (M,), rad, of the given ends: the angle by which the view turns although it must not."""
        return smooth_abs((end.yaw - start.yaw) + (end.pan - start.pan))
