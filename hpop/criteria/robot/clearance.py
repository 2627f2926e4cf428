"""Nearness of obstacles: clearance at the worst moment, and the length of the path weighted by proximity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import is_symbolic, smooth_abs
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import Instants, Motions, collision_of, is_coupled


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

    quantity: ClassVar[str] = "shortfall"
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
