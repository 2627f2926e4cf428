"""Arrays of a search graph: added arcs, and checks and conversions of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arrays import IntArray
from hpop.errors import GraphError

if TYPE_CHECKING:
    from hpop.search.graph import Graph

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
        """Return no arcs, of a graph with this number of costs."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, criteria), np.int64))


def integers(values: ArrayLike, name: str, dtype: Any) -> NDArray[Any]:
    """Return whole numbers as a contiguous array, copied unless read-only and of this dtype; else raise GraphError."""
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
