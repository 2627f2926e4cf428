"""The cells of a grid on the shortest paths, which are searched first if the whole grid takes long.

Plain arrays, no robots. Imported on first use only, because importing numba takes a quarter of a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, distinct
from hpop.runtime.compiled import lean

STRAIGHT, DIAGONAL = 5, 7  # 7/5 is near enough to sqrt(2) for choosing cells
STEPS = DIAGONAL + 1
FAR = np.int64(2**30)  # longer than any path


def nearby(
    free: BoolArray, start: tuple[int, int], goal: tuple[int, int], most: int, *, corner_cutting: bool
) -> BoolArray | None:
    """Mark the free cells that lie on the shortest paths from start to goal; None if there is no path.

    Cells are taken by the length of the shortest path through them; ties go to those nearest to one shortest path,
    which is marked completely. Without corner cutting, the cells beside its diagonals are marked too.

    Parameters
    ----------
    free : (rows, columns) bool
    start, goal : (row, column) of free cells
    most : number of cells to mark, unless the path has more

    >>> nearby(np.ones((3, 5), bool), (0, 0), (0, 4), 7, corner_cutting=False).sum(axis=1).tolist()
    [5, 2, 0]
    """
    columns = free.shape[1]
    begin, end = (np.array([row * columns + column]) for row, column in (start, goal))
    there, before = spread(free, begin, corner_cutting)
    if there[end[0]] >= FAR:
        return None
    cells = [int(end[0])]
    while cells[-1] != begin[0]:
        cells.append(int(before[cells[-1]]))
    path = np.array(cells)
    if not corner_cutting:
        row, column = np.divmod(path, columns)
        path = distinct(np.concatenate([path, row[:-1] * columns + column[1:], row[1:] * columns + column[:-1]]))
    through = there + spread(free, end, corner_cutting)[0]
    aside, _ = spread(free, path, corner_cutting)
    through[path] = 0
    count = min(max(most, path.size), int((aside < FAR).sum()))
    marked = np.zeros(free.size, dtype=bool)
    marked[np.argpartition(through * FAR + aside, count - 1)[:count]] = True
    return marked.reshape(free.shape)


def spread(free: BoolArray, seeds: IntArray, corner_cutting: bool) -> tuple[IntArray, IntArray]:
    """Return the distance (rows * columns,) of each cell from the seeds, or FAR, and the cell before it, or -1."""
    distance = np.full(free.size, FAR)
    before = np.full(free.size, np.int64(-1))
    distance[seeds] = 0
    waiting = np.empty((STEPS, free.size), np.int32)
    filled = np.zeros(STEPS, np.int64)
    filled[0] = len(seeds)
    waiting[0, : len(seeds)] = seeds
    reach(free, corner_cutting, distance, before, waiting, filled)
    return distance, before


@lean
def reach(
    free: BoolArray,
    corner_cutting: bool,
    distance: IntArray,
    before: IntArray,
    waiting: NDArray[np.int32],
    filled: IntArray,
) -> None:
    """Fill in distances and the cells before, by Dijkstra's algorithm over the eight neighbours of a cell.

    The cells at distance d wait in row d mod STEPS of `waiting` (Dial 1969): steps are shorter than there are rows.
    """
    rows, columns = free.shape
    here, empty = 0, 0
    while empty < STEPS:
        row_of = here % STEPS
        empty = empty + 1 if filled[row_of] == 0 else 0
        for k in range(filled[row_of]):
            cell = np.int64(waiting[row_of, k])
            if distance[cell] != here:
                continue
            row, column = cell // columns, cell % columns
            for up in range(-1, 2):
                for right in range(-1, 2):
                    i, j = row + up, column + right
                    if not (0 <= i < rows and 0 <= j < columns) or not free[i, j]:
                        continue
                    diagonal = up != 0 and right != 0
                    if diagonal and not corner_cutting and not (free[row, j] and free[i, column]):
                        continue
                    step = DIAGONAL if diagonal else STRAIGHT
                    there = i * columns + j
                    if here + step < distance[there]:
                        distance[there] = here + step
                        before[there] = cell
                        later = (here + step) % STEPS
                        waiting[later, filled[later]] = there
                        filled[later] += 1
        filled[row_of] = 0
        here += 1
