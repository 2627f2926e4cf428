"""Exact search if one cost is a mean: the ratio of two sums, an integral and a duration, beside other costs.

The duration must be limited, by a cap or by bounds on other sums (:mod:`hpop.search.mean`).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import whole
from hpop.errors import GraphError, OptionError
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.search import machinery, mean
from hpop.search.graph import Graph
from hpop.search.machinery.checkpoint import CheckpointSpec, Keeper
from hpop.search.mean import MAX_PRODUCT, MeanLimits
from hpop.search.pareto_paths import pareto_paths
from hpop.search.queries import UNLIMITED, ParetoPaths, checked_graph, checked_node, checked_targets

if TYPE_CHECKING:
    from hpop.search.machinery.slices import Clock
    from hpop.search.mean.search import CappedMean

METHOD = "capped mean"


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class MeanPaths(ParetoPaths):
    """Result of a search with a mean: walks that are non-dominated in the mean S / T and the other costs.

    S is the integral and T the duration. Rows of ``costs`` are sorted by the mean. If a limit stopped the search, the
    walks are within the limits and do not dominate each other, but the exact front may have better walks. How much
    better is not computed: ``gap`` is always 0. Other fields and methods are those of :class:`ParetoPaths`.

    integral  column of S
    duration  column of T
    cap       upper bound on T that follows from the limits
    notes     lines for the user, such as why there is no walk
    """

    integral: int
    duration: int
    cap: int
    notes: tuple[str, ...]

    def front(self, *, names: Sequence[str] | None = None, units: Sequence[str] | None = None) -> NoReturn:
        """Raise OptionError: a front of the summed costs would leave out walks with the best means."""
        raise OptionError(
            "front() needs costs that are sums, but one cost here is a mean; call hpop.frontier.ItemFront.of with the "
            "columns that you want, such as paths.means and columns of paths.values, and with paths.path(i) as items"
        )

    @property
    def means(self) -> FloatArray:
        """Mean S / T (n,) of each walk, in quanta of S per quantum of T; 0 for a walk that takes no time."""
        total, time = self.costs[:, self.integral], self.costs[:, self.duration]
        return np.asarray(total / np.maximum(1, time), dtype=np.float64)

    def mean(self, i: int) -> Fraction:
        """Return the mean S / T of walk i as an exact fraction."""
        total, time = self.costs[i, [self.integral, self.duration]].tolist()
        return Fraction(total, max(1, time))


@checked_arguments
def capped_mean_paths(
    graph: Graph,
    source: Hashable,
    target: Hashable | Iterable[Hashable],
    *,
    integral: int,
    duration: int,
    cap: int | None = None,
    at_most: Sequence[int | None] = (),
    budget: Budget = UNLIMITED,
    progress: ProgressCallback | None = None,
    checkpoint: CheckpointSpec | None = None,
) -> MeanPaths:
    """Return every non-dominated vector (S/T, other costs) of the walks from source to target within limits.

    S and T are the sums of two columns, ``integral`` and ``duration``; all other columns are further costs. To minimise
    the duration as well, give it a second column. Walks may pass nodes, also targets, more than once: time spent at low
    cost lowers a mean, so without limits the front may be infinite. Of walks with equal vectors one is returned. A walk
    without arcs has the mean 0.

    cap      T <= cap; may be left out if every arc that takes time raises a sum that ``at_most`` bounds
    at_most  a bound or None for each cost, as in :func:`pareto_paths`; None for S and T

    First :func:`pareto_paths` quickly finds the front of T and the other costs, without S. The means of its paths are a
    first front. Then the search of :mod:`.mean.kernel` completes it, and prunes by the means found so far.

    Accepts: any :class:`Graph` with sums S and T in which arcs without duration add nothing to S; up to four other
    costs, each a sum or a maximum.

    Guarantees: exact in integers, with means compared as fractions. If a limit of ``budget`` or Ctrl-C stops the
    search, it returns walks within the limits; better ones may be missing.

    `checkpoint`: as in :func:`pareto_paths`, but only for the second search; the first one is repeated.

    Cost: many times that of :func:`pareto_paths` on sums, and growing steeply with the limits, because labels with
    different T must be kept even if T is no cost.

    >>> arcs = [[4, 4], [1, 2], [0, 2]]  # (S, T): a costly arc, a shorter one, and waiting before it
    >>> graph = Graph.from_arcs(2, [0, 0, 0], [1, 1, 0], arcs)
    >>> paths = capped_mean_paths(graph, 0, 1, integral=0, duration=1, cap=6)
    >>> paths.mean(0), paths.arcs(0).tolist()
    (Fraction(1, 6), [2, 2, 1])
    """
    start, targets = checked_node(checked_graph(graph), source, "source"), checked_targets(graph, target)
    columns = _columns(graph, integral, duration)
    limits = MeanLimits.of(graph, columns, cap, at_most)
    keeper = Keeper.of(checkpoint, graph, start, targets, METHOD, *columns, limits.most)
    clock = machinery.slices.Clock(budget, progress)
    bounds = list(at_most) and [bound for j, bound in enumerate(at_most) if j != integral]
    first = pareto_paths(
        _without_column(graph, integral), start, targets, budget=budget, progress=progress, at_most=bounds
    )
    clock.compiled, clock.peak = first.stats.seconds_compiled, first.stats.peak_memory
    run = _MeanRun(graph, first, columns, limits, keeper)
    try:
        status = run.go(start, targets, clock)
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    return run.result(start, clock, status)


class _MeanRun:
    """One run of a query, after a first search found the front without the integral.

    columns  columns of the graph's costs: the duration, the integral, then the other costs
    """

    def __init__(
        self, graph: Graph, first: ParetoPaths, columns: tuple[int, ...], limits: MeanLimits, keeper: Keeper | None
    ) -> None:
        totals = [graph.costs[path, columns[1]].sum() for path in first._paths]
        costs = np.insert(first.costs, columns[1], totals, axis=1)[:, list(columns)]
        under = np.flatnonzero(costs[:, 0] <= limits.cap)
        self.rows = under[
            np.argsort(costs[under, 0], kind="stable")
        ]  # of equal vectors the one of the shortest duration comes first
        self.walks = costs[self.rows]
        self.least = int(costs[:, 0].min(initial=MAX_PRODUCT))
        self.graph, self.first, self.columns, self.limits, self.keeper = graph, first, columns, limits, keeper
        self.front = np.zeros((max(64, 2 * len(first)), len(columns)), np.int64)
        self.solutions = np.zeros(len(self.front), np.int64)
        self.size = 0
        self.search: CappedMean | None = None
        self.seconds_bounds = first.stats.seconds_bounds

    def go(self, source: int, targets: IntArray, clock: Clock) -> Status:
        """Run the search for the mean, and return its status.

        The walks found are in ``search``, or in ``front`` if the run ended before that search.
        """
        self.size = int(clock.call(mean.kernel.insert_all, self.walks, self.front, self.solutions))
        if self.first.status is not Status.COMPLETE:
            return self.first.status
        if not self.size:
            return Status.NO_PATH
        begin = clock.seconds()
        h, _, status = machinery.bounds.lower_bounds(self.graph, source, targets, clock)
        self.seconds_bounds += clock.seconds() - begin
        if status is not None:
            return status
        first = (self.front, self.solutions, self.size)
        self.search = mean.search.CappedMean(self.graph, source, targets, h, self.columns, self.limits, first)
        # Both searches share the limit on labels.
        self.search.counters[machinery.slices.N_GENERATED] = self.first.stats.labels_generated
        return self.search.run(clock) if self.keeper is None else self.keeper.run(self.search, METHOD, clock)

    def result(self, source: int, clock: Clock, status: Status) -> MeanPaths:
        """Return the walks found, sorted by the mean."""
        first, counts = self.first.stats, {}
        front, solutions = self.front[: self.size], self.solutions[: self.size]
        if self.search is not None:
            front, solutions, generated, expanded, waiting = self.search.results()
            expanded += first.labels_expanded
            counts = {"labels_generated": generated, "labels_expanded": expanded, "labels_open": waiting}
        costs = np.empty((len(front), self.graph.criteria), np.int64)
        costs[:, list(self.columns)] = front
        costs.setflags(write=False)
        stats = replace(
            first,
            method=METHOD,
            order=self.columns,
            peak_memory=clock.peak,
            seconds_bounds=self.seconds_bounds,
            seconds_search=clock.seconds() - self.seconds_bounds,
            seconds_compiled=clock.compiled,
            **counts,
        )
        paths = tuple(self._path(int(label), clock) for label in solutions)
        integral, duration = self.columns[1], self.columns[0]
        notes: tuple[str, ...] = ()
        if status is Status.NO_PATH and len(self.first):
            notes = (f"cap must be at least {self.least}, the shortest duration, got {self.limits.cap}; raise it",)
        return MeanPaths(
            costs,
            status,
            stats,
            self.graph,
            source,
            paths,
            integral=integral,
            duration=duration,
            cap=self.limits.cap,
            notes=notes,
        )

    def _path(self, label: int, clock: Clock) -> IntArray:
        """Return the arcs of a solution's walk, as indices in the graph; the first search has negative labels."""
        if label < 0:
            return self.first._paths[int(self.rows[-1 - label])]
        if self.search is None:
            raise AssertionError("a label without its search, please report")
        return self.search.paths(np.array([label]), clock)[0]


def _without_column(graph: Graph, column: int) -> Graph:
    """Return the graph without one column of its costs."""
    left = [j for j in range(graph.criteria) if j != column]
    aggregates = [graph.aggregates[j] for j in left]
    return Graph.from_csr(graph.indptr, graph.heads, graph.costs[:, left], aggregates=aggregates)


def _columns(graph: Graph, integral: Any, duration: Any) -> tuple[int, ...]:
    """Check the options ``integral`` and ``duration``; return the columns: duration, integral, then the other costs."""
    last = graph.criteria - 1
    integral = whole("integral", integral, 0, last, "a column")
    duration = whole("duration", duration, 0, last, "a column")
    for name, column in (("integral", integral), ("duration", duration)):
        if graph.aggregates[column] != "sum":
            raise GraphError(f"{name} must be the column of a cost that is a sum, but cost {column} is a 'max'")
    if integral == duration:
        raise OptionError(f"integral and duration must be two columns, got {integral} for both")
    return (duration, integral, *(j for j in range(graph.criteria) if j not in (integral, duration)))
