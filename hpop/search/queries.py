"""Checks of the arguments that all searches take (graph, nodes, bounds, precision), and their result."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, cast

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import MOST_COUNTED, amounts, whole
from hpop.base.text import python_value, shown
from hpop.errors import GraphError, OptionError, QueryError, did_you_mean
from hpop.frontier import ItemFront
from hpop.runtime.limits import Budget, Status
from hpop.search.graph import Graph
from hpop.search.machinery import ANYTHING, Precision
from hpop.search.networks import WHOLE, unknown_label

UNLIMITED = Budget()


@dataclass(frozen=True)
class SearchStats:
    """Statistics of a search.

    method            "staircase", "general", "capped mean", "weighted sum" or "timed"; "auto" if a limit came before
                      the choice
    order             columns of the costs, in the order in which the search compares them
    labels_generated  count  labels (partial paths) put into the queue
    labels_expanded   count  labels taken out of the queue and extended
    labels_open       count  labels in the queue at the end
    peak_memory       bytes  largest size of the search's arrays
    seconds_bounds    s      time for the lower bounds
    seconds_search    s      time for the search itself, with its tables
    seconds_compiled  s      time for compiling or loading kernels; 0 if they were in memory
    arcs_checked      count  arcs whose freedom a lazy search checked
    arcs_blocked      count  blocked arcs among them
    rounds            count  rounds of a lazy search, each on the graph without the arcs known to be blocked
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


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class ParetoPaths:
    """Result of a search: the non-dominated cost vectors, each with one path.

    costs   (n, k)  int64  columns as in the graph, rows in lexicographic order
    status  COMPLETE, NO_PATH, or the limit that stopped the search
    stats   statistics of the search
    gap     relative: for every missing vector p there is a returned r <= (1 + gap) p + tolerance; inf if unknown
    blocked (b,)  indices of the arcs that a lazy search found to be blocked
    asked   text for the certificate: tolerance and bounds of the query
    """

    KIND: ClassVar[str] = "all non-dominated vectors of paths"

    costs: IntArray
    status: Status
    stats: SearchStats
    _graph: Graph
    _source: int
    _paths: tuple[IntArray, ...]
    gap: float = field(default=0.0, kw_only=True)
    blocked: IntArray = field(default_factory=lambda: np.zeros(0, np.int64), kw_only=True)
    asked: str = field(default="", kw_only=True)

    def __len__(self) -> int:
        return len(self.costs)

    def select(self, costs: IntArray, rows: IntArray) -> ParetoPaths:
        """Return only the paths of the given rows, in that order, with their rows of ``costs`` (n, k) as new costs."""
        return replace(self, costs=costs[rows], _paths=tuple(self._paths[row] for row in rows))

    def on(self, graph: Graph) -> ParetoPaths:
        """Return the same paths on ``graph``, from which :meth:`.Graph.without` made the graph of this result."""
        return replace(self, _graph=graph, _paths=tuple(self._graph.arc[path].astype(np.int64) for path in self._paths))

    def and_those_of(self, other: ParetoPaths) -> ParetoPaths:
        """Return the paths of this result and then those of another on the same graph, also dominated ones."""
        return replace(self, costs=np.concatenate([self.costs, other.costs]), _paths=self._paths + other._paths)

    def nodes(self, i: int) -> IntArray:
        """Return the numbers of the nodes of path i, from source to target."""
        heads, _ = self._graph.ends_and_costs(self._paths[i])
        return np.append(np.array([self._source], np.int64), heads)

    def path(self, i: int) -> list[Hashable]:
        """Return the nodes of path i from source to target, as labels, or as numbers if the graph has no labels."""
        labels = self._graph.labels
        return [node if labels is None else labels[node] for node in self.nodes(i).tolist()]

    def edges(self, i: int) -> list[tuple[Hashable, ...]]:
        """Return the edges of path i as pairs (tail, head); in a multigraph as (tail, head, key), as in `g.edges`."""
        nodes, edges = self.path(i), self._graph.edges
        keys = [() if edges is None else edges.ends[arc][2:] for arc in self.arcs(i).tolist()]
        return [(tail, head, *key) for tail, head, key in zip(nodes[:-1], nodes[1:], keys, strict=True)]

    @property
    def values(self) -> FloatArray | IntArray:
        """Exact costs (n, k) of the paths in the units of the caller's edge attributes.

        `costs` are rounded up: times the quantum, they exceed a value by less than a quantum for each edge. If all
        attributes are whole numbers with the quantum 1, and for a graph without networkx edges, values equal `costs`.
        """
        edges = self._graph.edges
        if edges is None:
            return self.costs
        rows = [edges.values[self.arcs(i)] for i in range(len(self))]
        worst = np.array(self._graph.aggregates) == "max"
        measured = [np.where(worst, row.max(axis=0, initial=0), row.sum(axis=0)) for row in rows]
        table: Any = np.array(measured, edges.values.dtype)
        return cast(FloatArray | IntArray, table.reshape(self.costs.shape))

    def front(
        self, *, names: Sequence[str] | None = None, units: Sequence[str] | None = None
    ) -> ItemFront[list[Hashable]]:
        """Return the result as an ItemFront, to choose from and to save: costs are `values`, items are lists of nodes.

        Paths whose exact values are dominated are left out. There may be some, because roundings along a path can add
        up to more than a quantum.

        names  k  names of the costs; by default the attributes of a graph from networkx, or "f1", "f2", ...
        units  k  units of the costs; by default "1"
        """
        edges = self._graph.edges
        if names is None and edges is not None:
            names = edges.names
        return ItemFront.of(
            self.values,
            [self.path(i) for i in range(len(self))],
            names=names,
            units=units,
            quanta=np.ones(self.costs.shape[1]) if edges is None else edges.quanta,
            status=str(self.status),
            certificate=self._claim(),
        )

    def _claim(self) -> str:
        """Return the certificate: a sentence that says how complete the front is, and how costs were rounded."""
        edges = self._graph.edges
        kind = self.KIND if self.status.is_final else f"not complete: some of {self.KIND}"
        steps = "" if edges is None else ", ".join(f"{n} {q:g}" for n, q in zip(edges.names, edges.quanta, strict=True))
        rounded = f", costs rounded up edge by edge to quanta ({steps})" if steps else ""
        within = f"; what is missing is covered within the factor {1 + self.gap:.6g}" if self.gap else ""
        return f"{kind}{self.asked}{rounded}{within}"

    @property
    def lengths(self) -> IntArray:
        """Number (n,) of arcs of each path."""
        return np.array([path.size for path in self._paths], dtype=np.int64)

    @property
    def places(self) -> list[IntArray]:
        """Arcs of each path, as indices into the arrays of the graph (`arcs` gives the caller's indices)."""
        return list(self._paths)

    @property
    def all_arcs(self) -> IntArray:
        """Arcs (N,) of all paths, path after path, as indices into the arrays of the graph."""
        return np.concatenate([np.zeros(0, np.int64), *self._paths])

    def through(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Return the nodes (N,) of the paths in r given rows, path after path, and the count (r,) of nodes per path."""
        paths = [self._paths[row] for row in rows]
        sizes = np.array([path.size for path in paths], dtype=np.int64) + 1
        nodes = np.full(sizes.sum(), self._source, dtype=np.int64)
        heads = np.delete(np.arange(nodes.size), np.cumsum(sizes) - sizes)
        nodes[heads], _ = self._graph.ends_and_costs(np.concatenate([np.zeros(0, np.int64), *paths]))
        return nodes, sizes

    def suffixes(self, node: int) -> list[IntArray]:
        """Return for each path through a node its arcs from there on, as indices into the graph's arrays.

        Paths that do not pass the node have no entry.
        """
        suffixes = []
        for i, path in enumerate(self._paths):
            at = np.flatnonzero(self.nodes(i) == node)
            if at.size:
                suffixes.append(path[at[-1] :])
        return suffixes

    def arcs(self, i: int) -> IntArray:
        """Return the arcs of path i, as indices into the arcs or edges from which the caller built the graph."""
        return self._graph.arc[self._paths[i]].astype(np.int64)

    def __repr__(self) -> str:
        edges = self._graph.edges
        costs = f"{self.costs.shape[1]} costs" if edges is None else ", ".join(edges.names)
        return f"<{type(self).__name__}: {len(self):,} of {costs}; {self.status}{'' if len(self) else self.asked}>"


def costs_along(graph: Graph, paths: Sequence[IntArray]) -> IntArray:
    """Return the costs (n, k) of n paths, each given by the indices of its arcs; a path without arcs costs 0."""
    worst = np.array(graph.aggregates) == "max"
    costs = np.zeros((len(paths), graph.criteria), np.int64)
    for row, arcs in zip(costs, paths, strict=True):
        _, each = graph.ends_and_costs(arcs)
        row[:] = np.where(worst, each.max(axis=0, initial=0), each.sum(axis=0))
    return costs


def checked_graph(graph: Any) -> Graph:
    """Return the argument ``graph`` if it is a Graph of :mod:`hpop.search`; raise GraphError for any other object."""
    if not isinstance(graph, Graph):
        raise GraphError(
            f"graph must be a Graph of hpop.search, got {shown(graph)}; make one with Graph.from_networkx or "
            "Graph.from_arcs"
        )
    return graph


def checked_node(graph: Graph, node: Any, name: str) -> int:
    """Return the number of a node that a caller gives by its label, or by its number if the graph has no labels.

    Raises QueryError for an unknown node; ``name`` is the name of the argument in the message.
    """
    if graph.labels is None:
        hint = "only a graph from networkx has names"
        return whole(name, node, 0, graph.nodes - 1, "a node", hint=hint, error=QueryError)
    number = graph.number(python_value(node))
    if number is None:
        raise QueryError(f"{name}: {unknown_label(graph.labels, node)}")
    return number


def checked_targets(graph: Graph, target: Any) -> IntArray:
    """Return the sorted numbers (t,) of the targets, which a caller gives as one node or as several.

    Raises QueryError for an unknown node, and if no node is given.
    """
    target = python_value(target)
    if graph.number(target) is not None or isinstance(target, int | str):
        return np.array([checked_node(graph, target, "target")], np.int64)
    if isinstance(target, tuple) and graph.labels is not None and not any(graph.number(t) is not None for t in target):
        raise QueryError(
            f"target: {unknown_label(graph.labels, target)}"
        )  # a label that is a tuple, such as (row, column)
    try:
        numbers = {checked_node(graph, t, "target") for t in target}
    except TypeError:
        raise QueryError(f"target must be a node or several nodes, got {shown(target)}") from None
    if not numbers:
        raise QueryError("target must name at least one node, got none")
    return np.array(sorted(numbers), np.int64)


def bounds_of(graph: Graph, at_most: Any) -> tuple[int, ...]:
    """Return the upper bounds (k,) of the option `at_most` in whole quanta, ANYTHING for a cost without a bound.

    The result is () if no cost is bounded. Raises OptionError for invalid bounds.
    """
    values = _value_per_cost(graph, at_most, "at_most", "a whole number or None", None)
    name = f"at_most must be a whole number or None for each of {graph.criteria} costs: a bound"
    first = "" if graph.edges is None else graph.edges.names[0]
    hint = f"or give bounds by name, in units, such as {{{first!r}: 30.0}}" * bool(first)
    bounds = tuple(ANYTHING if b is None else min(whole(name, b, 0, 2**63 - 1, hint=hint), ANYTHING) for b in values)
    return bounds if any(b < ANYTHING for b in bounds) else ()


def precision_of(graph: Graph, eps: float, tolerance: Any) -> Precision:
    """Return the precision of a front from the options `eps` (relative) and `tolerance` (absolute, one for each cost).

    Raises OptionError for invalid values.
    """
    return Precision(eps, _value_per_cost(graph, tolerance, "tolerance", "a whole number", 0))


def query_text(graph: Graph, precision: Precision, at_most: tuple[int, ...]) -> str:
    """Return a text for the certificate that states the bounds and the tolerance of a query, "" if it has none."""
    names = graph.edges.names if graph.edges is not None else [f"cost {j}" for j in range(graph.criteria)]
    quanta = graph.edges.quanta.tolist() if graph.edges is not None else [1] * graph.criteria
    steps, bounds = precision.of(range(graph.criteria)).tolist(), at_most or [ANYTHING] * graph.criteria
    near = [f"{n} {s * q:.9g}" for n, s, q in zip(names, steps, quanta, strict=True) if s]
    within = [f"{n} {b * q:.9g}" for n, b, q in zip(names, bounds, quanta, strict=True) if b < ANYTHING]
    return f" of at most {', '.join(within)}" * bool(within) + f" within a tolerance of {', '.join(near)}" * bool(near)


def _value_per_cost(graph: Graph, values: Any, name: str, kind: str, missing: int | None) -> tuple[Any, ...]:
    """Return one whole number of quanta for each cost, from a list of them, or from amounts by the name of the cost.

    Amounts are rounded down to quanta. The entries of a list are not checked; an empty list gives ().

    name     name of the option, for messages
    kind     description of valid values, for messages
    missing  value for a cost that is not named
    """
    if isinstance(values, Mapping):
        if graph.edges is None:
            raise OptionError(
                f"{name} must be {kind} for each of {graph.criteria} costs, got values by name; the costs of this "
                "graph have no names, so give a list"
            )
        counts: dict[str, int | None] = dict.fromkeys(graph.edges.names, missing)
        for cost, amount in amounts(name, values, MOST_COUNTED).items():
            if cost not in counts:
                names = ", ".join(counts)
                raise OptionError(f"{name} must name costs ({names}), got {shown(cost)}.{did_you_mean(cost, counts)}")
            quantum = graph.edges.quanta[graph.edges.names.index(cost)]
            counts[cost] = min(math.floor(amount / quantum + WHOLE), 2**62)
        return tuple(counts.values())
    listed = isinstance(values, Sequence) and not isinstance(values, str)
    if not (listed or (isinstance(values, np.ndarray) and values.ndim)) or len(values) not in (0, graph.criteria):
        raise OptionError(f"{name} must be {kind} for each of {graph.criteria} costs, got {shown(values)}")
    return tuple(values)
