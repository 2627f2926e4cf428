"""To look at something from a suitable distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import dot, hypot, norm, wrap
from hpop.base.options import LEAST, MOST, Angle, real, set_reals
from hpop.errors import QueryError
from hpop.goals.base import REACHED, goal
from hpop.goals.bearing import LEAST as CLOSEST
from hpop.goals.bearing import off_axis, off_axis_rates, roll_of, roll_rate
from hpop.goals.region import DEGREE, Place, Region, checked_angle, checked_numbers, checked_place, written
from hpop.motions import Pose, Twist, Vector


@goal("look_at")
@dataclass(frozen=True)
class LookAt(Region):
    """The camera looks at a target from within a band of distances.

    target           m    (x, y, z), in the middle of the view
    distance         m    (least, greatest) from the camera to it
    roll             rad  of the camera to the right, 0 with the horizon level; None leaves it free. It says nothing of
                          a camera that looks straight up or down, within 1e-6 rad
    angle_tolerance  rad  by how much the view may be off, the target from its middle and the roll together

    Whether something stands between camera and target is for a criterion to say (``occlusion``); an answer notes where
    nothing of the target is seen.
    """

    target: tuple[float, float, float]
    distance: tuple[float, float]
    roll: Angle | None = None
    angle_tolerance: Angle = DEGREE

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", checked_place("target", self.target))
        form = "(least, greatest) distance in m"
        least, most = checked_numbers("distance", self.distance, 2, form)
        for one in (least, most):
            real("distance", one, LEAST, MOST, f"{form}, each", error=QueryError)
        if least > most:
            raise QueryError(f"distance is {form}, the least first, got {written((least, most))}")
        object.__setattr__(self, "distance", (least, most))
        if self.roll is not None:
            object.__setattr__(self, "roll", checked_angle("roll", self.roll))
        set_reals(self, "angle_tolerance", least=LEAST, most=math.pi, kind="an angle in rad", error=QueryError)

    def __str__(self) -> str:
        """What is looked at, and from how far."""
        rolled = "" if self.roll is None else f", rolled {math.degrees(self.roll):.4g} degrees"
        return f"look_at {written(self.target)} from {self.distance[0]:.4g} to {self.distance[1]:.4g} m{rolled}"

    @property
    def body(self) -> str:
        """The camera."""
        return "camera"

    @property
    def looked_at(self) -> Place:
        """The target."""
        return self.target

    @property
    def places(self) -> tuple[Place, ...]:
        """The target."""
        return (self.target,)

    @property
    def widened(self) -> tuple[str, ...]:
        """Distance and tolerance."""
        return "distance", "angle_tolerance"

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The band, and nothing off the middle."""
        still = [0.0] * (2 if self.roll is None else 3)
        return np.array([self.distance[0], *still]), np.array([self.distance[1], *still])

    @property
    def lengths(self) -> BoolArray:
        """The distance."""
        return np.array([True, False, False, *([] if self.roll is None else [False])])

    @property
    def tolerances(self) -> tuple[float, float]:
        """None in distance, which is a band."""
        return REACHED, self.angle_tolerance

    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Distance, angles to the left and above the middle, and by how much the roll is off."""
        offset = self._offset(pose)
        return norm(offset), *off_axis(pose, offset), *(() if self.roll is None else (self._off_roll(pose),))

    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """How fast these change."""
        offset = self._offset(pose)
        x, y, z = (-part for part in twist.velocity)
        approach = dot(offset, (x, y, z)) / np.maximum(norm(offset), CLOSEST)
        rolled = () if self.roll is None else (roll_rate(pose, twist),)
        return approach, *off_axis_rates(pose, twist, offset, (x, y, z)), *rolled

    def _off_roll(self, pose: Pose) -> Column:
        """By how much the roll is off: by nothing where the camera shows no horizon."""
        off_vertical = np.arctan2(hypot(pose.left[2], pose.up[2]), np.abs(pose.ahead[2]))
        return np.where(off_vertical <= REACHED, 0.0, wrap(roll_of(pose) - self.roll))

    def _offset(self, pose: Pose) -> Vector:
        """From the camera to the target, m."""
        x, y, z = self.target
        return x - pose.x, y - pose.y, z - pose.z
