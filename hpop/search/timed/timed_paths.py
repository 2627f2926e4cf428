"""All non-dominated cost vectors on a clock, one path each: the way in."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import IntArray
from hpop.errors import GraphError
from hpop.search.machinery.approximation import Precision, proven_gap
from hpop.search.pareto_paths import _bounds, _in_words, _precision
from hpop.search.queries import UNLIMITED, SearchStats, checked_node, checked_targets
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.paths import TimedPaths
from hpop.status import Budget, ProgressCallback, Status
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.search.machinery.checkpoint import CheckpointSpec
    from hpop.search.machinery.slices import Clock
    from hpop.search.timed.search import TimedSearch

METHOD = "timed"


def timed_paths(
    graph: TimedGraph,
    source: Hashable,
    target: Hashable | Iterable[Hashable],
    *,
    budget: Budget = UNLIMITED,
    progress: ProgressCallback | None = None,
    eps: float = 0.0,
    tolerance: Sequence[int] | Mapping[str, float] = (),
    at_most: Sequence[int | None] | Mapping[str, float] = (),
    checkpoint: CheckpointSpec | None = None,
) -> TimedPaths:
    """Find every non-dominated cost vector of the paths that leave the source at tick 0, each with one path.

    A path is made of arcs, which are left for when they are open, and of holds; the source may be held at first. What
    arcs and holds cost, and when they are allowed, is told in :mod:`.timed.graph`. Nobody holds at the end.
    With several targets, a path may end at any of them and all compete in one front.

    Accepts: any :class:`TimedGraph`, 1 to 6 costs, each a sum or a maximum.

    Guarantees: exact in integers, on the graph's ticks. `eps`, `tolerance` and `at_most`, limits of `budget` and Ctrl-C
    are those of :func:`.pareto_paths`.

    >>> from hpop.search import Graph
    >>> static = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 0], [1, 0], [9, 0]])
    >>> passage = [[8, 8, 8, 0]]  # somebody stands in it until tick 3
    >>> graph = TimedGraph(static, [1, 1, 1], 3, timed=[2], costs={0: passage}, hold=1)
    >>> paths = timed_paths(graph, 0, 2)
    >>> paths.costs.tolist(), paths.steps(0).arcs.tolist(), paths.steps(0).departures.tolist()
    ([[1, 0]], [0, -1, 1], [0, 1, 3, 4])
    """
    if not isinstance(graph, TimedGraph):
        raise GraphError(f"expected a TimedGraph of hpop.search, got {shown(graph)}")
    static = graph.graph
    start, targets = checked_node(static, source, "source"), checked_targets(static, target)
    from hpop.search.machinery.slices import Clock  # numba: on first use

    clock = Clock(budget, progress)
    run = _TimedRun(graph, start, targets, _precision(static, eps, tolerance), _bounds(static, at_most))
    try:
        status = run.go(clock)
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    return run.result(clock, status)


class _TimedRun:
    """One query: bounds, then the search."""

    def __init__(
        self, graph: TimedGraph, source: int, targets: IntArray, precision: Precision, at_most: tuple[int, ...]
    ) -> None:
        self.graph, self.source, self.targets = graph, source, targets
        self.precision, self.at_most = precision, at_most
        self.search: TimedSearch | None = None
        self.after_bounds = 0.0
        self.at_goal = source in targets

    def go(self, clock: Clock) -> Status:
        """Run the query; what it found is in `search`."""
        if self.at_goal:
            return Status.COMPLETE
        from hpop.search.machinery.bounds import UNREACHABLE
        from hpop.search.timed.bounds import JointBounds
        from hpop.search.timed.rest import rest_of_way
        from hpop.search.timed.search import TimedSearch
        from hpop.search.timed.tables import Tables

        tables = Tables.of(self.graph)
        rest, status = rest_of_way(self.graph, tables, self.source, self.targets, clock)
        self.after_bounds = clock.seconds()
        if rest is None:
            assert status is not None
            return status
        if rest.ticks[self.source] >= UNREACHABLE:
            return Status.NO_PATH
        bounds = JointBounds(self.graph, tables, rest, self.source, self.targets)
        bounds.make(clock)
        query = (self.source, self.targets, self.precision, self.at_most)
        self.search = TimedSearch(self.graph, tables, rest, *query, bounds.joint(), bounds.seeds)
        return self.search.run(clock)

    def result(self, clock: Clock, status: Status) -> TimedPaths:
        """What was found."""
        k = self.graph.graph.criteria
        costs = np.zeros((int(self.at_goal), k), np.int64)
        paths = [(np.zeros(0, np.int64), np.zeros(0, np.int64))] * len(costs)
        counts: dict[str, Any] = {}
        end = clock.seconds()
        gap = self.precision.eps if status.is_final else math.inf
        if self.search is not None:
            from hpop.search.timed.gathered import gather_holds

            costs, paths = self.search.found()
            for row, (arcs, leaves) in zip(costs, paths, strict=True):
                clock.call(gather_holds, self.search.tables, self.source, arcs, leaves, row)
            counts = self.search.counts()
            if not status.is_final:
                gap = max(self.precision.eps, proven_gap(costs, self.search.estimates()))
        costs.setflags(write=False)
        stats = SearchStats(
            METHOD,
            tuple(range(k)),
            peak_memory=clock.peak,
            seconds_bounds=self.after_bounds,
            seconds_search=end - self.after_bounds,
            seconds_compiled=clock.compiled,
            **counts,
        )
        asked = _in_words(self.graph.graph, self.precision, self.at_most)
        return TimedPaths(costs, status, stats, self.graph, self.source, tuple(paths), gap=gap, asked=asked)
