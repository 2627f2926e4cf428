"""A graph prepared for fast searches to the same targets from any node, while arcs are closed and opened again.

A driving robot repeats one query from many nodes, while doors close and open. Most of the time of a small query goes
into the groups of turns and the lower bounds of remaining costs. These do not depend on the source, so they are
computed once. Closed arcs need no new graph: in the tables of a search they cost more than any solution, or lead back
to their tails. Lower bounds are repaired where they change (:mod:`.repair`). Without a repair they would still be valid
after a closing, but would lead the search to the closed door.

All turns of a group can be closed together. If only some are closed, a path may need two turns in a row, which groups
exclude. The search then does without groups until these turns are open again, which is exact but slower.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, IntArray
from hpop.base.options import MOST, real
from hpop.frontier import is_nondominated
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.search.graph import Graph
from hpop.search.machinery import Precision
from hpop.search.machinery.bounds import PILES, UNREACHABLE, costs_of_least_paths, costs_to_go
from hpop.search.machinery.kernels import proven_gap
from hpop.search.machinery.slices import N_GENERATED, Clock, DeadlineClock, Search
from hpop.search.machinery.turns import Groups
from hpop.search.pareto_paths import SearchQuery
from hpop.search.prepared.closings import ClosedArcs, KnownPaths, StaircaseBounds, known_paths, least_path
from hpop.search.prepared.hull_repair import HullRepair
from hpop.search.prepared.repair import lower_bounds_of_opened, raise_bounds, sort_by_head
from hpop.search.queries import UNLIMITED, ParetoPaths, SearchStats, checked_graph, checked_node, checked_targets
from hpop.search.staircase import choose_method, choose_order
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import TooWide

# Most queries of a driving robot are small, and the exact search ends in milliseconds. If it has used a share of its
# limits without ending, it pauses for an approximate search. This search first repairs the cached joint bounds (lower
# bounds of two costs together) for the closed arcs, as far as time allows. With these bounds and all known paths it
# needs some thousands of labels, and proves a gap that the exact search, which is ordered by its first cost, would
# prove only at its end. Then the exact search goes on. On small graphs joint bounds are not repaired: while arcs are
# closed, the exact search has all the time.


FIRST, SECOND = 0.4, 0.7  # shares of the limits at which the approximate search begins and ends
SOON, REPAIRED, LATE = 0.15, 0.55, 0.95  # shares if joint bounds are repaired: begin, end of the repair, end
GAP = 0.1  # relative precision of the approximate search
CLOSER = 350e-6, 15e-9  # s, and s for each open label (partial path), to prove a closer gap by bounds by turns
JOINTLY = 15e-3, 1e-6  # the same by joint bounds
AHEAD = 150e-9  # s for each node, that the approximate search needs before its first label


class PreparedRun:
    """One run of a query on a prepared graph.

    exact        exact search, None before it is set up
    approximate  search with the precision GAP, which runs while the exact search pauses; None if it does not run
    """

    def __init__(self, prepared: Prepared, source: int, known: KnownPaths) -> None:
        self.prepared, self.source, self.known = prepared, source, known
        self.exact: Search | None = None
        self.approximate: Staircase | None = None
        self.is_approximate_complete = False  # whether the approximate search is complete
        self.method, self.order = prepared.plans[0]

    def go(self, clock: DeadlineClock) -> Status:
        """Run the searches to the end or until a limit, and return the status."""
        if self.prepared.bounds[0, self.source] >= UNREACHABLE:
            return Status.NO_PATH
        status = clock.exceeded(0, 0)
        if status is not None:
            return status
        try:
            return self._run(clock)
        except TooWide:
            self.exact, (self.method, self.order) = None, self.prepared.plans[1]
            return self._run(clock)

    def _run(self, clock: DeadlineClock) -> Status:
        prepared = self.prepared
        query = SearchQuery(prepared.graph, self.source, prepared.targets)
        groups = prepared.closed_arcs.groups
        search = query.search(self.method, self.order, prepared.bounds, groups, clock, jointly=False)
        prepared.closed_arcs.close_arcs_of(search, groups)
        self.exact = search
        staircase_bounds, in_groups = prepared.staircase_bounds, groups is prepared.closed_arcs.whole
        if isinstance(search, Staircase) and in_groups and staircase_bounds.layers is not None:
            search.take_turn_bounds(staircase_bounds.layers.astype(search.dtype, copy=False))
        is_right = prepared.hull is not None or not prepared.closed_arcs.closed.any()
        if isinstance(search, Staircase) and in_groups and staircase_bounds.hull and is_right and clock.is_limited:
            clock.share = SOON if prepared.outdated_hull else FIRST
            status = search.run(clock)
            if status not in (Status.TIME_LIMIT, Status.LABEL_LIMIT):
                return status
            self._run_approximate(search, clock)
            clock.share = 1.0
        return search.run(clock)

    def _run_approximate(self, exact: Staircase, clock: DeadlineClock) -> None:
        """Repair the joint bounds, then run the approximate search, starting from all known paths.

        The paths found by the exact search so far are among them.
        """
        prepared, staircase_bounds = self.prepared, self.prepared.staircase_bounds
        graph, groups, hull = prepared.graph, prepared.closed_arcs.whole, staircase_bounds.hull
        h = staircase_bounds.h.copy()
        turns = prepared.bounds[self.order[1]]  # joint bounds do not depend on these
        np.copyto(h[self.order[1]], turns, where=turns < UNREACHABLE)
        clock.share = SECOND
        if (outdated_hull := prepared.outdated_hull) is not None:
            clock.share = REPAIRED
            outdated_hull.close(prepared.closed_arcs.closed, prepared.closed_arcs.turns > 0, clock)
            clock.share = LATE
        if hull is None or clock.remaining < AHEAD * graph.nodes:
            return
        clock.labels, clock.memory = int(exact.counters[N_GENERATED]), exact.memory()
        query = SearchQuery(graph, self.source, prepared.targets, Precision(GAP))
        try:
            search = query.staircase(self.order, h, groups, clock, jointly=True)
            prepared.closed_arcs.close_arcs_of(search, groups)
            along, paths_along = search.front_near_hull(hull, clock)
            costs_found, labels, *_ = exact.results()
            costs = np.concatenate([self.known.costs[:, list(self.order)], costs_found, along])
            paths = [*self.known.paths, *exact.paths(labels, clock), *paths_along]
            rows = _non_dominated_rows(costs)
            search.take_joint_bounds(hull, costs[rows], [paths[row] for row in rows], clock)
            self.approximate = search
            self.is_approximate_complete = search.run(clock) is Status.COMPLETE
        except TooWide:
            self.approximate = None
        clock.labels = 0 if self.approximate is None else int(self.approximate.counters[N_GENERATED])
        clock.memory = 0 if self.approximate is None else self.approximate.memory()

    def result(self, clock: DeadlineClock, status: Status) -> ParetoPaths:
        """Return the non-dominated paths among all found and known ones, with the gap to missing paths."""
        graph = self.prepared.graph
        costs, paths = self.known
        generated = expanded = waiting = 0
        for search in (self.approximate, self.exact):
            if search is not None:
                costs_found, labels, new, followed, waiting = search.results()
                costs = np.concatenate([self._in_graph_columns(costs_found), costs])
                paths = (*search.paths(labels, clock), *paths)
                generated, expanded = generated + new, expanded + followed
        rows = _non_dominated_rows(costs)
        costs = costs[rows]
        costs.setflags(write=False)
        gap = 0.0 if status.is_final else self._gap(costs, clock)
        stats = SearchStats(
            self.method,
            self.order,
            labels_generated=generated,
            labels_expanded=expanded,
            labels_open=waiting,
            peak_memory=sum(self._own_bytes(search) for search in (self.approximate, self.exact) if search is not None),
            seconds_search=clock.seconds(),
            seconds_compiled=clock.compiled,
        )
        return ParetoPaths(costs, status, stats, graph, self.source, tuple(paths[row] for row in rows), gap=gap)

    def _own_bytes(self, search: Search) -> int:
        """Return the bytes of a search's arrays, without those that it shares with the prepared graph."""
        staircase_bounds, groups = self.prepared.staircase_bounds, self.prepared.closed_arcs.whole
        shared = [staircase_bounds.layers, *vars(groups).values(), *vars(staircase_bounds.hull or object).values()]
        places = {array.__array_interface__["data"][0] for array in shared if isinstance(array, np.ndarray)}
        arrays = search.arrays()
        return sum(array.nbytes for array in arrays if array.__array_interface__["data"][0] not in places)

    def _gap(self, costs: IntArray, clock: DeadlineClock) -> float:
        """Return the smallest gap of costs (n, k) to missing paths that the exact or the approximate search proves."""
        if self.exact is None:
            return proven_gap(costs, self.prepared.bounds[:, self.source][None], math.inf)
        front, gap = costs[:, list(self.order)], GAP if self.is_approximate_complete else math.inf
        if self.approximate is not None and not self.is_approximate_complete:
            gap = max(GAP, self._gap_of(self.approximate, front, gap, clock))
        return min(gap, self._gap_of(self.exact, front, gap, clock))

    def _gap_of(self, search: Search, front: IntArray, gap: float, clock: DeadlineClock) -> float:
        """Return the gap that a search proves for a front (n, k), its columns in the order of the search.

        gap  the smallest gap proven so far; if the search proves no smaller one, the result is this value or more
        """
        estimates = search.estimates()
        gap = proven_gap(front, estimates[:, : len(self.order)], gap)
        if isinstance(search, Staircase) and (search.layers.size or search.hull):
            fixed, each = JOINTLY if search.hull else CLOSER
            if clock.remaining > fixed + each * len(estimates):
                gap = search.closer_gap(front, gap, estimates, front[:0], clock)
        return gap

    def _in_graph_columns(self, table: IntArray) -> IntArray:
        """Return costs (n, k) with columns in the order of the graph instead of the order of the search."""
        columns: IntArray = np.empty((len(table), len(self.order)), np.int64)
        columns[:, list(self.order)] = table[:, : len(self.order)]
        return columns


def _non_dominated_rows(costs: IntArray) -> IntArray:
    """Return the indices of the non-dominated rows of costs (n, k), in lexicographic order of the rows."""
    rows: IntArray = np.lexsort(costs.T[::-1])
    return rows[is_nondominated(costs[rows].astype(np.float64))] if len(rows) else rows


MANY = 100_000  # nodes: on smaller graphs the exact search mostly ends before joint bounds are needed
FINE = 2.0**24  # costs that break ties: value of the largest bound
DEAREST = 2.0**34  # and the most that an arc may cost, so that sums do not overflow
SHARE = 0.2  # share of the nodes: if a closing changes more bounds, computing all bounds again is faster


@checked_arguments
class Prepared:
    """A graph prepared for searches from any node to the same targets, in which arcs can be closed and opened.

    bounds  (k, n)  least value of each cost over the paths of open arcs from each node to a target
    onward  (k, n)  next node on such a path, -1 at targets and at nodes without a path

    Accepts: any :class:`Graph`, 1 to 6 costs, each a sum or a maximum.

    Guarantees: :meth:`paths` returns the same front as :func:`pareto_paths` on the graph without the closed arcs.

    Cost: groups of turns and bounds are computed once, and bounds are repaired after each closing and opening. A search
    then takes only the time for its labels. The first search that needs joint bounds repairs them, as its limits allow.

    >>> graph = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 5], [1, 5], [9, 1]])
    >>> prepared = Prepared(graph, 2)
    >>> prepared.paths(0).costs.tolist(), prepared.paths(1).costs.tolist()
    ([[2, 10], [9, 1]], [[1, 5]])
    >>> prepared.close([2])
    >>> prepared.paths(0).costs.tolist(), prepared.paths(1).status
    ([[9, 1]], <Status.NO_PATH: 'no path'>)
    """

    def __init__(
        self, graph: Graph, target: Hashable | Iterable[Hashable], *, progress: ProgressCallback | None = None
    ) -> None:
        graph = checked_graph(graph)
        if graph.layers > 1:
            graph = graph.copied()  # as an arc of a layer can be closed alone
        self.graph = graph
        self.targets = checked_targets(graph, target)
        self.is_target = np.zeros(graph.nodes, np.bool_)
        self.is_target[self.targets] = True
        clock = Clock(UNLIMITED, progress)
        clock.report("bounds")
        groups = Groups.of(graph, clock).unshared()
        h, self.onward = costs_to_go(graph, self.targets, clock, groups)
        reached = h[0] < UNREACHABLE
        far = int(
            np.argmax(np.where(reached, (h / (1 + h.max(axis=1, where=reached, initial=0))[:, None]).sum(axis=0), -1))
        )
        samples = costs_of_least_paths(graph, far, h, self.onward, clock)
        method, index = choose_method(graph, "auto", samples, groups)
        if method == "staircase" and groups.column != index:
            groups = Groups.single_nodes(graph, clock)
        self.plans = [
            (each, choose_order(graph, each, index, samples, h[:, far], groups)) for each in (method, "general")
        ]
        self.bounds = h.copy()
        self.staircase_bounds = StaircaseBounds(h)
        if method == "staircase":
            self.staircase_bounds = StaircaseBounds.of(graph, far, self.targets, self.plans[0][1], h, groups, clock)
        self.closed_arcs = ClosedArcs(graph, groups)
        self.hull: HullRepair | None = None
        if self.staircase_bounds.hull is not None and graph.nodes > MANY:
            first, _, rest = self.plans[0][1]
            self.hull = HullRepair(self.staircase_bounds.hull, groups, graph.costs, (first, rest), h, self.is_target)
        self._entering: tuple[IntArray, NDArray[np.int32]] | None = None

    @property
    def closed(self) -> BoolArray:
        """Mask (m,), True for each closed arc; a copy."""
        return self.closed_arcs.closed.copy()

    @property
    def memory(self) -> int:
        """Size of all arrays except those of the graph, bytes."""
        staircase_bounds, entering = self.staircase_bounds, self._entering or ()
        arrays = [self.bounds, self.onward, staircase_bounds.h, *entering, *vars(self.closed_arcs.whole).values()]
        arrays += [self.closed_arcs.closed, staircase_bounds.layers, *vars(staircase_bounds.hull or object).values()]
        arrays += [self.is_target, *vars(self.closed_arcs).values(), *([] if self.hull is None else self.hull.arrays())]
        return sum({id(array): array.nbytes for array in arrays if isinstance(array, np.ndarray)}.values())

    @property
    def outdated_hull(self) -> HullRepair | None:
        """Joint bounds that are not repaired yet for the present closed arcs; None if up to date or not in use."""
        closed_arcs = self.closed_arcs
        return (
            None
            if self.hull is None or self.hull.is_up_to_date(closed_arcs.closed, closed_arcs.turns > 0)
            else self.hull
        )

    def close(self, arcs: ArrayLike) -> None:
        """Close arcs, given by their indices (N,) in the graph: no path uses them until they are opened.

        Arcs that are closed already stay closed. Raises GraphError for an index that the graph does not have.
        """
        self._repair(raise_bounds, self.closed_arcs.set_closed(arcs, closed=True))

    def open(self, arcs: ArrayLike) -> None:
        """Open closed arcs again, given by their indices (N,) in the graph; arcs that are open stay open.

        Raises GraphError for an index that the graph does not have.
        """
        self._repair(lower_bounds_of_opened, self.closed_arcs.set_closed(arcs, closed=False))

    def _repair(self, kernel: Any, changed: IntArray) -> None:
        """Repair the bounds of all costs after arcs (a,) were closed or opened; ``kernel`` does so for one cost."""
        graph, clock, n = self.graph, Clock(UNLIMITED, None), self.graph.nodes
        if self._entering is None:
            self._entering = np.zeros(n + 2, np.int64), np.empty(graph.arcs, np.int32)
            clock.call(sort_by_head, graph.heads, *self._entering)
        tables = (graph.indptr, graph.heads, graph.costs, self.closed_arcs.tails)
        most = int(SHARE * n)

        def arguments(j: int) -> tuple[Any, ...]:
            piles = np.full(PILES, -1), np.empty(n, np.int32), np.empty(n, np.int32)
            kind = (j, graph.aggregates[j] == "max", self.closed_arcs.closed)
            bounds = self.bounds[j], self.onward[j], np.zeros(n, np.uint8)
            return (changed, tables, self._entering, *kind, *bounds, piles, np.empty(most, np.int32))

        repaired = clock.call_all(kernel, [arguments(j) for j in range(graph.criteria)])
        if failed := [j for j, is_repaired in enumerate(repaired) if not is_repaired]:
            bounds = costs_to_go(graph, self.targets, clock, self.closed_arcs.without_closed(), failed)
            self.bounds[failed], self.onward[failed] = bounds

    def break_ties(self, column: int) -> None:
        """Choose, among paths that are equally good in one cost, those that are also good in the others.

        For costs that are 0 on most arcs: a path that is least only in such a cost may be a detour through the whole
        graph. The path of this cost in :meth:`least_paths` becomes one with the least sum of the other costs, each
        divided by its largest bound; of parallel arcs, it may take any. Call this again after :meth:`close` and
        :meth:`open`, which choose among ties arbitrarily.
        """
        graph, h, tails = self.graph, self.bounds, self.closed_arcs.tails
        is_best = ~self.closed_arcs.closed & (h[column, tails] < UNREACHABLE)
        is_best &= h[column, tails] == graph.costs[:, column] + h[column, graph.heads]
        costs = np.ones((int(is_best.sum()), 1), np.int64)  # of equal sums, the path with the fewest arcs
        for j in (j for j, aggregate in enumerate(graph.aggregates) if j != column and aggregate == "sum"):
            largest = int(h[j].max(where=h[j] < UNREACHABLE, initial=1))
            costs[:, 0] += np.minimum(graph.costs[is_best, j] * (FINE / largest), DEAREST).astype(np.int64)
        first = np.concatenate([np.zeros(1, np.int64), np.cumsum(is_best)])[graph.indptr]
        best = Graph(first, graph.heads[is_best], costs, np.arange(len(costs), dtype=np.int32), ("sum",))
        clock = Clock(UNLIMITED, None)
        self.onward[column] = costs_to_go(best, self.targets, clock, Groups.single_nodes(best, clock))[1][0]

    def paths(
        self,
        source: Hashable,
        *,
        deadline: float | None = None,
        budget: Budget = UNLIMITED,
        progress: ProgressCallback | None = None,
        known: Sequence[IntArray] = (),
    ) -> ParetoPaths:
        """Find every non-dominated cost vector of the paths from a source to the targets, each with one path.

        No path uses a closed arc (:meth:`close`). The search ends after `deadline` seconds of this thread's processor
        time, when a limit of `budget` is reached, or at Ctrl-C. Then the paths found so far are returned, and `gap`
        bounds how much better missing ones may be. The deadline includes the computation of the result and the gap, but
        not the first compilation of kernels.

        `known` are paths from the source that the caller knows, such as the remaining parts of earlier results
        (:meth:`.ParetoPaths.suffixes`), given by the indices of their arcs in the graph. Those without closed arcs
        count as found from the beginning, as does the least path in each cost. So a deadline of 0 returns the
        non-dominated paths among them.

        Raises QueryError if the source is no node, and if a known path does not lead from it to a target.
        """
        start = checked_node(self.graph, source, "source")
        if deadline is not None:
            deadline = real("deadline", deadline, 0, MOST, "a number of seconds, 0 or more,")
        clock = DeadlineClock(deadline, budget, progress)
        paths = [*known, *self.least_paths(start)]
        open_paths = known_paths(self.graph, start, self.is_target, paths, self.closed_arcs.closed)
        run = PreparedRun(self, start, open_paths)
        try:
            status = run.go(clock)
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        return run.result(clock, status)

    def least_paths(self, source: int) -> list[IntArray]:
        """Return for each cost the path from a node that is least in it, as indices of arcs; [] if there is no path."""
        if self.bounds[0, source] >= UNREACHABLE:
            return []
        graph, clock, paths = self.graph, Clock(UNLIMITED, None), []
        arcs = np.empty(graph.nodes, np.int64)
        for j in range(graph.criteria):
            tables = (graph.indptr, graph.heads, graph.costs, j, self.closed_arcs.closed, self.onward[j])
            paths.append(arcs[: clock.call(least_path, *tables, source, arcs)].copy())
        return paths
