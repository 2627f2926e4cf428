"""Lexicographic search on any graph of hpop: the best path in the order in which the criteria are listed."""

from __future__ import annotations

import heapq
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.errors import UnsupportedCriterion
from hpop.planners import Candidates, planner
from hpop.planners.base import edge_objectives
from hpop.planners.graphs import OnGraph
from hpop.search import Graph


@planner("lexicographic")
@dataclass(frozen=True)
class Lexicographic(OnGraph):
    """Search for the path with the least first criterion, among equals the least second criterion, and so on.

    on  the graph family with its options: ``{"roadmap": {"samples": 300}}``

    Accepts criteria that add up. Guarantees that no path of the graph comes before it in this order.
    """

    def __post_init__(self) -> None:
        self.take_needs()

    def solve(self, problem: Any, progress: Any = None) -> Candidates:
        """Find the path."""
        objectives = edge_objectives(problem.criteria, "lexicographic")
        worst = [criterion.name for criterion in objectives.optimised if criterion.aggregate == "max"]
        if worst:
            raise UnsupportedCriterion(f"lexicographic needs criteria that add up along edges, not {', '.join(worst)}")
        query = self.family.query(problem, objectives, progress=progress)
        path = least(query.graph, query.start, query.goals)
        claim = (
            f"the first path of {query.space.words} in the order of {query.names}; paths off this graph may be better"
        )
        return query.answer("lexicographic", [] if path is None else [path], claim)


def least(graph: Graph, start: int, goals: Collection[int]) -> np.ndarray | None:
    """Return the arcs of the path to one of the goals that comes first in the order of its costs; Dijkstra 1959."""
    best = {start: ((0,) * graph.criteria, None)}
    waiting, done = [best[start][0] + (start,)], set[int]()
    while waiting:
        *cost, node = heapq.heappop(waiting)
        if node in done:
            continue
        done.add(node)
        if node in goals:
            arcs = list[int]()
            while (arc := best[node][1]) is not None:
                arcs.append(arc)
                node = int(np.searchsorted(graph.indptr, arc, side="right")) - 1
            return np.array(arcs[::-1], dtype=np.int64)
        for arc in range(graph.indptr[node], graph.indptr[node + 1]):
            head = int(graph.heads[arc])
            farther = tuple(a + b for a, b in zip(cost, graph.costs[arc].tolist(), strict=True))
            if head not in best or farther < best[head][0]:
                best[head] = (farther, arc)
                heapq.heappush(waiting, (*farther, head))
    return None
