"""Walks on a clock: whether a graph allows them, and what they cost."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.timed.tables import Tables, arc_cost, free_since, is_open, omega_at, worst_rate


@lean
def cost_of_walk(tables: Tables, source: int, begin: int, arcs: IntArray, leaves: IntArray, total: IntArray) -> int:
    """Write what a walk costs that leaves a node at a tick and takes arcs (s,) at ticks (s,), holds between them.

    It is written into total (k,).

    Returns the node where it ends; -1 if it is none of this graph, or holds so long after the horizon that no search
    would. The numbers may be any.
    """
    for j in range(len(total)):
        total[j] = 0
    v, t, last = np.int64(source), np.int64(begin), tables.since.shape[1] - 1
    for i in range(len(arcs)):
        a, leave = arcs[i], leaves[i]
        if not 0 <= a < len(tables.heads) or not tables.start[v] <= a < tables.start[v + 1]:
            return -1
        p = np.int64(tables.place[v])
        held = leave - t
        if held != 0 and (tables.hold == 0 or held < tables.hold or free_since(tables, p, leave) > t):
            return -1
        if held != 0 and leave > last + tables.hold:  # a hold that no search makes
            return -1
        if not is_open(tables, a, p, leave):
            return -1
        for j in range(len(total)):
            more = arc_cost(tables, a, p, j, leave)
            if tables.is_max[j]:
                total[j] = max(total[j], more, worst_rate(tables, p, j, t, leave))
            else:
                total[j] += more + omega_at(tables, p, j, leave) - omega_at(tables, p, j, t)
        v, t = np.int64(tables.heads[a]), leave + np.int64(tables.durations[a])
    return int(v)
