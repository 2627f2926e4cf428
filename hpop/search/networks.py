"""Networks of a user's own: the edges of a networkx graph as rows, their costs as whole quanta.

networkx keeps names and attributes, and whatever else a user wants of a graph; a search takes arrays. What is here
reads the one into the other, and remembers the edges, so that paths come back in their words.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.scalars import is_number, python_value
from hpop.base.text import shown
from hpop.errors import GraphError, did_you_mean
from hpop.frontier import default_quanta

if TYPE_CHECKING:
    import networkx as nx

WHOLE = 1e-6  # of a quantum: so much above a whole number is still that number
MOST_QUANTA = 2**53  # of one edge: beyond, float64 does not tell one quantum from the next
Edge = tuple[Hashable, ...]


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges that the arcs of a graph were made of, and their costs as they were given.

    ends    E       (tail, head), of a multigraph (tail, head, key): what `g.edges[...]` takes
    names   k       attributes that are the costs
    values  (E, k)  as given: int64 if all of them are whole numbers, else float64
    quanta  (k,)    what the whole numbers of the graph count, in the units of the values
    """

    ends: tuple[Edge, ...]
    names: tuple[str, ...]
    values: FloatArray | IntArray
    quanta: FloatArray


class Network(NamedTuple):
    """A networkx graph in arrays: names of nodes, arcs (m,), the edge of each, whole costs (m, k), and the edges."""

    labels: tuple[Hashable, ...]
    tails: IntArray
    heads: IntArray
    edge: IntArray
    costs: IntArray
    edges: Edges


def is_network(graph: object) -> bool:
    """Whether something is a graph of networkx, without importing that for others."""
    return any(cls.__module__.partition(".")[0] == "networkx" for cls in type(graph).__mro__)


def network(
    g: nx.Graph[Any], costs: Sequence[str], quanta: Mapping[str, float] | Sequence[float] | None = None
) -> Network:
    """Read a networkx graph; an undirected edge becomes two arcs, each of several parallel edges an arc of its own.

    Raises GraphError for another graph, an attribute that an edge lacks, and what is no cost or no quantum.
    """
    if not is_network(g):
        raise GraphError(
            f"expected a networkx graph, got {_article(g)}; Graph.from_arcs(n, tails, heads, costs) takes arrays of any"
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
    return Network(labels, tails, heads, edge, counts, Edges(ends, names, values, steps))


def _names(costs: Sequence[str], data: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    names = (costs,) if isinstance(costs, str) else tuple(costs) if isinstance(costs, Iterable) else ()
    if not names or len(set(names)) < len(names) or not all(isinstance(name, str) for name in names):
        raise GraphError(
            f"costs names the attributes of edges to minimise, such as costs=['length', 'risk'], none twice, got "
            f"{shown(costs) if costs else 'none'}{_there(data)}"
        )
    return names


def _column(name: str, ends: Sequence[Edge], data: Sequence[Mapping[str, Any]]) -> FloatArray | IntArray:
    """One attribute of all edges (E,), checked: finite numbers, none below zero."""
    found = [python_value(row.get(name)) for row in data]
    lacking = [place for place, value in enumerate(found) if value is None]
    if lacking:
        known = {other for row in data for other in row if isinstance(other, str)}
        many = f"{len(lacking):,} of {len(ends):,} edges have" if len(lacking) > 1 else "one edge has"
        raise GraphError(
            f"{many} no attribute {shown(name)}, the first is {_said(ends[lacking[0]])}{_there(data)}."
            f"{did_you_mean(name, known - {name})}"
        )
    for place, value in enumerate(found):
        if not isinstance(value, Real) or not math.isfinite(value) or value < 0:
            raise GraphError(
                f"costs must be finite numbers of at least 0, got {shown(value)} as {shown(name)} of "
                f"{_said(ends[place])}{'; shift or flip what is to be maximised' * (_is_negative(value))}"
            )
    whole = all(isinstance(value, int) for value in found)
    try:
        return np.array(found, np.int64) if whole else np.array([float(cast(Real, value)) for value in found])
    except OverflowError:
        raise GraphError(f"{shown(name)} is beyond 64 bits on some edge; give it in a larger unit") from None


def _quanta(
    quanta: Mapping[str, float] | Sequence[float] | None, names: tuple[str, ...], columns: Sequence[NDArray[Any]]
) -> FloatArray:
    """The quantum (k,) of each cost: as given, or else what its values suggest."""
    own = {
        name: 1.0 if column.dtype.kind == "i" else float(default_quanta(column[:, None])[0])
        for name, column in zip(names, columns, strict=True)
    }
    given = quanta
    if given is not None and not isinstance(given, Mapping):
        listed = np.ndim(given) == 1 and len(given) == len(names)
        if not listed:
            raise GraphError(
                f"quanta has a step for each of {', '.join(names)}, or gives some by name, such as "
                f"{{{names[0]!r}: 0.01}}, got {shown(given)}"
            )
        given = dict(zip(names, given, strict=True))
    for name, quantum in (given or {}).items():
        if name not in own:
            raise GraphError(
                f"quanta has {shown(name)}, which is no cost here; these are {', '.join(names)}."
                f"{did_you_mean(name, names)}"
            )
        if not is_number(quantum) or not 0 < quantum < math.inf:
            raise GraphError(f"the quantum of {shown(name)} must be a positive finite number, got {shown(quantum)}")
        own[name] = float(quantum)
    return np.array([own[name] for name in names])


def _counts(name: str, column: NDArray[Any], quantum: float, ends: Sequence[Edge]) -> IntArray:
    """A column (E,) in whole quanta, rounded up."""
    if quantum == 1.0 and column.dtype.kind == "i":
        return column
    with np.errstate(over="ignore"):
        quotients = column / quantum
    if (beyond := np.flatnonzero(quotients > MOST_QUANTA)).size:
        place = int(beyond[0])
        raise GraphError(
            f"{shown(name)} of {_said(ends[place])} is {column[place]:.6g}, more quanta of {quantum:.6g} than float64 "
            "tells apart; use a coarser quantum"
        )
    counts: IntArray = np.ceil(quotients - WHOLE).astype(np.int64)
    return counts


def _is_negative(value: Any) -> bool:
    return isinstance(value, Real) and value < 0


def _said(edge: Edge) -> str:
    tail, head, *key = edge
    return f"edge {shown(tail)} - {shown(head)}{''.join(f' (key {shown(one)})' for one in key)}"


def _there(data: Iterable[Mapping[str, Any]]) -> str:
    """Which attributes edges have, for a message."""
    known = sorted({name for row in data for name in row if isinstance(name, str)})
    return f"; edges have {', '.join(map(shown, known[:12]))}{', ...' * (len(known) > 12)}" if known else ""


def _article(graph: object) -> str:
    cls = type(graph)
    return f"an object of {cls.__module__}.{cls.__qualname__}" if cls.__module__ != "builtins" else shown(graph)
