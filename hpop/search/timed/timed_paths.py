"""The main function of the search on time-dependent graphs: all non-dominated cost vectors, each with one path."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import IntArray
from hpop.base.text import shown
from hpop.errors import GraphError
from hpop.frontier import is_nondominated
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.search import machinery, timed
from hpop.search.machinery import ANYTHING, Precision
from hpop.search.queries import (
    UNLIMITED,
    SearchStats,
    bounds_of,
    checked_node,
    checked_targets,
    precision_of,
    query_text,
)
from hpop.search.timed.graph import TimedGraph, TimedPaths

if TYPE_CHECKING:
    from hpop.search.machinery.checkpoint import CheckpointSpec
    from hpop.search.machinery.slices import Clock
    from hpop.search.timed.bounds import Seed
    from hpop.search.timed.calm import PathBounds
    from hpop.search.timed.search import TimedSearch
    from hpop.search.timed.solutions import StoredSolutions
    from hpop.search.timed.tables import TimedTables

METHOD = "timed"
SOON = 100_000  # number of labels after which a search stops, coarser searches run, and it begins again
COARSE = (0.1, 0.02)  # relative precisions of the coarser searches


@checked_arguments
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

    A path consists of arcs, each with a departure while it is open, and of holds (pauses at a node). It may begin with
    a hold, but does not end with one. :mod:`.timed.graph` defines the costs of arcs and holds, and when they are
    allowed. With several targets, a path may end at any of them, and all paths compete in one front.

    Accepts: any :class:`TimedGraph`, 1 to 6 costs, each a sum or a maximum.

    Guarantees: exact in integers, on the graph's ticks. With `eps` or `tolerance` (whole numbers, one for each cost),
    every non-dominated vector p is covered by a returned one, r <= (1 + eps) p + tolerance. If a limit of `budget` or
    Ctrl-C stops the search, the solutions known by then are returned, and `gap` says how much better missing ones may
    be. With `at_most` (a bound or None for each cost), all this holds for the paths within the bounds.

    Cost: grows with the number of labels that bounds do not prune (:mod:`.timed.joint`). Solutions help to prune, so a
    long search stops, runs coarsely to find solutions, then more precisely, and begins again with these.

    `checkpoint` is a file, or a :class:`.Checkpoint`, in which the search saves its solutions. After a limit, Ctrl-C or
    kill -9, the same query with the same file begins with them, and finds the same vectors. Raises CheckpointError for
    a file that is damaged, of another query or of another version of hpop.

    >>> from hpop.search import Graph
    >>> static = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 0], [1, 0], [9, 0]])
    >>> passage = [[8, 8, 8, 0]]  # a person stands in it until tick 3
    >>> graph = TimedGraph(static, [1, 1, 1], 3, timed=[2], costs={0: passage}, hold=1)
    >>> paths = timed_paths(graph, 0, 2)
    >>> paths.costs.tolist(), paths.steps(0).arcs.tolist(), paths.steps(0).departures.tolist()
    ([[1, 0]], [0, -1, 1], [0, 1, 3, 4])
    """
    if not isinstance(graph, TimedGraph):
        raise GraphError(
            f"graph must be a TimedGraph of hpop.search, got {shown(graph)}; make one from a Graph by "
            "TimedGraph(graph, durations, horizon)"
        )
    static = graph.graph
    start, targets = checked_node(static, source, "source"), checked_targets(static, target)

    precision, bounds = precision_of(static, eps, tolerance), bounds_of(static, at_most)
    query = (start, targets, float(precision.eps), precision.of(range(static.criteria)), np.array(bounds, np.int64))
    stored = timed.solutions.StoredSolutions(graph, checkpoint, *query)
    clock = machinery.slices.Clock(budget, progress)
    run = _TimedRun(graph, start, targets, precision, bounds, stored)
    try:
        status = run.go(clock)
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
        run.save()
    return run.result(clock, status)


class _TimedRun:
    """One run of a query: it computes bounds, then runs one search, or several of increasing precision.

    search  latest search, None before the first
    seeds   solutions known so far
    proven  relative gap to missing solutions (:attr:`TimedPaths.gap`) that the last complete search proves, or inf
    """

    def __init__(
        self,
        graph: TimedGraph,
        source: int,
        targets: IntArray,
        precision: Precision,
        at_most: tuple[int, ...],
        stored: StoredSolutions,
    ) -> None:
        self.graph, self.source, self.targets, self.stored = graph, source, targets, stored
        self.precision, self.at_most = precision, at_most
        self.search: TimedSearch | None = None
        self.tables: TimedTables | None = None
        self.bounds: PathBounds | None = None
        self.seeds: list[Seed] = []
        self.after_bounds = 0.0
        self.proven = math.inf
        self.at_goal = source in targets

    def go(self, clock: Clock) -> Status:
        """Run the query and return its status; the solutions are in ``search`` and ``seeds``."""
        if self.at_goal:
            return Status.COMPLETE

        if (limit := clock.exceeded(0, timed.tables.own_bytes(self.graph), record=False)) is not None:
            return limit
        self.tables = tables = timed.tables.TimedTables.of(self.graph)
        self.bounds, status = timed.calm.path_bounds(self.graph, tables, self.source, self.targets, clock)
        if self.bounds is None:
            assert status is not None
            return status
        if self.bounds.ticks[self.source] >= machinery.bounds.UNREACHABLE:
            return Status.NO_PATH
        seeds = self.stored.seeds(tables, self.source, self.targets, clock)
        bounds = timed.bounds.TimedJointBounds(self.graph, tables, self.bounds, self.source, self.targets, seeds)
        self.seeds = bounds.seeds
        bounds.make(clock)
        if (status := clock.exceeded(0, 0, record=False)) is not None:
            self.save()
            return status
        rest = timed.calm.remaining_bounds(self.graph, self.bounds, bounds.layout.needed)
        self.after_bounds = clock.seconds()
        joint = bounds.joint()
        for precision, enough in self._precision_stages():
            before = (0, 0) if self.search is None else self.search.label_counts
            self.seeds = self._solutions()
            query = (self.source, self.targets, precision, self.at_most, bounds, joint, self.seeds, before)
            self.search = timed.search.TimedSearch(self.graph, tables, rest, *query)
            status = self.search.run(clock, lambda: self.stored.save_if_due(self._solutions), enough)
            if status is not None and not status.is_final:
                self.save()
                return status
            if status is not None:
                self.proven = precision.eps
            if status is not None and precision is self.precision:
                break
        assert status is not None
        return status

    def save(self) -> None:
        """Write the known solutions to the checkpoint file, if there is one."""
        self.stored.save(self._solutions)

    def _precision_stages(self) -> Iterator[tuple[Precision, int | None]]:
        """Yield the searches to run: the precision of each, and the number of labels at which it gives up, or None."""
        yield self.precision, SOON
        for eps in COARSE:
            if eps > self.precision.eps:
                yield Precision(eps, self.precision.tolerance), None
        yield self.precision, None

    def _solutions(self) -> list[Seed]:
        """Return all known non-dominated solutions within the bounds, from all searches so far."""
        seeds = self.seeds + (self.search.solutions_found() if self.search is not None else [])
        costs = np.array([seed.costs for seed in seeds], np.int64).reshape(-1, self.graph.graph.criteria)
        within = np.all(costs <= np.array(self.at_most or [ANYTHING] * costs.shape[1]), axis=1)
        rows = np.lexsort(costs.T[::-1])
        rows = rows[within[rows]]
        return [seeds[row] for row in rows[is_nondominated(costs[rows])]] if rows.size else []

    def result(self, clock: Clock, status: Status) -> TimedPaths:
        """Return the paths found so far, with statistics, and with the gap to missing paths if a limit came."""
        k = self.graph.graph.criteria
        costs = np.zeros((int(self.at_goal), k), np.int64)
        paths = [(np.zeros(0, np.int64), np.zeros(0, np.int64))] * len(costs)
        counts: dict[str, Any] = {}
        end = clock.seconds()
        gap = self.precision.eps if status.is_final else self.proven
        if self.tables is not None and self.bounds is not None:
            if self.search is not None:
                costs, paths = self.search.costs_and_paths()
                counts = self.search.counts()
            if not status.is_final:
                seeds = self._solutions()
                costs = np.array([seed.costs for seed in seeds], np.int64).reshape(-1, k)
                paths = [(seed.arcs, seed.leaves) for seed in seeds]
            for row, (arcs, leaves) in zip(costs, paths, strict=True):
                clock.call(timed.best_paths.merge_holds, self.tables, self.source, 0, arcs, leaves, row)
            if not status.is_final and self.search is not None:
                missing = max(machinery.kernels.proven_gap(costs, block, gap) for block in self.search.estimates())
                gap = min(gap, max(self.search.eps, missing))
            elif not status.is_final:
                gap = min(gap, machinery.kernels.proven_gap(costs, self.bounds.least[:, self.source][None], gap))
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
        words = query_text(self.graph.graph, self.precision, self.at_most)
        return TimedPaths(costs, status, stats, self.graph, self.source, tuple(paths), gap=gap, asked=words)
