"""Occupied cells as few rectangles, each as wide as it goes and then as high: what is drawn of a raster."""

from __future__ import annotations

from typing import cast

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import kernel


def boxes(cells: BoolArray) -> IntArray:
    """Rectangles (B, 4) that cover each True cell (H, W) once and no other: column and row, first and beyond the last.

    >>> boxes(np.array([[True, True, False], [True, True, True]])).tolist()
    [[0, 0, 2, 2], [2, 1, 3, 2]]
    """
    return cast(IntArray, _boxes(np.array(cells, dtype=np.bool_)))


@kernel
def _boxes(cells):  # type: ignore[no-untyped-def]
    """Greedy: the first cell that is left, as far as its row goes on, then row by row; ``cells`` is used up."""
    rows, columns = cells.shape
    found = np.empty((64, 4), np.int64)
    count = 0
    for row in range(rows):
        column = 0
        while column < columns:
            if not cells[row, column]:
                column += 1
                continue
            end = column + 1
            while end < columns and cells[row, end]:
                end += 1
            top = row + 1
            while top < rows and cells[top, column:end].all():
                top += 1
            cells[row:top, column:end] = False
            if count == len(found):
                grown = np.empty((2 * count, 4), np.int64)
                grown[:count] = found
                found = grown
            found[count] = column, row, end, top
            count += 1
            column = end
    return found[:count].copy()
