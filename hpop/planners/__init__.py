"""Planners: problem in, candidate trajectories out.

Each is imported when it is first used, and then registered: a plan with one of them need not wait for all.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hpop.planners.base import Candidates, Planner, make_planner, planner

if TYPE_CHECKING:
    from hpop.planners.any_angle import AnyAngle
    from hpop.planners.epsilon_constraint import EpsilonConstraint
    from hpop.planners.lattice import Lattice
    from hpop.planners.roadmap import Roadmap
    from hpop.planners.rrt import RRT
    from hpop.planners.smoothing import Smoothing
    from hpop.planners.weighted_sum import WeightedSum
    from hpop.planners.weighted_sum_corridor import WeightedSumCorridor

_HOMES = {
    "AnyAngle": "hpop.planners.any_angle",
    "EpsilonConstraint": "hpop.planners.epsilon_constraint",
    "Lattice": "hpop.planners.lattice",
    "RRT": "hpop.planners.rrt",
    "Roadmap": "hpop.planners.roadmap",
    "Smoothing": "hpop.planners.smoothing",
    "WeightedSum": "hpop.planners.weighted_sum",
    "WeightedSumCorridor": "hpop.planners.weighted_sum_corridor",
}

__all__ = [
    "RRT",
    "AnyAngle",
    "Candidates",
    "EpsilonConstraint",
    "Lattice",
    "Planner",
    "Roadmap",
    "Smoothing",
    "WeightedSum",
    "WeightedSumCorridor",
    "make_planner",
    "planner",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'hpop.planners' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
