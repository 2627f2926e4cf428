"""Checks and conversions of the arrays of a search graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arrays import IntArray
from hpop.errors import GraphError

MAX_INDEX = 2**31 - 2  # nodes and arcs are counted in 32 bits
MAX_SUM = 2**59  # so that a path cost, a bound of its remaining cost and two more arcs fit a key of 62 bits


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
