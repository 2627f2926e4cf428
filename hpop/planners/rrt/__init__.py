"""The RRT planner: random trees of drives, the baseline of Becerra et al. 2020."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.rrt.planner import RRT

__all__ = ["RRT"]

__getattr__ = on_first_use(__name__, {"RRT": "hpop.planners.rrt.planner"})
