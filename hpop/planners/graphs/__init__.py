"""Graphs whose paths are robot trajectories: how they are built, joined to start and goal, searched and reported."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.graphs.corners import CornersGraph
    from hpop.planners.graphs.family import BuiltGraph, GraphFamily, OnGraph, graph_family
    from hpop.planners.graphs.lattice import LatticeGraph
    from hpop.planners.graphs.primitives import PrimitivesGraph
    from hpop.planners.graphs.roadmap import RoadmapGraph

__all__ = [
    "BuiltGraph",
    "CornersGraph",
    "GraphFamily",
    "LatticeGraph",
    "OnGraph",
    "PrimitivesGraph",
    "RoadmapGraph",
    "graph_family",
]

__getattr__ = on_first_use(
    __name__,
    {
        "BuiltGraph": "hpop.planners.graphs.family",
        "CornersGraph": "hpop.planners.graphs.corners",
        "GraphFamily": "hpop.planners.graphs.family",
        "LatticeGraph": "hpop.planners.graphs.lattice",
        "OnGraph": "hpop.planners.graphs.family",
        "PrimitivesGraph": "hpop.planners.graphs.primitives",
        "RoadmapGraph": "hpop.planners.graphs.roadmap",
        "graph_family": "hpop.planners.graphs.family",
    },
)
