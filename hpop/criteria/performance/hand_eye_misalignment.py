"""Hand-eye misalignment: how far what the hand does is turned against what the eye sees."""

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
    """∫ |log(R_handᵀ R_eye)| dt: the angle of the rotation from the operator's hand to the camera's view, rad.

    yaw  rad  what the operator's hand takes for ahead, in the world: commands are given in a level frame of this yaw

    An operator who moves a hand ahead and sees the picture go aside has to turn one into the other in mind. Wu, Yu, Do
    and Wang (arXiv 2105.08466) measured it with a camera on the hand of the robot: at a right angle people took twice
    as long as upside down, and both far longer than aligned. R_eye is the camera's orientation and R_hand that of the
    commands, so the angle is 0 where the camera looks along ``yaw``, level and upright, and π at most.

    Deviation: the cost grows with the angle throughout, though half a turn is easier than a right angle: a cost that
    fell beyond it would lead the camera there. Commands that are given in the camera's own frame have none of this.
    """

    yaw: Angle = 0.0

    def __post_init__(self) -> None:
        set_reals(self, "yaw", least=-2 * math.pi, most=2 * math.pi, kind="an angle in rad", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,), rad s."""
        cos, sin = round(math.cos(self.yaw), 15), round(math.sin(self.yaw), 15)
        hand = (cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)

        def angle(s: Instants) -> Column:
            return rotation_angle(hand, (s.camera.ahead, s.camera.left, s.camera.up))

        return m.integrate(angle)


def rotation_angle(one: tuple[Vector, Vector, Vector], other: tuple[Vector, Vector, Vector]) -> Column:
    """Angle, rad in [0, pi], of the rotation that takes three axes to others.

    Half the sum of the axes' cross products is as long as its sine, and the sum of their products is 1 + 2 cosines.
    """
    products = [cross(a, b) for a, b in zip(one, other, strict=True)]
    normal = [_half_of(components) for components in zip(*products, strict=True)]
    cosine = 0.5 * (sum(dot(a, b) for a, b in zip(one, other, strict=True)) - 1.0)
    return np.arctan2(sine_of(normal), cosine)


def _half_of(components: Sequence[Column]) -> Column:
    """Half the sum of columns; the number 0.0 where all are known to be zero."""
    return 0.0 if all(map(is_zero, components)) else 0.5 * sum(components)
