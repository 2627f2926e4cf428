"""Graph that repeats a base graph in layers and adds nodes and arcs, without copying the arrays of the base.

A query adds its start and goals to a graph that other queries use as well. A tour has a layer for each set of visited
stops, and arcs that lead to later layers. The exact search reads arcs of the base in place. Other searches read arrays
of all arcs, which are made when they are first read.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray, N, copied, inserted_in_layers, numbered, tiled
from hpop.search.graph import Graph


class AddedArcs(NamedTuple):
    """Arcs that a graph adds to its base, sorted by tail; they follow the arcs of the base at each tail.

    before  (j,)    index in the arrays of the base, repeated for each layer, before which each arc is inserted
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
    """Graph that repeats its :attr:`base` in layers, and adds nodes and arcs.

    Node v of the base, which has n nodes, is node l * n + v of layer l; added nodes follow the last layer.

    added   the added arcs
    layers  number of layers
    """

    added: AddedArcs
    layers: int = 1

    @classmethod
    def of(cls, base: Graph, part: Graph, layers: int = 1) -> ExtendedGraph:
        """Return the graph with the nodes and arcs of ``base`` in each layer, and the added ones of ``part``.

        The nodes of ``part`` are those of all layers and then the added ones; its arcs are only the added ones.
        """
        rows = tiled(base.indptr[:-1], layers, base.arcs)
        rows = np.append(rows, np.full(part.nodes + 1 - len(rows), layers * base.arcs))
        indptr = _read_only(rows + part.indptr)
        graph = object.__new__(cls)
        vars(graph).update(aggregates=base.aggregates, labels=None, edges=None, turns=base.turns, base=base)
        added = AddedArcs(np.repeat(rows[1:], np.diff(part.indptr)), part.heads, part.costs)
        largest = np.maximum(base.largest, part.largest)
        vars(graph).update(indptr=indptr, added=added, largest=largest, layers=layers)
        return graph

    def over(self, base: Graph, costs: IntArray) -> Graph:
        """Return the same graph with other costs: those of ``base``, which has the same arcs, and of the added arcs."""
        tails = np.searchsorted(self.indptr, self.added.places, side="right") - 1
        arcs = tails, self.added.heads.astype(np.int64), costs
        return copied(base.extended(self.nodes, *arcs, is_reused=True, layers=self.layers), turns=self.turns)

    @cached_property
    def heads(self) -> NDArray[np.int32]:
        """Heads (m,) of all arcs, copied when they are first read."""
        added = self.added.before, self.added.heads
        return _read_only(inserted_in_layers(self.layer.heads, self.layers, *added, self.layer.nodes))

    @cached_property
    def costs(self) -> IntArray:
        """Costs (m, k) of all arcs, copied when they are first read."""
        return _read_only(inserted_in_layers(self.layer.costs, self.layers, self.added.before, self.added.costs))

    @cached_property
    def arc(self) -> NDArray[np.int32]:
        """Indices (m,) of the arcs in this graph: 0, 1, ..."""
        return _read_only(np.arange(self.arcs, dtype=np.int32))

    def copied(self) -> Graph:
        """Return the same graph as a plain Graph that owns all its arrays and has no base."""
        graph = object.__new__(Graph)
        own = {"heads": self.heads, "costs": self.costs, "arc": self.arc, "base": None}
        vars(graph).update({name: value for name, value in vars(self).items() if name not in ("added", "layers")} | own)
        return graph

    @property
    def layer(self) -> Graph:
        """The base, which each layer repeats."""
        assert self.base is not None
        return self.base

    @property
    def offsets_of_added(self) -> IntArray:
        """Offsets (n + 1,) among the added arcs of those of each node."""
        return np.searchsorted(self.added.places, self.indptr)

    def places_in_layer(self, layer: IntArray, arcs: IntArray) -> IntArray:
        """Return the indices (N,) in this graph of arcs of the base in given layers; both arguments are (N,)."""
        places = layer * self.layer.arcs + arcs
        return places + np.searchsorted(self.added.before, places, side="right")

    def ends_and_costs(self, arcs: IntArray) -> tuple[NDArray[np.int32], IntArray]:
        """Return the heads (N,) and costs (N, k) of N arcs, given by their indices, without copying other arcs."""
        if self.base is None or "costs" in vars(self):
            return super().ends_and_costs(arcs)
        places = self.added.places
        own = np.searchsorted(places, arcs)
        is_added = np.append(places, -1)[own] == arcs
        heads, costs = np.empty(arcs.shape, np.int32), np.empty((*arcs.shape, self.criteria), np.int64)
        heads[is_added], costs[is_added] = self.added.heads[own[is_added]], self.added.costs[own[is_added]]
        layer, inner = np.divmod((arcs - own)[~is_added], max(1, self.base.arcs))
        heads[~is_added], costs[~is_added] = self.base.ends_and_costs(inner)
        heads[~is_added] += (layer * self.base.nodes).astype(np.int32)
        return heads, costs

    @property
    def distinct_costs(self) -> IntArray:
        """Costs (r, k) of the arcs of one layer and of the added arcs; other arcs repeat these, and are not copied."""
        if self.base is None or "costs" in vars(self):
            return super().distinct_costs
        return np.concatenate([self.base.distinct_costs, self.added.costs])

    @property
    def bytes_to_copy(self) -> int:
        """Bytes of the arrays of all arcs if they are not made yet; 0 without layers, where the caller counts them."""
        are_made = self.base is None or self.layers == 1 or "costs" in vars(self)
        return 0 if are_made else self.arcs * (2 * np.dtype(np.int32).itemsize + self.criteria * self.indptr.itemsize)

    @property
    def tables(self) -> tuple[NDArray[Any], ...]:
        """Arrays that define the graph; if it has several layers, the arcs of one and the added arcs."""
        if self.base is None or self.layers == 1:
            return super().tables
        return (self.indptr, *self.base.tables, *self.added)

    @property
    def rows_of_turns(self) -> tuple[IntArray, NDArray[np.int32], IntArray, IntArray, int]:
        """Arrays of the base: see :attr:`.Graph.rows_of_turns`.

        Added arcs are no turns within groups, so nothing is copied.
        """
        if self.base is None or "costs" in vars(self):
            return super().rows_of_turns
        indptr, heads, costs, *_ = self.base.rows_of_turns
        return indptr, heads, costs, self.indptr, self.base.nodes

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
