"""Number of turns: the paper's N."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions

LEAST_TURN = np.deg2rad(1.0)  # rad: a smaller change of heading is no turn


@criterion("turns", group="C", unit="1", aggregate="sum", smooth=False, quantum=1.0)
@dataclass(frozen=True)
class Turns:
    """N, the number of turning motions, whatever their angle; those at start and goal count.

    Becerra et al. 2020 (arXiv 2002.10696): few and fast rotations spare the semicircular canals. A motion counts when
    it turns the base by more than one degree. That is the paper's N where turns are made in one go, as planners here
    make them; two turns in succession count twice, and a curve cut into pieces of less than a degree would not count.
    """

    def cost(self, m: Motions) -> Column:
        """1 for each motion (M,) that turns, else 0."""
        return np.where(m.base.turned > LEAST_TURN, 1.0, 0.0)
