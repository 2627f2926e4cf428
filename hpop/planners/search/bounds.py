"""Consistent lower bounds of the cost-to-go: one backward scalar search a cost, from all targets at once.

h_j(v) is the least cost j of any path from v to a target: Dijkstra for a sum, bottleneck Dijkstra for a
maximum. It is exact a cost, so consistent: h(u) <= c(u, v) + h(v), and h(u) <= max(c(u, v), h(v)).
Source: Mandow and Perez de la Cruz, "Multiobjective A* search with consistent heuristics", JACM 2010
(the ideal-point heuristic of Tung and Chew 1992). Parallel arcs need no care: each is relaxed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.planners.search.graph import Graph
from hpop.planners.search.kernels import drop_first, kernel, push
from hpop.planners.search.slices import Clock
from hpop.status import Status

UNREACHABLE = np.int64(2**62)


@kernel
def reverse(
    indptr: IntArray, heads: NDArray[np.int32], costs: IntArray
) -> tuple[IntArray, NDArray[np.int32], IntArray]:
    """Sort the arcs by head (a counting sort): offsets (n + 1,), tails (m,), costs (m, k) in that order."""
    n, m = len(indptr) - 1, len(heads)
    start = np.zeros(n + 2, np.int64)
    for a in range(m):
        start[heads[a] + 2] += 1
    for v in range(n):
        start[v + 2] += start[v + 1]
    tails = np.empty(m, np.int32)
    weights = np.empty((m, costs.shape[1]), np.int64)
    for u in range(n):
        for a in range(indptr[u], indptr[u + 1]):
            place = start[heads[a] + 1]
            start[heads[a] + 1] = place + 1
            tails[place] = u
            for j in range(costs.shape[1]):
                weights[place, j] = costs[a, j]
    return start[: n + 1], tails, weights


@kernel
def cost_to_go(
    start: IntArray,
    tails: NDArray[np.int32],
    weights: IntArray,
    column: int,
    is_max: bool,
    targets: IntArray,
    out: IntArray,
    parent: NDArray[np.int32],
) -> None:
    """Search backward from the targets in one cost; out and parent (n,) receive cost and next node."""
    n = len(start) - 1
    capacity = 1024
    keys = np.empty(capacity, np.int64)
    nodes = np.empty(capacity, np.int64)
    key = np.empty(1, np.int64)
    size = 0
    for v in range(n):
        out[v] = UNREACHABLE
        parent[v] = -1
    for t in targets:
        out[t] = 0
    for t in targets:
        if size == capacity:
            keys = np.concatenate((keys, np.empty_like(keys)))
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
            capacity *= 2
        key[0] = 0
        push(keys, nodes, size, 1, key, t)
        size += 1
    while size > 0:
        d = keys[0]
        v = nodes[0]
        drop_first(keys, nodes, size, 1)
        size -= 1
        if d > out[v]:
            continue
        while size + start[v + 1] - start[v] > capacity:
            keys = np.concatenate((keys, np.empty_like(keys)))
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
            capacity *= 2
        for a in range(start[v], start[v + 1]):
            u = tails[a]
            w = weights[a, column]
            g = max(d, w) if is_max else d + w
            if g < out[u]:
                out[u] = g
                parent[u] = v
                key[0] = g
                push(keys, nodes, size, 1, key, u)
                size += 1


@kernel
def cost_along(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    is_max: IntArray,
    column: int,
    h: IntArray,
    parent: NDArray[np.int32],
    source: int,
) -> IntArray:
    """Cost vector (k,) of the path that is least in one cost, following `parent` from the source."""
    k = costs.shape[1]
    total = np.zeros(k, np.int64)
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
    return total


def lower_bounds(
    graph: Graph, source: int, targets: IntArray, clock: Clock
) -> tuple[IntArray, IntArray, Status | None]:
    """Compute h (k, n), the cost vectors (k, k) of the paths least in each cost, and the limit passed.

    A node from which no target is reached has UNREACHABLE; an unreachable source has no vectors (0, k).
    """
    n, k = graph.nodes, graph.criteria
    clock.report("bounds")
    is_max = np.array([a == "max" for a in graph.aggregates], np.int64)
    backward = clock.call(reverse, graph.indptr, graph.heads, graph.costs)
    h = np.empty((k, n), np.int64)
    parent = np.empty(n, np.int32)
    samples = []
    memory = sum(a.nbytes for a in backward) + h.nbytes + parent.nbytes
    for j in range(k):
        clock.report("bounds")
        status = clock.exceeded(0, memory)
        if status is not None:
            return h, np.zeros((0, k), np.int64), status
        clock.call(cost_to_go, *backward, j, bool(is_max[j]), targets, h[j], parent)
        if h[j, source] < UNREACHABLE:
            arrays = (graph.indptr, graph.heads, graph.costs, is_max)
            samples.append(clock.call(cost_along, *arrays, j, h[j], parent, source))
    vectors = np.array(samples, np.int64).reshape(len(samples), k)
    return h, vectors, clock.exceeded(0, memory)
