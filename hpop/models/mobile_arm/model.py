"""Mobile base that carries an arm with a camera in its hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.options import Angle
from hpop.base.registry import with_optional_members
from hpop.base.text import shown
from hpop.errors import ModelError, QueryError
from hpop.models.base import PlanarModel, model
from hpop.models.camera import FieldOfView
from hpop.models.collision.parts import Part as Prism
from hpop.models.collision.planar import PlanarCollision
from hpop.models.collision.solid import SolidCollision
from hpop.models.differential_drive import DifferentialDrive, OnBase
from hpop.models.execution import rest_to_rest_execution
from hpop.models.joints import legs_of_joints
from hpop.models.laws import cruise_speed
from hpop.models.mobile_arm.collision import (
    PLATFORM,
    BaseAndLinks,
    Links,
    LinksJudge,
    MobileCollision,
    carried_chain,
    carried_parts,
    touching_platform,
)
from hpop.models.rigid import (
    Mount,
    RigidPose,
    RigidTwist,
    RigidTwistRate,
    is_planar,
    motion_bounds,
    rigid_body,
    turned_body,
)
from hpop.models.serial_arm import SerialArm
from hpop.models.serial_arm.chain import ArmPart, Chain, Pair, frames, levers
from hpop.models.serial_arm.collision import SAMPLES
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import ArmBody, Reach
from hpop.models.serial_arm.laws import faults as joint_faults
from hpop.motions import (
    MODEL_DEFAULTS,
    Body,
    Law,
    Leg,
    Model,
    Motions,
    Pose,
    States,
    StateSpace,
    Twist,
    integrated,
    is_curve,
)
from hpop.motions.bodies import standing
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.geometry.solids import Shape

AXIS = Mount()  # of the base, on the floor
UNFOLDED = 1e-6  # rad or m: largest deviation of a joint of a folded arm
REACH = "reach"  # law of the arm
CARRIES = frozenset({"base", "plane", "rigid"})  # what a base provides that can carry an arm


@model("mobile_arm")
@dataclass(frozen=True)
class MobileArm(OnBase, Model):
    """Base in the plane that carries an arm; states x, y (m), yaw (rad) and the arm's joints.

    arm     its ``base`` is the position of its root on the mobile one: x ahead of the axis, y to the left, z above the
            floor; it has the camera, and its ``field_of_view``
    base    a model in the plane without joints; the camera and the mast of a differential drive are left out
    folded  the arm while the base drives: the name of one of its states, or its joints in order or by name

    The base stands while the arm moves ("reach"), and the arm is folded while the base moves. The base moves from rest
    to rest, by the laws by which it executes its plans. From one position to another, the arm is folded, the base
    drives (a differential drive turns, moves and turns), and the arm reaches out. At one position the arm reaches from
    posture to posture.
    """

    name: ClassVar[str]

    arm: SerialArm
    base: PlanarModel = field(default_factory=DifferentialDrive)
    folded: str | tuple[Angle, ...] | dict[str, Angle] = "home"

    def __post_init__(self) -> None:
        _check_parts(self.arm, self.base)
        try:
            values = self._rest.values()
        except QueryError as error:
            raise ModelError(str(error)) from None
        if not isinstance(self.folded, str):
            object.__setattr__(self, "folded", tuple(values))

    @cached_property
    def _rest(self) -> dict[str, float]:
        """Joints of the folded arm by name."""
        state = self.arm.space.state(self.folded, what="folded arm")
        return {name: float(getattr(state, name)[0]) for name in self.joints}

    # What it is made of

    @property
    def provides(self) -> frozenset[str]:
        """Bodies, joints, and the heading and wheels of the base; no lattice has its states."""
        return frozenset({"base", "camera", "tool", "joints"}) | (self.base.provides & {"heading", "wheels"})

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of the arm."""
        return self.arm.joints

    @property
    def field_of_view(self) -> FieldOfView | None:
        """Field of view of the camera in the hand."""
        return self.arm.field_of_view

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions about the robot, as text."""
        own = (
            f"the link {shown(next(link for link in pair if link != PLATFORM))} touches the base that carries the arm "
            f"in each of {SAMPLES:,} states drawn, so that collision is not looked at"
            for pair in sorted(self._touching)
        )
        return (*self.arm.notes, *own)

    @cached_property
    def space(self) -> StateSpace:
        """States of the base and the joints, as far apart as the base moves while they change."""
        plane, joints, chain = self.base.space, self.arm.space, self.arm.chain
        return StateSpace(
            (*plane.names, *joints.names),
            (*plane.units, *joints.units),
            (*plane.low, *joints.low),
            (*plane.high, *joints.high),
            (*plane.weights, *(cruise_speed(self.base) / chain.speed).tolist()),
            plane.turning | joints.turning,
            rest=self._rest,
        )

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Executed laws of the base except curves, and "reach" of the arm: each from rest to rest."""
        base = self.base
        kinds = [base.executed.get(kind, kind) for kind, law in base.laws.items() if not is_curve(law)]
        return {**{kind: base.laws[kind] for kind in kinds}, REACH: self.arm.laws[REACH]}

    @cached_property
    def chain(self) -> Chain:
        """The joints of the arm after two slides and a turn of the base."""
        return carried_chain(self.base.space, self.arm.chain)

    @property
    def platform(self) -> tuple[Prism, ...]:
        """Upright parts of the base: its body without a mast."""
        return self.base.body_parts

    @cached_property
    def parts(self) -> tuple[ArmPart, ...]:
        """Collision geometry: links of the arm, and the body of the base."""
        return carried_parts(self.arm.parts, self.platform)

    @cached_property
    def apart(self) -> frozenset[Pair]:
        """Pairs of links, the base included, without collision tests."""
        return self.arm.apart | self._touching

    @cached_property
    def _touching(self) -> frozenset[Pair]:
        return touching_platform(self.arm.chain, self.arm.parts, self.arm.apart, self.platform)

    # How it moves

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.chain)

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of the base, the camera or the tool in each of the states."""
        return RigidPose(AXIS, states) if body == "base" else self._kinematics.pose(body, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the twist of a body."""
        if body == "base":
            return RigidTwist(AXIS, states, rates)
        return self._kinematics.twist(body, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the derivative of the twist of a body."""
        if body == "base":
            return RigidTwistRate(AXIS, states, rates, changes)
        return self._kinematics.twist_rate(body, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return a body's motion in each motion, in closed form where the law of the base has one."""
        if isinstance(motions.law, Reach):
            return standing(name, motions) if name == "base" else ArmBody(name, self._kinematics, motions)
        if not is_planar(motions.law):
            return integrated(name, motions)
        return rigid_body(name, AXIS, motions) if name == "base" else self._carried(name, motions)

    def _carried(self, name: str, motions: Motions) -> Body:
        """Return the motion of a body in the hand while the base moves."""
        turns = "yaw" in motions.law.varies
        return replace(turned_body(name, motions), steady=not turns, upright=True)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return bounds (M,), m and rad, on how far any body moves and turns."""
        if isinstance(motions.law, Reach):
            return self.arm.extent(motions)
        return motion_bounds(motions, self._lever)

    @cached_property
    def _lever(self) -> float:
        """Bound on the distance of any body from the axis, m."""
        return float(levers(self.chain)[self.space.names.index("yaw")])

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the legs: the arm folds, the base drives, the arm reaches out; without a drive one reach.

        Joints that are NaN in b are left as they are, folded where the base has moved.
        """
        drives = np.any([leg.present for leg in self._drive(a, b)], axis=0)
        fold = self._reach(a, {name: np.where(drives, value, np.nan) for name, value in self._rest.items()})
        drive = self._drive(fold.end, b)
        return [fold, *drive, self._reach(drive[-1].end, b.__dict__)]

    def _drive(self, a: States, b: States) -> list[Leg]:
        """Return the legs of the base from states a (M,) to the positions and headings of b, as they are executed."""
        legs = legs_of_joints(self.space, self.base.connect(a, b), a, b, ())
        return [leg._replace(kind=self.base.executed.get(leg.kind, leg.kind)) for leg in legs]

    def _reach(self, a: States, joints: Mapping[str, Column]) -> Leg:
        """Return the leg from states a (M,) to values of the joints, where these are numbers."""
        (leg,) = self.arm.connect(a, States(**{name: joints[name] for name in self.joints}))
        return leg._replace(end=States(**a.__dict__ | leg.end.__dict__))

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the plan, which moves from rest to rest already; consecutive runs in one line become one."""
        return rest_to_rest_execution(trajectory, {kind: kind for kind in self.base.executed.values()})

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield what the base cannot do, joints beyond their limits, and drives with an unfolded arm."""
        yield from self.base.faults(trajectory)
        states, count = trajectory.states, max(1, len(trajectory))
        start, end = states.take(slice(0, count)), states.take(slice(-count, None))
        yield from joint_faults(self.arm.chain, self.arm.laws[REACH], start, end, np.arange(count))
        drives = [i for i, kind in enumerate(trajectory.kinds) if kind in self._drives]
        for i in np.array(drives, int)[self._is_unfolded(states.take(drives))][:1].tolist():
            yield f"drives with its arm unfolded in motion {i}, a {trajectory.kinds[i]}"

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return motions (M,) that are doubtful for the base, for the arm, or for both together."""
        found = self.base.doubtful(law, start, end) | self.arm.doubtful(self.arm.laws[REACH], start, end)
        return found | self._is_unfolded(start) if law.kind in self._drives else found

    @property
    def _drives(self) -> frozenset[str]:
        """Laws of the base."""
        return frozenset(self.laws) - {REACH}

    def _is_unfolded(self, states: States) -> BoolArray:
        """Return in which states (N,) the arm is not folded."""
        rest = States(**{name: np.full(states.size, value) for name, value in self._rest.items()})
        off = self.arm.space.differences(rest, states).values()
        return np.asarray(np.any([np.abs(column) > UNFOLDED for column in off], axis=0))

    # Where it collides

    def bodies(self, states: States) -> list[tuple[Shape, FloatArray]]:
        """Return the shapes of the parts and their poses (N, 4, 4), which may hide things from the camera."""
        placed = frames(self.chain, states)
        return [(part.solid.shape, placed[part.frame] @ part.solid.pose) for part in self.parts]

    def collision(self, world: World) -> MobileCollision:
        """Return the collision test: of the base in the plane, with certificates for the links."""
        links = Links(self.chain, self.parts, self.apart, world)
        return MobileCollision(PlanarCollision(self.platform, world), links, self.platform, world)

    def judge(self, world: World) -> BaseAndLinks:
        """Return the judge by python-fcl: the base every 5 cm or 3 degrees, the links every 1 mm."""
        links = LinksJudge(self.chain, self.parts, self.apart, world)
        return BaseAndLinks(SolidCollision(self.platform, world), links)

    def describe(self) -> dict[str, Any]:
        """Return JSON-able parameters, enough to build the same robot."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return {self.name: {name: v.describe() if isinstance(v, Model) else v for name, v in given.items()}}


def _check_parts(arm: Any, base: Any) -> None:
    if not isinstance(arm, SerialArm):
        raise ModelError(f"arm must be a serial arm, arm=SerialArm(...); got {shown(arm)}")
    if not isinstance(base, PlanarModel) or not base.provides >= CARRIES:
        raise ModelError(
            "an arm is carried by a base in the plane that has no joints of its own, such as "
            f"base=DifferentialDrive(...); got {shown(base)}"
        )
    camera = with_optional_members(base, MODEL_DEFAULTS).mounts.get("camera")
    if (camera is not None and camera.view is not None) or base.field_of_view is not None:
        raise ModelError("the camera is the arm's: leave view out of its base, and give field_of_view to the arm")
    if taken := [name for name in arm.joints if name in base.space.names]:
        raise ModelError(
            f"the arm's joint {shown(taken[0])} has the name of a state of the base; rename it in the URDF"
        )
    if taken := [kind for kind in base.laws if kind == REACH]:
        raise ModelError(f"a law of the base is called {taken[0]!r}, which is the arm's law; rename it")
    if any(part.link == PLATFORM for part in arm.parts):
        raise ModelError(
            f"a link of the arm is called {PLATFORM!r}, which is the name of its base; rename it in the URDF"
        )
