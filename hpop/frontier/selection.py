"""What an index other than a row selects of a front: a slice of its rows, or a mask."""

from __future__ import annotations

from typing import Any

import numpy as np

from hpop.base.text import shown
from hpop.frontier.dominance import BoolArray

WAYS = "index a front by a row, a slice such as [:5], or a boolean mask (n,) such as front.costs[:, 0] <= 5"


def kept(index: Any, size: int) -> tuple[BoolArray, str]:
    """Which of so many rows (n,) an index selects, and how in words.

    Raises TypeError for what is no index, IndexError for a mask of another length or a slice that goes backwards.

    >>> kept(slice(1, None), 3)
    (array([False,  True,  True]), 'rows 1:')
    """
    if isinstance(index, slice):
        if index.step is not None and index.step < 0:
            raise IndexError("the points of a front keep their order; take reversed(list(front)) for another")
        mask = np.zeros(size, dtype=np.bool_)
        mask[index] = True
        ends = ["" if end is None else str(end) for end in (index.start, index.stop, index.step)]
        return mask, f"rows {':'.join(ends[: 2 + bool(ends[2])])}"
    try:
        mask = np.asarray(index)
    except ValueError:  # rows of several lengths
        mask = np.zeros((0, 0), dtype=np.bool_)
    if mask.dtype != np.bool_ or mask.ndim != 1:
        raise TypeError(f"{WAYS}; got {shown(index)}")
    if mask.size != size:
        raise IndexError(f"a mask says yes or no to each of {size:,} points, got one of length {mask.size:,}")
    return mask, "a mask"
