"""Graphs without arrays of all arcs and costs, which take most of the memory of a large graph.

A graph may repeat a base graph in layers and add nodes and arcs. A query adds its start and goals to a graph that other
queries use as well. A tour has a layer for each set of visited stops, and arcs that lead to later layers. Or a graph
stores its costs as a column of small integers for each cost. The exact search reads these arcs in place. Other searches
read arrays of all arcs, which are made when they are first read.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, N, inserted_in_layers, tiled
from hpop.search.graph import Graph
from hpop.search.networks import AddedArcs, check_sums


class CompactGraph(Graph):
    """Graph whose costs are stored as a column of small unsigned integers for each cost, such as 16 bits.

    The array :attr:`costs` (m, k), of 64 bits, is made when it is first read. The exact search with turns reads the
    columns instead.
    """

    columns: tuple[NDArray[np.unsignedinteger[Any]], ...] = ()

    @classmethod
    def of(
        cls,
        indptr: IntArray,
        heads: NDArray[np.int32],
        columns: Sequence[NDArray[np.unsignedinteger[Any]]],
        aggregates: Sequence[str],
    ) -> Self:
        """Return the graph of these arrays, which are not copied and must not change; ``columns``: k arrays (m,)."""
        graph = object.__new__(cls)
        vars(graph).update(indptr=indptr, heads=heads, columns=tuple(columns), aggregates=tuple(aggregates))
        vars(graph).update(labels=None, edges=None, turns=None, base=None, layers=1)
        check_sums(graph)
        return graph

    @cached_property
    def costs(self) -> IntArray:
        """Costs (m, k) of all arcs, copied when they are first read."""
        return _read_only(self._stacked(slice(None)))

    @cached_property
    def arc(self) -> NDArray[np.int32]:
        """Indices (m,) of the arcs in this graph: 0, 1, ..."""
        return _read_only(np.arange(self.arcs, dtype=np.int32))

    def cost(self, column: int, part: slice = slice(None)) -> NDArray[Any]:
        """Return one cost of the arcs in a range of indices, as the small integers that are stored."""
        return super().cost(column, part) if self.has_costs else self.columns[column][part]

    def ends_and_costs(self, arcs: NDArray[np.integer[Any]] | slice) -> tuple[NDArray[np.int32], IntArray]:
        """Return the heads (N,) and costs (N, k) of N arcs, given by their indices, without copying other arcs."""
        return super().ends_and_costs(arcs) if self.has_costs else (self.heads[arcs], self._stacked(arcs))

    def _stacked(self, arcs: NDArray[np.integer[Any]] | slice) -> IntArray:
        first = self.heads[arcs]
        costs = np.empty((*first.shape, len(self.columns)), np.int64)
        for j, column in enumerate(self.columns):
            costs[..., j] = column[arcs]
        return costs


class ExtendedGraph(Graph):
    """Graph that repeats its :attr:`base` in layers, and adds nodes and arcs.

    Node v of the base, which has n nodes, is node l * n + v of layer l; added nodes follow the last layer.
    """

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
        own = {"heads": self.heads, "costs": self.costs, "arc": self.arc, "base": None, "layers": 1}
        vars(graph).update({name: value for name, value in vars(self).items() if name != "added"} | own)
        return graph

    def ends_and_costs(self, arcs: NDArray[np.integer[Any]] | slice) -> tuple[NDArray[np.int32], IntArray]:
        """Return the heads (N,) and costs (N, k) of N arcs, given by their indices, without copying other arcs."""
        if self.base is None or self.has_costs or isinstance(arcs, slice):
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
        if self.base is None or self.has_costs:
            return super().distinct_costs
        return np.concatenate([self.base.distinct_costs, self.added.costs])

    @property
    def bytes_to_copy(self) -> int:
        """Bytes of the arrays of all arcs, which some searches make; 0 if they are made already.

        Also 0 with a single layer: the code that adds arcs to the base has counted these bytes then.
        """
        are_made = self.base is None or self.layers == 1 or self.has_costs
        return 0 if are_made else self.arcs * (2 * np.dtype(np.int32).itemsize + self.criteria * self.indptr.itemsize)

    @property
    def tables(self) -> tuple[NDArray[Any], ...]:
        """Arrays that define the graph; if it has several layers, the arcs of one and the added arcs."""
        if self.base is None or self.layers == 1:
            return super().tables
        return (self.indptr, *self.base.tables, *self.added)

    def rows_of_turns(self, column: int) -> tuple[IntArray, NDArray[np.int32], BoolArray, IntArray, int]:
        """Return arrays of the base: see :meth:`.Graph.rows_of_turns`.

        Added arcs are no turns within groups, so nothing is copied.
        """
        if self.base is None or self.has_costs:
            return super().rows_of_turns(column)
        indptr, heads, is_raised, *_ = self.base.rows_of_turns(column)
        return indptr, heads, is_raised, self.indptr, self.base.nodes


def _read_only(array: NDArray[N]) -> NDArray[N]:
    array.setflags(write=False)
    return array
