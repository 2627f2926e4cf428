"""Paths on time-dependent graphs: best paths for given weights, costs of a path, and paths with fewer holds.

A lane is one weight vector of a table of joint bounds (:mod:`.joint`). A hold is a pause at a node. A place is a set of
nodes at one position; an arc stays if both its ends are at one place.
"""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.timed.joint import FAR, LANES, UNIT, JointSweep, TimeWindows, depart, row_of, weigh_standing
from hpop.search.timed.tables import PLAIN, STAYS, TimedTables, arc_cost, free_since, is_open, omega_at, worst_rate


@lean
def remaining_cost_by_arc(
    tables: TimedTables, ahead: TimeWindows, work: JointSweep, lane: int, a: int, p: int, t: int
) -> int:
    """Return the least weighted remaining cost of a path that begins with arc a at tick t; FAR if it is not allowed.

    p      place of the arc's tail
    ahead  time windows: a path is not allowed if it can reach no target in time
    work   sweep with the table of joint bounds
    lane   index of the weights in this table
    """
    u = np.int64(tables.heads[a])
    end = t + np.int64(tables.durations[a])
    if ahead.ticks[u] > ahead.arrive_by - end or not is_open(tables, a, p, t):
        return FAR
    cost = np.int64(work.fixed[a, lane])
    r = tables.row[a]
    column = min(t, tables.since.shape[1] - 1)
    for j in range(0 if r == PLAIN else len(work.weights)):
        if tables.is_max[j] or (tables.table_of[j] if r >= 0 else tables.omega_of[j]) < 0:
            continue
        if r >= 0:
            more = np.float64(tables.timed[tables.table_of[j], r, column])
        else:
            after = column + np.int64(tables.durations[a])
            more = np.float64(omega_at(tables, p, j, after) - omega_at(tables, p, j, column))
        cost += np.int64(work.weights[j, lane] * min(more, work.most[j]))
    return int(min(np.int64(FAR), work.rows[row_of(work.offset, work.calm, u, end), lane] + cost))


@lean
def continues_at_once(tables: TimedTables, ahead: TimeWindows, work: JointSweep, lane: int, a: int, t: int) -> bool:
    """Return whether a path that is best for a lane (weight vector) can go on to another place directly after arc a.

    The path takes the arc at tick t. The result is also True if the arc ends at a target. Arguments as for
    :func:`remaining_cost_by_arc`.
    """
    u, end = np.int64(tables.heads[a]), t + np.int64(tables.durations[a])
    p = np.int64(tables.place[u])
    least = np.int64(work.rows[row_of(work.offset, work.calm, u, end), lane])
    for b in range(tables.start[u], tables.start[u + 1]):
        if tables.row[b] != STAYS and remaining_cost_by_arc(tables, ahead, work, lane, b, p, end) <= least:
            return True
    return bool(ahead.is_target[u])


@lean
def trace_best_path(
    tables: TimedTables,
    ahead: TimeWindows,
    work: JointSweep,
    lane: int,
    node: int,
    tick: int,
    arcs: IntArray,
    leaves: IntArray,
    total: IntArray,
) -> int:
    """Trace a path to a target that is best for one lane (weight vector), from a node reached at a tick.

    Writes its arcs to `arcs` and the ticks of their departures to `leaves`, and adds its costs to total (k,). Returns
    the number of arcs, or -1 if the path has a cycle or does not arrive in time. Arcs that stay at a place may cost
    nothing for a lane, so a path could cycle among them; therefore arcs that lead to another place are preferred.
    `ahead` and `work` are those of :func:`remaining_cost_by_arc`.
    """
    dep, now = work.dep, work.now
    hold = np.int64(tables.hold)
    v, t, count = np.int64(node), np.int64(tick), 0
    seen = np.int64(-1)  # a node of this path to detect cycles, updated whenever the number of arcs has doubled
    while not ahead.is_target[v]:
        if count == len(arcs) or v == seen:
            return -1
        if count & (count - 1) == 0:
            seen = v
        p = np.int64(tables.place[v])
        begin = t
        depart(tables, ahead, work, v, t)
        leaving = best = np.int64(dep[lane])
        last = np.int64(work.calm[v])
        least = np.int64(work.rows[row_of(work.offset, work.calm, v, t), lane])
        if hold > 0 and t <= last and best > least:  # otherwise a hold is useless
            weigh_standing(tables, work.weights, p, t, now)
            base = now[lane]
            s = t + hold
            while (
                best > least + work.rounded[lane] and free_since(tables, p, s) <= t and (s <= last + 1 or s == t + hold)
            ):
                weigh_standing(tables, work.weights, p, s, now)
                depart(tables, ahead, work, v, s)
                if dep[lane] + now[lane] - base < best:
                    best, leaving, begin = dep[lane] + now[lane] - base, np.int64(dep[lane]), s
                s += 1
        chosen, goes = -1, False
        nearest = np.int64(0)
        for a in range(tables.start[v], tables.start[v + 1]):
            if leaving == FAR or remaining_cost_by_arc(tables, ahead, work, lane, a, p, begin) > leaving:
                continue
            end = begin + np.int64(tables.durations[a]) + ahead.ticks[tables.heads[a]]
            if goes and end >= nearest:
                continue
            on = tables.row[a] != STAYS or continues_at_once(tables, ahead, work, lane, a, begin)
            if chosen < 0 or (on and not goes) or (on == goes and end < nearest):
                chosen, nearest, goes = a, end, on
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


@lean
def trace_best_paths(
    tables: TimedTables,
    ahead: TimeWindows,
    work: JointSweep,
    lanes: IntArray,
    nodes: IntArray,
    tick: int,
    arcs: IntArray,
    leaves: IntArray,
    totals: IntArray,
    sizes: IntArray,
) -> int:
    """Trace w best paths, each for a lane (weight vector) and from a node; all nodes are reached at one tick.

    lanes, nodes    (w,)  lane by which each path is best, and node from which it leads
    arcs, leaves    output: arcs and ticks of departure, path after path
    totals  (w, k)  output: the costs of the paths are added
    sizes   (w,)    output: number of arcs of each path, 0 if it does not arrive

    Returns the number of traced paths. A path is traced only if there is room for the longest possible path. See
    :func:`trace_best_path`, also for the other arguments.
    """
    used, longest = 0, len(arcs) // 2
    for i in range(len(lanes)):
        if used > longest:
            return i
        room = arcs[used : used + longest], leaves[used : used + longest]
        count = trace_best_path(tables, ahead, work, lanes[i], nodes[i], tick, room[0], room[1], totals[i])
        sizes[i] = max(count, 0)
        used += sizes[i]
    return len(lanes)


EVEN = 0.25  # a mixed weight vector gives each cost at least this part of its share in an even mixture


def lone_weights(summed: IntArray, typical: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the weights (LANES, k) of the first table of joint bounds: each summed cost alone, then mixtures.

    A cost j alone has the weight 2^-shift[j]; the shifts (k,) are returned as well.

    summed   columns of costs that are sums
    typical  (k,) approximate costs of a whole path
    """
    k = len(typical)
    weights, shift = np.zeros((LANES, k)), np.zeros(k, np.int64)
    for lane, j in enumerate(summed):
        shift[j] = max(0, int(np.ceil(np.log2(max(1.0, typical[j] / UNIT)))))
        weights[lane, j] = 2.0 ** -shift[j]
    mixed = mixtures(len(summed), LANES - len(summed))
    weights[len(summed) :, summed] = _rounded_weights(mixed * UNIT / np.maximum(1.0, typical[summed]))
    return weights, shift


def mixed_weights(summed: IntArray, ranges: FloatArray, typical: FloatArray) -> FloatArray:
    """Return the weights (LANES, k) of the second table of joint bounds: mixtures of costs scaled by their ranges.

    summed   columns of costs that are sums
    ranges   (k,) ranges of the costs
    typical  (k,) approximate costs of a whole path, whose weighted sums become UNIT
    """
    weights = np.zeros((LANES, len(ranges)))
    mixed = mixtures(len(summed), LANES) / np.maximum(1.0, ranges[summed])
    most = (mixed * np.maximum(1.0, typical[summed])).sum(axis=1)
    weights[:, summed] = _rounded_weights(mixed * UNIT / most[:, None])
    return weights


def _rounded_weights(weights: FloatArray) -> FloatArray:
    """Round all weights of at least 1 to whole numbers, so that their products with costs are exact."""
    return np.asarray(np.where(weights >= 1, np.rint(weights), weights))


def mixtures(k: int, count: int) -> FloatArray:
    """Return positive weight vectors (count, k) with the sum 1: equal weights, one favouring each cost, then random.

    >>> mixtures(2, 3).round(3).tolist()
    [[0.5, 0.5], [0.875, 0.125], [0.125, 0.875]]
    """
    if k == 1:
        return np.ones((count, 1))
    even = np.full((1, k), 1 / k)
    favour = (1 - EVEN) * np.eye(k) + EVEN / k
    generator = np.random.default_rng(0)  # fixed, so that weights are always the same
    spread = generator.dirichlet(np.full(k, 0.7), max(0, count - k - 1))
    return np.concatenate([even, favour, (1 - EVEN / 5) * spread + EVEN / 5 / k])[:count]


@lean
def path_cost(tables: TimedTables, source: int, begin: int, arcs: IntArray, leaves: IntArray, total: IntArray) -> int:
    """Check a path and write its costs to total (k,); return the node where it ends, or -1 if it is invalid.

    The path is at `source` at tick `begin`, and takes arcs (s,) with departures `leaves` (s,), with holds between them.
    It is invalid if the graph does not allow it, or if it holds longer after the horizon than any search would.
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
        if held != 0 and leave > last + tables.hold:  # a hold that no search would make
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


# A search keeps the first path that it finds for each cost vector. If waiting costs the same at several places, that
# path may stop at each of them. So pairs of its holds are merged at the place of the first or the second one,
# departures between them shift, and the costs are computed again. The merged path costs the same, and no two of its
# holds can be merged further.


@kernel
def merge_holds(tables: TimedTables, source: int, begin: int, arcs: IntArray, leaves: IntArray, costs: IntArray) -> int:
    """Merge holds (pauses) of a path as long as its costs (k,) stay the same; return the number of holds that remain.

    The departures `leaves` (s,) of its arcs are changed in place. Other arguments are those of :func:`path_cost`.
    """
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
                    if path_cost(tables, source, begin, arcs, tried, total) >= 0 and (total == costs).all():
                        leaves[:] = tried
                        again = True
                        break
                if again:
                    break
            if again:
                break
    return int((waits > 0).sum())
