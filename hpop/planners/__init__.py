"""Planners: problem in, candidate trajectories out.

Each is imported when it is first used, and then registered: a plan with one of them need not wait for all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.lazy import on_first_use
from hpop.planners.base import Candidates, Planner, make_planner, planner

if TYPE_CHECKING:
    from hpop.planners.any_angle import AnyAngle
    from hpop.planners.epsilon_constraint.planner import EpsilonConstraint
    from hpop.planners.lattice import Lattice
    from hpop.planners.roadmap.planner import Roadmap
    from hpop.planners.rrt.planner import RRT
    from hpop.planners.searches.exact import Exact
    from hpop.planners.smoothing.planner import Smoothing
    from hpop.planners.spline.planner import Spline
    from hpop.planners.weighted_sum import WeightedSum
    from hpop.planners.weighted_sum_corridor.planner import WeightedSumCorridor

_HOMES = {
    "AnyAngle": "hpop.planners.any_angle",
    "EpsilonConstraint": "hpop.planners.epsilon_constraint.planner",
    "Exact": "hpop.planners.searches.exact",
    "Lattice": "hpop.planners.lattice.planner",
    "RRT": "hpop.planners.rrt.planner",
    "Roadmap": "hpop.planners.roadmap.planner",
    "Smoothing": "hpop.planners.smoothing.planner",
    "Spline": "hpop.planners.spline.planner",
    "WeightedSum": "hpop.planners.weighted_sum",
    "WeightedSumCorridor": "hpop.planners.weighted_sum_corridor.planner",
}

__all__ = [
    "RRT",
    "AnyAngle",
    "Candidates",
    "EpsilonConstraint",
    "Exact",
    "Lattice",
    "Planner",
    "Roadmap",
    "Smoothing",
    "Spline",
    "WeightedSum",
    "WeightedSumCorridor",
    "make_planner",
    "planner",
]

__getattr__ = on_first_use(__name__, _HOMES)
