"""Ways that are known: what of them is still to go from any node is an answer that takes no search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.frontier import is_nondominated
from hpop.search import Graph


@dataclass(frozen=True, eq=False)
class Known:
    """Ways to a goal, the arcs of all, one way after another, and what is still to go from each.

    Where only closings came since they were found, the open rests of optimal ways are optimal: alternatives became
    fewer.

    tails, arcs  (S,)
    ends         (S,)  where the way of each arc ends among these
    to_go        (S, k)  counts, from the tail of each arc to the goal
    closed       (S,)  whether an arc from there on is closed
    """

    tails: IntArray
    arcs: IntArray
    ends: IntArray
    to_go: IntArray
    closed: BoolArray

    @classmethod
    def of(cls, ways: Sequence[IntArray], tails: IntArray, graph: Graph, closed: BoolArray) -> Known:
        """Of ways, arcs each, through a graph whose arcs (m,) have these tails, some of them closed."""
        arcs = np.concatenate([np.zeros(0, np.int64), *ways])
        sizes = [way.size for way in ways]
        last = np.cumsum(np.array(sizes, np.int64))
        to_go = np.empty((arcs.size, graph.criteria), np.int64)
        shut = np.empty(arcs.size, dtype=np.bool_)
        worst = np.array(graph.aggregates) == "max"
        for end, size in zip(last.tolist(), sizes, strict=True):
            own = slice(end - size, end)
            costs = graph.costs[arcs[own]][::-1]
            to_go[own] = np.where(worst, np.maximum.accumulate(costs), np.cumsum(costs, axis=0))[::-1]
            shut[own] = np.logical_or.accumulate(closed[arcs[own]][::-1])[::-1]
        return cls(tails[arcs], arcs, np.repeat(last, sizes), to_go, shut)

    def rests(self, node: int) -> list[IntArray]:
        """The open rests of the ways from a node, arcs each, none of them dominated."""
        found = np.flatnonzero((self.tails == node) & ~self.closed)
        found = found[is_nondominated(self.to_go[found])] if found.size else found
        return [self.arcs[at : self.ends[at]] for at in found.tolist()]
