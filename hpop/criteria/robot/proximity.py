"""Proximity: the length of the path, weighted by the nearness of obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import smooth_abs
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions


@criterion("proximity", group="R", unit="1", aggregate="sum", requires=("base",), instead=("clearance",))
@dataclass(frozen=True)
class Proximity:
    """Length of the base's path, each metre divided by the clearance there, in metres: ∫ ds / max(d, least).

    d is the clearance of the base. Unit 1; a sum over motions. The integral is over the path, not over time, so
    standing and turning in place cost nothing.

    Source: the path integral of the reciprocal clearance is the usual additive cost beside the smallest clearance, for
    example in OMPL's tutorial on optimal planning (Sucan, Moll, Kavraki, "The Open Motion Planning Library", IEEE RAM
    2012).

    Deviations: d counts as at least ``least``, so that the cost is finite. It is read from the world's distance grid,
    also in nonlinear programs, and differs from the exact distance by at most 0.82 of a cell. Among
    boxes the cost is within 1 % of that of exact distances. Quadrature intervals are at most half of ``least`` long,
    but at least an eighth of a cell. If a path runs into an obstacle, where d falls below ``least``, their error is at
    most 1e-3.
    """

    least: float = 0.1  # m, smallest clearance by which the path is divided

    def __post_init__(self) -> None:
        set_reals(self, "least", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the integral of the reciprocal clearance along each motion (M,)."""
        if m.base.stays:
            return 0.0 * m.duration  # a turn in place has no path
        clearance = m.world.clearance_field()

        def rate(s: Instants) -> Column:
            return smooth_abs(s.speed) / np.maximum(clearance(s.base.x, s.base.y), self.least)

        return m.integrate(rate, detail=self.least)
