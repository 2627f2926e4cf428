"""Clearance: how near the robot comes to obstacles at its worst moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import is_symbolic
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import Motions, collision_of, is_coupled


@criterion("clearance", group="R", unit="m", aggregate="max", quantum=1e-3)
@dataclass(frozen=True)
class Clearance:
    """max over t of (enough - d(p(t)))₊: by how much the base's axis comes nearer than ``enough`` metres.

    d is the distance to the nearest obstacle at any height, keep-out zone, person who stands, or border of the extent;
    the cost of a path with least clearance c is ``enough`` - c, and 0 beyond.

    Of a model whose collision measures a ``clearance`` it is that of the whole robot: of every link of an arm from what
    stands in the world, along reaches to .01 mm, which is proved. That has no symbols. A model needs either this or a
    base.
    """

    enough: float = 1.0  # m, a clearance beyond which nothing is gained

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Worst shortfall (M,), m."""
        collision = collision_of(m.model, m.world)
        if collision.clearance is None and "base" not in m.model.provides:
            raise UnsupportedCriterion("it needs a base, or a model whose collision measures its clearance")
        if collision.clearance is not None and any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
            raise UnsupportedCriterion("distances of a whole robot have no symbols; take a planner on a graph")
        if collision.least_clearance is not None and not is_coupled(m.law):
            return self.enough - collision.least_clearance(m, self.enough)
        if (clearance := collision.clearance) is not None:
            return m.worst(lambda s: np.maximum(self.enough - clearance(s.state), 0.0))
        return m.worst(lambda s: np.maximum(self.enough - m.world.clearance(s.base.x, s.base.y), 0.0))

    def convex(self, path: ConvexPath) -> ConvexCost:
        """A bound: the distance to half-planes that hold all obstacles."""
        return ConvexCost(path.shortfall(self.enough, path.world.free_space(), "base"), exact=False)
