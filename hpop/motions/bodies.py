"""Bodies of a robot: their movement over whole motions and at moments, and protocols of their collision tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import norm
from hpop.base.registry import with_optional_members
from hpop.base.table import Table
from hpop.base.text import shown
from hpop.errors import OptionError, UnsupportedCriterion, did_you_mean
from hpop.motions.laws import is_curve
from hpop.motions.model import Model
from hpop.motions.states import LazyStates, Pose, States, Twist, Vector

if TYPE_CHECKING:
    from hpop.goals.region import Region
    from hpop.motions.batch import Motions
    from hpop.world import World


JOINTS = "joints"  # capability; given as a body it stands for the values of the joints instead of poses
NO_BODIES = frozenset(
    {"heading", JOINTS, "plane", "rigid", "spline", "steering", "time", "turn-move", "wheels"}
)  # capabilities of models (`Model.provides`) that are not names of bodies
POSE = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "pitch": "rad", "roll": "rad"}
VELOCITY = ("vx", "vy", "vz")
ROTATION = ("wx", "wy", "wz")


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """Movement of one body of the robot, such as the camera, in each of M motions; criteria are written with it.

    start, end  poses of the body at both ends of each motion
    length      (M,)  m    length of the body's path
    turned      (M,)  rad  absolute rotation, about any axis
    rotation    (M,)  rad  signed rotation about the vertical, counter-clockwise positive
    turns       one or two columns (M,), rad: signed rotations of the turns that end in each motion, 0 for none. A turn
                is a rotation in one motion or, along curves, the longest stretch in which the heading changes with one
                sign
    stays       True if no motion of the batch moves the body's position
    steady      True if no motion of the batch rotates the body
    upright     True if no motion of the batch rotates it about an axis other than the vertical
    """

    start: Pose
    end: Pose
    length: Column
    turned: Column
    rotation: Column
    turns: tuple[Column, ...]
    stays: bool = False
    steady: bool = False
    upright: bool = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: from {self.start!r} to {self.end!r}>"


def standing(name: str, motions: Motions) -> Body:
    """Return the motion of a body during holds: its pose does not change, whatever the model is."""
    nothing = 0.0 * motions.duration
    start, end = (motions.model.pose(name, states) for states in (motions.start, motions.end))
    return Body(start, end, nothing, nothing, nothing, (nothing,), stays=True, steady=True, upright=True)


@checked_arguments
def integrated(name: str, motions: Motions) -> Body:
    """Return the motion of a body by integrating its velocity and angular velocity over each motion.

    This suits any model, but has the errors of quadrature. A model that knows closed forms should use those instead
    (:meth:`hpop.motions.Model.body`).
    """
    m = motions
    rotation = m.integrate(lambda s: s.twist(name).rotation[2])
    return Body(
        start=m.model.pose(name, m.start),
        end=m.model.pose(name, m.end),
        length=m.integrate(lambda s: norm(s.twist(name).velocity)),
        turned=m.integrate(lambda s: norm(s.twist(name).rotation)),
        rotation=rotation,
        turns=m.turns or m.law.bends(m.start, m.end) if is_curve(m.law) else (rotation,),
    )


@checked_arguments
class Instants:
    """Moments within motions, one per entry of each column: the argument ``s`` of a criterion's rate (cost per second).

    ``s.camera`` and ``s.base`` are poses. ``s.twist("camera")`` is the velocity and angular velocity of a body, and
    ``s.twist_rate("camera")`` the time derivative of both. ``s.speed``, ``s.turn_rate``, ``s.acceleration`` and
    ``s.turn_acceleration`` describe the base. ``s.state`` has the robot's states and ``s.t`` the time, s.

    Columns are computed when they are first read, and their names are recorded. If a rate reads only columns that are
    constant during a motion, it is constant too and is evaluated once.
    """

    def __init__(
        self,
        model: Model,
        names: tuple[str, ...],
        size: int,
        t: Column,
        column: Callable[[str], Column],
        derivatives: Callable[[str], tuple[Column, Column]],
    ) -> None:
        self._model = model
        self._t = t
        self.read = read = set[
            str
        ]()  # the functions below refer to this set and not to self: a cycle would keep the object in memory
        self.state = LazyStates(names, size, column, read)

        def first(name: str) -> Column:
            read.add(first_derivative(name))
            return derivatives(name)[0]

        def second(name: str) -> Column:
            read.add(second_derivative(name))
            return derivatives(name)[1]

        self.rates = LazyStates(names, size, first, set())
        self.changes = LazyStates(names, size, second, set())

    @property
    def model(self) -> Model:
        """Model of the robot."""
        return self._model

    @property
    def t(self) -> Column:
        """Time of each moment, s, from the start of the trajectory."""
        self.read.add("t")
        if self._t is None:
            raise UnsupportedCriterion(
                "the criterion depends on the time, but this planner plans without time; plan by 'exact', 'lattice', "
                "'roadmap' or 'any-angle', which plan with it"
            )
        return self._t

    @cached_property
    def base(self) -> Pose:
        """Pose of the base."""
        return self._model.pose("base", self.state)

    @cached_property
    def camera(self) -> Pose:
        """Pose of the camera."""
        return self._model.pose("camera", self.state)

    def pose(self, body: str) -> Pose:
        """Return the pose of a body of the model."""
        return self._model.pose(body, self.state)

    def twist(self, body: str) -> Twist:
        """Return velocity, m/s, and rotation, rad/s, of a body: three columns each, world frame."""
        return self._model.twist(body, self.state, self.rates)

    def twist_rate(self, body: str) -> Twist:
        """Return acceleration, m/s², and angular acceleration, rad/s², of a body: three columns each, world frame.

        Planned moves have no acceleration: they begin and end at cruise speed.
        """
        return self._model.twist_rate(body, self.state, self.rates, self.changes)

    @cached_property
    def speed(self) -> Column:
        """Speed of the base, m/s; for a base on wheels it is the speed along the heading, negative backwards."""
        velocity = self.twist("base").velocity
        return self._along_heading(velocity) if self._on_wheels else norm(velocity)

    @cached_property
    def turn_rate(self) -> Column:
        """Yaw rate of the base, rad/s."""
        return self.twist("base").rotation[2]

    @cached_property
    def acceleration(self) -> Column:
        """Rate at which the speed of the base changes, m/s²; 0 for planned moves, which keep their cruise speed."""
        acceleration = self.twist_rate("base").velocity
        if self._on_wheels:
            return self._along_heading(acceleration)
        along = sum(v * a for v, a in zip(self.twist("base").velocity, acceleration, strict=True))
        return np.where(self.speed > 0, along / np.where(self.speed > 0, self.speed, 1.0), 0.0)

    @cached_property
    def turn_acceleration(self) -> Column:
        """Angular acceleration of the base about the vertical, rad/s²."""
        return self.twist_rate("base").rotation[2]

    @property
    def _on_wheels(self) -> bool:
        return "wheels" in self._model.provides

    def _along_heading(self, vector: Vector) -> Column:
        yaw = self.base.yaw
        return vector[0] * np.cos(yaw) + vector[1] * np.sin(yaw)


def first_derivative(name: str) -> str:
    """Return the name under which :attr:`Instants.read` records the first time derivative of a state: "x'"."""
    return f"{name}'"


def second_derivative(name: str) -> str:
    """Return the name under which :attr:`Instants.read` records the second time derivative of a state: "x''"."""
    return f"{name}''"


Rate = Callable[[Instants], Column]


def body_table(
    model: Model, body: str | None, times: FloatArray, states: States, rates: States, changes: States
) -> Table:
    """Return a table (N,) of a body's motion: time, pose, velocity and angular velocity in the world frame.

    For body None, the table has the time, the robot's states and their first time derivatives (``rates``) instead; for
    "joints", the joints with their first and second time derivatives (``changes``). Raises OptionError for a body that
    the model does not have.
    """
    columns: list[tuple[str, str, Column]] = [("t", "s", times)]
    has_joints = JOINTS in model.provides
    if body is None or (body == JOINTS and has_joints):
        space = dict(zip(model.space.names, model.space.units, strict=True))
        space = space if body is None else {name: space[name] for name in model.joints}
        columns += [(name, unit, getattr(states, name)) for name, unit in space.items()]
        columns += [(f"{name}_rate", f"{unit}/s", getattr(rates, name)) for name, unit in space.items()]
        for name, unit in space.items() if body is not None else ():
            columns.append((f"{name}_acceleration", f"{unit}/s²", getattr(changes, name)))
    else:
        check_body(model, body, or_else=f"{', joints' if has_joints else ''}, or None for its states")
        pose, twist = model.pose(body, states), model.twist(body, states, rates)
        columns += [(name, unit, getattr(pose, name)) for name, unit in POSE.items()]
        columns += [(name, "m/s", column) for name, column in zip(VELOCITY, twist.velocity, strict=True)]
        columns += [(name, "rad/s", column) for name, column in zip(ROTATION, twist.rotation, strict=True)]
    names = [name for name, _, _ in columns]
    if len(set(names)) < len(names):
        raise OptionError(
            f"a table needs different names of columns, but the states of this robot give {', '.join(names)}; name a "
            "body of the robot instead of None"
        )
    values = {name: np.array(np.broadcast_to(column, times.shape), float) for name, _, column in columns}
    return Table(values, {name: unit for name, unit, _ in columns})


def check_body(model: Model, body: str, *, or_else: str = "") -> None:
    """Raise OptionError for a body that the model does not have."""
    known = sorted(model.provides - NO_BODIES)
    if body not in known:
        near = did_you_mean(body, [*known, JOINTS] if JOINTS in or_else else known)
        raise OptionError(
            f"this robot has no body {shown(body)}.{near} body must be one of {', '.join(known)}{or_else}"
        )


COLLISION_DEFAULTS: dict[str, Any] = {
    "clearance": None,
    "least_clearance": None,
    "is_uncompiled": False,
    "posture_matters": False,
    "turn_part": 0.0,
    "projected": None,
    "kept": None,
    "constraint": "",
    "differs": lambda collision, before, x, y, within: np.ones(x.shape, dtype=np.bool_),
}
"""Values of a collision's optional members."""


class Collision(Protocol):
    """Collision test of a robot with obstacles, keep-out zones, standing people and the border of the map.

    A class may leave out these members; :func:`collision_of` then adds the default that ends each entry:

    clearance        method: takes states (N,), returns the distance (N,), m, from the robot to the nearest of these
                     things; default None
    least_clearance  method: takes motions (M,) of an uncoupled law and a distance, m; returns the smallest clearance
                     (M,), m, along each motion, at most that distance; default None, ``clearance`` is then sampled
    is_uncompiled    True if the first call must compile kernels; default False
    posture_matters  for robots in the plane: True if collisions depend on states other than x, y and yaw; default False
    turn_part        angle, rad. If a turn in place is cut at multiples of this angle, the turn is free exactly where
                     all its pieces are; default 0, if there is no such angle
    projected        method: takes states (N,), returns states moved so that they fulfil a constraint of the robot, as
                     far as possible; default None, no constraint
    kept             region (:class:`hpop.goals.Region`) in which a body stays in all states; default None
    constraint       what motions must keep besides being free, and how this is checked, for certificates; default ""
    differs          for robots in the plane, method: takes the collision test in an earlier world, positions (P,) and a
                     distance, m; returns a mask (P,): where collisions within it may have changed; default all True
    """

    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), ends included."""

    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""


class WholeCollision(Collision, Protocol):
    """Collision test in which all optional members of :class:`Collision` are present."""

    @property
    def clearance(self) -> Callable[[States], FloatArray] | None: ...

    @property
    def least_clearance(self) -> Callable[[Motions, float], FloatArray] | None: ...

    @property
    def is_uncompiled(self) -> bool: ...

    @property
    def projected(self) -> Callable[[States], States] | None: ...

    @property
    def kept(self) -> Region | None: ...

    @property
    def constraint(self) -> str: ...

    @property
    def posture_matters(self) -> bool: ...


@checked_arguments
def collision_of(model: Model, world: World) -> WholeCollision:
    """Return the collision test of a model in a world; optional members that it lacks get their defaults."""
    return cast(WholeCollision, with_optional_members(model.collision(world), COLLISION_DEFAULTS))


@checked_arguments
def free_along(collision: Collision, motions: Motions) -> BoolArray:
    """Return whether the robot is free all along each motion (M,); a hold, which does not move, is one state."""
    return collision.states_free(motions.start) if motions.stands else collision.motions_free(motions)


class PlaneCollision(Collision, Protocol):
    """Collision test of a robot in the plane, which can also test a position for all yaws at once."""

    @property
    def yaw_matters(self) -> bool:
        """True if a position that is not :meth:`clear` can still be free at some yaw."""

    @property
    def posture_matters(self) -> bool: ...

    @property
    def turn_part(self) -> float: ...

    def clear(self, x: FloatArray, y: FloatArray, beyond: float = 0.0) -> BoolArray:
        """Return a mask (P,): True where the robot collides at no yaw, and so in no turn in place.

        With ``beyond``, m, True also means this for all positions within that distance, and for all moves between them.
        """

    def differs(self, before: PlaneCollision, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return a mask (P,) of the positions near which collisions may have changed since an earlier world.

        before  collision test in the earlier world
        x, y    m, positions (P,)
        within  m, distance from each position within which changes count
        """


class Separations(NamedTuple):
    """Distances between pairs of bodies that are close to each other, with gradients with respect to the states.

    owner     (R,)    index of the state in which each of the R pairs is close
    distance  (R,)    m, between the two bodies
    gradient  (R, n)  derivatives of the distance by the n columns of the model's state space, m per unit
    """

    owner: IntArray
    distance: FloatArray
    gradient: FloatArray


class JointCollision(Collision, Protocol):
    """Collision test of a robot with joints, such as an arm: it also returns distances and their gradients."""

    def separations(self, states: States, within: float) -> Separations:
        """Return the distance and its gradient for each pair of bodies closer than ``within`` m, in states (N,)."""
