"""Number of turns: the paper's N."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions

LEAST_TURN = np.deg2rad(1.0)  # rad: a smaller change of heading is no turn


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
    """N, the number of turns of more than one degree, whatever their angle; those at start and goal count.

    Turns are the camera's, about the vertical, whatever makes them: its base, or a head that pans. A tilt is none.

    Becerra et al. 2020 (arXiv 2002.10696): few and fast rotations spare the semicircular canals. A turn in place is one
    motion and one turn: the paper's N where turns are made in one go, as planners here make them; two turns in place in
    succession count twice. Along curves a turn is a maximal stretch in which the heading changes with one sign, however
    it is cut into motions: a change of sign begins another, and so does going straight for a while. A curve on a graph,
    or alone, knows no neighbours and is counted as if the heading stayed the same before and after.
    """

    def cost(self, m: Motions) -> Column:
        """Number (M,) of turns that end in each motion."""
        return sum(np.where(np.abs(turn) > LEAST_TURN, 1.0, 0.0) for turn in m.camera.turns)
