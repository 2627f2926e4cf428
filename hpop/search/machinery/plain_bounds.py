"""Fast lower bounds of the remaining costs for one query.

A backward Dijkstra search for each cost runs until it reaches the source. This gives the path that is least in that
cost. Let U be the largest cost j of these k paths. Search j goes on until all open nodes are farther than U, and then
stops at a distance D > U. Every node that it has not settled gets the bound D, or its tentative distance if that is
less. The minimum of a consistent bound and a constant is consistent, so the front remains exact. A label at such a node
exceeds U in cost j, and only few labels of a front do. Reversed arcs of graphs without groups of turns are cached.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.runtime.limits import Status
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import (
    UNREACHABLE,
    costs_of_least_paths,
    costs_of_path,
    lower_bounds,
    path_onward,
    sort_arcs_by_head,
)
from hpop.search.machinery.group_bounds import GroupSearches, can_be_packed, memory_of_group_searches
from hpop.search.machinery.kernels import WORD_BITS
from hpop.search.machinery.labels import layer_of
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import CACHED, Groups

Shared: TypeAlias = tuple[int, int, int, NDArray[np.int32]] | None
FARTHEST = 2**61  # larger than the distance of any path


@lean
def settle(
    begin: IntArray,
    tails: NDArray[np.int32],
    weights: IntArray,
    is_max: bool,
    bits: int,
    source: int,
    until: int,
    size: int,
    heap: IntArray,
    shared: Any,
    out: IntArray,
    parent: NDArray[np.int32],
) -> int:
    """Continue a backward Dijkstra search for one cost, until all nodes up to a distance are settled.

    Returns the number of entries that remain in the heap, from which the next call continues. An entry of the 4-ary
    heap is distance << bits | node; it is obsolete if its node has a smaller distance by now.

    begin (n + 1,)           offsets: the arcs that enter node v are begin[v] : begin[v + 1]
    tails (m,), weights (m,) tails and costs of the arcs, sorted by head
    shared                   layers that share the arcs, see :func:`.labels.row_of`; `more` has the offsets of the arcs
                             that enter nodes; None without layers
    is_max                   True if the cost of a path is its largest arc cost, False if it is the sum
    source                   the search also stops at the distance of this node; -1 for none
    until                    largest distance to be settled
    size, heap               number of entries in the heap, and the heap, which is changed
    out, parent (n,)         changed: least distance of each node, and next node towards the target
    """
    mask = (1 << bits) - 1
    while size > 0:
        entry = heap[0]
        d, v = entry >> bits, entry & mask
        if d > until:
            break
        if v == source:
            until = d
        size -= 1
        last = heap[size]
        i = 0
        while True:
            child = 4 * i + 1
            if child >= size:
                break
            best = child
            for j in range(child + 1, min(child + 4, size)):
                best = j if heap[j] < heap[best] else best
            if heap[best] >= last:
                break
            heap[i] = heap[best]
            i = best
        heap[i] = last
        if d > out[v]:
            continue
        shift = np.int64(0)
        if shared is not None:  # numba drops these branches for None
            n, m, _, more = shared
            shift = layer_of(v, shared) * n
        first, last = begin[v - shift], begin[v - shift + 1]
        end = last
        if shared is not None:
            end += more[v + 1] - more[v]
        for position in range(first, end):
            a, onward = position, shift
            if shared is not None and position >= last:  # an arc from another layer
                a, onward = m + more[v] + position - last, np.int64(0)
            u = np.int64(tails[a]) + onward
            cost = max(d, weights[a]) if is_max else d + weights[a]
            if cost >= out[u]:
                continue
            out[u] = cost
            parent[u] = v
            entry = (cost << bits) | u
            i = size
            size += 1
            while i > 0 and heap[(i - 1) >> 2] > entry:
                heap[i] = heap[(i - 1) >> 2]
                i = (i - 1) >> 2
            heap[i] = entry
    return int(size)


def plain_bounds(
    graph: Graph, source: int, targets: IntArray, clock: Clock, groups: Groups
) -> tuple[IntArray, IntArray, Status | None]:
    """Return lower bounds of remaining costs, the costs of the best path for each cost, and the limit passed or None.

    The result has the form of :func:`.lower_bounds`, but comes sooner. Its bounds are smaller at nodes far from the
    targets, and suffice only for a search from this source. On a graph whose costs do not fit a heap entry, or a packed
    arc of a graph with groups of turns, the result is that of :func:`.lower_bounds`.
    """
    if groups.column >= 0:
        return _bounds_with_groups(graph, source, targets, clock, groups)
    n, k, m = graph.nodes, graph.criteria, len(groups.heads) or graph.arcs
    bits = n.bit_length()
    if int(graph.largest.max(initial=0)) * n >> (WORD_BITS - bits):
        return lower_bounds(graph, source, targets, clock)
    clock.report("bounds")
    own = len(groups.heads) or len(graph.distinct_costs)
    memory = groups.nbytes + k * (12 * n + 8 * (m + len(targets))) + 8 * n + own * (4 + 8 * k)
    status = clock.exceeded(0, memory)
    if status is not None:
        return np.empty((k, 0), np.int64), np.zeros((0, k), np.int64), status
    begin, tails, weights, shared = _reversed(graph, clock, groups)
    h, onward = np.full((k, n), UNREACHABLE), np.full((k, n), -1, np.int32)
    heaps = np.empty((k, m + len(targets)), np.int64)
    h[:, targets] = 0
    heaps[:, : len(targets)] = targets

    def settled(end: int, until: IntArray, sizes: IntArray) -> IntArray:
        worst = [aggregate == "max" for aggregate in graph.aggregates]
        states = [(int(until[j]), int(sizes[j]), heaps[j], shared, h[j], onward[j]) for j in range(k)]
        return np.array(
            clock.call_all(settle, [(begin, tails, weights[j], worst[j], bits, end, *states[j]) for j in range(k)])
        )

    sizes = settled(source, np.full(k, FARTHEST), np.full(k, len(targets)))
    samples = costs_of_least_paths(graph, source, h, onward, clock)
    if len(samples):
        sizes = settled(-1, samples.max(axis=0), sizes)
        nearest = [heaps[j, 0] >> bits if sizes[j] > 0 else UNREACHABLE for j in range(k)]
        _bound_open_nodes(h, np.array(nearest, np.int64))
    return h, samples, clock.exceeded(0, memory)


def _bounds_with_groups(
    graph: Graph, source: int, targets: IntArray, clock: Clock, groups: Groups
) -> tuple[IntArray, IntArray, Status | None]:
    """Return the result of :func:`plain_bounds` for a graph whose turns form groups of nodes."""
    if not can_be_packed(graph, groups):
        return lower_bounds(graph, source, targets, clock, groups)
    clock.report("bounds")
    k, memory = graph.criteria, memory_of_group_searches(graph, groups)
    status = clock.exceeded(0, memory)
    if status is not None:
        return np.empty((k, 0), np.int64), np.zeros((0, k), np.int64), status
    searches = GroupSearches(graph, targets, clock, groups)
    searches.settle(source, np.full(k, UNREACHABLE))
    samples = _samples_with_groups(graph, source, searches, clock)
    until = samples.max(axis=0) if len(samples) else np.full(k, UNREACHABLE)
    until[groups.column] = UNREACHABLE  # few turns lead almost everywhere; it finds the nodes that reach no target
    nearest = searches.settle(-1, until)
    h = searches.distances()
    _bound_open_nodes(h, nearest)
    return h, samples, clock.exceeded(0, memory)


def _samples_with_groups(graph: Graph, source: int, searches: GroupSearches, clock: Clock) -> IntArray:
    """Return all costs (k, k) of the best path for each cost, or (0, k), see :func:`.costs_of_least_paths`."""
    if graph.has_costs:
        return costs_of_least_paths(graph, source, *searches.results(), clock)
    first, costs = searches.groups.new_number[source], []  # nodes keep the numbers of the groups, which takes no time
    for j in range(graph.criteria):
        if searches.h[j, first] < UNREACHABLE:
            path = path_onward(searches.onward[j], first)
            costs.append(costs_of_path(graph, searches.groups.nodes[path], j, searches.h[j, path]))
    return np.array(costs, np.int64).reshape(-1, graph.criteria)


def _bound_open_nodes(h: IntArray, nearest: IntArray) -> None:
    """Turn the tentative distances h (k, n) of searches that were stopped early into lower bounds, in place.

    nearest  (k,)  distance of the nearest open node of each search, to which bounds of farther nodes are cut;
                   UNREACHABLE if no node is open, and then nodes that are not reached have no path to a target
    """
    unreached = np.zeros(h.shape[1], np.bool_)
    for bounds, distance in zip(h, nearest, strict=True):
        if distance < UNREACHABLE:
            np.minimum(bounds, distance, out=bounds)
        else:
            unreached |= bounds >= UNREACHABLE
    h[:, unreached] = UNREACHABLE


def _reversed(
    graph: Graph, clock: Clock, groups: Groups | None = None
) -> tuple[IntArray, NDArray[np.int32], IntArray, Shared]:
    """Return the arcs sorted by head: the offsets (n + 1,) of each head, and the arcs' tails (m,) and costs (k, m).

    If the graph has layers, these are the arcs of one layer, then the added ones. The last value says how the layers
    share the arcs, see :func:`.labels.row_of`; it has the offsets of the added arcs that enter each node.
    """
    if graph.layers > 1:
        begin, tails, weights, _ = _reversed(graph.layer, clock)
        m, added, layers = len(tails), graph.added, graph.layers
        begin = np.append(begin, np.full(graph.nodes - layers * graph.layer.nodes, m))
        order = np.argsort(added.heads, kind="stable")
        more = np.searchsorted(added.heads[order], np.arange(graph.nodes + 1)).astype(np.int32)
        entered_from = np.searchsorted(graph.indptr, added.places[order], side="right") - 1
        tails = np.append(tails, entered_from.astype(np.int32))
        weights = np.append(weights, added.costs[order].T, axis=1)
        return begin, tails, weights, (graph.layer.nodes, m, layers, more)
    if "reversed" in graph.cache:
        arcs: tuple[IntArray, NDArray[np.int32], IntArray, Shared] = graph.cache["reversed"]
        return arcs
    groups = groups or Groups.single_nodes(graph, clock)
    n, k, m = graph.nodes, graph.criteria, len(groups.heads)
    begin, tails, weights = np.zeros(n + 2, np.int64), np.empty(m, np.int32), np.empty((k, m), np.int64)
    costs, rows = groups.costs_of_arcs(graph)
    clock.call(sort_arcs_by_head, groups.start, groups.heads, rows, costs, begin, tails, weights)
    arcs = begin[:-1], tails, weights, None
    if clock.budget.max_memory is None and tails.nbytes + weights.nbytes <= CACHED:
        graph.cache["reversed"] = arcs
    return arcs
