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

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import inlined, lean, wide
from hpop.search.timed.tables import PLAIN, STAYS, Tables, arc_cost, free_since, is_open, omega_at

LANES = 8  # 32 bytes: one vector register
UNIT = 2.0**27  # what a whole way costs, about; so FAR is eight times as much
FAR = 2**30
HALF = FAR / 2 - 1  # of an arc: what of it is always the same, and the rest
DOWN, UP = 1 - 2.0**-40, 1 + 2.0**-40  # more than the rounding of a product and sums of floats

IntLanes = NDArray[np.int32]
Lanes = tuple[np.int32, np.int32, np.int32, np.int32, np.int32, np.int32, np.int32, np.int32]  # LANES of them


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
    quiet       (P, H + 1)  until when standing at a place, from a tick on, costs what it does at any time
    """

    ticks: IntArray
    earliest: IntArray
    arrive_by: int
    is_target: NDArray[np.uint8]
    quiet: NDArray[np.int32]


@inlined
def row_of(offset: IntArray, calm: NDArray[np.int32], v: int, t: int) -> int:
    """The row of a node at a tick."""
    return v if t > calm[v] else int(offset[v] + t)


@lean
def find_quiet(tables: Tables, quiet: NDArray[np.int32]) -> None:
    """Write until when (P, H + 1) nothing happens at places: no table of a sum rises, and one may stand there."""
    last = quiet.shape[1] - 1
    for p in range(len(quiet)):
        quiet[p, last] = last
        for t in range(last - 1, -1, -1):
            same = tables.since[p, t + 1] <= t
            for j in range(len(tables.is_max)):
                s = tables.omega_of[j]
                if s >= 0 and not tables.is_max[j]:
                    same &= tables.omega[s, p, t] == tables.omega[s, p, t + 1]
            quiet[p, t] = quiet[p, t + 1] if same else t


@lean
def price_arcs(tables: Tables, weights: FloatArray, priced: IntLanes, fixed: IntLanes) -> None:
    """Weigh what arcs cost for good, from H on, into `priced` (m, LANES), FAR where they are then closed.

    weights  (k, LANES)
    fixed    (m, LANES)  what of their costs is the same at all ticks
    """
    last = tables.since.shape[1] - 1
    for u in range(len(tables.place)):
        p = np.int64(tables.place[u])
        for a in range(tables.start[u], tables.start[u + 1]):
            r = tables.row[a]
            for lane in range(LANES):
                total = always = 0.0
                for j in range(len(weights)):
                    weight = weights[j, lane]
                    if weight == 0.0:
                        continue
                    total += weight * arc_cost(tables, a, p, j, last)
                    if r < 0 or tables.table_of[j] < 0:
                        always += weight * tables.costs[a, j]
                priced[a, lane] = np.int32(min(FAR - 1.0, total))
                fixed[a, lane] = np.int32(min(HALF, always))
            if not is_open(tables, a, p, last):
                for lane in range(LANES):
                    priced[a, lane] = FAR


@inlined
def weigh_arc(
    tables: Tables, weights: FloatArray, most: FloatArray, fixed: IntLanes, a: int, p: int, t: int, out: IntLanes
) -> None:
    """Weigh what an arc costs at a tick into `out` (1, LANES), less of it where that passes HALF.

    weights  (k, LANES); most (k,) of a cost that all lanes can weigh
    """
    for lane in range(LANES):
        out[0, lane] = fixed[a, lane]
    r = tables.row[a]
    if r == PLAIN:
        return
    t = min(t, tables.since.shape[1] - 1)
    for j in range(len(weights)):
        if tables.is_max[j]:
            continue
        if r >= 0:
            c = tables.table_of[j]
            if c < 0:
                continue
            more = min(np.float64(tables.timed[c, r, t]), most[j])
        else:
            if tables.omega_of[j] < 0:
                continue
            spent = omega_at(tables, p, j, t + np.int64(tables.durations[a])) - omega_at(tables, p, j, t)
            more = min(np.float64(spent), most[j])
        if more > 0.0:
            for lane in range(LANES):
                out[0, lane] += np.int32(weights[j, lane] * more)


@inlined
def weigh_standing(tables: Tables, weights: FloatArray, p: int, t: int, out: IntArray) -> None:
    """Weigh what standing at a place has cost until tick t into `out` (LANES,); weights (k, LANES)."""
    for lane in range(LANES):
        out[lane] = 0
    for j in range(len(weights)):
        if not tables.is_max[j]:
            spent = np.float64(omega_at(tables, p, j, t))
            if spent > 0.0:
                for lane in range(LANES):
                    out[lane] += np.int64(weights[j, lane] * spent)


class Sweep(NamedTuple):
    """What a sweep for LANES weights works on.

    weights   (k, LANES); most (k,) of a cost that all lanes can weigh
    fixed     (m, LANES)  what of the arcs' costs is the same at all ticks
    rows      (r, LANES)  the table, its calm rows filled
    order     (w,)        nodes that have other rows, those of a place together; place_in (n,) there, -1 if none
    entering  (w,)        places in `order`, the latest L first
    recent    (power of two times w, LANES)   rows of the last ticks, a tick at a time: near each other in memory
    held      (power of two, w, LANES)  the least w.Omega(s) + dep(v, s) of s from t on, for the last ticks
    rounded   (LANES,)    weights that are no whole numbers: what they weigh is rounded
    cost (1, LANES), dep, now, then, later  (LANES,)  room
    """

    weights: FloatArray
    most: FloatArray
    fixed: IntLanes
    rows: IntLanes
    offset: IntArray
    calm: NDArray[np.int32]
    order: IntArray
    place_in: IntArray
    entering: IntArray
    recent: NDArray[np.int32]
    held: IntArray
    rounded: IntArray
    cost: IntLanes
    dep: IntLanes
    now: IntArray
    then: IntArray
    later: IntArray


@inlined
def lower(least: Lanes, rows: IntLanes, row: int, costs: IntLanes, of: int) -> Lanes:
    """The lesser of what is least and the sum of two rows. Spelled out: in memory, each lane would be one by itself."""
    return (
        min(least[0], np.int32(rows[row, 0] + costs[of, 0])),
        min(least[1], np.int32(rows[row, 1] + costs[of, 1])),
        min(least[2], np.int32(rows[row, 2] + costs[of, 2])),
        min(least[3], np.int32(rows[row, 3] + costs[of, 3])),
        min(least[4], np.int32(rows[row, 4] + costs[of, 4])),
        min(least[5], np.int32(rows[row, 5] + costs[of, 5])),
        min(least[6], np.int32(rows[row, 6] + costs[of, 6])),
        min(least[7], np.int32(rows[row, 7] + costs[of, 7])),
    )


@inlined
def depart(tables: Tables, ahead: Ahead, work: Sweep, v: int, t: int, swept: bool) -> None:
    """Write the least weighted rests of whoever leaves a node at tick t into `dep`; swept, if all rows are filled."""
    far = np.int32(FAR)
    least = (far, far, far, far, far, far, far, far)
    p, w = np.int64(tables.place[v]), len(work.order)
    quiet = np.int64(ahead.quiet[p, min(t, ahead.quiet.shape[1] - 1)])
    slabs = len(work.recent) // max(1, w) - 1
    for a in range(tables.start[v], tables.start[v + 1]):
        u = np.int64(tables.heads[a])
        end = t + np.int64(tables.durations[a])
        if ahead.ticks[u] > ahead.arrive_by - end:
            continue
        r = tables.row[a]
        always = r == PLAIN or (r == STAYS and end <= quiet)
        if not always:
            if not is_open(tables, a, p, t):
                continue
            weigh_arc(tables, work.weights, work.most, work.fixed, a, p, t, work.cost)
        if swept or end > work.calm[u]:
            row = row_of(work.offset, work.calm, u, end)
            if always:
                least = lower(least, work.rows, row, work.fixed, a)
            else:
                least = lower(least, work.rows, row, work.cost, 0)
        else:
            row = (end & slabs) * w + work.place_in[u]
            if always:
                least = lower(least, work.recent, row, work.fixed, a)
            else:
                least = lower(least, work.recent, row, work.cost, 0)
    for lane, each in enumerate(least):
        work.dep[lane] = each


@lean
def enter_nodes(work: Sweep, t: int, active: IntArray, count: Any, coming: Any) -> Any:
    """Add the nodes whose rows begin at tick t to the first `count` of `active`, which rise; return how many."""
    more = np.int64(0)
    while coming + more < len(work.order) and work.calm[work.order[work.entering[coming + more]]] == t:
        more += 1
    old, new, at = count - 1, coming + more - 1, count + more - 1
    while new >= coming:
        if old >= 0 and active[old] > work.entering[new]:
            active[at] = active[old]
            old -= 1
        else:
            active[at] = work.entering[new]
            new -= 1
        at -= 1
    return more


@wide
def sweep(tables: Tables, ahead: Ahead, work: Sweep, active: IntArray, state: IntArray, steps: int) -> bool:
    """Fill the rows of so many states in between, or of all that are left; whether all are filled.

    state (4,) is where it is: the tick, how many nodes have rows at it, how many of `entering` have had, and which of
    them is next, for a start the latest tick and zeros; active (w,) are the nodes that have rows at this tick. They
    come in the order of memory, so that rows of the places about are in the processor's cache.
    """
    dep, now, then, later = work.dep, work.now, work.then, work.later
    hold, order, calm, rows = np.int64(tables.hold), work.order, work.calm, work.rows
    ring, slabs = len(work.held) - 1, len(work.recent) // max(1, len(order)) - 1
    t, count, coming, i = state[0], state[1], state[2], state[3]
    before = np.int64(-1)  # the place of the last node: what standing there costs is known
    stands = may_hold = False
    while t >= 0 and steps > 0:
        if i == 0:
            more = enter_nodes(work, t, active, count, coming)
            count += more
            coming += more
            before = np.int64(-1)
        while i < count and steps > 0:
            steps -= 1
            at = active[i]
            v = order[at]
            depart(tables, ahead, work, v, t, False)
            if hold > 0:
                p = np.int64(tables.place[v])
                last = np.int64(calm[v])
                if p != before:
                    before = p
                    weigh_standing(tables, work.weights, p, t, now)
                    stands = free_since(tables, p, t + 1) <= t
                    may_hold = free_since(tables, p, t + hold) <= t
                if stands and t == last:
                    weigh_standing(tables, work.weights, p, t + 1, then)
                for lane in range(LANES):  # of leaving at t or later
                    later[lane] = dep[lane] + now[lane]
                    if stands:
                        after = rows[v, lane] + then[lane] if t == last else work.held[(t + 1) & ring, at, lane]
                        later[lane] = min(later[lane], after)
                if may_hold:
                    if t + hold > last:
                        weigh_standing(tables, work.weights, p, t + hold, then)
                    for lane in range(LANES):
                        after = rows[v, lane] + then[lane]
                        if t + hold <= last:
                            after = work.held[(t + hold) & ring, at, lane]
                        after -= now[lane] + work.rounded[lane]
                        if after < FAR - 1:
                            dep[lane] = np.int32(min(np.int64(dep[lane]), max(np.int64(0), after)))
                for lane in range(LANES):
                    work.held[t & ring, at, lane] = later[lane]
            row, to = work.offset[v] + t, (t & slabs) * len(order) + at
            for lane in range(LANES):
                least = np.int32(0) if ahead.is_target[v] else min(dep[lane], np.int32(FAR))
                rows[row, lane] = least
                work.recent[to, lane] = least
            i += 1
        if i == count:
            count = np.int64(0)
            for at in active[:i]:
                active[count] = at
                count += t != ahead.earliest[order[at]]
            t, i = t - 1, np.int64(0)
    state[0], state[1], state[2], state[3] = t, count, coming, i
    return bool(t < 0)
