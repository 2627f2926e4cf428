"""A time-dependent graph: costs of arcs, and whether arcs are open, depend on the tick of departure.

Time is counted in ticks from 0, the earliest departure from the source. From the horizon H on nothing changes: the last
column of every table, column H, is for departures at H and at any later tick.

**Standing** at a place from tick t1 to t2 has the cost W(t1, t2). A rate is the cost of standing for one tick.

- A cost that is a sum: W(t1, t2) = Omega(t2) - Omega(t1), where Omega(t) is the cost of standing from tick 0 to t. Up
  to H, Omega is the table of this cost in `standing`. Then Omega(t) = Omega(H) + floor((t - H) rate / 2^20): `rate` is
  in units of 2^-20 quanta. Without a table, Omega(t) = floor(t rate / 2^20).
- A cost that is a maximum: W(t1, t2) is the largest rate of the ticks t1 to t2 - 1.

**An arc** a = (u, v) with departure at tick t arrives at t + d_a. Its cost j is the entry of its table, if it has one,
otherwise its static cost. An arc that `stays`, such as a turn in place, also costs standing at its place meanwhile. For
each cost j with a table in `standing`, W(t', t' + d_a) is added, where t' = min(t, H); of a maximum, the larger of both
counts. At all ticks from H on, t' is H, so the arc has its cost at H.

**A hold**, a pause at a node from t1 to t2, costs W(t1, t2) at its place. It lasts at least `hold` ticks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, IntArray
from hpop.base.options import whole
from hpop.base.text import shown
from hpop.errors import GraphError
from hpop.runtime.limits import Status
from hpop.search.graph import Graph
from hpop.search.networks import MAX_SUM
from hpop.search.queries import SearchStats

MAX_TICKS = 2**20  # longest arc, hold and horizon: fourteen hours with ticks of 1/20 s
RATE_BITS = 20
MAX_PRODUCT = 2**62  # largest product of a rate and a number of ticks
RATE = 2**RATE_BITS  # the rate of one quantum of cost for each tick
LEFT_OUT: Any = None


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class TimedGraph:
    """Time-dependent graph: arcs take time, and costs depend on the tick of departure.

    The rules for arcs and holds are in :mod:`.timed.graph`.

    graph       n nodes, m arcs sorted by tail, static costs (m, k); indices of arcs below refer to its arrays
    durations   (m,) int32        duration of each arc, ticks, at least 1
    horizon     H                 tables have H + 1 columns, the last for H and later ticks
    timed       (q,) int32        arcs whose costs or closures depend on the tick, rising
    rows        (q,) int32        row of each timed arc in the tables below; arcs that are alike may share a row
    costs       {j: (r, H + 1)}   int64 or int32, cost j of a timed arc by tick; costs left out are static
    blocked     (r, H + 1) bool   ticks at which a timed arc is closed for departures
    place       (n,) int32        place of each node; nodes of one place share the costs of standing there
    stays       (m,) bool         arcs within a place, which cost their static cost and the cost of standing meanwhile
    standing    {j: (P, H + 1)}   int64, quanta: for a sum, Omega(t), the cost of standing from tick 0 to t, which never
                                  falls; for a maximum, the rate during [t, t + 1)
    rate        (P, k) int64      cost of standing for each tick, if there is no table, or after its end H: for a sum in
                                  units of 2^-20 quanta, for a maximum without a table in quanta
    cut         (P, H + 1) bool   ticks, [t, t + 1), during which the robot must not stand at the place: they end holds
                                  and block arcs that stay; timed arcs have `blocked` instead
    hold        least duration of a hold, ticks; None: no holds
    arrive_by   latest tick of an arrival; None: any

    Read-only, contiguous arrays of these types are used without a copy. By default there are no timed arcs and no cuts,
    each timed arc has its own row, each node has its own place, and standing costs nothing.

    Raises GraphError for tables that do not fit together.

    >>> graph = Graph.from_arcs(2, [0], [1], [[3, 1]])
    >>> TimedGraph(graph, [4], 2, timed=[0], costs={1: [[9, 9, 0]]}, hold=1)
    <TimedGraph: 2 nodes, 1 arcs, 2 costs (sum, sum), 1 arcs timed up to tick 2>
    """

    graph: Graph
    durations: NDArray[np.int32]
    horizon: int
    timed: NDArray[np.int32] = LEFT_OUT
    costs: Mapping[int, NDArray[Any]] = field(default_factory=dict)
    blocked: BoolArray = LEFT_OUT
    place: NDArray[np.int32] = LEFT_OUT
    stays: BoolArray = LEFT_OUT
    standing: Mapping[int, IntArray] = field(default_factory=dict)
    rate: IntArray = LEFT_OUT
    cut: BoolArray = LEFT_OUT
    hold: int | None = None
    arrive_by: int | None = None
    rows: NDArray[np.int32] = LEFT_OUT

    def __post_init__(self) -> None:
        if not isinstance(self.graph, Graph):
            raise GraphError(f"graph must be a Graph of hpop.search, got {shown(self.graph)}")
        n, m, k = self.graph.nodes, self.graph.arcs, self.graph.criteria
        horizon = whole("horizon", self.horizon, 0, MAX_TICKS, "ticks", error=GraphError)
        width = horizon + 1
        kept: dict[str, Any] = {"horizon": horizon}
        kept["durations"] = _table(self.durations, "durations", np.int32, (m,), least=1, most=MAX_TICKS)
        timed = [] if self.timed is None else self.timed
        timed = kept["timed"] = _table(timed, "timed", np.int32, (None,), most=m - 1)
        if (np.diff(timed) <= 0).any():
            raise GraphError("timed must list indices of arcs in rising order, each once; sort it with np.unique")
        q = rows = len(timed)
        if self.rows is None:
            kept["rows"] = _read_only(np.arange(q, dtype=np.int32))
        else:
            tables = [*self.costs.values(), *([] if self.blocked is None else [self.blocked])]
            rows = len(tables[0]) if tables else q
            kept["rows"] = _table(self.rows, "rows", np.int32, (q,), most=rows - 1)
        kept["costs"] = {
            j: _table(table, f"costs[{j}]", None, (rows, width), most=MAX_SUM) for j, table in _columns(self.costs, k)
        }
        kept["blocked"] = _flags(self.blocked, "blocked", (rows, width))
        place = kept["place"] = (
            _read_only(np.arange(n, dtype=np.int32))
            if self.place is None
            else _table(self.place, "place", np.int32, (n,))
        )
        places = int(place.max()) + 1
        if self.rate is not None:
            places = len(_table(self.rate, "rate", np.int64, (None, k), most=MAX_SUM))
        kept["rate"] = (
            _read_only(np.zeros((places, k), np.int64))
            if self.rate is None
            else _table(self.rate, "rate", np.int64, (places, k), most=MAX_SUM)
        )
        if place.max() >= places:
            raise GraphError(f"place must be from 0 to {places - 1}, as rate has {places} rows, got {place.max()}")
        kept["standing"] = {
            j: _table(table, f"standing[{j}]", np.int64, (places, width), most=MAX_SUM)
            for j, table in _columns(self.standing, k)
        }
        for j, table in kept["standing"].items():
            if self.graph.aggregates[j] == "sum" and (np.diff(table, axis=1) < 0).any():
                raise GraphError(
                    f"standing[{j}] must not fall from tick to tick: for cost {j}, column t has the cost of standing "
                    "from tick 0 to tick t; pass running sums that begin with 0, not the costs of single ticks"
                )
        kept["cut"] = _flags(self.cut, "cut", (places, width))
        stays = kept["stays"] = _flags(self.stays, "stays", (m,))
        if stays[timed].any():
            both = timed[stays[timed]][0]
            raise GraphError(f"an arc must not be both in timed and in stays, got arc {both}; leave it out of either")
        heads = self.graph.heads
        tails = np.repeat(np.arange(n), np.diff(self.graph.indptr))
        if (moving := np.flatnonzero(stays & (place[tails] != place[heads]))).size:
            raise GraphError(
                f"a stay (an arc marked in stays) must begin and end at nodes of one place, but arc {moving[0]} does "
                "not; correct place or stays"
            )
        for name, least in (("hold", 1), ("arrive_by", 0)):
            given = getattr(self, name)
            kept[name] = None if given is None else whole(name, given, least, MAX_TICKS, "ticks", error=GraphError)
        for name, value in kept.items():
            object.__setattr__(self, name, value)
        self._check_sums()

    @property
    def places(self) -> int:
        """Number of places, P."""
        return len(self.rate)

    @cached_property
    def largest(self) -> IntArray:
        """Upper bound (k,) of each cost of any arc at any tick, including the cost of standing of an arc that stays."""
        most = self.graph.largest.copy()
        longest = int(self.durations.max(initial=0))
        for j, table in self.costs.items():
            most[j] = max(most[j], table.max(initial=0))
        for j, aggregate in enumerate(self.graph.aggregates):
            rate = int(self.rate[:, j].max(initial=0))
            if aggregate == "max":
                most[j] = max(most[j], rate, self.standing[j].max(initial=0) if j in self.standing else 0)
            elif j in self.standing:
                most[j] += int((self.standing[j][:, -1] - self.standing[j][:, 0]).max(initial=0))
                most[j] += (rate * longest >> RATE_BITS) + 1
        return most

    def _longest(self) -> int:
        """Return the longest duration of any arc, or the least duration of a hold if that is longer, ticks."""
        return max(int(self.durations.max(initial=1)), self.hold or 0)

    def _check_sums(self) -> None:
        """Raise GraphError if the costs of a path could overflow 64-bit integers.

        A path takes at most one arc per tick until H, and then passes no node twice.
        """
        for j, aggregate in enumerate(self.graph.aggregates):
            worst = int(self.largest[j])
            held = 2 * int(self.rate[:, j].max(initial=0)) * (self.horizon + (self.hold or 0)) >> RATE_BITS
            product = int(self.rate[:, j].max(initial=0)) * (self.horizon + self._longest())
            if aggregate == "sum" and product > MAX_PRODUCT:
                raise GraphError(
                    f"rate of cost {j}, in 2^-20 quanta per tick, times the ticks until the horizon must not exceed "
                    f"{MAX_PRODUCT}, got {product}; use a coarser quantum"
                )
            bound = worst if aggregate == "max" else worst * (self.graph.nodes + self.horizon + 2) + held
            if bound > MAX_SUM:
                raise GraphError(
                    f"cost {j} of a path must stay below {MAX_SUM}, but could reach {bound}; use a coarser quantum"
                )

    def __repr__(self) -> str:
        costs = f"{self.graph.criteria} costs ({', '.join(self.graph.aggregates)})"
        size = f"{self.graph.nodes:,} nodes, {self.graph.arcs:,} arcs, {costs}"
        return f"<TimedGraph: {size}, {len(self.timed):,} arcs timed up to tick {self.horizon}>"


def _columns(tables: Any, k: int) -> list[tuple[int, Any]]:
    """Return the tables of an argument as pairs (column, table), sorted by column.

    Raises GraphError if the argument is no mapping from columns to tables, or has a column that the graph lacks.
    """
    if not isinstance(tables, Mapping):
        raise GraphError(f"costs and standing must map the column of a cost to its table, got {shown(tables)}")
    return [
        (whole("the column of a table", j, 0, k - 1, "a cost's", error=GraphError), tables[j]) for j in sorted(tables)
    ]


def _table(
    values: ArrayLike, name: str, dtype: Any, shape: tuple[int | None, ...], least: int = 0, most: int = 2**31 - 1
) -> NDArray[Any]:
    """Return a read-only array of integers from ``least`` to ``most``; raise GraphError for other values or shapes.

    Without a dtype, an int32 array stays as it is and other arrays become int64.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise GraphError(f"{name} must be an array of integers: {error}") from None
    if array.size == 0 and len(shape) == 1 and shape[0] in (0, None):
        array = np.zeros(0, np.int32)
    if array.dtype.kind not in "iu" and array.size:
        raise GraphError(f"{name} must be integers, got {array.dtype}: choose a quantum and quantise first")
    if array.ndim != len(shape) or any(s is not None and s != a for s, a in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if s is None else f"{s:,}" for s in shape)
        raise GraphError(f"{name} must have the shape ({wanted}), got {array.shape}")
    if array.size and (array.min() < least or array.max() > most):
        raise GraphError(f"{name} must be from {least} to {most:,}, got {array.min()} to {array.max()}")
    if dtype is None:
        dtype = np.int32 if array.dtype == np.int32 else np.int64
    return _as_read_only(array, dtype)


def _flags(values: Any, name: str, shape: tuple[int, ...]) -> BoolArray:
    """Return ``values`` as a read-only array of booleans, all False if ``values`` is None.

    Raises GraphError for other types, or if the shape is not ``shape``.
    """
    if values is None:
        return _read_only(np.zeros(shape, np.bool_))
    array = np.asarray(values)
    if array.size and array.dtype != np.bool_:
        raise GraphError(f"{name} must be booleans, got {array.dtype}")
    if array.shape != shape:
        raise GraphError(f"{name} must have the shape {shape}, got {array.shape}")
    return _as_read_only(array, np.bool_)


def _as_read_only(array: NDArray[Any], dtype: Any) -> NDArray[Any]:
    if array.dtype == dtype and array.flags.c_contiguous and not array.flags.writeable:
        return array
    return _read_only(np.array(array, dtype, order="C"))


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array


HOLD = -1


class PathSteps(NamedTuple):
    """The s steps of a path in order: arcs and holds.

    nodes       (s + 1,)  nodes from source to target; a hold repeats its node
    arcs        (s,)      index of each arc in the caller's numbering (`graph.arc`), -1 for a hold
    departures  (s + 1,)  tick at which each step begins; the last entry is the tick of arrival
    """

    nodes: IntArray
    arcs: IntArray
    departures: IntArray


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class TimedPaths:
    """Result of a search on a time-dependent graph: the non-dominated cost vectors, each with one path.

    costs   (n, k)  int64  rows in lexicographic order
    status  COMPLETE, NO_PATH, or the limit that stopped the search
    stats   statistics of the search
    gap     relative: for every missing vector p there is a returned r <= (1 + gap) p + tolerance; inf if unknown
    asked   text for the certificate: tolerance and bounds of the query
    begin   tick at which paths leave the source, or begin to hold there
    """

    costs: IntArray
    status: Status
    stats: SearchStats
    _graph: TimedGraph
    _source: int
    _paths: tuple[tuple[IntArray, IntArray], ...]
    gap: float = field(default=0.0, kw_only=True)
    asked: str = field(default="", kw_only=True)
    begin: int = field(default=0, kw_only=True)

    def __len__(self) -> int:
        return len(self.costs)

    @property
    def places(self) -> tuple[tuple[IntArray, IntArray], ...]:
        """For each path, the indices of its arcs in the graph's arrays, and the ticks of their departures."""
        return self._paths

    def steps(self, i: int) -> PathSteps:
        """Return the arcs and holds of path i, with nodes and departures."""
        arcs, leaves = self._paths[i]  # arcs without holds, and their departures
        source = np.array([self._source], np.int64)
        ends = leaves + self._graph.durations[arcs]
        ready = np.append(self.begin, ends[:-1])[: len(arcs)]
        held = np.flatnonzero(leaves > ready)
        arrival = ends[-1:] if len(arcs) else np.array([self.begin], np.int64)
        nodes = np.concatenate([source, self._graph.graph.heads[arcs].astype(np.int64)])
        return PathSteps(
            np.insert(nodes, held, nodes[held]),
            np.insert(self._graph.graph.arc[arcs].astype(np.int64), held, HOLD),
            np.append(np.insert(leaves, held, ready[held]), arrival),
        )

    def arrival(self, i: int) -> int:
        """Return the tick at which path i arrives."""
        return int(self.steps(i).departures[-1])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self):,} of {self.costs.shape[1]} costs; {self.status}>"
