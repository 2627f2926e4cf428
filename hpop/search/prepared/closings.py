"""Which arcs are closed, and what that means to the groups that turns make."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arrays import IntArray
from hpop.base.text import shown
from hpop.errors import GraphError
from hpop.search.general.search import General
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import Clock, Search
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups
from hpop.search.queries import UNLIMITED
from hpop.search.staircase.search import Staircase


class Closings:
    """Closed arcs of a graph whose turns make groups; the turns of `groups` are changed with them.

    closed  (m,)  which arcs are
    """

    def __init__(self, graph: Graph, groups: Groups) -> None:
        self.graph, self.whole = graph, groups
        self.closed = np.zeros(graph.arcs, np.bool_)
        self.turns = np.zeros(len(groups.rows), np.int64)  # how many of each group are closed

    @property
    def groups(self) -> Groups:
        """The groups in force: each node on its own where some turns of a group are closed and others are not."""
        several = self.whole.rows[:, SIZE] * (self.whole.rows[:, SIZE] - 1)
        return self._apart if ((self.turns > 0) & (self.turns < several)).any() else self.whole

    def without_closed(self) -> Groups:
        """The groups in force without what is closed: arcs that are no turns, and the turns of whole groups."""
        groups, still = self.groups, self.turns > 0
        free = ~self.closed[groups.origin]
        start = np.concatenate([np.zeros(1, np.int64), np.cumsum(free)])[groups.start]
        dearest = groups.dearest
        if groups is self.whole and still.any():
            dearest = np.where(still[:, None], UNREACHABLE, dearest)
        heads, origin = groups.heads[free], groups.origin[free]
        return replace(groups, dearest=dearest, start=start, heads=heads, origin=origin)

    @cached_property
    def _apart(self) -> Groups:
        return Groups.none(self.graph, Clock(UNLIMITED, None))

    @cached_property
    def tails(self) -> NDArray[np.int32]:
        """Where arcs (m,) begin."""
        return np.repeat(np.arange(self.graph.nodes, dtype=np.int32), np.diff(self.graph.indptr))

    def turned(self, arcs: ArrayLike, closed: bool) -> IntArray:
        """Close arcs, or open them, by their places (N,); returns those that were not so before."""
        places = self._places(arcs)
        places = np.compress(self.closed[places] != closed, places)
        self.closed[places] = closed
        self._count_turns(places, 1 if closed else -1)
        return places

    def _places(self, arcs: ArrayLike) -> IntArray:
        places = np.asarray(arcs)
        if not places.size:
            return np.zeros(0, np.int64)
        if places.ndim != 1 or places.dtype.kind not in "iu":
            raise GraphError(
                f"arcs are closed and opened by their places in the graph, (N,) integers; got {shown(arcs)}"
            )
        if places.min() < 0 or places.max() >= self.graph.arcs:
            raise GraphError(f"places of arcs are 0 to {self.graph.arcs - 1}; got {places.min()} to {places.max()}")
        unique: IntArray = np.unique(places.astype(np.int64))
        return unique

    def _count_turns(self, arcs: IntArray, by: int) -> None:
        """Count the turns of groups among arcs, and price the turns of groups anew that have none left, or all."""
        groups = self.whole
        if groups.column < 0:
            return
        tails, heads = groups.place[self.tails[arcs]], groups.place[self.graph.heads[arcs]]
        within = self._group[tails] == self._group[heads]
        turning = within & (tails != heads) & (self.graph.costs[arcs, groups.column] > 0)
        tails, heads, arcs = tails[turning], heads[turning], arcs[turning]
        np.add.at(self.turns, self._group[tails], by)
        if groups.alike.all():
            return
        rows = groups.rows[self._group[tails]]
        place = rows[:, TURNS] + (tails - rows[:, OFFSET]) * rows[:, SIZE] + heads - rows[:, OFFSET]
        groups.turns[:, place] = UNREACHABLE if by > 0 else self.graph.costs[arcs].T

    @cached_property
    def _group(self) -> NDArray[np.int32]:
        """The group (n,) of each node, by the numbers of the groups."""
        return np.repeat(np.arange(len(self.whole.rows), dtype=np.int32), self.whole.rows[:, SIZE])

    def mask(self, search: Search) -> None:
        """Let a search that was set up take no arc that is closed."""
        if isinstance(search, General):
            search.close(self.closed)
        elif isinstance(search, Staircase):
            still = self.turns > 0 if search.groups is self.whole else np.zeros(len(search.group_table), np.bool_)
            search.close(self.closed, still)
