"""Bending energy: how much and how sharply the path bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Curve, Motions


@criterion(
    "bending_energy",
    group="R",
    unit="1/m",
    aggregate="sum",
    requires=("base", "heading"),
    instead=("rotation", "joint_energy"),
)
@dataclass(frozen=True)
class BendingEnergy:
    """∫ κ² ds of the base's path, with corners rounded to arcs of radius ``rounding`` metres.

    Bending energy is that of a thin rod along the path (Euler's elastica; Horn, "The curve of least energy", ACM TOMS
    9(4), 1983), and infinite at corners. So a turn in place by Δθ is charged as the arc that rounds it,
    |Δθ|/rounding, also at start and goal and where the segments beside it are too short for the arc; and a motion
    that bends more sharply than ``rounding`` is charged like that arc: the cost of a motion of length L is Δθ²/max(L,
    rounding |Δθ|). Among piecewise-linear trajectories it ranks as the total rotation does: count ``turns`` beside
    it.

    The base looks where it goes, so the curvature is its rotation a metre. Along curves the cost is the integral of
    ω²/max(|v|, rounding |ω|) over time. Within other motions the curvature is constant: straight moves, turns in place
    and arcs.
    """

    rounding: float = 0.5  # m

    def __post_init__(self) -> None:
        set_reals(self, "rounding", least=LEAST, most=MOST, kind="a positive radius in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Integral (M,) of the squared curvature, 1/m."""
        if isinstance(m.law, Curve):
            return m.integrate(lambda s: self._bent(np.abs(s.turn_rate), np.abs(s.speed)))
        return self._bent(m.base.turned, m.base.length)

    def _bent(self, turned: Column, length: Column) -> Column:
        """Squared rotation over the way that it takes, of whole motions or a second."""
        stretch = np.maximum(length, self.rounding * turned)
        bends = stretch > 0
        return np.where(bends, turned * turned / np.where(bends, stretch, 1.0), 0.0)
