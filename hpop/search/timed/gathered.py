"""Holds gathered: of paths that cost the same, one that stops less often.

A search keeps one path of each cost vector, whichever comes first: where waiting costs the same at several places, it
may stop at each of them for a while. So of each path that is found pairs of holds are tried as one, at the place of
the first or of the second; what lies between is then left for later or earlier, and all of it is costed anew. The path
that remains costs the same, and no two of its holds could be one.
"""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel
from hpop.search.timed.tables import Tables
from hpop.search.timed.walks import cost_of_walk


@kernel
def gather_holds(tables: Tables, source: int, begin: int, arcs: IntArray, leaves: IntArray, costs: IntArray) -> int:
    """Make two holds one while the path costs the same (k,); leaves (s,) are changed; returns how many are left."""
    total = np.empty(len(costs), np.int64)
    tried = leaves.copy()
    waits = np.zeros(len(arcs), np.int64)
    again = True
    while again:
        again = False
        ready = np.int64(begin)
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
                    if cost_of_walk(tables, source, begin, arcs, tried, total) >= 0 and (total == costs).all():
                        leaves[:] = tried
                        again = True
                        break
                if again:
                    break
            if again:
                break
    return int((waits > 0).sum())
