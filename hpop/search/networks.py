"""Conversion of networkx graphs to arrays: arcs with costs in whole quanta, and labels of nodes."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import is_number, python_value, shown
from hpop.errors import GraphError, did_you_mean
from hpop.frontier import default_quanta

if TYPE_CHECKING:
    import networkx as nx

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


def is_network(graph: object) -> bool:
    """Return whether an object is a networkx graph, without importing networkx."""
    return any(cls.__module__.partition(".")[0] == "networkx" for cls in type(graph).__mro__)


def network_arrays(
    g: nx.Graph[Any], costs: Sequence[str], quanta: Mapping[str, float] | Sequence[float] | None = None
) -> NetworkArrays:
    """Convert a networkx graph to arrays. An undirected edge becomes two arcs, and parallel edges stay apart.

    costs   names of the edge attributes that are the costs
    quanta  value of one count of each cost, as in :meth:`.Graph.from_networkx`

    Raises GraphError for an object of another type, a missing attribute, and invalid costs or quanta.
    """
    if not is_network(g):
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
