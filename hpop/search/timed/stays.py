"""Places where one arc that stays is as good as two: turns in place, whose holds take the time that they save.

Let arcs that stay lead from u to v and from v to w, with static costs c1, c2 and durations d1, d2, at one place. They
may be left out, one after the other and with a hold between, if an arc that stays leads from u to w, c3 and d3, with
d1 + d2 - d3 = 0 or at least a hold, and nowhere dearer when it is followed by that hold (from u back to u: by the hold
alone). For then the hold takes whatever time is left until the second arc would have ended: at the same place, so with
the same cuts and the same standing costs in the columns that have a table. In the other columns two arcs pay their
static costs only, so what the hold costs there must be in c1 + c2 - c3.

The same holds where the label at v was made superfluous by another: its head start is no time or at least a hold too.
From the horizon on parts of counts are cut off arc by arc, not once for all: so rates there must be whole.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.timed.graph import RATE, RATE_BITS
from hpop.search.timed.tables import STAYS, Tables


@lean
def one_stay_suffices(tables: Tables, nodes: IntArray) -> bool:
    """Whether no two arcs that stay need follow each other at a place; nodes are those of it that anybody comes to."""
    for u in nodes:
        p = np.int64(tables.place[u])
        for first in range(tables.start[u], tables.start[u + 1]):
            if tables.row[first] != STAYS:
                continue
            v = np.int64(tables.heads[first])
            for second in range(tables.start[v], tables.start[v + 1]):
                if tables.row[second] == STAYS and not is_needless(tables, u, p, first, second):
                    return False
    return True


@lean
def is_needless(tables: Tables, u: int, p: int, first: int, second: int) -> bool:
    """Whether two arcs that stay, from u on, have no use."""
    w = np.int64(tables.heads[second])
    d = np.int64(tables.durations[first]) + np.int64(tables.durations[second])
    if w == u:
        return bool(is_no_dearer(tables, p, first, second, -1, d))
    for third in range(tables.start[u], tables.start[u + 1]):
        leads_there = bool(tables.row[third] == STAYS and tables.heads[third] == w)
        if leads_there and is_no_dearer(tables, p, first, second, third, d - np.int64(tables.durations[third])):
            return True
    return False


@lean
def is_no_dearer(tables: Tables, p: int, first: int, second: int, third: int, spare: Any) -> bool:
    """Whether an arc, or none (-1), and a hold of the spare ticks cost no more than two arcs."""
    if spare < 0 or (spare > 0 and (tables.hold == 0 or spare < tables.hold)):
        return False
    for j in range(len(tables.is_max)):
        one, two = tables.costs[first, j], tables.costs[second, j]
        direct = tables.costs[third, j] if third >= 0 else np.int64(0)
        rate = tables.rate[p, j]
        if tables.is_max[j]:
            if tables.omega_of[j] < 0 and spare > 0:
                direct = max(direct, rate)
            if direct > max(one, two):
                return False
        else:
            if tables.omega_of[j] >= 0:
                direct += 0 if rate % RATE == 0 else 1
            else:
                direct += (rate * spare + RATE - 1) >> RATE_BITS
                direct += 0 if rate % RATE == 0 else 1
            if direct > one + two:
                return False
    return True
