"""The stages of the lattice planner: a first answer within a second or two, the exact front in the end.

Most of the time before an answer goes into costing millions of edges. So the first stage takes the positions round a
shortest way alone, a bounded number of them: their edges are edges of the whole lattice, hence so are their paths, and
the path that is shortest there is among them. On both it looks for supported points (:mod:`.search.weighted_sum`), the
best path in each cost first, for a fraction of a second or of the time that building took. Where a cost takes the worst
edge, weighted sums say nothing, and the first points of an exact search stand in.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hpop.planners.base import Candidates, edge_objectives
from hpop.planners.lattice_graph import StateLattice
from hpop.planners.search import Graph, ParetoPaths, pareto_paths, supported_paths
from hpop.planners.state_graph import GraphQuery
from hpop.status import Budget, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.planners.lattice import Lattice
    from hpop.problem import Problem

MOST = 8_000  # positions of the first stage: their edges are built in half a second
QUICK = 0.3  # s, of a search before the exact one, at least
SHARE = 0.2  # of the time that building took, if that is more


def stages(planner: Lattice, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
    """Candidates of each stage. A time limit is one of all searches together; first answers take no half of it."""
    objectives = edge_objectives(problem.criteria, "lattice")
    lattice, left = planner.lattice(problem), planner.time_limit or math.inf
    part = _part(planner, lattice, problem)
    for space in [lattice] if part is None else [part, lattice]:
        query = planner.query(problem, objectives, progress, space)
        seconds = min(left / 4, max(QUICK, SHARE * query.build_seconds))
        first = _first_answer(query, Budget(seconds, planner.max_labels, planner.max_memory), progress)
        left = max(left - first.stats["bounds_seconds"] - first.stats["search_seconds"], left / 2)
        if len(first.trajectories) or first.status is Status.INTERRUPTED:
            yield first
        if first.status is Status.INTERRUPTED:
            return
    limit = None if planner.time_limit is None else left
    budget = Budget(limit, planner.max_labels, planner.max_memory)
    yield query.exact("lattice", budget, progress, eps=planner.eps, tolerance=planner.tolerance)


def _part(planner: Lattice, lattice: StateLattice, problem: Problem) -> StateLattice | None:
    """The part of a large lattice round a shortest way; None for a small one, or where there is no way."""
    if lattice.cells[0].size <= MOST:
        return None
    from hpop.planners.nearby import nearby  # numba: on first use

    start, goals, _ = planner.ends(lattice, problem)
    at = lattice.places(np.array([start, goals[0]]))
    begin, end = zip(*(axis[at].tolist() for axis in lattice.cells), strict=True)
    kept = nearby(lattice.number >= 0, begin, end, MOST, corner_cutting=lattice.corner_cutting)
    return None if kept is None else replace(lattice, kept=kept)


def _first_answer(query: GraphQuery, budget: Budget, progress: ProgressCallback | None) -> Candidates:
    """Points found within the budget, and what they are."""

    def search(graph: Graph) -> ParetoPaths:
        find = pareto_paths if "max" in graph.aggregates else supported_paths
        return find(graph, query.start, query.goals, budget=budget, progress=progress)

    paths = query.with_fewest_turns(search)
    kind = "non-dominated" if "max" in query.graph.aggregates else "supported"
    status = Status.INTERRUPTED if paths.status is Status.INTERRUPTED else Status.UNFINISHED
    claim = f"first answer: {kind} points of {query.space.words} for ({query.names}), the exact search is not done"
    return query.candidates(
        "lattice",
        replace(paths, status=status),
        claim,
        provenance=[{"stage": f"{kind} points"}] * len(paths),
        stats={"method": paths.stats.method, "peak_memory": paths.stats.peak_memory},
    )
