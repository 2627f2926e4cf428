"""Lower bounds of the remaining costs of each node: one backward search for each cost, from all targets at once.

h_j(v) is the least cost j of any path from v to a target, found by Dijkstra for a sum and by bottleneck Dijkstra for a
maximum. It is exact for each cost alone, and therefore consistent: h(u) <= c(u, v) + h(v), and
h(u) <= max(c(u, v), h(v)). Source: Mandow and Perez de la Cruz, "Multiobjective A* search with consistent heuristics",
JACM 2010 (the ideal-point heuristic of Tung and Chew 1992).

If turns form groups (:mod:`.machinery.turns`), a faster search works on whole groups (:mod:`.group_bounds`), unless
costs are too large for it. The search on nodes uses that no path needs two turns in a row: it does not add a turn
before a path that begins with a turn. If all turns of a group have equal costs, it adds turns only at the node of the
group that it reaches first: other nodes are farther from the target, and could not improve the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray, numbered
from hpop.runtime.compiled import lean
from hpop.runtime.limits import Status
from hpop.search.graph import Graph
from hpop.search.machinery.group_bounds import UNREACHABLE as UNREACHABLE
from hpop.search.machinery.group_bounds import GroupSearches, can_be_packed, in_graph_numbers, memory_of_group_searches
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups, NoRoom

PILES = 63  # of the radix heap: costs have up to 62 bits
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
    """Sort arcs by head, by a counting sort, for a search backward from the targets.

    start (n + 1,), heads (m,)      arcs sorted by tail: offsets of each tail, and heads
    origin (m,), costs              row of each arc in the table of costs, and this table with k columns
    first (n + 2,)                  must be 0; its first n + 1 entries receive the offset of each head
    tails (m,), weights (k, m)      output: tails and costs of the arcs, sorted by head
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
    """Return the bit length of an integer x >= 0 (3 for 5), read from the exponent of a float without rounding."""
    return max(0, int(np.float64(x & ~(x >> 1)).view(np.int64) >> 52) - 1022)


@lean
def put_on_pile(v: int, pile: int, tops: IntArray, above: NDArray[np.int32], below: NDArray[np.int32]) -> None:
    """Put node v on top of a pile of the radix heap, a queue that sorts open nodes by cost (see :func:`cost_to_go`).

    Piles are linked lists: `tops` has the top node of each pile, `above` and `below` (n,) the neighbours of each node.
    """
    top = tops[pile]
    above[v], below[v] = -1, top
    if top >= 0:
        above[top] = v
    tops[pile] = v


@lean
def take_from_pile(v: int, pile: int, tops: IntArray, above: NDArray[np.int32], below: NDArray[np.int32]) -> None:
    """Remove node v from its pile of the radix heap; arguments as in :func:`put_on_pile`."""
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
) -> None:
    """Search backward from the targets by one cost; write the least remaining cost of each node and its next node.

    start, tails, weights   arcs sorted by head, of :func:`sort_arcs_by_head`, with this cost alone
    is_max                  True if the cost of a path is its largest arc cost, False if it is the sum
    group (n,), rows        index of each node's group, and the table of groups, see :class:`.Groups`
    dearest, uniform, turns this cost of the turns, see :class:`.Groups` (`uniform` is an entry of `alike`)
    targets                 nodes at which paths may end, in the numbering of the groups
    out, parent (n,)        output: least cost, and next node on such a path or -1, in the numbering of the groups
    turned (g,)             scratch: 1 for groups whose turns were added, 0 before the call
    turning (n,)            scratch: 1 for nodes whose best path begins with a turn, 0 before the call
    tops (PILES,)           scratch for the radix heap, -1 before the call; above and below (n,): its linked lists

    Open nodes are in a radix heap (Ahuja, Mehlhorn, Orlin and Tarjan 1990). Let d be the cost of the last node taken.
    Pile 0 holds the open nodes of cost d. Pile b holds those whose cost differs from d in bit b, counted from 1, and in
    no higher bit. When pile 0 is empty, d becomes the least cost in the next pile, whose nodes are distributed again.
    """
    n = len(start) - 1
    lowest = np.int64(0)  # not 0: numba would compile the helpers once for that number alone
    d = np.int64(0)
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
                return
            top = tops[pile]
            nearest = out[top]
            v = below[top]
            while v >= 0:
                nearest = min(nearest, out[v])
                v = below[v]
            tops[pile] = -1
            d = nearest
            v = top
            while v >= 0:
                following = below[v]
                put_on_pile(v, bits(out[v] ^ d), tops, above, below)
                v = following
        v = tops[0]
        take_from_pile(v, lowest, tops, above, below)
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
    """Add up all k costs of the path from the source that is least in one cost, that of `column`, into `total` (k,).

    indptr, heads, costs  arcs of the graph, see :class:`.Graph`
    is_max (k,)           1 for a cost of which a path has the maximum, 0 for a sum
    h (n,)                least remaining cost of each node, in that column
    parent (n,)           next node on the path; -1 at its end
    total (k,)            output, 0 before the call
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
    """Return lower bounds of the remaining costs of all nodes, and the costs of the best path for each cost.

    The first value has the bounds (k, n), UNREACHABLE at nodes that reach no target; it is (k, 0) if memory does not
    suffice. Row j of the second, (k, k), has all costs of the path from the source that is least in cost j; it is
    (0, k) if the source reaches no target. The third value is the limit that was passed, or None.
    """
    k = graph.criteria
    clock.report("bounds")
    try:
        groups = groups or Groups.of(graph, clock)
    except NoRoom:
        return np.empty((k, 0), np.int64), np.zeros((0, k), np.int64), Status.MEMORY_LIMIT
    is_packed = can_be_packed(graph, groups)
    memory = memory_of_group_searches(graph, groups) if is_packed else memory_of_searches(graph, groups)
    status = clock.exceeded(0, memory)
    if status is not None:
        return np.empty((k, 0), np.int64), np.zeros((0, k), np.int64), status
    if is_packed:
        searches = GroupSearches(graph, targets, clock, groups)
        searches.settle(-1, np.full(k, UNREACHABLE))
        h, onward = searches.results()
    else:
        h, onward = costs_to_go(graph, targets, clock, groups)
    return h, costs_of_least_paths(graph, source, h, onward, clock), clock.exceeded(0, memory)


def memory_of_searches(graph: Graph, groups: Groups) -> int:
    """Return how many bytes the backward searches for all costs need, groups included."""
    n, k, m = graph.nodes, graph.criteria, len(groups.heads)
    return m * (ARC + COST * k) + n * (NODE + NODE_COST * k) + groups.nbytes


def costs_to_go(
    graph: Graph, targets: IntArray, clock: Clock, groups: Groups, columns: Sequence[int] | None = None
) -> tuple[IntArray, NDArray[np.int32]]:
    """Return the least remaining cost (j, n) of each node in j columns, by default all, and its next node (j, n).

    The next node is the successor on a path that is least in this cost; it is -1 at targets and at nodes that reach
    none.
    """
    chosen = range(graph.criteria) if columns is None else columns
    n, m = graph.nodes, len(groups.heads)
    is_max = _is_max(graph)
    group = np.repeat(np.arange(len(groups.rows)), groups.rows[:, SIZE])
    begin, tails = np.zeros(n + 2, np.int64), np.empty(m, np.int32)
    weights = np.empty((graph.criteria, m), np.int64)
    costs, rows = groups.costs_of_arcs(graph)
    clock.call(sort_arcs_by_head, groups.start, groups.heads, rows, costs, begin, tails, weights)
    h, onward = np.empty((len(chosen), n), np.int64), np.empty((len(chosen), n), np.int32)
    dearest, ends = np.ascontiguousarray(groups.dearest.T), groups.new_number[targets]

    def arguments(row: int, j: int) -> tuple[Any, ...]:
        turns = (group, groups.rows, dearest[j], bool(groups.alike[j]), groups.turns[j])
        marks = (np.zeros(len(groups.rows), np.uint8), np.zeros(n, np.uint8))
        piles = (np.full(PILES, -1), np.empty(n, np.int32), np.empty(n, np.int32))
        return (begin[:-1], tails, weights[j], bool(is_max[j]), *turns, ends, h[row], onward[row], *marks, *piles)

    clock.call_all(cost_to_go, [arguments(row, j) for row, j in enumerate(chosen)])
    return in_graph_numbers(groups, h, onward)


def costs_of_least_paths(graph: Graph, source: int, h: IntArray, onward: NDArray[np.int32], clock: Clock) -> IntArray:
    """Return all costs (k, k) of the best path for each cost: row j is for the path from the source least in cost j.

    The result is (0, k) if the source reaches no target.

    h, onward (k, n)  least remaining costs and next nodes, of :func:`costs_to_go`
    """
    k = graph.criteria
    vectors = np.zeros((k, k), np.int64)
    for j in range(k):
        if not graph.has_costs and h[j, source] < UNREACHABLE:
            nodes = path_onward(onward[j], source)
            vectors[j] = costs_of_path(graph, nodes, j, h[j, nodes])
        elif h[j, source] < UNREACHABLE:
            arrays = (graph.indptr, graph.heads, graph.costs, _is_max(graph))
            clock.call(costs_of_least_path, *arrays, j, h[j], onward[j], source, vectors[j])
    return vectors[h[:, source] < UNREACHABLE]


def path_onward(onward: NDArray[np.int32], source: int) -> IntArray:
    """Return the nodes of the path from a source that follows the next node ``onward`` (n,) of each node."""
    nodes = [source]
    while (node := int(onward[nodes[-1]])) >= 0:
        nodes.append(node)
    return np.array(nodes, np.int64)


def costs_of_path(graph: Graph, nodes: IntArray, column: int, remaining: IntArray) -> IntArray:
    """Return all costs (k,) of a path through the given nodes (N,), which is least in the cost of ``column``.

    Of parallel arcs, the first one that gives this least cost is taken.

    remaining  (N,)  least remaining cost of each of these nodes in this column
    """
    sizes = (graph.indptr[nodes + 1] - graph.indptr[nodes])[:-1]
    step, number = numbered(sizes)
    heads, costs = graph.ends_and_costs(graph.indptr[nodes[step]] + number)
    worst = np.array(graph.aggregates) == "max"
    after = remaining[step + 1]
    paid = np.maximum(costs[:, column], after) if worst[column] else costs[:, column] + after
    fits = np.flatnonzero((heads == nodes[step + 1]) & (paid == remaining[step]))
    _, first = np.unique(step[fits], return_index=True)
    chosen = costs[fits[first]]
    total: IntArray = np.where(worst, chosen.max(axis=0, initial=0), chosen.sum(axis=0))
    return total


def _is_max(graph: Graph) -> IntArray:
    return np.array([aggregate == "max" for aggregate in graph.aggregates], np.int64)
