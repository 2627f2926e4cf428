"""The main function of exact search: all non-dominated cost vectors from a source to targets, with one path each."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import IntArray
from hpop.base.text import shown
from hpop.errors import OptionError
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.search import general, machinery, staircase, supported
from hpop.search.graph import Graph
from hpop.search.lazy_paths import Free, LazyRun
from hpop.search.machinery import EXACT, Precision, proven_gap
from hpop.search.machinery.checkpoint import CheckpointSpec, Keeper
from hpop.search.queries import (
    UNLIMITED,
    ParetoPaths,
    SearchStats,
    bounds_of,
    checked_node,
    checked_targets,
    precision_of,
    query_text,
)
from hpop.search.staircase import choose_method, choose_order

if TYPE_CHECKING:
    import networkx as nx

    from hpop.search.general.search import General
    from hpop.search.machinery.slices import Clock
    from hpop.search.machinery.turns import Groups
    from hpop.search.staircase.search import Staircase


LARGE = 30_000_000  # arcs of a graph that is searched in a corridor


@dataclass(frozen=True, eq=False)
class SearchQuery:
    """Query of a search: the front of the paths of a graph from a source to any of some targets.

    source     number of a node
    targets    (t,)  numbers of nodes
    precision  error that the front may have
    at_most    (k,)  upper bounds on the costs of a path; empty if there are none
    """

    graph: Graph
    source: int
    targets: IntArray
    precision: Precision = EXACT
    at_most: tuple[int, ...] = ()

    def search(
        self, method: str, order: tuple[int, ...], h: IntArray, groups: Groups, clock: Clock, *, jointly: bool
    ) -> General | Staircase:
        """Return a new search for this query; raise TooWide if the costs do not fit the tables of "staircase".

        method   "staircase" or "general"
        order    columns of the costs in the order of the search, of :func:`choose_order`
        h        (k, n)  lower bounds of the remaining costs of each node
        groups   groups of nodes joined by turns; for "staircase" turns must raise the index cost, or pass single nodes
        jointly  whether the search may use bounds of several costs together, which are tighter
        """
        if method == "staircase":
            return self.staircase(order, h, groups, clock, jointly=jointly)
        ends = self.graph, self.source, self.targets
        return general.search.General(*ends, h, order, groups, clock, self.precision, self.at_most)

    def staircase(
        self, order: tuple[int, ...], h: IntArray, groups: Groups, clock: Clock, *, jointly: bool
    ) -> Staircase:
        """Return a new search by the method "staircase", see :meth:`search`."""
        ends = self.graph, self.source, self.targets
        three = (order[0], order[1], order[2] if len(order) > 2 else -1)
        return staircase.search.Staircase(*ends, h, three, groups, clock, self.precision, self.at_most, jointly=jointly)


METHODS = ("auto", "staircase", "general")
MOST_COMPARED = 500_000  # costs of open labels; the gap to so many is computed within a tenth of a second


@checked_arguments
def pareto_paths(
    graph: Graph | nx.Graph[Any],
    source: Hashable,
    target: Hashable | Iterable[Hashable],
    *,
    costs: Sequence[str] | None = None,
    quanta: Mapping[str, float] | Sequence[float] | None = None,
    aggregates: Sequence[str] | None = None,
    budget: Budget = UNLIMITED,
    progress: ProgressCallback | None = None,
    method: str = "auto",
    eps: float = 0.0,
    tolerance: Sequence[int] | Mapping[str, float] = (),
    at_most: Sequence[int | None] | Mapping[str, float] = (),
    checkpoint: CheckpointSpec | None = None,
    free: Free | None = None,
) -> ParetoPaths:
    """Return every non-dominated cost vector of the paths from source to target, each with one path.

    A vector is dominated if another one is at most as large in every cost. Of paths with equal vectors, one is
    returned. With several targets, a path may end at any of them, and all paths compete in one front. A path without
    arcs costs 0.

    Accepts: any :class:`Graph` with 1 to 6 costs, each a sum or a maximum; source and targets are labels if the graph
    has labels, else numbers. Or a networkx graph, directed or not, also with parallel edges: `costs` then names the
    attributes to minimise, and `quanta` and `aggregates` are those of :meth:`.Graph.from_networkx`. Costs with
    fractions are rounded up to quanta, edge by edge; see :attr:`.ParetoPaths.values`.

    Guarantees: exact in integers. With `eps` or `tolerance` (whole numbers, one for each cost), every non-dominated
    vector p is covered by a returned one, r <= (1 + eps) p + tolerance, which need not be non-dominated itself. If a
    limit of `budget` or Ctrl-C stops the search, the vectors found by then are returned, and `gap` says how much better
    missing ones may be. With `at_most` (a bound or None for each cost), all this holds for the paths within the bounds.

    Cost: `method` "staircase" (:mod:`.staircase.search`) needs two or three costs, one of them a sum of small integers;
    "general" (:mod:`.general.search`) takes all graphs. "auto" takes "staircase" for three costs if one of them counts
    turns in groups of nodes (:mod:`.machinery.turns`), or if the table of all staircases is small (:mod:`.staircase`).
    The order in which costs are compared is always chosen.

    `checkpoint` is a file, or a :class:`.Checkpoint`, in which the search saves its state. The same query with the same
    file resumes the search after a limit, Ctrl-C or kill -9, with the same result as without the stop. A time limit
    begins again, a limit of labels does not. A complete search leaves the file: remove it when the front is saved.
    Raises CheckpointError for a file that is damaged, of another query or of another version of hpop. Resume only
    from files that you trust: :mod:`.checkpoint`.

    `free` is a function that takes indices (N,) of arcs in the graph, and returns which of these arcs are free. All
    this then holds for the graph without its blocked arcs. Only arcs on paths of a front are checked, each at most once
    (:mod:`.lazy_paths`). Limits hold for all rounds together. All returned paths are free, also after a limit. After a
    resume this relies on the file, and different arcs may have been checked.

    >>> graph = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 5], [1, 5], [9, 1]])
    >>> paths = pareto_paths(graph, 0, 2)
    >>> paths.costs.tolist(), paths.nodes(0).tolist(), paths.arcs(1).tolist()
    ([[2, 10], [9, 1]], [0, 1, 2], [2])

    >>> import networkx as nx
    >>> g = nx.Graph()
    >>> g.add_edge("hall", "stairs", length=4.5, risk=0.2)
    >>> g.add_edge("stairs", "room", length=3.5, risk=0.0)
    >>> g.add_edge("hall", "room", length=12.25, risk=0.1)
    >>> paths = pareto_paths(g, "hall", "room", costs=["length", "risk"])
    >>> paths.values.tolist(), paths.path(0)
    ([[8.0, 0.2], [12.25, 0.1]], ['hall', 'stairs', 'room'])
    """
    if not isinstance(method, str) or method not in METHODS:
        raise OptionError(f"method must be one of {', '.join(METHODS)}, got {shown(method)}")
    graph = _converted(graph, costs, quanta, aggregates)
    start, targets = checked_node(graph, source, "source"), checked_targets(graph, target)
    precision = precision_of(graph, eps, tolerance)
    bounds = bounds_of(graph, at_most)
    options = (float(precision.eps), precision.of(range(graph.criteria)), np.array(bounds, np.int64))
    keeper = Keeper.of(checkpoint, graph, start, targets, method, *options, *["lazily"][: free is not None])

    def search(part: Graph, left: Budget) -> ParetoPaths:
        run = _ParetoRun(part, start, targets, method, precision, bounds, keeper)
        return _result(run, machinery.slices.Clock(left, progress))

    if free is None:
        found = None
        if graph.arcs >= LARGE and not (precision.is_exact or len(bounds) or keeper or method == "general"):
            from hpop.search.corridor import search_in_corridor  # importing numba takes half a second

            clock = machinery.slices.Clock(budget, progress)
            found = search_in_corridor(graph, start, targets, precision, _search_part, clock)
        return search(graph, budget) if found is None else found
    return LazyRun(graph, free, search, budget, progress, keeper, precision.of(range(graph.criteria))).go()


def _search_part(graph: Graph, source: int, targets: IntArray, precision: Precision, clock: Clock) -> ParetoPaths:
    """Search a part of a large graph, see :mod:`.corridor`."""
    return _result(_ParetoRun(graph, source, targets, "auto", precision, (), None), clock)


def _result(run: _ParetoRun, clock: Clock) -> ParetoPaths:
    """Run a query and return its result, also after Ctrl-C."""
    try:
        status = run.go(clock)
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    try:
        return run.result(clock, status)
    except KeyboardInterrupt:  # a second one skips the gap
        return run.result(clock, Status.INTERRUPTED, proven=False)


class _ParetoRun:
    """One run of a query: it computes lower bounds, chooses the method and the order of costs, and searches.

    search        the search, None before it is set up
    samples       (k, k) costs of the path that is best for each cost; (0, k) before they are known
    after_bounds  s   time at which the lower bounds were complete
    """

    def __init__(
        self,
        graph: Graph,
        source: int,
        targets: IntArray,
        method: str,
        precision: Precision,
        at_most: tuple[int, ...],
        keeper: Keeper | None,
    ) -> None:
        self.graph, self.source, self.targets, self.precision = graph, source, targets, precision
        self.at_most = at_most
        self.keeper = keeper
        self.method = method if keeper is None else keeper.method or method
        self.search: General | Staircase | None = None
        self.order: tuple[int, ...] = ()
        self.samples = np.zeros((0, graph.criteria), np.int64)
        self.after_bounds = 0.0

    def go(self, clock: Clock) -> Status:
        """Run the query and return its status; the paths are in ``search``."""
        prepared = self._prepare(clock)
        if isinstance(prepared, Status):
            return prepared
        self.search = prepared
        try:
            return prepared.run(clock) if self.keeper is None else self.keeper.run(prepared, self.method, clock)
        except staircase.tables.TooWide:
            self.method = "general"
            return self.go(clock)

    def _prepare(self, clock: Clock) -> General | Staircase | Status:
        """Compute bounds and choose the method; return the new search, or the status if the query ends before it."""
        try:
            groups = machinery.turns.Groups.of(self.graph, clock, has_arcs=False)
        except machinery.turns.NoRoom:
            return Status.MEMORY_LIMIT
        h, samples, status = machinery.plain_bounds.plain_bounds(self.graph, self.source, self.targets, clock, groups)
        self.after_bounds = clock.seconds()
        if status is not None:
            return status
        self.samples = samples
        self.method, index = choose_method(self.graph, self.method, samples, groups)
        if h[0, self.source] >= machinery.bounds.UNREACHABLE:
            return Status.NO_PATH
        query = SearchQuery(self.graph, self.source, self.targets, self.precision, self.at_most)
        costs = samples, h[:, self.source]
        self.order = choose_order(self.graph, self.method, index, *costs, groups)
        if self.method == "staircase":
            if groups.column != index:
                groups = machinery.turns.Groups.single_nodes(self.graph, clock)
            try:
                return query.search("staircase", self.order, h, groups, clock, jointly=self.keeper is None)
            except staircase.tables.TooWide:
                self.method, self.order = "general", choose_order(self.graph, "general", index, *costs, groups)
        return query.search(self.method, self.order, h, groups, clock, jointly=False)

    def result(self, clock: Clock, status: Status, *, proven: bool = True) -> ParetoPaths:
        """Return the paths found so far, with statistics and, if a limit stopped the search, the gap to missing paths.

        The gap takes seconds for millions of open labels. After Ctrl-C it is computed only if that is quick; if
        ``proven`` is False, it is not computed (inf).
        """
        k = self.graph.criteria
        costs = np.zeros((0, k), np.int64)
        paths: tuple[IntArray, ...] = ()
        counts: dict[str, Any] = {}
        end = clock.seconds()
        if self.search is not None:
            vectors, labels, generated, expanded, waiting = self.search.results()
            costs = np.empty((len(vectors), k), np.int64)
            costs[:, list(self.order)] = vectors[:, : len(self.order)]
            rows = np.lexsort(costs.T[::-1])
            costs = costs[rows]
            paths = tuple(self.search.paths(labels[rows], clock))
            counts = {"labels_generated": generated, "labels_expanded": expanded, "labels_open": waiting}
        costs.setflags(write=False)
        gap = self.precision.eps
        if not status.is_final:
            gap = math.inf
            awaited = status is not Status.INTERRUPTED or counts.get("labels_open", 0) * k <= MOST_COMPARED
            if proven and awaited and self.search is not None:
                estimates, least = self.search.estimates(), self.samples[:, list(self.order)]
                gap = proven_gap(vectors[:, :k], estimates[:, :k])
                if gap > self.precision.eps:
                    gap = self.search.closer_gap(vectors, gap, estimates, least, clock)
                gap = max(self.precision.eps, gap)
        stats = SearchStats(
            self.method,
            self.order,
            peak_memory=clock.peak,
            seconds_bounds=self.after_bounds,
            seconds_search=end - self.after_bounds,
            seconds_compiled=clock.compiled,
            **counts,
        )
        asked = query_text(self.graph, self.precision, self.at_most)
        if status is Status.NO_PATH and self.at_most and self.samples.size:  # there are paths, beyond the bounds
            lowest = tuple(map(int, self.samples.diagonal()))
            asked += query_text(self.graph, EXACT, lowest).replace(" of at most", "; each path has at least")
        return ParetoPaths(costs, status, stats, self.graph, self.source, paths, gap=gap, asked=asked)


def _converted(graph: Any, costs: Any, quanta: Any, aggregates: Any) -> Graph:
    """Return the graph to search: a Graph as it is, or a networkx graph converted with the given options."""
    if isinstance(graph, Graph):
        if costs is not None or quanta is not None or aggregates is not None:
            raise OptionError(
                "costs, quanta and aggregates are only for networkx graphs, but graph is a Graph; leave them out"
            )
        return graph
    return Graph.from_networkx(graph, () if costs is None else costs, quanta=quanta, aggregates=aggregates)


def main_kernels(aggregates: Sequence[str], turns: int) -> tuple[Any, Any]:
    """Return the main kernel of a search with costs of these kinds, and the kernel of its quick early result.

    The main kernel takes longest to compile. The other one is that of weighted sums, or the main kernel again if a
    cost is a maximum.

    aggregates  "sum" or "max" for each cost
    turns       column of the cost that counts turns, or -1
    """
    is_staircase = turns >= 0 and len(aggregates) == 3
    advance = staircase.kernel.advance if is_staircase else general.kernel.advance
    return advance, advance if "max" in aggregates else supported.weighted_path.weighted_path
