"""Orientation retention: whether a viewer who feels turns in round numbers still knows where they face."""

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

TIE = 1e-9  # turns within this share of a multiple's half count as halfway


@dataclass(frozen=True)
class _RoundTurns:
    """A viewer who remembers each turn as the nearest ``multiple``, rad (halfway: the smaller one)."""

    multiple: float = np.pi / 2  # rad, turns by multiples of it are kept count of

    def __post_init__(self) -> None:
        kind = "an angle in rad, such as pi/4 or pi/2,"
        set_reals(self, "multiple", least=LEAST, most=np.pi, kind=kind, error=CriterionError)

    def _missed(self, turn: Column) -> Column:
        """Signed angle (M,), rad, by which a turn goes beyond the nearest multiple; at most half a multiple."""
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
    """Σ_k |e_k|, e_k = θ_k - the nearest multiple of ``multiple`` to θ_k, over the camera's turns θ_k.

    Turns by 90 degrees (or 45) are easy to keep count of; others are remembered as the nearest one, so the viewer's
    idea of where they face goes wrong by e_k. The definition is the project's own.
    It is a sum, so exact searches can minimise it, and it bounds the misalignment |Σ e_k| in the end
    (:class:`NetMisalignment`), in which errors may cancel and which needs memory. Each turn in place is one turn: one
    planned in two pieces counts as two. Along curves a turn is a stretch in which the heading changes with one sign,
    as in ``turns``.
    """

    def cost(self, m: Motions) -> Column:
        """What the turns that end in each motion (M,) go beyond the nearest multiple, rad."""
        return sum(np.abs(self._missed(turn)) for turn in m.camera.turns)


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
    """|wrap(Σ_k e_k)|: by how much the viewer is wrong in the end about where they face.

    e_k is as in :class:`OrientationRetention`, but here a turn is a maximal stretch of motions that turn the camera one
    after the other, either way; a move without rotation ends it. Errors of either sign cancel.
    """

    def cost(self, m: History) -> Column:
        """Misalignment (M,), rad, at the end of each motion."""
        turned = m.of_motions(lambda batch: batch.camera.rotation)
        turning = np.abs(turned) > TIE
        so_far = self._missed(_since_last(turning, turned)) * turning
        complete = so_far * (turning & ~np.append(turning[1:], False))
        return np.abs(wrap(np.cumsum(complete) - complete + so_far))


def _since_last(turning: BoolArray, turned: FloatArray) -> FloatArray:
    """Rotation (M,) since the last motion that did not turn, rad."""
    total = np.concatenate([[0.0], np.cumsum(turned)])
    still = np.where(turning, 0, np.arange(1, turning.size + 1))
    since: FloatArray = total[1:] - total[np.maximum.accumulate(still)]
    return since
