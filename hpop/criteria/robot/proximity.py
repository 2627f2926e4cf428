"""Proximity: how long a way the robot goes how near to obstacles."""

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
    """∫ ds / max(d, least): metres of the base's path, each divided by its clearance d in metres.

    The path integral of the reciprocal clearance is the usual additive partner of the worst one, for example in OMPL's
    tutorial on optimal planning (Sucan, Moll, Kavraki, "The Open Motion Planning Library", IEEE RAM 2012). It is taken
    over the path, not over time, so standing and turning in place cost nothing.

    Deviations: d is capped from below at ``least``, so that the cost stays finite; and d is read from the world's
    clearance field, on numbers as on symbols, which is within 0.82 of a field cell of the exact distance (see
    ``clearance``): among boxes the cost is within 1 % of that of exact distances. The quadrature, whose panels are no
    longer than half of ``least`` (but no shorter than an eighth of a field cell), adds 1e-3 at most where a way runs
    into an obstacle, at the edge of the cap.
    """

    least: float = 0.1  # m

    def __post_init__(self) -> None:
        set_reals(self, "least", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Reciprocal clearance along each motion (M,)."""
        if m.base.stays:
            return 0.0 * m.duration  # in place: no way is gone
        clearance = m.world.clearance_field()

        def rate(s: Instants) -> Column:
            return smooth_abs(s.speed) / np.maximum(clearance(s.base.x, s.base.y), self.least)

        return m.integrate(rate, detail=self.least)
