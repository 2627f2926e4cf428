"""The tables of nodes and arcs that a search reads, in its own order of costs, and the way back from a label."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.planners.search.bounds import UNREACHABLE
from hpop.planners.search.kernels import kernel


@kernel
def build(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    order: IntArray,
    index: int,
    h: IntArray,
    arcs: NDArray[Any],
    nodes: NDArray[Any],
    origin: NDArray[np.int32],
) -> tuple[IntArray, IntArray]:
    """Fill the tables of arcs and nodes in the order of the search; arcs that lead nowhere are left out.

    order    (k,)         columns of the costs; -1 is a cost that is always 0
    index                 column that makes an arc a turn, or -1: no turns
    arcs     (m, 1 + k)   head and costs; at each node plain arcs first, then turns
    nodes    (n, k ...)   lower bounds
    origin   (m,)         where the arc is in the graph

    Returns the offsets of the arcs (n + 1,), and where the turns of each node begin (n,).
    """
    n = len(indptr) - 1
    start = np.zeros(n + 1, np.int64)
    split = np.zeros(n, np.int64)
    m = 0
    for u in range(n):
        for j in range(len(order)):
            nodes[u, j] = h[order[j], u] if order[j] >= 0 and h[order[j], u] < UNREACHABLE else 0
        start[u] = m
        for turns in (False, True):
            if turns:
                split[u] = m
            for a in range(indptr[u], indptr[u + 1]):
                v = heads[a]
                is_turn = index >= 0 and costs[a, index] > 0
                if v == u or h[0, v] >= UNREACHABLE or is_turn != turns:
                    continue
                arcs[m, 0] = v
                for j in range(len(order)):
                    arcs[m, j + 1] = costs[a, order[j]] if order[j] >= 0 else 0
                origin[m] = a
                m += 1
    start[n] = m
    return start, split


@kernel
def trace(
    start: IntArray,
    split: IntArray,
    arcs: NDArray[Any],
    origin: NDArray[np.int32],
    closed: IntArray,
    source: int,
    label: int,
) -> IntArray:
    """Follow a label back to the source; where the arcs do not join, the turn between them is put in."""
    steps = []
    while label != 0:
        a = (label & 0xFFFFFFFF) - 1
        steps.append(np.int64(origin[a]))
        label = closed[(label >> 32) - 1]
        at = np.int64(arcs[(label & 0xFFFFFFFF) - 1, 0]) if label != 0 else source
        if not start[at] <= a < start[at + 1]:
            t = split[at]
            while not start[arcs[t, 0]] <= a < start[arcs[t, 0] + 1]:
                t += 1
            steps.append(np.int64(origin[t]))
    return np.array(steps[::-1], np.int64)
