"""The array types that signatures use, and small checks that they share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
# A column of a batch: a NumPy array of shape (M,), or the CasADi symbols that stand for one.
Column = Any


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy, so that a frozen value stays what it was."""
    copy = np.array(array)
    copy.setflags(write=False)
    return copy
