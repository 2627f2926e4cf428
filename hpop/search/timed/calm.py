"""Bounds for a search on a time-dependent graph: remaining costs, useful holds, and ticks after the last change.

L(v) is the last tick at which a departure from node v can still meet a change; after it, v is calm. H is the horizon,
the tick from which on nothing changes. The nodes of a place are at one position, and share the costs of standing. A
hold is a pause at a node. An arc stays if both its ends are at one place.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import lean
from hpop.runtime.limits import Status
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds, put_on_pile, sort_arcs_by_head, take_from_pile
from hpop.search.machinery.slices import Clock
from hpop.search.timed.graph import RATE, RATE_BITS, TimedGraph
from hpop.search.timed.tables import (
    PLAIN,
    STAYS,
    TimedTables,
    arc_cost,
    free_since,
    is_open,
    omega_at,
    one_stay_suffices,
    worst_rate,
)

# Let L(v) be the last tick at which a departure from v can still meet a change: some arc on a path onward then differs
# from its state at the horizon H. L(v) = max(last change of an arc that leaves v, max over arcs (v, u) of L(u) - d). A
# path that leaves v after L(v) finds the same arcs at the same costs, whatever the tick, and has no use for holds. Then
# v is called calm.
#
# Proof: let a path leave v at t > L(v). Its first arc departs after the last change of this arc, and reaches its head u
# at t + d > L(u). By induction, each arc of the path is as it is at H, also if the path is shifted in time. If its
# holds are left out, no cost rises, and all later departures become earlier, but are still later than L of their tails.
#
# Waiting for an arc (v, u) is useful only if the arc improves: if it opens at some tick, or costs less than a tick
# before, or the robot must not stand at u. Its cost here includes standing at v before it, less standing at u after
# it. After the last such tick, waiting at v is no better than going on and waiting at u.


NOTHING = -1  # value of L(v) if nothing ever changes, so that v is calm from tick 0 on


@lean
def find_settled_ticks(tables: TimedTables, whole: BoolArray, settled: NDArray[np.int32]) -> None:
    """Write to `settled` the tick from which standing at each place no longer changes.

    From this tick on, each tick of standing costs as much, and is allowed or forbidden, as it is at the horizon H.

    settled  (P,)  output
    whole    (P,)  output: whether, from H on, a tick of standing at the place costs a whole number of quanta
    """
    last = tables.since.shape[1] - 1
    for p in range(len(settled)):
        whole[p] = True
        for j in range(len(tables.is_max)):
            whole[p] &= tables.is_max[j] or tables.rate[p, j] % RATE == 0
        t = last
        while t > 0:
            same = (free_since(tables, p, t) == t) == tables.cut_on[p]
            for j in range(len(tables.is_max)):
                s = tables.omega_of[j]
                if s >= 0 and tables.is_max[j]:
                    same &= tables.omega[s, p, t - 1] == tables.omega[s, p, last]
                elif s >= 0:
                    same &= tables.rate[p, j] % RATE == 0
                    same &= (tables.omega[s, p, t] - tables.omega[s, p, t - 1]) == tables.rate[p, j] >> RATE_BITS
            if not same:
                break
            t -= 1
        settled[p] = t


@lean
def last_changes(
    tables: TimedTables, leads: NDArray[np.uint8], settled: NDArray[np.int32], out: NDArray[np.int32]
) -> None:
    """Find for each node the last tick at which one of its arcs differs from its state at the horizon H.

    It is written to `out` (n,), and is NOTHING if no arc ever differs. An arc that stays (leads to a node of its own
    place) may differ until the place is settled.

    leads    (n,)  marks the nodes from which a target can be reached; arcs to other nodes do not count
    settled  (P,)  of :func:`find_settled_ticks`
    """
    last = tables.since.shape[1] - 1
    k = len(tables.is_max)
    for v in range(len(out)):
        latest = np.int64(NOTHING)
        p = np.int64(tables.place[v])
        for a in range(tables.start[v], tables.start[v + 1]):
            r = tables.row[a]
            if r == PLAIN or not leads[tables.heads[a]]:
                continue
            if r == STAYS:
                latest = max(latest, np.int64(settled[p]) - 1)
                continue
            t = last - 1
            while t > latest:
                same = tables.blocked[r, t] == tables.blocked[r, last]
                j = 0
                while same and not tables.blocked[r, t] and j < k:
                    same = arc_cost(tables, a, p, j, t) == arc_cost(tables, a, p, j, last)
                    j += 1
                if not same:
                    latest = t
                t -= 1
        out[v] = latest


@lean
def propagate_calm_ticks(
    begin: IntArray,
    tails: NDArray[np.int32],
    ticks: IntArray,
    calm: NDArray[np.int32],
    tops: IntArray,
    above: NDArray[np.int32],
    below: NDArray[np.int32],
) -> None:
    """Compute for all nodes the tick L(v) after which no path from v meets a change, from the changes of single nodes.

    L(v) is the larger of v's own last change and, over its arcs to nodes u, L(u) less the duration of the arc. Nodes
    are taken in order of their ticks, the latest first.

    begin, tails, ticks  arcs sorted by head: offsets (n + 1,), tails and durations (m,)
    calm   (n,)      last changes of the nodes' own arcs before the call, L(v) afterwards
    tops   (H + 1,)  queue of nodes by tick, -1 before the call; above and below (n,) are scratch
    """
    for v in range(len(calm)):
        if calm[v] >= 0:
            put_on_pile(v, np.int64(calm[v]), tops, above, below)
    for t in range(len(tops) - 1, 0, -1):
        while tops[t] >= 0:
            v = tops[t]
            take_from_pile(v, t, tops, above, below)
            for i in range(begin[v], begin[v + 1]):
                u, earlier = np.int64(tails[i]), t - ticks[i]
                if earlier > calm[u]:
                    if calm[u] >= 0:
                        take_from_pile(u, np.int64(calm[u]), tops, above, below)
                    calm[u] = earlier
                    put_on_pile(u, earlier, tops, above, below)


@lean
def last_gains(
    tables: TimedTables,
    leads: NDArray[np.uint8],
    calm: NDArray[np.int32],
    earliest: IntArray,
    whole: BoolArray,
    settled: NDArray[np.int32],
    v: int,
    out: NDArray[np.int32],
) -> int:
    """Find for each arc of node v the last tick at which waiting for it is useful; write it to `out` (m,), 0 if never.

    Returns the largest of these ticks. Only one tick is tested if all ticks are alike. This is so if rates are whole,
    and if both places of a plain arc are always settled, or the arc stays at a place without cuts. The other arguments
    are fields of :class:`RemainingBounds`.
    """
    last = tables.since.shape[1] - 1
    p = np.int64(tables.place[v])
    latest = np.int64(0)
    for a in range(tables.start[v], tables.start[v + 1]):
        out[a] = 0
        u = tables.heads[a]
        if tables.hold == 0 or calm[v] < earliest[v] or not leads[u]:
            continue
        q = np.int64(tables.place[u])
        alike = whole[p] and whole[q]
        if tables.row[a] == STAYS:
            alike &= tables.since[p, last] == 0 and not tables.cut_on[p]
        else:
            alike &= tables.row[a] == PLAIN and settled[p] == 0 and settled[q] == 0
        t = np.int64(calm[v]) + tables.hold
        while t > earliest[v]:
            if gains(tables, a, p, t - 1, t):
                out[a] = t
                latest = max(latest, t)
                break
            if alike:
                break
            t -= 1
    return int(latest)


@lean
def gains(tables: TimedTables, a: int, p: int, early: int, late: int) -> bool:
    """Return whether waiting at the tail of arc a and leaving at tick `late` may be better than leaving at `early`.

    It may be if the arc is closed at `early`, or if leaving then and waiting at the arc's head until the other path
    arrives costs more or is not allowed. p is the place of the tail.
    """
    if not is_open(tables, a, p, late):
        return False
    q = np.int64(tables.place[tables.heads[a]])
    d = np.int64(tables.durations[a])
    if not is_open(tables, a, p, early) or free_since(tables, q, late + d) > early + d:
        return True
    for j in range(len(tables.is_max)):
        now, then = arc_cost(tables, a, p, j, early), arc_cost(tables, a, p, j, late)
        if tables.is_max[j]:
            now = max(now, worst_rate(tables, q, j, early + d, late + d))
            then = max(then, worst_rate(tables, p, j, early, late))
        else:
            now += omega_at(tables, q, j, late + d) - omega_at(tables, q, j, early + d)
            then += omega_at(tables, p, j, late) - omega_at(tables, p, j, early)
        if now > then:
            return True
    return False


# Whether holds are useful is computed for a node or place when a label first reaches it; most are never reached.


UNKNOWN = -2  # not computed yet
NEVER_OF_USE = -1


class RemainingBounds(NamedTuple):
    """Lower bounds of the remaining path from each node, and what is known about holds there.

    least    (k, n)  least remaining costs, over all ticks
    ticks    (n,)    fewest remaining ticks
    earliest (n,)    earliest tick at which a path reaches the node
    calm     (n,)    L(v): last tick at which a departure from v can still meet a change, see above
    leads    (n,)    1 if a target can be reached
    whole, settled   of :func:`find_settled_ticks`
    gain     (m,)    last tick at which waiting for an arc is useful, valid once `until` of its tail is computed
    until    (n,)    last tick at which waiting at a node is useful, NEVER_OF_USE, or UNKNOWN until it is computed
    one_stay (P,)    1 if paths never need two consecutive arcs within the place (:mod:`.tables`), else 0, or UNKNOWN
    nodes, first     needed nodes, sorted by place; those of place p are nodes[first[p] : first[p + 1]]
    """

    least: IntArray
    ticks: IntArray
    earliest: IntArray
    calm: NDArray[np.int32]
    leads: NDArray[np.uint8]
    whole: BoolArray
    settled: NDArray[np.int32]
    gain: NDArray[np.int32]
    until: IntArray
    one_stay: NDArray[np.int8]
    nodes: IntArray
    first: IntArray


@lean
def wait_until(tables: TimedTables, rest: RemainingBounds, v: int) -> int:
    """Return the last tick at which waiting at node v is useful, or NEVER_OF_USE; the result is cached in `rest`."""
    if rest.until[v] == UNKNOWN:
        latest = last_gains(tables, rest.leads, rest.calm, rest.earliest, rest.whole, rest.settled, v, rest.gain)
        hold = np.int64(tables.hold)
        rest.until[v] = min(latest + 2 * hold, rest.calm[v] + hold) if latest > 0 else NEVER_OF_USE
    return int(rest.until[v])


@lean
def needs_one_stay(tables: TimedTables, rest: RemainingBounds, p: int) -> bool:
    """Return whether one arc within place p, with a hold where needed, replaces two arcs in a row there (cached)."""
    if rest.one_stay[p] == UNKNOWN:
        rest.one_stay[p] = one_stay_suffices(tables, rest.nodes[rest.first[p] : rest.first[p + 1]])
    return bool(rest.one_stay[p] != 0)


class PathBounds(NamedTuple):
    """Lower bounds of the paths through each node; fields not listed are as in :class:`.RemainingBounds`.

    through  (k, n)  least costs of a path from the source through the node to a target, over all ticks
    """

    least: IntArray
    through: IntArray
    ticks: IntArray
    earliest: IntArray
    calm: NDArray[np.int32]
    leads: NDArray[np.uint8]
    whole: BoolArray
    settled: NDArray[np.int32]


def path_bounds(
    graph: TimedGraph, tables: TimedTables, source: int, targets: IntArray, clock: Clock
) -> tuple[PathBounds | None, Status | None]:
    """Compute lower bounds of the paths through each node.

    Returns the bounds and None, or None and the limit that was passed.
    """
    static, n, m = graph.graph, graph.graph.nodes, graph.graph.arcs
    cheapest = _graph_of_least_costs(graph)
    least, _, status = lower_bounds(cheapest, source, targets, clock)
    if status is not None:
        return None, status
    spent, _, status = lower_bounds(reversed_graph(cheapest), 0, np.array([source]), clock)
    if status is not None:
        return None, status
    ticks = graph.durations.astype(np.int64)[:, None]
    onward = Graph.from_csr(static.indptr, static.heads, ticks)
    needed, _, status = lower_bounds(onward, source, targets, clock)
    if status is not None:
        return None, status
    earliest, _, status = lower_bounds(reversed_graph(onward), 0, np.array([source]), clock)
    if status is not None:
        return None, status
    leads = (needed[0] < UNREACHABLE).astype(np.uint8)
    calm = np.empty(n, np.int32)
    whole, settled = np.empty(graph.places, np.bool_), np.empty(graph.places, np.int32)
    clock.call(find_settled_ticks, tables, whole, settled)
    clock.call(last_changes, tables, leads, settled, calm)
    begin, entering, weights = np.zeros(n + 2, np.int64), np.empty(m, np.int32), np.empty((1, m), np.int64)
    clock.call(
        sort_arcs_by_head, static.indptr, static.heads, np.arange(m, dtype=np.int32), ticks, begin, entering, weights
    )
    piles = np.full(graph.horizon + 1, -1), np.empty(n, np.int32), np.empty(n, np.int32)
    clock.call(propagate_calm_ticks, begin[:-1], entering, weights[0], calm, *piles)
    is_max = np.array([aggregate == "max" for aggregate in static.aggregates])[:, None]
    worst = np.maximum(spent, least)
    through = np.where(is_max | (worst >= UNREACHABLE), worst, spent + least)
    return PathBounds(least, through, needed[0], earliest[0], calm, leads, whole, settled), None


def remaining_bounds(graph: TimedGraph, bounds: PathBounds, needed: BoolArray) -> RemainingBounds:
    """Return the bounds of remaining paths for a search; ``needed`` (n,) is a mask of the nodes that it may use."""
    n, nodes = graph.graph.nodes, np.flatnonzero(needed)
    nodes = nodes[np.argsort(graph.place[nodes], kind="stable")]
    return RemainingBounds(
        bounds.least, bounds.ticks, bounds.earliest, np.where(needed, bounds.calm, np.int32(NOTHING)),
        bounds.leads, bounds.whole, bounds.settled,
        np.zeros(graph.graph.arcs, np.int32), np.full(n, UNKNOWN), np.full(graph.places, UNKNOWN, np.int8),
        nodes, np.searchsorted(graph.place[nodes], np.arange(graph.places + 1)),
    )  # fmt: skip


def reversed_graph(graph: Graph) -> Graph:
    """Return the graph with all arcs reversed."""
    tails = np.repeat(np.arange(graph.nodes, dtype=np.int32), np.diff(graph.indptr))
    return Graph.from_arcs(graph.nodes, graph.heads, tails, graph.costs, aggregates=graph.aggregates)


def _graph_of_least_costs(graph: TimedGraph) -> Graph:
    """Return a static graph in which each arc has its least cost at any tick, without arcs that are never open."""
    costs = graph.graph.costs.copy()
    for j, table in graph.costs.items():
        costs[graph.timed, j] = table.min(axis=1)[graph.rows]
    never: NDArray[Any] = np.zeros(graph.graph.arcs, np.bool_)
    closed: BoolArray = np.all(graph.blocked, axis=1)
    never[graph.timed] = closed[graph.rows]
    part = Graph.from_csr(graph.graph.indptr, graph.graph.heads, costs, aggregates=graph.graph.aggregates)
    return part.without(never) if never.any() else part
