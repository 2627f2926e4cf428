"""Graph that adds a few nodes and arcs to a large one, its base, without copying the arrays of the base.

A query adds its start and goals to a graph that other queries use as well. With groups of turns, the exact search reads
arcs of the base in place. Otherwise the arrays of all arcs are copied when they are first read.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray, N, inserted, numbered
from hpop.search.graph import Graph


class AddedArcs(NamedTuple):
    """Arcs that a graph adds to its base, sorted by tail; they follow the arcs of the base at each tail.

    before  (j,)    index in the arrays of the base before which each arc is inserted
    heads   (j,)    int32, node to which each arc leads
    costs   (j, k)  costs of each arc
    """

    before: IntArray
    heads: NDArray[np.int32]
    costs: IntArray

    @property
    def places(self) -> IntArray:
        """Indices (j,) of these arcs among all arcs of the extended graph."""
        return self.before + np.arange(self.before.size)


class ExtendedGraph(Graph):
    """Graph that adds nodes and arcs to its :attr:`base`; ``added`` has these arcs."""

    added: AddedArcs

    @classmethod
    def of(cls, base: Graph, part: Graph) -> ExtendedGraph:
        """Return the graph with the nodes and arcs of ``base``, and the added ones of ``part``.

        The nodes of ``part`` are those of the base and then the added ones; its arcs are only the added ones.
        """
        rows = np.append(base.indptr, np.full(part.nodes - base.nodes, base.arcs))
        indptr = _read_only(rows + part.indptr)
        graph = object.__new__(cls)
        vars(graph).update(aggregates=base.aggregates, labels=None, edges=None, turns=base.turns, base=base)
        added = AddedArcs(np.repeat(rows[1:], np.diff(part.indptr)), part.heads, part.costs)
        vars(graph).update(indptr=indptr, added=added, largest=np.maximum(base.largest, part.largest))
        return graph

    @cached_property
    def heads(self) -> NDArray[np.int32]:
        """Heads (m,) of all arcs, copied when they are first read."""
        return _read_only(inserted(self._base.heads, self.added.before, self.added.heads))

    @cached_property
    def costs(self) -> IntArray:
        """Costs (m, k) of all arcs, copied when they are first read."""
        return _read_only(inserted(self._base.costs, self.added.before, self.added.costs))

    @cached_property
    def arc(self) -> NDArray[np.int32]:
        """Indices (m,) of the arcs in this graph: 0, 1, ..."""
        return _read_only(np.arange(self.arcs, dtype=np.int32))

    def copied(self) -> Graph:
        """Return the same graph as a plain Graph that owns all its arrays and has no base."""
        graph = object.__new__(Graph)
        own = {"heads": self.heads, "costs": self.costs, "arc": self.arc, "base": None}
        vars(graph).update({name: value for name, value in vars(self).items() if name != "added"} | own)
        return graph

    @property
    def _base(self) -> Graph:
        assert self.base is not None
        return self.base

    def ends_and_costs(self, arcs: IntArray) -> tuple[NDArray[np.int32], IntArray]:
        """Return the heads (N,) and costs (N, k) of N arcs, given by their indices, without copying other arcs."""
        if self.base is None or "costs" in vars(self):
            return super().ends_and_costs(arcs)
        places = self.added.places
        own = np.searchsorted(places, arcs)
        is_added = np.append(places, -1)[own] == arcs
        heads, costs = np.empty(arcs.shape, np.int32), np.empty((*arcs.shape, self.criteria), np.int64)
        heads[is_added], costs[is_added] = self.added.heads[own[is_added]], self.added.costs[own[is_added]]
        inner = (arcs - own)[~is_added]
        heads[~is_added], costs[~is_added] = self.base.heads[inner], self.base.costs[inner]
        return heads, costs

    @property
    def rows_of_turns(self) -> tuple[IntArray, NDArray[np.int32], IntArray, IntArray]:
        """Offsets, heads, costs of arcs with all turns within groups among them; offsets of this graph's own arcs.

        The first three are the arrays of the base, as added arcs are no turns within groups; so nothing is copied.
        """
        if self.base is None or "costs" in vars(self):
            return super().rows_of_turns
        return self.base.indptr, self.base.heads, self.base.costs, self.indptr

    def costs_of_path(self, nodes: IntArray, column: int, remaining: IntArray) -> IntArray:
        """Return all costs (k,) of a path through the given nodes (N,), which is least in the cost of ``column``.

        Of parallel arcs, the first one that gives this least cost is taken.

        remaining  (n,)  least remaining cost of each node in this column
        """
        sizes = (self.indptr[nodes + 1] - self.indptr[nodes])[:-1]
        step, number = numbered(sizes)
        heads, costs = self.ends_and_costs(self.indptr[nodes[step]] + number)
        worst = np.array(self.aggregates) == "max"
        onward = nodes[step + 1]
        paid = (
            np.maximum(costs[:, column], remaining[onward]) if worst[column] else costs[:, column] + remaining[onward]
        )
        fits = np.flatnonzero((heads == onward) & (paid == remaining[nodes[step]]))
        _, first = np.unique(step[fits], return_index=True)
        chosen = costs[fits[first]]
        total: IntArray = np.where(worst, chosen.max(axis=0, initial=0), chosen.sum(axis=0))
        return total


def _read_only(array: NDArray[N]) -> NDArray[N]:
    array.setflags(write=False)
    return array
