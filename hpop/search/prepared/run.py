"""One search of a prepared graph: set up from what is kept, ended in time, answered together with what was known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.frontier import is_nondominated
from hpop.search.machinery.bounds import UNREACHABLE, costs_of_least
from hpop.search.machinery.slices import Search
from hpop.search.methods import Question, chosen_method
from hpop.search.prepared.deadline import Deadline
from hpop.search.prepared.gap import proven_gap
from hpop.search.prepared.known import KnownPaths
from hpop.search.queries import ParetoPaths, SearchStats
from hpop.search.staircase.tables import TooWide
from hpop.status import Status

if TYPE_CHECKING:
    from hpop.search.prepared.prepared import Prepared


class PreparedRun:
    """One question: from a source to the targets, with some paths known."""

    def __init__(self, prepared: Prepared, source: int, known: KnownPaths) -> None:
        self.prepared, self.source, self.known = prepared, source, known
        self.search: Search | None = None
        self.method = "auto"
        self.order: tuple[int, ...] = ()

    def go(self, clock: Deadline) -> Status:
        """Search until all is found, or time is up."""
        prepared = self.prepared
        if prepared.bounds[0, self.source] >= UNREACHABLE:
            return Status.NO_PATH
        status = clock.exceeded(0, 0)
        if status is not None:
            return status
        graph, h = prepared.graph, prepared.bounds
        samples = costs_of_least(graph, self.source, h, prepared.onward, clock)
        method, index = chosen_method(graph, self.method, samples)
        question = Question(graph, self.source, prepared.targets)
        groups = prepared.closings.groups
        self.search, self.method, self.order = question.search(method, index, h, samples, groups, clock, jointly=False)
        prepared.closings.mask(self.search)
        try:
            return self.search.run(clock)
        except TooWide:
            self.search, self.method = None, "general"
            return self.go(clock)

    def result(self, clock: Deadline, status: Status) -> ParetoPaths:
        """What was found and what was known, together, and how much better others may be."""
        k, graph = self.prepared.graph.criteria, self.prepared.graph
        costs, paths = self.known
        missing = self.prepared.bounds[:, self.source][None]  # (m, k)  lower bounds of what may be missing
        counts: dict[str, Any] = {}
        end = clock.seconds()
        if self.search is not None:
            found, labels, generated, expanded, waiting = self.search.found()
            counts = {"labels_generated": generated, "labels_expanded": expanded, "labels_open": waiting}
            own = np.empty((len(found), k), np.int64)
            own[:, list(self.order)] = found[:, :k]
            costs = np.concatenate([own, costs])
            paths = (*self.search.paths(labels, clock), *paths)
            if not status.is_final:
                missing = np.empty((waiting, k), np.int64)
                missing[:, list(self.order)] = self.search.estimates()[:, :k]
        rows = np.lexsort(costs.T[::-1])
        rows = rows[is_nondominated(costs[rows].astype(np.float64))] if len(rows) else rows
        costs = costs[rows]
        costs.setflags(write=False)
        gap = 0.0 if status.is_final else proven_gap(costs, missing) if len(costs) else math.inf
        stats = SearchStats(
            self.method,
            self.order,
            peak_memory=clock.peak,
            seconds_search=end,
            seconds_compiled=clock.compiled,
            **counts,
        )
        return ParetoPaths(costs, status, stats, graph, self.source, tuple(paths[row] for row in rows), gap=gap)
