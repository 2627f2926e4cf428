"""A mobile base that carries an arm with a camera in its hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, cast

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import hypot, smooth_abs
from hpop.base.options import Angle
from hpop.base.text import shown
from hpop.errors import ModelError, QueryError
from hpop.models.base import model
from hpop.models.camera import FieldOfView
from hpop.models.collision.parts import Part as Prism
from hpop.models.collision.planar import PlanarCollision
from hpop.models.collision.solid import SolidCollision
from hpop.models.differential_drive import FIXED, DifferentialDrive, OnBase
from hpop.models.execution import rest_to_rest_execution
from hpop.models.laws import turn_move_turn
from hpop.models.mobile_arm.collision import (
    PLATFORM,
    Both,
    Links,
    LinksJudge,
    MobileCollision,
    carried_chain,
    carried_parts,
    touching_platform,
)
from hpop.models.rigid import Mount, PlanarLaw, RigidPose, RigidTwist, RigidTwistRate, farthest, rigid_body
from hpop.models.serial_arm import SerialArm
from hpop.models.serial_arm.chain import Chain, Pair, Part, frames, levers
from hpop.models.serial_arm.collision import SAMPLES
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import ArmBody, Reach
from hpop.models.serial_arm.laws import faults as joint_faults
from hpop.motions import Body, Law, Leg, Model, Motions, Pose, States, StateSpace, Twist
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.geometry.solids import Shape

AXIS = Mount()  # of the base, on the floor
UNFOLDED = 1e-6  # rad or m: an arm is folded if no joint is farther from where it is then
TURN, MOVE = "spin", "run"  # laws of the base: both from rest to rest, as it stops for each turn and each reach
DRIVES = (MOVE, TURN)


@model("mobile_arm")
@dataclass(frozen=True)
class MobileArm(OnBase, Model):
    """A base with two driven wheels that carries an arm; states x, y (m), yaw (rad) and the arm's joints.

    arm     its ``base`` is where its root stands on the mobile one: x ahead of the axis, y to the left, z above the
            floor; it has the camera, and its ``field_of_view``
    base    carries it; the camera and the mast that it has by itself are left out
    folded  the arm while the base drives: the name of one of its states, or its joints in order or by name

    The base stands while the arm moves ("reach"), and the arm is folded while the base moves and turns. What leads from
    one place to another: the arm is folded, the base turns, moves, turns, and the arm reaches out. At one place the arm
    reaches from posture to posture.
    """

    name: ClassVar[str]

    arm: SerialArm
    base: DifferentialDrive = field(default_factory=DifferentialDrive)
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
        """Bodies, joints, and what the base has: a heading and wheels. Its states are for no lattice."""
        return frozenset({"base", "camera", "tool", "joints", "heading", "wheels"})

    @property
    def joints(self) -> tuple[str, ...]:
        """The arm's."""
        return self.arm.joints

    @property
    def field_of_view(self) -> FieldOfView | None:
        """That of the camera in the hand."""
        return self.arm.field_of_view

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed of it, in words."""
        own = (
            f"the link {shown(next(link for link in pair if link != PLATFORM))} touches the base that carries the arm "
            f"in each of {SAMPLES:,} states drawn, so that collision is not looked at"
            for pair in sorted(self._touching)
        )
        return (*self.arm.notes, *own)

    @cached_property
    def space(self) -> StateSpace:
        """The base's states and the joints, apart by how far the base moves in the time in which they change."""
        plane, joints, chain = self.base.space, self.arm.space, self.arm.chain
        return StateSpace(
            (*plane.names, *joints.names),
            (*plane.units, *joints.units),
            (*plane.low, *joints.low),
            (*plane.high, *joints.high),
            (*plane.weights, *(self.base.speed / chain.speed).tolist()),
            plane.turning | joints.turning,
            rest=self._rest,
        )

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Runs and spins of the base, and "reach" of the arm: each from rest to rest, as it is executed."""
        return {**{kind: self.base.laws[kind] for kind in DRIVES}, "reach": self.arm.laws["reach"]}

    @cached_property
    def chain(self) -> Chain:
        """The joints of the arm after two slides and a turn of the base."""
        return carried_chain(self.base, self.arm.chain)

    @property
    def platform(self) -> tuple[Prism, ...]:
        """Upright parts of the base: its body without a mast."""
        return self.base.body_parts

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """What collides: links of the arm, and the body of the base."""
        return carried_parts(self.arm.parts, self.platform)

    @cached_property
    def apart(self) -> frozenset[Pair]:
        """Pairs of links, the base among them, whose collisions are not looked at."""
        return self.arm.apart | self._touching

    @cached_property
    def _touching(self) -> frozenset[Pair]:
        return touching_platform(self.arm.chain, self.arm.parts, self.arm.apart, self.platform)

    # How it moves

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.chain)

    def pose(self, body: str, states: States) -> Pose:
        """Pose of the base, the camera or the tool in each of the states."""
        return RigidPose(AXIS, states) if body == "base" else self._kinematics.pose(body, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """How fast it moves and turns."""
        if body == "base":
            return RigidTwist(AXIS, states, rates)
        return self._kinematics.twist(body, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """How fast that changes."""
        if body == "base":
            return RigidTwistRate(AXIS, states, rates, changes)
        return self._kinematics.twist_rate(body, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """What it does in each of the motions: in closed form while the base moves, for what it carries is rigid."""
        if isinstance(motions.law, Reach):
            return self._standing(motions) if name == "base" else ArmBody(name, self._kinematics, motions)
        return rigid_body(name, AXIS, motions) if name == "base" else self._carried(name, motions)

    def _standing(self, motions: Motions) -> Body:
        """The base while the arm moves."""
        nothing = 0.0 * motions.start.x
        start, end = (self.pose("base", states) for states in (motions.start, motions.end))
        return Body(start, end, nothing, nothing, nothing, (nothing,), stays=True, steady=True, upright=True)

    def _carried(self, name: str, motions: Motions) -> Body:
        """A body in the hand while the base moves: it goes round the axis at its own distance from that."""
        m, law = motions, cast(PlanarLaw, motions.law)
        start, rotation = self.pose(name, m.start), law.turned(m.start, m.end)
        turns = "yaw" in law.varies
        way = hypot(start.x - m.start.x, start.y - m.start.y) * smooth_abs(rotation) if turns else 0.0
        return Body(
            start,
            self.pose(name, m.end),
            length=law.travel(m.start, m.end, 0.0) + way,
            turned=smooth_abs(rotation),
            rotation=rotation,
            turns=(rotation,),
            steady=not turns,
            upright=True,
        )

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """How far (M,), m and rad, no body moves or turns farther."""
        if isinstance(motions.law, Reach):
            return self.arm.extent(motions)
        return farthest(motions, self._lever)

    @cached_property
    def _lever(self) -> float:
        """Distance from the axis, m, that no body is beyond."""
        return float(levers(self.chain)[self.space.names.index("yaw")])

    def connect(self, a: States, b: States) -> list[Leg]:
        """The arm is folded, the base turns, moves and turns, and the arm reaches out; at one place a reach alone.

        Joints that are NaN in b are left as they are, folded where the base has moved.
        """
        drives = np.any([leg.present for leg in self._drive(a, b)], axis=0)
        fold = self._reach(a, {name: np.where(drives, value, np.nan) for name, value in self._rest.items()})
        drive = self._drive(fold.end, b)
        return [fold, *drive, self._reach(drive[-1].end, b.__dict__)]

    def _drive(self, a: States, b: States) -> list[Leg]:
        """The legs of the base from states a (M,) to the places and headings of b."""
        return turn_move_turn(self.space, a, b, turn=TURN, move=MOVE)

    def _reach(self, a: States, joints: Mapping[str, Column]) -> Leg:
        """From states a (M,) to values of the joints, where they are numbers."""
        (leg,) = self.arm.connect(a, States(**{name: joints[name] for name in self.joints}))
        return leg._replace(end=States(**a.__dict__ | leg.end.__dict__))

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """What is planned, which goes from rest to rest; but runs in one line are one."""
        return rest_to_rest_execution(trajectory, {MOVE: MOVE})

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """What the base cannot do, joints beyond their limits, and an arm that is not folded while the base moves."""
        yield from self.base.faults(trajectory)
        states, count = trajectory.states, max(1, len(trajectory))
        start, end = states.take(slice(0, count)), states.take(slice(-count, None))
        yield from joint_faults(self.arm.chain, self.arm.laws["reach"], start, end, np.arange(count))
        drives = [i for i, kind in enumerate(trajectory.kinds) if kind in DRIVES]
        for i in np.array(drives, int)[self._unfolded(states.take(drives))][:1].tolist():
            yield f"drives with its arm unfolded in motion {i}, a {trajectory.kinds[i]}"

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Motions (M,) that are doubtful for the base or the arm, or for both together."""
        found = self.base.doubtful(law, start, end) | self.arm.doubtful(self.arm.laws["reach"], start, end)
        return found | self._unfolded(start) if law.kind in DRIVES else found

    def _unfolded(self, states: States) -> BoolArray:
        """In which states (N,) the arm is not folded."""
        rest = States(**{name: np.full(states.size, value) for name, value in self._rest.items()})
        off = self.arm.space.differences(rest, states).values()
        return np.asarray(np.any([np.abs(column) > UNFOLDED for column in off], axis=0))

    # Where it collides

    def bodies(self, states: States) -> list[tuple[Shape, FloatArray]]:
        """What may stand in the way of the camera: the shapes of the parts, and their poses (N, 4, 4)."""
        placed = frames(self.chain, states)
        return [(part.solid.shape, placed[part.frame] @ part.solid.pose) for part in self.parts]

    def collision(self, world: World) -> MobileCollision:
        """Of the base in the plane, and certificates for the links: never too kind."""
        links = Links(self.chain, self.parts, self.apart, world)
        return MobileCollision(PlanarCollision(self.platform, world), links, self.platform, world)

    def judge(self, world: World) -> Both:
        """By python-fcl: the base every 5 cm or 3 degrees, links between which states move no farther than 1 mm."""
        links = LinksJudge(self.chain, self.parts, self.apart, world)
        return Both(SolidCollision(self.platform, world), links)

    def describe(self) -> dict[str, Any]:
        """JSON-able parameters, enough to build the same robot."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return {self.name: {name: v.describe() if isinstance(v, Model) else v for name, v in given.items()}}


def _check_parts(arm: Any, base: Any) -> None:
    if not isinstance(arm, SerialArm):
        raise ModelError(f"what is carried is an arm, arm=SerialArm(...); got {shown(arm)}")
    if not isinstance(base, DifferentialDrive):
        raise ModelError(f"an arm is carried by a differential drive, base=DifferentialDrive(...); got {shown(base)}")
    if base.view != FIXED or base.field_of_view is not None:
        raise ModelError("the camera is the arm's: leave view out of its base, and give field_of_view to the arm")
    if taken := [name for name in arm.joints if name in base.space.names]:
        raise ModelError(
            f"the arm's joint {shown(taken[0])} is called as a state of its base is; rename it in the URDF"
        )
    if any(part.link == PLATFORM for part in arm.parts):
        raise ModelError(f"a link of the arm is called {PLATFORM!r}, as what carries it is; rename it in the URDF")
