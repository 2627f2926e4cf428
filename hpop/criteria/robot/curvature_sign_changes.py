"""Curvature sign changes: how often the path changes from bending to one side to bending to the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort.turns import LEAST_TURN
from hpop.errors import CriterionError
from hpop.trajectories.history import History


@criterion(
    "curvature_sign_changes",
    group="R",
    unit="1",
    aggregate="trajectory",
    requires=("base", "heading"),
    smooth=False,
    quantum=1.0,
    instead=("turns",),
)
@dataclass(frozen=True)
class CurvatureSignChanges:
    """Number of times that the path changes its bending side: the number of sign changes of the curvature κ.

    Unit 1; a criterion of the whole trajectory. Source: Becerra et al. 2020 (arXiv 2002.10696), who chose the one of
    1000 RRT trajectories with the fewest sign changes.

    κ is the change of the base's heading per metre. Each stretch between turns in place is cut into equal pieces of at
    most ``spacing`` metres. A piece with |κ| < ``least`` counts as straight and is ignored: left, straight, left is no
    sign change. A turn in place of more than one degree counts as a bend to its side, whatever its angle. The heading
    is taken to change evenly within each motion.
    """

    spacing: float = 0.25  # m, largest length of a piece
    least: float = 0.05  # 1/m, curvature below which a piece counts as straight

    def __post_init__(self) -> None:
        set_reals(self, "spacing", least=0.001, most=MOST, kind="a positive length in m", error=CriterionError)
        set_reals(self, "least", least=0, most=MOST, kind="a curvature per metre", error=CriterionError)

    def cost(self, m: History) -> Column:
        """Return the number of sign changes (M,) up to the end of each motion."""
        length = m.of_motions(lambda motions: motions.base.length)
        rotation = m.of_motions(lambda motions: motions.base.rotation)
        in_place = (length == 0) & (rotation != 0)  # a hold does not end a stretch
        stretch = np.cumsum(np.diff(in_place, prepend=in_place[0]))  # (M,) number of each motion's stretch
        motions, signs = [], []
        for number in range(stretch[-1] + 1):
            (index,) = np.nonzero(stretch == number)
            if in_place[index[0]]:
                motions.append(index)
                signs.append(np.where(np.abs(rotation[index]) > LEAST_TURN, np.sign(rotation[index]), 0.0))
            else:
                ends, bends = self._bends(length[index], rotation[index])
                motions.append(index[ends])
                signs.append(bends)
        motion, sign = np.concatenate(motions), np.concatenate(signs)
        motion, sign = motion[sign != 0], sign[sign != 0]
        flips = motion[1:][np.diff(sign) != 0]
        return np.cumsum(np.bincount(flips, minlength=len(m)))

    def _bends(self, length: FloatArray, rotation: FloatArray) -> tuple[IntArray, FloatArray]:
        """Cut a stretch into P pieces; return for each the motion in which it ends, and the sign of its curvature.

        length, rotation  m and rad, of the motions of the stretch
        """
        arc_length = np.concatenate([[0.0], np.cumsum(length)])
        heading = np.concatenate([[0.0], np.cumsum(rotation)])
        cuts = np.linspace(0.0, arc_length[-1], int(np.ceil(arc_length[-1] / self.spacing - 1e-9)) + 1)
        curvature = np.diff(np.interp(cuts, arc_length, heading)) / np.diff(cuts)
        ends = np.minimum(np.searchsorted(arc_length[1:], cuts[1:] * (1.0 - 1e-12)), length.size - 1)
        return ends, np.where(np.abs(curvature) >= self.least, np.sign(curvature), 0.0)
