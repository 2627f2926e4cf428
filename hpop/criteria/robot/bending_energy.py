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
    """Bending energy of the base's path: ∫ κ² ds, where κ is its curvature and corners are rounded to arcs.

    Unit 1/m; a sum over motions. The base drives in the direction of its heading, so the curvature is its rotation per
    metre. Along curves with speed v and yaw rate ω the cost is the integral of ω²/max(|v|, rounding |ω|) over time. In
    straight moves, turns in place and arcs the curvature is constant.

    A sharp corner would have an infinite cost. So a turn in place by Δθ costs |Δθ|/rounding, as much as an arc with the
    radius ``rounding``. This also holds at start and goal, and if the segments beside the turn are too short for the
    arc. A motion that bends more sharply than the radius ``rounding`` costs as much as that arc: a motion of length L
    costs Δθ²/max(L, rounding |Δθ|). Polylines are therefore ranked by their total rotation, so also use the criterion
    ``turns``.

    Source: the energy of a thin rod along the path (Euler's elastica; Horn, "The curve of least energy", ACM TOMS 9(4),
    1983).
    """

    rounding: float = 0.5  # m

    def __post_init__(self) -> None:
        set_reals(self, "rounding", least=LEAST, most=MOST, kind="a positive radius in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,) of the squared curvature, 1/m."""
        if isinstance(m.law, Curve):
            return m.integrate(lambda s: self._bent(np.abs(s.turn_rate), np.abs(s.speed)))
        return self._bent(m.base.turned, m.base.length)

    def _bent(self, turned: Column, length: Column) -> Column:
        """Return turned²/max(length, rounding turned): the cost of whole motions, or the cost per second.

        turned  absolute rotation, rad, or yaw rate, rad/s
        length  m, or speed, m/s
        """
        stretch = np.maximum(length, self.rounding * turned)
        bends = stretch > 0
        return np.where(bends, turned * turned / np.where(bends, stretch, 1.0), 0.0)
