"""Orientation retention: whether a viewer who remembers turns in round numbers still knows the heading."""

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

TIE = 1e-9  # share of a multiple; a turn within it of halfway counts as halfway


@dataclass(frozen=True)
class _RoundTurns:
    """Error of a viewer who remembers each turn as the nearest ``multiple``, rad (halfway: the smaller one)."""

    multiple: float = np.pi / 2  # rad, turns by multiples of it are remembered exactly

    def __post_init__(self) -> None:
        kind = "an angle in rad, such as pi/4 or pi/2,"
        set_reals(self, "multiple", least=LEAST, most=np.pi, kind=kind, error=CriterionError)

    def _angle_to_multiple(self, turn: Column) -> Column:
        """Return the signed angle (M,), rad, from the nearest multiple to a turn; at most half a multiple."""
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
    """Rotation that a viewer loses track of: Σ_k |e_k|, e_k = θ_k - the nearest multiple of ``multiple`` to θ_k.

    θ_k are the camera's turns. Turns by 90 degrees (or 45) are easy to remember; any other turn is remembered as the
    nearest one, so each turn makes the viewer's idea of the heading wrong by e_k. Unit rad; a sum over motions, so
    exact searches can minimise it. It is an upper bound of the final error |Σ e_k| (:class:`NetMisalignment`), in which
    errors may cancel. The definition is this project's own.

    Each turn in place is one turn; a turn that is planned in two pieces counts as two. Along curves a turn is a stretch
    in which the heading changes with one sign, as in ``turns``.
    """

    def cost(self, m: Motions) -> Column:
        """Return the angles (M,), rad, that turns ending in each motion are off the nearest multiple."""
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
    """Error of the viewer's idea of the heading at the end: |wrap(Σ_k e_k)|.

    e_k is as in :class:`OrientationRetention`, except that consecutive motions that turn the camera, to either side,
    are one turn. A move without rotation ends the turn. Errors of opposite sign cancel. Unit rad; a criterion of the
    whole trajectory, so graph searches report it and do not minimise it.
    """

    def cost(self, m: History) -> Column:
        """Return the misalignment (M,), rad, at the end of each motion."""
        turned = m.of_motions(lambda batch: batch.camera.rotation)
        turning = np.abs(turned) > TIE
        so_far = self._angle_to_multiple(_since_last(turning, turned)) * turning
        complete = so_far * (turning & ~np.append(turning[1:], False))
        return np.abs(wrap(np.cumsum(complete) - complete + so_far))


def _since_last(turning: BoolArray, turned: FloatArray) -> FloatArray:
    """Return the rotation (M,), rad, since the last motion that did not turn."""
    total = np.concatenate([[0.0], np.cumsum(turned)])
    still = np.where(turning, 0, np.arange(1, turning.size + 1))
    since: FloatArray = total[1:] - total[np.maximum.accumulate(still)]
    return since
