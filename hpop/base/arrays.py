"""Array types for signatures, and small functions on arrays and frozen dataclasses."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]  #: A NumPy array of float64.
IntArray = NDArray[np.int64]  #: A NumPy array of int64.
BoolArray = NDArray[np.bool_]  #: A NumPy array of bool.
#: A column of a batch: a NumPy array of shape (M,), or the CasADi symbols that stand for one.
Column = Any
N = TypeVar("N", bound=np.generic)
T = TypeVar("T")
SUMMED = 2**20  # values that :func:`running_sums` adds up in one step


def distinct(values: NDArray[N]) -> NDArray[N]:
    """Return the distinct values, sorted.

    `numpy.unique` does the same, but without further arguments it imports NumPy's masked arrays (a sixtieth of a
    second).

    >>> distinct(np.array([[3, 1], [1, 2]]))
    array([1, 2, 3])
    """
    unique: NDArray[N] = np.unique(values, return_counts=True)[0]
    return unique


def marked(mask: BoolArray) -> tuple[IntArray, ...]:
    """Return the indices along each axis at which a mask is True, as `numpy.nonzero` does, but much faster if few are.

    >>> [index.tolist() for index in marked(np.array([[False, True], [True, True]]))]
    [[0, 1, 1], [1, 0, 1]]
    """
    return np.unravel_index(np.flatnonzero(mask), mask.shape)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy of an array."""
    copy = np.array(array)
    copy.setflags(write=False)
    return copy


def copied(value: T, without: Collection[str] = (), **fields: Any) -> T:
    """Return a copy of a frozen dataclass with some fields replaced.

    Unlike `dataclasses.replace`, the copy skips ``__post_init__`` and keeps cached properties, which saves time if the
    new fields do not affect them.

    Parameters
    ----------
    without : names of cached properties that depend on the new fields; they are computed again
    fields : the new values by field name
    """
    copy = object.__new__(type(value))
    copy.__dict__.update({name: part for name, part in vars(value).items() if name not in without}, **fields)
    return copy


def inserted(values: NDArray[N], before: IntArray, rows: NDArray[N]) -> NDArray[N]:
    """Return an array (m, ...) with new rows (j, ...) inserted before the rows with indices ``before`` (j,), ascending.

    >>> inserted(np.array([1, 2, 3]), np.array([1, 1, 3]), np.array([7, 8, 9])).tolist()
    [1, 7, 8, 2, 3, 9]
    """
    cuts, first, counts = np.unique(before, return_index=True, return_counts=True)
    parts, begin = list[NDArray[N]](), 0
    for cut, row, count in zip(cuts.tolist(), first.tolist(), counts.tolist(), strict=True):
        parts += [values[begin:cut], rows[row : row + count].astype(values.dtype, copy=False)]
        begin = cut
    return np.concatenate([*parts, values[begin:]])


def tiled(values: NDArray[N], layers: int, step: int = 0) -> NDArray[N]:
    """Return an array (m,) repeated ``layers`` times, with l * ``step`` added to repetition l.

    >>> tiled(np.array([1, 2]), 2, 5).tolist()
    [1, 2, 6, 7]
    """
    offsets = step * np.arange(layers, dtype=values.dtype)
    return np.asarray(np.add.outer(offsets, values), dtype=values.dtype).ravel()


def inserted_in_layers(
    values: NDArray[N], layers: int, before: IntArray, rows: NDArray[N], step: int = 0
) -> NDArray[N]:
    """Return the result of :func:`inserted` for an array that is first repeated, as by :func:`tiled`.

    >>> inserted_in_layers(np.array([1, 2]), 2, np.array([1, 2]), np.array([7, 8]), 10).tolist()
    [1, 7, 2, 8, 11, 12]
    """
    if layers == 1:
        return inserted(values, before, rows)
    size, places = len(values), before + np.arange(before.size)
    merged = np.empty((layers * size + before.size, *values.shape[1:]), values.dtype)
    is_old = np.ones(len(merged), dtype=np.bool_)
    merged[places], is_old[places] = rows, False
    for layer in range(layers):
        first, last = layer * size, (layer + 1) * size - 1
        part = slice(first + np.searchsorted(before, first, "right"), last + np.searchsorted(before, last, "right") + 1)
        merged[part][is_old[part]] = np.add(values, values.dtype.type(layer * step))
    return merged


def numbered(counts: IntArray) -> tuple[IntArray, IntArray]:
    """Return the group of each element and its index within the group, for consecutive groups of sizes ``counts``.

    >>> [column.tolist() for column in numbered(np.array([2, 0, 3]))]
    [[0, 0, 2, 2, 2], [0, 1, 0, 1, 2]]
    """
    group = np.repeat(np.arange(counts.size), counts)
    return group, np.arange(group.size) - np.repeat(np.cumsum(counts) - counts, counts)


def running_sums(steps: FloatArray, sizes: IntArray) -> FloatArray:
    """Return the cumulative sums (N,) of ``steps`` (N,), which begin again at 0 in each of n stretches.

    sizes  (n,)  number of steps of each stretch

    >>> running_sums(np.array([1.0, 2.0, 3.0]), np.array([2, 0, 1])).tolist()
    [1.0, 3.0, 3.0]
    """
    running = np.empty(steps.size)
    ends = np.append(0, np.cumsum(sizes))
    at_once = max(1, SUMMED // max(1, int(sizes.max(initial=0))))
    for begin in range(0, sizes.size, at_once):
        own = sizes[begin : begin + at_once]
        part = slice(ends[begin], ends[begin + own.size])
        inside = np.arange(own.max()) < own[:, None]
        rows = np.zeros(inside.shape)
        rows[inside] = steps[part]
        running[part] = np.cumsum(rows, axis=1)[inside]
    return running
