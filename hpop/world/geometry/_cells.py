"""Compiled loop that looks points up in occupancy cells. Imported on first use, because importing numba takes long."""

from __future__ import annotations

from hpop.base.arrays import BoolArray, FloatArray
from hpop.runtime.compiled import lean


@lean
def inside_cells(
    cells: BoolArray, xs: FloatArray, ys: FloatArray, x: FloatArray, y: FloatArray, out: BoolArray
) -> None:
    """Write to out (M,) whether each point is strictly inside the free region: all cells that touch it are free.

    xs (W + 1,) and ys (H + 1,) are the coordinates, m, of the lines between columns and between rows.
    """
    rows, columns = cells.shape
    across, up = columns / (xs[columns] - xs[0]), rows / (ys[rows] - ys[0])
    for n in range(x.size):
        out[n] = False
        if not (xs[0] < x[n] < xs[columns] and ys[0] < y[n] < ys[rows]):
            continue
        column = min(max(int((x[n] - xs[0]) * across), 0), columns - 1)
        while xs[column] > x[n]:
            column -= 1
        while xs[column + 1] <= x[n]:
            column += 1
        row = min(max(int((y[n] - ys[0]) * up), 0), rows - 1)
        while ys[row] > y[n]:
            row -= 1
        while ys[row + 1] <= y[n]:
            row += 1
        free = True
        for j in range(column - 1 if xs[column] == x[n] else column, column + 1):
            for i in range(row - 1 if ys[row] == y[n] else row, row + 1):
                free &= not cells[i, j]
        out[n] = free
