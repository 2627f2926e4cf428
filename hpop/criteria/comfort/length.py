"""Length of the path of the base: the cost D of Becerra et al. 2020."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import hypot
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.motions import Motions, States


@criterion(
    "length",
    group="C",
    unit="m",
    aggregate="sum",
    requires=("base",),
    role="length",
    instead=("camera_length", "joint_length"),
)
@dataclass(frozen=True)
class Length:
    """Length of the base's path: D = ∫ sqrt(x'² + y'²) dt.

    Unit m; a sum over motions. Source: Becerra et al. 2020 (arXiv 2002.10696), who count it as comfort because a short
    path shortens the exposure to virtual reality.
    """

    def cost(self, m: Motions) -> Column:
        """Return the path length (M,), m."""
        return m.base.length

    def bound(self, start: States, goal: States) -> Column:
        """Return a lower bound (M,), m, on the length of any trajectory between two states: their distance."""
        return hypot(goal.x - start.x, goal.y - start.y)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return the length of a polyline as a convex expression of cvxpy."""
        return ConvexCost(path.length, exact=True)
