"""Planners: problem in, candidate trajectories out; importing this package registers those that come with hpop."""

from hpop.planners.any_angle import AnyAngle
from hpop.planners.base import Candidates, Planner, make_planner, planner
from hpop.planners.epsilon_constraint import EpsilonConstraint
from hpop.planners.lattice import Lattice
from hpop.planners.roadmap import Roadmap
from hpop.planners.rrt import RRT
from hpop.planners.smoothing import Smoothing
from hpop.planners.weighted_sum import WeightedSum
from hpop.planners.weighted_sum_corridor import WeightedSumCorridor

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
