"""Robot model "mobile_arm": a base in the plane that carries an arm with a camera at its end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.options import Angle
from hpop.base.text import shown
from hpop.errors import ModelError, QueryError
from hpop.models.base import PlanarModel, model
from hpop.models.collision import Part as Prism
from hpop.models.collision.planar import PlanarCollision
from hpop.models.differential_drive import DifferentialDrive, OnBase
from hpop.models.execution import rest_to_rest_execution
from hpop.models.joints import legs_of_joints
from hpop.models.laws import Run, cruise_speed
from hpop.models.mobile_collision import (
    PLATFORM,
    BaseAndLinks,
    KeepingLinks,
    KeepingLinksJudge,
    Links,
    LinksJudge,
    MobileCollision,
    carried_chain,
    carried_parts,
    check_kept,
    check_parts,
    touching_platform,
)
from hpop.models.ramps import doubtful_ramps, ramp_faults, ramps_of
from hpop.models.rigid import (
    FieldOfView,
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
from hpop.models.serial_arm.chain import ArmPart, Chain, Pair, levers, pairs_apart, placed_parts
from hpop.models.serial_arm.checks import check_touches
from hpop.models.serial_arm.collision import SAMPLES
from hpop.models.serial_arm.judge import LIBRARIES
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import ArmBody, Reach
from hpop.models.serial_arm.laws import faults as joint_faults
from hpop.motions import (
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
from hpop.motions.laws import CHANGE
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.geometry.solids import Shape
from hpop.world.readers.moveit_frames import placed_scene

AXIS = Mount()  # position of the body "base": on the axis, on the floor
UNFOLDED = 1e-6  # rad or m: by how much a joint of a folded arm may differ from its folded value
REACH = "reach"  # name of the arm's law


@model("mobile_arm")
@dataclass(frozen=True)
class MobileArm(OnBase, Model):
    """Base in the plane that carries an arm; states x, y (m), yaw (rad) and the arm's joints.

    arm     serial arm. Its ``base`` is the pose of its root link on the mobile base: x ahead of the axis, y to the
            left, z above the floor. The arm carries the camera, and its ``field_of_view`` applies
    base    model in the plane without joints, by default a differential drive; the camera and mast of a differential
            drive are left out
    folded  state of the arm while the base moves: the name of a state, or joint values in order or by name

    The base stands while the arm moves ("reach"), and the arm is folded while the base moves. The base moves from rest
    to rest, by its executed laws. To get from one position to another, the arm folds, the base drives (a differential
    drive turns, moves and turns), and the arm reaches out. At one position, the arm reaches from state to state.
    """

    name: ClassVar[str]

    arm: SerialArm
    base: PlanarModel = field(default_factory=DifferentialDrive)
    folded: str | tuple[Angle, ...] | dict[str, Angle] = "home"

    def __post_init__(self) -> None:
        check_parts(self.arm, self.base)
        try:
            values = self._rest.values()
        except QueryError as error:
            raise ModelError(str(error)) from None
        check_kept(self.arm.kept, self.arm.chain, self.arm.space.state(tuple(values)))
        if not isinstance(self.folded, str):
            object.__setattr__(self, "folded", tuple(values))

    @cached_property
    def _rest(self) -> dict[str, float]:
        """Joint values of the folded arm, rad or m, by name."""
        state = self.arm.space.state(self.folded, what="folded arm")
        return {name: float(getattr(state, name)[0]) for name in self.joints}

    def with_scene(self, world: World) -> MobileArm:
        """Return this robot with the objects that a planning scene attaches to the links of its arm.

        Raises ModelError as :meth:`hpop.SerialArm.with_scene` does; an object may also touch the base.
        """
        robot = self._with_attached(world)
        check_touches(robot.arm.attached, self.links, world)
        return robot

    @property
    def links(self) -> frozenset[str]:
        """Names of all links of the arm, and of the base."""
        return self.arm.links | {PLATFORM}

    def _with_attached(self, world: World) -> MobileArm:
        arm = self.arm.with_attached(world)
        return self if arm is self.arm else replace(self, arm=arm)

    # Structure

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: "base", "camera", "tool", "joints", and "heading" and "wheels" if the base has them.

        "plane" is not among them, so that no lattice is built for this robot.
        """
        return frozenset({"base", "camera", "tool", "joints"}) | (self.base.provides & {"heading", "wheels"})

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the arm's joints."""
        return self.arm.joints

    @property
    def field_of_view(self) -> FieldOfView | None:
        """Field of view of the arm's camera, (horizontal, vertical) rad, or None for all round."""
        return self.arm.field_of_view

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on assumptions about the robot, to be printed with every front."""
        own = (
            f"the link {shown(next(link for link in pair if link != PLATFORM))} touches the base that carries the arm "
            f"in each of {SAMPLES:,} random states, so this pair is not checked for collisions"
            for pair in sorted(self._touching)
        )
        return (*self.arm.notes, *own)

    @cached_property
    def space(self) -> StateSpace:
        """States of base and arm; in distances a joint counts as the distance that the base drives in its time."""
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
        """Motion laws: the executed laws of the base, except curves; reaches of the arm; and ramps of base and arm.

        For a base with several speeds, there is a run (straight move from rest to rest) for each speed. Only ramps may
        begin or end in motion (:mod:`hpop.models.ramps`).
        """
        base = self.base
        kinds = [base.executed.get(kind, kind) for kind, law in base.laws.items() if not is_curve(law)]
        laws = {kind: base.laws[kind] for kind in kinds if kind != CHANGE}
        for kind, speed in self._run_speeds.items():
            laws[kind] = Run(speed, base.laws[CHANGE].acceleration, kind)  # type: ignore[attr-defined]
        reaches = {kind: law for kind, law in self.arm.laws.items() if isinstance(law, Reach)}
        executed = {kind: law for kind, law in laws.items() if kind in base.executed.values()}
        return {**laws, **reaches, **ramps_of({**executed, REACH: reaches[REACH]})}

    @property
    def _run_speeds(self) -> dict[str, float]:
        """Speed, m/s, of each kind of run, from slow to fast, for a base with several speeds; else empty."""
        if not self.base.speed_classes:
            return {}
        *slower, fastest = self.base.speed_classes
        return {**{f"{self._run}_{speed:g}": speed for speed in slower}, self._run: fastest}

    @property
    def _run(self) -> str:
        """Kind of the law that executes moves of the base."""
        return self.base.executed.get("move", "move")

    @property
    def paces(self) -> tuple[Mapping[str, str], ...]:
        """Speeds for whole motions: each speed and turn rate of the base with each share of the arm's; () for one.

        Each is a mapping from kinds of motion to the kinds that replace them, from slow to fast.
        """
        runs, name = [{self._run: kind} for kind in self._run_speeds] or [{}], self.base.executed
        turns = [{name.get(a, a): name.get(b, b) for a, b in pace.items()} for pace in self.base.paces] or [{}]
        both = tuple({**run, **turn, **reach} for turn in turns for run in runs for reach in self.arm.paces or [{}])
        return both if len(both) > 1 else ()

    @cached_property
    def chain(self) -> Chain:
        """Chain of joints from the world to the tip: x, y and yaw of the base, then the joints of the arm."""
        return carried_chain(self.base.space, self.arm.chain)

    @property
    def platform(self) -> tuple[Prism, ...]:
        """Collision parts of the base, without the mast of its own camera."""
        return self.base.body_parts

    @cached_property
    def parts(self) -> tuple[ArmPart, ...]:
        """Collision geometry: solids of the arm's links and of the base."""
        return carried_parts(self.arm.parts, self.platform)

    @cached_property
    def apart(self) -> frozenset[Pair]:
        """Pairs of links that are not tested for collision with each other; the base counts as a link."""
        return self.arm.apart | self._touching

    def _in_world(self, world: World) -> tuple[Chain, tuple[ArmPart, ...], frozenset[Pair], World]:
        """Return the arguments of a collision test: chain, parts, pairs of links that are not tested, and ``world``.

        Objects that the world attaches to links are among the parts. Its rules for links change the pairs. Objects that
        a planning scene gives in the frame of a link are placed in the world.
        """
        world, own = placed_scene(world, self), self._with_attached(world)
        touching = own.arm.touching | own._touching
        return own.chain, own.parts, pairs_apart(own.parts, own.apart, touching, world.link_rules), world

    @cached_property
    def _touching(self) -> frozenset[Pair]:
        return touching_platform(self.arm.chain, self.arm.parts, self.arm.apart, self.platform)

    # Motion

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.chain)

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of the base, the camera or the tool in each of the states."""
        return RigidPose(AXIS, states) if body == "base" else self._kinematics.pose(body, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the velocity and angular velocity of the base, the camera or the tool."""
        if body == "base":
            return RigidTwist(AXIS, states, rates)
        return self._kinematics.twist(body, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the acceleration and angular acceleration of the base, the camera or the tool."""
        if body == "base":
            return RigidTwistRate(AXIS, states, rates, changes)
        return self._kinematics.twist_rate(body, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return how a body moves in each motion.

        It is integrated for camera and tool in a reach, and for a law of the base that has no closed form.
        """
        if isinstance(motions.law, Reach):
            return standing(name, motions) if name == "base" else ArmBody(name, self._kinematics, motions)
        if not is_planar(motions.law):
            return integrated(name, motions)
        return rigid_body(name, AXIS, motions) if name == "base" else self._carried(name, motions)

    def _carried(self, name: str, motions: Motions) -> Body:
        """Return how the camera or the tool moves while the base moves and the arm is at rest."""
        turns = "yaw" in motions.law.varies
        return replace(turned_body(name, motions), steady=not turns, upright=True)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far any body moves and turns in each motion."""
        if isinstance(motions.law, Reach):
            return self.arm.extent(motions)
        return motion_bounds(motions, self._lever)

    @cached_property
    def _lever(self) -> float:
        """Upper bound on the distance of camera and tool from the axis of the base, m."""
        return float(levers(self.chain)[self.space.names.index("yaw")])

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motions from states a to b: the arm folds, the base drives, the arm reaches out.

        If the base need not move, there is one reach only. A joint whose value in b is NaN keeps its value; it stays
        folded if the base has moved.
        """
        drives = np.any([leg.present for leg in self._drive(a, b)], axis=0)
        fold = self._reach(a, {name: np.where(drives, value, np.nan) for name, value in self._rest.items()})
        drive = self._drive(fold.end, b)
        return [fold, *drive, self._reach(drive[-1].end, b.__dict__)]

    def _drive(self, a: States, b: States) -> list[Leg]:
        """Return the base's motions, by its executed laws, from states a (M,) to the positions and headings of b."""
        legs = legs_of_joints(self.space, self.base.connect(a, b), a, b, ())
        return [leg._replace(kind=self.base.executed.get(leg.kind, leg.kind)) for leg in legs]

    def _reach(self, a: States, joints: Mapping[str, Column]) -> Leg:
        """Return the arm's motion from states a (M,) to joint values; a joint whose value is NaN does not move."""
        (leg,) = self.arm.connect(a, States(**{name: joints[name] for name in self.joints}))
        return leg._replace(end=States(**a.__dict__ | leg.end.__dict__))

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the execution of a plan: the plan, with consecutive runs at one speed in one straight line joined.

        The planned motions already go from rest to rest. Also return the times (n+1,), s, at which the robot passes the
        planned states.
        """
        kinds = (*self.base.executed.values(), *self._run_speeds)
        return rest_to_rest_execution(trajectory, {kind: kind for kind in kinds})

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for each fault: of the base, of joints or ramps beyond limits, of driving unfolded."""
        yield from self.base.faults(trajectory)
        yield from ramp_faults(trajectory)
        states, count = trajectory.states, max(1, len(trajectory))
        start, end = states.take(slice(0, count)), states.take(slice(-count, None))
        yield from joint_faults(self.arm.chain, self.arm.laws[REACH], start, end, np.arange(count))
        drives = [i for i, kind in enumerate(trajectory.kinds) if kind in self._drives]
        for i in np.array(drives, int)[self._is_unfolded(states.take(drives))][:1].tolist():
            yield f"drives with its arm unfolded in motion {i}, a {trajectory.kinds[i]}"

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of motions with a possible fault of base, arm or speed, or of driving unfolded."""
        found = (
            doubtful_ramps(law, start, end)
            | self.base.doubtful(law, start, end)
            | self.arm.doubtful(self.arm.laws[REACH], start, end)
        )
        return found | self._is_unfolded(start) if law.kind in self._drives else found

    @property
    def _drives(self) -> frozenset[str]:
        """Kinds of motion in which the base moves: the names of all laws but those of reaches."""
        return frozenset(kind for kind, law in self.laws.items() if not isinstance(law, Reach))

    def _is_unfolded(self, states: States) -> BoolArray:
        """Return a mask (N,) of the states in which the arm is not folded."""
        rest = States(**{name: np.full(states.size, value) for name, value in self._rest.items()})
        off = self.arm.space.differences(rest, states).values()
        return np.asarray(np.any([np.abs(column) > UNFOLDED for column in off], axis=0))

    # Collision tests

    def bodies(self, states: States) -> list[tuple[Shape, FloatArray]]:
        """Return the shapes of the collision solids and their poses (N, 4, 4); they can hide things from the camera."""
        return placed_parts(self.chain, self.parts, states)

    def collision(self, world: World) -> MobileCollision:
        """Return the collision test for planning: of the base in the plane, with proofs for the links."""
        given, kept = self._in_world(world), self.arm.kept
        links = Links(*given) if kept is None else KeepingLinks(*given, kept, self)
        return MobileCollision(PlanarCollision(self.platform, world), links, self.platform, world)

    def judge(self, world: World) -> BaseAndLinks:
        """Return the collision test for verification, by python-fcl.

        States are sampled every 5 cm or 3 degrees for the base, and every 1 mm for the links.
        """
        return self.judge_by(LIBRARIES[0], world)

    def judge_by(self, library: str, world: World) -> BaseAndLinks:
        """Return :meth:`judge` with distances of the links by a library: "fcl" or "coal"."""
        from hpop.models.collision.solid import SolidCollision  # slow to import

        given, kept = self._in_world(world), self.arm.kept
        links = LinksJudge(*given) if kept is None else KeepingLinksJudge(*given, kept)
        return BaseAndLinks(SolidCollision(self.platform, world), replace(links, library=library))

    def describe(self) -> dict[str, Any]:
        """Return name and parameters for JSON, enough to build an equal robot; arm and base are described likewise."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return {self.name: {name: v.describe() if isinstance(v, Model) else v for name, v in given.items()}}
