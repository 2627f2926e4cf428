"""The array types that signatures use, and small checks that they share."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]  #: A NumPy array of float64.
IntArray = NDArray[np.int64]  #: A NumPy array of int64.
BoolArray = NDArray[np.bool_]  #: A NumPy array of bool.
#: A column of a batch: a NumPy array of shape (M,), or the CasADi symbols that stand for one.
Column = Any
N = TypeVar("N", bound=np.generic)


def distinct(values: NDArray[N]) -> NDArray[N]:
    """Return the distinct values, sorted.

    `numpy.unique` gives the same, but where it is asked for nothing else it imports NumPy's masked arrays, a sixtieth
    of a second, to make sure that there are none.

    >>> distinct(np.array([[3, 1], [1, 2]]))
    array([1, 2, 3])
    """
    found: NDArray[N] = np.unique(values, return_counts=True)[0]
    return found


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy, so that a frozen value stays what it was."""
    copy = np.array(array)
    copy.setflags(write=False)
    return copy
