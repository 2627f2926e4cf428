"""The tables of a graph on a clock as kernels read them: what an arc costs at a tick, and what standing costs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import inlined, lean
from hpop.search.timed.graph import RATE, RATE_BITS, TimedGraph

PLAIN, STAYS = -1, -2  # rows of arcs without a table of their own
NARROW = 2**31 - 1
NEVER = 2**40  # a tick later than any


class TimedTables(NamedTuple):
    """What is known of arcs and places.

    start, heads, durations, costs   of the graph
    row      (m,) int32         of the arc in the tables of timed arcs, PLAIN or STAYS
    timed    (c, q, H + 1)      costs of timed arcs; table_of (k,) the table of a column, -1 for none
    blocked  (q, H + 1)
    place    (n,)
    omega    (s, P, H + 1)      what standing costs; omega_of (k,) the table of a column, -1 for none
    rate     (P, k)
    since    (P, H + 1) int32   the first tick from which one may have stood until t
    cut_on   (P,)               whether the place is cut for ever from H on
    is_max   (k,)
    hold     ticks, 0 for none
    """

    start: IntArray
    heads: NDArray[np.int32]
    durations: NDArray[np.int32]
    costs: IntArray
    row: NDArray[np.int32]
    timed: NDArray[Any]
    table_of: IntArray
    blocked: BoolArray
    place: NDArray[np.int32]
    omega: IntArray
    omega_of: IntArray
    rate: IntArray
    since: NDArray[np.int32]
    cut_on: BoolArray
    is_max: BoolArray
    hold: int

    @classmethod
    def of(cls, graph: TimedGraph) -> TimedTables:
        """The tables of a graph."""
        static, k, width = graph.graph, graph.graph.criteria, graph.horizon + 1
        row = np.full(static.arcs, PLAIN, np.int32)
        row[graph.stays] = STAYS
        row[graph.timed] = np.arange(len(graph.timed), dtype=np.int32)
        wide = any(table.max(initial=0) > NARROW for table in graph.costs.values())
        timed, table_of = _stacked(graph.costs, k, (len(graph.timed), width), np.int64 if wide else np.int32)
        omega, omega_of = _stacked(graph.standing, k, (graph.places, width), np.int64)
        last_cut = np.where(graph.cut, np.arange(1, width + 1, dtype=np.int32), np.int32(0))
        since = np.zeros((graph.places, width), np.int32)
        np.maximum.accumulate(last_cut[:, :-1], axis=1, out=since[:, 1:])
        return cls(
            start=static.indptr,
            heads=static.heads,
            durations=graph.durations,
            costs=static.costs,
            row=row,
            timed=timed,
            table_of=table_of,
            blocked=graph.blocked,
            place=graph.place,
            omega=omega,
            omega_of=omega_of,
            rate=graph.rate,
            since=since,
            cut_on=graph.cut[:, -1].copy(),
            is_max=np.array([aggregate == "max" for aggregate in static.aggregates]),
            hold=graph.hold or 0,
        )

    @property
    def own(self) -> list[NDArray[Any]]:
        """The arrays that are not the graph's; tables of one column are taken as they are."""
        stacked: list[NDArray[Any]] = [table for table in (self.timed, self.omega) if len(table) > 1]
        return [self.row, self.since, *stacked]


def own_bytes(graph: TimedGraph) -> int:
    """Bytes of the arrays that tables of a graph have of their own, scratch included."""
    columns = [table for table in (graph.costs, graph.standing) if len(table) > 1]
    stacked = sum(table.nbytes for some in columns for table in some.values())
    return stacked + 4 * graph.graph.arcs + 2 * 4 * graph.cut.size


def _stacked(tables: Any, k: int, shape: tuple[int, int], dtype: Any) -> tuple[NDArray[Any], IntArray]:
    """Tables one over another, and which is that of each column; a single one is not copied.

    They are read-only however they came: kernels would be compiled anew, half a minute, for tables that can be written.
    """
    places = np.full(k, -1)
    places[list(tables)] = np.arange(len(tables))
    if len(tables) == 1:
        (table,) = tables.values()
        stacked = np.ascontiguousarray(table, dtype)[None].view()
    elif tables:
        stacked = np.stack(list(tables.values())).astype(dtype, copy=False)
    else:
        stacked = np.zeros((0, *shape), dtype)
    stacked.setflags(write=False)
    return stacked, places


@inlined
def omega_at(tables: TimedTables, p: int, j: int, t: int) -> int:
    """What standing at a place has cost until tick t, of a sum."""
    rate = tables.rate[p, j]
    s = tables.omega_of[j]
    if s < 0:
        return int((rate * t) >> RATE_BITS)
    last = tables.omega.shape[2] - 1
    if t <= last:
        return int(tables.omega[s, p, t])
    return int(tables.omega[s, p, last] + ((rate * (t - last)) >> RATE_BITS))


@lean
def worst_rate(tables: TimedTables, p: int, j: int, begin: int, end: int) -> int:
    """The worst of standing at a place from a tick to another, of a maximum; 0 of no time."""
    if end <= begin:
        return 0
    s = tables.omega_of[j]
    if s < 0:
        return int(tables.rate[p, j])
    last = tables.omega.shape[2] - 1
    worst = np.int64(0)
    for t in range(min(begin, last), min(end - 1, last) + 1):
        worst = max(worst, tables.omega[s, p, t])
    return int(worst)


@inlined
def free_since(tables: TimedTables, p: int, t: int) -> int:
    """The first tick from which one may have stood at a place until tick t."""
    last = tables.since.shape[1] - 1
    if t > last:
        return t if tables.cut_on[p] else int(tables.since[p, last])
    return int(tables.since[p, t])


@inlined
def is_open(tables: TimedTables, a: int, p: int, t: int) -> bool:
    """Whether an arc whose tail is at place p can be left for at a tick."""
    r = tables.row[a]
    if r == PLAIN:
        return True
    t = min(t, tables.since.shape[1] - 1)
    if r >= 0:
        return bool(not tables.blocked[r, t])
    return bool(free_since(tables, p, t + np.int64(tables.durations[a])) <= t)


@lean
def arc_cost(tables: TimedTables, a: int, p: int, j: int, t: int) -> int:
    """Cost j of an arc whose tail is at place p, left for at a tick."""
    r = tables.row[a]
    base = tables.costs[a, j]
    if r == PLAIN:
        return int(base)
    t = min(t, tables.since.shape[1] - 1)
    if r >= 0:
        c = tables.table_of[j]
        return int(base if c < 0 else tables.timed[c, r, t])
    if tables.omega_of[j] < 0:
        return int(base)
    end = t + np.int64(tables.durations[a])
    if tables.is_max[j]:
        return int(max(base, worst_rate(tables, p, j, t, end)))
    return int(base + omega_at(tables, p, j, end) - omega_at(tables, p, j, t))


# Let arcs that stay lead from u to v and from v to w, with static costs c1, c2 and durations d1, d2, at one place. They
# may be left out, one after the other and with a hold between, if an arc that stays leads from u to w, c3 and d3, with
# d1 + d2 - d3 = 0 or at least a hold, and nowhere dearer when it is followed by that hold (from u back to u: by the
# hold alone). For then the hold takes whatever time is left until the second arc would have ended: at the same place,
# so with the same cuts and the same standing costs in the columns that have a table. In the other columns two arcs pay
# their static costs only, so what the hold costs there must be in c1 + c2 - c3.
#
# The same holds where the label at v was made superfluous by another: its head start is no time or at least a hold too.
# From the horizon on parts of counts are cut off arc by arc, not once for all: so rates there must be whole.


@lean
def one_stay_suffices(tables: TimedTables, nodes: IntArray) -> bool:
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
def is_needless(tables: TimedTables, u: int, p: int, first: int, second: int) -> bool:
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
def is_no_dearer(tables: TimedTables, p: int, first: int, second: int, third: int, spare: Any) -> bool:
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
