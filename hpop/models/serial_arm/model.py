"""Robot model "serial_arm": a chain of joints, read from a URDF, with a camera at its end."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, cast

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.options import MOST, Angle, BesideScenario, one_of, real
from hpop.base.registry import check_parameters, models
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.base import model
from hpop.models.files import is_record, record, without_paths
from hpop.models.rigid import FieldOfView, checked_field_of_view
from hpop.models.serial_arm.arm_file import ArmFile, read_arm
from hpop.models.serial_arm.chain import ArmPart, Chain, Pair, attached_objects, levers, pairs_apart, placed_parts
from hpop.models.serial_arm.checks import (
    SLOWEST,
    check_touches,
    checked_mapping,
    checked_numbers,
    checked_shares,
    path_text,
    pose_matrix,
)
from hpop.models.serial_arm.collision import SAMPLES, ArmCollision, always_touching
from hpop.models.serial_arm.judge import ArmJudge
from hpop.models.serial_arm.keep import KeepingCollision, KeepingJudge, KeptAxis
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import ArmBody, JointLaw, JointSpline, Reach, doubtful, faults
from hpop.models.serial_arm.meshes import WAYS, Way
from hpop.motions import Body, Law, Leg, Model, Motions, Pose, States, StateSpace, Twist, integrated
from hpop.trajectories.trajectory import Trajectory
from hpop.world.bodies import WIDEST
from hpop.world.readers.moveit_frames import placed_scene

if TYPE_CHECKING:
    from hpop.world import World
    from hpop.world.geometry.solids import Shape

NEAR = 1e-9  # m or rad: tolerance for equal states
REFERENCE = 1.0  # m/s: a second that a joint needs at its largest speed counts as 1 m in distances between states
Placed = tuple[float, float, float, Angle, Angle, Angle]
HERE: Placed = (0.0,) * 6


@model("serial_arm")
@dataclass(frozen=True, eq=False)
class SerialArm(Model):
    """Arm with a camera at its end; its states are the values of the joints from base to tip, rad or m.

    urdf           file that describes the arm; its root link is placed at ``base``
    tip            name of the last link; its frame is that of the body "tool"
    acceleration   rad/s² or m/s², largest acceleration of all joints, or of each by name (a URDF has only speeds)
    srdf           file with named states and with pairs of links that need no collision test, or None
    packages       folders of mesh files, by the name of the package in the URDF (package://name/...)
    camera         m and rad  (x, y, z, roll, pitch, yaw) of the camera in the frame of the tip; the camera looks along
                              its x axis, y is to its left and z up (REP-103)
    base           m and rad  (x, y, z, roll, pitch, yaw) of the root link in the world
    fixed          rad or m   values, by name, of joints that do not move; other joints outside the chain are at 0, or
                              at the limit nearest to 0
    field_of_view  rad        (horizontal, vertical) angles of view, or None for all round
    velocity_scaling          share of the speeds in the URDF that the arm uses, above 0 up to 1, or a list of rising
                              shares: a plan may then choose among them for each reach
    keep                      orientation kept in all states and motions: {"body": "tool", "axis": (0, 0, 1), "angle":
                              (0, 0.3)} keeps the tool's z axis within 0 to 0.3 rad of ``direction``, up by default
    padding        m          distance that all links, or each by name, keep from obstacles, beyond the usual 0.5 mm
    meshes         for meshes that are not convex: "hull" takes their convex hull, "decompose" cuts them into convex
                   pieces, "exact" refuses them
    attached       objects that the arm holds, each with its link, shape and pose in the link's frame; ``touches`` names
                   links and obstacles that it may touch

    The arm has two motion laws. In a "reach" it moves from rest to rest along a straight line in joint space: at each
    moment all joints have done equal shares of their changes. A "spline" is a cubic function of time between two knots.
    The distance between two states is 1 m/s times the Euclidean norm of the times, s, that the joints need at their
    largest speeds.
    """

    name: ClassVar[str]

    urdf: Annotated[Any, BesideScenario]
    tip: str
    acceleration: float | dict[str, float]
    srdf: Annotated[Any, BesideScenario] = None
    packages: dict[str, Annotated[Any, BesideScenario]] = field(default_factory=dict)
    camera: Placed = HERE
    base: Placed = HERE
    fixed: dict[str, float] = field(default_factory=dict)
    field_of_view: FieldOfView | None = None
    velocity_scaling: float | tuple[float, ...] = 1.0
    keep: dict[str, Any] | None = None
    padding: float | dict[str, float] = 0.0
    meshes: Way = "hull"
    attached: list[dict[str, Any]] = field(default_factory=list)
    _arm: ArmFile = field(init=False, repr=False)
    _records: dict[str, Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.tip, str):
            raise ModelError(f"tip must be the name of a link of the URDF, got {shown(self.tip)}")
        packages = checked_mapping("packages", self.packages, "folders")
        given = {"urdf": self.urdf, "srdf": self.srdf, **{f"package {name}": path for name, path in packages.items()}}
        paths = {name: path_text(name, value) for name, value in given.items() if value is not None or name != "srdf"}
        fixed = checked_numbers("fixed", self.fixed, -MOST, "values in rad or m")
        acceleration = self.acceleration
        if isinstance(acceleration, Mapping):
            acceleration = checked_numbers("acceleration", acceleration, SLOWEST, "values in rad/s² or m/s²")
        else:
            acceleration = real("acceleration", acceleration, SLOWEST, MOST, "rad/s² or m/s²", error=ModelError)
        if isinstance(self.padding, Mapping):
            padding: float | dict[str, float] = checked_numbers("padding", self.padding, 0.0, "lengths in m", WIDEST)
        else:
            padding = float(real("padding", self.padding, 0.0, WIDEST, "a length in m", error=ModelError))
        held = attached_objects(self.attached)
        arm = read_arm(
            paths["urdf"],
            paths.get("srdf"),
            packages={name: paths[f"package {name}"] for name in packages},
            tip=self.tip,
            camera=pose_matrix("camera", self.camera),
            base=pose_matrix("base", self.base),
            fixed=fixed,
            acceleration=acceleration,
            padding=padding,
            way=one_of("meshes", self.meshes, WAYS, error=ModelError),
            attached=held,
        )
        shares = checked_shares(self.velocity_scaling)
        arm = arm._replace(chain=replace(arm.chain, speed=shares[-1] * arm.chain.speed))
        records = {"urdf": record(paths["urdf"], *arm.hashes)}
        if arm.srdf_hash is not None:
            records["srdf"] = record(paths["srdf"], arm.srdf_hash)
        for name, found in records.items():
            if is_record(given[name]) and list(given[name]["sha256"]) != found["sha256"]:
                raise ModelError(
                    f"the {name.upper()} {shown(paths[name], 400)}, or a mesh that it names, has changed since the "
                    "front was saved: its SHA-256 differs. Restore the file, or plan again."
                )
        checked: dict[str, Any] = {
            **{name: found["path"] for name, found in records.items()},
            "acceleration": acceleration,
            "packages": {name: os.path.abspath(paths[f"package {name}"]) for name in packages},
            "camera": tuple(float(number) for number in self.camera),
            "base": tuple(float(number) for number in self.base),
            "fixed": fixed,
            "field_of_view": checked_field_of_view(self.field_of_view),
            "velocity_scaling": shares if len(shares) > 1 else shares[0],
            "keep": None if self.keep is None else KeptAxis.from_spec(self.keep).described(),
            "padding": padding,
            "attached": [each.spec for each in held],
            "_arm": arm,
            "_records": records,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_urdf(cls, path: str | os.PathLike[str], **parameters: Any) -> SerialArm:
        """Return the arm that a URDF describes.

        path        the URDF file
        parameters  the other parameters of the class by name; ``tip`` and ``acceleration`` are required

        Raises ModelError for missing, unknown or invalid parameters.
        """
        given = {"urdf": path, **parameters}
        check_parameters(models, cls.name, cls, given)
        return cls(**given)

    def holding(self, *attached: Mapping[str, Any]) -> SerialArm:
        """Return this arm with these objects in its hand, in place of any before; without objects, the empty hand.

        Plan with it from the moment on at which the arm has grasped the objects, in a world without them.
        """
        return replace(self, attached=list(attached))  # type: ignore[arg-type]  # checked there

    def with_scene(self, world: World) -> SerialArm:
        """Return this arm with the objects that a planning scene attaches to its links, besides those in its hand.

        Raises ModelError if ``touches`` of an object names something that is no link, attached object or obstacle.
        """
        arm = self.with_attached(world)
        check_touches(arm.attached, self.links, world)
        return arm

    def with_attached(self, world: World) -> SerialArm:
        """Return the arm that :meth:`with_scene` returns, without its check of ``touches``."""
        held = {each["name"] for each in self.attached}
        more = [each for each in world.link_rules.attached if each["name"] not in held]
        return self.holding(*self.attached, *more) if more else self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SerialArm) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @cached_property
    def _identity(self) -> str:
        return json.dumps(without_paths(self.describe()), sort_keys=True)

    # Structure

    @property
    def chain(self) -> Chain:
        """Chain of the joints that move, with the frames of tool and camera."""
        return self._arm.chain

    @property
    def parts(self) -> tuple[ArmPart, ...]:
        """Collision geometry: solids on the links."""
        return self._arm.parts

    @property
    def links(self) -> frozenset[str]:
        """Names of all links of the URDF."""
        return self._arm.links

    def link_pose(self, link: str, joints: Mapping[str, float]) -> FloatArray | None:
        """Return the pose (4, 4) of a link in the world; None if it moves and joint values do not say where it is."""
        pose = self._arm.link_pose(link, joints)
        return None if pose is None else pose_matrix("base", self.base) @ pose

    @property
    def apart(self) -> frozenset[Pair]:
        """Pairs of links that are not tested for collision with each other; names in alphabetical order."""
        return self._arm.apart | self.always_touching

    @property
    def touching(self) -> frozenset[Pair]:
        """Pairs of links that touch by design or in each of 10,000 random states."""
        return self._arm.touching | self.always_touching

    @cached_property
    def always_touching(self) -> frozenset[Pair]:
        """Pairs of links that touch in each of 10,000 random states, and so need no test; empty if there is an SRDF."""
        return frozenset() if self.srdf is not None else always_touching(self.chain, self.parts, self._arm.apart)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on assumptions about the arm, to be printed with every front."""
        notes = self._arm.notes + tuple(
            f"the links {shown(one)} and {shown(other)} touch in each of {SAMPLES:,} random states, so they are not "
            "tested for collision with each other; to decide which links may touch, give an SRDF file (srdf)"
            for one, other in sorted(self.always_touching)
        )
        return notes if self.kept is None else (*notes, f"in all states and motions, {self.kept}")

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: the bodies "camera" and "tool", "joints", and "spline"."""
        return frozenset({"camera", "tool", "joints", "spline"})

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints; the arm has no other states."""
        return self.chain.names

    @cached_property
    def space(self) -> StateSpace:
        """State space of the joints, with the named states of the SRDF."""
        chain = self.chain
        return StateSpace(
            chain.names,
            tuple("m" if sliding else "rad" for sliding in chain.sliding),
            tuple(chain.low.tolist()),
            tuple(chain.high.tolist()),
            tuple((REFERENCE / chain.speed).tolist()),
            frozenset(name for name, turns in zip(chain.names, chain.turning, strict=True) if turns),
            named=self._arm.states,
            unnamed=self._arm.unnamed,
        )

    @cached_property
    def laws(self) -> Mapping[str, JointLaw]:
        """Motion laws: "reach", straight in joint space from rest to rest, and "spline".

        With several shares of the speeds, there is a law of slower reaches for each share but the largest: "reach_0.5".
        """
        chain, *slower = self.chain, *self._shares[:-1]
        of_chain = (chain.names, tuple(chain.speed.tolist()), tuple(chain.acceleration.tolist()))
        laws: dict[str, JointLaw] = {"reach": Reach(*of_chain), "spline": JointSpline(*of_chain)}
        for share in slower:
            speeds, kind = chain.speed * (share / self._shares[-1]), f"reach_{share:g}"
            laws[kind] = Reach(chain.names, tuple(speeds.tolist()), of_chain[2], kind)
        return laws

    @property
    def _shares(self) -> tuple[float, ...]:
        given = self.velocity_scaling
        return given if isinstance(given, tuple) else (given,)

    @property
    def paces(self) -> tuple[Mapping[str, str], ...]:
        """Shares of the speeds, from slow to fast: for each, the law that replaces "reach"; () if there is only one.

        With shares 0.5 and 1 they are ({"reach": "reach_0.5"}, {"reach": "reach"}).
        """
        slower = tuple({"reach": f"reach_{share:g}"} for share in self._shares[:-1])
        return (*slower, {"reach": "reach"}) if slower else ()

    @cached_property
    def kept(self) -> KeptAxis | None:
        """Orientation that the arm keeps, or None."""
        return None if self.keep is None else KeptAxis.from_spec(self.keep)

    # Motion

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.chain)

    @cached_property
    def _levers(self) -> FloatArray:
        return levers(self.chain)

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of the camera or the tool in each of the states."""
        return self._kinematics.pose(body, states)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return the velocity and angular velocity of the camera or the tool."""
        return self._kinematics.twist(body, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the acceleration and angular acceleration of the camera or the tool."""
        return self._kinematics.twist_rate(body, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return how the camera or the tool moves in each motion, by integrating its velocities."""
        if not isinstance(motions.law, Reach):
            return integrated(name, motions)
        return ArmBody(name, self._kinematics, motions)

    def bodies(self, states: States) -> list[tuple[Shape, FloatArray]]:
        """Return the shapes of the collision parts and their poses (N, 4, 4); they can hide things from the camera."""
        return placed_parts(self.chain, self.parts, states)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far tool and camera move and turn in each motion.

        The first is the sum of the joints' changes, each times the largest distance of the bodies from this joint (1 if
        it slides). The second is the sum of the changes of the turning joints.
        """
        law, farthest, turned = cast(JointLaw, motions.law), np.float64(0.0), np.float64(0.0)
        for name, lever, sliding in zip(self.chain.names, self._levers, self.chain.sliding, strict=True):
            way = law.ways(name, motions.start, motions.end)
            farthest = farthest + float(lever) * way
            turned = turned if sliding else turned + way
        return farthest, turned + 0.0 * farthest

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return the motion from states a to b: one reach.

        A joint without limits turns the shorter way round, and a joint whose value in b is NaN does not move.
        """
        given = States(**{n: np.where(np.isnan(getattr(b, n)), getattr(a, n), getattr(b, n)) for n in self.space.names})
        end = self.space.onward(a, given)
        moved = np.any([np.abs(getattr(end, n) - getattr(a, n)) > NEAR for n in self.space.names], axis=0)
        return [Leg("reach", States(**{n: np.where(moved, getattr(end, n), getattr(a, n)) for n in end.names}), moved)]

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the plan itself and its times, because an arm executes its motions as planned."""
        return trajectory, trajectory.times

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for each limit of a joint (range, speed, acceleration) that motions of one kind exceed."""
        states = trajectory.states
        for kind in dict.fromkeys(trajectory.kinds):
            motions = np.flatnonzero([kind == other for other in trajectory.kinds])
            start, end = states.take(motions), states.take(motions + 1)
            yield from faults(self.chain, self._joint_law(kind), start, end, motions)
        if not len(trajectory):
            yield from faults(self.chain, self.laws["reach"], states, states, np.zeros(1, np.int64))

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of the motions in which a joint exceeds its range, speed or acceleration."""
        return doubtful(self.chain, self._joint_law(law.kind), start, end)

    def _joint_law(self, kind: str) -> JointLaw:
        """Return the law of a kind of motion; a hold counts as a reach of length 0, and gets the law of reaches."""
        return self.laws.get(kind, self.laws["reach"])

    # Collision tests

    def collision(self, world: World) -> ArmCollision:
        """Return the collision test for planning: on convex shapes, with proofs that whole motions are free."""
        given = self._in_world(world)
        return ArmCollision(*given) if self.kept is None else KeepingCollision(*given, self.kept, self)

    def judge(self, world: World) -> ArmJudge:
        """Return the collision test for verification: python-fcl at states between which no part moves over 1 mm."""
        given = self._in_world(world)
        return ArmJudge(*given) if self.kept is None else KeepingJudge(*given, self.kept)

    def judge_by(self, library: str, world: World) -> ArmJudge:
        """Return :meth:`judge` with distances by a library, "fcl" or "coal".

        If coal is not installed, the first test by it raises ModelError.
        """
        return replace(self.judge(world), library=library)

    def _in_world(self, world: World) -> tuple[Chain, tuple[ArmPart, ...], frozenset[Pair], World]:
        """Return the arguments of a collision test: chain, parts, pairs of links that are not tested, and ``world``.

        Objects that the world attaches to links are among the parts. Its rules for links change the pairs. Objects that
        a planning scene gives in the frame of a link are placed in the world.
        """
        world = placed_scene(world, self)
        arm = self.with_attached(world)
        return arm.chain, arm.parts, pairs_apart(arm.parts, arm.apart, arm.touching, world.link_rules), world

    def describe(self) -> dict[str, Any]:
        """Return name and parameters for JSON, enough to build an equal arm; files are given by path and SHA-256."""
        arm: dict[str, Any] = {**self._records, "tip": self.tip, "acceleration": self.acceleration}
        if self.packages:
            arm["packages"] = {name: record(folder) for name, folder in self.packages.items()}
        if self._shares != (1.0,):
            arm["velocity_scaling"] = list(self._shares) if self.paces else self.velocity_scaling
        for name in ("camera", "base", "fixed", "field_of_view", "keep", "padding", "meshes", "attached"):
            if (value := getattr(self, name)) and value not in (HERE, WAYS[0]):
                arm[name] = list(value) if isinstance(value, tuple) else value
        return {self.name: arm}
