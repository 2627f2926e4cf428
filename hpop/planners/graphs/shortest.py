"""The shortest path of a graph of states, kept in case a limit is passed before all its edges are costed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.runtime import limits
from hpop.search.supported.first_paths import first_paths


def shortest_path(
    name: str, space: TrajectoryGraph, start: int, goals: list[int], objectives: Objectives
) -> Candidates:
    """Return the shortest path of a graph with its costs in all objectives, as a stage of the planner ``name``.

    Lengths alone are needed of all edges, which take a small part of the time of most other costs; these are evaluated
    along the path. What it takes for a while is given back. Raises Exhausted where a limit is passed.
    """
    spending, length = space.spending, edge_objectives([make_criterion("length")], name)
    held = spending.memory
    graph = space.graph(length.optimised)
    query = Query(space, length, graph, start, goals, build_seconds=spending.seconds())
    paths = first_paths(graph, start, goals, spending.left())
    what = "shortest path"
    found = assemble(name, query, paths, f"the {what} of {space.words}", provenance=[{"stage": what}] * len(paths))
    with limits.within(spending):
        costs = trajectory_costs(objectives.optimised, found.trajectories, space.world)
    spending.release(spending.memory - held)
    return replace(
        found,
        objectives=objectives.optimised,
        planned=costs,
        tolerance=np.zeros_like(costs),
        filters=objectives.filters,
        notes=objectives.notes,
    )
