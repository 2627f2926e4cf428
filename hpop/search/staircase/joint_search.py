"""What joint bounds make of a staircase search: solutions to begin with, and corners of what is left uncovered.

See :mod:`.turn_hull` and :mod:`.corners`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.search.graph import Graph
from hpop.search.machinery.approximation import ANYTHING, Precision, thinned
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds
from hpop.search.machinery.covered import least_covered
from hpop.search.machinery.slices import N_EXPANDED, N_FRONT, N_GENERATED, Clock
from hpop.search.machinery.turns import Groups, NoRoom
from hpop.search.staircase.bucket_search import BucketSearch
from hpop.search.staircase.corners import Corners
from hpop.search.staircase.tables import H_FIRST, H_REST
from hpop.search.staircase.turn_hull import LANES, ROOM, IntLanes, JointBounds, TurnHull, directions, turn_hull

NEAR = 4  # the front on the ways found, and the bounds by turns, are as near as eps / NEAR
THIN = 3  # and the part of it that is kept covers it within eps / THIN


class JointSearch(BucketSearch):
    """A staircase search that may take joint bounds of its first and its rest cost.

    hull         the bounds that it took; None for none
    cornered     size of the front that their corners are of
    hull_paths   arcs of the solutions that no label led to
    closed_arcs  (m,) of the graph, which no path takes; None for none
    """

    graph: Graph
    source: int
    precision: Precision
    tolerance: IntArray
    at_most: tuple[int, ...]
    groups: Groups
    order: tuple[int, int, int]
    nodes: NDArray[Any]
    start: IntArray
    arcs: NDArray[Any]
    is_target: NDArray[np.uint8]
    looked_ahead: bool
    hull: JointBounds | None = None
    cornered: int = 0
    hull_paths: tuple[IntArray, ...] = ()
    closed_arcs: BoolArray | None = None

    @abstractmethod
    def _on(
        self, part: Graph, source: int, targets: IntArray, h: IntArray, groups: Groups, clock: Clock, near: Precision
    ) -> BucketSearch:
        """The same search on a part of the graph."""

    def _look_jointly(self, clock: Clock) -> bool:
        """Take joint bounds, and solutions to begin with; False where there are none, or no room for them."""
        limit = clock.budget.max_memory
        room = ROOM if limit is None else limit - self.memory()
        columns = (self.order[0], self.order[2])
        weights = directions((int(self.nodes[:, H_FIRST].max()), int(self.nodes[:, H_REST].max())))
        best = self.nodes[self.source, [H_FIRST, H_REST]]
        enough = best * (1 + self.precision.eps / NEAR) + self.tolerance[[0, 2]] // NEAR
        near = enough[0] * weights[0, 0], enough[1] * weights[1, 1]

        def is_enough(now: IntLanes) -> bool:
            return not (now[self.source, :2] > near).any()

        tables = (self.nodes, self.start, self.arcs)
        hull = turn_hull(self.groups, columns, weights, *tables, self.is_target, is_enough, room, clock)
        if hull is None:
            return False
        self.take_joint_bounds(hull, *self.front_along(hull, clock), clock)
        return True

    def front_along(self, hull: TurnHull, clock: Clock) -> tuple[IntArray, list[IntArray]]:
        """The front (n, 3) of the paths through the nodes that a hull's best ways pass, near enough, and their arcs."""
        columns = (self.order[0], self.order[2])
        passed = hull.passed(self.groups, columns, self.nodes, self.start, self.arcs, self.source, clock)
        return self._front_on(passed, clock)

    def take_joint_bounds(self, hull: TurnHull, costs: IntArray, paths: Sequence[IntArray], clock: Clock) -> None:
        """Begin with solutions (n, 3) that are known, and follow only what a hull and these cannot tell to be covered.

        costs  in the order of the search, rows in lexicographic order
        paths  n  places of their arcs
        """
        self.looked_ahead = True
        found = int(self.counters[N_FRONT])
        rows = thinned(costs, self.front[:found], self.precision.eps / THIN, self.tolerance // THIN)
        self.hull_paths = tuple(paths[row] for row in rows)
        self.front = np.concatenate([self.front[:found], costs[rows], np.zeros((64, 3), np.int64)])
        self.solutions = np.concatenate([self.solutions[:found], -1 - np.arange(len(rows)), np.zeros(64, np.int64)])
        self.counters[N_FRONT] += len(rows)
        ahead = self._covered(costs[rows])
        ahead = ahead[ahead[:, 0].argsort()]
        nothing = np.zeros((0, 0, LANES), np.int32), np.zeros(0, np.int64)
        reached, scratch = np.zeros(1, np.int64), np.zeros((2, LANES), np.int32)
        self._take_corners(JointBounds(hull.layers, hull.weights, *nothing, ahead, reached, scratch), clock)

    def _front_on(self, passed: IntArray, clock: Clock) -> tuple[IntArray, list[IntArray]]:
        """The front (n, 3) of the paths through some nodes alone, near enough, and their arcs."""
        nodes = np.sort(self.groups.nodes[passed])
        part = self.graph.among(nodes)
        if self.closed_arcs is not None:
            free = part.without(self.closed_arcs[part.arc])
            part = replace(free, arc=part.arc[free.arc])
        source = int(np.searchsorted(nodes, self.groups.nodes[self.source]))
        targets = np.flatnonzero(self.is_target[self.groups.place[nodes]])
        memory = self.memory()
        silent = clock.silent(int(self.counters[N_GENERATED]), memory)
        try:
            groups = Groups.of_column(part, self.order[1], silent) or Groups.none(part, silent)
        except NoRoom:
            return np.zeros((0, 3), np.int64), []
        h, _, _ = lower_bounds(part, source, targets, silent, groups)
        if not h.size or h[0, source] >= UNREACHABLE:  # no room, or steps are too coarse to tell ways apart
            return np.zeros((0, 3), np.int64), []
        near = Precision(self.precision.eps / NEAR, tuple(t // NEAR for t in self.precision.tolerance))
        search = self._on(part, source, targets, h, groups, silent, near)
        search.run(silent)
        costs, labels, generated, expanded, _ = search.found()
        self.counters[N_GENERATED] += generated
        self.counters[N_EXPANDED] += expanded
        hull_paths = [part.arc[path].astype(np.int64) for path in search.paths(labels, silent)]
        clock.compiled += silent.compiled
        clock.peak = max(clock.peak, memory + silent.peak)
        return costs, hull_paths

    def _covered(self, costs: IntArray) -> IntArray:
        """The least estimates (n, 3) that costs cover."""
        eps, tolerance = float(self.precision.eps), self.tolerance.tolist()
        table = [[least_covered(c, eps, t) for c, t in zip(row, tolerance, strict=True)] for row in costs.tolist()]
        return np.array(table, np.int64).reshape(-1, 3)

    def _take_corners(self, hull: JointBounds, clock: Clock) -> None:
        """Tell the kernel what the front leaves uncovered, within what no solution may exceed."""
        self.cornered = int(self.counters[N_FRONT])
        covered = self._covered(self.front[: self.cornered])
        if self.at_most:
            beyond = np.diag([self.at_most[j] + 1 for j in self.order])
            covered = np.concatenate([covered, beyond[beyond.max(axis=1) <= ANYTHING]])
        corners = Corners.of(covered, hull.weights, clock)
        self.hull = hull._replace(corners=corners.values, last=corners.last)
