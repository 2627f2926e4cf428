"""A time-dependent graph prepared for fast searches to the same targets, from many nodes and ticks.

A driving robot repeats one query while people move as predicted. Most of the time of a small query goes into lower
bounds of the remaining costs. These depend on node and tick, but not on the source. So they are computed once, for all
nodes and ticks that the robot can reach from a first node and tick.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import IntArray
from hpop.base.options import MOST, MOST_COUNTED, real, whole
from hpop.base.text import shown
from hpop.errors import GraphError, QueryError
from hpop.frontier import is_nondominated
from hpop.runtime.limits import Budget, Status
from hpop.search.machinery import Precision
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.kernels import proven_gap
from hpop.search.machinery.slices import Clock, DeadlineClock
from hpop.search.queries import UNLIMITED, SearchStats, checked_node, checked_targets
from hpop.search.timed.best_paths import merge_holds, path_cost
from hpop.search.timed.bounds import Seed, TimedJointBounds
from hpop.search.timed.calm import path_bounds, remaining_bounds
from hpop.search.timed.graph import TimedGraph, TimedPaths
from hpop.search.timed.joint import LANES, row_of
from hpop.search.timed.search import TimedSearch
from hpop.search.timed.tables import TimedTables

METHOD = "timed"
FIRST, SECOND = 0.35, 0.95  # shares of the limits at which the approximate search begins and ends
GAP = 0.1  # relative precision of the approximate search


class TimedPath(NamedTuple):
    """Path with its times: the indices (s,) of its arcs in the graph, and the ticks (s,) of their departures."""

    arcs: IntArray
    leaves: IntArray


class PreparedTimed:
    """A time-dependent graph prepared for searches from any node and tick that are reached from a first one.

    The first node is ``source``, left at tick ``begin``.

    earliest  (n,)  earliest tick of a query from each node; UNREACHABLE for nodes that cannot be reached

    Accepts: any :class:`TimedGraph`, 1 to 6 costs, each a sum or a maximum.

    Guarantees: :meth:`paths` returns the same front as :func:`.timed_paths` on a graph whose tables begin at the tick
    of the query.

    Cost: bounds are computed once, for all these nodes and ticks. A search then takes only the time for its labels.

    >>> from hpop.search import Graph
    >>> static = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 0], [1, 0], [9, 0]])
    >>> graph = TimedGraph(static, [1, 1, 1], 3, timed=[2], costs={0: [[8, 8, 8, 0]]}, hold=1)
    >>> prepared = PreparedTimed(graph, 0, 2)
    >>> prepared.paths(0, 0).costs.tolist(), prepared.paths(1, 5).costs.tolist()
    ([[1, 0]], [[0, 0]])
    """

    def __init__(
        self, graph: TimedGraph, source: Hashable, target: Hashable | Iterable[Hashable], *, begin: int = 0
    ) -> None:
        if not isinstance(graph, TimedGraph):
            raise GraphError(
                f"graph must be a TimedGraph of hpop.search, got {shown(graph)}; make one from a Graph by "
                "TimedGraph(graph, durations, horizon)"
            )
        self.graph = graph
        first, self.targets = checked_node(graph.graph, source, "source"), checked_targets(graph.graph, target)
        begin = whole("begin", begin, 0, MOST_COUNTED, "a tick")
        clock = Clock(UNLIMITED, None)
        self.tables = TimedTables.of(graph)
        bounds, _ = path_bounds(graph, self.tables, first, self.targets, clock)
        assert bounds is not None  # there is no limit
        is_reached = bounds.earliest < UNREACHABLE
        self.earliest = np.where(is_reached, bounds.earliest + begin, UNREACHABLE)
        # No solution is known for later queries, so every node may be needed.
        through = np.where(is_reached & (bounds.ticks < UNREACHABLE), bounds.through * 0, UNREACHABLE)
        bounds = bounds._replace(earliest=self.earliest, through=through)
        self.bounds = TimedJointBounds(graph, self.tables, bounds, first, self.targets, begin=begin)
        self.bounds.make_for_all(clock)
        self.rest = remaining_bounds(graph, bounds, self.bounds.layout.needed)
        self.joint = self.bounds.joint()

    @property
    def memory(self) -> int:
        """Size of all arrays except those of the graph, bytes."""
        arrays = [*self.tables, *self.rest, *self.joint, *(array for sweep in self.bounds.sweeps for array in sweep)]
        own = {id(array): array.nbytes for array in arrays if isinstance(array, np.ndarray)}
        return sum(own.values())

    def paths(
        self,
        source: Hashable,
        tick: int,
        *,
        deadline: float | None = None,
        budget: Budget = UNLIMITED,
        known: Sequence[TimedPath] = (),
    ) -> TimedPaths:
        """Find every non-dominated cost vector of the paths that start at a node at a tick, each with one path.

        A path may begin with a hold. The search ends after `deadline` seconds of this thread's processor time, at a
        limit of `budget`, or at Ctrl-C. Then the paths found so far are returned, and `gap` bounds how much better
        missing ones may be.

        `known` are paths from the node that the caller knows. They count as found, even with a deadline
        of 0. A path is ignored if the graph does not allow it from the source at its ticks, if it ends at no target,
        or if it arrives too late.

        Raises QueryError if the source is no node, or cannot be reached by that tick.
        """
        start = checked_node(self.graph.graph, source, "source")
        tick = whole("tick", tick, 0, MOST_COUNTED, "a tick", error=QueryError)
        if tick < self.earliest[start]:
            raise QueryError(
                f"node {source!r} cannot be reached by tick {tick} from the node for which the graph was prepared; "
                "pass a later tick, or prepare the graph from this node"
            )
        if deadline is not None:
            deadline = real("deadline", deadline, 0, MOST, "a number of seconds, 0 or more,")
        run = _TimedPreparedRun(self, start, tick, DeadlineClock(deadline, budget, None))
        run.add_known_paths(known)
        try:
            status = run.go()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        return run.result(status)


class _TimedPreparedRun:
    """One run of a query on a prepared time-dependent graph, from a node at a tick.

    seeds        solutions known so far
    exact        exact search, None before it is set up
    approximate  search with the precision GAP, which runs while the exact search pauses; None if it does not run
    """

    def __init__(self, prepared: PreparedTimed, source: int, tick: int, clock: DeadlineClock) -> None:
        self.prepared, self.source, self.tick, self.clock = prepared, source, tick, clock
        self.seeds = list[Seed]()
        self.exact: TimedSearch | None = None
        self.approximate: TimedSearch | None = None
        self.is_approximate_complete = False  # whether the approximate search is complete

    def add_known_paths(self, known: Sequence[TimedPath]) -> None:
        """Add the paths that a caller knows to the solutions.

        A path is ignored if the graph does not allow it from the source at its ticks, if it ends at no target, or if it
        arrives too late.
        """
        prepared, k = self.prepared, self.prepared.graph.graph.criteria
        latest = prepared.graph.arrive_by
        for path in known:
            arcs, leaves = (np.ascontiguousarray(part, np.int64) for part in path)
            total = np.zeros(k, np.int64)
            arguments = prepared.tables, self.source, self.tick, arcs, leaves, total
            if not arcs.size or self.clock.call(path_cost, *arguments) not in prepared.targets:
                continue
            if latest is None or leaves[-1] + prepared.graph.durations[arcs[-1]] <= latest:
                self.seeds.append(Seed(total, arcs, leaves))

    def go(self) -> Status:
        """Run the searches to the end or until a limit, and return the status."""
        prepared, clock = self.prepared, self.clock
        if prepared.graph.arrive_by is not None and self.tick > prepared.graph.arrive_by:
            return Status.NO_PATH
        if self.source in prepared.targets:
            none = np.zeros(0, np.int64)
            self.seeds = [Seed(np.zeros(prepared.graph.graph.criteria, np.int64), none, none)]
            return Status.COMPLETE
        if prepared.rest.ticks[self.source] >= UNREACHABLE:
            return Status.NO_PATH
        status = clock.exceeded(0, 0)
        if status is not None:
            return status
        self._add_best_paths()
        self.exact = exact = self._search(Precision())
        if not clock.is_limited:
            return self._run_search(exact)
        clock.share = FIRST
        status = self._run_search(exact)
        if status not in (Status.TIME_LIMIT, Status.LABEL_LIMIT):
            return status
        clock.share, clock.labels, clock.memory = SECOND, exact.label_counts[0], exact.memory()
        self.seeds = self._solutions()
        self.approximate = approximate = self._search(Precision(GAP))
        self.is_approximate_complete = self._run_search(approximate) in (Status.COMPLETE, Status.NO_PATH)
        for seed in approximate.solutions_found():
            exact.add_solution(seed)
        clock.share, clock.labels, clock.memory = 1.0, approximate.label_counts[0], approximate.memory()
        return self._run_search(exact)

    def _add_best_paths(self) -> None:
        """Add the best path from the source for each weight vector of the joint bounds to the solutions."""
        bounds = self.prepared.bounds
        nodes, costs = np.full(LANES, self.source), np.zeros((LANES, self.prepared.graph.graph.criteria), np.int64)
        for table in range(len(bounds.sweeps)):
            paths = bounds.best_completions(table, np.arange(LANES), nodes, self.tick, costs, self.clock)
            self.seeds += [seed for seed in paths if seed is not None]

    def _search(self, precision: Precision) -> TimedSearch:
        prepared = self.prepared
        query = prepared.tables, prepared.rest, self.source, prepared.targets
        return TimedSearch(
            prepared.graph, *query, precision, (), prepared.bounds, prepared.joint, self.seeds, begin=self.tick
        )

    def _run_search(self, search: TimedSearch) -> Status:
        status = search.run(self.clock, lambda: None)
        assert status is not None
        return status

    def _solutions(self) -> list[Seed]:
        """Return all known non-dominated solutions, in lexicographic order."""
        several = list(self.seeds)
        for search in (self.exact, self.approximate):
            several += [] if search is None else search.solutions_found()
        if not several:
            return []
        costs = np.array([seed.costs for seed in several])
        rows = np.lexsort(costs.T[::-1])
        return [several[row] for row in rows[is_nondominated(costs[rows].astype(np.float64))]]

    def result(self, status: Status) -> TimedPaths:
        """Return the non-dominated paths among all found and known ones, with the gap to missing paths."""
        prepared, clock, seeds = self.prepared, self.clock, self._solutions()
        k = prepared.graph.graph.criteria
        costs = np.array([seed.costs for seed in seeds], np.int64).reshape(-1, k)
        for row, seed in zip(costs, seeds, strict=True):
            clock.call(merge_holds, prepared.tables, self.source, self.tick, seed.arcs, seed.leaves, row)
        costs.setflags(write=False)
        counts = {"labels_generated": 0, "labels_expanded": 0, "labels_open": 0}
        for search in (self.approximate, self.exact):
            for name, count in {} if search is None else search.counts().items():
                counts[name] = count if name == "labels_open" else counts[name] + count
        stats = SearchStats(
            METHOD, tuple(range(k)), peak_memory=clock.peak, seconds_search=clock.seconds(),
            seconds_compiled=clock.compiled, **counts,
        )  # fmt: skip
        gap = 0.0 if status.is_final else self._gap(costs)
        paths = tuple((seed.arcs, seed.leaves) for seed in seeds)
        return TimedPaths(costs, status, stats, prepared.graph, self.source, paths, gap=gap, begin=self.tick)

    def _least_remaining(self) -> IntArray:
        """Return a lower bound (k,) of each cost of all paths from the source at the tick of the query."""
        least, joint = self.prepared.rest.least[:, self.source].copy(), self.prepared.joint
        row = row_of(joint.offset, joint.calm, self.source, self.tick)
        for j in np.flatnonzero(joint.alone >= 0):
            least[j] = max(least[j], int(joint.rows[0, row, joint.alone[j]]) << int(joint.shift[j]))
        return least

    def _gap(self, costs: IntArray) -> float:
        """Return the smallest gap of costs (n, k) to missing paths that the exact or the approximate search proves."""
        if self.exact is None:
            return proven_gap(costs, self._least_remaining()[None], math.inf)
        gap = GAP if self.is_approximate_complete else math.inf
        if self.approximate is not None and not self.is_approximate_complete:
            gap = max(GAP, *(proven_gap(costs, block, gap) for block in self.approximate.estimates()))
        return min(gap, max(proven_gap(costs, block, gap) for block in self.exact.estimates()))
