"""Tables of nodes and arcs that the general search reads, in its order of costs, and the way back from its labels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel
from hpop.search.machinery.bounds import UNREACHABLE


@kernel
def build(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    order: IntArray,
    h: IntArray,
    is_target: NDArray[np.uint8],
    turn: int,
    group: NDArray[np.int32],
    arcs: NDArray[Any],
    nodes: NDArray[Any],
    origin: NDArray[np.int32],
) -> tuple[IntArray, IntArray]:
    """Fill the tables of arcs and nodes in the order of the search; arcs that lead nowhere are left out.

    order    (k,)         columns of the costs
    turn                  column of the cost that the arcs raise which are to be taken at once, -1 for none
    group    (n,)         the group in which they stay
    arcs     (m, 1 + k)   head and costs
    nodes    (n, k)       lower bounds
    origin   (m,)         where the arc is in the graph

    Returns where the arcs of a node begin (n + 1,), and where those begin that are not taken at once (n,).
    """
    n = len(indptr) - 1
    start = np.zeros(n + 1, np.int64)
    plain = np.zeros(n, np.int64)
    m = 0
    for u in range(n):
        for j in range(len(order)):
            nodes[u, j] = h[order[j], u] if h[order[j], u] < UNREACHABLE else 0
        start[u] = m
        for at_once in (True, False):
            if not at_once:
                plain[u] = m
            for a in range(indptr[u], indptr[u + 1]):
                v = heads[a]
                if v == u or h[0, v] >= UNREACHABLE:
                    continue
                if at_once != (turn >= 0 and costs[a, turn] > 0 and group[u] == group[v] and not is_target[v]):
                    continue
                arcs[m, 0] = v
                for j in range(len(order)):
                    arcs[m, j + 1] = costs[a, order[j]]
                origin[m] = a
                m += 1
    start[n] = m
    return start, plain


@kernel
def trace(origin: NDArray[np.int32], closed: IntArray, labels: IntArray) -> tuple[IntArray, IntArray]:
    """Follow labels back to the source.

    Returns where each path ends (n,) in the arcs of all of them, one after the other, each from its last arc on.
    """
    ends = np.empty(len(labels), np.int64)
    steps = np.empty(1024, np.int64)
    size = 0
    for i in range(len(labels)):
        label = labels[i]
        while label != 0:
            if size == len(steps):
                steps = np.concatenate((steps, np.empty_like(steps)))
            steps[size] = origin[(label & 0xFFFFFFFF) - 1]
            size += 1
            label = closed[(label >> 32) - 1]
        ends[i] = size
    return ends, steps[:size]
