"""Orientation of viewer and operator: turns that are hard to remember, and views turned from the frame of commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import cross, dot, is_zero, sine_of, wrap
from hpop.base.options import LEAST, Angle, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions, Vector
from hpop.trajectories.history import History

TIE = 1e-9  # share of a multiple: a turn this near to halfway between two multiples counts as halfway


@dataclass(frozen=True)
class _RoundTurns:
    """Error of a viewer who remembers each turn as the nearest multiple of ``multiple``, rad.

    Of two equally near multiples, the one nearer to 0 is remembered: with pi/2, a turn of 3 pi/4 as pi/2.
    """

    multiple: float = np.pi / 2  # rad, turns by multiples of it are remembered exactly

    def __post_init__(self) -> None:
        kind = "an angle in rad, such as pi/4 or pi/2,"
        set_reals(self, "multiple", least=LEAST, most=np.pi, kind=kind, error=CriterionError)

    def _angle_to_multiple(self, turn: Column) -> Column:
        """Return the signed difference (M,), rad, from the nearest multiple of ``multiple`` to a turn."""
        count = np.ceil(np.abs(turn) / self.multiple - 0.5 - TIE)
        return np.sign(turn) * (np.abs(turn) - self.multiple * count)


@criterion(
    "orientation_retention",
    group="P",
    unit="rad",
    aggregate="sum",
    requires=("camera", "heading"),
    smooth=False,
    instead=("rotation", "camera_roll"),
)
@dataclass(frozen=True)
class OrientationRetention(_RoundTurns):
    """Rotation that a viewer loses track of: Σ_k |e_k|, where e_k is the error in remembering the camera's turn θ_k.

    Turns by multiples of 90 degrees (or 45; the option ``multiple``) are easy to remember. Any other turn is remembered
    as the nearest multiple, and e_k is the difference between θ_k and this multiple. Unit rad; a sum over motions, so
    exact searches can minimise it. It is an upper bound on the final error |Σ e_k| (:class:`NetMisalignment`), in which
    errors may cancel. The definition is this project's own.

    Each motion in place is one turn, so a turn that is planned in two motions counts as two. Along curves a turn is a
    stretch in which the heading changes with one sign, as in ``turns``.
    """

    def cost(self, m: Motions) -> Column:
        """Return, for each motion (M,), the sum of |e_k|, rad, over the turns that end in it."""
        return sum(np.abs(self._angle_to_multiple(turn)) for turn in m.camera.turns)


@criterion(
    "net_misalignment",
    group="P",
    unit="rad",
    aggregate="trajectory",
    requires=("camera", "heading"),
    smooth=False,
    instead=("heading_mismatch", "hand_eye_misalignment"),
)
@dataclass(frozen=True)
class NetMisalignment(_RoundTurns):
    """Error of the viewer's idea of the heading at the end of the trajectory: |wrap(Σ_k e_k)|.

    The viewer remembers turn k of the camera, θ_k, as the nearest multiple of the option ``multiple``; e_k is θ_k minus
    this multiple. Motions that turn the camera, one directly after another, are one turn: θ_k is the sum of their
    rotations, those to the left positive, those to the right negative. A motion without rotation ends the turn. Errors
    of opposite sign cancel. Unit rad; a criterion of the whole trajectory, so graph searches report it but cannot
    minimise it.
    """

    def cost(self, m: History) -> Column:
        """Return the error of the viewer's idea of the heading (M,), rad, at the end of each motion."""
        turned = m.of_motions(lambda batch: batch.camera.rotation)
        turning = np.abs(turned) > TIE
        so_far = self._angle_to_multiple(_since_last(turning, turned)) * turning
        complete = so_far * (turning & ~np.append(turning[1:], False))
        return np.abs(wrap(np.cumsum(complete) - complete + so_far))


def _since_last(turning: BoolArray, turned: FloatArray) -> FloatArray:
    """Return, for each motion, the rotation (M,), rad, since the last motion before it that did not turn the camera.

    It includes the motion itself, and is 0 for a motion that does not turn the camera.

    turning  (M,)  whether each motion turns the camera
    turned   (M,)  rad, rotation in each motion
    """
    total = np.concatenate([[0.0], np.cumsum(turned)])
    still = np.where(turning, 0, np.arange(1, turning.size + 1))
    since: FloatArray = total[1:] - total[np.maximum.accumulate(still)]
    return since


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
