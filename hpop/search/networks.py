"""Arrays of a search graph: from networkx graphs, with costs in whole quanta; added arcs; checks and conversions."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import is_number, python_value, shown
from hpop.errors import GraphError, did_you_mean
from hpop.frontier import default_quanta

if TYPE_CHECKING:
    import networkx as nx

    from hpop.search.graph import Graph

WHOLE = 1e-6  # share of a quantum: rounding error allowed before a cost is rounded up
MOST_QUANTA = 2**53  # largest cost of one edge in quanta: beyond, float64 cannot represent all whole numbers
Edge = tuple[Hashable, ...]


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of the networkx graph from which a graph was built, with their exact costs.

    ends    E       (tail, head), or (tail, head, key) in a multigraph, as in `g.edges[...]`
    names   k       names of the attributes that are the costs
    values  (E, k)  exact costs: int64 if all are whole numbers, else float64
    quanta  (k,)    value of one count of each integer cost, in the unit of the attribute
    """

    ends: tuple[Edge, ...]
    names: tuple[str, ...]
    values: FloatArray | IntArray
    quanta: FloatArray


class NetworkArrays(NamedTuple):
    """Networkx graph as arrays.

    labels        n       labels of the nodes
    tails, heads  (m,)    nodes of each arc
    edge          (m,)    index of the edge of each arc
    costs         (m, k)  integer costs of each arc
    edges                 edges with their exact costs
    """

    labels: tuple[Hashable, ...]
    tails: IntArray
    heads: IntArray
    edge: IntArray
    costs: IntArray
    edges: Edges


def network_arrays(
    g: nx.Graph[Any], costs: Sequence[str], quanta: Mapping[str, float] | Sequence[float] | None = None
) -> NetworkArrays:
    """Convert a networkx graph to arrays. An undirected edge becomes two arcs, and parallel edges stay apart.

    costs   names of the edge attributes that are the costs
    quanta  value of one count of each cost, as in :meth:`.Graph.from_networkx`

    Raises GraphError for an object of another type, a missing attribute, and invalid costs or quanta.
    """
    if not any(cls.__module__.partition(".")[0] == "networkx" for cls in type(g).__mro__):  # networkx is not imported
        raise GraphError(
            f"graph must be a networkx graph, got {_type_of(g)}; for arrays use Graph.from_arcs(n, tails, heads, costs)"
        )
    labels = tuple(g.nodes)
    index = {label: i for i, label in enumerate(labels)}
    listed: Any = g.edges  # of a multigraph it takes keys
    rows: list[tuple[Any, ...]] = list(listed(keys=True, data=True) if g.is_multigraph() else listed(data=True))
    ends, data = tuple(row[:-1] for row in rows), [row[-1] for row in rows]
    names = _names(costs, data)
    columns = [_column(name, ends, data) for name in names]
    values: Any = np.stack(columns, axis=1)  # (E, k) int64 or float64
    steps = _quanta(quanta, names, columns)
    counts = np.stack([_counts(*each, ends) for each in zip(names, columns, steps.tolist(), strict=True)], axis=1)
    tails, heads = (np.array([index[end[side]] for end in ends], np.int64) for side in (0, 1))
    edge = np.arange(len(ends))
    if not g.is_directed():
        tails, heads = np.concatenate([tails, heads]), np.concatenate([heads, tails])
        edge, counts = np.concatenate([edge, edge]), np.concatenate([counts, counts])
    return NetworkArrays(labels, tails, heads, edge, counts, Edges(ends, names, values, steps))


def _names(costs: Sequence[str], data: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    names = (costs,) if isinstance(costs, str) else tuple(costs) if isinstance(costs, Iterable) else ()
    if not names or len(set(names)) < len(names) or not all(isinstance(name, str) for name in names):
        raise GraphError(
            f"costs must name the attributes of edges to minimise, each once, such as costs=['length', 'risk'], got "
            f"{shown(costs) if costs else 'none'}{_attributes(data)}"
        )
    return names


def _column(name: str, ends: Sequence[Edge], data: Sequence[Mapping[str, Any]]) -> FloatArray | IntArray:
    """Return the values (E,) of an attribute on all edges; raise GraphError unless all are finite and at least 0.

    ends, data  for each edge, its ends as in `g.edges[...]`, and its attributes
    """
    values = [python_value(row.get(name)) for row in data]
    lacking = [edge for edge, value in enumerate(values) if value is None]
    if lacking:
        names = {attribute for row in data for attribute in row if isinstance(attribute, str)}
        subject = f"{len(lacking):,} of {len(ends):,} edges have" if len(lacking) > 1 else "one edge has"
        raise GraphError(
            f"{subject} no attribute {shown(name)}, the first is {_edge_text(ends[lacking[0]])}{_attributes(data)}."
            f"{did_you_mean(name, names - {name})}"
        )
    for edge, value in enumerate(values):
        if not isinstance(value, Real) or not math.isfinite(value) or value < 0:
            negative = isinstance(value, Real) and value < 0
            hint = "; to maximise a quantity, pass its largest value minus the quantity as cost" if negative else ""
            hint += " (a sum then also rewards fewer edges), or -log(p) of a probability p" if negative else ""
            raise GraphError(
                f"costs must be finite numbers of at least 0, got {shown(value)} as {shown(name)} of "
                f"{_edge_text(ends[edge])}{hint}"
            )
    try:
        if all(isinstance(value, int) for value in values):
            return np.array(values, np.int64)
        return np.array([float(cast(Real, value)) for value in values])
    except OverflowError:
        raise GraphError(
            f"{shown(name)} must fit 64 bits, but is larger on some edge; give it in a larger unit"
        ) from None


def _quanta(
    quanta: Mapping[str, float] | Sequence[float] | None, names: tuple[str, ...], columns: Sequence[NDArray[Any]]
) -> FloatArray:
    """Return the quantum (k,) of each cost: the caller's, or a default derived from the cost's values.

    quanta   the option of :meth:`.Graph.from_networkx`
    names    names of the costs
    columns  for each cost its values (E,) on all edges
    """
    own = {
        name: 1.0 if column.dtype.kind == "i" else float(default_quanta(column[:, None])[0])
        for name, column in zip(names, columns, strict=True)
    }
    if quanta is not None and not isinstance(quanta, Mapping):
        if np.ndim(quanta) != 1 or len(quanta) != len(names):
            raise GraphError(
                f"quanta must have one number for each of {', '.join(names)}, or give some by name, such as "
                f"{{{names[0]!r}: 0.01}}, got {shown(quanta)}"
            )
        quanta = dict(zip(names, quanta, strict=True))
    for name, quantum in (quanta or {}).items():
        if name not in own:
            raise GraphError(
                f"quanta must name costs ({', '.join(names)}), got {shown(name)}.{did_you_mean(name, names)}"
            )
        if not is_number(quantum) or not 0 < quantum < math.inf:
            raise GraphError(f"the quantum of {shown(name)} must be a positive finite number, got {shown(quantum)}")
        own[name] = float(quantum)
    return np.array([own[name] for name in names])


def _counts(name: str, column: NDArray[Any], quantum: float, ends: Sequence[Edge]) -> IntArray:
    """Return the values (E,) of a cost as whole numbers of its quantum, rounded up."""
    if quantum == 1.0 and column.dtype.kind == "i":
        return column
    with np.errstate(over="ignore"):
        quotients = column / quantum
    if (beyond := np.flatnonzero(quotients > MOST_QUANTA)).size:
        edge = int(beyond[0])
        raise GraphError(
            f"{shown(name)} must be at most 2^53 quanta, but is {column[edge]:.6g} on {_edge_text(ends[edge])}, with "
            f"the quantum {quantum:.6g}; use a coarser quantum"
        )
    counts: IntArray = np.ceil(quotients - WHOLE).astype(np.int64)
    return counts


def unknown_label(labels: Sequence[Hashable], label: object) -> str:
    """Return the error message for a label that no node of a graph has, with similar labels."""
    examples = ", ".join(map(shown, labels[:4])) + (", ..." if len(labels) > 4 else ".")
    near = did_you_mean(label, [name for name in labels if isinstance(name, str)])
    return f"no node is called {shown(label)}; the {len(labels):,} nodes are called {examples}{near}"


def _edge_text(edge: Edge) -> str:
    tail, head, *keys = edge
    return f"edge {shown(tail)} - {shown(head)}{''.join(f' (key {shown(key)})' for key in keys)}"


def _attributes(data: Iterable[Mapping[str, Any]]) -> str:
    """Return the names of all attributes that edges have, as a clause of an error message."""
    names = sorted({name for row in data for name in row if isinstance(name, str)})
    return f"; edges have {', '.join(map(shown, names[:12]))}{', ...' if len(names) > 12 else ''}" if names else ""


def _type_of(graph: object) -> str:
    cls = type(graph)
    return f"an object of {cls.__module__}.{cls.__qualname__}" if cls.__module__ != "builtins" else shown(graph)


MAX_INDEX = 2**31 - 2  # nodes and arcs are counted in 32 bits
MAX_SUM = 2**59  # so that a path cost, a bound of its remaining cost and two more arcs fit a key of 62 bits


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

    @classmethod
    def none(cls, criteria: int) -> AddedArcs:
        """Return an empty set of arcs, for a graph with this number of costs."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, criteria), np.int64))


def integers(values: ArrayLike, name: str, dtype: Any) -> NDArray[Any]:
    """Return whole numbers as a contiguous array of a dtype; raise GraphError for values that are no such numbers.

    A contiguous read-only array of this dtype is returned as it is; other values are copied.
    """
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
        beyond = array.max() if array.max() > largest else array.min()
        raise GraphError(f"each number of {name} must be from {-largest} to {largest}, got {beyond}")
    if array.dtype == dtype and array.flags.c_contiguous and not array.flags.writeable:
        return array
    return np.array(array, dtype, order="C")


def make_read_only(*arrays: NDArray[Any]) -> None:
    """Mark new arrays as read-only, so that Graph takes them without a copy."""
    for array in arrays:
        array.setflags(write=False)


def stable_order(nodes: IntArray) -> NDArray[np.int32]:
    """Return the stable order that sorts node numbers, by two fast radix sorts of their 16-bit halves."""
    order = np.argsort((nodes & 0xFFFF).astype(np.uint16), kind="stable").astype(np.int32)
    if nodes.max() > 0xFFFF:
        order = order[np.argsort((nodes[order] >> 16).astype(np.uint16), kind="stable")]
    return order


def check_range(nodes: IntArray, n: int, name: str) -> None:
    """Raise GraphError if a node of an array (m,) is not from 0 to n - 1; ``name`` is the name of the array."""
    if len(nodes) and (nodes.min() < 0 or nodes.max() >= n):
        at = int(np.flatnonzero((nodes < 0) | (nodes >= n))[0])
        raise GraphError(f"{name} must be nodes from 0 to {n - 1}, got {nodes[at]} at arc {at}")


def aggregates_of(aggregates: Sequence[str] | None, costs: IntArray) -> tuple[str, ...]:
    """Return the kinds of costs as a tuple; by default all costs (m, k) are sums."""
    if aggregates is None:
        return ("sum",) * (costs.shape[1] if costs.ndim == 2 else 0)
    return (aggregates,) if isinstance(aggregates, str) else tuple(aggregates)


def check_sums(graph: Graph) -> None:
    """Raise GraphError if a cost of a path that leaves each node at most once could exceed MAX_SUM."""
    leaving = graph.indptr[:-1][np.diff(graph.indptr) > 0]
    for j, aggregate in enumerate(graph.aggregates):
        worst = int(graph.largest[j])
        bound = worst * (len(leaving) + 2 if aggregate == "sum" else 1)
        if bound > MAX_SUM and worst <= MAX_SUM and aggregate == "sum":
            steps = np.maximum.reduceat(graph.costs[:, j], leaving)
            bound = sum(steps.tolist()) + 2 * worst
        if bound > MAX_SUM:
            raise GraphError(
                f"cost {j} of a path must stay below {MAX_SUM}, but could reach {bound}; use a coarser quantum"
            )
