"""Closed arcs and lower bounds, which a prepared graph keeps between queries, and checks of known paths.

A closed arc is an arc that paths may not use. A group is a set of nodes joined by turns. A hull is a table of lower
bounds on weighted sums of two costs (:mod:`.staircase.turn_hull`), with a layer for each number of turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.base.text import shown
from hpop.errors import GraphError, QueryError
from hpop.runtime.compiled import lean
from hpop.search.general.search import General
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups
from hpop.search.pareto_paths import SearchQuery
from hpop.search.queries import UNLIMITED
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import H_FIRST, H_REST, TooWide, costs_by_turns
from hpop.search.staircase.turn_hull import IntLanes, TurnHull, directions, turn_hull


class ClosedArcs:
    """The closed arcs of a graph, and the groups of nodes that a search may still use.

    A group is a set of nodes joined by turns. A search can use it while all of its turns are open, or all are closed.

    closed  (m,)  True for a closed arc
    whole         groups of the graph, formed while all arcs were open. Its table of turn costs belongs to this object
                  alone: closing a turn sets its cost in the table to UNREACHABLE
    turns   (g,)  number of closed turns of each group
    """

    def __init__(self, graph: Graph, groups: Groups) -> None:
        self.graph, self.whole = graph, groups
        self.closed = np.zeros(graph.arcs, np.bool_)
        self.turns = np.zeros(len(groups.rows), np.int64)

    @property
    def groups(self) -> Groups:
        """Groups for the next search: ``whole``, or single nodes while only some of the turns of a group are closed.

        A search with groups needs all turns of a group, or none.
        """
        several = self.whole.rows[:, SIZE] * (self.whole.rows[:, SIZE] - 1)
        return self._single_nodes if ((self.turns > 0) & (self.turns < several)).any() else self.whole

    def without_closed(self) -> Groups:
        """Return the groups for the next search without closed arcs, and with infinite costs for closed turns."""
        groups, turns_closed = self.groups, self.turns > 0
        free = ~self.closed[groups.origin]
        start = np.concatenate([np.zeros(1, np.int64), np.cumsum(free)])[groups.start]
        dearest = groups.dearest
        if groups is self.whole and turns_closed.any():
            dearest = np.where(turns_closed[:, None], UNREACHABLE, dearest)
        heads, origin = groups.heads[free], groups.origin[free]
        return replace(groups, dearest=dearest, start=start, heads=heads, origin=origin)

    @cached_property
    def _single_nodes(self) -> Groups:
        return Groups.single_nodes(self.graph, Clock(UNLIMITED, None))

    @cached_property
    def tails(self) -> NDArray[np.int32]:
        """Tail (m,) of each arc."""
        return np.repeat(np.arange(self.graph.nodes, dtype=np.int32), np.diff(self.graph.indptr))

    def set_closed(self, arcs: ArrayLike, closed: bool) -> IntArray:
        """Close or open arcs (N,), given by their indices in the graph; return the indices of arcs that changed."""
        indices = self._arc_indices(arcs)
        indices = np.compress(self.closed[indices] != closed, indices)
        self.closed[indices] = closed
        self._count_turns(indices, 1 if closed else -1)
        return indices

    def _arc_indices(self, arcs: ArrayLike) -> IntArray:
        indices = np.asarray(arcs)
        if not indices.size:
            return np.zeros(0, np.int64)
        if indices.ndim != 1 or indices.dtype.kind not in "iu":
            raise GraphError(
                f"arcs must be a list of integers, indices of arcs in the graph, to close or open; got {shown(arcs)}"
            )
        if indices.min() < 0 or indices.max() >= self.graph.arcs:
            raise GraphError(
                f"indices of arcs must be from 0 to {self.graph.arcs - 1}, got {indices.min()} to {indices.max()}; use "
                "those of this graph"
            )
        unique: IntArray = np.unique(indices.astype(np.int64))
        return unique

    def _count_turns(self, arcs: IntArray, by: int) -> None:
        """Update the numbers and costs of closed turns for the turns among arcs that were closed or opened.

        ``by`` is 1 for arcs that were closed, -1 for arcs that were opened.
        """
        groups = self.whole
        if groups.column < 0:
            return
        tails, heads = groups.new_number[self.tails[arcs]], groups.new_number[self.graph.heads[arcs]]
        within = self._group_of_node[tails] == self._group_of_node[heads]
        turning = within & (tails != heads) & (self.graph.costs[arcs, groups.column] > 0)
        tails, heads, arcs = tails[turning], heads[turning], arcs[turning]
        np.add.at(self.turns, self._group_of_node[tails], by)
        if groups.alike.all():
            return
        rows = groups.rows[self._group_of_node[tails]]
        place = rows[:, TURNS] + (tails - rows[:, OFFSET]) * rows[:, SIZE] + heads - rows[:, OFFSET]
        groups.turns[:, place] = UNREACHABLE if by > 0 else self.graph.costs[arcs].T

    @cached_property
    def _group_of_node(self) -> NDArray[np.int32]:
        """Index (n,) of the group of each node, nodes in the order of the groups."""
        return np.repeat(np.arange(len(self.whole.rows), dtype=np.int32), self.whole.rows[:, SIZE])

    def close_arcs_of(self, search: General | Staircase, groups: Groups) -> None:
        """Exclude the closed arcs from a new search on ``groups``, by changing its tables."""
        search.close(self.closed, self.turns > 0 if groups is self.whole else np.zeros(len(groups.rows), np.bool_))


class KnownPaths(NamedTuple):
    """The n paths that are known before a search, with their costs.

    costs  (n, k) costs of each path
    paths  n arrays: indices of the arcs of each path in the graph
    """

    costs: IntArray
    paths: tuple[IntArray, ...]


def known_paths(
    graph: Graph, source: int, is_target: BoolArray, paths: Sequence[IntArray], closed: BoolArray
) -> KnownPaths:
    """Check paths that a caller knows; return those that use no closed arc, with their costs.

    is_target (n,), closed (m,)  masks of nodes and arcs
    paths                        paths, each given by the indices of its arcs in the graph

    Raises QueryError for a path that does not lead from the source to a target.
    """
    several = [np.asarray(path) for path in paths]
    listed = [arcs.ndim == 1 and (arcs.dtype.kind in "iu" or not arcs.size) for arcs in several]
    if not all(listed):
        raise QueryError(
            f"known path {listed.index(False)} must be a list of indices of arcs, whole numbers, got "
            f"{shown(paths[listed.index(False)])}; ParetoPaths.suffixes returns such lists"
        )
    sizes = np.array([path.size for path in several], np.int64)
    ends = np.cumsum(sizes)
    arcs = np.concatenate([np.zeros(0, np.int64), *several]).astype(np.int64)
    row = np.repeat(np.arange(len(several)), sizes)
    is_strange = (arcs < 0) | (arcs >= graph.arcs)
    strange = row[is_strange]
    if strange.size:
        raise QueryError(
            f"known path {strange[0]} must list indices of arcs from 0 to {graph.arcs - 1}, got {arcs[is_strange][0]}; "
            "use those of this graph"
        )
    heads = graph.heads[arcs].astype(np.int64)
    tails = np.append(source, heads)[:-1] if arcs.size else arcs
    tails[(ends - sizes)[sizes > 0]] = source
    leads = (graph.indptr[tails] <= arcs) & (arcs < graph.indptr[tails + 1])
    last = np.full(len(several), source)
    last[sizes > 0] = heads[ends[sizes > 0] - 1]
    wrong = np.concatenate([row[~leads], np.flatnonzero(~is_target[last])])
    if wrong.size:
        raise QueryError(
            f"known path {wrong.min()} must lead from node {source} to a target, arc by arc, but does not; leave it out"
        )
    costs = np.zeros((len(several), graph.criteria), np.int64)
    for j, aggregate in enumerate(graph.aggregates):
        if arcs.size:
            add = np.maximum if aggregate == "max" else np.add
            costs[sizes > 0, j] = add.reduceat(graph.costs[arcs, j], (ends - sizes)[sizes > 0])
    free = np.ones(len(several), np.bool_)
    free[row[closed[arcs]]] = False
    parts = np.split(arcs, ends[:-1]) if several else []
    return KnownPaths(costs[free], tuple(part for part, is_free in zip(parts, free, strict=True) if is_free))


@lean
def least_path(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    column: int,
    closed: BoolArray,
    onward: NDArray[np.int32],
    source: int,
    arcs: IntArray,
) -> int:
    """Follow a path from the source to a target, node by node; write its arcs to `arcs`, and return their number.

    indptr, heads, costs  arcs of the graph, see :class:`.Graph`
    onward  (n,)  next node on the path from each node; -1 at its end
    column        of parallel open arcs, the one with the least cost in this column is taken
    closed  (m,)  mask of closed arcs
    arcs          output, with room for the longest path
    """
    size = 0
    u = np.int64(source)
    while onward[u] >= 0:
        best = np.int64(-1)
        for a in range(indptr[u], indptr[u + 1]):
            if heads[a] == onward[u] and not closed[a] and (best < 0 or costs[a, column] < costs[best, column]):
                best = np.int64(a)
        arcs[size] = best
        size += 1
        u = np.int64(onward[u])
    return size


# The exact search uses bounds for each number of remaining turns (:func:`.staircase.tables.costs_by_turns`), the
# approximate one joint bounds of two costs (:mod:`.turn_hull`). Both take longer to compute than a small search, but do
# not depend on the source. They are computed while all arcs are open. When arcs are closed they stay valid, as the best
# of fewer paths is no better. Joint bounds are stored as excess over the least costs, so they can only be used with the
# bounds h with which they were computed.


ROOM = 200 * 2**20  # bytes for joint bounds, scratch included
# No more layers are added once bounds are within NEAR times the least costs, at all but the share FEW of the nodes.
NEAR, FEW = 1.025, 0.02


@dataclass(frozen=True, eq=False)
class StaircaseBounds:
    """Lower bounds of the remaining costs for staircase searches, computed while all arcs are open.

    h       (k, n)       least remaining value of each cost
    layers  (n, LAYERS)  least remaining rest cost, the third in the search's order, with at most 0, 1, ... turns; nodes
                         in the order of the groups; or None
    hull                 joint bounds of the first and the rest cost (:mod:`.staircase.turn_hull`), or None
    """

    h: IntArray
    layers: NDArray[Any] | None = None
    hull: TurnHull | None = None

    @classmethod
    def of(
        cls,
        graph: Graph,
        source: int,
        targets: IntArray,
        order: tuple[int, ...],
        h: IntArray,
        groups: Groups,
        clock: Clock,
    ) -> Self:
        """Compute the bounds.

        ``layers`` and ``hull`` need groups of turns that raise the index cost by 1, and costs that are sums; otherwise
        they are None.

        source  node with the largest remaining costs, from which the range of costs is taken
        order   columns of the costs in the order of the search: first, index and third cost
        h       (k, n)  least remaining value of each cost
        """
        first, index, rest = order
        sums = [graph.aggregates[j] == "sum" for j in (first, rest)]
        if groups.column != index or groups.step != 1 or not sums[1]:
            return cls(h)
        try:
            search = SearchQuery(graph, source, targets).staircase(order, h, groups, clock, jointly=False)
        except TooWide:
            return cls(h)
        tables = search.nodes, search.start, search.arcs
        layers = costs_by_turns(groups, rest, *tables, search.is_target, clock)
        if not sums[0]:
            return cls(h, layers)
        weights = directions((int(search.nodes[:, H_FIRST].max()), int(search.nodes[:, H_REST].max())))
        near = search.nodes[:, [H_FIRST, H_REST]] * weights[[0, 1], [0, 1]] * NEAR
        near[h[0, groups.nodes] >= UNREACHABLE] = np.inf

        def is_enough(lanes: IntLanes) -> bool:
            return bool((lanes[:, :2] > near).any(axis=1).mean() <= FEW)

        hull = turn_hull(groups, (first, rest), weights, *tables, search.is_target, is_enough, ROOM, clock)
        return cls(h, layers, hull)
