"""Serial arm with a camera in its hand."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, cast

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import not_radians
from hpop.base.options import MOST, Angle, BesideScenario, real
from hpop.base.registry import check_parameters, models
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.base import model
from hpop.models.camera import FieldOfView, checked_field_of_view
from hpop.models.files import is_record, path_of, record, without_paths
from hpop.models.serial_arm.arm_file import ArmFile, read_arm
from hpop.models.serial_arm.chain import ArmPart, Chain, Pair, frames, levers
from hpop.models.serial_arm.collision import SAMPLES, ArmCollision, always_touching
from hpop.models.serial_arm.judge import ArmJudge
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import ArmBody, JointLaw, JointSpline, Reach, doubtful, faults
from hpop.models.serial_arm.xml import pose_of
from hpop.motions import Body, Law, Leg, Model, Motions, Pose, States, StateSpace, Twist, integrated
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.world import World
    from hpop.world.geometry.solids import Shape

NEAR = 1e-9  # m or rad: tolerance for equal states
REFERENCE = 1.0  # m/s: metres of distance between states per second that the joints need
FARTHEST = 1e4  # m: from the origin of the world to an arm's base
Placed = tuple[float, float, float, Angle, Angle, Angle]
HERE: Placed = (0.0,) * 6


@model("serial_arm")
@dataclass(frozen=True, eq=False)
class SerialArm(Model):
    """Arm with a camera in its hand; states are the angles, rad, and slides, m, of the joints from base to tip.

    urdf           the file that describes it; its root link stands at ``base``
    tip            name of the last link, with the frame of the body "tool"
    acceleration   rad/s² or m/s², the greatest, of all joints or by name: a URDF has only their speeds
    srdf           file with named states and pairs of links that never collide, or None
    packages       folders of meshes by the name of their package (package://name/...)
    camera         m and rad  (x, y, z, roll, pitch, yaw) of the camera in the tip's frame; it looks along its x, its
                              left is y, its up z (REP-103)
    base           m and rad  (x, y, z, roll, pitch, yaw) of the root link in the world
    fixed          rad or m   values of joints that stand, by name; others beside the chain stand at 0, or at the limit
                              nearest to it
    field_of_view  rad        (horizontal, vertical) angles of view, or None for all round

    It has two laws: "reach", from rest to rest, all joints having done equal shares of their paths at each moment, and
    "spline", cubics of time from knot to knot. The distance of two states is the root of the sum of squares of the
    seconds that the joints need at their greatest speeds, times 1 m/s.
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
    _arm: ArmFile = field(init=False, repr=False)
    _records: dict[str, Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.tip, str):
            raise ModelError(f"the tip is the name of a link, got {shown(self.tip)}")
        packages = _checked_mapping("packages", self.packages, "folders")
        given = {"urdf": self.urdf, "srdf": self.srdf, **{f"package {name}": path for name, path in packages.items()}}
        paths = {name: _path_text(name, value) for name, value in given.items() if value is not None or name != "srdf"}
        fixed = _checked_numbers("fixed", self.fixed, -MOST, "values, rad or m,")
        acceleration = self.acceleration
        if isinstance(acceleration, Mapping):
            acceleration = _checked_numbers("acceleration", acceleration, SLOWEST, "rad/s² or m/s²")
        else:
            acceleration = real("acceleration", acceleration, SLOWEST, MOST, "rad/s² or m/s²", error=ModelError)
        arm = read_arm(
            paths["urdf"],
            paths.get("srdf"),
            packages={name: paths[f"package {name}"] for name in packages},
            tip=self.tip,
            camera=_pose_matrix("camera", self.camera),
            base=_pose_matrix("base", self.base),
            fixed=fixed,
            acceleration=acceleration,
        )
        records = {"urdf": record(paths["urdf"], *arm.hashes)}
        if arm.srdf_hash is not None:
            records["srdf"] = record(paths["srdf"], arm.srdf_hash)
        for name, found in records.items():
            if is_record(given[name]) and list(given[name]["sha256"]) != found["sha256"]:
                raise ModelError(
                    f"the {name.upper()} {shown(paths[name], 400)}, or a mesh that it names, has changed since this "
                    "was saved: its SHA-256 differs. Restore the file, or plan again."
                )
        checked: dict[str, Any] = {
            **{name: found["path"] for name, found in records.items()},
            "acceleration": acceleration,
            "packages": {name: os.path.abspath(paths[f"package {name}"]) for name in packages},
            "camera": tuple(float(number) for number in self.camera),
            "base": tuple(float(number) for number in self.base),
            "fixed": fixed,
            "field_of_view": checked_field_of_view(self.field_of_view),
            "_arm": arm,
            "_records": records,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_urdf(cls, path: str | os.PathLike[str], **parameters: Any) -> SerialArm:
        """Return the arm of a URDF; parameters as of the class, by name, ``tip`` and ``acceleration`` at least.

        Raises ModelError for parameters that are missing or unknown, and as the class does.
        """
        given = {"urdf": path, **parameters}
        check_parameters(models, cls.name, cls, given)
        return cls(**given)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SerialArm) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @cached_property
    def _identity(self) -> str:
        return json.dumps(without_paths(self.describe()), sort_keys=True)

    # What it is made of

    @property
    def chain(self) -> Chain:
        """Chain of the joints that move, with the positions of bodies."""
        return self._arm.chain

    @property
    def parts(self) -> tuple[ArmPart, ...]:
        """Collision geometry."""
        return self._arm.parts

    @property
    def apart(self) -> frozenset[Pair]:
        """Pairs of links, each in alphabetical order, without collision tests."""
        return self._arm.apart | self.always_touching

    @cached_property
    def always_touching(self) -> frozenset[Pair]:
        """Pairs of ``apart`` that touch in each of 10,000 random states; empty if an SRDF lists pairs."""
        return frozenset() if self.srdf is not None else always_touching(self.chain, self.parts, self._arm.apart)

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions about the arm, in words."""
        return self._arm.notes + tuple(
            f"the links {shown(one)} and {shown(other)} touch in each of {SAMPLES:,} states drawn, so their collisions "
            "are not looked at; an SRDF says which links may touch"
            for one, other in sorted(self.always_touching)
        )

    @property
    def provides(self) -> frozenset[str]:
        """Bodies, joints, and the law of splines."""
        return frozenset({"camera", "tool", "joints", "spline"})

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, which are all states."""
        return self.chain.names

    @cached_property
    def space(self) -> StateSpace:
        """The joints, and the states that the SRDF names."""
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
        """Laws: from rest to rest, straight in the space of the joints; and splines there."""
        chain = self.chain
        of_chain = (chain.names, tuple(chain.speed.tolist()), tuple(chain.acceleration.tolist()))
        return {"reach": Reach(*of_chain), "spline": JointSpline(*of_chain)}

    # How it moves

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
        """Return the velocity and rotation of camera or tool."""
        return self._kinematics.twist(body, states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return the derivative of the twist of camera or tool."""
        return self._kinematics.twist_rate(body, states, rates, changes)

    def body(self, name: str, motions: Motions) -> Body:
        """Return the motion of camera or tool in each motion, by integrating twists."""
        if not isinstance(motions.law, Reach):
            return integrated(name, motions)
        return ArmBody(name, self._kinematics, motions)

    def bodies(self, states: States) -> list[tuple[Shape, FloatArray]]:
        """Return the shapes of the parts, which may hide things from the camera, and their poses (N, 4, 4)."""
        placed = frames(self.chain, states)
        return [(part.solid.shape, placed[part.frame] @ part.solid.pose) for part in self.parts]

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return bounds (M,), m and rad, on how far any body moves and turns: changes of joints times their levers."""
        law, farthest, turned = cast(JointLaw, motions.law), np.float64(0.0), np.float64(0.0)
        for name, lever, sliding in zip(self.chain.names, self._levers, self.chain.sliding, strict=True):
            way = law.ways(name, motions.start, motions.end)
            farthest = farthest + float(lever) * way
            turned = turned if sliding else turned + way
        return farthest, turned + 0.0 * farthest

    def connect(self, a: States, b: States) -> list[Leg]:
        """Return one reach; a joint without limits takes the shorter direction, and a joint that is NaN in b stays."""
        given = States(**{n: np.where(np.isnan(getattr(b, n)), getattr(a, n), getattr(b, n)) for n in self.space.names})
        end = self.space.onward(a, given)
        moved = np.any([np.abs(getattr(end, n) - getattr(a, n)) > NEAR for n in self.space.names], axis=0)
        return [Leg("reach", States(**{n: np.where(moved, getattr(end, n), getattr(a, n)) for n in end.names}), moved)]

    def execution(self, trajectory: Trajectory) -> tuple[Trajectory, FloatArray]:
        """Return the plan: reaches go from rest to rest already."""
        return trajectory, trajectory.times

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield joints beyond their limits, too fast, or accelerated too fast."""
        states = trajectory.states
        for kind in dict.fromkeys(trajectory.kinds):
            motions = np.flatnonzero([kind == other for other in trajectory.kinds])
            start, end = states.take(motions), states.take(motions + 1)
            yield from faults(self.chain, self._joint_law(kind), start, end, motions)
        if not len(trajectory):
            yield from faults(self.chain, self.laws["reach"], states, states, np.zeros(1, np.int64))

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return which motions (M,) break a limit of a joint."""
        return doubtful(self.chain, self._joint_law(law.kind), start, end)

    def _joint_law(self, kind: str) -> JointLaw:
        """Return the law of a kind of motion; a hold counts as the end of a reach of length 0."""
        return self.laws.get(kind, self.laws["reach"])

    # Where it collides

    def collision(self, world: World) -> ArmCollision:
        """Return the collision test of planning: convex hulls, and certificates that whole motions are free."""
        return ArmCollision(self.chain, self.parts, self.apart, world)

    def judge(self, world: World) -> ArmJudge:
        """Return the collision test of verification, by python-fcl, at states between which no part moves over 1 mm."""
        return ArmJudge(self.chain, self.parts, self.apart, world)

    def describe(self) -> dict[str, Any]:
        """Return JSON-able parameters, enough to build the same arm: its files by path and SHA-256."""
        arm: dict[str, Any] = {**self._records, "tip": self.tip, "acceleration": self.acceleration}
        if self.packages:
            arm["packages"] = {name: record(folder) for name, folder in self.packages.items()}
        arm |= {name: list(value) for name in ("camera", "base") if (value := getattr(self, name)) != HERE}
        if self.fixed:
            arm["fixed"] = dict(self.fixed)
        if self.field_of_view is not None:
            arm["field_of_view"] = list(self.field_of_view)
        return {self.name: arm}


SLOWEST = 1e-6
WORDS = {"urdf": "URDF", "srdf": "SRDF"}


def _path_text(name: str, given: Any) -> str:
    """Return a path as text, also from the record of a file."""
    path = path_of(given, WORDS.get(name, name)) if is_record(given) else given
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        raise ModelError(f"{name} is the path of a file, got {shown(given)}")
    return str(os.fspath(path))


def _pose_matrix(name: str, given: Any) -> FloatArray:
    """Return a pose (4, 4) from x, y, z, roll, pitch, yaw."""
    try:
        numbers = [
            real(name, number, -FARTHEST, FARTHEST, "x, y, z, m, and roll, pitch, yaw, rad,", error=ModelError)
            for number in given
        ]
    except TypeError:
        numbers = []
    if len(numbers) != 6:
        raise ModelError(f"{name} is (x, y, z, roll, pitch, yaw) in m and rad, got {shown(given)}")
    for angle in numbers[3:]:
        if advice := not_radians(angle):
            raise ModelError(f"an angle of {name} {advice}")
    return pose_of(np.array(numbers[:3]), np.array(numbers[3:]))


def _checked_mapping(name: str, given: Any, what: str) -> dict[str, Any]:
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise ModelError(f"{name} gives {what} by name, such as {{'name': ...}}, got {shown(given)}")
    return dict(given)


def _checked_numbers(name: str, given: Any, least: float, what: str) -> dict[str, float]:
    named = _checked_mapping(name, given, what)
    return {key: float(real(f"{name} of {key}", value, least, MOST, error=ModelError)) for key, value in named.items()}
