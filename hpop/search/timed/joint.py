"""Joint lower bounds of the remaining costs: the least weighted remaining cost of each node at each tick.

A lane is one of LANES weight vectors w; let H_w(v, t) be the least weighted cost of a path that starts from node v at
tick t. A label (partial path) with costs g at this node and tick leads only to solutions with a weighted cost of at
least w.g + H_w(v, t). A state (v, t), a node at a tick, leads only to later states. So one sweep over the ticks, from
the last to the first, gives H_w for all states. A path leaves v by an arc that is open at t, or holds (pauses) until s
>= t + hold and then leaves, where W(t, s) are the costs of standing from t to s, and d the ticks of an arc:

    dep(v, t) = min over arcs (v, u) of w.c(t) + H(u, t + d),
    H(v, t) = min(dep(v, t), min over s of w.W(t, s) + dep(v, s)).

From tick L(v) + 1 on nothing changes any more (:mod:`.calm`), and nor do values; they come from one Dijkstra search for
each lane. No state is earlier than the first tick at which its node can be reached. So few states remain in between. A
table has n rows for the nodes after L(v), then a row for each of these states. The nodes of a place are at one
position, and an arc that stays joins two of them.

LANES weights are swept at once. Weighted costs are integers of 31 bits, rounded down, and sums stop at FAR. Both only
decrease values, so they remain lower bounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import inlined, lean, wide
from hpop.search.timed.tables import NEVER, STAYS, TimedTables, arc_cost, free_since, is_open, omega_at

LANES = 8  # number of weight vectors of a table: 32 bytes, one vector register
UNIT = 2.0**27  # approximate weighted cost of a whole path; FAR is eight times as much
FAR = 2**30  # weighted cost that counts as infinite
HALF = FAR / 2 - 1  # limit of the part of an arc's weighted cost that is the same at all ticks, and of the other part
CUT = -1  # marks a weighted cost of standing where the robot must not stand
DOWN, UP = 1 - 2.0**-40, 1 + 2.0**-40  # more than the rounding errors of a product and sums

IntLanes = NDArray[np.int32]
Lanes = tuple[np.int32, np.int32, np.int32, np.int32, np.int32, np.int32, np.int32, np.int32]  # LANES of them


class JointTables(NamedTuple):
    """Tables of joint bounds: b tables with LANES weight vectors (lanes) each.

    weights  (b, LANES, k)  weights of the costs, 0 for maxima
    rows     (b, r, LANES)  least weighted remaining costs, a row for each state; see :class:`.Layout`
    offset   (n,)           the row of node v at tick t is offset[v] + t up to tick L(v), afterwards v
    calm     (n,)           L(v), the last tick at which a departure from v can meet a change (:mod:`.calm`)
    alone    (k,)           for each cost, the lane of the first table that weighs only this cost, -1 if there is none
    shift    (k,)           number of low bits of this cost that its lane drops
    """

    weights: FloatArray
    rows: NDArray[np.int32]
    offset: IntArray
    calm: NDArray[np.int32]
    alone: IntArray
    shift: IntArray


class TimeWindows(NamedTuple):
    """Bounds on the ticks at which a path can pass each node.

    ticks       (n,)  fewest ticks from the node to a target
    earliest    (n,)  earliest tick at which a path reaches the node
    arrive_by   latest tick of an arrival at a target
    is_target   (n,)  mask
    """

    ticks: IntArray
    earliest: IntArray
    arrive_by: int
    is_target: NDArray[np.uint8]


@inlined
def row_of(offset: IntArray, calm: NDArray[np.int32], v: int, t: int) -> int:
    """Return the row of node v at tick t in a table of joint bounds, from fields of :class:`JointTables`."""
    return v if t > calm[v] else int(offset[v] + t)


@lean
def weigh_final_arcs(tables: TimedTables, weights: FloatArray, priced: IntLanes, fixed: IntLanes) -> None:
    """Write the weighted costs of arcs from the horizon H on to `priced` (m, LANES), FAR for arcs closed by then.

    weights  (k, LANES)  weights of the costs, one column for each lane
    fixed    (m, LANES)  output: the part of the weighted cost that is the same at all ticks
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
    tables: TimedTables, weights: FloatArray, most: FloatArray, fixed: IntLanes, a: int, t: int, out: IntLanes
) -> None:
    """Write the costs of timed arc a for a departure at tick t, weighted by each weight vector, to `out` (1, LANES).

    weights  (k, LANES)  weights of the costs, one column for each lane
    most     (k,)        costs above this value count as this value, so that no weighted sum overflows
    fixed    (m, LANES)  of :func:`weigh_final_arcs`
    """
    for lane in range(LANES):
        out[0, lane] = fixed[a, lane]
    r, t = tables.row[a], min(t, tables.since.shape[1] - 1)
    for j in range(len(weights)):
        c = tables.table_of[j]
        if c >= 0 and not tables.is_max[j]:
            more = min(np.float64(tables.timed[c, r, t]), most[j])
            if more > 0.0:
                for lane in range(LANES):
                    out[0, lane] += np.int32(weights[j, lane] * more)


@inlined
def weigh_stay(
    tables: TimedTables, weights: FloatArray, most: FloatArray, p: int, t: int, ticks: int, out: IntLanes
) -> None:
    """Write the weighted cost of standing at place p from tick t on, for a number of ticks, to `out[ticks]` (LANES,).

    Only costs with a table count, and no maxima. Lane 0 is CUT if the robot must not stand there so long. `weights` and
    `most` are those of :func:`weigh_arc`.
    """
    t = min(t, tables.since.shape[1] - 1)
    for lane in range(LANES):
        out[ticks, lane] = 0
    for j in range(len(weights)):
        if tables.omega_of[j] >= 0 and not tables.is_max[j]:
            more = min(np.float64(omega_at(tables, p, j, t + ticks) - omega_at(tables, p, j, t)), most[j])
            if more > 0.0:
                for lane in range(LANES):
                    out[ticks, lane] += np.int32(weights[j, lane] * more)
    if free_since(tables, p, t + ticks) > t:
        out[ticks, 0] = CUT


@inlined
def weigh_standing(tables: TimedTables, weights: FloatArray, p: int, t: int, out: IntArray) -> None:
    """Write the weighted costs of standing at place p from tick 0 to t to `out` (LANES,), one for each weight vector.

    Differences of two results are costs of standing in between. Costs that are maxima are left out.

    weights  (k, LANES)  weights of the costs, one column for each lane
    """
    for lane in range(LANES):
        out[lane] = 0
    for j in range(len(weights)):
        if not tables.is_max[j]:
            spent = np.float64(omega_at(tables, p, j, t))
            if spent > 0.0:
                for lane in range(LANES):
                    out[lane] += np.int64(weights[j, lane] * spent)


class JointSweep(NamedTuple):
    """Working arrays for the sweep of one table, with LANES weight vectors (lanes).

    weights   (k, LANES)  weight of each cost in each lane
    most      (k,)        costs above this value count as this value, so that no weighted sum overflows
    fixed     (m, LANES)  part of the arcs' weighted costs that is the same at all ticks
    rows      (r, LANES)  the table; rows for ticks after L(v) are filled before the sweep
    offset, calm          fields of :class:`JointTables`
    order     (w,)        nodes with rows up to L(v), grouped by place
    first     (p + 1,)    index in `order` of the first node of each place
    together  least duration of an arc, ticks; so many ticks are swept together
    held      (w, power of two, LANES)  least w.Omega(s) + dep(v, s) over s from t on, for the last ticks t; Omega(s)
                          are the costs of standing from tick 0 to s
    rounded   (LANES,)    number of weights that are not whole; their products are rounded
    stay      (ticks, LANES)  weighted cost of standing by duration, for the place and tick in `stay_of` (ticks,)
    cost (1, LANES), dep, now, then, later  (LANES,)  scratch
    """

    weights: FloatArray
    most: FloatArray
    fixed: IntLanes
    rows: IntLanes
    offset: IntArray
    calm: NDArray[np.int32]
    order: IntArray
    first: IntArray
    together: int
    held: IntArray
    rounded: IntArray
    stay: IntLanes
    stay_of: IntArray
    cost: IntLanes
    dep: IntLanes
    now: IntArray
    then: IntArray
    later: IntArray


@inlined
def lower(least: Lanes, rows: IntLanes, row: int, costs: IntLanes, of: int) -> Lanes:
    """Return for each lane the minimum of `least` and rows[row] + costs[of].

    `least` is the best weighted cost so far, `rows[row]` the remaining cost after an arc, and `costs[of]` that of the
    arc. It is written out, lane by lane, so that it is vectorised.
    """
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
def lower_by_stay(least: Lanes, rows: IntLanes, row: int, fixed: IntLanes, a: int, stay: IntLanes, ticks: int) -> Lanes:
    """Return for each lane the minimum of `least` and rows[row] + fixed[a] + stay[ticks].

    Like :func:`lower`, for arc a within a place, which costs `fixed[a]` and standing for its duration, `stay[ticks]`.
    """
    return (
        min(least[0], np.int32(rows[row, 0] + fixed[a, 0] + stay[ticks, 0])),
        min(least[1], np.int32(rows[row, 1] + fixed[a, 1] + stay[ticks, 1])),
        min(least[2], np.int32(rows[row, 2] + fixed[a, 2] + stay[ticks, 2])),
        min(least[3], np.int32(rows[row, 3] + fixed[a, 3] + stay[ticks, 3])),
        min(least[4], np.int32(rows[row, 4] + fixed[a, 4] + stay[ticks, 4])),
        min(least[5], np.int32(rows[row, 5] + fixed[a, 5] + stay[ticks, 5])),
        min(least[6], np.int32(rows[row, 6] + fixed[a, 6] + stay[ticks, 6])),
        min(least[7], np.int32(rows[row, 7] + fixed[a, 7] + stay[ticks, 7])),
    )


@inlined
def depart(tables: TimedTables, ahead: TimeWindows, work: JointSweep, v: int, t: int) -> None:
    """Write dep(v, t), the least weighted remaining costs of a path that leaves node v at tick t, to `work.dep`.

    The rows of later ticks must be filled already. `ahead` excludes arcs after which no target is reached in time.
    """
    far = np.int32(FAR)
    least = (far, far, far, far, far, far, far, far)
    p = np.int64(tables.place[v])
    state = p * np.int64(NEVER) + t
    for a in range(tables.start[v], tables.start[v + 1]):
        u = np.int64(tables.heads[a])
        ticks = np.int64(tables.durations[a])
        end = t + ticks
        if ahead.ticks[u] > ahead.arrive_by - end:
            continue
        r = tables.row[a]
        if r == STAYS:
            if work.stay_of[ticks] != state:  # nodes of a place are consecutive, and their arcs last equally long
                work.stay_of[ticks] = state
                weigh_stay(tables, work.weights, work.most, p, t, ticks, work.stay)
            if work.stay[ticks, 0] == CUT:
                continue
        elif r >= 0:
            if not is_open(tables, a, p, t):
                continue
            weigh_arc(tables, work.weights, work.most, work.fixed, a, t, work.cost)
        row = row_of(work.offset, work.calm, u, end)
        if r == STAYS:
            least = lower_by_stay(least, work.rows, row, work.fixed, a, work.stay, ticks)
        elif r >= 0:
            least = lower(least, work.rows, row, work.cost, 0)
        else:
            least = lower(least, work.rows, row, work.fixed, a)
    for lane, each in enumerate(least):
        work.dep[lane] = each


@wide
def sweep(tables: TimedTables, ahead: TimeWindows, work: JointSweep, state: IntArray, steps: int) -> bool:
    """Go on with the sweep of a table: fill the rows of about ``steps`` states; return whether all rows are filled.

    Ticks are processed in blocks, the last block first. No arc is shorter than a block, so within a block states depend
    only on states of the same node. So places are processed one after another, each for the whole block, with local
    memory access.

    ahead  time windows of the nodes, which leave out states from which no target is reached in time
    work   arrays of the sweep, of which the rows are written
    state  (2,)  progress: the latest tick of the current block, and the current place; before the first call, the
                 latest tick of all, and 0
    """
    dep, now, then, later = work.dep, work.now, work.then, work.later
    hold, order, calm, rows = np.int64(tables.hold), work.order, work.calm, work.rows
    ring, places = work.held.shape[1] - 1, len(work.first) - 1
    stands = may_hold = False
    while state[0] >= 0 and steps > 0:
        begin, end = work.first[state[1]], work.first[state[1] + 1]
        p = np.int64(tables.place[order[begin]])
        for t in range(state[0], max(np.int64(-1), state[0] - work.together), -1):
            is_weighed = False  # the cost of standing here
            for at in range(begin, end):
                v = order[at]
                last = np.int64(calm[v])
                if t > last or t < ahead.earliest[v]:
                    continue
                steps -= 1
                depart(tables, ahead, work, v, t)
                if hold > 0:
                    if not is_weighed:
                        is_weighed = True
                        weigh_standing(tables, work.weights, p, t, now)
                        stands = free_since(tables, p, t + 1) <= t
                        may_hold = free_since(tables, p, t + hold) <= t
                    if stands and t == last:
                        weigh_standing(tables, work.weights, p, t + 1, then)
                    for lane in range(LANES):  # cost of leaving at t or later
                        later[lane] = dep[lane] + now[lane]
                        if stands:
                            after = rows[v, lane] + then[lane] if t == last else work.held[at, (t + 1) & ring, lane]
                            later[lane] = min(later[lane], after)
                    if may_hold:
                        if t + hold > last:
                            weigh_standing(tables, work.weights, p, t + hold, then)
                        for lane in range(LANES):
                            after = rows[v, lane] + then[lane]
                            if t + hold <= last:
                                after = work.held[at, (t + hold) & ring, lane]
                            after -= now[lane] + work.rounded[lane]
                            if after < FAR - 1:
                                dep[lane] = np.int32(min(np.int64(dep[lane]), max(np.int64(0), after)))
                    for lane in range(LANES):
                        work.held[at, t & ring, lane] = later[lane]
                row = work.offset[v] + t
                for lane in range(LANES):
                    rows[row, lane] = np.int32(0) if ahead.is_target[v] else min(dep[lane], np.int32(FAR))
        state[1] += 1
        if state[1] == places:
            state[0], state[1] = state[0] - work.together, 0
    return bool(state[0] < 0)
