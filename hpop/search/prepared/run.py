"""One search of a prepared graph: set up from what is kept, ended in time, answered together with what was known.

Most questions of a drive are small: the exact search answers them in milliseconds. Where it has spent a part of its
limits and is not done, a search within a precision comes in between. Joint bounds that are kept are made right for what
is closed now, as far as there is time; with them, and all that is known to begin with, it needs some thousands of
labels, and proves a gap that the exact search, which goes by its first cost, would prove at its end. Then that goes on.
On small graphs joint bounds are not made right: where anything is closed, all the time is the exact search's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray
from hpop.frontier import is_nondominated
from hpop.runtime.status import Status
from hpop.search.machinery.approximation import Precision
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.deadline import Deadline
from hpop.search.machinery.gap import proven_gap
from hpop.search.machinery.slices import N_GENERATED, Search
from hpop.search.methods import Question
from hpop.search.prepared.known import KnownPaths
from hpop.search.queries import ParetoPaths, SearchStats
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import TooWide

if TYPE_CHECKING:
    from hpop.search.prepared.prepared import Prepared

FIRST, SECOND = 0.4, 0.7  # of all limits: a search within a precision comes in between
SOON, REPAIRED, LATE = 0.15, 0.55, 0.95  # where it waits until joint bounds are those of what is closed now
GAP = 0.1  # its precision, relative
AHEAD = 150e-9  # s a node that it takes before its first label


class PreparedRun:
    """One question: from a source to the targets, with some paths known."""

    def __init__(self, prepared: Prepared, source: int, known: KnownPaths) -> None:
        self.prepared, self.source, self.known = prepared, source, known
        self.exact: Search | None = None
        self.near: Staircase | None = None
        self.is_near = False  # whether the search within a precision is complete
        self.method, self.order = prepared.plans[0]

    def go(self, clock: Deadline) -> Status:
        """Search until all is found, or time is up."""
        if self.prepared.bounds[0, self.source] >= UNREACHABLE:
            return Status.NO_PATH
        status = clock.exceeded(0, 0)
        if status is not None:
            return status
        try:
            return self._go(clock)
        except TooWide:
            self.exact, (self.method, self.order) = None, self.prepared.plans[1]
            return self._go(clock)

    def _go(self, clock: Deadline) -> Status:
        prepared = self.prepared
        question = Question(prepared.graph, self.source, prepared.targets)
        groups = prepared.closings.groups
        search = question.search(self.method, self.order, prepared.bounds, groups, clock, jointly=False)
        prepared.closings.mask(search)
        self.exact = search
        outlook, in_groups = prepared.outlook, groups is prepared.closings.whole
        if isinstance(search, Staircase) and in_groups and outlook.layers is not None:
            search.take_turn_bounds(outlook.layers.astype(search.dtype, copy=False))
        is_right = prepared.hull is not None or not prepared.closings.closed.any()
        if isinstance(search, Staircase) and in_groups and outlook.hull and is_right and clock.is_limited:
            clock.share = SOON if prepared.outdated else FIRST
            status = search.run(clock)
            if status not in (Status.TIME_LIMIT, Status.LABEL_LIMIT):
                return status
            self._go_near(search, clock)
            clock.share = 1.0
        return search.run(clock)

    def _go_near(self, exact: Staircase, clock: Deadline) -> None:
        """Search within a precision, with joint bounds and all that is found and known to begin with."""
        prepared, outlook = self.prepared, self.prepared.outlook
        graph, groups, hull = prepared.graph, prepared.closings.whole, outlook.hull
        h = outlook.h.copy()
        turns = prepared.bounds[self.order[1]]  # joint bounds do not build on this one
        np.copyto(h[self.order[1]], turns, where=turns < UNREACHABLE)
        clock.share = SECOND
        if (outdated := prepared.outdated) is not None:
            clock.share = REPAIRED
            outdated.close(prepared.closings.closed, prepared.closings.turns > 0, clock)
            clock.share = LATE
        if hull is None or clock.left < AHEAD * graph.nodes:
            return
        clock.labels, clock.memory = int(exact.counters[N_GENERATED]), exact.memory()
        question = Question(graph, self.source, prepared.targets, Precision(GAP))
        try:
            search = question.search("staircase", self.order, h, groups, clock, jointly=True)
            assert isinstance(search, Staircase)
            prepared.closings.mask(search)
            along, ways = search.front_along(hull, clock)
            found, labels, *_ = exact.found()
            costs = np.concatenate([self.known.costs[:, list(self.order)], found, along])
            paths = [*self.known.paths, *exact.paths(labels, clock), *ways]
            rows = _best(costs)
            search.take_joint_bounds(hull, costs[rows], [paths[row] for row in rows], clock)
            self.near = search
            self.is_near = search.run(clock) is Status.COMPLETE
        except TooWide:
            self.near = None
        clock.labels = 0 if self.near is None else int(self.near.counters[N_GENERATED])
        clock.memory = 0 if self.near is None else self.near.memory()

    def result(self, clock: Deadline, status: Status) -> ParetoPaths:
        """What was found and what was known, together, and how much better others may be."""
        graph = self.prepared.graph
        costs, paths = self.known
        generated = expanded = waiting = 0
        for search in (self.near, self.exact):
            if search is not None:
                found, labels, made, followed, waiting = search.found()
                costs = np.concatenate([self._in_columns(found), costs])
                paths = (*search.paths(labels, clock), *paths)
                generated, expanded = generated + made, expanded + followed
        rows = _best(costs)
        costs = costs[rows]
        costs.setflags(write=False)
        gap = 0.0 if status.is_final else self._gap(costs)
        stats = SearchStats(
            self.method,
            self.order,
            labels_generated=generated,
            labels_expanded=expanded,
            labels_open=waiting,
            peak_memory=sum(self._beside(search) for search in (self.near, self.exact) if search is not None),
            seconds_search=clock.seconds(),
            seconds_compiled=clock.compiled,
        )
        return ParetoPaths(costs, status, stats, graph, self.source, tuple(paths[row] for row in rows), gap=gap)

    def _beside(self, search: Search) -> int:
        """Bytes that a search holds beside what is kept for all."""
        outlook, groups = self.prepared.outlook, self.prepared.closings.whole
        kept = [outlook.layers, *vars(groups).values(), *vars(outlook.hull or object).values()]
        places = {array.__array_interface__["data"][0] for array in kept if isinstance(array, np.ndarray)}
        arrays = search.arrays()
        return sum(array.nbytes for array in arrays if array.__array_interface__["data"][0] not in places)

    def _gap(self, costs: IntArray) -> float:
        """The least gap that any search proves of what is returned (n, k)."""
        if self.exact is None:
            return proven_gap(costs, self.prepared.bounds[:, self.source][None], math.inf)
        gap = GAP if self.is_near else math.inf
        if self.near is not None and not self.is_near:
            gap = max(GAP, proven_gap(costs, self._in_columns(self.near.estimates()), gap))
        return min(gap, proven_gap(costs, self._in_columns(self.exact.estimates()), gap))

    def _in_columns(self, table: IntArray) -> IntArray:
        """A table (n, k) in the order of the search, in the caller's columns."""
        columns: IntArray = np.empty((len(table), len(self.order)), np.int64)
        columns[:, list(self.order)] = table[:, : len(self.order)]
        return columns


def _best(costs: IntArray) -> IntArray:
    """The rows of non-dominated costs (n, k), in lexicographic order."""
    rows: IntArray = np.lexsort(costs.T[::-1])
    return rows[is_nondominated(costs[rows].astype(np.float64))] if len(rows) else rows
