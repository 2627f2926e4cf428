"""Label setting on a clock as one would write it first: a bucket a tick, at every node a list that is looked through.

A label at a node is dropped where the goal front covers it with its bound, where a label there with the same tick is no
worse, where one that came earlier could have waited and would be no worse (the potential of waiting), or where nothing
changes any more and one that came earlier is no worse (calm). Sums only. The search of hpop is measured against it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.timed.graph import TimedGraph

NEVER = 2**30  # no way to a target, or no cut any more
PART = 20  # bits: rates are in 2**-20 counts


class PlainFront(NamedTuple):
    """Result and counts of a plain search.

    costs     (n, k)  rows in lexicographic order
    made      count   labels put into buckets
    expanded  count
    complete  whether it came to its end; else labels ran out
    nbytes    bytes of labels and tables
    """

    costs: IntArray
    made: int
    expanded: int
    complete: bool
    nbytes: int


class Tables(NamedTuple):
    """The graph as the kernels read it, all columns alike."""

    indptr: IntArray
    heads: NDArray[np.int32]
    durations: NDArray[np.int32]
    static: IntArray  # (m, k)
    row: NDArray[np.int32]  # (m,)  of a timed arc, else -1
    table: NDArray[np.int32]  # (q, H + 1, k)
    blocked: NDArray[np.bool_]  # (q, H + 1)
    place: NDArray[np.int32]
    stays: NDArray[np.bool_]
    omega: NDArray[np.int32]  # (P, H + 1, k)
    own: NDArray[np.bool_]  # (k,)  columns of which arcs that stay pay the standing
    rate: IntArray  # (P, k)
    next_cut: NDArray[np.int32]  # (P, H + 1)  the first tick from here on at which nobody may stand
    hold: int  # 0: nobody holds
    horizon: int
    last: int


def tables_of(graph: TimedGraph) -> Tables:
    """All columns written out."""
    static, h, k = graph.graph, graph.horizon, graph.graph.criteria
    if set(static.aggregates) != {"sum"}:
        raise ValueError("the plain label setting takes sums only")
    row = np.full(static.arcs, -1, np.int32)
    row[graph.timed] = np.arange(graph.timed.size)
    table = np.repeat(static.costs[graph.timed, None, :], h + 1, axis=1).astype(np.int32)
    omega = (graph.rate[:, None, :] * np.arange(h + 1)[None, :, None] >> PART).astype(np.int32)
    for j in graph.costs:
        table[:, :, j] = graph.costs[j]
    for j in graph.standing:
        omega[:, :, j] = graph.standing[j]
    next_cut = np.where(graph.cut, np.arange(h + 1, dtype=np.int32), np.int32(NEVER))
    next_cut = np.minimum.accumulate(next_cut[:, ::-1], axis=1)[:, ::-1]
    longest = int(graph.durations.max(initial=1))
    last = h + longest * static.nodes if graph.arrive_by is None else graph.arrive_by
    own = np.array([j in graph.standing for j in range(k)])
    return Tables(
        static.indptr, static.heads, graph.durations, static.costs, row, np.ascontiguousarray(table), graph.blocked,
        graph.place, graph.stays, np.ascontiguousarray(omega), own, graph.rate, np.ascontiguousarray(next_cut),
        graph.hold or 0, h, last,
    )  # fmt: skip


def plain_front(
    graph: TimedGraph, source: int, targets: list[int], *, seeds: int = 0, most: int = 40_000_000
) -> PlainFront:
    """Return the front; the goal front begins with the supported points of some weights, or empty."""
    t, k = tables_of(graph), graph.graph.criteria
    is_target = np.zeros(graph.graph.nodes, np.bool_)
    is_target[targets] = True
    bounds = np.stack([sweep(t, is_target, unit) for unit in np.eye(k, dtype=np.int64)])  # (k, H + 1, n)
    calm = _calm(graph, t)
    front = np.zeros((100_000, k), np.int64)
    found = 0
    rng = np.random.default_rng(0)
    least = np.maximum(1, bounds[:, 0, source].astype(np.int64))
    for _ in range(seeds):
        weights = np.maximum(1, (rng.dirichlet(np.ones(k)) * 1e5 / least).astype(np.int64))
        ahead = sweep(t, is_target, weights)
        costs, arrival = follow(t, is_target, weights, ahead, source)
        if arrival <= t.last:
            found = enter(front, found, costs)
    labels = np.zeros((most, 2 + k), np.int32)
    links = np.zeros((most, 2), np.int32)
    counts = np.zeros(4, np.int64)
    search(t, is_target, bounds, calm, source, labels, links, front, found, counts)
    costs = front[: counts[2]]
    used = int(counts[0])
    nbytes = used * (labels.itemsize * labels.shape[1] + links.itemsize * 2) + bounds.nbytes + t.table.nbytes
    return PlainFront(costs[np.lexsort(costs.T[::-1])], used, int(counts[1]), bool(counts[3]), nbytes)


def _calm(graph: TimedGraph, t: Tables) -> NDArray[np.int32]:
    """Return the last tick (n,) at which leaving a node can still meet a change, -1 if there is none."""
    n, h, k = graph.graph.nodes, t.horizon, graph.graph.criteria
    tails = np.repeat(np.arange(n), np.diff(t.indptr))
    last = np.full(n, -1, np.int64)
    if h:
        changes = (np.diff(t.table, axis=1) != 0).any(axis=2) | (np.diff(t.blocked, axis=1) != 0)
        np.maximum.at(last, tails[graph.timed], _last(changes))
        rates = np.concatenate([np.diff(t.omega, axis=1), np.zeros((graph.places, 1, k), np.int32)], axis=1)
        still = np.array([[graph.rate[p, j] >> PART for j in range(k)] for p in range(graph.places)])
        rates[:, -1] = still
        uneven = (rates != still[:, None]).any(axis=2) | (graph.cut != graph.cut[:, -1:])
        np.maximum.at(last, np.arange(n), _last(uneven)[graph.place])
    while True:
        through = last.copy()
        np.maximum.at(through, tails, last[t.heads] - t.durations)
        if (through == last).all():
            return last.astype(np.int32)
        last = through


def _last(marked: NDArray[np.bool_]) -> IntArray:
    """Return the last marked column of each row, -1 for a row without one."""
    width = marked.shape[1]
    return np.where(marked.any(axis=1), width - 1 - np.argmax(marked[:, ::-1], axis=1), -1)


@lean
def standing(t: Tables, p: int, j: int, tick: int) -> int:
    """Return the cost of standing at a position until a tick."""
    if tick <= t.horizon:
        return int(t.omega[p, tick, j])
    if t.own[j]:
        return int(t.omega[p, t.horizon, j]) + (t.rate[p, j] * (tick - t.horizon) >> PART)
    return int(t.rate[p, j] * tick >> PART)


@lean
def cost(t: Tables, a: int, p: int, j: int, tick: int) -> int:
    """Cost of an arc that is left for at a tick."""
    at = min(tick, t.horizon)
    if t.row[a] >= 0:
        return int(t.table[t.row[a], at, j])
    c = t.static[a, j]
    if t.stays[a] and t.own[j]:
        c += standing(t, p, j, at + t.durations[a]) - standing(t, p, j, at)
    return int(c)


@lean
def is_open(t: Tables, a: int, p: int, tick: int) -> bool:
    """Return True if an arc is open at a tick."""
    at = min(tick, t.horizon)
    if t.row[a] >= 0:
        return not t.blocked[t.row[a], at]
    return not t.stays[a] or t.next_cut[p, at] >= at + t.durations[a]


@lean
def may_stand(t: Tables, p: int, begin: int, end: int) -> bool:
    """Return True if no person comes too near from one tick to another."""
    return end <= begin or t.next_cut[p, min(begin, t.horizon)] >= min(end, t.horizon + 1)


@kernel
def sweep(t: Tables, is_target: NDArray[np.bool_], weights: IntArray) -> NDArray[np.int32]:
    """Least weighted cost (H + 1, n) of going on from a node at a tick, whatever the time of arrival."""
    n, h, k = len(t.place), t.horizon, len(weights)
    ahead = np.full((h + 1, n), NEVER, np.int32)
    held = np.full((h + 1, n), NEVER, np.int32)  # of who has held long enough
    ahead[h][is_target] = 0
    changed = True
    while changed:  # nothing changes from the horizon on
        changed = False
        for v in range(n):
            for a in range(t.indptr[v], t.indptr[v + 1]):
                if ahead[h, t.heads[a]] < NEVER and is_open(t, a, t.place[v], h):
                    c = ahead[h, t.heads[a]]
                    for j in range(k):
                        c += weights[j] * cost(t, a, t.place[v], j, h)
                    if c < ahead[h, v]:
                        ahead[h, v] = c
                        changed = True
    held[h] = ahead[h]
    for tick in range(h - 1, -1, -1):
        for v in range(n):
            if is_target[v]:
                ahead[tick, v] = 0
                continue
            p, best = t.place[v], np.int64(NEVER)
            for a in range(t.indptr[v], t.indptr[v + 1]):
                end = min(tick + t.durations[a], h)
                if ahead[end, t.heads[a]] < NEVER and is_open(t, a, p, tick):
                    c = np.int64(ahead[end, t.heads[a]])
                    for j in range(k):
                        if weights[j]:
                            c += weights[j] * cost(t, a, p, j, tick)
                    best = min(best, c)
            held[tick, v] = ahead[tick, v] = best
            if t.hold:
                if held[tick + 1, v] < NEVER and may_stand(t, p, tick, tick + 1):
                    held[tick, v] = min(best, held[tick + 1, v] + _waited(t, weights, p, tick, tick + 1))
                end = tick + t.hold
                if held[min(end, h), v] < NEVER and may_stand(t, p, tick, end):
                    ahead[tick, v] = min(best, held[min(end, h), v] + _waited(t, weights, p, tick, end))
    return ahead


@lean
def _waited(t: Tables, weights: IntArray, p: int, begin: int, end: int) -> int:
    """Weighted cost of a hold."""
    c = 0
    for j in range(len(weights)):
        if weights[j]:
            c += weights[j] * (standing(t, p, j, end) - standing(t, p, j, begin))
    return c


@kernel
def follow(
    t: Tables, is_target: NDArray[np.bool_], weights: IntArray, ahead: NDArray[np.int32], source: int
) -> tuple[IntArray, int]:
    """Costs (k,) and arrival of a walk that is optimal for the weights."""
    h, k = t.horizon, len(weights)
    g, v, tick = np.zeros(k, np.int64), source, 0
    while not is_target[v] and tick <= t.last:
        p, best, by, leave = t.place[v], np.int64(2**62), -1, tick
        for begin in range(tick, max(tick + t.hold, h) + 1):
            if begin > tick and (t.hold == 0 or not may_stand(t, p, tick, begin)):
                break
            if tick < begin < tick + t.hold:
                continue
            waited = _waited(t, weights, p, tick, begin)
            for a in range(t.indptr[v], t.indptr[v + 1]):
                end = min(begin + t.durations[a], h)
                if ahead[end, t.heads[a]] < NEVER and is_open(t, a, p, begin):
                    c = waited + ahead[end, t.heads[a]]
                    for j in range(k):
                        c += weights[j] * cost(t, a, p, j, begin)
                    if c < best:
                        best, by, leave = c, a, begin
        if by < 0:
            return g, 2**30
        for j in range(k):
            g[j] += standing(t, p, j, leave) - standing(t, p, j, tick) + cost(t, by, p, j, leave)
        v, tick = t.heads[by], leave + t.durations[by]
    return g, tick


@kernel
def enter(front: IntArray, size: int, g: IntArray) -> int:
    """Put a vector into a front unless one there is no worse; those that it dominates leave. The new size."""
    kept = 0
    for i in range(size):
        no_worse = worse = True
        for j in range(front.shape[1]):
            no_worse &= front[i, j] <= g[j]
            worse &= g[j] <= front[i, j]
        if no_worse:
            return size
        if not worse:
            front[kept] = front[i]
            kept += 1
    front[kept] = g
    return kept + 1


@lean
def is_dropped(
    t: Tables,
    bounds: NDArray[np.int32],
    calm: NDArray[np.int32],
    labels: NDArray[np.int32],
    links: NDArray[np.int32],
    first: NDArray[np.int32],
    front: IntArray,
    size: int,
    v: int,
    tick: int,
    g: IntArray,
) -> bool:
    """Return True if a label need not be expanded."""
    k, p = len(g), t.place[v]
    for i in range(size):
        covered = True
        for j in range(k):
            covered &= front[i, j] <= g[j] + bounds[j, min(tick, t.horizon), v]
        if covered:
            return True
    i = first[v]
    while i >= 0:
        at = labels[i, 1]
        waits = at < tick and t.hold > 0 and at + t.hold <= tick and may_stand(t, p, at, tick)
        if at == tick or waits or at > calm[v]:
            dominated = True
            for j in range(k):
                shift = standing(t, p, j, tick) - standing(t, p, j, at) if waits and at <= calm[v] else 0
                if labels[i, 2 + j] + shift > g[j]:
                    dominated = False
                    break
            if dominated:
                return True
        i = links[i, 1]
    return False


@kernel
def search(
    t: Tables,
    is_target: NDArray[np.bool_],
    bounds: NDArray[np.int32],
    calm: NDArray[np.int32],
    source: int,
    labels: NDArray[np.int32],
    links: NDArray[np.int32],
    front: IntArray,
    found: int,
    counts: IntArray,
) -> None:
    """Fill the front; counts are labels made, labels expanded, the front's size, and whether the search ended.

    labels  (N, 2 + k)  node, tick and costs
    links   (N, 2)      the next label of the same bucket, the next one of the same node's list; -1 at the end
    """
    n, k = len(t.place), labels.shape[1] - 2
    bucket, first = np.full(t.last + 1, -1, np.int32), np.full(n, -1, np.int32)
    labels[0, 0], bucket[0], made, expanded = source, 0, 1, 0
    links[0, 0] = -1
    g, longer = np.zeros(k, np.int64), np.zeros(k, np.int64)
    tried, when = np.zeros((t.horizon + 2, k), np.int64), np.zeros(t.horizon + 2, np.int64)
    for tick in range(t.last + 1):
        i = bucket[tick]
        while i >= 0:
            label, i = i, links[i, 0]
            v = labels[label, 0]
            g[:] = labels[label, 2:]
            if bounds[0, min(tick, t.horizon), v] >= NEVER:
                continue
            if is_dropped(t, bounds, calm, labels, links, first, front, found, v, tick, g):
                continue
            links[label, 1], first[v] = first[v], label
            if is_target[v]:
                found = enter(front, found, g)
                continue
            expanded += 1
            p = t.place[v]
            until = max(calm[v] + 1, tick + t.hold) if t.hold else tick
            for a in range(t.indptr[v], t.indptr[v + 1]):
                u, d = t.heads[a], t.durations[a]
                q, tries, begin = t.place[u], 0, tick
                while begin <= min(until, t.last - d) and may_stand(t, p, tick, begin):
                    if is_open(t, a, p, begin):
                        for j in range(k):
                            spent = standing(t, p, j, begin) + cost(t, a, p, j, begin)
                            tried[tries, j] = spent - standing(t, q, j, begin + d)
                            longer[j] = g[j] + spent - standing(t, p, j, tick)
                        when[tries], new = begin, True
                        for b in range(tries):
                            if when[b] + t.hold > begin or not may_stand(t, q, when[b] + d, begin + d):
                                continue
                            no_worse = True
                            for j in range(k):
                                no_worse &= tried[b, j] <= tried[tries, j]
                            if no_worse:
                                new = False
                                break
                        if new:
                            tries += 1
                            end = begin + d
                            if bounds[0, min(end, t.horizon), u] < NEVER and not is_dropped(
                                t, bounds, calm, labels, links, first, front, found, u, end, longer
                            ):
                                if made == len(labels):
                                    counts[:3] = made, expanded, found
                                    return
                                labels[made, 0], labels[made, 1] = u, end
                                labels[made, 2:] = longer
                                links[made, 0], bucket[end] = bucket[end], made
                                made += 1
                    begin = begin + 1 if begin > tick else tick + t.hold
                    if t.hold == 0:
                        break
    counts[:] = made, expanded, found, 1
