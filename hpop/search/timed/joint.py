"""Joint lower bounds of what is left of the way, exact on the clock: the least weighted rest, for several weights.

What a label still becomes lies above its supporting lines: w.g + H_w(v, t), with H_w(v, t) the least weighted cost of a
way from v at tick t. The state (v, t) leads to later ones only, so one sweep over ticks, the last first, gives H_w for
all of them: over the arcs that are open at t, or a hold until s >= t + hold and then an arc,
    dep(v, t) = min over arcs (v, u) of w.c(t) + H(u, t + d),
    H(v, t) = min(dep(v, t), min over s of w.W(t, s) + dep(v, s)).
From L(v) + 1 on (:mod:`.calm`) nothing changes: these values come from one Dijkstra a weight. And v cannot be reached
before its earliest tick. So there are few states in between, one row each, after the n rows of those that are calm.

LANES weights are swept at once. Weighted costs are whole numbers of 31 bits, rounded down, and sums stop at FAR: all
this makes less of the truth, which is still a lower bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import lean
from hpop.search.timed.tables import PLAIN, Tables, arc_cost, free_since, is_open, omega_at, worst_rate

LANES = 8  # 32 bytes: one vector register
UNIT = 2.0**27  # what a whole way costs, about; so FAR is eight times as much
FAR = 2**30
DOWN, UP = 1 - 2.0**-40, 1 + 2.0**-40  # more than the rounding of a product and sums of floats

IntLanes = NDArray[np.int32]


class Joint(NamedTuple):
    """Bounds for some tables of LANES weights each.

    weights  (b, LANES, k)  0 of what is a maximum
    rows     (b, r, LANES)  of calm nodes first
    offset   (n,)           of node v at tick t is the row offset[v] + t, until L(v)
    calm     (n,)           L
    alone    (k,)           the lane of the first table that has this cost alone, -1 if none
    shift    (k,)           bits of that cost which the lane leaves out
    """

    weights: FloatArray
    rows: NDArray[np.int32]
    offset: IntArray
    calm: NDArray[np.int32]
    alone: IntArray
    shift: IntArray


class Ahead(NamedTuple):
    """What a sweep reads beside.

    ticks       (n,)  fewest to a target
    earliest    (n,)  tick at which a node may be reached
    arrive_by   the latest tick of an arrival
    is_target   (n,)
    """

    ticks: IntArray
    earliest: IntArray
    arrive_by: int
    is_target: NDArray[np.uint8]


@lean
def row_of(offset: IntArray, calm: NDArray[np.int32], v: int, t: int) -> int:
    """The row of a node at a tick."""
    return v if t > calm[v] else int(offset[v] + t)


@lean
def price_arcs(tables: Tables, weights: FloatArray, out: IntLanes) -> None:
    """Weigh what arcs cost for good, from H on, into `out` (m, LANES); FAR where they are then closed."""
    last = tables.since.shape[1] - 1
    for u in range(len(tables.place)):
        p = np.int64(tables.place[u])
        for a in range(tables.start[u], tables.start[u + 1]):
            if is_open(tables, a, p, last):
                weigh_arc(tables, weights, a, p, last, out[a])
            else:
                for lane in range(LANES):
                    out[a, lane] = FAR


@lean
def weigh_arc(tables: Tables, weights: FloatArray, a: int, p: int, t: int, out: IntLanes) -> None:
    """Weigh what an arc costs at a tick into `out` (LANES,)."""
    for lane in range(LANES):
        total = 0.0
        for j in range(weights.shape[1]):
            if weights[lane, j] > 0.0:
                total += weights[lane, j] * arc_cost(tables, a, p, j, t)
        out[lane] = np.int32(min(FAR - 1.0, total * DOWN))


@lean
def weigh_standing(tables: Tables, weights: FloatArray, p: int, t: int, out: IntArray) -> None:
    """Weigh what standing at a place has cost until tick t into `out` (LANES,)."""
    for lane in range(LANES):
        total = 0.0
        for j in range(weights.shape[1]):
            if weights[lane, j] > 0.0:
                total += weights[lane, j] * omega_at(tables, p, j, t)
        out[lane] = np.int64(total)


@lean
def depart(
    tables: Tables,
    ahead: Ahead,
    weights: FloatArray,
    rows: IntLanes,
    offset: IntArray,
    calm: NDArray[np.int32],
    priced: IntLanes,
    v: int,
    t: int,
    cost: IntLanes,
    out: IntLanes,
) -> None:
    """The least weighted rests (LANES,) of whoever leaves a node at tick t; priced (m, LANES) of arcs for good."""
    for lane in range(LANES):
        out[lane] = FAR
    p = np.int64(tables.place[v])
    for a in range(tables.start[v], tables.start[v + 1]):
        u = np.int64(tables.heads[a])
        end = t + np.int64(tables.durations[a])
        if ahead.ticks[u] > ahead.arrive_by - end or not is_open(tables, a, p, t):
            continue
        row = row_of(offset, calm, u, end)
        if tables.row[a] == PLAIN:
            for lane in range(LANES):
                out[lane] = min(out[lane], np.int32(rows[row, lane] + priced[a, lane]))
            continue
        weigh_arc(tables, weights, a, p, t, cost)
        for lane in range(LANES):
            out[lane] = min(out[lane], np.int32(rows[row, lane] + cost[lane]))


@lean
def sweep(
    tables: Tables,
    ahead: Ahead,
    weights: FloatArray,
    rows: IntLanes,
    offset: IntArray,
    calm: NDArray[np.int32],
    priced: IntLanes,
    order: IntArray,
    scratch: IntLanes,
    standing: IntArray,
    held: IntArray,
    active: IntArray,
) -> None:
    """Fill the rows of the states in between, from those of calm nodes.

    order     (w,)  nodes that have any, the latest L first
    scratch   (2, LANES), standing (3, LANES) and active (w,) are room
    held      (w, hold + 1, LANES)  the least w.Omega(s) + dep(v, s) of s from t on, for the last ticks
    """
    cost, dep = scratch[0], scratch[1]
    now, then, later = standing[0], standing[1], standing[2]
    hold = np.int64(tables.hold)
    ring = hold + 1
    count, coming = 0, 0
    t = np.int64(calm[order[0]]) if len(order) > 0 else np.int64(-1)
    while t >= 0:
        while coming < len(order) and calm[order[coming]] == t:
            active[count] = coming
            coming += 1
            count += 1
        i = 0
        while i < count:
            at = active[i]
            v = order[at]
            row = offset[v] + t
            depart(tables, ahead, weights, rows, offset, calm, priced, v, t, cost, dep)
            if hold > 0:
                p = np.int64(tables.place[v])
                last = np.int64(calm[v])
                weigh_standing(tables, weights, p, t, now)
                weigh_standing(tables, weights, p, t + 1, then)
                stands = free_since(tables, p, t + 1) <= t
                for lane in range(LANES):  # of leaving at t or later
                    after = rows[v, lane] + then[lane] if t == last else held[at, (t + 1) % ring, lane]
                    later[lane] = dep[lane] + now[lane]
                    if stands:
                        later[lane] = min(later[lane], after)
                if free_since(tables, p, t + hold) <= t:
                    weigh_standing(tables, weights, p, t + hold, then)
                    for lane in range(LANES):
                        after = rows[v, lane] + then[lane] if t + hold > last else held[at, (t + hold) % ring, lane]
                        after -= now[lane] + 1  # two sums were rounded
                        if after < FAR - 1:
                            dep[lane] = np.int32(min(np.int64(dep[lane]), max(np.int64(0), after)))
                for lane in range(LANES):
                    held[at, t % ring, lane] = later[lane]
            for lane in range(LANES):
                rows[row, lane] = 0 if ahead.is_target[v] else min(dep[lane], np.int32(FAR))
            if t == ahead.earliest[v]:
                count -= 1
                active[i] = active[count]
            else:
                i += 1
        t -= 1


@lean
def follow(
    tables: Tables,
    ahead: Ahead,
    weights: FloatArray,
    rows: IntLanes,
    offset: IntArray,
    calm: NDArray[np.int32],
    priced: IntLanes,
    lane: int,
    source: int,
    scratch: IntLanes,
    standing: IntArray,
    arcs: IntArray,
    leaves: IntArray,
    total: IntArray,
) -> int:
    """Follow a best way from the source; write its arcs, when they are left for, and what it costs (k,).

    Returns the number of arcs, -1 if it leads nowhere in time.
    """
    cost, dep = scratch[0], scratch[1]
    now = standing[0]
    hold = np.int64(tables.hold)
    v, t, count = np.int64(source), np.int64(0), 0
    while not ahead.is_target[v]:
        if count == len(arcs):
            return -1
        p = np.int64(tables.place[v])
        begin = t
        depart(tables, ahead, weights, rows, offset, calm, priced, v, t, cost, dep)
        best = np.int64(dep[lane])
        if hold > 0 and t <= calm[v]:  # else a hold has no use
            weigh_standing(tables, weights, p, t, now)
            base = now[lane]
            s = t + hold
            while free_since(tables, p, s) <= t and (s <= calm[v] + 1 or s == t + hold):
                depart(tables, ahead, weights, rows, offset, calm, priced, v, s, cost, dep)
                weigh_standing(tables, weights, p, s, now)
                if dep[lane] + now[lane] - base < best:
                    best = dep[lane] + now[lane] - base
                    begin = s
                s += 1
        chosen = -1
        nearest = np.int64(0)
        depart(tables, ahead, weights, rows, offset, calm, priced, v, begin, cost, dep)
        for a in range(tables.start[v], tables.start[v + 1]):
            u = np.int64(tables.heads[a])
            end = begin + np.int64(tables.durations[a])
            if ahead.ticks[u] > ahead.arrive_by - end or not is_open(tables, a, p, begin):
                continue
            weigh_arc(tables, weights, a, p, begin, cost)
            rest = np.int64(rows[row_of(offset, calm, u, end), lane]) + cost[lane]
            if rest <= dep[lane] and rest < FAR and (chosen < 0 or end + ahead.ticks[u] < nearest):
                chosen, nearest = a, end + ahead.ticks[u]
        if chosen < 0:
            return -1
        for j in range(len(total)):
            more = arc_cost(tables, chosen, p, j, begin)
            if tables.is_max[j]:
                total[j] = max(total[j], more, worst_rate(tables, p, j, t, begin))
            else:
                total[j] += more + omega_at(tables, p, j, begin) - omega_at(tables, p, j, t)
        arcs[count], leaves[count] = chosen, begin
        count += 1
        t = begin + np.int64(tables.durations[chosen])
        v = np.int64(tables.heads[chosen])
    return count
