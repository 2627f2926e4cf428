"""Robots in the plane, defined by their parts and motion laws, so that a model of your own is one short file."""

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
from hpop.models.collision.leaving import planar_collision
from hpop.models.collision.parts import Part
from hpop.models.collision.planar import PlanarCollision
from hpop.models.collision.solid import SolidCollision
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
from hpop.motions import MODEL_DEFAULTS, Body, Law, Leg, Model, Motions, Pose, States, StateSpace, Twist, integrated
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World

__all__ = ["Joint", "Mount", "Part", "PlanarModel", "model", "plane_space"]

T = TypeVar("T", bound=type)


@checked_arguments
def model(name: str) -> Callable[[T], T]:
    """Register a robot under a name: a frozen dataclass with its parameters as fields."""

    def declare(cls: T) -> T:
        if not is_dataclass(cls) or not callable(getattr(cls, "collision", None)):
            raise ModelError(
                f"model {name!r} must be a dataclass that follows hpop.motions.Model, such as a PlanarModel"
            )
        for noun in ("space", "laws", "parts", "mounts", "provides"):
            if isfunction(getattr(cls, noun, None)):
                raise ModelError(f"model {name!r} has {noun} as a method; write @property above it")
        setattr(cls, "name", name)  # noqa: B010  (a type variable has no attribute to assign)
        update_abstractmethods(cls)
        models.add(name, with_optional_members(cls, MODEL_DEFAULTS))
        return checked_arguments(cls)

    return declare


@checked_arguments
def plane_space(metres_a_radian: float, joints: Iterable[Joint] = (), speed: float = 1.0) -> StateSpace:
    """Return the state space of position and heading, followed by joints.

    metres_a_radian  distance that a change of heading by one radian counts as
    speed            m/s; a change of a joint counts as the distance that a base at this speed covers meanwhile
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
    """Robot that stands upright on a floor, with everything that follows from its parts and its laws.

    A model of your own is a frozen dataclass with its parameters as fields, and gives ``space``, ``laws``, ``parts``
    and ``mounts``; :func:`model` registers it under a name.
    """

    executed: ClassVar[Mapping[str, str]] = {"move": "run", "turn": "spin"}
    """Law of execution by planned law; motions of other laws are executed as planned."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name in the registry."""

    @property
    @abstractmethod
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by kind."""

    @property
    @abstractmethod
    def parts(self) -> tuple[Part, ...]:
        """Upright prisms in the frame of the base, which collide where they overlap obstacles at their height."""

    @property
    @abstractmethod
    def space(self) -> StateSpace:
        """States: x, y and yaw, which place the parts, among them; see :func:`plane_space`."""

    @property
    @abstractmethod
    def mounts(self) -> Mapping[str, Mount]:
        """Bodies by name, "base" and "camera" for example, and their positions on the base."""

    @property
    def platform(self) -> tuple[Part, ...]:
        """Parts placed by x, y and yaw; a part carried by joints is replaced by the volume that it sweeps."""
        return tuple(part.swept for part in self.parts)

    @property
    def body_parts(self) -> tuple[Part, ...]:
        """Parts that remain if another camera replaces the model's own: all, unless a model excludes a mast."""
        return self.parts

    @property
    def carrying(self) -> tuple[Joint, ...]:
        """Joints that carry parts or bodies of the robot, each once."""
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
        """Bodies, and "plane"; "turn-move", "rigid" and "joints" according to the laws and states."""
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
        """Return the velocity and rotation of a body."""
        mount = self._mount(body)
        return (CarriedTwist if mount.on else RigidTwist)(mount, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the derivative of the twist of a body."""
        mount = self._mount(body)
        return (CarriedTwistRate if mount.on else RigidTwistRate)(mount, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return a body's motion in each motion; in closed form if the law knows its path and rotation."""
        mount = self._mount(name)
        if mount.on:
            return carried_body(name, mount, motions)
        known = is_planar(motions.law)
        return rigid_body(name, mount, motions) if known else integrated(name, motions)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return bounds (M,), m and rad, on how far any body moves and turns; a lever lengthens the path of a body."""
        lever = max(mount.lever for mount in self.mounts.values())
        moved, turned = motion_bounds(motions, lever)
        joints = [joint for joint in self.carrying if joint.name in motions.law.varies]
        if not joints:
            return moved, turned
        farther, more = largest_change(joints, motions.start, motions.end, lever)
        return moved + farther, turned + more

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the legs from states a to b.

        A turn towards b, a straight move, a turn to b's heading, then joint by joint.
        """
        if not {"turn", "move"} <= self.laws.keys():
            raise ModelError(
                f"{self.name} has no laws turn and move, its laws are {', '.join(self.laws)}; give it connect(a, b), "
                "the legs by which it gets from states to others"
            )
        legs = turn_move_turn(self.space, a, b)
        return legs_of_joints(self.space, legs, a, b, self.joints) if self.joints else legs

    def stations(self, yaw: FloatArray) -> Stations:
        """Return the stations of a lattice.

        Each heading (H,), rad, with three values of each joint, and the motions in place.

        The values of a joint are both stops and 0, or the middle if 0 is not between the stops. Raises UnsupportedModel
        for a model with other states, which needs a method of its own.
        """
        joints = self.joints
        if other := [name for name in self.space.names if name not in ("x", "y", "yaw", *joints)]:
            raise UnsupportedModel(
                f"{self.name} has {', '.join(other)} among its states; for lattices give it stations(yaw), which says "
                "at which of them it may be at each heading, and how it changes them in place"
            )
        return grid_of_stations(yaw, {joint: stops_of(self.space, joint) for joint in joints})[0]

    def _mount(self, body: str) -> Mount:
        if body not in self.mounts:
            raise ModelError(f"{self.name} has the bodies {' and '.join(self.mounts)}, not {body!r}")
        return self.mounts[body]

    def collision(self, world: World) -> PlanarCollision:
        """Return the collision test of planning: exact for straight motions, conservative for those that turn."""
        return planar_collision(self.parts, world)

    def judge(self, world: World) -> SolidCollision:
        """Return the collision test of verification, by python-fcl, at states at most 5 cm or 3 degrees apart."""
        return SolidCollision(self.parts, world.for_robots)

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the robot's real motion, moves in one line joined, all from rest to rest, and times of states."""
        return rest_to_rest_execution(trajectory, self.executed)

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield joints beyond their stops; all other results of the laws are possible."""
        return stop_faults(self.space, self.joints, trajectory.states)

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return which motions (M,) have a joint beyond a stop."""
        return beyond_stops(self.space, self.joints, start) | beyond_stops(self.space, self.joints, end)

    def describe(self) -> dict[str, Any]:
        """Return JSON-able parameters, enough to build the same robot, including those of models within it.

        Parameters that are None by default are left out.
        """
        own: list[tuple[Any, Any]] = (
            [(field, getattr(self, field.name)) for field in fields(self)] if is_dataclass(self) else []
        )
        given = {field.name: value for field, value in own if not (value is None is field.default)}
        return {self.name: {name: v.describe() if isinstance(v, Model) else v for name, v in given.items()}}
