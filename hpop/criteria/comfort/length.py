"""Length of the path: the paper's D."""

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
    """D = ∫ sqrt(x'² + y'²) dt of the base.

    Becerra et al. 2020 (arXiv 2002.10696) count it to comfort: short paths shorten the exposure to virtual reality.
    """

    def cost(self, m: Motions) -> Column:
        """Path length (M,), m."""
        return m.base.length

    def bound(self, start: States, goal: States) -> Column:
        """Least length (M,), m, of any trajectory between two states: the straight line."""
        return hypot(goal.x - start.x, goal.y - start.y)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """A sum of norms."""
        return ConvexCost(path.length, exact=True)
