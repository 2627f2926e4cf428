"""Holds gathered: of paths that cost the same, one that stops less often.

A search keeps one path of each cost vector, whichever comes first: where waiting costs the same at several places, it
may stop at each of them for a while. So of each path that is found pairs of holds are tried as one, at the place of
the first or of the second; what lies between is then left for later or earlier, and all of it is costed anew. The path
that remains costs the same, and no two of its holds could be one.
"""

from __future__ import annotations

import numpy as np

from hpop.arrays import IntArray
from hpop.compiled import kernel, lean
from hpop.search.timed.tables import Tables, arc_cost, free_since, is_open, omega_at, worst_rate


@lean
def cost_of_walk(tables: Tables, source: int, arcs: IntArray, leaves: IntArray, total: IntArray) -> bool:
    """Add up in total (k,) the costs of arcs left for at some ticks, holds between them; False where that cannot be."""
    for j in range(len(total)):
        total[j] = 0
    v, ready = np.int64(source), np.int64(0)
    for i in range(len(arcs)):
        p, t, a = tables.place[v], leaves[i], arcs[i]
        waits = t - ready
        if waits < 0 or 0 < waits < tables.hold or (waits > 0 and free_since(tables, p, t) > ready):
            return False
        if not is_open(tables, a, p, t):
            return False
        for j in range(len(total)):
            cost = arc_cost(tables, a, p, j, t)
            if tables.is_max[j]:
                total[j] = max(total[j], cost, worst_rate(tables, p, j, ready, t))
            else:
                total[j] += cost + (omega_at(tables, p, j, t) - omega_at(tables, p, j, ready) if waits > 0 else 0)
        v, ready = np.int64(tables.heads[a]), t + np.int64(tables.durations[a])
    return True


@kernel
def gather_holds(tables: Tables, source: int, arcs: IntArray, leaves: IntArray, costs: IntArray) -> int:
    """Make two holds one while the path costs the same (k,); leaves (s,) are changed; returns how many are left."""
    total = np.empty(len(costs), np.int64)
    tried = leaves.copy()
    waits = np.zeros(len(arcs), np.int64)
    again = True
    while again:
        again = False
        ready = np.int64(0)
        for i in range(len(arcs)):
            waits[i] = leaves[i] - ready
            ready = leaves[i] + np.int64(tables.durations[arcs[i]])
        for i in range(len(arcs)):
            for j in range(i + 1, len(arcs) if waits[i] > 0 else 0):
                if waits[j] == 0:
                    continue
                for later in (waits[j], -waits[i]):  # all at the first place, or all at the second
                    for between in range(len(arcs)):
                        tried[between] = leaves[between] + (later if i <= between < j else 0)
                    if cost_of_walk(tables, source, arcs, tried, total) and (total == costs).all():
                        leaves[:] = tried
                        again = True
                        break
                if again:
                    break
            if again:
                break
    return int((waits > 0).sum())
