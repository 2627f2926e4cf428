"""Planners: problem in, candidate trajectories out.

Each is imported when it is first used, and then registered: a plan with one of them need not wait for all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use
from hpop.planners.base import Candidates, Planner, make_planner, planner

if TYPE_CHECKING:
    from hpop.planners.any_angle import AnyAngle
    from hpop.planners.lattice import Lattice
    from hpop.planners.programs.corridor.planner import WeightedSumCorridor
    from hpop.planners.programs.epsilon_constraint.planner import EpsilonConstraint
    from hpop.planners.programs.smoothing.planner import Smoothing
    from hpop.planners.programs.spline.planner import Spline
    from hpop.planners.roadmap import Roadmap
    from hpop.planners.rrt.planner import RRT
    from hpop.planners.searches.exact import Exact
    from hpop.planners.weighted_sum import WeightedSum

_HOMES = {
    "AnyAngle": "hpop.planners.any_angle",
    "EpsilonConstraint": "hpop.planners.programs.epsilon_constraint.planner",
    "Exact": "hpop.planners.searches.exact",
    "Lattice": "hpop.planners.lattice",
    "RRT": "hpop.planners.rrt.planner",
    "Roadmap": "hpop.planners.roadmap",
    "Smoothing": "hpop.planners.programs.smoothing.planner",
    "Spline": "hpop.planners.programs.spline.planner",
    "WeightedSum": "hpop.planners.weighted_sum",
    "WeightedSumCorridor": "hpop.planners.programs.corridor.planner",
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
