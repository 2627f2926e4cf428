"""A graph made ready for one set of targets: groups and bounds are made once, closed arcs are masked.

A drive asks the same question again and again, from node after node, while doors close and open. What takes most of the
time of a small question does not change then: the groups that turns make, and lower bounds of the costs-to-go, which do
not depend on the source. Nor does a closed arc need another graph. In the tables of a search it costs more than any
solution, or leads back to where it begins, so kernels stay what they are; and bounds stay consistent, only weaker. When
arcs open again the bounds are repaired (:mod:`.repair`).

All turns of a group can be closed together. Where only some of them are, a path may need two turns in a row, which
groups rule out: then the search does without groups until they are open again. That is exact, and slower.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.arrays import BoolArray, IntArray
from hpop.options import MOST, real
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import PILES, UNREACHABLE, costs_to_go
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from hpop.search.prepared.closings import Closings
from hpop.search.prepared.deadline import Deadline
from hpop.search.prepared.known import known_paths
from hpop.search.prepared.repair import is_reached, lower_bounds_from, sort_by_head
from hpop.search.prepared.run import PreparedRun
from hpop.search.queries import UNLIMITED, ParetoPaths, checked_graph, checked_node, checked_targets
from hpop.status import Budget, ProgressCallback, Status


class Prepared:
    """A graph ready to be searched from any node to the same targets, again and again.

    bounds  (k, n)  lower bounds of the costs-to-go, consistent on the arcs that are open
    onward  (k, n)  next node on a way of that cost while all arcs were open, -1 for none

    Accepts: any :class:`Graph`, 1 to 6 costs, each a sum or a maximum.

    Guarantees: :meth:`paths` is what :func:`pareto_paths` finds on the graph without the arcs that are closed.

    Cost: groups and bounds once. A search then takes the time of its labels alone, after closings up to twice as many
    as with bounds made anew.

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
        self.graph = checked_graph(graph)
        self.targets = checked_targets(graph, target)
        self.is_target = np.zeros(graph.nodes, np.bool_)
        self.is_target[self.targets] = True
        clock = Clock(UNLIMITED, progress)
        clock.report("bounds")
        groups = Groups.of(graph, clock)
        self.bounds, self.onward = costs_to_go(graph, self.targets, clock, groups)
        self.closings = Closings(graph, groups)
        self._entering: tuple[IntArray, NDArray[np.int32]] | None = None

    @property
    def closed(self) -> BoolArray:
        """Which arcs (m,) are closed; a copy."""
        return self.closings.closed.copy()

    def close(self, arcs: ArrayLike) -> None:
        """Let no path take these arcs, by their places (N,) in the graph, until they are opened."""
        self.closings.turned(arcs, closed=True)

    def open(self, arcs: ArrayLike) -> None:
        """Let paths take these arcs again, by their places (N,) in the graph; the bounds are repaired."""
        opened = self.closings.turned(arcs, closed=False)
        graph, clock, n = self.graph, Clock(UNLIMITED, None), self.graph.nodes
        if self._entering is None:
            self._entering = np.zeros(n + 2, np.int64), np.empty(graph.arcs, np.int32)
            clock.call(sort_by_head, graph.heads, *self._entering)
        arrays = (*self._entering, self.closings.tails, graph.heads, graph.costs)
        for j, aggregate in enumerate(graph.aggregates):
            scratch = np.zeros(n, np.uint8), np.full(PILES, -1), np.empty(n, np.int32), np.empty(n, np.int32)
            tables = (*arrays, j, aggregate == "max", self.closings.closed)
            clock.call(lower_bounds_from, opened, *tables, self.bounds[j], self.onward[j], *scratch)

    def paths(
        self,
        source: Hashable,
        *,
        deadline: float | None = None,
        budget: Budget = UNLIMITED,
        progress: ProgressCallback | None = None,
        known: Sequence[IntArray] = (),
    ) -> ParetoPaths:
        """Find every non-dominated cost vector of the open paths from a source to the targets, each with one path.

        With a `deadline`, in seconds of this thread's processor time, a limit of `budget`, or Ctrl-C it may end before:
        what is returned is what was found until then, and `gap` says how much better others may be. Slices are so short
        that a deadline is kept, answer and gap included; to compile kernels, once, does not count.

        `known` are paths from the source, by the places of their arcs in the graph, such as
        :meth:`.ParetoPaths.suffixes`. Those of which no arc is closed are there even after a deadline of 0, and the gap
        is that of what was found and what was known together.

        Raises QueryError for a source that is no node, and for a known path that does not lead from it to a target.
        """
        start = checked_node(self.graph, source, "source")
        if deadline is not None:
            deadline = real("deadline", deadline, 0, MOST, "a number of seconds, 0 or more,")
        clock = Deadline(deadline, budget, progress)
        sooner = known_paths(self.graph, start, self.is_target, known, self.closings.closed)
        run = PreparedRun(self, start, sooner)
        try:
            status = run.go(clock)
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        return run.result(clock, status)

    def is_reached(self, source: int, clock: Clock) -> bool:
        """Whether any target is reached from a node by arcs that are open."""
        if self.bounds[0, source] >= UNREACHABLE:
            return False
        if not self.closings.closed.any():
            return True
        graph = self.graph
        room = np.zeros(graph.nodes, np.uint8), np.empty(graph.nodes, np.int32)
        tables = (graph.indptr, graph.heads, self.closings.closed, self.bounds[0], self.is_target.view(np.uint8))
        return bool(clock.call(is_reached, *tables, source, *room))
