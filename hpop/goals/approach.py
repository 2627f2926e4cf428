"""Approach and sight of goals: a straight line in one orientation over the last metres, and a free line to a target.

The line ends where the body is at the end of the trajectory. States on it are found by inverse kinematics, each from
the next one; motions between them are straight in joint space, not in space. So each motion is proved to stay near the
line: it is halved until upper bounds on how far each part moves and turns (``Model.extent``) are smaller than what is
left of the tolerances in the middle of the part. This also holds for speed profiles along such motions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import cross, dot, norm
from hpop.base.options import Degrees, real
from hpop.base.text import shown
from hpop.errors import QueryError
from hpop.goals.base import Goal
from hpop.goals.region import InverseKinematics, Region, checked_angle, checked_numbers, written
from hpop.motions import HOLD, Model, Motions, Pose, States, StateSpace, Twist, Vector, laws_of
from hpop.world.geometry.rays_in_space import Surfaces, rows, stacked_poses, surfaces_of
from hpop.world.geometry.solids import Solid

if TYPE_CHECKING:
    from hpop.goals.base import Goal
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World

TARGET_RADIUS = 0.05  # m: a target is a ball of this radius; solids within the ball do not hide it
RAYS = 37  # number of rays to this ball
MOST_HIDDEN = 0.5  # share of the rays that may be blocked on the way to a target that must be visible


def hidden_share(
    world: World, model: Model, states: States, target: tuple[float, float, float], *, by_robot: bool
) -> FloatArray:
    """Return the share (N,) of the rays from the camera to a ball about a target that solids of the world block.

    ``by_robot`` says whether the bodies of the robot block rays too, except bodies that contain or touch the camera.
    """
    pose = model.pose("camera", states)
    camera = rows((pose.x, pose.y, pose.z), states.size)
    bodies = model.bodies(states) if by_robot else []
    shapes = Surfaces.of([Solid(shape, np.eye(4)) for shape, _ in bodies])
    poses = stacked_poses([pose for _, pose in bodies], states.size)
    return np.asarray(surfaces_of(world).blocked(shapes, poses, camera, target, TARGET_RADIUS, RAYS))


def sees_target(world: World, model: Model, states: States, target: tuple[float, float, float]) -> BoolArray:
    """Return whether at least half of a target, a ball of 5 cm radius, is visible from the camera (N,)."""
    return np.asarray(hidden_share(world, model, states, target, by_robot=True) <= MOST_HIDDEN)


def reached_in(world: World, goal: Goal, model: Model, states: States) -> BoolArray:
    """Return which states (M,) reach a goal in a world, with a visible target if the goal requires this."""
    found = np.zeros(states.size, dtype=bool)
    for each in goal.alternatives():
        there = np.flatnonzero(each.reached(model, states) & ~found)
        if each.visible and each.looked_at is not None and there.size:
            there = there[sees_target(world, model, states.take(there), each.looked_at)]
        found[there] = True
    return found


REACH = "reach"  # kind of the motions that are straight in joint space
KEYS = ("distance", "axis", "direction", "tolerance", "angle")
FORM = 'approach must be a mapping such as {"distance": 0.1, "axis": (1, 0, 0)} or {"distance": 0.1, "direction": '
LONGEST = 10.0  # m
SMALLEST = 1e-4  # m and rad: smallest tolerances
TOLERANCE, ANGLE = 2e-3, math.radians(2)
SLACK = 0.02  # share of the tolerances: a motion is refused only if it comes nearer than this to one of them
PARTS = (1, 2, 4, 8, 16, 32)  # numbers of motions that are tried
SURE = 4  # with at least so many motions, an end without states on the line is given up
ON_LINE = 1e-7  # m, or of the body's axes: states at the ends of these motions are no farther from the line


class ApproachRows(NamedTuple):
    """Approaches to N states.

    rows     for each state the states of its approach, as rows (K + 1, n), the given one last; None if there is none
    strayed  (N,)  True where states on the line were found, but no motions between them that stay near it
    """

    rows: list[FloatArray | None]
    strayed: BoolArray


@dataclass(frozen=True)
class Approach:
    """Straight approach of a body: where it begins, in which direction it leads, and how far motions may stray from it.

    body       name of the body
    distance   m    length of the line, which ends where the body is at the end of the trajectory
    axis            unit vector along which the body moves, in its own frame (x ahead, y left, z up); or None
    direction       unit vector along which it moves, in the world; or None
    tolerance  m    largest distance of the body from the line
    angle      rad  largest angle between the body's orientation and the one that it has at the end
    """

    body: str
    distance: float
    axis: Vector | None
    direction: Vector | None
    tolerance: float = TOLERANCE
    angle: float = ANGLE

    @classmethod
    def from_spec(cls, body: str, given: Any) -> Approach:
        """Return the approach that a mapping describes: distance, axis or direction, tolerance, angle.

        Without axis and direction, the body moves along its x axis. Raises QueryError for another mapping.
        """
        if not isinstance(given, Mapping) or "distance" not in given or not set(given) <= set(KEYS):
            raise QueryError(
                f"{FORM}(0, 0, -1)}}, and may have tolerance (m) and angle (rad) as well; got {shown(given)}"
            )
        if given.get("axis") is not None and given.get("direction") is not None:
            raise QueryError(
                "approach takes axis, in the frame of the body, or direction, in the world, got both; leave one out"
            )
        distance, tolerance = (
            float(real(f"{key} of approach", given.get(key, TOLERANCE), SMALLEST, LONGEST, "m", error=QueryError))
            for key in ("distance", "tolerance")
        )
        angle = checked_angle("angle of approach", Degrees.in_radians(given.get("angle", ANGLE)))
        real("angle of approach", angle, SMALLEST, math.pi / 2, "an angle in rad", error=QueryError)
        if tolerance >= distance:
            raise QueryError(f"tolerance of approach must be less than its distance, {distance:g} m, got {tolerance:g}")
        direction = None if given.get("direction") is None else _unit("direction", given["direction"])
        axis = None if direction is not None else _unit("axis", given.get("axis") or (1.0, 0.0, 0.0))
        return cls(body, distance, axis, direction, tolerance, angle)

    def described(self) -> dict[str, Any]:
        """Return the mapping that :meth:`from_spec` takes."""
        way = {"axis": self.axis} if self.direction is None else {"direction": self.direction}
        numbers = {"tolerance": self.tolerance, "angle": self.angle}
        return {"distance": self.distance, **{key: list(value or ()) for key, value in way.items()}, **numbers}

    def __str__(self) -> str:
        """Return the approach as short text for messages."""
        way = f"its axis {written(self.axis)}" if self.axis is not None else written(self.direction or ())
        return f"straight over the last {self.distance:g} m along {way}"

    def lines(self, model: Model, space: StateSpace, world: World, ends: States) -> ApproachRows:
        """Return the approach to each of the states (N,), with as few motions as stay within the tolerances.

        space  state space, which bounds the states
        """
        line = _Line.to(self, model, ends)
        sought = _JointsMove(model, space, _Frame(self.body))
        given = sought.rows(ends)
        rows: list[FloatArray | None] = [None] * ends.size
        left, strayed = np.arange(ends.size), np.zeros(ends.size, dtype=bool)
        for count in PARTS:
            states = np.repeat(given[left, None], count + 1, axis=1)  # (L, count + 1, n)
            there = np.arange(left.size)  # rows of `left` that have states on the line so far
            for i in reversed(range(count)):
                aims = line.frames(left[there], self.distance * (count - i) / count)
                states[there, i] = sought.descend(states[there, i + 1], aims, aims)
                there = there[
                    (np.abs(sought.excess(sought.states(states[there, i]), aims, aims)) <= ON_LINE).all(axis=1)
                ]
            strayed[left] = False
            strayed[left[there]] = True
            begin, end = (
                sought.states(states[there, part].reshape(-1, states.shape[2])) for part in (slice(-1), slice(1, None))
            )
            legs = list(model.connect(begin, end))
            reaches = Motions(world, model, model.laws[REACH], begin, legs[-1].end)
            near = self._stays(reaches, line, np.repeat(left[there], count))
            for leg in legs:
                near &= (leg.kind == REACH) | ~np.asarray(leg.present)
            found = there[near.reshape(-1, count).all(axis=1)]
            for i in found.tolist():
                rows[left[i]] = states[i]
            strayed[left[found]] = False
            left = np.setdiff1d(left[there] if count >= SURE else left, left[found])
            if not left.size:
                break
        return ApproachRows(rows, strayed)

    def begin(self, trajectory: Trajectory, world: World) -> int | None:
        """Return the index of the first motion of a trajectory's straight approach; None if it does not end with one.

        All motions from there on are proved to stay within the tolerances.
        """
        model, size = trajectory.model, len(trajectory)
        states = trajectory.states.take(np.arange(size + 1))
        line = _Line.to(self, model, states.take([size]))
        owner = np.zeros(size + 1, np.int64)
        off, turned, behind = line.errors(owner, model.carrier.pose(self.body, states))
        near = (off <= self.tolerance) & (turned <= self.angle)
        begins = near & (behind >= self.distance - self.tolerance)
        last = size
        while last and near[last] and not begins[last]:
            last -= 1
        reach = model.laws.get(REACH)
        if not size or not begins[last] or reach is None:
            return None
        kinds = np.array(trajectory.kinds[last:], dtype=object)
        for kind in {*kinds.tolist()} - {HOLD.kind}:
            motions = last + np.flatnonzero(kinds == kind)
            law = laws_of(model)[kind]
            if not reach.varies.issuperset(law.varies.intersection(model.space.names)):
                return None
            names = (*model.space.names, *law.extra)
            start, end = (
                States(**{name: getattr(trajectory.states, name)[at] for name in names})
                for at in (motions, motions + 1)
            )
            if not self._stays(Motions(world, model, law, start, end), line, owner[motions]).all():
                return None
        return last

    def _stays(self, motions: Motions, line: _Line, owner: IntArray) -> BoolArray:
        """Return which motions (M,) of a law are proved to stay near a line; ``owner`` (M,) says near which.

        Motions are halved until the body moves and turns less in each part than what its error in the middle of the
        part leaves of the tolerances.
        """
        world, model, law, start, end = motions.world, motions.model, motions.law, motions.start, motions.end
        kept, motion = np.ones(start.size, dtype=bool), np.arange(start.size)
        while motion.size:
            middle = States(**{
                n: law.interpolate(n, start, end, np.full(motion.size, 0.5)) if n in law.varies else getattr(start, n)
                for n in start.names
            })  # fmt: skip
            off, turned, _ = line.errors(owner[motion], model.carrier.pose(self.body, middle))
            room, angle = self.tolerance - off, self.angle - turned
            kept[motion[(room < SLACK * self.tolerance) | (angle < SLACK * self.angle)]] = False
            metres, radians = model.extent(Motions(world, model, law, start, end))
            part = np.flatnonzero(kept[motion] & ((metres > room) | (radians > angle)))
            start, middle, end, motion = start.take(part), middle.take(part), end.take(part), motion[part]
            start, end = (
                States(**{n: np.concatenate([getattr(first, n), getattr(second, n)]) for n in start.names})
                for first, second in ((start, middle), (middle, end))
            )
            motion = np.concatenate([motion, motion])
        return kept


@dataclass(frozen=True, eq=False)
class _Line:
    """Lines along which a body approaches N states.

    frame  (N, 9)  position, m, and the axes ahead and left of the body at the end of each line
    along  (N, 3)  unit vector of each line
    """

    approach: Approach
    frame: FloatArray
    along: FloatArray

    @classmethod
    def to(cls, approach: Approach, model: Model, ends: States) -> _Line:
        """Return the lines that end at states (N,)."""
        pose, size = model.carrier.pose(approach.body, ends), ends.size
        frame = _columns((pose.x, pose.y, pose.z, *pose.ahead, *pose.left), size)
        way = approach.direction or (0.0, 0.0, 0.0)
        if approach.axis is not None:
            parts = zip(pose.ahead, pose.left, pose.up, strict=True)
            way = tuple(sum(a * b for a, b in zip(approach.axis, part, strict=True)) for part in parts)
        return cls(approach, frame, _columns(way, size))

    def frames(self, lines: IntArray, before: float) -> FloatArray:
        """Return position, axis ahead and axis left of the body (L, 9), 3 columns each, ``before`` m from lines' ends.

        lines  (L,) indices of the lines
        """
        frames = self.frame[lines].copy()
        frames[:, :3] -= before * self.along[lines]
        return frames

    def errors(self, owner: IntArray, pose: Pose) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return how far poses (M,) are from their lines, as three arrays (M,).

        They are the distance from the line, m, the angle to the orientation at its end, rad, and how far the pose is
        before its end along the line, m (negative beyond it). ``owner`` (M,) says which line belongs to each pose.
        """
        place, ahead, left = ((*self.frame[owner, 3 * i : 3 * i + 3].T,) for i in range(3))
        along = (*self.along[owner].T,)
        off = [own - there for own, there in zip((pose.x, pose.y, pose.z), place, strict=True)]
        behind = -np.asarray(dot(off, along))
        within = np.clip(behind, 0.0, self.approach.distance)
        error = norm([part + within * way for part, way in zip(off, along, strict=True)])
        axes: list[tuple[Sequence[Column], Sequence[Column]]]
        axes = [(pose.ahead, ahead), (pose.left, left), (pose.up, cross(ahead, left))]
        normals = [cross(own, there) for own, there in axes]
        sine = 0.5 * np.asarray(norm([sum(part) for part in zip(*normals, strict=True)]))
        cosine = 0.5 * (sum(np.asarray(dot(own, there), float) for own, there in axes) - 1.0)
        return np.asarray(error), np.arctan2(sine, cosine), behind


@dataclass(frozen=True)
class _Frame(Region):
    """Region of a body in a given position and orientation, which its bounds give row by row."""

    name: ClassVar[str] = "frame"

    of: str = field(default="tool")

    @property
    def body(self) -> str:
        """Return the name of the body."""
        return self.of

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Placeholders for the bounds: each row has its own, which callers pass."""
        return np.zeros(9), np.zeros(9)

    @property
    def lengths(self) -> BoolArray:
        """Mask (9,) of the coordinates in m."""
        return np.arange(9) < 3

    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Return the position, m, and the components of the axes ahead and left."""
        return (pose.x, pose.y, pose.z, *pose.ahead, *pose.left)

    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """Return the rates of the coordinates."""
        return (*twist.velocity, *cross(twist.rotation, pose.ahead), *cross(twist.rotation, pose.left))


class _JointsMove(InverseKinematics):
    """Inverse kinematics in which only joints move, and the base of a mobile arm stands."""

    def _jacobian(self, states: States) -> FloatArray:
        jacobian = super()._jacobian(states)
        jacobian[:, :, ~self._moving] = 0.0
        return jacobian

    @cached_property
    def _moving(self) -> BoolArray:
        varies = self.model.laws[REACH].varies
        return np.array([name in varies for name in self.space.names])


def split(goal: Goal, trajectory: Trajectory, world: World) -> int:
    """Return the index of the motion with which a trajectory begins the straight approach that its goal requires.

    The number of motions is returned if the goal requires none, or if the trajectory does not end with one.
    """
    every = [each.straight for each in goal.alternatives() if each.straight is not None]
    last = trajectory.states.take([-1])
    if not every or any(e.straight is None and e.reached(trajectory.model, last)[0] for e in goal.alternatives()):
        return len(trajectory)
    begins = [begin for each in every if (begin := each.begin(trajectory, world)) is not None]
    return max(begins, default=len(trajectory))


def misses_line(goal: Goal, trajectory: Trajectory, world: World) -> bool:
    """Return whether a trajectory that ends at a goal lacks the straight approach that the goal requires."""
    every = goal.alternatives()
    if not any(each.straight is not None for each in every):
        return False
    last = trajectory.states.take([-1])
    there = [each for each in every if each.reached(trajectory.model, last)[0]]
    return bool(there) and all(
        each.straight is not None and each.straight.begin(trajectory, world) is None for each in there
    )


def _columns(columns: Any, size: int) -> FloatArray:
    return np.stack([np.broadcast_to(np.asarray(column, float), (size,)) for column in columns], axis=1)


def _unit(key: str, given: Any) -> Vector:
    x, y, z = checked_numbers(f"{key} of approach", given, 3, "(x, y, z), a vector of any length")
    length = math.hypot(x, y, z)
    if length < SMALLEST:
        raise QueryError(f"{key} of approach must be (x, y, z), a vector of any length but 0, got {shown(given)}")
    return x / length, y / length, z / length
