"""Exact multi-objective search on plain graphs: arrays in, the whole front out; independent of robots."""

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use
from hpop.search.graph import Graph
from hpop.search.machinery.checkpoint import Checkpoint
from hpop.search.mean.capped_mean import MeanPaths, capped_mean_paths
from hpop.search.pareto_paths import pareto_paths
from hpop.search.queries import ParetoPaths, SearchStats
from hpop.search.supported.supported_paths import SupportedPaths, supported_paths

if TYPE_CHECKING:
    from hpop.search.prepared import Prepared

__all__ = [
    "Checkpoint",
    "Graph",
    "MeanPaths",
    "ParetoPaths",
    "Prepared",
    "SearchStats",
    "SupportedPaths",
    "capped_mean_paths",
    "pareto_paths",
    "supported_paths",
]

__getattr__ = on_first_use(__name__, {"Prepared": "hpop.search.prepared"})  # its kernels take numba
