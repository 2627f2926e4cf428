"""Repair of lower bounds after arcs were closed or opened: only bounds that change are computed again.

The bound h_j(v) is the least cost j of any path from v to a target, and the next node on such a path is stored for each
node. When an arc is closed, only the bounds of nodes with paths through it may rise. They are computed again from those
of their neighbours (Ramalingam and Reps, "An incremental algorithm for a generalization of the shortest-path problem",
1996). When an arc from u to v with cost c is opened, h(u) may fall to c + h(v), and so may the bounds of nodes before
u. In both cases the search of :mod:`.machinery.bounds` then continues backward from the changed nodes, which wait in a
radix heap of piles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.bounds import PILES, UNREACHABLE, bits, put_on_pile, take_from_pile


@lean
def sort_by_head(heads: NDArray[np.int32], first: IntArray, arcs: NDArray[np.int32]) -> None:
    """Sort arcs by their heads, by a counting sort, and write their indices in this order to `arcs` (m,).

    heads (m,)     head of each arc
    first (n + 2,) must be 0 before the call; its first n + 1 entries receive the offset of each head
    """
    for a in range(len(heads)):
        first[heads[a] + 2] += 1
    for v in range(len(first) - 2):
        first[v + 2] += first[v + 1]
    for a in range(len(heads)):
        place = first[heads[a] + 1]
        first[heads[a] + 1] = place + 1
        arcs[place] = a


@lean
def propagate_bounds(
    graph: Any,
    entering: Any,
    column: int,
    is_max: bool,
    closed: BoolArray,
    h: IntArray,
    onward: NDArray[np.int32],
    is_open: NDArray[np.uint8],
    piles: Any,
) -> None:
    """Propagate changed bounds h (n,) backward from the nodes in the piles, until no open arc lowers any bound.

    This is Dijkstra's algorithm; the piles are its queue, a radix heap (:mod:`.machinery.bounds`). Arguments are those
    of :func:`lower_bounds_of_opened`.
    """
    _, _, costs, tails = graph
    first, arcs = entering
    tops, above, below = piles
    lowest = d = np.int64(0)
    while True:
        if tops[0] < 0:
            pile = 1
            while pile < PILES and tops[pile] < 0:
                pile += 1
            if pile == PILES:
                return
            top = tops[pile]
            tops[pile] = -1
            d = h[top]
            v = np.int64(below[top])
            while v >= 0:
                d = min(d, h[v])
                v = np.int64(below[v])
            v = np.int64(top)
            while v >= 0:
                following = np.int64(below[v])
                put_on_pile(v, bits(h[v] ^ d), tops, above, below)
                v = following
        v = np.int64(tops[0])
        take_from_pile(v, lowest, tops, above, below)
        is_open[v] = 0
        for i in range(first[v], first[v + 1]):
            a = np.int64(arcs[i])
            u = np.int64(tails[a])
            if closed[a] or h[u] <= d:
                continue
            far = max(d, costs[a, column]) if is_max else d + costs[a, column]
            if far < h[u]:
                if is_open[u]:
                    take_from_pile(u, bits(h[u] ^ d), tops, above, below)
                h[u], onward[u], is_open[u] = far, v, 1
                put_on_pile(u, bits(far ^ d), tops, above, below)


@lean
def lower_bounds_of_opened(
    opened: IntArray,
    graph: Any,
    entering: Any,
    column: int,
    is_max: bool,
    closed: BoolArray,
    h: IntArray,
    onward: NDArray[np.int32],
    is_open: NDArray[np.uint8],
    piles: Any,
    scratch: NDArray[np.int32],
) -> bool:
    """Lower the bounds of one cost where opened arcs (a,) give a better path to a target; return True.

    graph      indptr (n + 1,), heads (m,), costs (m, k) and tails (m,)
    entering   arcs sorted by head: offsets and arcs of :func:`sort_by_head`
    column     column of the cost, a maximum if `is_max`
    closed     (m,)  mask of the closed arcs
    h, onward  (n,)  bounds of this cost, and next nodes; changed in place
    is_open    (n,)  scratch, 0 before the call: nodes that wait in the radix heap
    piles      the radix heap of :mod:`.machinery.bounds`: (PILES,) -1 before the call, (n,) and (n,) scratch
    scratch    not used; :func:`raise_bounds` takes such an argument
    """
    _, heads, costs, tails = graph
    tops, above, below = piles
    for a in opened:
        u, v = np.int64(tails[a]), np.int64(heads[a])
        if h[v] >= UNREACHABLE:
            continue
        far = max(h[v], costs[a, column]) if is_max else h[v] + costs[a, column]
        if far < h[u]:
            if is_open[u]:
                take_from_pile(u, bits(h[u]), tops, above, below)
            h[u], onward[u], is_open[u] = far, v, 1
            put_on_pile(u, bits(far), tops, above, below)
    propagate_bounds(graph, entering, column, is_max, closed, h, onward, is_open, piles)
    return True


@lean
def raise_bounds(
    newly_closed: IntArray,
    graph: Any,
    entering: Any,
    column: int,
    is_max: bool,
    closed: BoolArray,
    h: IntArray,
    onward: NDArray[np.int32],
    is_open: NDArray[np.uint8],
    piles: Any,
    affected: NDArray[np.int32],
) -> bool:
    """Raise the bounds of one cost at nodes whose best path used newly closed arcs (a,).

    affected  (most,)  scratch that has room for `most` such nodes

    Other arguments as in :func:`lower_bounds_of_opened`. Returns False if there are more than `most` such nodes; h and
    onward are then invalid, and must be computed from scratch.
    """
    indptr, heads, costs, tails = graph
    first, arcs = entering
    tops, above, below = piles
    size = 0
    for a in newly_closed:
        u = np.int64(tails[a])
        if onward[u] == heads[a] and h[u] < UNREACHABLE:
            if size == len(affected):
                return False
            h[u] = UNREACHABLE
            affected[size] = u
            size += 1
    at = 0
    while at < size:
        v = np.int64(affected[at])
        at += 1
        for i in range(first[v], first[v + 1]):
            u = np.int64(tails[arcs[i]])
            if onward[u] == v and h[u] < UNREACHABLE:
                if size == len(affected):
                    return False
                h[u] = UNREACHABLE
                affected[size] = u
                size += 1
    for i in range(size):
        onward[affected[i]] = -1
    for i in range(size):
        u = np.int64(affected[i])
        best, to = UNREACHABLE, np.int64(-1)
        for a in range(indptr[u], indptr[u + 1]):
            v = np.int64(heads[a])
            if closed[a] or is_open[v] or h[v] >= UNREACHABLE:
                continue
            far = max(h[v], costs[a, column]) if is_max else h[v] + costs[a, column]
            if far < best:
                best, to = far, v
        if to >= 0:
            h[u], onward[u], is_open[u] = best, to, 1
            put_on_pile(u, bits(best), tops, above, below)
    propagate_bounds(graph, entering, column, is_max, closed, h, onward, is_open, piles)
    return True
