"""The graph of the exact search: arcs in compressed sparse rows, with integer costs that are sums or maxima."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, IntArray
from hpop.base.options import whole
from hpop.base.text import shown
from hpop.errors import GraphError
from hpop.search.networks import (
    MAX_INDEX,
    AddedArcs,
    Edges,
    aggregates_of,
    check_range,
    check_sums,
    integers,
    make_read_only,
    network_arrays,
    stable_order,
    unknown_label,
)

if TYPE_CHECKING:
    import networkx as nx

MAX_COSTS = 6
MOST_NODES = 100_000_000  # even without arcs they take 800 MB
AGGREGATES = ("sum", "max")


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Graph:
    """Directed graph with k non-negative integer costs on every arc.

    Self-loops and parallel arcs are allowed. A path costs the sum over its arcs ("sum"), or the largest ("max").

    indptr      (n + 1,)  int64  the arcs that leave node u are indptr[u] : indptr[u + 1]
    heads       (m,)      int32  the node to which an arc leads
    costs       (m, k)    int64  costs of each arc, non-negative, k from 1 to 6
    arc         (m,)      int32  the index of the arc in the caller's arrays
    aggregates  (k,)      "sum" or "max" for every cost
    labels      (n,)      the caller's names of the nodes, or None
    edges                 edges and exact costs of the networkx graph, if the graph was built from one, or None
    turns                 the column of the cost that counts turns in place, if known, or None
    base                  the graph to which this graph adds nodes and arcs (:meth:`extended`), if it is reused, or None
    layers                number of copies of the base, 1 without a base

    Read-only, contiguous arrays of these types are used without a copy.

    >>> graph = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 5], [1, 5], [9, 1]])
    >>> graph.nodes, graph.arcs, graph.criteria
    (3, 3, 2)
    >>> graph.arc.tolist()
    [0, 2, 1]
    """

    indptr: IntArray
    heads: NDArray[np.int32]
    costs: IntArray
    arc: NDArray[np.int32]
    aggregates: tuple[str, ...]
    labels: tuple[Hashable, ...] | None = None
    edges: Edges | None = None
    turns: int | None = None
    base: Graph | None = field(default=None, init=False)  # not kept by `replace`
    layers: int = field(default=1, init=False)

    def __post_init__(self) -> None:
        indptr = integers(self.indptr, "indptr", np.int64)
        costs = integers(self.costs, "costs", np.int64)
        heads = integers(self.heads, "heads", np.int32)
        arc = integers(self.arc, "arc", np.int32)
        n, m = len(indptr) - 1, len(heads)
        if indptr.ndim != 1 or n < 1:
            raise GraphError(f"indptr must be a vector of n + 1 offsets, n at least 1; got {indptr.shape}")
        if n > MAX_INDEX or m > MAX_INDEX:
            raise GraphError(f"a graph must have at most {MAX_INDEX} nodes and arcs, got {n} nodes and {m} arcs")
        if indptr[0] != 0 or indptr[-1] != m or (np.diff(indptr) < 0).any():
            raise GraphError(f"indptr must begin with 0, never fall, and end with the number of arcs, {m}")
        if heads.ndim != 1 or arc.shape != heads.shape:
            raise GraphError(f"heads and arc must be vectors of one length, got {heads.shape} and {arc.shape}")
        if costs.ndim != 2 or len(costs) != m or not 1 <= costs.shape[1] <= MAX_COSTS:
            raise GraphError(
                f"costs must have a row for each of the {m} arcs and 1 to {MAX_COSTS} columns, got {costs.shape}"
            )
        check_range(heads, n, "heads")
        if m and costs.min() < 0:
            row, column = np.argwhere(costs < 0)[0]
            raise GraphError(f"costs must be non-negative, got {costs[row, column]} at arc {row}, cost {column}")
        aggregates = tuple(self.aggregates)
        if len(aggregates) != costs.shape[1] or not set(aggregates) <= set(AGGREGATES):
            raise GraphError(
                f"aggregates must name 'sum' or 'max' for each of {costs.shape[1]} costs, got {shown(aggregates)}"
            )
        if self.labels is not None and len(self.labels) != n:
            raise GraphError(f"labels must name each of the {n} nodes, got {len(self.labels)}")
        for name, value in (("indptr", indptr), ("heads", heads), ("costs", costs), ("arc", arc)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "aggregates", aggregates)
        check_sums(self)

    @property
    def nodes(self) -> int:
        """Number of nodes, n."""
        return len(self.indptr) - 1

    @cached_property
    def largest(self) -> IntArray:
        """Largest value (k,) of each cost over all arcs, 0 without arcs."""
        return np.array([self.cost(j).max(initial=0) for j in range(self.criteria)], np.int64)

    @property
    def arcs(self) -> int:
        """Number of arcs, m."""
        return int(self.indptr[-1])

    @property
    def criteria(self) -> int:
        """Number of costs, k."""
        return len(self.aggregates)

    @classmethod
    def from_arcs(
        cls,
        n: int,
        tails: ArrayLike,
        heads: ArrayLike,
        costs: ArrayLike,
        *,
        aggregates: Sequence[str] | None = None,
    ) -> Self:
        """Build the graph from arcs in any order; `arc` of the graph has their positions in that order.

        >>> Graph.from_arcs(2, [1, 0], [0, 1], [[3], [4]]).costs.tolist()
        [[4], [3]]
        """
        n = whole("n", n, 1, MOST_NODES, "a number of nodes", error=GraphError)
        tails_ = integers(tails, "tails", np.int64)
        heads_ = integers(heads, "heads", np.int64)
        costs_ = integers(costs, "costs", np.int64)
        if tails_.ndim != 1 or tails_.shape != heads_.shape or costs_.shape[:1] != tails_.shape:
            raise GraphError(
                "tails, heads and costs must have one row for each arc, "
                f"got {tails_.shape}, {heads_.shape} and {costs_.shape}"
            )
        check_range(tails_, n, "tails")
        order = np.arange(len(tails_), dtype=np.int32)
        if (tails_[1:] < tails_[:-1]).any():
            order = stable_order(tails_)
            heads_, costs_ = heads_[order], costs_[order]
        indptr = np.zeros(n + 1, np.int64)
        np.cumsum(np.bincount(tails_, minlength=n), out=indptr[1:])
        make_read_only(indptr, heads_, costs_, order)
        return cls(indptr, cast(Any, heads_), costs_, cast(Any, order), aggregates_of(aggregates, costs_))

    @classmethod
    def from_csr(
        cls,
        indptr: ArrayLike,
        heads: ArrayLike,
        costs: ArrayLike,
        *,
        aggregates: Sequence[str] | None = None,
    ) -> Self:
        """Build the graph from arcs that are sorted by tail.

        indptr      (n + 1,)  the arcs of node v are ``indptr[v]`` to ``indptr[v + 1] - 1``
        heads       (m,)      node to which each arc leads
        costs       (m, k)    whole numbers
        aggregates  "sum" or "max" for each cost; by default sums

        >>> Graph.from_csr([0, 1, 1], [1], [[7, 2]], aggregates=["sum", "max"]).aggregates
        ('sum', 'max')
        """
        costs_ = integers(costs, "costs", np.int64)
        order = np.arange(len(costs_) if costs_.ndim else 0, dtype=np.int32)
        make_read_only(costs_, order)
        return cls(cast(Any, indptr), cast(Any, heads), costs_, order, aggregates_of(aggregates, costs_))

    @classmethod
    def from_networkx(
        cls,
        g: nx.Graph[Any],
        costs: Sequence[str],
        *,
        quanta: Mapping[str, float] | Sequence[float] | None = None,
        aggregates: Sequence[str] | None = None,
    ) -> Self:
        """Build the graph from a networkx graph; `costs` names the edge attributes that are its costs.

        An undirected edge becomes two arcs, both with the index of the edge in `g.edges`. Each of several parallel
        edges of a multigraph becomes an arc. The names of the nodes become `labels`, for source, target and paths.

        Costs become whole numbers of quanta, rounded up edge by edge (a millionth of a quantum is rounding noise).
        `quanta` gives the quanta by name, or one for each cost, in the unit of the attribute. By default the quantum is
        1 if the cost is a whole number on all edges. Else it is a power of ten, about a billionth of the largest cost
        (:func:`hpop.frontier.default_quanta`). The exact costs of paths, summed from the attributes, are in
        :attr:`.ParetoPaths.values`.

        Raises GraphError for no networkx graph, for a missing attribute, and for a cost that is negative or not finite.

        >>> import networkx as nx
        >>> g = nx.Graph()
        >>> g.add_edge("hall", "room", length=3.25, turns=1)
        >>> graph = Graph.from_networkx(g, ["length", "turns"], quanta={"length": 0.5})
        >>> graph.costs.tolist(), graph.node("room"), graph.arc.tolist()
        ([[7, 1], [7, 1]], 1, [0, 0])
        """
        read = network_arrays(g, costs, quanta)
        plain = cls.from_arcs(len(read.labels), read.tails, read.heads, read.costs, aggregates=aggregates)
        return replace(plain, arc=cast(Any, read.edge[plain.arc]), labels=read.labels, edges=read.edges)

    def to_networkx(self) -> nx.MultiDiGraph[Any]:
        """Return a networkx graph with an edge per arc, the arc's index as its key, and costs as attributes.

        A graph that came from networkx keeps its nodes, and the names and values of the attributes that are costs;
        other attributes are left out. Otherwise nodes are numbers and costs are called "cost 0", "cost 1", ...

        >>> Graph.from_arcs(2, [0], [1], [[7, 2]]).to_networkx().edges(keys=True, data=True)
        OutMultiEdgeDataView([(0, 1, 0, {'cost 0': 7, 'cost 1': 2})])
        """
        import networkx as nx

        labels = self.labels or range(self.nodes)
        names = [f"cost {j}" for j in range(self.criteria)] if self.edges is None else self.edges.names
        table = self.costs if self.edges is None else self.edges.values[self.arc]
        tails = np.repeat(np.arange(self.nodes), np.diff(self.indptr))
        g: nx.MultiDiGraph[Any] = nx.MultiDiGraph()
        g.add_nodes_from(labels)
        for tail, head, arc, costs in zip(
            tails.tolist(), self.heads.tolist(), self.arc.tolist(), table.tolist(), strict=True
        ):
            g.add_edge(labels[tail], labels[head], arc, **dict(zip(names, costs, strict=True)))
        return g

    def among(self, nodes: IntArray) -> Self:
        """Return the subgraph of `nodes` (j,), renumbered 0, 1, ... in this order; its `arc` has indices in this graph.

        >>> part = Graph.from_arcs(4, [0, 0, 1, 3], [1, 3, 2, 0], [[5], [6], [7], [8]]).among(np.array([0, 3]))
        >>> part.heads.tolist(), part.costs.tolist(), part.arc.tolist()
        ([1, 0], [[6], [8]], [1, 3])
        """
        number = np.full(self.nodes, -1)
        number[nodes] = np.arange(len(nodes))
        arcs = np.concatenate([np.arange(self.indptr[u], self.indptr[u + 1]) for u in nodes])
        tails = np.repeat(np.arange(len(nodes)), self.indptr[nodes + 1] - self.indptr[nodes])
        heads, costs = self.ends_and_costs(arcs)
        inside = number[heads] >= 0
        part = self.from_arcs(
            len(nodes), tails[inside], number[heads[inside]], costs[inside], aggregates=self.aggregates
        )
        return replace(part, arc=cast(Any, arcs[inside][part.arc]))

    def without(self, left_out: BoolArray) -> Self:
        """Return the graph without the marked arcs, a mask (m,); its `arc` has indices of arcs in this graph.

        >>> part = Graph.from_arcs(3, [0, 0, 1], [1, 2, 2], [[5], [6], [7]]).without(np.array([True, False, False]))
        >>> part.indptr.tolist(), part.heads.tolist(), part.costs.tolist(), part.arc.tolist()
        ([0, 1, 2, 2], [2, 2], [[6], [7]], [1, 2])
        """
        stays = np.flatnonzero(~left_out).astype(np.int32)
        before = np.append(0, np.cumsum(left_out))
        indptr, heads, costs = self.indptr - before[self.indptr], self.heads[stays], self.costs[stays]
        make_read_only(indptr, heads, costs, stays)
        return replace(self, indptr=indptr, heads=heads, costs=costs, arc=stays)

    def extended(
        self,
        nodes: int,
        tails: IntArray,
        heads: IntArray,
        costs: IntArray,
        *,
        is_reused: bool = False,
        layers: int = 1,
    ) -> Graph:
        """Return a larger graph. New nodes get the next numbers; new arcs follow the old arcs of a node.

        The result has no :attr:`labels` (names of nodes). If ``is_reused``, this graph becomes the :attr:`base` of the
        result, which shares its cache and arcs.

        Parameters
        ----------
        layers : number of copies of this graph in the result; a node v has the number l * n + v in copy l
        nodes : number of nodes of the result, old and new
        tails, heads : (j,) of the new arcs, sorted by tail
        costs : (j, k) of the new arcs

        >>> more = Graph.from_arcs(2, [0, 1], [1, 0], [[5], [6]]).extended(3, [0, 2], [2, 1], [[7], [8]])
        >>> more.indptr.tolist(), more.heads.tolist(), more.costs.ravel().tolist()
        ([0, 2, 3, 4], [1, 2, 0, 1], [5, 7, 6, 8])
        """
        from hpop.search.extended import ExtendedGraph  # it imports this module

        nodes = whole("nodes", nodes, layers * self.nodes, MOST_NODES, "a number of nodes", error=GraphError)
        part = Graph.from_arcs(nodes, tails, heads, costs, aggregates=self.aggregates)  # these alone are checked
        graph = ExtendedGraph.of(self, part, layers)
        check_sums(graph)
        return graph if is_reused or not self.has_costs else graph.copied()

    @property
    def layer(self) -> Graph:
        """The graph that each layer repeats: the base, or this graph if it has none."""
        return self if self.base is None else self.base

    @cached_property
    def added(self) -> AddedArcs:
        """Arcs that this graph adds to its base; none without a base."""
        return AddedArcs.none(self.criteria)

    def copied(self) -> Graph:
        """Return the same graph with its own arrays of all arcs, and without a base."""
        return self

    def ends_and_costs(self, arcs: NDArray[np.integer[Any]] | slice) -> tuple[NDArray[np.int32], IntArray]:
        """Return the heads (N,) and costs (N, k) of N arcs, given by indices or a range."""
        return self.heads[arcs], self.costs[arcs]

    @property
    def distinct_costs(self) -> IntArray:
        """Rows of costs (r, k) among which the costs of every arc are; here each arc has its own row."""
        return self.costs

    @property
    def bytes_to_copy(self) -> int:
        """Bytes of the arrays of all arcs that searches other than the exact one have yet to make; here 0."""
        return 0

    @property
    def tables(self) -> tuple[NDArray[Any], ...]:
        """Arrays that define the arcs and their costs."""
        return self.indptr, self.heads, self.costs

    def rows_of_turns(self, column: int) -> tuple[IntArray, NDArray[np.int32], BoolArray, IntArray, int]:
        """Return the arcs of one layer, as arrays, with what is needed to find them in the graph of all layers.

        Turns within groups of nodes are all among these arcs. The values are offsets (rows) and heads of the arcs of
        one layer, a mask of those with a positive cost in ``column``, the offsets of all arcs of this graph, and the
        number of nodes of a layer. In this graph, arcs that were added to a node come after its arcs of the layer.
        """
        if ("raised", column) not in self.cache:
            self.cache["raised", column] = self.cost(column) > 0
        return self.indptr, self.heads, self.cache["raised", column], self.indptr, self.nodes

    @property
    def has_costs(self) -> bool:
        """True if the array :attr:`costs` exists; some graphs make it when it is first read."""
        return "costs" in vars(self)

    def cost(self, column: int, part: slice = slice(None)) -> NDArray[Any]:
        """Return one cost of the arcs in a range."""
        return self.costs[part, column]

    @cached_property
    def cache(self) -> dict[Hashable, Any]:
        """Cache of tables, by name, that searches reuse on this graph and on graphs that extend it."""
        return {}

    def node(self, label: Hashable) -> int:
        """Return the number of the node with a label; raises GraphError if there is none."""
        if self.labels is None:
            raise GraphError("this graph has no labels; use node numbers, or build it with Graph.from_networkx")
        number = self.number(label)
        if number is None:
            raise GraphError(unknown_label(self.labels, label))
        return number

    def number(self, label: object) -> int | None:
        """Return the number of the node with a label, or None if there is none."""
        try:
            return self._numbers.get(label)
        except TypeError:  # a value that cannot be a label, such as a list
            return None

    @cached_property
    def _numbers(self) -> dict[Hashable, int]:
        return {label: i for i, label in enumerate(self.labels or ())}

    def __repr__(self) -> str:
        costs = ", ".join(self._cost_descriptions())
        return f"<Graph: {self.nodes:,} nodes, {self.arcs:,} arcs, {self.criteria} costs ({costs})>"

    def _cost_descriptions(self) -> tuple[str, ...]:
        """Return a short description of each cost, for the repr."""
        if self.edges is None:
            return self.aggregates
        quanta = (f"{quantum:g}" for quantum in self.edges.quanta)
        named = zip(self.aggregates, self.edges.names, quanta, strict=True)
        return tuple(f"{aggregate} of {name} in {quantum}" for aggregate, name, quantum in named)
