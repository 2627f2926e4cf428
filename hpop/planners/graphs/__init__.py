"""Graphs of trajectories: families that build them, exact ends, the query, and what is claimed of its answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.any_angle import CornersGraph
    from hpop.planners.graphs.family import BuiltGraph, GraphFamily, OnGraph, graph_family
    from hpop.planners.lattice.planner import LatticeGraph
    from hpop.planners.roadmap.planner import RoadmapGraph

__all__ = ["BuiltGraph", "CornersGraph", "GraphFamily", "LatticeGraph", "OnGraph", "RoadmapGraph", "graph_family"]

__getattr__ = on_first_use(
    __name__,
    {
        "BuiltGraph": "hpop.planners.graphs.family",
        "CornersGraph": "hpop.planners.any_angle",
        "GraphFamily": "hpop.planners.graphs.family",
        "LatticeGraph": "hpop.planners.lattice.planner",
        "OnGraph": "hpop.planners.graphs.family",
        "RoadmapGraph": "hpop.planners.roadmap.planner",
        "graph_family": "hpop.planners.graphs.family",
    },
)
