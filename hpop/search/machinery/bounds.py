"""Consistent lower bounds of the cost-to-go: one backward scalar search per cost, from all targets at once.

h_j(v) is the least cost j of any path from v to a target, by Dijkstra for a sum and bottleneck Dijkstra for a maximum.
It is exact for each cost and therefore consistent: h(u) <= c(u, v) + h(v), and h(u) <= max(c(u, v), h(v)). If turns
form groups (:mod:`.machinery.turns`), no path needs two turns in a row, so the backward search does not turn to a node
with a path that begins with a turn. If all turns of a group have equal costs, it turns only to the node that is reached
first: later nodes are farther from the target and could not improve the others. Source: Mandow and Perez de la Cruz,
"Multiobjective A* search with consistent heuristics", JACM 2010 (the ideal-point heuristic of Tung and Chew 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.runtime.status import Status
from hpop.search.extended import ExtendedGraph
from hpop.search.graph import Graph
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups, NoRoom

UNREACHABLE = np.int64(2**62)
PILES = 63  # costs have up to 62 bits
ARC, COST = 4, 8  # bytes of a reversed arc, and of each of its costs
NODE, NODE_COST = 24, 29  # bytes of a node, and for each cost: bound, next node, dearest turn, 9 of the search backward


@lean
def sort_arcs_by_head(
    start: IntArray,
    heads: NDArray[np.int32],
    origin: NDArray[np.int32],
    costs: IntArray,
    first: IntArray,
    tails: NDArray[np.int32],
    weights: IntArray,
) -> None:
    """Sort arcs by head with a counting sort; write their tails (m,) and their costs (k, m) to `weights` in that order.

    start (n + 1,), heads (m,)  arcs by tail; origin (m,) their rows in the table of costs
    first (n + 2,)              must be 0; its first n + 1 entries receive the offset of each head
    """
    n, m = len(start) - 1, len(heads)
    for a in range(m):
        first[heads[a] + 2] += 1
    for v in range(n):
        first[v + 2] += first[v + 1]
    for u in range(n):
        for a in range(start[u], start[u + 1]):
            position = first[heads[a] + 1]
            first[heads[a] + 1] = position + 1
            tails[position] = u
            for j in range(costs.shape[1]):
                weights[j, position] = costs[origin[a], j]


@lean
def bits(x: int) -> int:
    """Return the number of bits of a non-negative number, from the exponent of a double without rounding."""
    return max(0, int(np.float64(x & ~(x >> 1)).view(np.int64) >> 52) - 1022)


@lean
def put_on_pile(v: int, pile: int, tops: IntArray, above: NDArray[np.int32], below: NDArray[np.int32]) -> None:
    """Put node v on top of a pile; piles are linked lists: `tops` of each pile, neighbours `above` and `below`."""
    top = tops[pile]
    above[v], below[v] = -1, top
    if top >= 0:
        above[top] = v
    tops[pile] = v


@lean
def take_from_pile(v: int, pile: int, tops: IntArray, above: NDArray[np.int32], below: NDArray[np.int32]) -> None:
    """Remove node v from its pile."""
    if above[v] >= 0:
        below[above[v]] = below[v]
    else:
        tops[pile] = below[v]
    if below[v] >= 0:
        above[below[v]] = above[v]


@lean
def cost_to_go(
    start: IntArray,
    tails: NDArray[np.int32],
    weights: IntArray,
    is_max: bool,
    group: IntArray,
    rows: IntArray,
    dearest: IntArray,
    uniform: bool,
    turns: IntArray,
    targets: IntArray,
    out: IntArray,
    parent: NDArray[np.int32],
    turned: NDArray[np.uint8],
    turning: NDArray[np.uint8],
    tops: IntArray,
    above: NDArray[np.int32],
    below: NDArray[np.int32],
    last: IntArray,
    source: int,
    until: int,
) -> int:
    """Search backward from the targets by one cost; write the least remaining cost of each node and its next node.

    Stops before nodes that are farther than `until`, or than the source; returns the distance of the nearest open node,
    or UNREACHABLE where none is left. The next call goes on from there.

    start, tails, weights   arcs by head, of :func:`sort_arcs_by_head`, with this cost alone
    group (n,), rows        group of each node, and the table of groups
    dearest, uniform, turns this cost of the turns, see :class:`.Groups`
    out, parent (n,)        output: least cost, and next node on such a path or -1
    turned (g,)             groups that have turned, 0 before the call
    turning (n,)            nodes with a path that begins with a turn, 0 before the call
    tops (PILES,)           -1 before the first call; above and below (n,) are scratch
    last (1,)               cost of the last node taken, -1 before the first call
    source                  node in the order of the groups, or -1

    Open nodes are in a radix heap (Ahuja, Mehlhorn, Orlin and Tarjan 1990). Let d be the cost of the last node taken.
    Pile b holds the nodes with a cost that differs from d first in bit b, counted from 1; pile 0 those of cost d. When
    pile 0 is empty, d becomes the least cost of the next pile, and the nodes of that pile are distributed again.
    """
    n = len(start) - 1
    lowest = np.int64(0)  # not 0: numba would compile the helpers once for that number alone
    d = max(int(last[0]), 0)
    if last[0] < 0:
        for v in range(n):
            out[v] = UNREACHABLE
            parent[v] = -1
        for v in targets:
            if out[v] > 0:
                out[v] = 0
                put_on_pile(v, lowest, tops, above, below)
    while True:
        if tops[0] < 0:
            pile = 1
            while pile < PILES and tops[pile] < 0:
                pile += 1
            if pile == PILES:
                last[0] = d
                return int(UNREACHABLE)
            top = tops[pile]
            nearest = int(out[top])
            v = below[top]
            while v >= 0:
                nearest = min(nearest, out[v])
                v = below[v]
            if nearest > until:
                last[0] = d
                return int(nearest)
            tops[pile] = -1
            d = nearest
            v = top
            while v >= 0:
                following = below[v]
                put_on_pile(v, bits(out[v] ^ d), tops, above, below)
                v = following
        v = tops[0]
        take_from_pile(v, lowest, tops, above, below)
        if v == source:
            until = min(until, d)
        g = group[v]
        offset, members = rows[g, OFFSET], rows[g, SIZE]
        entering = start[v + 1] - start[v]
        more = entering
        if members > 1 and turning[v] == 0 and not (uniform and turned[g]):
            more += members
            turned[g] = 1
        for i in range(more):
            a = start[v] + i
            u = np.int64(tails[a]) if i < entering else offset + i - entering
            if out[u] <= d:
                continue
            if i < entering:
                w = weights[a]
            else:
                w = dearest[g] if uniform else turns[rows[g, TURNS] + (u - offset) * members + v - offset]
            cost = max(d, w) if is_max else d + w
            if cost < out[u]:
                if out[u] < UNREACHABLE:
                    take_from_pile(u, bits(out[u] ^ d), tops, above, below)
                out[u] = cost
                parent[u] = v
                turning[u] = i >= entering
                put_on_pile(u, bits(cost ^ d), tops, above, below)


@lean
def costs_of_least_path(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    is_max: IntArray,
    column: int,
    h: IntArray,
    parent: NDArray[np.int32],
    source: int,
    total: IntArray,
) -> None:
    """Add to `total` (k,) all costs of the path that is least in the cost of `column`.

    The path follows `parent` (n,) from the source; h (n,) are the least remaining costs of that column.
    """
    k = costs.shape[1]
    u = source
    while parent[u] >= 0:
        v = parent[u]
        chosen = indptr[u]
        for a in range(indptr[u], indptr[u + 1]):
            if heads[a] == v:
                w = costs[a, column]
                exact = max(w, h[v]) == h[u] if is_max[column] else w + h[v] == h[u]
                if exact:
                    chosen = a
                    break
        for j in range(k):
            w = costs[chosen, j]
            total[j] = max(total[j], w) if is_max[j] else total[j] + w
        u = v


def lower_bounds(
    graph: Graph, source: int, targets: IntArray, clock: Clock, groups: Groups | None = None
) -> tuple[IntArray, IntArray, Status | None]:
    """Return bounds h (k, n), the cost vectors (k, k) of the least path of each cost, and the limit passed or None.

    h is UNREACHABLE at nodes that reach no target; a source that reaches no target has no vectors, (0, k). If memory
    does not suffice, h is (k, 0).
    """
    k = graph.criteria
    clock.report("bounds")
    try:
        groups = groups or Groups.of(graph, clock)
    except NoRoom:
        return np.empty((k, 0), np.int64), np.zeros((0, k), np.int64), Status.MEMORY_LIMIT
    memory = memory_of_searches(graph, groups)
    status = clock.exceeded(0, memory)
    if status is not None:
        return np.empty((k, 0), np.int64), np.zeros((0, k), np.int64), status
    h, onward = costs_to_go(graph, targets, clock, groups)
    return h, costs_of_least_paths(graph, source, h, onward, clock), clock.exceeded(0, memory)


def memory_of_searches(graph: Graph, groups: Groups) -> int:
    """Return the bytes that the searches of all costs take, groups included."""
    n, k, m = graph.nodes, graph.criteria, len(groups.heads)
    return m * (ARC + COST * k) + n * (NODE + NODE_COST * k) + groups.nbytes


def costs_to_go(
    graph: Graph, targets: IntArray, clock: Clock, groups: Groups, columns: Sequence[int] | None = None
) -> tuple[IntArray, NDArray[np.int32]]:
    """Return the least remaining costs (j, n) in some columns, by default all, and the next nodes (j, n), or -1.

    The next node of a node is its successor on a path of the least cost in that column.
    """
    searches = BackwardSearches(graph, targets, clock, groups, columns)
    searches.settle(-1, np.full(len(searches.columns), UNREACHABLE))
    return searches.results()


class BackwardSearches:
    """Searches backward from targets, one for each cost; they stop at distances, and go on from there."""

    def __init__(
        self, graph: Graph, targets: IntArray, clock: Clock, groups: Groups, columns: Sequence[int] | None = None
    ) -> None:
        """Sort the plain arcs by head.

        columns  costs of the searches, by default all
        """
        self.clock, self.groups = clock, groups
        self.columns = range(graph.criteria) if columns is None else columns
        n, k, m = graph.nodes, len(self.columns), len(groups.heads)
        is_max = _is_max(graph)
        group = np.repeat(np.arange(len(groups.rows)), groups.rows[:, SIZE])
        begin, tails, weights = (
            np.zeros(n + 2, np.int64),
            np.empty(m, np.int32),
            np.empty((graph.criteria, m), np.int64),
        )
        costs, rows = groups.costs_of_arcs(graph)
        clock.call(sort_arcs_by_head, groups.start, groups.heads, rows, costs, begin, tails, weights)
        self.h, self.parents = np.empty((k, n), np.int64), np.empty((k, n), np.int32)
        dearest = np.ascontiguousarray(groups.dearest.T)
        ends = groups.new_number[targets]

        def arguments(row: int, j: int) -> tuple[Any, ...]:
            turns = (group, groups.rows, dearest[j], bool(groups.alike[j]), groups.turns[j])
            marks = (np.zeros(len(groups.rows), np.uint8), np.zeros(n, np.uint8))
            piles = (np.full(PILES, -1), np.empty(n, np.int32), np.empty(n, np.int32), np.full(1, -1))
            distances = (self.h[row], self.parents[row])
            return (begin[:-1], tails, weights[j], bool(is_max[j]), *turns, ends, *distances, *marks, *piles)

        self._searches = [arguments(row, j) for row, j in enumerate(self.columns)]

    def settle(self, source: int, until: IntArray) -> IntArray:
        """Go on up to distances (k,), or to a source unless it is -1; return the distances (k,) of the open nodes.

        A distance is UNREACHABLE where no node is open.
        """
        end = source if source < 0 else int(self.groups.new_number[source])
        calls = [(*search, end, distance) for search, distance in zip(self._searches, until.tolist(), strict=True)]
        return np.array(self.clock.call_all(cost_to_go, calls), np.int64)

    def results(self) -> tuple[IntArray, NDArray[np.int32]]:
        """Return the remaining costs (k, n) and the next nodes (k, n) so far, nodes in the order of the graph."""
        groups = self.groups
        if (groups.nodes[:-1] < groups.nodes[1:]).all():  # no node was renumbered
            return self.h, self.parents
        parents = np.where(self.parents < 0, -1, groups.nodes[self.parents]).astype(np.int32)
        return self.h[:, groups.new_number], parents[:, groups.new_number]


def costs_of_least_paths(graph: Graph, source: int, h: IntArray, onward: NDArray[np.int32], clock: Clock) -> IntArray:
    """Return the cost vectors (k, k) of the least path of each cost from a source; (0, k) if no target is reached.

    h, onward (k, n)  least remaining costs and next nodes, of :func:`costs_to_go`
    """
    k = graph.criteria
    vectors = np.zeros((k, k), np.int64)
    for j in range(k):
        if isinstance(graph, ExtendedGraph) and graph.base is not None and h[j, source] < UNREACHABLE:
            vectors[j] = graph.costs_of_path(_path(onward[j], source), j, h[j])
        elif h[j, source] < UNREACHABLE:
            arrays = (graph.indptr, graph.heads, graph.costs, _is_max(graph))
            clock.call(costs_of_least_path, *arrays, j, h[j], onward[j], source, vectors[j])
    return vectors[h[:, source] < UNREACHABLE]


def _path(onward: NDArray[np.int32], source: int) -> IntArray:
    """Return the nodes of the path from a source along the next nodes (n,)."""
    nodes = [source]
    while (node := int(onward[nodes[-1]])) >= 0:
        nodes.append(node)
    return np.array(nodes, np.int64)


def _is_max(graph: Graph) -> IntArray:
    return np.array([aggregate == "max" for aggregate in graph.aggregates], np.int64)
