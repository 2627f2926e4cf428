"""What moves, and by which laws: the protocols that models and motion laws follow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.motions.collision import Collision
from hpop.motions.space import StateSpace
from hpop.motions.states import Pose, States, Twist

if TYPE_CHECKING:
    from hpop.motions.batch import Motions
    from hpop.motions.bodies import Body
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World


INSTANT = 1e-12  # s: a phase that lasts no longer is one by rounding, such as the cruise of a short turn


@checked_arguments
class Phase(NamedTuple):
    """One smooth part of a law's timing: the share of the motion done goes from ``begin`` to ``end``.

    duration  (M,)  s
    begin     (M,)  share of the motion done when the phase begins
    end       (M,)  share done when it ends
    shape     how the share grows within the phase: hold, cruise, speed-up or slow-down (constant acceleration); drive:
              evenly, but the states do not change in proportion to it; ramp: part of a speed-up or slow-down
    change    (M,)  of a ramp: by how much faster than on average it ends, as a share of that; -1 to 1
    """

    duration: Column
    begin: Column
    end: Column
    shape: str
    change: Column = 0.0

    def share(self, u: Column) -> Column:
        """Share of the motion done at fraction ``u`` of the phase's time."""
        if self.shape == "ramp":
            return self.begin + (self.end - self.begin) * u * (1.0 + self.change * (u - 1.0))
        grown = {"hold": 0.0 * u, "cruise": u, "drive": u, "speed-up": u * u, "slow-down": u * (2.0 - u)}[self.shape]
        return self.begin + (self.end - self.begin) * grown

    def share_rates(self, u: Column) -> tuple[Column, Column]:
        """First and second time derivative of the share, 1/s and 1/s², at fraction ``u`` of the phase's time."""
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
        """What lies between two fractions (M,) of the phase's time."""
        ends = self.share(first), self.share(last)
        change = {"speed-up": 1.0, "slow-down": -1.0, "ramp": self.change}.get(self.shape)
        if change is None:
            return Phase(self.duration * (last - first), *ends, self.shape)
        mean = 1.0 + change * (first + last - 1.0)  # speed in the part, as a share of that in the phase
        change = np.where(mean > 0, change * (last - first) / np.where(mean > 0, mean, 1.0), 0.0)
        return Phase(self.duration * (last - first), *ends, "ramp", change)


class Law(Protocol):
    """How one kind of motion goes from its start state to its end state.

    These may be left out, and have defaults:

    extra       names of the states that the law needs beside the model's own; (). Where its duration is one, that is
                the difference of ``clock``, s, from any zero
    reversible  whether the motion from b to a goes through the states of the one from a to b; False
    quadrature  "adaptive" for integrals by :mod:`hpop.motions.quadrature`; None for panels
    """

    @property
    def kind(self) -> str:
        """Name of the law: "move", "turn"."""

    @property
    def varies(self) -> frozenset[str]:
        """Names of the states that change within a motion; all others keep their start value."""

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Timing, in order; the durations add up to the motion's."""

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """State ``name`` where ``share`` of the motion is done."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def extra(self) -> tuple[str, ...]: ...

        @property
        def reversible(self) -> bool: ...

        @property
        def quadrature(self) -> str | None: ...


class LawDefaults:
    """What a law has of the contract without saying so."""

    extra: ClassVar[tuple[str, ...]] = ()
    reversible: ClassVar[bool] = False
    quadrature: ClassVar[str | None] = None


@runtime_checkable
class Coupled(Law, Protocol):
    """A law whose states depend on each other, so that its motions do not lead to any end that is given."""

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """First and second derivative of state ``name`` by the share."""

    def strays(self, start: States, end: States) -> Column:
        """How far (M,), m or rad, the end is from where the law leads from the start."""


@runtime_checkable
class Curve(Coupled, Protocol):
    """A law of curves: what it varies is not in proportion to the share done, and its yaw rate may change its sign.

    All others are taken to change their states evenly with the share, and each of their motions for one whole turn.
    """

    @property
    def extra(self) -> tuple[str, ...]:
        """Names of the states that it needs beside the model's own."""

    @property
    def even(self) -> frozenset[str]:
        """Names of the states whose second derivative by time stays the same within a motion."""

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Signed rotation (M,), rad, before and after the yaw rate changes its sign, which it does once at most."""


@checked_arguments
def is_curve(law: Law) -> TypeGuard[Curve]:
    """Whether a law is one of curves."""
    return _is(law, Curve)


@checked_arguments
def is_coupled(law: Law) -> TypeGuard[Coupled]:
    """Whether the states of a law depend on each other."""
    return _is(law, Coupled)


def _is(law: Law, protocol: type) -> bool:
    """Whether a law follows a protocol; each class is looked at once, which takes as long as a short trajectory."""
    found = _FOUND.get((type(law), protocol))
    if found is None:
        found = _FOUND[type(law), protocol] = isinstance(law, protocol)
    return found


_FOUND: dict[tuple[type, type], bool] = {}


@checked_arguments
def slopes(law: Law, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
    """First and second derivative of a state by the share of the motion done."""
    if is_coupled(law):
        return law.slopes(name, start, end, share)
    return getattr(end, name) - getattr(start, name), 0.0


@checked_arguments
def onward(law: Law, space: StateSpace, start: States, end: States) -> States:
    """States ``end`` (M,) as a law leads there: what comes round the shorter way, half a turn counter-clockwise.

    What a coupled law makes of the other states follows them: a head turns back half a turn clockwise.
    """
    turning = law.varies & space.turning
    end = space.onward(start, end) if turning else end
    if not is_coupled(law):
        return end
    return States(**end.__dict__ | {name: law.interpolate(name, start, end, np.float64(1.0)) for name in turning})


class Leg(NamedTuple):
    """One motion of each of M chains that lead from states to others.

    kind     of its law
    end      states (M,) where it ends
    present  (M,)  whether it is a motion; where not, its end is where the chain was before it
    """

    kind: str
    end: States
    present: BoolArray


@runtime_checkable
class Model(Protocol):
    """A system: what moves, by which laws, and where its camera is.

    These may be left out, and have defaults:

    name           in the registry; the name of the class
    field_of_view  (horizontal, vertical) rad, what the camera sees at once; None for all round
                   (:mod:`hpop.models.camera`)
    bodies         method of the states (N,): what of the robot can stand in the way of its camera, and is drawn, as
                   pairs of a shape of :mod:`hpop.world.geometry.solids` and its poses (N, 4, 4); ()
    parts          what collides, in a form of the model's own; ()
    platform       upright prisms, :class:`hpop.models.base.Part`, that x, y and yaw place and in which the robot stays
                   whatever its other states are; the parts of a model that provides "plane", () of others
    mounts         where bodies are that the base carries, by name, as :class:`hpop.models.base.Mount`; {}
    joints         names of the states that are joints; ()
    executed       the law by which motions of a planned law are done, by kind; {}
    notes          what was assumed of the robot, in words, which fronts repeat; ()
    """

    @property
    def provides(self) -> frozenset[str]:
        """What criteria and planners can ask for.

        "base", "camera"  bodies
        "tool"            a body as well: what the robot works with
        "joints"          angles or lengths that motors set; ``joints`` names these states, without those of the base
        "heading"         the base looks where it goes
        "wheels"          two driven wheels or tracks at either side of an axis, as :class:`Wheeled` says
        "plane"           x, y and yaw are among the states, and the robot is made of upright ``parts``, so that its
                          collisions are a :class:`PlaneCollision`
        "turn-move"       the laws "turn" and "move" of :mod:`hpop.models.laws`
        "rigid"           no states but x, y and yaw
        "spline"          the law "spline", cubics from knot to knot, and a :class:`JointCollision`
        """

    @property
    def space(self) -> StateSpace:
        """Its states: columns in order."""

    @property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by kind."""

    def pose(self, body: str, states: States) -> Pose:
        """Pose of a body in each of the states."""

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """How fast a body moves and turns, given the first derivatives of the states by time."""

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """The time derivative of :meth:`twist`, given the second derivatives as well."""

    def body(self, name: str, motions: Motions) -> Body:
        """What a body does in each of the motions: :func:`hpop.motions.bodies.integrated`, or a closed form."""

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """How far (M,), m and rad, no body moves or turns farther: it chooses the panels of quadratures."""

    def connect(self, a: States, b: States) -> list[Leg]:
        """The motions, one after another, that lead from states a (M,) to b; what is NaN in b is left as it comes."""

    def collision(self, world: World) -> Collision:
        """What planning asks which states and motions are free: never too kind."""

    def judge(self, world: World) -> Collision:
        """What a result is verified by: shares no geometry with :meth:`collision`."""

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """What the robot really does of a trajectory, and when (n+1,), s, it passes each planned state."""

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """What the robot cannot do of a trajectory, in words: "does not go ahead in motion 3, a move"."""

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Which motions (M,) of one law :meth:`faults` may find a fault in, told of thousands at once."""

    def describe(self) -> dict[str, Any]:
        """JSON-able name and parameters, enough to build the same model: ``{name: {parameter: value}}``."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def name(self) -> str:
            return type(self).__name__

        @property
        def field_of_view(self) -> tuple[float, float] | None:
            return None

        def bodies(self, states: States) -> Sequence[tuple[Any, FloatArray]]:
            return ()

        @property
        def parts(self) -> tuple[Any, ...]:
            return ()

        @property
        def platform(self) -> tuple[Any, ...]:
            return ()

        @property
        def mounts(self) -> Mapping[str, Any]:
            return {}

        @property
        def joints(self) -> tuple[str, ...]:
            return ()

        @property
        def executed(self) -> Mapping[str, str]:
            return {}

        @property
        def notes(self) -> tuple[str, ...]:
            return ()


class Wheeled(Model, Protocol):
    """A model that provides "wheels": two driven wheels or tracks, at either side of the axis of its base.

    Where it is "rigid" as well, curves are planned for it, by the law "drive" and within the limits of its base.
    """

    @property
    def wheel_base(self) -> float:
        """Distance between them, m."""

    @property
    def wheel_speed(self) -> float:
        """Largest speed of each, m/s."""

    @property
    def wheel_acceleration(self) -> float:
        """Largest acceleration of each, m/s²."""

    @property
    def speed(self) -> float:
        """Largest speed of a rigid base, m/s."""

    @property
    def acceleration(self) -> float:
        """Largest acceleration of a rigid base, m/s²."""

    @property
    def turn_rate(self) -> float:
        """Largest yaw rate of a rigid base, rad/s."""

    @property
    def turn_acceleration(self) -> float:
        """Largest angular acceleration of a rigid base, rad/s²."""


class _Name:
    """Default name: that of the class."""

    def __get__(self, instance: object, owner: type) -> str:
        return owner.__name__


class _Platform:
    """Default platform: the parts of a model in the plane."""

    def __get__(self, instance: Any, owner: type) -> tuple[Any, ...]:
        return tuple(instance.parts) if instance is not None and "plane" in instance.provides else ()


MODEL_DEFAULTS: dict[str, Any] = {
    "name": _Name(),
    "field_of_view": None,
    "bodies": lambda model, states: (),
    "parts": (),
    "platform": _Platform(),
    "mounts": {},
    "joints": (),
    "executed": {},
    "notes": (),
}
"""What a model has of the contract without saying so."""
