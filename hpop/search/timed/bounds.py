"""Joint bounds of a query, made table by table, and the ways that are best for their weights: first solutions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import FloatArray, IntArray
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.joint import DOWN, FAR, HALF, LANES, Ahead, Joint, Sweep, follow, price_arcs, sweep
from hpop.search.timed.kernel import Rest
from hpop.search.timed.tables import NEVER, Tables
from hpop.search.timed.weights import lone_weights, mixed_weights

AT_ONCE = 4  # columns of a graph whose shortest ways are found side by side
FEW = 4  # mixtures of costs in the first table: with fewer, a second one has mixtures of like ranges


class Seed(NamedTuple):
    """A solution known before the search: costs (k,), arcs (s,) and when they are left for (s,)."""

    costs: IntArray
    arcs: IntArray
    leaves: IntArray


class JointBounds:
    """Tables of joint bounds, and the seeds that come with them."""

    def __init__(self, graph: TimedGraph, tables: Tables, rest: Rest, source: int, targets: IntArray) -> None:
        self.graph, self.tables, self.rest, self.source, self.targets = graph, tables, rest, source, targets
        n = graph.graph.nodes
        is_target = np.zeros(n, np.uint8)
        is_target[targets] = 1
        arrive_by = NEVER if graph.arrive_by is None else graph.arrive_by
        self.ahead = Ahead(rest.ticks, rest.earliest, arrive_by, is_target)
        between = np.maximum(rest.calm - rest.earliest + 1, 0)
        self.offset = n + np.cumsum(between) - between - np.minimum(rest.earliest, NEVER)
        self.size = n + int(between.sum())
        latest = np.flatnonzero(between)
        self.order = latest[np.argsort(-rest.calm[latest], kind="stable")]
        self.place_in = np.full(n, -1)
        self.place_in[self.order] = np.arange(len(self.order))
        self.summed = np.flatnonzero([aggregate == "sum" for aggregate in graph.graph.aggregates])
        self.weights: list[FloatArray] = []
        self.rows: list[NDArray[np.int32]] = []
        self.sweeps: list[Sweep] = []
        self.room = tuple(np.empty(n + graph.horizon, np.int64) for _ in range(2))
        self.seeds: list[Seed] = []
        self.shift = np.zeros(graph.graph.criteria, np.int64)

    @property
    def memory(self) -> int:
        """Bytes that a table takes, and what is needed while it is made."""
        slabs = 4 * _power(min(self._longest(), self.graph.horizon)) + 8 * _power(self.tables.hold)
        return LANES * (self.size * 4 + self.graph.graph.arcs * 20 + len(self.order) * slabs)

    def make(self, clock: Clock) -> None:
        """Make the tables, as far as there are sums, and memory and time for them."""
        typical = self._typical()
        several = 1 if LANES - len(self.summed) > FEW else 2
        for table in range(several if len(self.summed) else 0):
            if clock.exceeded(0, self.memory * (table + 1), record=False) is not None:
                return
            if table == 0:
                weights, self.shift = lone_weights(self.summed, typical)
            else:
                weights = mixed_weights(self.summed, self._ranges(typical), typical)
            self._add(weights, clock)

    def joint(self) -> Joint:
        """All tables, as kernels read them."""
        k = self.graph.graph.criteria
        alone = np.full(k, -1)
        if not self.rows:
            rows, weights = np.zeros((0, 1, LANES), np.int32), np.zeros((0, LANES, k))
        else:
            rows, weights = np.stack(self.rows), np.stack(self.weights)
            alone[self.summed] = np.arange(len(self.summed))
        return Joint(weights, rows, self.offset, self.rest.calm, alone, self.shift)

    def _typical(self) -> FloatArray:
        """What a way costs (k,), about: at least what is least of the farthest node, and some arcs."""
        least = self.rest.least.astype(np.float64)
        far = np.array([row[row < NEVER].max(initial=0.0) for row in least])
        return np.asarray(np.maximum(far, 4.0 * self.graph.largest))

    def _ranges(self, typical: FloatArray) -> FloatArray:
        """How far apart (k,) the solutions known are in each cost."""
        if len(self.seeds) < 2:
            return typical
        costs = np.array([seed.costs for seed in self.seeds], np.float64)
        spread = costs.max(axis=0) - costs.min(axis=0)
        return np.asarray(np.where(spread > 0, spread, np.maximum(costs.max(axis=0), 1.0)))

    def _add(self, weights: FloatArray, clock: Clock) -> None:
        """One more table, and the ways that are best for its weights."""
        n, m = self.graph.graph.nodes, self.graph.graph.arcs
        clock.report("bounds")
        priced, fixed = np.empty((m, LANES), np.int32), np.empty((m, LANES), np.int32)
        columns = np.ascontiguousarray(weights.T)
        columns *= np.where(columns % 1 == 0, 1.0, DOWN)  # products of whole numbers are exact
        most = HALF / len(columns) / np.maximum(columns.max(axis=1), 1 / FAR)
        clock.call(price_arcs, self.tables, columns, priced, fixed)
        rows = np.empty((self.size, LANES), np.int32)
        closed = (priced == FAR).all(axis=1)
        for begin in range(0, LANES, AT_ONCE):
            lanes = slice(begin, begin + AT_ONCE)
            calm = Graph.from_csr(self.graph.graph.indptr, self.graph.graph.heads, priced[:, lanes].astype(np.int64))
            calm = calm.without(closed) if closed.any() else calm
            h, _, status = lower_bounds(calm, self.source, self.targets, clock)
            if status is not None:  # the search that follows says so
                return
            rows[:n, lanes] = np.minimum(h, FAR).T
        w, longest = len(self.order), min(self._longest(), self.graph.horizon)
        work = Sweep(
            columns, most, fixed, rows, self.offset, self.rest.calm, self.order, self.place_in,
            np.empty((_power(longest), w, LANES), np.int32), np.empty((_power(self.tables.hold), w, LANES), np.int64),
            (columns % 1 > 0).sum(axis=0),
            np.empty(LANES, np.int32), np.empty(LANES, np.int32), *(np.empty(LANES, np.int64) for _ in range(3)),
        )  # fmt: skip
        clock.call(sweep, self.tables, self.ahead, work, np.empty(w, np.int64))
        self.weights.append(weights)
        self.rows.append(rows)
        self.sweeps.append(work)
        start = np.zeros(self.graph.graph.criteria, np.int64)
        for lane in range(LANES):
            seed = self.completed(len(self.sweeps) - 1, lane, self.source, 0, start, clock)
            if seed is not None:
                self.seeds.append(seed)

    def completed(self, table: int, lane: int, node: int, tick: int, costs: IntArray, clock: Clock) -> Seed | None:
        """A best way for a weight, from a node reached at a tick at some costs (k,); None if it leads nowhere."""
        arcs, leaves = self.room
        total = costs.copy()
        arguments = (self.tables, self.ahead, self.sweeps[table], lane, node, tick, arcs, leaves, total)
        count = clock.call(follow, *arguments)
        return Seed(total, arcs[:count].copy(), leaves[:count].copy()) if count > 0 else None

    def _longest(self) -> int:
        """Ticks of the longest arc that leaves a node whose rows are swept."""
        return int(self.graph.durations.max(initial=1))


def _power(ticks: int) -> int:
    """A power of two that is larger."""
    return 1 << ticks.bit_length()
