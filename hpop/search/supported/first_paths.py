"""A first result without kernels: shortest paths for some weights of the costs, by SciPy.

It is shown while kernels are compiled for the first time (:mod:`.beside`). The costs of its paths are exact integers.
But weighted sums are floating-point numbers, so the paths are not claimed to be optimal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from time import perf_counter
from typing import Any, cast

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.frontier import is_nondominated
from hpop.runtime.limits import Budget, Progress, ProgressCallback, Status
from hpop.search.graph import Graph
from hpop.search.queries import ParetoPaths, SearchStats
from hpop.search.supported import simplex_lattice

DIVISIONS = (2, 3)  # divisions of the lattices of weights that are tried after each cost alone
TIE = 1e-6  # weight of the other costs when one cost is minimised
STEP = 1e-9  # added to the weighted cost of each arc, so that loops of arcs without cost are avoided


def first_paths(
    graph: Graph, source: int, targets: Sequence[int], budget: Budget, progress: ProgressCallback | None = None
) -> ParetoPaths:
    """Return a few good paths quickly: the best path for each cost and, while time lasts, for mixtures of costs.

    Dominated paths are left out. For a cost that is a maximum, the search weights its sum along the path instead; the
    returned cost is the maximum. The gap is inf; the status COMPLETE says only that all weight vectors were tried.

    >>> graph = Graph.from_arcs(2, [0, 0, 0], [1, 1, 1], [[0, 4], [1, 1], [4, 0]])
    >>> first_paths(graph, 0, [1], Budget()).costs.tolist()
    [[0, 4], [1, 1], [4, 0]]
    """
    began = perf_counter()
    by_costs: dict[tuple[int, ...], IntArray] = {}
    status = Status.COMPLETE
    try:
        for solved, arcs in enumerate(_least_paths(graph, source, np.asarray(targets)), start=1):
            if arcs is None:
                status = Status.NO_PATH
                break
            arc_costs = graph.costs[arcs]
            columns = [
                c.max(initial=0) if a == "max" else c.sum() for c, a in zip(arc_costs.T, graph.aggregates, strict=True)
            ]
            by_costs.setdefault(tuple(map(int, columns)), arcs)
            seconds = perf_counter() - began
            if progress:
                progress(Progress("weights", front=len(by_costs), seconds=seconds))
            if budget.time_limit is not None and solved >= graph.criteria and seconds > budget.time_limit:
                status = Status.TIME_LIMIT
                break
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    costs = np.array(sorted(by_costs), np.int64).reshape(-1, graph.criteria)
    costs = costs[is_nondominated(costs)] if len(costs) else costs
    paths = tuple(by_costs[tuple(row)] for row in costs.tolist())
    stats = SearchStats("weighted sum", seconds_search=perf_counter() - began)
    return ParetoPaths(costs, status, stats, graph, source, paths, gap=math.inf)


def _least_paths(graph: Graph, source: int, targets: IntArray) -> Iterator[IntArray | None]:
    """Yield the arcs of the shortest path for one vector of weights after another; None if no target is reached."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    costs = graph.costs / np.maximum(graph.largest, 1)
    matrix = csr_array((np.empty(graph.arcs), graph.heads, graph.indptr.astype(np.int32)), (graph.nodes, graph.nodes))
    totals: list[FloatArray] = []
    for weights in _weights(graph.criteria, totals):
        matrix.data[:] = costs @ weights + STEP * weights.sum()
        distance, before = cast(Any, dijkstra)(matrix, indices=source, return_predecessors=True)
        end = int(targets[distance[targets].argmin()])
        if math.isinf(distance[end]):
            yield None
            return
        arcs = _path_to(graph, matrix.data, before, source, end)
        totals.append(costs[arcs].sum(axis=0))
        yield arcs


def _weights(k: int, totals: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """Yield weight vectors (k,): each cost alone, then a fixed set of mixtures.

    The weights of a mixture are divided by the ranges of the costs in `totals`, to which the caller adds the costs of
    each path that it finds meanwhile.
    """
    yield from np.eye(k) + TIE
    ranges = np.maximum(np.ptp(np.array(totals), axis=0), TIE)
    for divisions in DIVISIONS:
        for parts in simplex_lattice(divisions, k):
            if max(parts) < divisions:
                yield (np.array(parts) + TIE) / ranges


def _path_to(graph: Graph, weighted: FloatArray, before: IntArray, source: int, end: int) -> IntArray:
    """Return the arcs of the path from the source to node `end`, traced back by the predecessors of nodes.

    If arcs are parallel, the one of least weighted cost is taken.

    weighted  (m,)  weighted cost of each arc
    before    (n,)  predecessor of each node
    """
    arcs: list[int] = []
    node = end
    while node != source:
        tail = int(before[node])
        leaving = np.arange(graph.indptr[tail], graph.indptr[tail + 1])
        joining = leaving[graph.heads[leaving] == node]
        arcs.append(int(joining[weighted[joining].argmin()]))
        node = tail
    return np.array(arcs[::-1], np.int64)
