"""Exact multi-objective search on plain graphs: arrays in, the whole front out; knows nothing of robots."""

from hpop.planners.search.capped_mean import MeanPaths, capped_mean_paths
from hpop.planners.search.checkpoint import Checkpoint
from hpop.planners.search.graph import Graph
from hpop.planners.search.pareto_paths import ParetoPaths, SearchStats, pareto_paths
from hpop.planners.search.weighted_sum import SupportedPaths, supported_paths

__all__ = [
    "Checkpoint",
    "Graph",
    "MeanPaths",
    "ParetoPaths",
    "SearchStats",
    "SupportedPaths",
    "capped_mean_paths",
    "pareto_paths",
    "supported_paths",
]
