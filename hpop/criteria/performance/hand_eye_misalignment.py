"""Hand-eye misalignment: the rotation between the frame of an operator's commands and the camera's view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import cross, dot, is_zero, sine_of
from hpop.base.options import Angle, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions, Vector


@criterion("hand_eye_misalignment", group="P", unit="rad s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class HandEyeMisalignment:
    """Rotation between the operator's commands and the camera's view, over time: ∫ |log(R_handᵀ R_eye)| dt.

    yaw  rad  direction in the world that the operator's hand regards as ahead; commands are given in a level frame with
              this yaw

    R_eye is the orientation of the camera and R_hand that of the frame of the commands. The integrand is the angle of
    the rotation between them, rad in [0, π]. It is 0 if the camera is level and upright and looks along ``yaw``. Unit
    rad s; a sum over motions.

    Source: Wu, Yu, Do and Wang (arXiv 2105.08466) used a camera on the robot's hand. An operator who moves a hand ahead
    and sees the picture go sideways has to rotate one into the other mentally. With a camera at a right angle people
    took twice as long as with one upside down, and in both cases far longer than with an aligned one.

    Deviation: the cost grows with the angle up to π, although people manage half a turn better than a right angle. If
    the cost fell beyond a right angle, it would draw the camera towards half a turn. If commands are given in the
    camera's own frame, this criterion does not apply.
    """

    yaw: Angle = 0.0

    def __post_init__(self) -> None:
        set_reals(self, "yaw", least=-2 * math.pi, most=2 * math.pi, kind="an angle in rad", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the angle (M,), rad s."""
        cos, sin = round(math.cos(self.yaw), 15), round(math.sin(self.yaw), 15)
        hand = (cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)

        def angle(s: Instants) -> Column:
            return rotation_angle(hand, (s.camera.ahead, s.camera.left, s.camera.up))

        return m.integrate(angle)


def rotation_angle(before: tuple[Vector, Vector, Vector], after: tuple[Vector, Vector, Vector]) -> Column:
    """Return the angle γ, rad in [0, pi], of the rotation that turns three axes ``before`` into three axes ``after``.

    Half the sum of the cross products of the axes has the length sin γ; the sum of their dot products is 1 + 2 cos γ.
    """
    products = [cross(a, b) for a, b in zip(before, after, strict=True)]
    normal = [_half_of(components) for components in zip(*products, strict=True)]
    cosine = 0.5 * (sum(dot(a, b) for a, b in zip(before, after, strict=True)) - 1.0)
    return np.arctan2(sine_of(normal), cosine)


def _half_of(components: Sequence[Column]) -> Column:
    """Return half the sum of columns; the number 0.0 if all of them are the number 0."""
    return 0.0 if all(map(is_zero, components)) else 0.5 * sum(components)
