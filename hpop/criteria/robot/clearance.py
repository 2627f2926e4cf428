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
    """Shortfall of the robot's clearance at its nearest point to obstacles: max over t of (enough - d(p(t)))₊.

    d is the distance from the base's axis p to the nearest obstacle at any height, keep-out zone, standing person, or
    border of the extent. A path with least clearance c costs ``enough`` - c, and 0 if c is larger than ``enough``. Unit
    m; the worst moment.

    If the collision of the model measures a ``clearance``, d is that of the whole robot: for an arm, of every link from
    all solids of the world. Along reaches it is then proved to .01 mm, and no symbolic form exists. A model needs
    either this or a base.
    """

    enough: float = 1.0  # m, clearance beyond which the cost is 0

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the worst shortfall (M,), m."""
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
        """Return a convex upper bound of the cost, from the distance to half-planes that contain all obstacles."""
        return ConvexCost(path.shortfall(self.enough, path.world.free_space(), "base"), exact=False)
