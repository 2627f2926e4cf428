"""Collision test of an arm for verification, by python-fcl or coal at small steps along each motion.

It shares neither kinematics nor distances nor bounds with :mod:`hpop.models.serial_arm.collision`. Frames are products
of SciPy's rotation matrices. How far a body moves from step to step is measured at the corners of its bounding box.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, product
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import one_of
from hpop.errors import ModelError
from hpop.models.serial_arm.chain import ArmPart, Chain, enlarged_parts
from hpop.motions import Motions, States
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere

if TYPE_CHECKING:
    from hpop.world import World

STEP = 1e-3  # m: no point of the arm moves farther from one step to the next
FIRST_STEPS = 32  # number of steps in a first attempt, from which the required number is estimated
MOST_STEPS = 100_000  # largest number of steps of one motion
LIMIT = 1e-6  # rad or m: tolerance of joint limits
SURE = 0.9  # this share of the distance that the library returns, less a step, is trusted as a lower bound
LIBRARIES = ("fcl", "coal")


class _Steps(NamedTuple):
    """Sampled states (steps) of an arm with P parts along one motion.

    rows   (S, n)        joint values at each of S steps
    poses  (P, S, 3, 4)  poses of the parts' shapes
    moved  (P, S - 1)    m, largest straight-line distance that a point of each part moves from step to step
    """

    rows: FloatArray
    poses: FloatArray
    moved: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class ArmJudge:
    """Collision test of an arm for verification.

    chain    joints of the arm
    parts    solids on its links
    apart    pairs of links that may touch each other
    world    obstacles
    library  that computes distances: "fcl" (python-fcl), or "coal" (``pip install 'hpop[coal]'``)

    A motion is sampled in steps in which no point of the arm moves more than 1 mm. A pair of bodies is not tested at
    every step. It is tested again once the movement since its last test adds up to nine tenths of the distance that the
    library returned there, because it cannot touch before. With solids of the world, padded or scaled links are tested
    as enlarged links (:mod:`hpop.models.serial_arm.chain`).
    """

    chain: Chain
    parts: tuple[ArmPart, ...]
    apart: frozenset[tuple[str, str]]
    world: World
    library: str = field(default=LIBRARIES[0], kw_only=True)

    def __post_init__(self) -> None:
        one_of("the library of a judge", self.library, LIBRARIES, error=ModelError)

    def states_free(self, states: States) -> BoolArray:
        """Return whether the arm is free in each state (N,)."""
        rows = self._rows(states)
        return np.array([self._contact_reason(self._steps_at(row[None])) == "" for row in rows], dtype=np.bool_)

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the arm is free at all sampled steps of each motion (M,), both ends included."""
        each = (self._steps_along(motions, i) for i in range(len(motions)))
        return np.array([self._contact_reason(steps) == "" for steps in each], dtype=np.bool_)

    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        reason = self._contact_reason(self._steps_at(self._rows(state)))
        return reason and f"{reason}. Choose other joint values"

    # Poses

    def _rows(self, states: States) -> FloatArray:
        """Return the joint values (N, n) of states."""
        return np.stack([np.asarray(getattr(states, name), np.float64) for name in self.chain.names], axis=1)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the states from which joint values are computed: the joints."""
        return self.chain.names

    def _frames(self, rows: FloatArray) -> list[FloatArray]:
        """Return the poses in the world (S, 4, 4) of the frames 0 to n, at joint values (S, n)."""
        return joint_frames(self.chain, rows)

    def _steps_at(self, rows: FloatArray) -> _Steps:
        """Return poses and movements of all parts at joint values (S, n)."""
        frames = self._frames(rows)
        poses = np.stack([frames[part.frame] @ part.solid.pose for part in self.parts])[:, :, :3]
        ways = np.linalg.norm(np.diff(poses, axis=1) @ self._corners[:, None], axis=2)  # (P, S - 1, 8)
        return _Steps(rows, poses, ways.max(axis=2))

    def _steps_along(self, motions: Motions, i: int) -> _Steps:
        """Return the steps of motion i: enough, up to MOST_STEPS, that no corner of a part moves more than ``STEP``."""
        law, start, end = motions.law, motions.start.take([i]), motions.end.take([i])
        count = FIRST_STEPS
        while True:
            share = np.linspace(0.0, 1.0, count + 1)
            columns = {
                name: law.interpolate(name, start, end, share) if name in law.varies else getattr(start, name)
                for name in self.columns
            }
            rows = self._rows(States(**{name: np.broadcast_to(c, share.shape) for name, c in columns.items()}))
            steps = self._steps_at(rows)
            longest = float(steps.moved.max(initial=0.0))
            if longest <= STEP or count >= MOST_STEPS:
                return steps
            count = min(MOST_STEPS, int(count * max(1.1 * longest / STEP, 1.01)) + 1)

    @cached_property
    def _corners(self) -> FloatArray:
        """Corners (P, 4, 8), in homogeneous coordinates, of a bounding box of each part, in the frame of its shape."""
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        sides = [_half_sides(part.solid) for part in self.parts]
        for a, larger in self._enlarged.items():
            sides[a] = np.maximum(sides[a], _half_sides(larger.solid) + larger.padding)
        corners = [np.c_[signs * side, np.ones(8)].T for side in sides]
        return np.array(corners).reshape(-1, 4, 8)

    # Contacts

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        """Pairs of objects to be tested: two parts that move relative to each other, or a moving part and a solid.

        Pairs that may touch are left out. Objects are numbered: first the parts, then the solids.
        """
        size = len(self.parts)
        own = [
            (a, b)
            for (a, one), (b, other) in combinations(enumerate(self.parts), 2)
            if one.frame != other.frame and tuple(sorted((one.link, other.link))) not in self.apart
        ]
        may_touch = self.world.link_rules.may_touch
        return own + [
            (a, size + b)
            for a, part in enumerate(self.parts)
            for b, solid in enumerate(self._solids)
            if part.frame and solid.name not in part.touches and not may_touch(part.link, solid.name)
        ]

    @cached_property
    def _enlarged(self) -> dict[int, ArmPart]:
        return enlarged_parts(self.parts, self.world.link_rules)

    @cached_property
    def _larger_objects(self) -> dict[int, Any]:
        """Objects of the library for enlarged parts (scaled or padded links), by index in ``parts``.

        They replace these parts in tests with solids of the world.
        """
        return {a: self._library.placed(part.solid, np.eye(4)) for a, part in self._enlarged.items()}

    @cached_property
    def _solids(self) -> tuple[Solid, ...]:
        return self.world.bodies

    @cached_property
    def _library(self) -> _Library:
        return _Coal() if self.library == "coal" else _Fcl()

    @cached_property
    def _objects(self) -> list[Any]:
        """Objects of the library: of the parts, which get their poses before each test, then of the world's solids."""
        parts = [self._library.placed(part.solid, np.eye(4)) for part in self.parts]
        return parts + [self._library.placed(solid, solid.pose) for solid in self._solids]

    def _contact_reason(self, steps: _Steps) -> str:
        """Return a text: which joint is beyond its limits, or which bodies touch, at some step; "" if none."""
        beyond = self._beyond_limits(steps.rows)
        if beyond.any():
            return f"joint {self.chain.names[int(np.argmax(beyond.any(axis=0)))]!r} is beyond its limits"
        come = np.zeros((len(self._objects), len(steps.rows)))  # distance covered by each object at each step
        come[: len(self.parts), 1:] = np.cumsum(steps.moved, axis=1)
        pair = next((pair for pair in self._pairs if self._in_contact(*pair, steps.poses, come)), None)
        return "" if pair is None else f"{self._body_name(pair[0])} touches {self._body_name(pair[1])}"

    def _beyond_limits(self, rows: FloatArray) -> BoolArray:
        """Return whether each joint is beyond its limits in each row of joint values (S, n)."""
        within = (rows >= self.chain.low - LIMIT) & (rows <= self.chain.high + LIMIT)
        return np.asarray(~(within | (self.chain.turning & np.isfinite(rows))))

    def _in_contact(self, a: int, b: int, poses: FloatArray, come: FloatArray) -> bool:
        """Return whether objects a and b touch at some step.

        poses  (P, S, 3, 4)  of the parts
        come   (objects, S)  m, how far each object has moved up to each step
        """
        one, other, ball = self._objects[a], self._objects[b], 0.0
        if b >= len(poses) and a in self._enlarged:
            one, ball = self._larger_objects[a], self._enlarged[a].padding
        together, step = come[a] + come[b], 0
        while step < together.size:
            self._library.move(one, poses[a, step])
            if b < len(poses):
                self._library.move(other, poses[b, step])
            distance = self._library.distance(one, other) - ball
            if distance <= 0.0:
                return True
            step = max(step + 1, int(np.searchsorted(together, together[step] + SURE * distance - STEP)))
        return False

    def _body_name(self, body: int) -> str:
        """Return the name of an object for messages: "the link NAME" or "the obstacle NAME"."""
        if body < len(self.parts):
            return f"the link {self.parts[body].link!r}"
        return f"the obstacle {self._solids[body - len(self.parts)].name!r}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.chain.names)} joints>"


def joint_frames(chain: Chain, rows: FloatArray) -> list[FloatArray]:
    """Return the poses in the world (S, 4, 4) of the frames 0 to n of a chain, at joint values (S, n)."""
    from scipy.spatial.transform import Rotation  # slow to import

    frames = [np.broadcast_to(np.eye(4), (len(rows), 4, 4))]
    for k, (origin, axis) in enumerate(zip(chain.origins, chain.axes, strict=True)):
        moved = np.broadcast_to(np.eye(4), (len(rows), 4, 4)).copy()
        along = rows[:, k, None] * axis
        if chain.sliding[k]:
            moved[:, :3, 3] = along
        else:
            moved[:, :3, :3] = Rotation.from_rotvec(along).as_matrix()
        frames.append(frames[-1] @ origin @ moved)
    return frames


def _half_sides(solid: Solid) -> FloatArray:
    """Return half the sides (3,), m, of the smallest box around a solid's shape whose centre is the shape's origin."""
    match solid.shape:
        case Box(size=size):
            return np.array(size) / 2
        case Cylinder(radius=radius, length=length):
            return np.array([radius, radius, length / 2])
        case Sphere(radius=radius):
            return np.full(3, radius)
        case Hull(points=points):
            sides: FloatArray = np.abs(points).max(axis=0)
            return sides


class _Library(Protocol):
    """Library that computes distances of convex objects; poses are (4, 4) or (3, 4)."""

    def placed(self, solid: Solid, pose: FloatArray) -> Any:
        """Return a solid's shape at a pose as an object of the library."""

    def move(self, one: Any, pose: FloatArray) -> None:
        """Move an object to a pose."""

    def distance(self, one: Any, other: Any) -> float:
        """Return the distance, m, of two objects; at most 0 if they touch."""


class _Fcl:
    """Distances by python-fcl."""

    def __init__(self) -> None:
        import fcl  # slow to import

        self._fcl = fcl
        self._request = fcl.DistanceRequest()

    def placed(self, solid: Solid, pose: FloatArray) -> Any:
        return self._fcl.CollisionObject(self._shape(solid), self._transform(pose))

    def move(self, one: Any, pose: FloatArray) -> None:
        one.setTransform(self._transform(pose))

    def distance(self, one: Any, other: Any) -> float:
        return float(self._fcl.distance(one, other, self._request, self._fcl.DistanceResult()))

    def _transform(self, pose: FloatArray) -> Any:
        return self._fcl.Transform(pose[:3, :3], pose[:3, 3])

    def _shape(self, solid: Solid) -> Any:
        match solid.shape:
            case Box(size=size):
                return self._fcl.Box(*size)
            case Cylinder(radius=radius, length=length):
                return self._fcl.Cylinder(radius, length)
            case Sphere(radius=radius):
                return self._fcl.Sphere(radius)
            case Hull(points=points, triangles=triangles):
                faces = np.column_stack([np.full(len(triangles), 3), triangles])
                return self._fcl.Convex(np.array(points), len(triangles), faces.ravel())


class _Coal:
    """Distances by coal, a later development of fcl; it builds the hulls of points itself."""

    def __init__(self) -> None:
        try:
            import coal  # installed by the extra hpop[coal]
        except ImportError as error:
            raise ModelError(
                f"judging by coal needs coal, which cannot be imported ({error}); run pip install 'hpop[coal]', or "
                "judge by fcl"
            ) from None
        self._coal = coal
        self._request = coal.DistanceRequest()

    def placed(self, solid: Solid, pose: FloatArray) -> Any:
        return self._coal.CollisionObject(self._shape(solid), self._transform(pose))

    def move(self, one: Any, pose: FloatArray) -> None:
        one.setTransform(self._transform(pose))

    def distance(self, one: Any, other: Any) -> float:
        return float(self._coal.distance(one, other, self._request, self._coal.DistanceResult()))

    def _transform(self, pose: FloatArray) -> Any:
        return self._coal.Transform3s(pose[:3, :3], pose[:3, 3])

    def _shape(self, solid: Solid) -> Any:
        match solid.shape:
            case Box(size=size):
                return self._coal.Box(*size)
            case Cylinder(radius=radius, length=length):
                return self._coal.Cylinder(radius, length)
            case Sphere(radius=radius):
                return self._coal.Sphere(radius)
            case Hull(points=points):
                corners = self._coal.StdVec_Vec3s()
                corners.extend([*points])
                return self._coal.Convex.convexHull(corners, True, "Qt")
