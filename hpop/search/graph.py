"""The graph that the exact search works on: arcs in compressed rows, integer costs, one aggregate a cost."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, IntArray
from hpop.base.options import whole
from hpop.base.text import shown
from hpop.errors import GraphError, did_you_mean
from hpop.search.networks import Edges, network

if TYPE_CHECKING:
    import networkx as nx

N = TypeVar("N", bound=np.generic)
MAX_COSTS = 6
MOST_NODES = 100_000_000  # without a single arc they take 800 MB
MAX_INDEX = 2**31 - 2  # nodes and arcs are counted in 32 bits
MAX_SUM = 2**59  # a path cost, a bound of the rest and two arcs more fit a key of 62 bits
AGGREGATES = ("sum", "max")


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Graph:
    """A directed graph with k non-negative integer costs on every arc.

    Self-loops and parallel arcs are allowed. A cost adds up along a path ("sum") or counts its worst arc
    ("max", a bottleneck).

    indptr      (n + 1,)  int64  the arcs that leave node u are indptr[u] : indptr[u + 1]
    heads       (m,)      int32  where an arc leads
    costs       (m, k)    int64  non-negative, k from 1 to 6
    arc         (m,)      int32  the index of the arc in what the caller gave
    aggregates  (k,)      "sum" or "max" for every cost
    labels      (n,)      the caller's names of the nodes, or None
    edges                 the caller's edges and costs as they were given, of a graph from networkx, or None
    base                  the graph that this one extends (:meth:`extended`), or None

    Arrays of these types that are read-only already are taken as they are, others are copied.

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
    base: Graph | None = field(default=None, init=False)  # a changed copy extends nothing

    def __post_init__(self) -> None:
        indptr = _integers(self.indptr, "indptr", np.int64)
        costs = _integers(self.costs, "costs", np.int64)
        heads = _integers(self.heads, "heads", np.int32)
        arc = _integers(self.arc, "arc", np.int32)
        n, m = len(indptr) - 1, len(heads)
        if indptr.ndim != 1 or n < 1:
            raise GraphError(f"indptr must be a vector of n + 1 offsets, n at least 1; got {indptr.shape}")
        if n > MAX_INDEX or m > MAX_INDEX:
            raise GraphError(f"at most {MAX_INDEX} nodes and arcs, got {n} nodes and {m} arcs")
        if indptr[0] != 0 or indptr[-1] != m or (np.diff(indptr) < 0).any():
            raise GraphError(f"indptr must rise from 0 to the number of arcs, {m}")
        if heads.ndim != 1 or arc.shape != heads.shape:
            raise GraphError(f"heads and arc must be vectors of one length, got {heads.shape} and {arc.shape}")
        if costs.ndim != 2 or len(costs) != m or not 1 <= costs.shape[1] <= MAX_COSTS:
            raise GraphError(
                f"costs must have a row for each of the {m} arcs and 1 to {MAX_COSTS} columns, got {costs.shape}"
            )
        _check_range(heads, n, "heads")
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
        _check_sums(self)

    @property
    def nodes(self) -> int:
        """Number of nodes, n."""
        return len(self.indptr) - 1

    @cached_property
    def largest(self) -> IntArray:
        """Largest cost (k,) of any arc; column by column, which is far quicker than ``max(axis=0)``."""
        return np.array([self.costs[:, j].max(initial=0) for j in range(self.criteria)], np.int64)

    @property
    def arcs(self) -> int:
        """Number of arcs, m."""
        return len(self.heads)

    @property
    def criteria(self) -> int:
        """Number of costs, k."""
        return int(self.costs.shape[1])

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
        """Build the graph from arcs in any order; `arc` maps back to that order.

        >>> Graph.from_arcs(2, [1, 0], [0, 1], [[3], [4]]).costs.tolist()
        [[4], [3]]
        """
        n = whole("n", n, 1, MOST_NODES, "a number of nodes", error=GraphError)
        tails_ = _integers(tails, "tails", np.int64)
        heads_ = _integers(heads, "heads", np.int64)
        costs_ = _integers(costs, "costs", np.int64)
        if tails_.ndim != 1 or tails_.shape != heads_.shape or costs_.shape[:1] != tails_.shape:
            raise GraphError(
                "tails, heads and costs must have one row an arc, "
                f"got {tails_.shape}, {heads_.shape} and {costs_.shape}"
            )
        _check_range(tails_, n, "tails")
        order = np.arange(len(tails_), dtype=np.int32)
        if (tails_[1:] < tails_[:-1]).any():
            order = _stable_order(tails_)
            heads_, costs_ = heads_[order], costs_[order]
        indptr = np.zeros(n + 1, np.int64)
        np.cumsum(np.bincount(tails_, minlength=n), out=indptr[1:])
        kinds = _aggregates(aggregates, costs_)
        _own(indptr, heads_, costs_, order)
        return cls(indptr, cast(Any, heads_), costs_, cast(Any, order), kinds)

    @classmethod
    def from_csr(
        cls,
        indptr: ArrayLike,
        heads: ArrayLike,
        costs: ArrayLike,
        *,
        aggregates: Sequence[str] | None = None,
    ) -> Self:
        """Build the graph from arcs that are sorted by tail already.

        >>> Graph.from_csr([0, 1, 1], [1], [[7, 2]], aggregates=["sum", "max"]).aggregates
        ('sum', 'max')
        """
        costs_ = _integers(costs, "costs", np.int64)
        order = np.arange(len(costs_) if costs_.ndim else 0, dtype=np.int32)
        kinds = _aggregates(aggregates, costs_)
        _own(costs_, order)
        return cls(cast(Any, indptr), cast(Any, heads), costs_, order, kinds)

    @classmethod
    def from_networkx(
        cls,
        g: nx.Graph[Any],
        costs: Sequence[str],
        *,
        quanta: Mapping[str, float] | Sequence[float] | None = None,
        aggregates: Sequence[str] | None = None,
    ) -> Self:
        """Build the graph from any networkx graph whose edges carry the costs as attributes, finite and not negative.

        An undirected edge becomes two arcs, both with the index of the edge in `g.edges`; each of several parallel
        edges of a multigraph is an arc of its own. The names of the nodes are the `labels` by which searches take
        source and target, and paths are told.

        Costs are counted in whole quanta, rounded up edge by edge (a millionth of a quantum is rounding noise).
        `quanta` gives them by name, or one a cost, in the unit of the attribute; else a cost that is a whole number on
        all edges has 1, and another one a billionth of the largest, as a power of ten
        (:func:`hpop.frontier.default_quanta`). What a path really costs, added up from the attributes as they were
        given, is in :attr:`.ParetoPaths.values`.

        Raises GraphError for another graph, an edge without the attribute, and a cost that is negative or no number.

        >>> import networkx as nx
        >>> g = nx.Graph()
        >>> g.add_edge("hall", "room", length=3.25, turns=1)
        >>> graph = Graph.from_networkx(g, ["length", "turns"], quanta={"length": 0.5})
        >>> graph.costs.tolist(), graph.node("room"), graph.arc.tolist()
        ([[7, 1], [7, 1]], 1, [0, 0])
        """
        read = network(g, costs, quanta)
        plain = cls.from_arcs(len(read.labels), read.tails, read.heads, read.costs, aggregates=aggregates)
        return replace(plain, arc=cast(Any, read.edge[plain.arc]), labels=read.labels, edges=read.edges)

    def to_networkx(self) -> nx.MultiDiGraph[Any]:
        """The graph for networkx: an edge an arc, its key the arc's index in what the caller gave, costs as attributes.

        Of a graph that came from networkx nodes, attributes and their values are those that were given; of another
        one nodes are numbers and costs are called "cost 0", "cost 1", ...

        >>> Graph.from_arcs(2, [0], [1], [[7, 2]]).to_networkx().edges(keys=True, data=True)
        OutMultiEdgeDataView([(0, 1, 0, {'cost 0': 7, 'cost 1': 2})])
        """
        import networkx as nx

        labels = self.labels or range(self.nodes)
        names = [f"cost {j}" for j in range(self.criteria)] if self.edges is None else self.edges.names
        table = self.costs if self.edges is None else self.edges.values[self.arc]
        tails = np.repeat(np.arange(self.nodes), np.diff(self.indptr))
        made: nx.MultiDiGraph[Any] = nx.MultiDiGraph()
        made.add_nodes_from(labels)
        for tail, head, arc, costs in zip(
            tails.tolist(), self.heads.tolist(), self.arc.tolist(), table.tolist(), strict=True
        ):
            made.add_edge(labels[tail], labels[head], arc, **dict(zip(names, costs, strict=True)))
        return made

    def among(self, nodes: IntArray) -> Self:
        """Return the part of the graph on some nodes, numbered anew in their order; `arc` has the arcs' places here.

        >>> part = Graph.from_arcs(4, [0, 0, 1, 3], [1, 3, 2, 0], [[5], [6], [7], [8]]).among(np.array([0, 3]))
        >>> part.heads.tolist(), part.costs.tolist(), part.arc.tolist()
        ([1, 0], [[6], [8]], [1, 3])
        """
        place = np.full(self.nodes, -1)
        place[nodes] = np.arange(len(nodes))
        arcs = np.concatenate([np.arange(self.indptr[u], self.indptr[u + 1]) for u in nodes])
        tails = np.repeat(np.arange(len(nodes)), self.indptr[nodes + 1] - self.indptr[nodes])
        inside = place[self.heads[arcs]] >= 0
        arcs, tails = arcs[inside], tails[inside]
        part = self.from_arcs(len(nodes), tails, place[self.heads[arcs]], self.costs[arcs], aggregates=self.aggregates)
        return replace(part, arc=cast(Any, arcs[part.arc]))

    def without(self, left_out: BoolArray) -> Self:
        """Return the graph without the arcs that are marked (m,); `arc` has the places here of those that stay.

        >>> part = Graph.from_arcs(3, [0, 0, 1], [1, 2, 2], [[5], [6], [7]]).without(np.array([True, False, False]))
        >>> part.indptr.tolist(), part.heads.tolist(), part.costs.tolist(), part.arc.tolist()
        ([0, 1, 2, 2], [2, 2], [[6], [7]], [1, 2])
        """
        kept = np.flatnonzero(~left_out).astype(np.int32)
        before = np.append(0, np.cumsum(left_out))
        indptr, heads, costs = self.indptr - before[self.indptr], self.heads[kept], self.costs[kept]
        _own(indptr, heads, costs, kept)
        return replace(self, indptr=indptr, heads=heads, costs=costs, arc=kept)

    def extended(
        self, nodes: int, tails: IntArray, heads: IntArray, costs: IntArray, *, is_reused: bool = False
    ) -> Self:
        """Return the graph with further nodes at the end, and further arcs after those of each tail.

        If this graph ``is_reused``, the other one keeps it as its :attr:`base`, and searches take what is known of it.

        Parameters
        ----------
        nodes : how many there are then
        tails, heads : (j,) of the further arcs, rising by their tails
        costs : (j, k)

        >>> more = Graph.from_arcs(2, [0, 1], [1, 0], [[5], [6]]).extended(3, [0, 2], [2, 1], [[7], [8]])
        >>> more.indptr.tolist(), more.heads.tolist(), more.costs.ravel().tolist()
        ([0, 2, 3, 4], [1, 2, 0, 1], [5, 7, 6, 8])
        """
        nodes = whole("nodes", nodes, self.nodes, MOST_NODES, "a number of nodes", error=GraphError)
        tails, heads = np.asarray(tails, np.int64), np.asarray(heads, np.int32)
        rows = np.append(self.indptr, np.full(nodes - self.nodes, self.arcs))
        more = np.append(0, np.cumsum(np.bincount(tails, minlength=nodes)))
        places = rows[tails + 1]
        all_heads = cast("NDArray[np.int32]", inserted(self.heads, places, heads))
        all_costs: IntArray = inserted(self.costs, places, np.asarray(costs))
        arcs = np.arange(self.arcs + tails.size, dtype=np.int32)
        _own(all_heads, all_costs, arcs)
        graph = type(self)(rows + more, all_heads, all_costs, arcs, self.aggregates)
        object.__setattr__(graph, "base", self if is_reused else None)
        return graph

    @cached_property
    def kept(self) -> dict[Hashable, Any]:
        """What searches know of the graph, by name, for other searches of it and of graphs that extend it."""
        return {}

    def node(self, label: Hashable) -> int:
        """Return the number of the node that the caller calls `label`."""
        if self.labels is None:
            raise GraphError("this graph has no labels; build it with Graph.from_networkx, or use the numbers")
        number = self.number(label)
        if number is None:
            raise GraphError(strange_node(self.labels, label))
        return number

    def number(self, label: object) -> int | None:
        """The number of the node that is called `label`; None where there is none, as of a graph without labels."""
        try:
            return self._numbers.get(label)
        except TypeError:  # a list, or another value that names nothing
            return None

    @cached_property
    def _numbers(self) -> dict[Hashable, int]:
        return {label: i for i, label in enumerate(self.labels or ())}

    def __repr__(self) -> str:
        return f"<Graph: {self.nodes:,} nodes, {self.arcs:,} arcs, {self.criteria} costs ({', '.join(self._costs())})>"

    def _costs(self) -> tuple[str, ...]:
        """Each cost in a word or three, for the repr."""
        if self.edges is None:
            return self.aggregates
        quanta = (f"{quantum:g}" for quantum in self.edges.quanta)
        named = zip(self.aggregates, self.edges.names, quanta, strict=True)
        return tuple(f"{aggregate} of {name} in {quantum}" for aggregate, name, quantum in named)


def inserted(values: NDArray[N], places: IntArray, added: NDArray[N]) -> NDArray[N]:
    """Return rows (m, ...) with further rows (j, ...) before some of their places (j,), which rise.

    >>> inserted(np.array([1, 2, 3]), np.array([1, 1, 3]), np.array([7, 8, 9])).tolist()
    [1, 7, 8, 2, 3, 9]
    """
    cuts, first, counts = np.unique(places, return_index=True, return_counts=True)
    parts, begin = list[NDArray[N]](), 0
    for cut, row, count in zip(cuts.tolist(), first.tolist(), counts.tolist(), strict=True):
        parts += [values[begin:cut], added[row : row + count].astype(values.dtype, copy=False)]
        begin = cut
    return np.concatenate([*parts, values[begin:]])


def strange_node(labels: Sequence[Hashable], label: object) -> str:
    """What is said of something that is none of the names of a graph's nodes."""
    known = ", ".join(map(shown, labels[:4])) + (", ..." if len(labels) > 4 else ".")
    near = did_you_mean(label, [one for one in labels if isinstance(one, str)])
    return f"no node is called {shown(label)}; the {len(labels):,} nodes are called {known}{near}"


def _integers(values: ArrayLike, name: str, dtype: Any) -> NDArray[Any]:
    """Return a contiguous array of integers, an own copy unless it is read-only; refuse what is not a whole number."""
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise GraphError(f"{name} must be an array of integers: {error}") from None
    if array.size == 0:
        return np.zeros(array.shape, dtype)
    if array.dtype.kind == "f":
        raise GraphError(
            f"{name} must be integers, got {array.dtype}: choose a quantum and quantise first, "
            f"for example np.rint({name} / quantum).astype(np.int64)"
        )
    if array.dtype.kind not in "iu":
        raise GraphError(f"{name} must be integers that fit 64 bits, got {array.dtype}")
    largest = MAX_INDEX if dtype is np.int32 else MAX_SUM
    wider = array.dtype.itemsize > np.dtype(dtype).itemsize or array.dtype.kind == "u"
    if wider and (array.max() > largest or array.min() < -largest):
        raise GraphError(f"{name} must not exceed {largest}, got {array.max()}")
    if array.dtype == dtype and array.flags.c_contiguous and not array.flags.writeable:
        return array
    return np.array(array, dtype, order="C")


def _own(*arrays: NDArray[Any]) -> None:
    """Mark arrays that nobody else has, so that they are not copied again."""
    for array in arrays:
        array.setflags(write=False)


def _stable_order(nodes: IntArray) -> NDArray[np.int32]:
    """Sort by node, ties as given: NumPy sorts 16-bit integers by radix, so do it in two halves."""
    order = np.argsort((nodes & 0xFFFF).astype(np.uint16), kind="stable").astype(np.int32)
    if nodes.max() > 0xFFFF:
        order = order[np.argsort((nodes[order] >> 16).astype(np.uint16), kind="stable")]
    return order


def _check_range(nodes: IntArray, n: int, name: str) -> None:
    if len(nodes) and (nodes.min() < 0 or nodes.max() >= n):
        at = int(np.flatnonzero((nodes < 0) | (nodes >= n))[0])
        raise GraphError(f"{name} must be nodes from 0 to {n - 1}, got {nodes[at]} at arc {at}")


def _aggregates(aggregates: Sequence[str] | None, costs: IntArray) -> tuple[str, ...]:
    if aggregates is None:
        return ("sum",) * (costs.shape[1] if costs.ndim == 2 else 0)
    return (aggregates,) if isinstance(aggregates, str) else tuple(aggregates)


def _check_sums(graph: Graph) -> None:
    """Refuse costs whose sums could overflow: a path without cycles leaves every node at most once."""
    leaving = graph.indptr[:-1][np.diff(graph.indptr) > 0]
    for j, aggregate in enumerate(graph.aggregates):
        worst = int(graph.largest[j])
        bound = worst * (len(leaving) + 2 if aggregate == "sum" else 1)
        if bound > MAX_SUM and worst <= MAX_SUM and aggregate == "sum":
            steps = np.maximum.reduceat(graph.costs[:, j], leaving)
            bound = sum(steps.tolist()) + 2 * worst
        if bound > MAX_SUM:
            raise GraphError(
                f"cost {j} could overflow: a path may cost up to {bound}, the limit is {MAX_SUM}; use a coarser quantum"
            )
