"""A graph on a clock made ready for one set of targets, to be searched from node after node, tick after tick.

A drive asks the same question again and again while people do as predicted. What takes most of the time of a small
question does not change then: bounds of the rest of the way, the sweeps of joint ones among them, belong to nodes and
ticks, whoever asks. So they are made once, for all nodes and ticks that come after a first one.
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
from hpop.runtime.status import Budget, Status
from hpop.search.machinery.approximation import Precision
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.kernels import proven_gap
from hpop.search.machinery.slices import Clock, Deadline
from hpop.search.queries import UNLIMITED, SearchStats, checked_node, checked_targets
from hpop.search.timed.best_paths import gather_holds, path_cost
from hpop.search.timed.bounds import Seed, TimedJointBounds
from hpop.search.timed.calm import path_bounds, remaining_bounds
from hpop.search.timed.graph import TimedGraph, TimedPaths
from hpop.search.timed.joint import LANES, row_of
from hpop.search.timed.search import TimedSearch
from hpop.search.timed.tables import TimedTables

METHOD = "timed"
FIRST, SECOND = 0.35, 0.95  # of all limits: in between comes a search within a precision
GAP = 0.1  # its precision, relative


class TimedPath(NamedTuple):
    """A path that is known: the places (s,) of its arcs in the graph, and the ticks (s,) at which they are left for."""

    arcs: IntArray
    leaves: IntArray


class PreparedTimed:
    """A graph on a clock, ready to be searched from any node and tick that come after a first one.

    earliest  (n,)  tick from which on each node may be asked about; UNREACHABLE for those that nobody comes to

    Accepts: any :class:`TimedGraph`, 1 to 6 costs, each a sum or a maximum.

    Guarantees: :meth:`paths` is what :func:`.timed_paths` finds on the graph whose tables begin at that tick.

    Cost: bounds and sweeps once, for all states on a clock behind the first one; a search then takes the time of its
    labels alone.

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
            raise GraphError(f"expected a TimedGraph of hpop.search, got {shown(graph)}")
        self.graph = graph
        first, self.targets = checked_node(graph.graph, source, "source"), checked_targets(graph.graph, target)
        begin = whole("begin", begin, 0, MOST_COUNTED, "a tick")
        clock = Clock(UNLIMITED, None)
        self.tables = TimedTables.of(graph)
        ways, _ = path_bounds(graph, self.tables, first, self.targets, clock)
        assert ways is not None  # nothing limits it
        comes = ways.earliest < UNREACHABLE
        self.earliest = np.where(comes, ways.earliest + begin, UNREACHABLE)
        # No solution is known of all queries to come, so every node may be needed.
        through = np.where(comes & (ways.ticks < UNREACHABLE), ways.through * 0, UNREACHABLE)
        ways = ways._replace(earliest=self.earliest, through=through)
        self.bounds = TimedJointBounds(graph, self.tables, ways, first, self.targets, begin=begin)
        self.bounds.make_for_all(clock)
        self.rest = remaining_bounds(graph, ways, self.bounds.layout.needed)
        self.joint = self.bounds.joint()

    @property
    def memory(self) -> int:
        """Bytes of what is kept beside the graph."""
        kept = [*self.tables, *self.rest, *self.joint, *(array for sweep in self.bounds.sweeps for array in sweep)]
        own = {id(array): array.nbytes for array in kept if isinstance(array, np.ndarray)}
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
        """Find every non-dominated cost vector of the paths that leave a node at a tick, or hold there, each with one.

        With a `deadline`, in seconds of this thread's processor time, a limit of `budget`, or Ctrl-C it may end before:
        what is returned is what was found until then, and `gap` says how much better others may be.

        `known` are paths from there. Those that the graph allows, at the ticks that they say, are there even after a
        deadline of 0; others are left out.

        Raises QueryError for a source that is no node, or that cannot be reached by then.
        """
        start = checked_node(self.graph.graph, source, "source")
        tick = whole("tick", tick, 0, MOST_COUNTED, "a tick", error=QueryError)
        if tick < self.earliest[start]:
            raise QueryError(f"node {source!r} cannot be reached by tick {tick}: prepare the graph from there")
        if deadline is not None:
            deadline = real("deadline", deadline, 0, MOST, "a number of seconds, 0 or more,")
        run = _TimedPreparedRun(self, start, tick, Deadline(deadline, budget, None))
        run.know(known)
        try:
            status = run.go()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        return run.result(status)


class _TimedPreparedRun:
    """One question: from a node at a tick, with some paths known."""

    def __init__(self, prepared: PreparedTimed, source: int, tick: int, clock: Deadline) -> None:
        self.prepared, self.source, self.tick, self.clock = prepared, source, tick, clock
        self.seeds = list[Seed]()
        self.exact: TimedSearch | None = None
        self.near: TimedSearch | None = None
        self.is_near = False  # whether the search within a precision is complete

    def know(self, known: Sequence[TimedPath]) -> None:
        """Begin with those of some paths that the graph allows."""
        prepared, k = self.prepared, self.prepared.graph.graph.criteria
        latest = prepared.graph.arrive_by
        for walk in known:
            arcs, leaves = (np.ascontiguousarray(part, np.int64) for part in walk)
            total = np.zeros(k, np.int64)
            asked = prepared.tables, self.source, self.tick, arcs, leaves, total
            if not arcs.size or self.clock.call(path_cost, *asked) not in prepared.targets:
                continue
            if latest is None or leaves[-1] + prepared.graph.durations[arcs[-1]] <= latest:
                self.seeds.append(Seed(total, arcs, leaves))

    def go(self) -> Status:
        """Search until all is found, or time is up."""
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
        self._follow_best()
        self.exact = exact = self._search(Precision())
        if not clock.is_limited:
            return self._ran(exact)
        clock.share = FIRST
        status = self._ran(exact)
        if status not in (Status.TIME_LIMIT, Status.LABEL_LIMIT):
            return status
        clock.share, clock.labels, clock.memory = SECOND, exact.spent[0], exact.memory()
        self.seeds = self._solutions()
        self.near = near = self._search(Precision(GAP))
        self.is_near = self._ran(near) in (Status.COMPLETE, Status.NO_PATH)
        for seed in near.known():
            exact.plant(seed)
        clock.share, clock.labels, clock.memory = 1.0, near.spent[0], near.memory()
        return self._ran(exact)

    def _follow_best(self) -> None:
        """Know the best ways for the weights of all sweeps, from here on."""
        bounds = self.prepared.bounds
        nodes, costs = np.full(LANES, self.source), np.zeros((LANES, self.prepared.graph.graph.criteria), np.int64)
        for table in range(len(bounds.sweeps)):
            ways = bounds.completed(table, np.arange(LANES), nodes, self.tick, costs, self.clock)
            self.seeds += [seed for seed in ways if seed is not None]

    def _search(self, precision: Precision) -> TimedSearch:
        prepared = self.prepared
        known = prepared.tables, prepared.rest, self.source, prepared.targets
        return TimedSearch(
            prepared.graph, *known, precision, (), prepared.bounds, prepared.joint, self.seeds, begin=self.tick
        )

    def _ran(self, search: TimedSearch) -> Status:
        status = search.run(self.clock, lambda: None)
        assert status is not None
        return status

    def _solutions(self) -> list[Seed]:
        """All that is known, none of it dominated, in lexicographic order."""
        several = list(self.seeds)
        for search in (self.exact, self.near):
            several += [] if search is None else search.known()
        if not several:
            return []
        costs = np.array([seed.costs for seed in several])
        rows = np.lexsort(costs.T[::-1])
        return [several[row] for row in rows[is_nondominated(costs[rows].astype(np.float64))]]

    def result(self, status: Status) -> TimedPaths:
        """What was found and what was known, together, and how much better others may be."""
        prepared, clock, known = self.prepared, self.clock, self._solutions()
        k = prepared.graph.graph.criteria
        costs = np.array([seed.costs for seed in known], np.int64).reshape(-1, k)
        for row, seed in zip(costs, known, strict=True):
            asked = prepared.tables, self.source, self.tick, seed.arcs, seed.leaves, row
            clock.call(gather_holds, *asked)
        costs.setflags(write=False)
        counts = {"labels_generated": 0, "labels_expanded": 0, "labels_open": 0}
        for search in (self.near, self.exact):
            for name, count in {} if search is None else search.counts().items():
                counts[name] = count if name == "labels_open" else counts[name] + count
        stats = SearchStats(
            METHOD, tuple(range(k)), peak_memory=clock.peak, seconds_search=clock.seconds(),
            seconds_compiled=clock.compiled, **counts,
        )  # fmt: skip
        gap = 0.0 if status.is_final else self._gap(costs)
        paths = tuple((seed.arcs, seed.leaves) for seed in known)
        return TimedPaths(costs, status, stats, prepared.graph, self.source, paths, gap=gap, begin=self.tick)

    def _least(self) -> IntArray:
        """Least costs (k,) of what leads on from here, one by one."""
        least, joint = self.prepared.rest.least[:, self.source].copy(), self.prepared.joint
        row = row_of(joint.offset, joint.calm, self.source, self.tick)
        for j in np.flatnonzero(joint.alone >= 0):
            least[j] = max(least[j], int(joint.rows[0, row, joint.alone[j]]) << int(joint.shift[j]))
        return least

    def _gap(self, costs: IntArray) -> float:
        """The least gap that any search proves of what is returned (n, k)."""
        if self.exact is None:
            return proven_gap(costs, self._least()[None], math.inf)
        gap = GAP if self.is_near else math.inf
        if self.near is not None and not self.is_near:
            gap = max(GAP, *(proven_gap(costs, some, gap) for some in self.near.estimates()))
        return min(gap, max(proven_gap(costs, some, gap) for some in self.exact.estimates()))
