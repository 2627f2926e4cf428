"""Weighted sums: the supported part of the front, one exact shortest path a weight."""

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
from hpop.runtime.status import Budget, Progress, ProgressCallback, Status
from hpop.runtime.sweep import Sweep
from hpop.search.graph import Graph
from hpop.search.lazy_paths import AskedArcs, Free
from hpop.search.queries import UNLIMITED, ParetoPaths, SearchStats, checked_graph, checked_node, checked_targets
from hpop.search.supported.weights import (
    NONE,
    Reduced,
    Task,
    Vector,
    WeightCone,
    checked_divisions,
    integer_weights,
    least_path,
    simplex_lattice,
    smallest,
    solve_weight,
)

if TYPE_CHECKING:
    from hpop.search.machinery.slices import Clock

ROUND = 16  # weights tested before the hull is updated: the same with and without workers
CHUNK_ARCS = 4_000_000  # arcs of the graphs of one chunk of jobs: some hundredths of a second
LARGEST_SUM = 2**61  # more than reduced costs add up to along a path; see Graph


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class SupportedPaths(ParetoPaths):
    """Supported points and their paths; see :class:`ParetoPaths`.

    weights  n         for each point the weights (., k) of normalised costs that gave it, each summing to 1
    ideal    (k,)      least value of each cost; a lower bound of it where a limit or Ctrl-C came first
    nadir    (k,)      greatest value of each cost among the lexicographic optima (an estimate beyond two costs)
    solved   count     weights for which a shortest path was computed
    notes              what went wrong with an executor
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
    """Find supported cost vectors of the paths from source to target, each with one path.

    Weights are those of normalised costs, (c_j - ideal_j) / (nadir_j - ideal_j). Without ``divisions`` or ``weights``
    they are adaptive: the lexicographic optima first, then the facets of the hull of all points found so far, until
    every facet is tested (for two costs that is the dichotomy). With ``divisions`` d they are the
    simplex lattice (Scheffe 1958; Das and Dennis 1998): all multiples of 1/d that sum to 1. Given ``weights`` are
    non-negative, of any positive sum, taken as fractions of the largest with denominators up to a million; the
    lexicographic optima, which normalisation needs, are returned as well. Where weights are zero,
    ties go to the least of these costs, the first of them first, so that every point is efficient, not only weakly.

    Accepts: any :class:`Graph` whose costs are sums.

    Guarantees: every vector is the optimum of positive weights among all paths, in exact integers. The adaptive sweep
    that ends by itself has every extreme supported vector, that is every vertex of conv(front) + R^k_>=. Results do not
    depend on the executor. If the time limit or Ctrl-C stops it, what is returned are supported vectors.

    With `free`, which says of some arcs (N,), by their places in the graph, which are free, all this holds of the graph
    without those that are blocked; it is asked, in this process, only about arcs on paths that are found, once each. A
    weight whose path is blocked is solved again without what is known to be blocked, until its path is free: that is
    the optimum, as to remove what was not asked about cannot better it.

    Cost: a shortest path a weight, by A* with the bounds of all costs; the number of facets grows with the number of
    extreme supported points n like n for up to three costs, like n^2 for four and five, n^3 for six.

    >>> graph = Graph.from_arcs(2, [0, 0, 0, 0], [1, 1, 1, 1], [[0, 4], [1, 3], [3, 2], [4, 0]])
    >>> found = supported_paths(graph, 0, 1)
    >>> found.costs.tolist(), found.solved  # (3, 2) lies above the line from (1, 3) to (4, 0)
    ([[0, 4], [4, 0]], 3)
    """
    checked_graph(graph)
    if "max" in graph.aggregates:
        raise GraphError(
            f"weighted sums need costs that add up, cost {graph.aggregates.index('max')} is a 'max'; use pareto_paths"
        )
    if divisions is not None and weights is not None:
        raise OptionError("give divisions or weights, not both")
    given = None if weights is None else [integer_weights(w, graph.criteria) for w in weights]
    if divisions is not None:
        divisions = checked_divisions(divisions, graph.criteria)
        given = list(simplex_lattice(divisions, graph.criteria))
    start, targets = checked_node(graph, source, "source"), checked_targets(graph, target)
    from hpop.search.machinery.slices import Clock  # numba: on first use

    run = SupportedRun(graph, start, Clock(budget, progress), None if free is None else AskedArcs(graph, free))
    try:
        status = run.go(targets, given, executor)
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    return run.result(status)


@dataclass(eq=False)
class SupportedRun:
    """One query: bounds, lexicographic optima, sweep; keeps what is found as it comes.

    asked  what is known of the arcs; None where all are free
    """

    graph: Graph
    source: int
    clock: Clock
    asked: AskedArcs | None = None
    found: dict[Vector, tuple[IntArray, list[Vector]]] = field(default_factory=dict)  # reduced costs: arcs, weights
    least: IntArray = field(init=False)  # bounds of the ideal, from which reduced costs are counted
    ideal: IntArray = field(init=False)
    nadir: IntArray = field(init=False)
    solved: int = 0
    rounds: int = 0
    after_bounds: float = 0.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.least = self.ideal = self.nadir = np.zeros(self.graph.criteria, np.int64)

    def go(self, targets: IntArray, given: list[Vector] | None, executor: Executor | None) -> Status:
        """Run the query; what it found is in ``found``."""
        from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds

        k = self.graph.criteria
        h, _, status = lower_bounds(self.graph, self.source, targets, self.clock)
        self.after_bounds = self.clock.seconds()
        if status is not None:
            return status
        if h[0, self.source] >= UNREACHABLE:
            return Status.NO_PATH
        self.least = self.nadir = h[:, self.source].copy()
        self.ideal = self.least.copy()
        self._reduce(h, targets, UNREACHABLE)
        del h
        units = [tuple(int(i == j) for i in range(k)) for j in range(k)]
        for j, unit in enumerate(units):
            status = self._optimum(j, unit)
            if status is not None:
                return status
        ranges = [max(1, int(r)) for r in self.nadir - self.ideal]
        chunk = max(1, min(ROUND, CHUNK_ARCS // max(1, len(self.data.heads))))
        with Sweep(solve_weight, self.data, executor, chunk=chunk) as sweep:
            for weights in self._adaptive(units) if given is None else self._given(given, ranges, units):
                if not self._round(weights, sweep):
                    return Status.TIME_LIMIT
        return Status.COMPLETE

    def _optimum(self, j: int, unit: Vector) -> Status | None:
        """Keep the lexicographic optimum of a cost; or why not."""
        task = self._task(unit, 0 if self.asked is None else self.radix[j])
        while not self._late():
            self.rounds += 1
            (posed,) = self._posed([task])
            arcs = least_path(self.data, posed, self.clock.call)
            if arcs is None:  # all ways are blocked: it is the first of the costs
                self.ideal = self.nadir = np.zeros_like(self.least)
                return Status.NO_PATH
            if not self._settle([arcs]):
                break
            if self._is_free(arcs):
                self.ideal[j] += self._keep(unit, arcs)[j]
                self.nadir = self.least + np.max(np.array(list(self.found)), axis=0)
                return None
        return Status.TIME_LIMIT

    def _round(self, weights: list[Vector], sweep: Sweep[Reduced, Task, IntArray]) -> bool:
        """Solve some weights, again where a path is blocked, and keep what is found; False where it was late before."""
        known = list(self.found)
        nearest = (np.array(known, float) @ np.array(weights, float).reshape(-1, self.graph.criteria).T).argmin(axis=0)
        tasks = [self._task(w, _dot(w, known[i])) for w, i in zip(weights, nearest, strict=True)]
        results: dict[int, IntArray] = {}
        try:
            while waiting := [i for i in range(len(tasks)) if i not in results]:
                self.rounds += 1
                found: dict[int, IntArray] = {}
                try:
                    for place, arcs in sweep.run(self._posed([tasks[i] for i in waiting]), self._late):
                        found[waiting[place]] = arcs
                        self._report(len(results) + len(found), len(waiting) - len(found))
                    ended = self._settle(list(found.values())) and len(found) == len(waiting)
                finally:  # what is finished when Ctrl-C comes is kept
                    results |= {i: arcs for i, arcs in found.items() if self._is_free(arcs)}
                if not ended:
                    return False
        finally:
            for i in sorted(results):
                self._keep(weights[i], results[i])
            self.notes = tuple(sweep.notes)
        return True

    # Arcs that may be blocked

    def _posed(self, tasks: list[Task]) -> list[Task]:
        """The same without the arcs that are known to be blocked."""
        if self.asked is None:
            return tasks
        blocked = np.flatnonzero(self.asked.blocked[self.place])
        return [task._replace(blocked=blocked) for task in tasks]

    def _settle(self, paths: list[IntArray]) -> bool:
        """Ask which paths are free; False where it was late before that is known."""
        if self.asked is None or not paths:
            return True
        lengths = np.array([arcs.size for arcs in paths])
        return self.asked.settle(self.place[np.concatenate(paths)], lengths, self._late)

    def _is_free(self, arcs: IntArray) -> bool:
        """Whether a path is known to be free."""
        return self.asked is None or bool(self.asked.are_free(self.place[arcs], np.array([arcs.size]))[0])

    def _reduce(self, h: IntArray, targets: IntArray, unreachable: np.int64) -> None:
        """Drop arcs that lead nowhere and reduce the costs of the rest."""
        from hpop.search.machinery.slices import PARTS
        from hpop.search.supported.weighted_path import arcs_onward, reduce_costs

        graph, k = self.graph, len(h)
        start = self.clock.call(arcs_onward, graph.indptr, graph.heads, h[0], unreachable)
        m = int(start[-1])
        farthest = h.max(axis=1, initial=0, where=h < unreachable)
        narrow = (graph.largest + farthest).max() < 2**31  # no reduced cost is more, though all may be less
        self.place, heads = np.empty(m, np.int64), np.empty(m, np.int32)
        costs = np.empty((m, k), np.int32 if narrow else np.int64)
        borders = np.linspace(0, graph.nodes, PARTS + 1).astype(int).tolist()
        rest = ((graph.indptr, graph.heads, graph.costs), h, unreachable, start, self.place, heads, costs)
        largest, bound = zip(*self.clock.call_all(reduce_costs, [(p, *rest) for p in pairwise(borders)]), strict=True)
        if np.max(largest) < 2**31:
            costs = costs.astype(np.int32, copy=False)
        is_target = np.zeros(graph.nodes, np.uint8)
        is_target[targets] = 1
        # No path adds up to this much in a cost, so these are the digits of lexicographic order.
        self.radix = [int(min(1.001 * worst + 2, LARGEST_SUM)) for worst in np.sum(bound, axis=0)]
        self.data = Reduced(start, heads, costs, self.source, is_target, tuple(np.max(largest, axis=0).tolist()))

    def _task(self, weights: Vector, limit: int) -> Task:
        """Weights with the ties of zero weights broken: one number whose digits are the sum and these costs."""
        refined = [0] * len(weights)
        scale = 1
        for j in reversed(range(len(weights))):
            if weights[j] == 0:
                refined[j] = scale
                scale *= self.radix[j]
        refined = [w * scale if w else r for w, r in zip(weights, refined, strict=True)]
        return Task(tuple(refined), (limit + 1) * scale - 1)

    def _adaptive(self, tested: Sequence[Vector]) -> Iterator[list[Vector]]:
        """Rounds of weights, until every facet of the hull of what is found is tested."""
        done = set(tested)
        inside: set[Vector] = set()
        cone: WeightCone | None = None
        while True:
            for point in self.found:
                if point in inside:
                    continue
                inside.add(point)
                if cone is None:
                    cone = WeightCone(point)
                else:
                    cone.add(point)
            facets = cone.facets() if cone else []
            tasks = list(islice(dict.fromkeys(w for w in (smallest(w) for w, _ in facets) if w not in done), ROUND))
            if not tasks:
                return
            done.update(tasks)
            yield tasks

    def _given(self, given: list[Vector], ranges: list[int], units: Sequence[Vector]) -> Iterator[list[Vector]]:
        """One round of the given weights of normalised costs, but those of a single cost, which are solved already."""
        product = math.prod(ranges)
        scaled = dict.fromkeys(smallest([w * (product // r) for w, r in zip(v, ranges, strict=True)]) for v in given)
        yield [w for w in scaled if w not in units]

    def _keep(self, weights: Vector, arcs: IntArray) -> Vector:
        """File a path under its reduced costs, and return these."""
        costs = tuple(int(c) for c in self.data.costs[arcs].sum(axis=0, dtype=np.int64))
        self.solved += 1
        self.found.setdefault(costs, (arcs, []))[1].append(weights)
        return costs

    def _late(self) -> bool:
        return self.clock.exceeded(0, 0) is not None

    def _report(self, done: int, waiting: int) -> None:
        """Report how many weights of a round are done, and how many wait."""
        if self.clock.progress is not None:
            seconds, front = self.clock.seconds(), len(self.found)
            solved = self.solved + done
            self.clock.progress(Progress("weights", labels=solved, open=waiting, front=front, seconds=seconds))

    def result(self, status: Status) -> SupportedPaths:
        """What was found, in lexicographic order."""
        k = self.graph.criteria
        points = sorted(self.found)
        costs = np.array(points, np.int64).reshape(len(points), k) + self.least
        costs.setflags(write=False)
        ranges = [max(1, int(r)) for r in self.nadir - self.ideal]
        end = self.clock.seconds()
        state = NONE if self.asked is None else self.asked.state
        blocked = NONE if self.asked is None else np.flatnonzero(self.asked.blocked)
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
            tuple(self.place[self.found[p][0]] for p in points),
            weights=tuple(_normalised(self.found[p][1], ranges) for p in points),
            ideal=self.ideal,
            nadir=self.nadir,
            solved=self.solved,
            notes=self.notes,
            blocked=blocked,
        )


def _dot(weights: Vector, point: Vector) -> int:
    return sum(w * c for w, c in zip(weights, point, strict=True))


def _normalised(weights: Sequence[Vector], ranges: Sequence[int]) -> FloatArray:
    """Weights (m, k) of normalised costs, summing to 1, from weights of the costs as they are."""
    scaled = [[w * r for w, r in zip(row, ranges, strict=True)] for row in weights]
    return np.array([[float(Fraction(w, sum(row))) for w in row] for row in scaled])
