"""Paths to the goal of a drive that earlier searches found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.frontier import is_nondominated
from hpop.search import Graph


@dataclass(frozen=True, eq=False)
class KnownRoutes:
    """Paths to the goal that are known from earlier searches, with the remaining cost from each of their nodes.

    The S arcs are listed path by path. If areas have only been closed since, open remaining parts of optimal paths are
    still optimal, as there are fewer alternatives.

    tails, arcs     (S,)    tail node and index of each arc
    ends            (S,)    index in this list after the last arc of the same path
    remaining_cost  (S, k)  in quanta (smallest cost steps), from the tail of each arc to the goal
    closed          (S,)    whether this arc or a later one of the path is closed
    """

    tails: IntArray
    arcs: IntArray
    ends: IntArray
    remaining_cost: IntArray
    closed: BoolArray

    @classmethod
    def of(cls, paths: Sequence[IntArray], tails: IntArray, graph: Graph, closed: BoolArray) -> KnownRoutes:
        """Build known paths from the indices of the arcs of each path.

        tails, closed  (m,) tail of each arc of the graph, and whether the arc is closed
        """
        arcs = np.concatenate([np.zeros(0, np.int64), *paths])
        sizes = [path.size for path in paths]
        last = np.cumsum(np.array(sizes, np.int64))
        remaining_cost = np.empty((arcs.size, graph.criteria), np.int64)
        is_closed = np.empty(arcs.size, dtype=np.bool_)
        worst = np.array(graph.aggregates) == "max"
        for end, size in zip(last.tolist(), sizes, strict=True):
            own = slice(end - size, end)
            costs = graph.costs[arcs[own]][::-1]
            remaining_cost[own] = np.where(worst, np.maximum.accumulate(costs), np.cumsum(costs, axis=0))[::-1]
            is_closed[own] = np.logical_or.accumulate(closed[arcs[own]][::-1])[::-1]
        return cls(tails[arcs], arcs, np.repeat(last, sizes), remaining_cost, is_closed)

    def remaining(self, node: int) -> list[IntArray]:
        """Return the arcs of each known path's part from a node to the goal, for parts that are open.

        Parts that another of them dominates are left out.
        """
        steps = np.flatnonzero((self.tails == node) & ~self.closed)
        steps = steps[is_nondominated(self.remaining_cost[steps])] if steps.size else steps
        return [self.arcs[step : self.ends[step]] for step in steps.tolist()]
