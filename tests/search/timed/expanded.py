"""Another oracle: the timed graph with a node for every state and tick, written out for :func:`pareto_paths`."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import IntArray
from hpop.search import Graph, pareto_paths
from hpop.search.timed.graph import TimedGraph
from tests.search.timed.instances import TimedQuery


def front_by_expansion(query: TimedQuery) -> list[tuple[int, ...]]:
    """Return the front of the untimed search on the expanded graph."""
    graph, n = query.graph, query.graph.graph.nodes
    ticks = _ticks(graph)
    tails, heads, costs = (np.concatenate(parts) for parts in zip(*_arcs(graph, ticks), strict=True))
    # Node (v, t) is t * n + v for who has arrived there, and ticks * n more for who has held long enough to leave.
    wide = Graph.from_arcs(2 * n * ticks, tails, heads, costs, aggregates=graph.graph.aggregates)
    goals = np.add.outer(n * np.arange(ticks), query.targets).ravel()
    return [tuple(row) for row in pareto_paths(wide, query.source, goals.tolist()).costs.tolist()]


def _ticks(graph: TimedGraph) -> int:
    """Ticks at which one may arrive: after the horizon no walk needs more than every node once, and one more hold."""
    if graph.arrive_by is not None:
        return graph.arrive_by + 1
    longest = int(graph.durations.max(initial=1))
    return graph.horizon + (graph.graph.nodes + 1) * longest + (graph.hold or 0) + 1


def _arcs(graph: TimedGraph, ticks: int) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Tails, heads and costs of all arcs of the expanded graph."""
    static, n, last = graph.graph, graph.graph.nodes, ticks * graph.graph.nodes
    tails = np.repeat(np.arange(n), np.diff(static.indptr))
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, static.criteria), np.int64))]
    rows = dict(zip(graph.timed.tolist(), graph.rows.tolist(), strict=True))
    t = np.arange(ticks)
    at = np.minimum(t, graph.horizon)
    for arc, (tail, head) in enumerate(zip(tails, static.heads, strict=True)):
        d = int(graph.durations[arc])
        costs = np.repeat(static.costs[[arc]], ticks, axis=0)
        free = t + d < ticks
        if arc in rows:
            free &= ~graph.blocked[rows[arc], at]
            for j, table in graph.costs.items():
                costs[:, j] = table[rows[arc], at]
        elif graph.stays[arc]:
            free &= ~_windows(graph.cut[graph.place[tail]], at, d, graph.horizon).any(axis=1)
            for j, table in graph.standing.items():
                row = table[graph.place[tail]]
                if static.aggregates[j] == "max":
                    costs[:, j] = np.maximum(costs[:, j], _windows(row, at, d, graph.horizon).max(axis=1))
                else:
                    costs[:, j] += _integral(graph, j, int(graph.place[tail]), at + d) - row[at]
        for layer in (0, last):
            found.append((layer + t[free] * n + tail, (t[free] + d) * n + head, costs[free]))
    if graph.hold is not None:
        for v in range(n):
            for length, begins, ends in ((graph.hold, 0, last), (1, last, last)):
                free = (t + length < ticks) & ~_cut(graph, v, t, length)
                costs = _standing(graph, v, t, length)
                found.append((begins + t[free] * n + v, ends + (t[free] + length) * n + v, costs[free]))
    return found


def _windows(row: np.ndarray, begin: IntArray, length: int, horizon: int) -> np.ndarray:
    """Entries (ticks, length) of a table's row from some ticks on, the last one for ever."""
    return row[np.minimum(np.add.outer(begin, np.arange(length)), horizon)]


def _cut(graph: TimedGraph, v: int, t: IntArray, length: int) -> np.ndarray:
    return _windows(graph.cut[graph.place[v]], t, length, graph.horizon).any(axis=1)


def _standing(graph: TimedGraph, v: int, t: IntArray, length: int) -> IntArray:
    """Costs (ticks, k) of standing for so long."""
    p, costs = int(graph.place[v]), np.empty((t.size, graph.graph.criteria), np.int64)
    for j, aggregate in enumerate(graph.graph.aggregates):
        if aggregate == "sum":
            costs[:, j] = _integral(graph, j, p, t + length) - _integral(graph, j, p, t)
        elif j in graph.standing:
            costs[:, j] = _windows(graph.standing[j][p], t, length, graph.horizon).max(axis=1)
        else:
            costs[:, j] = graph.rate[p, j]
    return costs


def _integral(graph: TimedGraph, j: int, p: int, t: IntArray) -> IntArray:
    """Return the cost of standing until ticks (N,) since tick 0, or since another common tick."""
    if j not in graph.standing:
        return graph.rate[p, j] * t >> 20
    after = graph.rate[p, j] * np.maximum(t - graph.horizon, 0) >> 20
    return graph.standing[j][p][np.minimum(t, graph.horizon)] + after
