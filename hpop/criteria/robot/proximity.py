"""Proximity: the length of path near obstacles."""

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
    """Path of the base, each metre divided by its clearance in metres: ∫ ds / max(d, least).

    d is the clearance of the base. Unit 1; a sum over motions. The integral is over the path, not over time, so
    standing and turning in place cost nothing.

    Source: the path integral of the reciprocal clearance is the usual additive partner of the least clearance, for
    example in OMPL's tutorial on optimal planning (Sucan, Moll, Kavraki, "The Open Motion Planning Library", IEEE RAM
    2012).

    Deviations: d is at least ``least``, so that the cost stays finite. On numbers and on symbols d is read from the
    world's clearance field, which is within 0.82 of a field cell of the exact distance (see ``clearance``): among boxes
    the cost is within 1 % of that of exact distances. Quadrature panels are no longer than half of ``least`` (but no
    shorter than an eighth of a field cell); where a path runs into an obstacle, at the edge of the cap, they add at
    most 1e-3.
    """

    least: float = 0.1  # m, smallest clearance by which the path is divided

    def __post_init__(self) -> None:
        set_reals(self, "least", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the integral of the reciprocal clearance along each motion (M,)."""
        if m.base.stays:
            return 0.0 * m.duration  # in place: no path
        clearance = m.world.clearance_field()

        def rate(s: Instants) -> Column:
            return smooth_abs(s.speed) / np.maximum(clearance(s.base.x, s.base.y), self.least)

        return m.integrate(rate, detail=self.least)
