"""Clearance: how near the robot comes to obstacles at its worst moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.math import is_symbolic
from hpop.motions import Motions, is_coupled
from hpop.options import LEAST, MOST, set_reals


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
        collision = _measuring(m)
        if hasattr(collision, "least_clearance") and not is_coupled(m.law):
            return self.enough - collision.least_clearance(m, self.enough)
        if collision is not None:
            return m.worst(lambda s: np.maximum(self.enough - collision.clearance(s.state), 0.0))
        return m.worst(lambda s: np.maximum(self.enough - m.world.clearance(s.base.x, s.base.y), 0.0))

    def convex(self, path: ConvexPath) -> ConvexCost:
        """A bound: the distance to half-planes that hold all obstacles."""
        return ConvexCost(path.shortfall(self.enough, path.world.free_space(), "base"), exact=False)


def _measuring(m: Motions) -> Any:
    """The collision of the model, if it measures how far the whole robot is from what blocks it; else it has a base."""
    collision: Any = m.model.collision(m.world)
    if hasattr(collision, "clearance"):
        if any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
            raise UnsupportedCriterion("distances of a whole robot have no symbols; take a planner on a graph")
        return collision
    if "base" not in m.model.provides:
        raise UnsupportedCriterion("it needs a base, or a model whose collision measures its clearance")
    return None
