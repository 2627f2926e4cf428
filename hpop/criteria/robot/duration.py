"""Duration of the trajectory."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions


@criterion("duration", group="R", unit="s", aggregate="sum", role="duration")
@dataclass(frozen=True)
class Duration:
    """Duration of the trajectory: T = ∫ dt.

    Unit s; a sum over motions. Each is timed by its motion law, which on a graph is that of planned motions.
    """

    def cost(self, m: Motions) -> Column:
        """Return the duration (M,), s."""
        return m.duration
