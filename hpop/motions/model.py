"""Protocols of robot models, with the defaults of optional members; those of collision tests are in `collision`."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.registry import with_optional_members
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.motions.laws import HOLD, Law, LawDefaults, Leg
from hpop.motions.states import Pose, States, StateSpace, Twist

if TYPE_CHECKING:
    from hpop.motions.batch import Motions
    from hpop.motions.bodies import Body, Collision
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World


@runtime_checkable
class Model(Protocol):
    """Robot model: a robot's states, motion laws, bodies, collision tests and camera.

    A class may leave out these members; each entry ends with the default:

    name           name in the registry; default: the name of the class
    field_of_view  (horizontal, vertical) angles of the camera, rad; default None, a view all round
                   (:mod:`hpop.models.rigid`)
    restrictor     narrows the field of view by the camera's speed and angular speed
                   (:class:`hpop.models.view.Restrictor`); default None
    carrier        the robot as it is built, without what software does to its view; default the model itself
    bodies         method: takes states (N,), returns the bodies that can hide a target from the camera and are drawn,
                   as pairs of a shape of :mod:`hpop.world.geometry.solids` and its poses (N, 4, 4); default ()
    parts          collision geometry, in any form that the model chooses; default ()
    platform       upright prisms (:class:`hpop.models.base.Part`) placed by x, y and yaw, which contain the robot
                   whatever its other states are; default: the parts if the model provides "plane", else ()
    mounts         positions of bodies on the base (:class:`hpop.models.base.Mount`), by name; default {}
    joints         names of the states that are joints; default ()
    executed       the kind of law by which the robot executes motions of each planned kind; default {}
    speed_classes  m/s, rising: speeds among which straight moves choose (:mod:`hpop.models.speeds`); default (), one
                   speed
    paces          speeds among which motions from rest to rest choose, from slow to fast, each as a mapping from kinds
                   of motion to the kinds of equal geometry that replace them; default (), one speed
    notes          sentences on assumptions about the robot, which are printed with every front; default ()
    notes_on       method: takes the trajectories of a front, returns such sentences about them; default ()
    with_scene     method: takes a world, returns the robot with the objects that a planning scene attaches to its links
                   (``world.link_rules``); default: the robot as it is
    links          names of links, to which rules of a planning scene (``world.link_rules``) apply; default: none
    link_pose      method: takes the name of a link and joint values by name, rad or m; returns the pose (4, 4) of the
                   link in the world, or None if the link moves and the values do not say where; default: None
    joinable       method: takes states a and b (M,), returns a mask (M,): whether ``connect`` leads from a to b itself,
                   not to a later state; default all True
    judge_by       method: takes the name of a collision library and a world, returns the collision test for
                   verification that uses it; default: ``judge`` for "fcl", others are refused
    """

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities of the robot; criteria and planners require some of these.

        "base", "camera"  the model has a body of this name
        "tool"            the model has a body "tool", at the end of its arm
        "seat"            the model has a body "seat", the seat of a passenger
        "joints"          some states are joint angles or lengths that motors set; ``joints`` names them
        "heading"         the base always drives in the direction of its heading
        "wheels"          two driven wheels or tracks, left and right of an axis; the model follows :class:`Wheeled`
        "plane"           x, y and yaw are among the states, and the robot consists of upright ``parts``, so that its
                          collision test is a :class:`PlaneCollision`
        "steering"        front wheels that steer; the model has the attributes and the laws of :class:`hpop.Ackermann`
        "turn-move"       the laws "turn" and "move" of :mod:`hpop.models.laws`
        "rigid"           the states are x, y and yaw only
        "time"            one of the states is the time; the model follows :class:`ModelInTime`
        "spline"          the law "spline" (cubic curves between knots), and a :class:`JointCollision`
        """

    @property
    def space(self) -> StateSpace:
        """State space: names, units and bounds of the state columns, in order."""

    @property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by the name of their kind, such as "move" or "turn"."""

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of a body in each of the states."""

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the linear and angular velocity of a body; ``rates`` are the first time derivatives of the states."""

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the time derivative of :meth:`twist`; ``changes`` are the second time derivatives of the states."""

    def body(self, name: str, motions: Motions) -> Body:
        """Return how a body moves in each motion: its path length, rotation and poses at both ends.

        Compute them in closed form, or call :func:`hpop.motions.integrated`, which suits any model.
        """

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far any body moves and turns in each motion.

        Quadrature uses them to choose its step sizes.
        """

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motions that lead from each of M states to its partner: from the i-th state of a to the i-th of b.

        Each :class:`.Leg` is one step of all M sequences, in order. A NaN in b leaves that state variable free.
        Obstacles are not considered.
        """

    def collision(self, world: World) -> Collision:
        """Return the collision test for planning. It must never report a blocked motion as free."""

    def judge(self, world: World) -> Collision:
        """Return the collision test for verification, which must share no geometry code with :meth:`collision`."""

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the motion that the robot really makes for a planned trajectory of n motions.

        Also return the times (n+1,), s, at which it passes the planned states.
        """

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield each reason why the robot cannot execute a trajectory, as text: "goes sideways in motion 3, a move"."""

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of the motions that may have :meth:`faults`: a fast test for thousands of motions."""

    def describe(self) -> dict[str, Any]:
        """Return name and parameters for JSON, enough to build an equal model: ``{name: {parameter: value}}``."""

    if TYPE_CHECKING:  # the defaults are set by `completed`

        @property
        def name(self) -> str:
            return type(self).__name__

        @property
        def field_of_view(self) -> tuple[float, float] | None:
            return None

        @property
        def restrictor(self) -> Any:
            return None

        @property
        def carrier(self) -> Model:
            return self

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
        def speed_classes(self) -> tuple[float, ...]:
            return ()

        @property
        def paces(self) -> tuple[Mapping[str, str], ...]:
            return ()

        @property
        def notes(self) -> tuple[str, ...]:
            return ()

        def notes_on(self, trajectories: Sequence[Trajectory]) -> tuple[str, ...]:
            return ()

        def judge_by(self, library: str, world: World) -> Collision:
            return self.judge(world)

        def with_scene(self, world: World) -> Model:
            return self

        @property
        def links(self) -> frozenset[str]:
            return frozenset()

        def link_pose(self, link: str, joints: Mapping[str, float]) -> FloatArray | None:
            return None

        def joinable(self, a: States, b: States) -> BoolArray:
            return np.ones(a.size, dtype=np.bool_)


class Wheeled(Model, Protocol):
    """Model that provides "wheels": two driven wheels or tracks, left and right of the axis of its base.

    If the model also provides "rigid", planners may plan curves for it. They use the law "drive" and keep the speed and
    acceleration limits below.
    """

    @property
    def wheel_base(self) -> float:
        """Distance between the left and the right wheel, m."""

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


class ModelInTime(Model, Protocol):
    """Model that provides "time", for a robot beside something that moves as given; the last state is the time, s.

    Every trajectory begins at time 0 and ends at the largest time of the space. The first states are those of the
    timeless model, and the first bodies are its bodies. Further states before the time are 0 where the robot rests.
    If the wanted end is too soon, which ``joinable`` says, ``connect`` ends the motion later.
    """

    @property
    def timeless(self) -> Model:
        """Model of the robot alone, without the time; its state columns are the first columns of this model."""

    @property
    def step(self) -> float:
        """Longest time step, s. Planners divide the time into equal steps, at most this long, at which motions end."""

    @property
    def watched(self) -> str:
        """Name of the body that the camera should watch."""


class _Name:
    """Default name of a model: the name of its class."""

    def __get__(self, instance: object, owner: type) -> str:
        return owner.__name__


class _Platform:
    """Default platform of a model: its collision parts if it provides "plane", else ()."""

    def __get__(self, instance: Any, owner: type) -> tuple[Any, ...]:
        return tuple(instance.parts) if instance is not None and "plane" in instance.provides else ()


def _judge_by(model: Model, library: str, world: World) -> Collision:
    """Return the model's own judge, by default python-fcl; raise ModelError for another library."""
    if library != "fcl":
        raise ModelError(f"only arms are judged by {shown(library)}, but the model is a {model.name}; judge by fcl")
    return model.judge(world)


MODEL_DEFAULTS: dict[str, Any] = {
    "name": _Name(),
    "field_of_view": None,
    "restrictor": None,
    "carrier": property(lambda model: model),
    "bodies": lambda model, states: (),
    "parts": (),
    "platform": _Platform(),
    "mounts": {},
    "joints": (),
    "executed": {},
    "speed_classes": (),
    "paces": (),
    "notes": (),
    "notes_on": lambda model, trajectories: (),
    "judge_by": _judge_by,
    "with_scene": lambda model, world: model,
    "links": frozenset(),
    "link_pose": lambda model, link, joints: None,
    "joinable": lambda model, a, b: np.ones(a.size, dtype=np.bool_),
}
"""Values of a model's optional members."""


@checked_arguments
def laws_of(model: Model) -> Mapping[str, Law]:
    """Return all motion laws by kind: the laws of the model, and the hold that every robot has."""
    return {
        **{kind: with_optional_members(law, vars(LawDefaults)) for kind, law in model.laws.items()},
        HOLD.kind: HOLD,
    }


@checked_arguments
def lacking(requires: Collection[str], model: Model, world: World) -> list[str]:
    """Return the capabilities in ``requires`` that neither the model nor the world provides, sorted."""
    return sorted(set(requires) - model.provides - world.contents)
