"""Number of turns of the camera: the cost N of Becerra et al. 2020."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions

LEAST_TURN = np.deg2rad(1.0)  # rad: smaller changes of heading are not counted


@criterion(
    "turns",
    group="C",
    unit="1",
    aggregate="sum",
    requires=("camera",),
    smooth=False,
    quantum=1.0,
    role="turns",
)
@dataclass(frozen=True)
class Turns:
    """Number of turns of more than one degree, whatever their angle.

    A turn is a rotation of the camera about the vertical, by its base or by a head that pans. Tilts do not count; turns
    at start and goal do. Unit 1; a sum over motions. Source: the cost N of Becerra et al. 2020 (arXiv 2002.10696): few
    and fast rotations spare the semicircular canals.

    Each motion in place counts as one turn, so two turns in place in succession count twice. Planners of hpop make each
    turn in one motion, as the paper does. Along curves a turn is the longest stretch in which the heading changes with
    one sign, however the curve is cut into motions. A change of sign begins another turn, and so does a straight
    stretch. The cost of a curve by itself, for example as an edge of a graph, assumes a constant heading before and
    after it.
    """

    def cost(self, m: Motions) -> Column:
        """Return the number (M,) of turns that end in each motion."""
        return sum(np.where(np.abs(turn) > LEAST_TURN, 1.0, 0.0) for turn in m.camera.turns)
