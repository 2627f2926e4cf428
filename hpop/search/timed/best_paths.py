"""Paths on a clock: best paths for a weight, costs of a path, and paths with fewer holds."""

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
    """Return the weighted remaining cost, for the weights of a lane, of leaving by arc a at tick t.

    p     place of the arc's tail
    work  sweep with the table of joint bounds; a lane is one of its LANES weights
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
    """Return whether a best path of a lane by arc a at tick t leaves the arc's head at once for another place."""
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
    """Trace a best path of a lane from a node reached at a tick; write its arcs and their departures `leaves`.

    Arcs that stay at a place may cost a lane nothing, and a path could cycle among them, so arcs that lead away are
    preferred. The costs of the path are added to total (k,). Returns the number of arcs, or -1 if the path has a cycle
    or does not arrive in time.
    """
    dep, now = work.dep, work.now
    hold = np.int64(tables.hold)
    v, t, count = np.int64(node), np.int64(tick), 0
    seen = np.int64(-1)  # a node of this path, updated whenever the number of arcs has doubled
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
    """Trace best paths for lanes (w,) from nodes (w,), all reached at one tick; write them one after another.

    totals  (w, k)  output: the costs of the paths are added
    sizes   (w,)    output: number of arcs of each path, 0 if it does not arrive

    Returns the number of traced paths. A path is traced only if there is room for the longest possible path.
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


EVEN = 0.25  # least share of each cost in a mixed weight, times its share in an even mixture


def lone_weights(summed: IntArray, typical: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return weights (LANES, k) and shifts (k,): first each summed cost alone, with weight 2^-shift, then mixtures.

    summed   columns of costs that add up
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
    """Return mixed weights (LANES, k) of costs that are scaled to equal ranges (k,).

    No weight makes the cost of a whole path, typically ``typical`` (k,), larger than UNIT.
    """
    weights = np.zeros((LANES, len(ranges)))
    mixed = mixtures(len(summed), LANES) / np.maximum(1.0, ranges[summed])
    most = (mixed * np.maximum(1.0, typical[summed])).sum(axis=1)
    weights[:, summed] = _rounded_weights(mixed * UNIT / most[:, None])
    return weights


def _rounded_weights(weights: FloatArray) -> FloatArray:
    """Return weights with those of at least 1 rounded to whole numbers, so that weighted sums are exact."""
    return np.asarray(np.where(weights >= 1, np.rint(weights), weights))


def mixtures(k: int, count: int) -> FloatArray:
    """Return positive weights (count, k) with sums of 1: an even row, a row that favours each cost, then random rows.

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
    """Write the costs of a path to total (k,); return the node where the path ends.

    The path leaves `source` at tick `begin`, takes arcs (s,) with departures `leaves` (s,), and holds between them.

    Returns -1 if the numbers are no path of this graph, or if the path holds longer after the horizon than any search
    would.
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


# A search keeps the first path of each cost vector. Where waiting costs the same at several places, that path may stop
# at each of them. So pairs of holds of each path are merged at the place of the first or second one, departures between
# them shift, and the path is costed again. The result costs the same, and no two of its holds can be merged.


@kernel
def merge_holds(tables: TimedTables, source: int, begin: int, arcs: IntArray, leaves: IntArray, costs: IntArray) -> int:
    """Merge pairs of holds of a path as long as its costs (k,) stay equal; return the number of holds.

    The departures `leaves` (s,) are changed in place.
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
