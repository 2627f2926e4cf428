"""The former place of :mod:`hpop.search`, under which its names are public as well."""

from hpop.search import (
    Checkpoint,
    Graph,
    MeanPaths,
    ParetoPaths,
    SearchStats,
    SupportedPaths,
    capped_mean_paths,
    pareto_paths,
    supported_paths,
)

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
