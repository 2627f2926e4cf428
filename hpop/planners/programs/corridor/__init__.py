"""The weighted-sum planner in the continuum: convex programs through corridors of convex free regions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.programs.corridor.planner import WeightedSumCorridor

__all__ = ["WeightedSumCorridor"]

__getattr__ = on_first_use(__name__, {"WeightedSumCorridor": "hpop.planners.programs.corridor.planner"})
