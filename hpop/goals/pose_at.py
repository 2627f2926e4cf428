"""To have a body somewhere, turned as it shall be: the camera, or a tool."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.options import LEAST, MOST, Angle, set_reals
from hpop.base.text import shown
from hpop.errors import QueryError
from hpop.goals.base import goal
from hpop.goals.bearing import Axes, off_axis, off_axis_rates, turn_to, turn_to_rates
from hpop.goals.region import DEGREE, Place, Region, checked_angle, checked_numbers, checked_place, written
from hpop.motions import Pose, Twist, Vector


@dataclass(frozen=True)
class PoseAt(Region):
    """A body at a place: in an orientation, along a direction and turned about it as may be, or turned anyhow."""

    position: tuple[float, float, float]
    yaw_pitch_roll: tuple[Angle, Angle, Angle] | None = None
    direction: tuple[float, float, float] | None = None
    position_tolerance: float = 1e-3
    angle_tolerance: Angle = DEGREE

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", checked_place("position", self.position))
        if self.yaw_pitch_roll is not None and self.direction is not None:
            raise QueryError(f"{self.name} takes yaw_pitch_roll, direction or neither, got both")
        if self.yaw_pitch_roll is not None:
            angles = checked_numbers("yaw_pitch_roll", self.yaw_pitch_roll, 3, "(yaw, pitch, roll) in rad")
            object.__setattr__(self, "yaw_pitch_roll", tuple(checked_angle("yaw_pitch_roll", one) for one in angles))
        if self.direction is not None:
            vector = checked_numbers("direction", self.direction, 3, "(x, y, z), a vector of any length")
            if math.hypot(*vector) < LEAST:
                raise QueryError(f"direction is (x, y, z), a vector of any length but 0, got {shown(self.direction)}")
            object.__setattr__(self, "direction", vector)
        set_reals(self, "position_tolerance", least=LEAST, most=MOST, kind="a length in m", error=QueryError)
        set_reals(self, "angle_tolerance", least=LEAST, most=math.pi, kind="an angle in rad", error=QueryError)

    def __str__(self) -> str:
        """Where the body is, and how it is turned."""
        turned = ""
        if self.yaw_pitch_roll is not None:
            yaw, pitch, roll = (f"{math.degrees(angle):.4g}" for angle in self.yaw_pitch_roll)
            turned = f", yaw {yaw}, pitch {pitch} and roll {roll} degrees"
        if self.direction is not None:
            turned = f" along {written(self.direction)}"
        return f"{self.name} {written(self.position)}{turned}"

    @property
    def places(self) -> tuple[Place, ...]:
        """Where the body is."""
        return (self.position,)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Nothing off: the tolerances are beside."""
        return np.zeros(self.lengths.size), np.zeros(self.lengths.size)

    @property
    def lengths(self) -> BoolArray:
        """The position."""
        angles = 3 if self.yaw_pitch_roll is not None else 2 if self.direction is not None else 0
        return np.array([True] * 3 + [False] * angles)

    @property
    def tolerances(self) -> tuple[float, float]:
        """Those that are given."""
        return self.position_tolerance, self.angle_tolerance

    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """By how much the body is off its place, and by which angles."""
        x, y, z = self.position
        apart = (pose.x - x, pose.y - y, pose.z - z)
        if self._axes is not None:
            return *apart, *turn_to(pose, self._axes)
        return (*apart, *off_axis(pose, self.direction)) if self.direction is not None else apart

    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """How fast these change."""
        if self._axes is not None:
            return *twist.velocity, *turn_to_rates(pose, twist, self._axes)
        if self.direction is not None:
            return *twist.velocity, *off_axis_rates(pose, twist, self.direction, (0.0, 0.0, 0.0))
        return twist.velocity

    @cached_property
    def _axes(self) -> Axes | None:
        """Ahead, left and up of the body, turned by the yaw, then up by the pitch, then right by the roll."""
        if self.yaw_pitch_roll is None:
            return None
        (cy, cp, cr), (sy, sp, sr) = (tuple(map(f, self.yaw_pitch_roll)) for f in (math.cos, math.sin))
        left, up = (-sy, cy, 0.0), (-sp * cy, -sp * sy, cp)  # before the roll
        return (cp * cy, cp * sy, sp), _mixed(cr, left, sr, up), _mixed(cr, up, -sr, left)


def _mixed(a: float, one: Vector, b: float, other: Vector) -> Vector:
    x, y, z = (a * p + b * q for p, q in zip(one, other, strict=True))
    return x, y, z


@goal("camera_at")
@dataclass(frozen=True)
class CameraAt(PoseAt):
    """The camera is at a place, turned as given.

    position            m    (x, y, z)
    yaw_pitch_roll      rad  yaw counter-clockwise, then pitch up, then roll to the right
    direction                (x, y, z) along which it looks, turned about that as may be; give this, or yaw_pitch_roll,
                             or neither: then it may look anywhere
    position_tolerance  m    how far it may be off
    angle_tolerance     rad  by how much it may be turned otherwise
    """

    @property
    def body(self) -> str:
        """The camera."""
        return "camera"


@goal("tool_at")
@dataclass(frozen=True)
class ToolAt(PoseAt):
    """A tool, or another body, is at a place, turned as given.

    position            m    (x, y, z)
    yaw_pitch_roll      rad  yaw counter-clockwise, then pitch up, then roll to the right
    direction                (x, y, z) along which it points, turned about that as may be; give this, or yaw_pitch_roll,
                             or neither: then it may point anywhere
    position_tolerance  m    how far it may be off
    angle_tolerance     rad  by how much it may be turned otherwise
    body                     as the model calls it
    """

    body: str = "tool"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.body, str) or not self.body:
            raise QueryError(f"body is the name of a body of the model, such as 'tool', got {shown(self.body)}")
