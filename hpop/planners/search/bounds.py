"""Consistent lower bounds of the cost-to-go: one backward scalar search a cost, from all targets at once.

h_j(v) is the least cost j of any path from v to a target: Dijkstra for a sum, bottleneck Dijkstra for a
maximum. It is exact a cost, so consistent: h(u) <= c(u, v) + h(v), and h(u) <= max(c(u, v), h(v)).
Where turns make groups (:mod:`.turns`) whose turns are alike, only the first node of a group that is reached
turns: later ones are farther from the target and could not improve the others.
Source: Mandow and Perez de la Cruz, "Multiobjective A* search with consistent heuristics", JACM 2010
(the ideal-point heuristic of Tung and Chew 1992). Parallel arcs need no care: each is relaxed.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.planners.search.graph import Graph
from hpop.planners.search.kernels import kernel
from hpop.planners.search.slices import Clock
from hpop.planners.search.turns import OFFSET, SIZE, TURNS, Groups
from hpop.status import Status

UNREACHABLE = np.int64(2**62)


@kernel
def reverse(
    start: IntArray, heads: NDArray[np.int32], origin: NDArray[np.int32], costs: IntArray
) -> tuple[IntArray, NDArray[np.int32], IntArray]:
    """Sort arcs by head (a counting sort): offsets (n + 1,), tails (m,), costs (k, m) in that order."""
    n, m = len(start) - 1, len(heads)
    first = np.zeros(n + 2, np.int64)
    for a in range(m):
        first[heads[a] + 2] += 1
    for v in range(n):
        first[v + 2] += first[v + 1]
    tails = np.empty(m, np.int32)
    weights = np.empty((costs.shape[1], m), np.int64)
    for u in range(n):
        for a in range(start[u], start[u + 1]):
            place = first[heads[a] + 1]
            first[heads[a] + 1] = place + 1
            tails[place] = u
            for j in range(costs.shape[1]):
                weights[j, place] = costs[origin[a], j]
    return first[: n + 1], tails, weights


@kernel
def cost_to_go(
    start: IntArray,
    tails: NDArray[np.int32],
    weights: IntArray,
    column: int,
    is_max: bool,
    group: IntArray,
    rows: IntArray,
    dearest: IntArray,
    alike: bool,
    turns: IntArray,
    targets: IntArray,
    out: IntArray,
    parent: NDArray[np.int32],
) -> None:
    """Search backward from the targets in one cost; out and parent (n,) receive cost and next node."""
    n = len(start) - 1
    capacity = 1024
    keys = np.empty(capacity, np.int64)
    nodes = np.empty(capacity, np.int64)
    turned = np.zeros(len(rows), np.uint8)
    size = 0
    for v in range(n):
        out[v] = UNREACHABLE
        parent[v] = -1
    for t in targets:
        out[t] = 0
        if size == capacity:
            keys = np.concatenate((keys, np.empty_like(keys)))
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
            capacity *= 2
        keys[size] = 0
        nodes[size] = t
        size += 1
    while size > 0:
        d = keys[0]
        v = nodes[0]
        # The last entry takes the place of the first and sinks (no calls here: numba would count references).
        size -= 1
        sinking, its = keys[size], nodes[size]
        i = 0
        while True:
            child = 4 * i + 1
            if child >= size:
                break
            least = keys[child]
            best = child
            for j in range(child + 1, min(child + 4, size)):
                if keys[j] < least:
                    least = keys[j]
                    best = j
            if least >= sinking:
                break
            keys[i] = least
            nodes[i] = nodes[best]
            i = best
        keys[i] = sinking
        nodes[i] = its
        if d > out[v]:
            continue
        g = group[v]
        offset, members = rows[g, OFFSET], rows[g, SIZE]
        if members > 1 and alike:
            members = members if turned[g] == 0 else 1
            turned[g] = 1
        entering = start[v + 1] - start[v]
        more = entering + (members if members > 1 else 0)
        while size + more > capacity:
            keys = np.concatenate((keys, np.empty_like(keys)))
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
            capacity *= 2
        for i in range(more):
            if i < entering:
                a = start[v] + i
                u = np.int64(tails[a])
                w = weights[a]
            else:
                u = offset + i - entering
                if u == v:
                    continue
                w = dearest[g, column] if alike else turns[rows[g, TURNS] + (u - offset) * members + v - offset, column]
            far = max(d, w) if is_max else d + w
            if far < out[u]:
                out[u] = far
                parent[u] = v
                at = size
                size += 1
                while at > 0:
                    above = (at - 1) >> 2
                    if keys[above] <= far:
                        break
                    keys[at] = keys[above]
                    nodes[at] = nodes[above]
                    at = above
                keys[at] = far
                nodes[at] = u


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
    graph: Graph, source: int, targets: IntArray, clock: Clock, groups: Groups | None = None
) -> tuple[IntArray, IntArray, Status | None]:
    """Compute h (k, n), the cost vectors (k, k) of the paths least in each cost, and the limit passed.

    A node from which no target is reached has UNREACHABLE; an unreachable source has no vectors (0, k).
    """
    n, k = graph.nodes, graph.criteria
    clock.report("bounds")
    is_max = np.array([a == "max" for a in graph.aggregates], np.int64)
    groups = groups or Groups.of(graph, clock)
    group = np.repeat(np.arange(len(groups.rows)), groups.rows[:, SIZE])
    begin, tails, weights = clock.call(reverse, groups.start, groups.heads, groups.origin, graph.costs)
    same = (groups.nodes[:-1] < groups.nodes[1:]).all()  # no node was renumbered
    h = np.empty((k, n), np.int64)
    parents = np.empty((k, n), np.int32)
    memory = begin.nbytes + tails.nbytes + weights.nbytes + h.nbytes + parents.nbytes + group.nbytes
    ends = groups.place[targets]
    status = clock.exceeded(0, memory)
    if status is not None:
        return h, np.zeros((0, k), np.int64), status

    def arguments(j: int) -> tuple[Any, ...]:
        how = (j, bool(is_max[j]), group, groups.rows, groups.dearest, bool(groups.alike[j]), groups.turns)
        return (begin, tails, weights[j], *how, ends, h[j], parents[j])

    clock.prepare(cost_to_go, *arguments(0))
    with ThreadPoolExecutor() as threads:
        list(threads.map(lambda j: cost_to_go(*arguments(j)), range(k)))
    samples = []
    for j in range(k):
        onward = parents[j]
        if not same:
            h[j] = h[j][groups.place]
            onward = np.where(onward < 0, -1, groups.nodes[onward]).astype(np.int32)[groups.place]
        if h[j, source] < UNREACHABLE:
            arrays = (graph.indptr, graph.heads, graph.costs, is_max)
            samples.append(clock.call(cost_along, *arrays, j, h[j], onward, source))
    vectors = np.array(samples, np.int64).reshape(len(samples), k)
    return h, vectors, clock.exceeded(0, memory)
