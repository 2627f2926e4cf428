"""Which arcs of a graph are free, asked one after another, no more than tell which paths are free all along.

A path with a blocked arc is of no use whatever its others are, so of each path one arc is asked about at a time, until
one is blocked: first about the one whose ends have had the largest shares of blocked arcs. Such a choice is an edge
selector of LazySP (Dellin and Srinivasa 2016, arXiv 1603.03490), here for many paths at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, distinct
from hpop.search.graph import Graph

UNKNOWN, FREE, BLOCKED = range(3)
AT_ONCE = 1024  # most arcs asked about between two looks at the clock

Free = Callable[[IntArray], BoolArray]
"""Which of some arcs (N,), by their places in the graph, are free."""


class AskedArcs:
    """What is known of the arcs of a graph.

    state  (m,)  UNKNOWN, FREE or BLOCKED
    """

    def __init__(self, graph: Graph, free: Free) -> None:
        """Nothing is known yet; ``free`` is asked about each arc at most once."""
        self.graph, self.free = graph, free
        self.state = np.zeros(graph.arcs, np.uint8)
        self._known = np.zeros(graph.nodes, np.int64)  # arcs that are known, of those that leave or enter each node
        self._blocked = self._known.copy()  # and those of them that are blocked

    @property
    def blocked(self) -> BoolArray:
        """Which arcs (m,) are known to be blocked."""
        return np.asarray(self.state == BLOCKED)

    def know(self, arcs: IntArray, free: BoolArray) -> None:
        """Note of arcs (N,), of which nothing is known yet, which are free."""
        self.state[arcs] = np.where(free, FREE, BLOCKED)
        for ends in self._ends(arcs):
            np.add.at(self._known, ends, 1)
            np.add.at(self._blocked, ends, ~free)

    def settle(self, arcs: IntArray, lengths: IntArray, late: Callable[[], bool]) -> bool:
        """Ask until each path is free all along, or an arc of it is blocked; False where it was late before.

        Parameters
        ----------
        arcs : (N,) of all paths, one path after another
        lengths : (n,) of the paths
        late : is asked after each AT_ONCE arcs
        """
        asked = 0
        while (some := self._next(arcs, lengths)[:AT_ONCE]).size:
            if asked >= AT_ONCE and late():
                return False
            self.know(some, self.free(some))
            asked += some.size
        return True

    def are_free(self, arcs: IntArray, lengths: IntArray) -> BoolArray:
        """Which paths (n,) are known to be free all along; arcs and lengths as in :meth:`settle`."""
        return ~_some(self.state[arcs] != FREE, lengths)

    def _next(self, arcs: IntArray, lengths: IntArray) -> IntArray:
        """Of each path that may be free, the arc of which nothing is known that is blocked most likely."""
        path = np.repeat(np.arange(lengths.size), lengths)
        doubtful = (self.state[arcs] == UNKNOWN) & ~_some(self.state[arcs] == BLOCKED, lengths)[path]
        arcs, path = arcs[doubtful], path[doubtful]
        arcs = arcs[np.lexsort((-self._risk(arcs), path))]
        return distinct(arcs[np.unique(path, return_index=True)[1]])

    def _risk(self, arcs: IntArray) -> FloatArray:
        """The shares of blocked arcs at the ends (N,) of arcs, added up; half where nothing is known."""
        tails, heads = ((self._blocked[ends] + 0.5) / (self._known[ends] + 1.0) for ends in self._ends(arcs))
        return np.asarray(tails + heads)

    def _ends(self, arcs: IntArray) -> tuple[IntArray, IntArray]:
        """Tails and heads (N,) of arcs."""
        tails = np.searchsorted(self.graph.indptr, arcs, side="right") - 1
        return tails, self.graph.heads[arcs].astype(np.int64)


def _some(marked: BoolArray, lengths: IntArray) -> BoolArray:
    """Which paths (n,) have an arc that is marked (N,)."""
    path = np.repeat(np.arange(lengths.size), lengths)
    return np.asarray(np.bincount(path, marked, minlength=lengths.size) > 0)
