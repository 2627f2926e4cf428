"""The ways that are best for a weight: followed, arc by arc and hold by hold, down a sweep of :mod:`.joint`."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.timed.joint import FAR, Ahead, Sweep, depart, row_of, weigh_standing
from hpop.search.timed.tables import PLAIN, STAYS, Tables, arc_cost, free_since, is_open, omega_at, worst_rate


@lean
def rest_by(tables: Tables, ahead: Ahead, work: Sweep, lane: int, a: int, p: int, t: int) -> int:
    """The weighted rest of a lane, all rows filled, for leaving at tick t by an arc whose tail is at place p."""
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
def goes_on(tables: Tables, ahead: Ahead, work: Sweep, lane: int, a: int, t: int) -> bool:
    """Whether a best way of a lane that leaves by an arc at tick t leaves its head at once, for another place."""
    u, end = np.int64(tables.heads[a]), t + np.int64(tables.durations[a])
    p = np.int64(tables.place[u])
    least = np.int64(work.rows[row_of(work.offset, work.calm, u, end), lane])
    for b in range(tables.start[u], tables.start[u + 1]):
        if tables.row[b] != STAYS and rest_by(tables, ahead, work, lane, b, p, end) <= least:
            return True
    return bool(ahead.is_target[u])


@lean
def follow(
    tables: Tables,
    ahead: Ahead,
    work: Sweep,
    lane: int,
    node: int,
    tick: int,
    arcs: IntArray,
    leaves: IntArray,
    total: IntArray,
) -> int:
    """Follow a best way of a lane from a node reached at tick t; write its arcs, and when they are left for.

    Where arcs in place cost a lane nothing, ways go round in circles of them: so an arc that leads away comes next.
    What it costs is added to total (k,). Returns the number of arcs, -1 if it leads nowhere in time, or round.
    """
    dep, now = work.dep, work.now
    hold = np.int64(tables.hold)
    v, t, count = np.int64(node), np.int64(tick), 0
    seen = np.int64(-1)  # a node of this way, the next one when as many arcs follow as come before
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
        if hold > 0 and t <= last and best > least:  # else a hold has no use
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
            if leaving == FAR or rest_by(tables, ahead, work, lane, a, p, begin) > leaving:
                continue
            end = begin + np.int64(tables.durations[a]) + ahead.ticks[tables.heads[a]]
            if goes and end >= nearest:
                continue
            on = tables.row[a] != STAYS or goes_on(tables, ahead, work, lane, a, begin)
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
def follow_all(
    tables: Tables,
    ahead: Ahead,
    work: Sweep,
    lanes: IntArray,
    nodes: IntArray,
    tick: int,
    arcs: IntArray,
    leaves: IntArray,
    totals: IntArray,
    sizes: IntArray,
) -> int:
    """Follow a best way each of lanes (w,) from nodes (w,), all reached at tick t, and write one behind the other.

    What each costs is added to totals (w, k); sizes (w,) are their numbers of arcs, 0 of those that lead nowhere.
    Returns how many were followed: there is room for the longest way at least, and none begins where that is not left.
    """
    used, longest = 0, len(arcs) // 2
    for i in range(len(lanes)):
        if used > longest:
            return i
        room = arcs[used : used + longest], leaves[used : used + longest]
        count = follow(tables, ahead, work, lanes[i], nodes[i], tick, room[0], room[1], totals[i])
        sizes[i] = max(count, 0)
        used += sizes[i]
    return len(lanes)
