"""Kinematics of a chain of joints: poses, velocities and accelerations of its bodies, on numbers or CasADi symbols.

Columns (M,) hold one entry for each state. Each joint's frame is turned so that its axis is z. Most products of the
arm's matrices are then with 0 or ±1. Constants are Python floats, so that these products are recognized and left out.
Let q' be the rate of a joint, z its unit axis, and r the vector from the origin of one frame to the next. From base to
tip, velocity v, angular velocity ω, acceleration a and angular acceleration α are

    v ← v + ω × r,                      ω ← ω + q' z
    a ← a + α × r + ω × (ω × r),        α ← α + q'' z + ω × q' z

and where a joint slides, v ← v + q' z and a ← a + q'' z + 2 ω × q' z (Featherstone 2008, Rigid Body Dynamics
Algorithms, ch. 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import hypot, is_zero
from hpop.errors import ModelError
from hpop.models.serial_arm.chain import Chain, FrameMount
from hpop.models.serial_arm.xml import exact
from hpop.motions import States
from hpop.motions.states import Vector

NOTHING: Vector = (0.0, 0.0, 0.0)
BLOCK = 8192  # states in a block: their columns fit the processor's cache
MANY = 4 * BLOCK  # number of states from which on poses are computed in blocks; integrals have fewer in one call


class Axes(NamedTuple):
    """Axes of a frame: three orthogonal unit vectors, whose components are columns or numbers."""

    x: Vector
    y: Vector
    z: Vector

    def along(self, parts: Vector) -> Vector:
        """Return the vector that has the components ``parts`` along these axes."""
        x, y, z = (
            plus_unless_zero(
                plus_unless_zero(lean_product(self.x[i], parts[0]), lean_product(self.y[i], parts[1])),
                lean_product(self.z[i], parts[2]),
            )
            for i in range(3)
        )
        return x, y, z


class Offset(NamedTuple):
    """Constant pose of one frame in another, as Python floats."""

    axes: Axes
    origin: Vector


class Posture(NamedTuple):
    """Frames of a chain in each of M states.

    steps   vector r of each joint: from the origin of the frame before it to its own, slides included
    lines   unit axis z of each joint
    axes    axes of the last frame
    origin  origin of the last frame

    It must not refer to the states, since it is cached for as long as they live.
    """

    steps: list[Vector]
    lines: list[Vector]
    axes: Axes
    origin: Vector


class Kinematics:
    """Forward kinematics of a chain: poses, velocities and accelerations of the bodies at its tip.

    The frames of states are cached as long as the states live, so that several criteria share them.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        turns = [_rotation_to_axis(axis) for axis in chain.axes]
        before = [np.eye(4), *turns]
        pairs = zip(before, chain.origins, turns, strict=False)
        self._offsets = [_offset(back.T @ origin @ turn) for back, origin, turn in pairs]
        self._mounts = {name: self._body_offset(name, mount, before) for name, mount in chain.mounts.items()}
        self._kept: WeakKeyDictionary[States, Posture] = WeakKeyDictionary()

    def __reduce__(self) -> tuple[type[Kinematics], tuple[Chain]]:
        return Kinematics, (self.chain,)

    def _body_offset(self, body: str, mount: FrameMount, turns: list[FloatArray]) -> Offset:
        """Return the pose of a body on the chain's last frame, relative to that frame with its z on the joint's axis.

        Raises ModelError if the body is mounted on another frame.
        """
        if mount.frame != len(self.chain):
            raise ModelError(
                f"{body} must be mounted on the last frame of the arm, {len(self.chain)}, got frame {mount.frame}; "
                "change the frame of its FrameMount"
            )
        return _offset(turns[-1].T @ mount.pose)

    def pose(self, body: str, states: States) -> ArmPose:
        """Return the pose of a body in each of the states."""
        return (ArmPose if states.size <= MANY else ArmPoses)(self, self._offset_of(body), states)

    def twist(self, body: str, states: States, rates: States) -> ArmTwist:
        """Return the velocity and angular velocity of a body; ``rates`` are the first derivatives of the states."""
        return ArmTwist(self, self._offset_of(body), states, rates)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> ArmTwistRate:
        """Return the acceleration and angular acceleration of a body; ``changes`` are the second derivatives."""
        return ArmTwistRate(self, self._offset_of(body), states, rates, changes)

    def posture(self, states: States) -> Posture:
        """Return the frames of the chain in each of the states, from the cache if they are in it."""
        kept = self._kept.get(states)
        if kept is None:
            kept = self._kept[states] = self._posture(states)
        return kept

    def _posture(self, states: States) -> Posture:
        axes, origin = Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), NOTHING
        steps, lines = [], []
        for name, sliding, offset in zip(self.chain.names, self.chain.sliding, self._offsets, strict=True):
            value, step = getattr(states, name), axes.along(offset.origin)
            axes = Axes(*(axes.along(axis) for axis in offset.axes))
            if sliding:
                step = vector_sum(step, scaled_vector(value, axes.z))
            else:
                cos, sin = np.cos(value), np.sin(value)
                x, y = axes.x, axes.y
                axes = Axes(
                    vector_sum(scaled_vector(cos, x), scaled_vector(sin, y)),
                    vector_sum(scaled_vector(cos, y), scaled_vector(-sin, x)),
                    axes.z,
                )
            origin = vector_sum(origin, step)
            steps.append(step)
            lines.append(axes.z)
        return Posture(steps, lines, axes, origin)

    def _offset_of(self, body: str) -> Offset:
        if body not in self._mounts:
            raise ModelError(f"the body of an arm must be one of {', '.join(self._mounts)}, got {body!r}")
        return self._mounts[body]


@dataclass(frozen=True, eq=False, repr=False)
class ArmPose:
    """Pose of a body at the tip of an arm; components are computed when they are read."""

    kinematics: Kinematics
    offset: Offset
    states: States

    @cached_property
    def _posture(self) -> Posture:
        return self.kinematics.posture(self.states)

    @cached_property
    def _place(self) -> Vector:
        return vector_sum(self._posture.origin, self._posture.axes.along(self.offset.origin))

    @property
    def x(self) -> Column:
        return self._column(self._place[0])

    @property
    def y(self) -> Column:
        return self._column(self._place[1])

    @property
    def z(self) -> Column:
        return self._column(self._place[2])

    @cached_property
    def ahead(self) -> Vector:
        return self._posture.axes.along(self.offset.axes.x)

    @cached_property
    def left(self) -> Vector:
        return self._posture.axes.along(self.offset.axes.y)

    @cached_property
    def up(self) -> Vector:
        return self._posture.axes.along(self.offset.axes.z)

    @property
    def yaw(self) -> Column:
        return np.arctan2(self._column(self.ahead[1]), self._column(self.ahead[0]))

    @property
    def pitch(self) -> Column:
        level = hypot(self._column(self.ahead[0]), self._column(self.ahead[1]))
        return np.arctan2(self._column(self.ahead[2]), level)

    @property
    def roll(self) -> Column:
        return np.arctan2(self._column(self.left[2]), self._column(self.up[2]))

    def _column(self, value: Column) -> Column:
        return np.full(self.states.size, value) if isinstance(value, float) else value

    def __repr__(self) -> str:
        return f"<ArmPose: {self.states!r}>"


class ArmPoses(ArmPose):
    """Poses of a body in many states: all components are computed together, in blocks of states.

    This takes three quarters of the time of :class:`ArmPose`. It does not work on CasADi symbols.
    """

    @cached_property
    def _columns(self) -> FloatArray:
        """Rows (12, M): x, y, z of the position, then of the axes ahead, left and up."""
        found = np.empty((12, self.states.size))
        for begin in range(0, self.states.size, BLOCK):
            part = slice(begin, begin + BLOCK)
            states = States(**{name: getattr(self.states, name)[part] for name in self.kinematics.chain.names})
            pose = ArmPose(self.kinematics, self.offset, states)
            for row, column in zip(found, (*pose._place, *pose.ahead, *pose.left, *pose.up), strict=True):
                row[part] = column
        return found

    def _vector(self, first: int) -> Vector:
        x, y, z = self._columns[first : first + 3]
        return x, y, z

    @cached_property
    def _place(self) -> Vector:
        return self._vector(0)

    @cached_property
    def ahead(self) -> Vector:
        return self._vector(3)

    @cached_property
    def left(self) -> Vector:
        return self._vector(6)

    @cached_property
    def up(self) -> Vector:
        return self._vector(9)


@dataclass(frozen=True, eq=False, repr=False)
class ArmTwist:
    """Velocity and angular velocity of a body at the tip of an arm; computed when they are read."""

    kinematics: Kinematics
    offset: Offset
    states: States
    rates: States

    @cached_property
    def posture(self) -> Posture:
        """Frames of the chain in each of the states."""
        return self.kinematics.posture(self.states)

    @cached_property
    def spins(self) -> list[Vector]:
        """Angular velocities ω of frames 0 to n."""
        spins = [NOTHING]
        for name, sliding, line in self._joints():
            spins.append(
                spins[-1] if sliding else vector_sum(spins[-1], scaled_vector(getattr(self.rates, name), line))
            )
        return spins

    @property
    def rotation(self) -> Vector:
        return self.spins[-1]

    @cached_property
    def velocity(self) -> Vector:
        found = NOTHING
        for (name, sliding, line), spin, step in zip(self._joints(), self.spins, self.posture.steps, strict=False):
            found = vector_sum(found, cross(spin, step))
            if sliding:
                found = vector_sum(found, scaled_vector(getattr(self.rates, name), line))
        return vector_sum(found, cross(self.spins[-1], self.arm))

    @cached_property
    def arm(self) -> Vector:
        """Vector from the origin of the last frame to the body."""
        return self.posture.axes.along(self.offset.origin)

    def _joints(self) -> list[tuple[str, bool, Vector]]:
        chain = self.kinematics.chain
        return list(zip(chain.names, chain.sliding.tolist(), self.posture.lines, strict=True))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.states!r}>"


@dataclass(frozen=True, eq=False, repr=False)
class ArmTwistRate(ArmTwist):
    """Acceleration and angular acceleration of a body at the tip of an arm; computed when they are read."""

    changes: States

    @cached_property
    def angular(self) -> list[Vector]:
        """Angular accelerations α of frames 0 to n."""
        found = [NOTHING]
        for (name, sliding, line), spin in zip(self._joints(), self.spins, strict=False):
            change = found[-1]
            if not sliding:
                change = vector_sum(change, scaled_vector(getattr(self.changes, name), line))
                change = vector_sum(change, cross(spin, scaled_vector(getattr(self.rates, name), line)))
            found.append(change)
        return found

    @property
    def rotation(self) -> Vector:
        return self.angular[-1]

    @cached_property
    def velocity(self) -> Vector:
        found, spins, angular = NOTHING, self.spins, self.angular
        for i, ((name, sliding, line), step) in enumerate(zip(self._joints(), self.posture.steps, strict=True)):
            found = vector_sum(found, carried_acceleration(angular[i], spins[i], step))
            if sliding:
                found = vector_sum(found, scaled_vector(getattr(self.changes, name), line))
                found = vector_sum(
                    found, scaled_vector(2.0, cross(spins[i], scaled_vector(getattr(self.rates, name), line)))
                )
        return vector_sum(found, carried_acceleration(angular[-1], spins[-1], self.arm))


def lean_product(a: Column, b: Column) -> Column:
    """Return a times b, without a multiplication if a factor is the number 0, 1 or -1."""
    for one, other in ((a, b), (b, a)):
        if isinstance(one, float) and one in (0.0, 1.0, -1.0):
            return 0.0 if one == 0.0 else other if one == 1.0 else -other
    return a * b


def plus_unless_zero(a: Column, b: Column) -> Column:
    """Return a + b, without an addition if a summand is the number 0."""
    return b if is_zero(a) else a if is_zero(b) else a + b


def scaled_vector(factor: Column, vector: Vector) -> Vector:
    """Return a vector times a factor, without needless operations."""
    x, y, z = (lean_product(factor, part) for part in vector)
    return x, y, z


def vector_sum(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors, without needless operations."""
    x, y, z = (plus_unless_zero(one, other) for one, other in zip(a, b, strict=True))
    return x, y, z


def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a × b, without needless operations."""

    def part(i: int, j: int) -> Column:
        return plus_unless_zero(lean_product(a[i], b[j]), lean_product(-1.0, lean_product(a[j], b[i])))

    return part(1, 2), part(2, 0), part(0, 1)


def carried_acceleration(angular: Vector, spin: Vector, step: Vector) -> Vector:
    """Return α × r + ω × (ω × r): the acceleration of a point r of a rotating frame, relative to its origin."""
    return vector_sum(cross(angular, step), cross(spin, cross(spin, step)))


def _rotation_to_axis(axis: FloatArray) -> FloatArray:
    """Return a rotation (4, 4) that turns the z axis to a given axis; exact for the axes x, y and z."""
    aside = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(aside, axis)
    x /= np.linalg.norm(x)
    turn = np.eye(4)
    turn[:3, 0], turn[:3, 1], turn[:3, 2] = x, np.cross(axis, x), axis
    return turn


def _offset(pose: FloatArray) -> Offset:
    """Return a pose (4, 4) as Python floats, with entries of the rotation that are nearly 0 or ±1 made exact."""
    x, y, z = ((exact(float(c[0])), exact(float(c[1])), exact(float(c[2]))) for c in pose[:3, :3].T)
    origin = pose[:3, 3].tolist()
    return Offset(Axes(x, y, z), (origin[0], origin[1], origin[2]))
