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
    """Shortfall of the robot's clearance at the moment nearest to obstacles: max over t of (enough - d(p(t)))₊.

    d is the distance from the base's axis p to the nearest obstacle at any height, keep-out zone, standing person, or
    border of the map. A path with smallest clearance c costs ``enough`` - c, or 0 if c is larger than ``enough``. Unit
    m; the worst moment.

    If the model's collision test measures a ``clearance``, d is that of the whole robot: for an arm, the distance of
    its links from all solids of the world. For reaches of an arm, its error is about 0.01 mm at most, and
    programs on CasADi symbols cannot use the criterion. A model needs either such a collision test or a base.
    """

    enough: float = 1.0  # m, clearance from which on the cost is 0

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MOST, kind="a positive distance in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the largest shortfall of the clearance (M,), m, in each motion."""
        collision = collision_of(m.model, m.world)
        if collision.clearance is None and "base" not in m.model.provides:
            raise UnsupportedCriterion(
                "the criterion needs a model with a base, or with a method clearance of its collision test; add one"
            )
        if collision.clearance is not None and any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
            raise UnsupportedCriterion(
                "nonlinear programs cannot compute distances of this whole robot; plan on a graph, such as by 'roadmap'"
            )
        if collision.least_clearance is not None and not is_coupled(m.law):
            return self.enough - collision.least_clearance(m, self.enough)
        if (clearance := collision.clearance) is not None:
            return m.worst(lambda s: np.maximum(self.enough - clearance(s.state), 0.0))
        return m.worst(lambda s: np.maximum(self.enough - m.world.clearance(s.base.x, s.base.y), 0.0))

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return a convex upper bound on the cost of a polyline.

        Distances are measured to half-planes that contain all obstacles.
        """
        return ConvexCost(path.shortfall(self.enough, path.world.free_space(), "base"), exact=False)
