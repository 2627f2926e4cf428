"""What is known of the rest of the way before the search: bounds, and when nothing changes any more."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.status import Status
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds, reverse
from hpop.search.machinery.slices import Clock
from hpop.search.timed.calm import NOTHING, last_changes, settle, spread_back
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.tables import Tables
from hpop.search.timed.uses import UNKNOWN, Rest


class Ways(NamedTuple):
    """What is known of the ways through each node, before any search; see :class:`.Rest`.

    through  (k, n)  least costs of a way from the source to a target, at whatever tick
    leads    (n,)    whether a target may be reached
    whole, settled   of :func:`.settle`
    """

    least: IntArray
    through: IntArray
    ticks: IntArray
    earliest: IntArray
    calm: NDArray[np.int32]
    leads: NDArray[np.uint8]
    whole: BoolArray
    settled: NDArray[np.int32]


def ways_through(
    graph: TimedGraph, tables: Tables, source: int, targets: IntArray, clock: Clock
) -> tuple[Ways | None, Status | None]:
    """What is known of the ways, or the limit that was passed."""
    static, n, m = graph.graph, graph.graph.nodes, graph.graph.arcs
    cheapest = _cheapest(graph)
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
    clock.call(settle, tables, whole, settled)
    clock.call(last_changes, tables, leads, settled, calm)
    begin, entering, weights = np.zeros(n + 2, np.int64), np.empty(m, np.int32), np.empty((1, m), np.int64)
    clock.call(reverse, static.indptr, static.heads, np.arange(m, dtype=np.int32), ticks, begin, entering, weights)
    piles = np.full(graph.horizon + 1, -1), np.empty(n, np.int32), np.empty(n, np.int32)
    clock.call(spread_back, begin[:-1], entering, weights[0], calm, *piles)
    is_max = np.array([aggregate == "max" for aggregate in static.aggregates])[:, None]
    worst = np.maximum(spent, least)
    through = np.where(is_max | (worst >= UNREACHABLE), worst, spent + least)
    return Ways(least, through, needed[0], earliest[0], calm, leads, whole, settled), None


def rest_of_way(graph: TimedGraph, ways: Ways, needed: BoolArray) -> Rest:
    """What is known of the rest of the way from the nodes (n,) that anybody has to come to."""
    n, nodes = graph.graph.nodes, np.flatnonzero(needed)
    nodes = nodes[np.argsort(graph.place[nodes], kind="stable")]
    return Rest(
        ways.least, ways.ticks, ways.earliest, np.where(needed, ways.calm, np.int32(NOTHING)),
        ways.leads, ways.whole, ways.settled,
        np.zeros(graph.graph.arcs, np.int32), np.full(n, UNKNOWN), np.full(graph.places, UNKNOWN, np.int8),
        nodes, np.searchsorted(graph.place[nodes], np.arange(graph.places + 1)),
    )  # fmt: skip


def reversed_graph(graph: Graph) -> Graph:
    """The graph with all arcs the other way round."""
    tails = np.repeat(np.arange(graph.nodes, dtype=np.int32), np.diff(graph.indptr))
    return Graph.from_arcs(graph.nodes, graph.heads, tails, graph.costs, aggregates=graph.aggregates)


def _cheapest(graph: TimedGraph) -> Graph:
    """The graph of what arcs cost when they cost least; those that are never open are left out."""
    costs = graph.graph.costs.copy()
    for j, table in graph.costs.items():
        costs[graph.timed, j] = table.min(axis=1)
    never: NDArray[Any] = np.zeros(graph.graph.arcs, np.bool_)
    never[graph.timed] = graph.blocked.all(axis=1)
    part = Graph.from_csr(graph.graph.indptr, graph.graph.heads, costs, aggregates=graph.graph.aggregates)
    return part.without(never) if never.any() else part
