"""Computation of the joint bounds of a query, and of first solutions: the best paths for the weights of these bounds.

Joint bounds are lower bounds of weighted sums of the remaining costs (:mod:`.joint`). They are computed by a sweep over
all states (nodes at ticks), from the last tick to the first. A lane is one of the LANES weight vectors of a table.
Before a long sweep, a smaller one covers only nodes near a best path. Its paths are paths of the graph, so they are
early solutions. A node is left out of the long sweep if, in every cost, even the cheapest path through it, at any tick,
costs no less than one of these solutions.
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

AT_ONCE = 4  # number of weights for which shortest paths are computed together
MANY = 250_000  # number of rows: a smaller table is swept without a small sweep before
NARROW = 10  # one in so many nodes counts as near a best path
STEPS = 30_000  # number of states in a slice: some 20 milliseconds
PRICED = 20  # bytes for each arc and lane: its cost, and the graph for shortest paths
FEW = 4  # if the first table has no more mixed weights than this, a second one has mixtures scaled by ranges


class Seed(NamedTuple):
    """Known solution: the costs (k,) of a path, the indices (s,) of its arcs, and the ticks (s,) of departures."""

    costs: IntArray
    arcs: IntArray
    leaves: IntArray


class Layout(NamedTuple):
    """Layout of a table of joint bounds: which row belongs to which state, a node at a tick.

    needed  (n,)      mask of the nodes that may be on a new solution
    calm    (n,)      last tick L(v) at which a departure can meet a change (:mod:`.calm`); NOTHING if not needed
    offset  (n,)      the row of node v at tick t is offset[v] + t up to tick L(v), afterwards v
    order   (w,)      nodes with rows up to L(v), grouped by place (nodes at one position)
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
        """Return the layout for needed nodes, a mask (n,); ``place`` (n,) is that of :class:`.TimedGraph`."""
        n = len(needed)
        calm = np.where(needed, bounds.calm, np.int32(NOTHING))
        between = np.maximum(calm - bounds.earliest + 1, 0)
        offset = n + np.cumsum(between) - between - np.minimum(bounds.earliest, NEVER)
        order = np.flatnonzero(between)
        order = order[np.argsort(place[order], kind="stable")]
        first = np.flatnonzero(np.diff(place[order], prepend=-1, append=-1))
        return cls(needed, calm, offset, order, first, n + int(between.sum()))


class Prices(NamedTuple):
    """Weights of one table of joint bounds, LANES vectors (called lanes), and the weighted costs of arcs.

    weights  (LANES, k)  weight of each cost in each lane
    columns  (k, LANES)  the same weights, rounded down so that products are lower bounds
    most     (k,)        costs above this value count as this value, so that no weighted sum overflows
    priced   (m, LANES)  weighted costs of arcs from the horizon H on
    fixed    (m, LANES)  the part of these costs that is the same at all ticks
    """

    weights: FloatArray
    columns: FloatArray
    most: FloatArray
    priced: NDArray[np.int32]
    fixed: NDArray[np.int32]


class TimedJointBounds:
    """Computation of the tables of joint bounds on a time-dependent graph, and of first solutions.

    A joint bound is a lower bound of a weighted sum of the costs that remain from a node at a tick. A table has the
    bounds of all needed nodes and ticks, for LANES vectors of weights. It is computed from the last tick to the first.

    weights  for each table: its vectors of weights (LANES, k)
    rows     for each table: the bounds (r, LANES), a row for each node and tick
    sweeps   for each table: the working arrays of its computation
    seeds    first solutions: paths that are best for some of the weights, and solutions known before
    layout   which row of the tables belongs to which node and tick
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
        """Begin without tables. ``known`` are known solutions; paths leave the source at tick ``begin``."""
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
        """Compute the tables of joint bounds and the first solutions of a query, as far as memory and time allow."""
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
        """Compute only the first table of joint bounds, for all nodes and ticks that the source can reach."""
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
        """Return all tables in the form that kernels need."""
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
        """Return a mask (n,) of the nodes through which a path may lead that no known solution covers."""
        through = self.bounds.through
        needed = np.asarray((through < UNREACHABLE).all(axis=0))
        for seed in self.seeds:
            needed &= (seed.costs[:, None] > through).any(axis=0)
        needed[self.targets] = True
        return needed

    def _near_best(self, prices: Prices, clock: Clock) -> BoolArray | None:
        """Return a mask (n,) of the needed nodes near a best path; None if no path exists or a limit is passed.

        Arcs are weighed by their costs from the horizon on, when these no longer change. A tenth of the nodes counts
        as near: those through which the least weighted cost of a path is smallest. Targets are always in the mask.
        """
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
        """Return a static graph of needed nodes; its costs are weighted costs of arcs from the horizon on, by lane."""
        graph = self.graph.graph
        calm = Graph.from_csr(graph.indptr, graph.heads, prices.priced[:, lanes].astype(np.int64))
        closed = (prices.priced == FAR).all(axis=1) | ~needed[graph.heads]
        closed |= ~np.repeat(needed, np.diff(graph.indptr))
        return calm.without(closed) if closed.any() else calm

    def _typical_costs(self) -> FloatArray:
        """Return approximate costs (k,) of a whole path, by which weights are scaled.

        They are the largest of the least remaining costs, or four times the largest cost of an arc if that is more.
        """
        least = self.bounds.least.astype(np.float64)
        far = np.array([row[row < NEVER].max(initial=0.0) for row in least])
        return np.asarray(np.maximum(far, 4.0 * self.graph.largest))

    def _ranges(self, typical: FloatArray) -> FloatArray:
        """Return the range (k,) of each cost over the known solutions, or the typical costs (k,) for fewer than two.

        A cost without a range has its value, at least 1, instead.
        """
        if len(self.seeds) < 2:
            return typical
        costs = np.array([seed.costs for seed in self.seeds], np.float64)
        spread = costs.max(axis=0) - costs.min(axis=0)
        return np.asarray(np.where(spread > 0, spread, np.maximum(costs.max(axis=0), 1.0)))

    def _weigh_arcs(self, weights: FloatArray, clock: Clock) -> Prices:
        """Return the weighted costs of all arcs for the weights (LANES, k) of a table."""
        m = self.graph.graph.arcs
        priced, fixed = np.empty((m, LANES), np.int32), np.empty((m, LANES), np.int32)
        columns = np.ascontiguousarray(weights.T)
        columns *= np.where(columns % 1 == 0, 1.0, DOWN)  # products of whole numbers are exact
        most = HALF / len(columns) / np.maximum(columns.max(axis=1), 1 / FAR)
        clock.call(weigh_final_arcs, self.tables, columns, priced, fixed)
        return Prices(weights, columns, most, priced, fixed)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """All arrays that the tables of joint bounds hold, so that a search can count its memory."""
        return [array for sweep in self.sweeps for array in sweep if isinstance(array, np.ndarray)]

    def _memory(self, layout: Layout) -> int:
        """Return the bytes of all tables and of one more with the given layout, scratch included."""
        held = 8 * _next_power_of_two(self.tables.hold)
        one = LANES * (layout.size * 4 + self.graph.graph.arcs * PRICED + len(layout.order) * held)
        return one * (len(self.rows) + 1)

    def _sweep_table(self, prices: Prices, layout: Layout, clock: Clock) -> JointSweep | None:
        """Compute one table, in slices of time; return None if a limit comes, which the search then reports.

        prices  weights of the table, and weighted costs of arcs
        layout  which row of the table belongs to which node and tick
        """
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
        """Add the best path from the source for each lane (weight vector) of a table to the known solutions."""
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
        """Complete w labels (partial paths) at nodes (w,) and a tick, each with the least weighted sum of its lane.

        Returns for each label the arcs and departures from its node to a target, with the costs of the whole path; None
        if no target is reached in time.

        table  index of the table of joint bounds; a lane is one of its weight vectors
        lanes  (w,)  lane of each label
        costs  (w, k)  costs of the labels
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
    """Return the smallest power of two that is larger than a number of ticks."""
    return 1 << ticks.bit_length()
