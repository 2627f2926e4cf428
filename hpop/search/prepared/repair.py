"""Bounds that stay true while arcs are opened, and whether a target is reached at all while others are closed.

To close an arc leaves lower bounds consistent: h(u) <= c + h(v) holds for fewer arcs. To open one may break that at its
tail u. Then h(u) becomes c + h(v), and so on backward: a search like that of :mod:`.machinery.bounds`, which only
lowers, and so comes no farther than where the way through an opened arc is better. What was exact before is so after.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import BoolArray, IntArray
from hpop.compiled import lean
from hpop.search.machinery.bounds import PILES, UNREACHABLE, bits, enter, leave


@lean
def sort_by_head(heads: NDArray[np.int32], first: IntArray, arcs: NDArray[np.int32]) -> None:
    """Sort arcs (m,) by their heads; first (n + 2,) is 0 before, its first n + 1 are then the offsets."""
    for a in range(len(heads)):
        first[heads[a] + 2] += 1
    for v in range(len(first) - 2):
        first[v + 2] += first[v + 1]
    for a in range(len(heads)):
        place = first[heads[a] + 1]
        first[heads[a] + 1] = place + 1
        arcs[place] = a


@lean
def lower_bounds_from(
    opened: IntArray,
    first: IntArray,
    entering: NDArray[np.int32],
    tails: NDArray[np.int32],
    heads: NDArray[np.int32],
    costs: IntArray,
    column: int,
    is_max: bool,
    closed: BoolArray,
    h: IntArray,
    onward: NDArray[np.int32],
    is_open: NDArray[np.uint8],
    tops: IntArray,
    above: NDArray[np.int32],
    below: NDArray[np.int32],
) -> None:
    """Lower h and onward (n,) in one cost where an opened arc (a,) makes the way to a target shorter.

    first, entering  the arcs that enter each node, see :func:`sort_by_head`
    is_open, tops    (n,) 0 and (PILES,) -1 before; above and below (n,) are scratch
    """
    lowest = d = np.int64(0)
    for a in opened:
        u, v = np.int64(tails[a]), np.int64(heads[a])
        if closed[a] or h[v] >= UNREACHABLE:
            continue
        far = max(h[v], costs[a, column]) if is_max else h[v] + costs[a, column]
        if far < h[u]:
            if is_open[u]:
                leave(u, bits(h[u] ^ d), tops, above, below)
            h[u], onward[u], is_open[u] = far, v, 1
            enter(u, bits(far ^ d), tops, above, below)
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
                enter(v, bits(h[v] ^ d), tops, above, below)
                v = following
        v = np.int64(tops[0])
        leave(v, lowest, tops, above, below)
        is_open[v] = 0
        for i in range(first[v], first[v + 1]):
            a = entering[i]
            u = np.int64(tails[a])
            if closed[a] or h[u] <= d:
                continue
            far = max(d, costs[a, column]) if is_max else d + costs[a, column]
            if far < h[u]:
                if is_open[u]:
                    leave(u, bits(h[u] ^ d), tops, above, below)
                h[u], onward[u], is_open[u] = far, v, 1
                enter(u, bits(far ^ d), tops, above, below)


@lean
def is_reached(
    indptr: IntArray,
    heads: NDArray[np.int32],
    closed: BoolArray,
    h: IntArray,
    is_target: NDArray[np.uint8],
    source: int,
    seen: NDArray[np.uint8],
    stack: NDArray[np.int32],
) -> bool:
    """Whether a target is reached from the source by arcs that are open; seen (n,) is 0 before, stack (n,) scratch."""
    size = 1
    stack[0] = source
    seen[source] = 1
    while size > 0:
        size -= 1
        v = np.int64(stack[size])
        if is_target[v]:
            return True
        for a in range(indptr[v], indptr[v + 1]):
            u = np.int64(heads[a])
            if closed[a] or seen[u] or h[u] >= UNREACHABLE:
                continue
            seen[u] = 1
            stack[size] = u
            size += 1
    return False
