"""Orientation retention: how well a viewer who remembers each turn as a round angle still knows the heading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import wrap
from hpop.base.options import LEAST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.trajectories.history import History

TIE = 1e-9  # share of a multiple: a turn this near to halfway between two multiples counts as halfway


@dataclass(frozen=True)
class _RoundTurns:
    """Error of a viewer who remembers each turn as the nearest multiple of ``multiple``, rad.

    Of two equally near multiples, the smaller one is remembered.
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
        """Return, for each motion (M,), how far the turns that end in it are from multiples of ``multiple``, rad."""
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

    e_k is as in :class:`OrientationRetention`, except that consecutive motions that turn the camera, to either side,
    count as one turn, which a motion without rotation ends. Errors of opposite sign cancel. Unit rad; a criterion of
    the whole trajectory, so graph searches report it but cannot minimise it.
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
