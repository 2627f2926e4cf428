"""Planners: each takes a problem and returns candidate trajectories with their costs.

A planner's module is imported when the planner is first used, so that planning does not import all other planners.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use
from hpop.planners.base import Candidates, Planner, make_planner, planner

if TYPE_CHECKING:
    from hpop.planners.graph_planners import AnyAngle as AnyAngle
    from hpop.planners.graph_planners import Lattice as Lattice
    from hpop.planners.graph_planners import Roadmap as Roadmap
    from hpop.planners.graph_planners import WeightedSum as WeightedSum
    from hpop.planners.programs.corridor import WeightedSumCorridor as WeightedSumCorridor
    from hpop.planners.programs.epsilon_constraint import EpsilonConstraint as EpsilonConstraint
    from hpop.planners.programs.smoothing import Smoothing as Smoothing
    from hpop.planners.programs.spline import Spline as Spline
    from hpop.planners.rrt import RRT as RRT
    from hpop.planners.searches import Exact as Exact

_HOMES = homes_of(__name__)
__all__ = [*_HOMES, "Candidates", "Planner", "make_planner", "planner"]
__getattr__ = on_first_use(__name__, _HOMES)
