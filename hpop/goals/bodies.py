"""Goals for the pose of a body: the camera looks at a target, or the camera or a tool is at a position.

Differences of directions and orientations are angles: the logarithm of the remaining rotation, with a closed form of
its derivative (Solà, Deray and Atchuthan 2018, arXiv 1812.01537). So inverse kinematics has exact derivatives
everywhere, not only at the goal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import cross, dot, hypot, norm, wrap
from hpop.base.options import LEAST, MOST, Angle, real, set_reals, truth
from hpop.base.text import shown
from hpop.errors import QueryError
from hpop.goals.approach import Approach, sees_target
from hpop.goals.base import REACHED, goal
from hpop.goals.region import DEGREE, Place, Region, checked_angle, checked_numbers, checked_place, written
from hpop.motions import Pose, States, Twist, Vector

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

ALIGNED = 1e-7  # rad: below, the sine of an angle is the angle to the last bit
CLOSEST = 1e-12  # m or rad: smallest divisor, against division by 0
Axes = tuple[Vector, Vector, Vector]


def off_axis(pose: Pose, offset: Vector) -> tuple[Column, Column]:
    """Return two angles (M,), rad: how far an offset points to the left of a body's forward axis, and above it.

    The norm of the two is the angle between offset and axis. An offset straight behind is half a turn to the left.
    """
    ahead, left, up = (dot(axis, offset) for axis in (pose.ahead, pose.left, pose.up))
    sine = norm((left, up))
    left = np.where((sine < CLOSEST) & (ahead < 0.0), CLOSEST, left)
    sine = np.maximum(sine, CLOSEST)
    share = np.arctan2(sine, ahead) / sine
    return share * left, share * up


def off_axis_rates(pose: Pose, twist: Twist, offset: Vector, change: Vector) -> tuple[Column, Column]:
    """Return the rates of the angles of :func:`off_axis`, rad/s, for a body with a twist and an offset that changes.

    ``change`` is the rate of the offset, m/s.
    """
    length = np.maximum(norm(offset), CLOSEST)
    turned = _linear_combination(1.0, change, -1.0, cross(twist.rotation, offset))
    ahead, left, up = (dot(axis, offset) / length for axis in (pose.ahead, pose.left, pose.up))
    growth = dot(offset, change) / length
    ahead_rate, left_rate, up_rate = (
        (dot(axis, turned) - part * growth) / length
        for axis, part in zip((pose.ahead, pose.left, pose.up), (ahead, left, up), strict=True)
    )
    sine = np.maximum(norm((left, up)), CLOSEST)
    sine_rate = (left * left_rate + up * up_rate) / sine
    some = sine > ALIGNED
    share = np.arctan2(sine, ahead) / sine
    share_rate = np.where(some, (ahead * sine_rate - sine * ahead_rate - share * sine_rate) / sine, 0.0)
    return share * left_rate + share_rate * left, share * up_rate + share_rate * up


def roll_of(pose: Pose) -> Column:
    """Return the roll (M,), rad, of a body to its right; arbitrary if it looks straight up or down."""
    return np.arctan2(pose.left[2], pose.up[2])


def roll_rate(pose: Pose, twist: Twist) -> Column:
    """Return the rate (M,), rad/s, of the roll (:func:`roll_of`) of a body with a given twist.

    It is 0 if the body looks straight up or down.
    """
    left, up = pose.left[2], pose.up[2]
    left_rate, up_rate = (cross(twist.rotation, axis)[2] for axis in (pose.left, pose.up))
    return (up * left_rate - left * up_rate) / np.maximum(left * left + up * up, CLOSEST)


def turn_to(pose: Pose, axes: Axes) -> Vector:
    """Return the rotation vector, rad, world frame, that turns a body's orientation to given axes ahead, left, up.

    For half a turn, the vector is (π, 0, 0), whatever the axis of the turn.
    """
    normal, sine, cosine = _remaining_rotation(pose, axes)
    some = sine > ALIGNED
    share = np.where(some, np.arctan2(sine, cosine) / np.maximum(sine, CLOSEST), 1.0)
    return np.where(some | (cosine > 0.0), share * normal[0], np.pi), share * normal[1], share * normal[2]


def turn_to_rates(pose: Pose, twist: Twist, axes: Axes) -> Vector:
    """Return the rates of :func:`turn_to`, rad/s, if the body turns: the inverse right Jacobian of SO(3) times -ω."""
    vector = turn_to(pose, axes)
    _, sine, cosine = _remaining_rotation(pose, axes)
    angle = np.maximum(np.arctan2(sine, cosine), CLOSEST)
    bend = 1.0 / angle**2 - (1.0 + cosine) / (2.0 * angle * np.maximum(sine, CLOSEST))
    bend = np.where(angle > 1e-3, bend, 1.0 / 12.0)  # its limit; nearer, the difference loses more than it is off
    once = cross(vector, twist.rotation)
    twice = cross(vector, once)
    x, y, z = (-w - 0.5 * a - bend * b for w, a, b in zip(twist.rotation, once, twice, strict=True))
    return x, y, z


def _remaining_rotation(pose: Pose, axes: Axes) -> tuple[Vector, Column, Column]:
    """Return the rotation from a body's axes to given axes: axis times sine of the angle, this sine, and the cosine."""
    own = (pose.ahead, pose.left, pose.up)
    normals = [cross(one, other) for one, other in zip(own, axes, strict=True)]
    normal = tuple(0.5 * sum(part) for part in zip(*normals, strict=True))
    trace = sum(dot(one, other) for one, other in zip(own, axes, strict=True))
    return (normal[0], normal[1], normal[2]), norm(normal), 0.5 * (trace - 1.0)


@goal("look_at")
@dataclass(frozen=True)
class LookAt(Region):
    """Goal of a camera that looks at a target from within a band of distances.

    target           m    (x, y, z), in the middle of the view
    distance         m    (least, greatest) from the camera to the target
    roll             rad  roll of the camera to the right, 0 with the horizon level; None allows any roll. It has no
                          effect if the camera looks straight up or down, within 1e-6 rad
    angle_tolerance  rad  largest error of the view: root of the sum of squares of the target's angle from the middle of
                          the view and of the roll error
    visible          whether the target must be visible at the goal: obstacles and the robot itself hide at most
                          half of a ball of 5 cm radius about it. Solids within this ball do not hide it

    On the way to the goal the target may be hidden; the criterion ``occlusion`` measures this. Unless ``visible`` is
    required, a front has a note if obstacles hide all of the target at the goal.
    """

    target: tuple[float, float, float]
    distance: tuple[float, float]
    roll: Angle | None = None
    angle_tolerance: Angle = DEGREE
    visible: bool = False

    def __post_init__(self) -> None:
        truth("visible", self.visible, error=QueryError)
        object.__setattr__(self, "target", checked_place("target", self.target))
        form = "(least, greatest) distance in m"
        least, most = checked_numbers("distance", self.distance, 2, form)
        for one in (least, most):
            real("distance", one, LEAST, MOST, f"{form}, each", error=QueryError)
        if least > most:
            raise QueryError(f"distance must be {form}, the least first, got {written((least, most))}")
        object.__setattr__(self, "distance", (least, most))
        if self.roll is not None:
            object.__setattr__(self, "roll", checked_angle("roll", self.roll))
        set_reals(self, "angle_tolerance", least=LEAST, most=math.pi, kind="an angle in rad", error=QueryError)

    def __str__(self) -> str:
        """Return the target, the distances and a required roll as short text for messages."""
        rolled = "" if self.roll is None else f", rolled {math.degrees(self.roll):.4g} degrees"
        seen = ", visible" if self.visible else ""
        return f"look_at {written(self.target)} from {self.distance[0]:.4g} to {self.distance[1]:.4g} m{rolled}{seen}"

    @property
    def body(self) -> str:
        """Return the name of the body: the camera."""
        return "camera"

    @property
    def looked_at(self) -> Place:
        """Return the position at which the camera looks: the target."""
        return self.target

    @property
    def places(self) -> tuple[Place, ...]:
        """Return the positions that pictures mark; here only one, the target."""
        return (self.target,)

    @property
    def widened(self) -> tuple[str, ...]:
        """Return the names of the parameters that make the goal easier to reach: distance and angle tolerance."""
        return "distance", "angle_tolerance"

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the coordinates: the distances, m, and 0 for the angles, rad."""
        still = [0.0] * (2 if self.roll is None else 3)
        return np.array([self.distance[0], *still]), np.array([self.distance[1], *still])

    @property
    def lengths(self) -> BoolArray:
        """Mask (k,) of the coordinates in m: only the distance."""
        return np.array([True, False, False, *([] if self.roll is None else [False])])

    @property
    def tolerances(self) -> tuple[float, float]:
        """Return the tolerances: almost 0 m, since the distance has bounds, and the angle tolerance, rad."""
        return REACHED, self.angle_tolerance

    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Return distance, m, the target's angles left of and above the middle of the view, and the roll error, rad.

        There is no roll error if any roll is allowed.
        """
        offset = self._offset(pose)
        return norm(offset), *off_axis(pose, offset), *(() if self.roll is None else (self._off_roll(pose),))

    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """Return the rates (M,) of the coordinates, m/s and rad/s."""
        offset = self._offset(pose)
        x, y, z = (-part for part in twist.velocity)
        approach = dot(offset, (x, y, z)) / np.maximum(norm(offset), CLOSEST)
        rolled = () if self.roll is None else (roll_rate(pose, twist),)
        return approach, *off_axis_rates(pose, twist, offset, (x, y, z)), *rolled

    def admitted(self, problem: Problem, states: States) -> BoolArray:
        """Return which states (N,) see the target, if it must be visible; else all."""
        if not self.visible:
            return super().admitted(problem, states)
        return sees_target(problem.world, problem.model, states, self.target)

    def why_refused(self, count: int) -> str:
        """Return a text: the target is hidden in ``count`` states, and a remedy."""
        return (
            f"obstacles or the robot itself hide its target in all of {count} states; move the target, give other "
            "distances, or leave visible out"
        )

    def describe(self) -> dict[str, Any]:
        """Return the name and the parameters as JSON, without ``visible`` if it is not required."""
        told = super().describe()
        if not self.visible:
            del told[self.name]["visible"]
        return told

    def _off_roll(self, pose: Pose) -> Column:
        """Return the roll error (M,), rad; 0 if the camera looks straight up or down."""
        off_vertical = np.arctan2(hypot(pose.left[2], pose.up[2]), np.abs(pose.ahead[2]))
        return np.where(off_vertical <= REACHED, 0.0, wrap(roll_of(pose) - self.roll))

    def _offset(self, pose: Pose) -> Vector:
        """Return the offset (x, y, z) from the camera to the target, m."""
        x, y, z = self.target
        return x - pose.x, y - pose.y, z - pose.z


@dataclass(frozen=True)
class PoseAt(Region):
    """Goal of a body at a position: in an orientation, along a direction with free roll, or in any orientation.

    :class:`CameraAt` and :class:`ToolAt` describe the fields.
    """

    position: tuple[float, float, float]
    yaw_pitch_roll: tuple[Angle, Angle, Angle] | None = None
    direction: tuple[float, float, float] | None = None
    position_tolerance: float = 1e-3
    angle_tolerance: Angle = DEGREE
    approach: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", checked_place("position", self.position))
        if self.yaw_pitch_roll is not None and self.direction is not None:
            raise QueryError(f"{self.name} takes yaw_pitch_roll, direction or neither, got both; leave one out")
        if self.yaw_pitch_roll is not None:
            angles = checked_numbers("yaw_pitch_roll", self.yaw_pitch_roll, 3, "(yaw, pitch, roll) in rad")
            object.__setattr__(self, "yaw_pitch_roll", tuple(checked_angle("yaw_pitch_roll", one) for one in angles))
        if self.direction is not None:
            vector = checked_numbers("direction", self.direction, 3, "(x, y, z), a vector of any length")
            if math.hypot(*vector) < LEAST:
                raise QueryError(
                    f"direction must be (x, y, z), a vector of any length but 0, got {shown(self.direction)}"
                )
            object.__setattr__(self, "direction", vector)
        set_reals(self, "position_tolerance", least=LEAST, most=MOST, kind="a length in m", error=QueryError)
        set_reals(self, "angle_tolerance", least=LEAST, most=math.pi, kind="an angle in rad", error=QueryError)
        if self.approach is not None:
            object.__setattr__(self, "approach", Approach.from_spec("", self.approach).described())

    def __str__(self) -> str:
        """Return the position and the orientation as short text for messages."""
        turned = ""
        if self.yaw_pitch_roll is not None:
            yaw, pitch, roll = (f"{math.degrees(angle):.4g}" for angle in self.yaw_pitch_roll)
            turned = f", yaw {yaw}, pitch {pitch} and roll {roll} degrees"
        if self.direction is not None:
            turned = f" along {written(self.direction)}"
        straight = "" if self.straight is None else f", {self.straight}"
        return f"{self.name} {written(self.position)}{turned}{straight}"

    @property
    def requires(self) -> frozenset[str]:
        """Return the capabilities that a model must provide: the body, and joints for a straight approach."""
        return frozenset({self.body}) if self.approach is None else frozenset({self.body, "joints"})

    @cached_property
    def straight(self) -> Approach | None:
        """Return the straight approach, or None."""
        return None if self.approach is None else Approach.from_spec(self.body, self.approach)

    @property
    def places(self) -> tuple[Place, ...]:
        """Return the positions that pictures mark; here only one, that of the goal."""
        return (self.position,)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds (k,), all 0: the coordinates must be 0, within the tolerances."""
        return np.zeros(self.lengths.size), np.zeros(self.lengths.size)

    @property
    def lengths(self) -> BoolArray:
        """Mask (k,) of the coordinates in m: the three of the position."""
        angles = 3 if self.yaw_pitch_roll is not None else 2 if self.direction is not None else 0
        return np.array([True] * 3 + [False] * angles)

    @property
    def tolerances(self) -> tuple[float, float]:
        """Return the tolerances of position, m, and orientation, rad."""
        return self.position_tolerance, self.angle_tolerance

    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Return the offset (x, y, z) of the body from the position, m, and how far it must still turn, rad.

        The latter is a rotation vector for yaw_pitch_roll, two angles (:func:`off_axis`) for a direction, else nothing.
        """
        x, y, z = self.position
        apart = (pose.x - x, pose.y - y, pose.z - z)
        if self._axes is not None:
            return *apart, *turn_to(pose, self._axes)
        return (*apart, *off_axis(pose, self.direction)) if self.direction is not None else apart

    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """Return the rates (M,) of the coordinates, m/s and rad/s."""
        if self._axes is not None:
            return *twist.velocity, *turn_to_rates(pose, twist, self._axes)
        if self.direction is not None:
            return *twist.velocity, *off_axis_rates(pose, twist, self.direction, (0.0, 0.0, 0.0))
        return twist.velocity

    @cached_property
    def _axes(self) -> Axes | None:
        """Return the axes ahead, left and up that yaw_pitch_roll demands; None without yaw_pitch_roll."""
        if self.yaw_pitch_roll is None:
            return None
        (cy, cp, cr), (sy, sp, sr) = (tuple(map(f, self.yaw_pitch_roll)) for f in (math.cos, math.sin))
        left, up = (-sy, cy, 0.0), (-sp * cy, -sp * sy, cp)  # before the roll
        return (cp * cy, cp * sy, sp), _linear_combination(cr, left, sr, up), _linear_combination(cr, up, -sr, left)


def _linear_combination(a: float, one: Vector, b: float, other: Vector) -> Vector:
    x, y, z = (a * p + b * q for p, q in zip(one, other, strict=True))
    return x, y, z


@goal("camera_at")
@dataclass(frozen=True)
class CameraAt(PoseAt):
    """Goal of a camera at a position, in a given orientation.

    position            m    (x, y, z)
    yaw_pitch_roll      rad  yaw counter-clockwise, then pitch up, then roll to the right
    direction                (x, y, z) of the view, with any roll. Give either this or yaw_pitch_roll; with neither, the
                             camera may look anywhere
    position_tolerance  m    largest error of the position
    angle_tolerance     rad  largest error of the orientation
    approach                 straight approach over the last metres: {"distance": 0.1, "axis": (1, 0, 0)} moves it along
                             its own x axis, {"distance": 0.1, "direction": (0, 0, -1)} down. Two more keys:
                             ``tolerance``, how far it may stray from the line, 0.002 m by default; ``angle``, rad, how
                             far it may turn, 2 degrees by default
    """

    @property
    def body(self) -> str:
        """Return the name of the body: the camera."""
        return "camera"


@goal("tool_at")
@dataclass(frozen=True)
class ToolAt(PoseAt):
    """Goal of a tool, or of another body, at a position, in a given orientation.

    position            m    (x, y, z)
    yaw_pitch_roll      rad  yaw counter-clockwise, then pitch up, then roll to the right
    direction                (x, y, z) in which the body points, with any roll. Give either this or yaw_pitch_roll; with
                             neither, the body may point anywhere
    position_tolerance  m    largest error of the position
    angle_tolerance     rad  largest error of the orientation
    approach                 straight approach over the last metres: {"distance": 0.1, "axis": (1, 0, 0)} moves it along
                             its own x axis, {"distance": 0.1, "direction": (0, 0, -1)} down. Two more keys:
                             ``tolerance``, how far it may stray from the line, 0.002 m by default; ``angle``, rad, how
                             far it may turn, 2 degrees by default
    body                     name of the body in the model
    """

    body: str = "tool"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.body, str) or not self.body:
            raise QueryError(f"body must be the name of a body of the model, such as 'tool', got {shown(self.body)}")
