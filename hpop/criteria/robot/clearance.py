"""Clearance: how near the robot comes to obstacles at its worst moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError
from hpop.motions import Motions
from hpop.options import LEAST, MOST, set_reals


@criterion("clearance", group="R", unit="m", aggregate="max", requires=("base",), quantum=1e-3)
@dataclass(frozen=True)
class Clearance:
    """max over t of (enough - d(p(t)))₊: by how much the base's axis comes nearer than ``enough`` metres.

    d is the distance to the nearest obstacle at any height, keep-out zone, person who stands, or border of the extent;
    the cost of a path with least clearance c is ``enough`` - c, and 0 beyond.
    """

    enough: float = 1.0

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Worst shortfall (M,), m."""
        return m.worst(lambda s: np.maximum(self.enough - m.world.clearance(s.base.x, s.base.y), 0.0))

    def convex(self, path: ConvexPath) -> ConvexCost:
        """A bound: the distance to half-planes that hold all obstacles."""
        return ConvexCost(path.shortfall(self.enough, path.world.free_space(), "base"), exact=False)
