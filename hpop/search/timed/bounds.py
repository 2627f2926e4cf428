"""Joint bounds of a query, computed table by table, with the best paths for their weights as first solutions.

Before a long sweep, a smaller one covers only nodes near a best path. Its paths are real and give early solutions. A
node is left out of the long sweep if the least costs of paths through it, at any tick, are all no less than those of a
solution.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.frontier import is_nondominated
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds
from hpop.search.machinery.slices import COUNTERS, N_FRONT, Clock
from hpop.search.timed.best_paths import lone_weights, mixed_weights, trace_best_paths
from hpop.search.timed.calm import NOTHING, PathBounds, reversed_graph
from hpop.search.timed.graph import MAX_TICKS, TimedGraph
from hpop.search.timed.joint import (
    DOWN,
    FAR,
    HALF,
    LANES,
    JointSweep,
    JointTables,
    TimeWindows,
    sweep,
    weigh_final_arcs,
)
from hpop.search.timed.tables import NEVER, TimedTables

AT_ONCE = 4  # weights for which shortest paths are computed together
MANY = 250_000  # states in between: fewer are swept without a smaller sweep before
NARROW = 10  # share of the nodes that count as near a best path, as a divisor
STEPS = 30_000  # states of a slice: some 20 milliseconds
PRICED = 20  # bytes of an arc and a lane: its cost, and the graph for shortest paths
FEW = 4  # mixed weights in the first table; with fewer, a second table has mixtures of equal ranges


class Seed(NamedTuple):
    """Known solution: the costs (k,) of a path, its arcs (s,) and their departures (s,), ticks."""

    costs: IntArray
    arcs: IntArray
    leaves: IntArray


class Layout(NamedTuple):
    """Layout of the rows of a table of joint bounds: one row per state (node, tick).

    needed  (n,)      mask of the nodes that may be on a new solution
    calm    (n,)      tick L(v) after which nothing changes (:mod:`.calm`); NOTHING for nodes that are not needed
    offset  (n,)      the row of node v at tick t is offset[v] + t up to tick L(v), afterwards v
    order   (w,)      nodes with rows before L(v), grouped by place
    first   (p + 1,)  index in `order` of the first node of each place
    size    number of rows
    """

    needed: BoolArray
    calm: NDArray[np.int32]
    offset: IntArray
    order: IntArray
    first: IntArray
    size: int

    @classmethod
    def of(cls, bounds: PathBounds, needed: BoolArray, place: NDArray[np.int32]) -> Layout:
        """Return the layout for the nodes of a mask (n,), which are at places (n,)."""
        n = len(needed)
        calm = np.where(needed, bounds.calm, np.int32(NOTHING))
        between = np.maximum(calm - bounds.earliest + 1, 0)
        offset = n + np.cumsum(between) - between - np.minimum(bounds.earliest, NEVER)
        order = np.flatnonzero(between)
        order = order[np.argsort(place[order], kind="stable")]
        first = np.flatnonzero(np.diff(place[order], prepend=-1, append=-1))
        return cls(needed, calm, offset, order, first, n + int(between.sum()))


class Prices(NamedTuple):
    """Weights of LANES lanes, and weighted costs of arcs.

    weights  (LANES, k)  weights
    columns  (k, LANES)  the same weights, rounded down so that products are lower bounds
    most     (k,)        largest cost that all lanes can weigh without overflow
    priced   (m, LANES)  weighted costs of arcs from H on
    fixed    (m, LANES)  the part of these costs that is the same at all ticks
    """

    weights: FloatArray
    columns: FloatArray
    most: FloatArray
    priced: NDArray[np.int32]
    fixed: NDArray[np.int32]


class TimedJointBounds:
    """Computation of joint bounds on a time-dependent graph, and of first solutions by best paths.

    weights, rows, sweeps  weights, rows and working arrays of each table
    seeds                  known solutions
    layout                 layout of the tables' rows
    """

    def __init__(
        self,
        graph: TimedGraph,
        tables: TimedTables,
        bounds: PathBounds,
        source: int,
        targets: IntArray,
        known: Iterable[Seed] = (),
        begin: int = 0,
    ) -> None:
        """Start with known solutions, without a table; paths leave the source at tick ``begin``."""
        self.begin = begin
        self.graph, self.tables, self.bounds, self.source, self.targets = graph, tables, bounds, source, targets
        n = graph.graph.nodes
        is_target = np.zeros(n, np.uint8)
        is_target[targets] = 1
        arrive_by = NEVER if graph.arrive_by is None else graph.arrive_by
        self.ahead = TimeWindows(bounds.ticks, bounds.earliest, arrive_by, is_target)
        self.summed = np.flatnonzero([aggregate == "sum" for aggregate in graph.graph.aggregates])
        self.weights: list[FloatArray] = []
        self.rows: list[NDArray[np.int32]] = []
        self.sweeps: list[JointSweep] = []
        self.room = tuple(np.empty(2 * (n + graph.horizon), np.int64) for _ in range(2))  # two of the longest paths
        self.seeds = list(known)
        self.shift = np.zeros(graph.graph.criteria, np.int64)
        self.layout = Layout.of(bounds, self._needed_nodes(), graph.place)

    def make(self, clock: Clock) -> None:
        """Compute tables and first solutions of one query, as far as memory and time allow."""
        if not len(self.summed) or clock.exceeded(0, PRICED * LANES * self.graph.graph.arcs, record=False) is not None:
            return
        typical = self._typical_costs()
        weights, self.shift = lone_weights(self.summed, typical)
        prices = self._weigh_arcs(weights, clock)
        if self.layout.size > MANY:
            near = self._near_best(prices, clock)
            if near is not None:
                self._add_best_paths(
                    self._sweep_table(prices, Layout.of(self.bounds, near, self.graph.place), clock), clock
                )
                self.layout = Layout.of(self.bounds, self._needed_nodes(), self.graph.place)
        several = 1 if LANES - len(self.summed) > FEW else 2
        for table in range(several):
            if table > 0:
                weights = mixed_weights(self.summed, self._ranges(typical), typical)
                prices = self._weigh_arcs(weights, clock)
            work = self._sweep_table(prices, self.layout, clock)
            if work is None:
                return
            self._store_table(weights, work)
            self._add_best_paths(work, clock)

    def make_for_all(self, clock: Clock) -> None:
        """Compute the first table for all states that the source can reach, without solutions."""
        if len(self.summed):
            weights, self.shift = lone_weights(self.summed, self._typical_costs())
            work = self._sweep_table(self._weigh_arcs(weights, clock), self.layout, clock)
            if work is not None:
                self._store_table(weights, work)

    def _store_table(self, weights: FloatArray, work: JointSweep) -> None:
        self.weights.append(weights)
        self.rows.append(work.rows)
        self.sweeps.append(work)

    def joint(self) -> JointTables:
        """Return all tables, stacked for the kernels."""
        k = self.graph.graph.criteria
        alone = np.full(k, -1)
        if not self.rows:
            rows, weights = np.zeros((0, 1, LANES), np.int32), np.zeros((0, LANES, k))
        else:
            rows = self.rows[0][None] if len(self.rows) == 1 else np.stack(self.rows)
            weights = np.stack(self.weights)
            alone[self.summed] = np.arange(len(self.summed))
        return JointTables(weights, rows, self.layout.offset, self.layout.calm, alone, self.shift)

    def _needed_nodes(self) -> BoolArray:
        """Return a mask (n,) of the nodes that may be on a path that no known solution covers."""
        through = self.bounds.through
        needed = np.asarray((through < UNREACHABLE).all(axis=0))
        for seed in self.seeds:
            needed &= (seed.costs[:, None] > through).any(axis=0)
        needed[self.targets] = True
        return needed

    def _near_best(self, prices: Prices, clock: Clock) -> BoolArray | None:
        """Return a mask (n,) of the needed nodes near a best path for the costs from H on; None at a limit."""
        lane, needed = len(self.summed), self.layout.needed
        calm = self._calm_graph(prices, slice(lane, lane + 1), needed)
        onward, _, status = lower_bounds(calm, self.source, self.targets, clock)
        if status is not None:
            return None
        back, _, status = lower_bounds(reversed_graph(calm), 0, np.array([self.source]), clock)
        if status is not None or onward[0, self.source] >= UNREACHABLE:
            return None
        through = np.where(np.maximum(onward[0], back[0]) < UNREACHABLE, onward[0] + back[0], UNREACHABLE)
        most = np.partition(through, len(through) // NARROW)[len(through) // NARROW]
        near: BoolArray = needed & (through <= most)
        near[self.targets] = True
        return near

    def _calm_graph(self, prices: Prices, lanes: slice, needed: BoolArray) -> Graph:
        """Return the graph of needed nodes with the weighted costs of some lanes, from H on, as costs."""
        graph = self.graph.graph
        calm = Graph.from_csr(graph.indptr, graph.heads, prices.priced[:, lanes].astype(np.int64))
        closed = (prices.priced == FAR).all(axis=1) | ~needed[graph.heads]
        closed |= ~np.repeat(needed, np.diff(graph.indptr))
        return calm.without(closed) if closed.any() else calm

    def _typical_costs(self) -> FloatArray:
        """Return approximate costs (k,) of a path: least cost from the farthest node, or of four arcs if larger."""
        least = self.bounds.least.astype(np.float64)
        far = np.array([row[row < NEVER].max(initial=0.0) for row in least])
        return np.asarray(np.maximum(far, 4.0 * self.graph.largest))

    def _ranges(self, typical: FloatArray) -> FloatArray:
        """Return the range (k,) of each cost over the known solutions, or the typical cost for fewer than two."""
        if len(self.seeds) < 2:
            return typical
        costs = np.array([seed.costs for seed in self.seeds], np.float64)
        spread = costs.max(axis=0) - costs.min(axis=0)
        return np.asarray(np.where(spread > 0, spread, np.maximum(costs.max(axis=0), 1.0)))

    def _weigh_arcs(self, weights: FloatArray, clock: Clock) -> Prices:
        """Return the costs of all arcs for weights (LANES, k)."""
        m = self.graph.graph.arcs
        priced, fixed = np.empty((m, LANES), np.int32), np.empty((m, LANES), np.int32)
        columns = np.ascontiguousarray(weights.T)
        columns *= np.where(columns % 1 == 0, 1.0, DOWN)  # products of whole numbers are exact
        most = HALF / len(columns) / np.maximum(columns.max(axis=1), 1 / FAR)
        clock.call(weigh_final_arcs, self.tables, columns, priced, fixed)
        return Prices(weights, columns, most, priced, fixed)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """Arrays of all tables."""
        return [array for sweep in self.sweeps for array in sweep if isinstance(array, np.ndarray)]

    def _memory(self, layout: Layout) -> int:
        """Return the bytes of the tables and of one further table, with scratch."""
        held = 8 * _next_power_of_two(self.tables.hold)
        one = LANES * (layout.size * 4 + self.graph.graph.arcs * PRICED + len(layout.order) * held)
        return one * (len(self.rows) + 1)

    def _sweep_table(self, prices: Prices, layout: Layout, clock: Clock) -> JointSweep | None:
        """Compute a table in slices of time; return None at a limit, which the search then reports."""
        if clock.exceeded(0, self._memory(layout), record=False) is not None:
            return None
        n, rows = self.graph.graph.nodes, np.empty((layout.size, LANES), np.int32)
        self._report(clock)
        for begin in range(0, LANES, AT_ONCE):
            lanes = slice(begin, begin + AT_ONCE)
            calm = self._calm_graph(prices, lanes, layout.needed)
            h, _, status = lower_bounds(calm, self.source, self.targets, clock)
            if status is not None:
                return None
            rows[:n, lanes] = np.minimum(h, FAR).T
        longest, ring = int(self.graph.durations.max(initial=1)), _next_power_of_two(self.tables.hold)
        work = JointSweep(
            prices.columns, prices.most, prices.fixed, rows, layout.offset, layout.calm, layout.order, layout.first,
            int(self.graph.durations.min(initial=MAX_TICKS)), np.empty((len(layout.order), ring, LANES), np.int64),
            (prices.columns % 1 > 0).sum(axis=0), np.empty((longest + 1, LANES), np.int32), np.full(longest + 1, -1),
            np.empty((1, LANES), np.int32), np.empty(LANES, np.int32), *(np.empty(LANES, np.int64) for _ in range(3)),
        )  # fmt: skip
        state = np.array([layout.calm.max() if len(layout.order) else -1, 0])
        while not clock.call(sweep, self.tables, self.ahead, work, state, STEPS):
            self._report(clock)
            if clock.exceeded(0, 0, record=False) is not None:
                return None
        return work

    def _add_best_paths(self, work: JointSweep | None, clock: Clock) -> None:
        """Add the best path for each weight of a table to the known solutions."""
        if work is not None:
            every = np.arange(LANES)
            nodes, costs = np.full(LANES, self.source), np.zeros((LANES, self.graph.graph.criteria), np.int64)
            self.seeds += [
                seed for seed in self._trace_paths(work, every, nodes, self.begin, costs, clock) if seed is not None
            ]
        self._report(clock)

    def _report(self, clock: Clock) -> None:
        counters = np.zeros(COUNTERS, np.int64)
        if self.seeds:
            costs = np.unique([seed.costs for seed in self.seeds], axis=0)
            counters[N_FRONT] = int(is_nondominated(costs).sum())
        clock.report("bounds", counters)

    def best_completions(
        self, table: int, lanes: IntArray, nodes: IntArray, tick: int, costs: IntArray, clock: Clock
    ) -> list[Seed | None]:
        """Return the best path for each lane (w,) of a table, from a node (w,) reached at a tick; None for no path.

        costs  (w, k)  costs of the path so far, to which the best path is added
        """
        return self._trace_paths(self.sweeps[table], lanes, nodes, tick, costs, clock)

    def _trace_paths(
        self, work: JointSweep, lanes: IntArray, nodes: IntArray, tick: int, costs: IntArray, clock: Clock
    ) -> list[Seed | None]:
        arcs, leaves = self.room
        paths: list[Seed | None] = []
        while (done := len(paths)) < len(lanes):
            totals, sizes = costs[done:].copy(), np.zeros(len(lanes) - done, np.int64)
            arguments = (self.tables, self.ahead, work, lanes[done:], nodes[done:], tick, arcs, leaves, totals, sizes)
            count = clock.call(trace_best_paths, *arguments)
            for total, size, end in zip(totals[:count], sizes, np.cumsum(sizes), strict=False):
                own = slice(end - size, end)
                paths.append(Seed(total, arcs[own].copy(), leaves[own].copy()) if size else None)
        return paths


def _next_power_of_two(ticks: int) -> int:
    """Return the next larger power of two."""
    return 1 << ticks.bit_length()
