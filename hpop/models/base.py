"""Base class and registration of robot models in the plane.

A model of your own gives its collision parts and motion laws. The rest follows from them, so it is one short file.
"""

from __future__ import annotations

import math
from abc import abstractmethod, update_abstractmethods
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from inspect import isfunction
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.options import FARTHEST
from hpop.base.registry import models, with_optional_members
from hpop.errors import ModelError, UnsupportedModel
from hpop.models.collision import Part
from hpop.models.collision.leaving import planar_collision
from hpop.models.collision.planar import PlanarCollision
from hpop.models.execution import rest_to_rest_execution
from hpop.models.joints import (
    Joint,
    Stations,
    beyond_stops,
    grid_of_stations,
    largest_change,
    legs_of_joints,
    stop_faults,
    stops_of,
)
from hpop.models.laws import Move, Turn, turn_move_turn
from hpop.models.rigid import (
    CarriedPose,
    CarriedTwist,
    CarriedTwistRate,
    Mount,
    RigidPose,
    RigidTwist,
    RigidTwistRate,
    carried_body,
    is_planar,
    motion_bounds,
    rigid_body,
)
from hpop.models.speeds import class_execution, doubtful_speeds, speed_faults
from hpop.motions import MODEL_DEFAULTS, Body, Law, Leg, Model, Motions, Pose, States, StateSpace, Twist, integrated
from hpop.motions.laws import follows
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.models.collision.solid import SolidCollision
    from hpop.world import World

__all__ = ["Joint", "Mount", "Part", "PlanarModel", "model", "plane_space"]

T = TypeVar("T", bound=type)


@checked_arguments
def model(name: str) -> Callable[[T], T]:
    """Register a robot model under a name: decorator of a frozen dataclass whose fields are the model's parameters."""

    def declare(cls: T) -> T:
        if not is_dataclass(cls) or not callable(getattr(cls, "collision", None)):
            raise ModelError(
                f"model {name!r} must be a dataclass that follows hpop.motions.Model: write @dataclass(frozen=True) "
                "below @model, and derive the class from PlanarModel or give it all methods of Model"
            )
        for noun in ("space", "laws", "parts", "mounts", "provides"):
            if isfunction(getattr(cls, noun, None)):
                raise ModelError(f"{noun} of model {name!r} must be a property, got a method; write @property above it")
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        update_abstractmethods(cls)
        models.add(name, with_optional_members(cls, MODEL_DEFAULTS))
        return checked_arguments(cls)

    return declare


@checked_arguments
def plane_space(metres_a_radian: float, joints: Iterable[Joint] = (), speed: float = 1.0) -> StateSpace:
    """Return the state space of a robot in the plane: x, y, yaw and its joints.

    metres_a_radian  m, weight of the heading in distances between states: one radian counts as this distance
    speed            m/s, of the base; a change of a joint counts as the distance that the base covers in its time
    """
    joints = tuple(joints)
    bounds = (FARTHEST, FARTHEST, math.pi)
    return StateSpace(
        ("x", "y", "yaw", *(joint.name for joint in joints)),
        ("m", "m", "rad", *(joint.unit for joint in joints)),
        (*(-bound for bound in bounds), *(joint.low for joint in joints)),
        (*bounds, *(joint.high for joint in joints)),
        (1.0, 1.0, metres_a_radian, *(speed / joint.speed for joint in joints)),
        frozenset({"yaw"}),
    )


@checked_arguments
class PlanarModel(Model):
    """Base class for models of robots that stand upright on a floor.

    A model of your own is a frozen dataclass whose fields are its parameters. It defines ``space``, ``laws``, ``parts``
    and ``mounts``; poses, collision tests and the rest follow from these. :func:`model` registers it under a name.
    """

    executed: ClassVar[Mapping[str, str]] = {"move": "run", "turn": "spin"}
    """The kind of law by which the robot executes motions of a planned kind; other kinds are executed as planned."""
    speed_classes: tuple[float, ...] = ()
    """Speeds, m/s, among which straight moves choose; with several, the laws are those of `hpop.models.speeds`."""
    reverses: bool = False
    """Whether the robot may drive backwards to get clear of people who touch it; planners plan no reverse otherwise."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name in the registry."""

    @property
    @abstractmethod
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by the name of their kind, such as "move" and "turn"."""

    @property
    @abstractmethod
    def parts(self) -> tuple[Part, ...]:
        """Collision geometry: upright prisms in the frame of the base, each tested with obstacles at its own height."""

    @property
    @abstractmethod
    def space(self) -> StateSpace:
        """State space; x, y and yaw must be among the states (:func:`plane_space` makes one)."""

    @property
    @abstractmethod
    def mounts(self) -> Mapping[str, Mount]:
        """Positions of the bodies on the base, by their names, such as "base" and "camera"."""

    @property
    def platform(self) -> tuple[Part, ...]:
        """Parts that contain the robot at any joint values: each part on joints is replaced by its swept volume."""
        return tuple(part.swept for part in self.parts)

    @property
    def body_parts(self) -> tuple[Part, ...]:
        """Parts that stay if another model, such as an arm, replaces the camera: all parts except the camera's mast.

        Here these are all parts; a model with a mast overrides it.
        """
        return self.parts

    @property
    def carrying(self) -> tuple[Joint, ...]:
        """Joints that carry parts or bodies of the robot; each joint is named once."""
        if len(self.space.names) == 3:
            return ()
        carried: list[Mount | Part] = [*self.mounts.values(), *self.parts]
        return tuple(dict.fromkeys(joint for one in carried for joint in one.on))

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the states that are joints."""
        return tuple(joint.name for joint in self.carrying)

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: the names of the bodies, and "plane".

        Added are "turn-move" if the laws "turn" and "move" are those of :mod:`hpop.models.laws`, "rigid" if there are
        no states but x, y and yaw, and "joints" if there are any (:attr:`hpop.motions.Model.provides`).
        """
        found = {"plane", *self.mounts}
        if isinstance(self.laws.get("turn"), Turn) and isinstance(self.laws.get("move"), Move):
            found.add("turn-move")
        if set(self.space.names) == {"x", "y", "yaw"}:
            found.add("rigid")
        if self.joints:
            found.add("joints")
        return frozenset(found)

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of a body in each of the states."""
        mount = self._mount(body)
        return (CarriedPose if mount.on else RigidPose)(mount, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the velocity, m/s, and angular velocity, rad/s, of a body (M,) in the frame of the world.

        ``rates`` are the time derivatives of the states.
        """
        mount = self._mount(body)
        return (CarriedTwist if mount.on else RigidTwist)(mount, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return acceleration and angular acceleration of a body.

        ``rates`` and ``changes`` are the first and second time derivatives of the states.
        """
        mount = self._mount(body)
        return (CarriedTwistRate if mount.on else RigidTwistRate)(mount, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return how a body moves in each motion; in closed form if the law has one, otherwise by quadrature."""
        mount = self._mount(name)
        if mount.on:
            return carried_body(name, mount, motions)
        known = is_planar(motions.law)
        return rigid_body(name, mount, motions) if known else integrated(name, motions)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far any body moves and turns in each motion.

        Bodies away from the axis of the base move farther when it turns.
        """
        lever = max(mount.lever for mount in self.mounts.values())
        moved, turned = motion_bounds(motions, lever)
        joints = [joint for joint in self.carrying if joint.name in motions.law.varies]
        if not joints:
            return moved, turned
        farther, more = largest_change(joints, motions.start, motions.end, lever)
        return moved + farther, turned + more

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motions from states a to states b.

        These are a turn towards b, a straight move, a turn to the heading of b, then the joints one after another.
        """
        if not {"turn", "move"} <= self.laws.keys():
            raise ModelError(
                f"the model {self.name} must have the laws turn and move, its laws are {', '.join(self.laws)}; add "
                "both, or override connect(a, b), which returns the motions from states a to states b"
            )
        legs = turn_move_turn(self.space, a, b)
        return legs_of_joints(self.space, legs, a, b, self.joints) if self.joints else legs

    def stations(self, yaw: FloatArray) -> Stations:
        """Return all states that a lattice uses at one position, and the motions in place between them.

        yaw  (H,)  headings, rad

        Each heading is combined with three values of each joint: both end stops and 0, or the midpoint of the stops if
        0 is not between them. Raises UnsupportedModel for a model with states other than x, y, yaw and joints; such a
        model needs its own method.
        """
        joints = self.joints
        if other := [name for name in self.space.names if name not in ("x", "y", "yaw", *joints)]:
            raise UnsupportedModel(
                f"a lattice knows values for x, y, yaw and joints only, but the model {self.name} also has the states "
                f"{', '.join(other)}; give it a method stations(yaw) that returns their values at each heading and the "
                "motions between them (hpop.models.joints.Stations)"
            )
        return grid_of_stations(yaw, {joint: stops_of(self.space, joint) for joint in joints})[0]

    def _mount(self, body: str) -> Mount:
        if body not in self.mounts:
            raise ModelError(f"the body of a {self.name} must be one of {', '.join(self.mounts)}, got {body!r}")
        return self.mounts[body]

    def collision(self, world: World) -> PlanarCollision:
        """Return the collision test for planning: exact for straight moves; turns may be blocked slightly too early."""
        return planar_collision(self.parts, world)

    def judge(self, world: World) -> SolidCollision:
        """Return the collision test for verification: python-fcl at states at most 5 cm or 3 degrees apart."""
        from hpop.models.collision.solid import SolidCollision  # slow to import

        return SolidCollision(self.parts, world.for_robots)

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the motion that the robot really makes for a planned trajectory of n motions.

        Consecutive moves in one straight line are joined to one run, from rest to rest; with several speeds, a run
        also contains the changes of speed on its way. Also return the times (n+1,), s, at which the executed motion
        passes the planned states.
        """
        if self.speed_classes:
            return class_execution(trajectory, self.executed)
        return rest_to_rest_execution(trajectory, self.executed)

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for each joint that goes beyond an end stop, and for each speed that the robot cannot have.

        The robot can do everything else its laws allow.
        """
        yield from stop_faults(self.space, self.joints, trajectory.states)
        yield from speed_faults(self.speed_classes, trajectory)

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of the motions that :meth:`faults` must check.

        These are motions that begin or end with a joint beyond an end stop, and all motions of a law with the state
        "speed".
        """
        beyond = beyond_stops(self.space, self.joints, start) | beyond_stops(self.space, self.joints, end)
        return beyond | doubtful_speeds(law, start, end)

    def describe(self) -> dict[str, Any]:
        """Return name and parameters for JSON, enough to build an equal robot; a base within it is described likewise.

        A parameter that is None, and is None by default, is left out.
        """
        own: list[tuple[Any, Any]] = (
            [(field, getattr(self, field.name)) for field in fields(self)] if is_dataclass(self) else []
        )
        given = {field.name: value for field, value in own if not (value is None is field.default)}
        return {self.name: {name: v.describe() if follows(v, Model) else v for name, v in given.items()}}
