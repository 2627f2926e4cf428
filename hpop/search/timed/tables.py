"""Tables of a time-dependent graph as kernels need them: costs of arcs by tick, and costs of standing.

Time is counted in ticks. From the horizon H on, a tick, nothing changes. A place is a set of nodes at one position. An
arc stays if both its ends are at one place (a turn in place). A timed arc has a cost for each tick of departure. A hold
is a pause at a node, of `hold` ticks at least. A cut is a tick at which the robot must not stand at a place.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import inlined, lean
from hpop.search.timed.graph import RATE, RATE_BITS, TimedGraph

PLAIN, STAYS = -1, -2  # rows of arcs without a table of their own
NARROW = 2**31 - 1
NEVER = 2**40  # later than any tick of a search


class TimedTables(NamedTuple):
    """Tables of a time-dependent graph for kernels; see :class:`.TimedGraph` for arcs, places, cuts and holds.

    start, heads, durations, costs   arcs of the graph: offsets, heads, ticks and static costs
    row       (m,) int32         row of the arc in the tables of timed arcs; PLAIN for an arc that never changes, STAYS
                                 for an arc within a place, which costs standing
    timed     (c, r, H + 1)      c tables: a cost of timed arcs by tick
    table_of  (k,)               index in `timed` of the table of each cost, -1 for a static cost
    blocked   (r, H + 1)         ticks at which timed arcs are closed
    place     (n,)               place of each node
    omega     (s, P, H + 1)      s tables, the `standing` of the graph: for a sum, the cost of standing at each place
                                 from tick 0 to t; for a maximum, its rate during [t, t + 1)
    omega_of  (k,)               index in `omega` of the table of each cost, -1 for none
    rate      (P, k)             cost of standing per tick, for a sum in units of 2^-20 quanta
    since     (P, H + 1) int32   earliest tick such that the robot may stand at the place from then until t
    cut_on    (P,)               whether the robot must not stand at the place from H on
    is_max    (k,)               True for a cost that is a maximum
    hold      least duration of a hold, ticks; 0 if there are no holds
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
        """Return the tables of a time-dependent graph."""
        static, k, width = graph.graph, graph.graph.criteria, graph.horizon + 1
        row = np.full(static.arcs, PLAIN, np.int32)
        row[graph.stays] = STAYS
        row[graph.timed] = graph.rows
        wide = any(table.max(initial=0) > NARROW for table in graph.costs.values())
        timed, table_of = _stacked(graph.costs, k, (len(graph.blocked), width), np.int64 if wide else np.int32)
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
    def own_arrays(self) -> list[NDArray[Any]]:
        """Arrays that do not belong to the graph, to count their bytes; a single table is the graph's own."""
        stacked: list[NDArray[Any]] = [table for table in (self.timed, self.omega) if len(table) > 1]
        return [self.row, self.since, *stacked]


def own_bytes(graph: TimedGraph) -> int:
    """Return how many bytes :meth:`TimedTables.of` needs for a graph, beside the graph itself, scratch included."""
    columns = [table for table in (graph.costs, graph.standing) if len(table) > 1]
    stacked = sum(table.nbytes for tables in columns for table in tables.values())
    return stacked + 4 * graph.graph.arcs + 2 * 4 * graph.cut.size


def _stacked(tables: Any, k: int, shape: tuple[int, int], dtype: Any) -> tuple[NDArray[Any], IntArray]:
    """Stack tables by column into one array; return it, and the index (k,) of each column's table, -1 for none.

    A single table is not copied. The result is read-only, as kernels would be compiled again, for half a minute, for
    writable tables.
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
    """Return cost j, a sum, of standing at place p from tick 0 to t: Omega(t)."""
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
    """Return the largest rate of cost j while the robot stands at place p from tick `begin` to tick `end`.

    Tick `end` itself does not count. Cost j must be one whose total along a path is a maximum, not a sum. Returns 0 if
    `end` is not later than `begin`.
    """
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
    """Return the earliest tick such that the robot may stand at place p from then until tick t."""
    last = tables.since.shape[1] - 1
    if t > last:
        return t if tables.cut_on[p] else int(tables.since[p, last])
    return int(tables.since[p, t])


@inlined
def is_open(tables: TimedTables, a: int, p: int, t: int) -> bool:
    """Return whether arc a, with its tail at place p, is open for a departure at tick t."""
    r = tables.row[a]
    if r == PLAIN:
        return True
    t = min(t, tables.since.shape[1] - 1)
    if r >= 0:
        return bool(not tables.blocked[r, t])
    return bool(free_since(tables, p, t + np.int64(tables.durations[a])) <= t)


@lean
def arc_cost(tables: TimedTables, a: int, p: int, j: int, t: int) -> int:
    """Return cost j of arc a, with its tail at place p, for a departure at tick t."""
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


# The functions below find out where a path never needs two arcs that stay (such as turns in place) one after the other.
#
# Let arcs that stay lead from u to v and from v to w, with static costs c1, c2 and durations d1, d2, at one place. A
# path need not take both, with or without a hold between, if one arc that stays leads from u to w, with c3 and d3, and
# if this arc and a hold of the remaining d1 + d2 - d3 ticks cost no more. These ticks must be 0 or at least a hold; if
# w is u, the hold alone replaces both arcs. The hold is at the same place, so it has the same cuts and, in columns with
# a table, the same costs of standing. In other columns the two arcs cost only their static costs, so the cost of the
# hold must not exceed c1 + c2 - c3.
#
# This is also true if another label made the label at v superfluous, as that label came earlier by 0 ticks or by at
# least a hold. From the horizon on, fractions of quanta are dropped arc by arc rather than once, so rates there must be
# whole.


@lean
def one_stay_suffices(tables: TimedTables, nodes: IntArray) -> bool:
    """Return whether paths never need two consecutive arcs within a place (arcs that stay) that has these nodes.

    Then a search need not try such pairs. The comment above says when one arc and a hold replace two.
    """
    for u in nodes:
        p = np.int64(tables.place[u])
        for first in range(tables.start[u], tables.start[u + 1]):
            if tables.row[first] != STAYS:
                continue
            v = np.int64(tables.heads[first])
            for second in range(tables.start[v], tables.start[v + 1]):
                if tables.row[second] == STAYS and not needs_only_one_stay(tables, u, p, first, second):
                    return False
    return True


@lean
def needs_only_one_stay(tables: TimedTables, u: int, p: int, first: int, second: int) -> bool:
    """Return whether a path from node u at place p never needs arc `second` after arc `first`, which both stay."""
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
    """Return whether arc `third` (-1: no arc) with a hold of `spare` ticks can replace arcs `first` and `second`.

    All three arcs stay at place p. The hold must be allowed, and no cost may become larger.
    """
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
