"""Weighted sums: the supported part of the front, by one exact shortest path for each vector of weights."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import islice, pairwise
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.errors import GraphError, OptionError
from hpop.runtime.limits import Budget, Progress, ProgressCallback, Status
from hpop.runtime.sweep import Sweep
from hpop.search import machinery, supported
from hpop.search.graph import Graph
from hpop.search.lazy_paths import ArcStates, Free
from hpop.search.queries import UNLIMITED, ParetoPaths, SearchStats, checked_graph, checked_node, checked_targets
from hpop.search.supported import (
    NONE,
    Reduced,
    Task,
    Vector,
    WeightCone,
    checked_divisions,
    divided_by_gcd,
    integer_weights,
    least_path,
    simplex_lattice,
    solve_weight,
)

if TYPE_CHECKING:
    from hpop.search.machinery.slices import Clock

ROUND = 16  # number of weights that are solved between updates of the hull, with or without workers
CHUNK_ARCS = 4_000_000  # number of arcs in all graphs of a chunk of jobs: some hundredths of a second
LARGEST_SUM = 2**61  # bound on sums of reduced costs along a path; see Graph


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class SupportedPaths(ParetoPaths):
    """Result of a weighted-sum search: the supported points of the front, each with a path.

    A point is supported if it is optimal for some positive weights. ``gap`` is always 0, and claims nothing about other
    points. Other fields and methods are those of :class:`ParetoPaths`.

    weights  n      for each point, the weights (., k) of normalised costs for which it is optimal; rows sum to 1
    ideal    (k,)   least value of each cost, or a lower bound after a limit or Ctrl-C
    nadir    (k,)   greatest value of each cost among the lexicographic optima (an estimate for more than two costs)
    solved   count  vectors of weights for which a shortest path was computed
    notes           lines for the user, such as failures of the executor
    """

    KIND: ClassVar[str] = "supported vectors of paths"

    weights: tuple[FloatArray, ...]
    ideal: IntArray
    nadir: IntArray
    solved: int
    notes: tuple[str, ...]


@checked_arguments
def supported_paths(
    graph: Graph,
    source: Hashable,
    target: Hashable | Iterable[Hashable],
    *,
    divisions: int | None = None,
    weights: Sequence[Sequence[float]] | None = None,
    budget: Budget = UNLIMITED,
    progress: ProgressCallback | None = None,
    executor: Executor | None = None,
    free: Free | None = None,
) -> SupportedPaths:
    """Return supported cost vectors of the paths from source to target: optima of weighted sums, with one path each.

    Weights apply to normalised costs, (c_j - ideal_j) / (nadir_j - ideal_j). Without ``divisions`` or ``weights`` they
    are adaptive: the lexicographic optima first, then normals of the facets of the hull of all points found so far,
    until every facet is tested (for two costs this is the dichotomy). With ``divisions`` d they are the simplex lattice
    (Scheffe 1958; Das and Dennis 1998): all vectors of multiples of 1/d that sum to 1. ``weights`` are non-negative
    vectors with any positive sum, taken as fractions of their largest with denominators up to a million. The
    lexicographic optima, which normalisation needs, are returned as well. Ties under zero weights are broken by these
    costs in their order, so every point is efficient, not only weakly efficient.

    Accepts: any :class:`Graph` with costs that are sums.

    Guarantees: every vector is the optimum of positive weights among all paths, in exact integers. If the adaptive
    search is complete, it has every extreme supported vector, that is every vertex of conv(front) + R^k_>=. Results do
    not depend on the executor. After the time limit or Ctrl-C the vectors found so far, all supported, are returned.

    `free` is a function that takes indices (N,) of arcs in the graph, and returns which of these arcs are free. All
    this then holds for the graph without its blocked arcs. Only arcs on found paths are checked, once each, in this
    process. If the path for some weights is blocked, they are solved again without the arcs known to be blocked, until
    their path is free. This path is the optimum, as the removal of unchecked arcs could not improve it.

    Cost: a shortest path for each vector of weights, by A* with the bounds of all costs. The number of facets grows
    with the number n of extreme supported points: like n for up to three costs, n^2 for four and five, n^3 for six.

    >>> graph = Graph.from_arcs(2, [0, 0, 0, 0], [1, 1, 1, 1], [[0, 4], [1, 3], [3, 2], [4, 0]])
    >>> paths = supported_paths(graph, 0, 1)
    >>> paths.costs.tolist(), paths.solved  # (3, 2) lies above the line from (1, 3) to (4, 0)
    ([[0, 4], [4, 0]], 3)
    """
    checked_graph(graph)
    if "max" in graph.aggregates:
        raise GraphError(
            f"weighted sums need costs that are sums, but cost {graph.aggregates.index('max')} is a 'max'; use "
            "pareto_paths"
        )
    if divisions is not None and weights is not None:
        raise OptionError("only one of divisions and weights can be given, got both; leave one out")
    fixed = None if weights is None else [integer_weights(w, graph.criteria) for w in weights]
    if divisions is not None:
        divisions = checked_divisions(divisions, graph.criteria)
        fixed = list(simplex_lattice(divisions, graph.criteria))
    start, targets = checked_node(graph, source, "source"), checked_targets(graph, target)
    clock = machinery.slices.Clock(budget, progress)
    run = SupportedRun(graph, start, clock, None if free is None else ArcStates(graph, free))
    try:
        status = run.go(targets, fixed, executor)
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    return run.result(status)


@dataclass(eq=False)
class SupportedRun:
    """One run of a query: it computes lower bounds and lexicographic optima, then solves vectors of weights in rounds.

    states  which arcs are known to be free or blocked; None if all are free
    paths   paths found: reduced costs -> arcs of the path, and the weights for which it is optimal
    least   (k,)  lower bounds of the ideal, by which reduced costs are less than costs
    ideal   (k,)  least value of each cost
    nadir   (k,)  greatest value of each cost among the lexicographic optima
    solved  number of vectors of weights for which a shortest path was computed
    rounds  number of rounds, also those repeated because of blocked arcs
    """

    graph: Graph
    source: int
    clock: Clock
    states: ArcStates | None = None
    paths: dict[Vector, tuple[IntArray, list[Vector]]] = field(default_factory=dict)
    least: IntArray = field(init=False)
    ideal: IntArray = field(init=False)
    nadir: IntArray = field(init=False)
    solved: int = 0
    rounds: int = 0
    after_bounds: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.least = self.ideal = self.nadir = np.zeros(self.graph.criteria, np.int64)

    def go(self, targets: IntArray, fixed: list[Vector] | None, executor: Executor | None) -> Status:
        """Run the query for ``fixed`` weights, or for adaptive ones if None; return the status, fill ``paths``."""
        k = self.graph.criteria
        h, _, status = machinery.bounds.lower_bounds(self.graph, self.source, targets, self.clock)
        self.after_bounds = self.clock.seconds()
        if status is not None:
            return status
        if h[0, self.source] >= machinery.bounds.UNREACHABLE:
            return Status.NO_PATH
        self.least = self.nadir = h[:, self.source].copy()
        self.ideal = self.least.copy()
        self._set_reduced_costs(h, targets, machinery.bounds.UNREACHABLE)
        del h
        units = [tuple(int(i == j) for i in range(k)) for j in range(k)]
        for j, unit in enumerate(units):
            status = self._optimum(j, unit)
            if status is not None:
                return status
        ranges = [max(1, int(r)) for r in self.nadir - self.ideal]
        chunk = max(1, min(ROUND, CHUNK_ARCS // max(1, len(self.data.heads))))
        with Sweep(solve_weight, self.data, executor, chunk=chunk) as sweep:
            for weights in self._adaptive_rounds(units) if fixed is None else self._fixed_round(fixed, ranges, units):
                if not self._solve_round(weights, sweep):
                    return Status.TIME_LIMIT
        return Status.COMPLETE

    def _optimum(self, j: int, unit: Vector) -> Status | None:
        """Find and record the lexicographic optimum for cost j (weights ``unit``); return a status if this fails."""
        task = self._task(unit, 0 if self.states is None else self.radix[j])
        while not self._is_late():
            self.rounds += 1
            (free_task,) = self._without_blocked_arcs([task])
            arcs = least_path(self.data, free_task, self.clock.call)
            if arcs is None:  # all paths are blocked: this shows at the first cost
                self.ideal = self.nadir = np.zeros_like(self.least)
                return Status.NO_PATH
            if not self._check_paths([arcs]):
                break
            if self._is_free(arcs):
                self.ideal[j] += self._record(unit, arcs)[j]
                self.nadir = self.least + np.max(np.array(list(self.paths)), axis=0)
                return None
        return Status.TIME_LIMIT

    def _solve_round(self, weights: list[Vector], sweep: Sweep[Reduced, Task, IntArray]) -> bool:
        """Find and record the best path for each vector of weights; return False if the time limit comes earlier.

        A path with a blocked arc is not recorded. Its weights are solved again without the arcs known to be blocked.
        """
        points = list(self.paths)
        nearest = (np.array(points, float) @ np.array(weights, float).reshape(-1, self.graph.criteria).T).argmin(axis=0)
        tasks = [self._task(w, _dot(w, points[i])) for w, i in zip(weights, nearest, strict=True)]
        results: dict[int, IntArray] = {}
        try:
            while waiting := [i for i in range(len(tasks)) if i not in results]:
                self.rounds += 1
                solved: dict[int, IntArray] = {}
                try:
                    for index, arcs in sweep.run(
                        self._without_blocked_arcs([tasks[i] for i in waiting]), self._is_late
                    ):
                        solved[waiting[index]] = arcs
                        self._report(len(results) + len(solved), len(waiting) - len(solved))
                    is_complete = self._check_paths(list(solved.values())) and len(solved) == len(waiting)
                finally:  # also after Ctrl-C
                    results |= {i: arcs for i, arcs in solved.items() if self._is_free(arcs)}
                if not is_complete:
                    return False
        finally:
            for i in sorted(results):
                self._record(weights[i], results[i])
            self.notes = tuple(sweep.notes)
        return True

    # Arcs that may be blocked

    def _without_blocked_arcs(self, tasks: list[Task]) -> list[Task]:
        """Return the tasks with all arcs excluded that are known to be blocked."""
        if self.states is None:
            return tasks
        blocked = np.flatnonzero(self.states.blocked[self.arc_index])
        return [task._replace(blocked=blocked) for task in tasks]

    def _check_paths(self, paths: list[IntArray]) -> bool:
        """Check arcs until each path is known to be free or blocked; return False if the time limit comes earlier."""
        if self.states is None or not paths:
            return True
        lengths = np.array([arcs.size for arcs in paths])
        return self.states.settle(self.arc_index[np.concatenate(paths)], lengths, self._is_late)

    def _is_free(self, arcs: IntArray) -> bool:
        """Return whether all arcs of a path are known to be free of collisions."""
        return self.states is None or bool(self.states.are_free(self.arc_index[arcs], np.array([arcs.size]))[0])

    def _set_reduced_costs(self, h: IntArray, targets: IntArray, unreachable: np.int64) -> None:
        """Build ``data``, the graph that workers search: without arcs that reach no target, with reduced costs.

        h  (k, n)  lower bounds of the remaining costs, `unreachable` if no target is reached
        """
        graph, k = self.graph, len(h)
        start = self.clock.call(supported.weighted_path.arcs_onward, graph.indptr, graph.heads, h[0], unreachable)
        m = int(start[-1])
        farthest = h.max(axis=1, initial=0, where=h < unreachable)
        narrow = (graph.largest + farthest).max() < 2**31  # a bound on reduced costs
        self.arc_index, heads = np.empty(m, np.int64), np.empty(m, np.int32)
        costs = np.empty((m, k), np.int32 if narrow else np.int64)
        borders = np.linspace(0, graph.nodes, machinery.slices.PARTS + 1).astype(int).tolist()
        tables = ((graph.indptr, graph.heads, graph.costs), h, unreachable, start, self.arc_index, heads, costs)
        calls = [(part, *tables) for part in pairwise(borders)]
        largest, bound = zip(*self.clock.call_all(supported.weighted_path.reduce_costs, calls), strict=True)
        if np.max(largest) < 2**31:
            costs = costs.astype(np.int32, copy=False)
        is_target = np.zeros(graph.nodes, np.uint8)
        is_target[targets] = 1
        # No path costs this much, so a weighted sum with these factors compares costs one after the other.
        self.radix = [int(min(1.001 * worst + 2, LARGEST_SUM)) for worst in np.sum(bound, axis=0)]
        self.data = Reduced(start, heads, costs, self.source, is_target, tuple(np.max(largest, axis=0).tolist()))

    def _task(self, weights: Vector, limit: int) -> Task:
        """Return the task for some weights, with weights added that break ties by the costs of weight 0.

        The weighted sum of the task is like a number whose leading digits are the weighted sum for ``weights``, and
        whose further digits are the costs of weight 0. ``limit`` is an upper bound of the former.
        """
        refined = [0] * len(weights)
        scale = 1
        for j in reversed(range(len(weights))):
            if weights[j] == 0:
                refined[j] = scale
                scale *= self.radix[j]
        refined = [w * scale if w else r for w, r in zip(weights, refined, strict=True)]
        return Task(tuple(refined), (limit + 1) * scale - 1)

    def _adaptive_rounds(self, tested: Sequence[Vector]) -> Iterator[list[Vector]]:
        """Yield rounds of weights, from the facets of the hull of the points found, until every facet is tested.

        ``tested`` are weights that are solved already.
        """
        done = set(tested)
        inside: set[Vector] = set()
        cone: WeightCone | None = None
        while True:
            for point in self.paths:
                if point in inside:
                    continue
                inside.add(point)
                if cone is None:
                    cone = WeightCone(point)
                else:
                    cone.add(point)
            facets = cone.facets() if cone else []
            tasks = list(
                islice(dict.fromkeys(w for w in (divided_by_gcd(w) for w, _ in facets) if w not in done), ROUND)
            )
            if not tasks:
                return
            done.update(tasks)
            yield tasks

    def _fixed_round(self, weights: list[Vector], ranges: list[int], units: Sequence[Vector]) -> Iterator[list[Vector]]:
        """Yield one round with all given weights, converted from normalised costs to costs.

        weights  vectors of weights for normalised costs
        ranges   nadir minus ideal of each cost
        units    weights of single costs, which are solved already and left out
        """
        product = math.prod(ranges)
        scaled = dict.fromkeys(
            divided_by_gcd([w * (product // r) for w, r in zip(v, ranges, strict=True)]) for v in weights
        )
        yield [w for w in scaled if w not in units]

    def _record(self, weights: Vector, arcs: IntArray) -> Vector:
        """Record a path and the weights for which it is optimal; return its costs, less ``least``."""
        costs = tuple(int(c) for c in self.data.costs[arcs].sum(axis=0, dtype=np.int64))
        self.solved += 1
        self.paths.setdefault(costs, (arcs, []))[1].append(weights)
        return costs

    def _is_late(self) -> bool:
        return self.clock.exceeded(0, 0) is not None

    def _report(self, done: int, waiting: int) -> None:
        """Report progress: how many weights of the round are ``done``, and how many are ``waiting``."""
        if self.clock.progress is not None:
            seconds, front = self.clock.seconds(), len(self.paths)
            solved = self.solved + done
            self.clock.progress(Progress("weights", labels=solved, open=waiting, front=front, seconds=seconds))

    def result(self, status: Status) -> SupportedPaths:
        """Return the paths found so far, in lexicographic order of their costs, with statistics."""
        k = self.graph.criteria
        points = sorted(self.paths)
        costs = np.array(points, np.int64).reshape(len(points), k) + self.least
        costs.setflags(write=False)
        ranges = [max(1, int(r)) for r in self.nadir - self.ideal]
        end = self.clock.seconds()
        state = NONE if self.states is None else self.states.state
        blocked = NONE if self.states is None else np.flatnonzero(self.states.blocked)
        stats = SearchStats(
            "weighted sum",
            peak_memory=self.clock.peak,
            seconds_bounds=self.after_bounds,
            seconds_search=end - self.after_bounds,
            seconds_compiled=self.clock.compiled,
            arcs_checked=int(np.count_nonzero(state)),
            arcs_blocked=blocked.size,
            rounds=self.rounds,
        )
        return SupportedPaths(
            costs,
            status,
            stats,
            self.graph,
            self.source,
            tuple(self.arc_index[self.paths[p][0]] for p in points),
            weights=tuple(_normalised(self.paths[p][1], ranges) for p in points),
            ideal=self.ideal,
            nadir=self.nadir,
            solved=self.solved,
            notes=self.notes,
            blocked=blocked,
        )


def _dot(weights: Vector, point: Vector) -> int:
    return sum(w * c for w, c in zip(weights, point, strict=True))


def _normalised(weights: Sequence[Vector], ranges: Sequence[int]) -> FloatArray:
    """Convert m vectors of weights of costs to weights (m, k) of normalised costs, each summing to 1.

    ranges  nadir minus ideal of each cost, by which costs are normalised
    """
    scaled = [[w * r for w, r in zip(row, ranges, strict=True)] for row in weights]
    return np.array([[float(Fraction(w, sum(row))) for w in row] for row in scaled])
