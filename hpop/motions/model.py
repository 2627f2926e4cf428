"""Protocols of models and of their collisions, with defaults of optional members."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.registry import with_optional_members
from hpop.motions.laws import HOLD, Law, LawDefaults, Leg
from hpop.motions.states import Pose, States, StateSpace, Twist

if TYPE_CHECKING:
    from hpop.motions.batch import Motions
    from hpop.motions.bodies import Body
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World

COLLISION_DEFAULTS: dict[str, Any] = {
    "clearance": None,
    "least_clearance": None,
    "is_uncompiled": False,
    "posture_matters": False,
    "turn_part": 0.0,
    "differs": lambda collision, before, x, y, within: np.ones(x.shape, dtype=np.bool_),
}
"""Values of a collision's optional members."""


class Collision(Protocol):
    """Collision test of a robot in a world: with obstacles, keep-out zones, standing people and the map's border.

    These may be left out, and have defaults (:func:`collision_of`):

    clearance        method of states (N,): distance (N,), m, of the whole robot from all of these; None
    least_clearance  method of motions (M,) of uncoupled laws and a distance: the least clearance (M,), m, along each,
                     at most that distance; None to sample ``clearance`` instead
    is_uncompiled    whether kernels must be compiled at the first call; False
    posture_matters  whether collisions depend on more than x, y and yaw, in the plane; False
    turn_part        angle, rad: a turn in place by a multiple of it is free exactly where its parts by multiples are; 0
                     if this does not hold
    differs          in the plane, method of the collision in an earlier world, positions (P,) and a distance, m:
                     whether within it the robot's collisions may differ from the earlier ones (P,); all may
    """

    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), ends included."""

    def why_blocked(self, state: States) -> str:
        """Return what blocks one state (1,) and what helps, without the last full stop; "" when it is free."""


class WholeCollision(Collision, Protocol):
    """Collision test with all optional members."""

    @property
    def clearance(self) -> Callable[[States], FloatArray] | None: ...

    @property
    def least_clearance(self) -> Callable[[Motions, float], FloatArray] | None: ...

    @property
    def is_uncompiled(self) -> bool: ...

    @property
    def posture_matters(self) -> bool: ...


@checked_arguments
def collision_of(model: Model, world: World) -> WholeCollision:
    """Return the collision test of a model with all optional members."""
    return cast(WholeCollision, with_optional_members(model.collision(world), COLLISION_DEFAULTS))


@checked_arguments
def free_along(collision: Collision, motions: Motions) -> BoolArray:
    """Return whether the robot is free all along each motion (M,); a hold is tested at its state."""
    return collision.states_free(motions.start) if motions.stands else collision.motions_free(motions)


class PlaneCollision(Collision, Protocol):
    """Collision test in the plane, which knows regions that are free at every yaw."""

    @property
    def yaw_matters(self) -> bool:
        """True if a position that is not :meth:`clear` can still be free at some yaw."""

    @property
    def posture_matters(self) -> bool: ...

    @property
    def turn_part(self) -> float: ...

    def clear(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return whether each position (P,) is free at every yaw, and so is every turn there."""

    def differs(self, before: PlaneCollision, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return where (P,), within a distance, m, collisions may differ from those in an earlier world."""


class Separations(NamedTuple):
    """Distances of bodies near one another, and their gradients by the states.

    owner     (R,)    index of the queried state
    distance  (R,)    m
    gradient  (R, n)  by the columns of the model's space, m per unit
    """

    owner: IntArray
    distance: FloatArray
    gradient: FloatArray


class JointCollision(Collision, Protocol):
    """Collision test of a robot of joints, with distances that have gradients."""

    def separations(self, states: States, within: float) -> Separations:
        """Return the distances of all pairs of bodies nearer than ``within`` m in states (N,)."""


@runtime_checkable
class Model(Protocol):
    """Robot model: a robot's states, motion laws, bodies and collisions, and its camera.

    These may be left out, and have defaults:

    name           in the registry; the name of the class
    field_of_view  (horizontal, vertical) rad of the camera; None for all round (:mod:`hpop.models.camera`)
    bodies         method of the states (N,): bodies of the robot that can hide a target from its camera, and are drawn,
                   as pairs of a shape of :mod:`hpop.world.geometry.solids` and its poses (N, 4, 4); ()
    parts          collision geometry, in a form of the model's own; ()
    platform       upright prisms, :class:`hpop.models.base.Part`, placed by x, y and yaw, that contain the robot
                   whatever its other states are; the parts of a model that provides "plane", () of others
    mounts         positions of bodies on the base, by name, as :class:`hpop.models.base.Mount`; {}
    joints         names of the states that are joints; ()
    executed       law of execution by the kind of a planned law; {}
    notes          assumptions about the robot, in words, which fronts repeat; ()
    """

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities that criteria and planners require.

        "base", "camera"  bodies
        "tool"            a body as well: the robot's tool
        "joints"          angles or lengths that motors set; ``joints`` names these states, without those of the base
        "heading"         the base looks where it goes
        "wheels"          two driven wheels or tracks at either side of an axis, as by :class:`Wheeled`
        "plane"           x, y and yaw are among the states, and the robot consists of upright ``parts``, so that its
                          collisions are a :class:`PlaneCollision`
        "turn-move"       the laws "turn" and "move" of :mod:`hpop.models.laws`
        "rigid"           no states but x, y and yaw
        "spline"          the law "spline", cubics from knot to knot, and a :class:`JointCollision`
        """

    @property
    def space(self) -> StateSpace:
        """State space: columns in order."""

    @property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by kind."""

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of a body in each of the states."""

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the velocity and rotation of a body, given the first derivatives of the states by time."""

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the time derivative of :meth:`twist`, given the second derivatives as well."""

    def body(self, name: str, motions: Motions) -> Body:
        """Return a body's motion in each motion: :func:`hpop.motions.integrated`, or a closed form."""

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return bounds (M,), m and rad, on how far any body moves and turns; they choose quadrature panels."""

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motions, one after another, that lead from states a (M,) to b; NaN in b is a free value."""

    def collision(self, world: World) -> Collision:
        """Return the collision test of planning, which never calls a blocked motion free."""

    def judge(self, world: World) -> Collision:
        """Return the collision test of verification, which shares no geometry with :meth:`collision`."""

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the robot's real motion along a trajectory, and the times (n+1,), s, of the planned states."""

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield what the robot cannot do of a trajectory: "does not go ahead in motion 3, a move"."""

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return which motions (M,) of one law need a check by :meth:`faults`, for thousands at once."""

    def describe(self) -> dict[str, Any]:
        """Return JSON-able name and parameters, enough to build the same model: ``{name: {parameter: value}}``."""

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
    """Model that provides "wheels": two driven wheels or tracks, at either side of the axis of its base.

    If the model is "rigid" as well, curves are planned for it, by the law "drive" and within the limits of its base.
    """

    @property
    def wheel_base(self) -> float:
        """Distance between the wheels, m."""

    @property
    def wheel_speed(self) -> float:
        """Largest speed of each wheel, m/s."""

    @property
    def wheel_acceleration(self) -> float:
        """Largest acceleration of each wheel, m/s²."""

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
"""Values of a model's optional members."""


@checked_arguments
def laws_of(model: Model) -> Mapping[str, Law]:
    """Return the motion laws by kind: the model's own, and those of hpop."""
    return {
        **{kind: with_optional_members(law, vars(LawDefaults)) for kind, law in model.laws.items()},
        HOLD.kind: HOLD,
    }


@checked_arguments
def lacking(requires: Collection[str], model: Model, world: World) -> list[str]:
    """Return the requirements that neither the model nor the world provides, sorted."""
    return sorted(set(requires) - model.provides - world.contents)
