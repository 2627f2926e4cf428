"""A query of a search, checked, and its answer: what all ways in share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import IntArray
from hpop.errors import QueryError
from hpop.options import whole
from hpop.search.graph import Graph
from hpop.status import Budget, Status
from hpop.text import shown

if TYPE_CHECKING:
    pass


UNLIMITED = Budget()


@dataclass(frozen=True)
class SearchStats:
    """What a search did and what it cost.

    method            "staircase" or "general"; "auto" if a limit came before the choice
    order             columns of the costs in the order of the search
    labels_generated  count  partial paths put into the heap
    labels_expanded   count  partial paths taken out of it and followed
    labels_open       count  partial paths that were waiting when it ended
    peak_memory       bytes  arrays of the search
    seconds_bounds    s      lower bounds
    seconds_search    s      the search itself, tables included
    seconds_compiled  s      compiling kernels or loading them; 0 when they were in memory
    arcs_checked      count  arcs of which it was asked whether they are free
    arcs_blocked      count  those of them that are not
    rounds            count  searches, each without the arcs that were known to be blocked
    """

    method: str
    order: tuple[int, ...] = ()
    labels_generated: int = 0
    labels_expanded: int = 0
    labels_open: int = 0
    peak_memory: int = 0
    seconds_bounds: float = 0.0
    seconds_search: float = 0.0
    seconds_compiled: float = 0.0
    arcs_checked: int = 0
    arcs_blocked: int = 0
    rounds: int = 1


@dataclass(frozen=True, eq=False, repr=False)
class ParetoPaths:
    """A front and its paths.

    costs   (n, k)  int64  in the caller's columns, rows in lexicographic order
    status  COMPLETE, NO_PATH, or what stopped the search
    stats   what the search did
    gap     every missing vector is covered by one of these within the factor 1 + gap, beside the tolerance asked for
    blocked (b,)  places of the arcs that are known to be blocked, of those of which that was asked
    """

    costs: IntArray
    status: Status
    stats: SearchStats
    _graph: Graph
    _source: int
    _paths: tuple[IntArray, ...]
    gap: float = field(default=0.0, kw_only=True)
    blocked: IntArray = field(default_factory=lambda: np.zeros(0, np.int64), kw_only=True)

    def __len__(self) -> int:
        return len(self.costs)

    def select(self, costs: IntArray, rows: IntArray) -> ParetoPaths:
        """The paths of some rows, in that order, with other costs (n, k) in the place of these."""
        return replace(self, costs=costs[rows], _paths=tuple(self._paths[row] for row in rows))

    def on(self, graph: Graph) -> ParetoPaths:
        """The same on the graph of which theirs is a part, as :meth:`.Graph.without` makes one."""
        return replace(self, _graph=graph, _paths=tuple(self._graph.arc[path].astype(np.int64) for path in self._paths))

    def and_those_of(self, other: ParetoPaths) -> ParetoPaths:
        """These paths and others on the same graph."""
        return replace(self, costs=np.concatenate([self.costs, other.costs]), _paths=self._paths + other._paths)

    def nodes(self, i: int) -> IntArray:
        """Nodes of path i, source and target included."""
        heads = self._graph.heads[self._paths[i]].astype(np.int64)
        return np.concatenate([np.array([self._source], np.int64), heads])

    @property
    def lengths(self) -> IntArray:
        """Arcs (n,) of each path."""
        return np.array([path.size for path in self._paths], dtype=np.int64)

    @property
    def all_arcs(self) -> IntArray:
        """Places (N,) of the arcs of all paths in the graph, one path after another."""
        return np.concatenate([np.zeros(0, np.int64), *self._paths])

    def through(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Nodes (N,) of the paths of some rows (r,), one path after another, and how many (r,) each has."""
        several = [self._paths[row] for row in rows]
        sizes = np.array([path.size for path in several], dtype=np.int64) + 1
        nodes = np.full(sizes.sum(), self._source, dtype=np.int64)
        heads = np.delete(np.arange(nodes.size), np.cumsum(sizes) - sizes)
        nodes[heads] = self._graph.heads[np.concatenate([np.zeros(0, np.int64), *several])]
        return nodes, sizes

    def arcs(self, i: int) -> IntArray:
        """Arcs of path i, as indices into the arcs that the caller gave."""
        return self._graph.arc[self._paths[i]].astype(np.int64)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self):,} of {self.costs.shape[1]} costs; {self.status}>"


def checked_node(graph: Graph, node: Any, name: str) -> int:
    """The number of a node of the graph; raises QueryError for anything else."""
    hint = "graph.node(label) gives the number of a node"
    return whole(name, node, 0, graph.nodes - 1, "a node", hint=hint, error=QueryError)


def checked_targets(graph: Graph, target: Any) -> IntArray:
    """The numbers of one or several nodes, in order; raises QueryError for anything else."""
    if isinstance(target, int | np.integer | str):
        return np.array([checked_node(graph, target, "target")], np.int64)
    try:
        several = {checked_node(graph, t, "target") for t in target}
    except TypeError:
        raise QueryError(f"target must be a node or several nodes, got {shown(target)}") from None
    if not several:
        raise QueryError("target must name at least one node, got none")
    return np.array(sorted(several), np.int64)
