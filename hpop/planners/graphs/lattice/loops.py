"""Compiled loops of a lattice: cells of a large grid that lie on the shortest paths, and arcs merged after a change.

A planner searches the cells on the shortest paths first. After a change of the world, the old arcs are merged with
those that were checked again near the change. The module is imported on first use only, because importing numba takes
a quarter of a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, distinct
from hpop.runtime.compiled import lean

STRAIGHT, DIAGONAL = 5, 7  # 7/5 is near enough to sqrt(2) for choosing cells
STEPS = DIAGONAL + 1
FAR = np.int64(2**30)  # longer than any path


def cells_near_shortest_paths(
    free: BoolArray, start: tuple[int, int], goal: tuple[int, int], most: int, *, corner_cutting: bool
) -> BoolArray | None:
    """Return a mask (rows, columns) of the free cells on the shortest paths from start to goal; None without a path.

    First, one shortest path is marked. Then the cells are marked through which the shortest paths lead, then those with
    slightly longer paths, and so on; of cells with equal lengths, those nearer to the first path are preferred. Without
    corner cutting, the cells beside the diagonal steps of the first path are marked too.

    Parameters
    ----------
    free : (rows, columns) whether each cell is free
    start, goal : (row, column) of free cells
    most : number of cells to mark; more if the first path is longer

    >>> cells_near_shortest_paths(np.ones((3, 5), bool), (0, 0), (0, 4), 7, corner_cutting=False).sum(axis=1).tolist()
    [5, 2, 0]
    """
    columns = free.shape[1]
    begin, end = (np.array([row * columns + column]) for row, column in (start, goal))
    there, before = distances_from(free, begin, corner_cutting)
    if there[end[0]] >= FAR:
        return None
    cells = [int(end[0])]
    while cells[-1] != begin[0]:
        cells.append(int(before[cells[-1]]))
    path = np.array(cells)
    if not corner_cutting:
        row, column = np.divmod(path, columns)
        path = distinct(np.concatenate([path, row[:-1] * columns + column[1:], row[1:] * columns + column[:-1]]))
    through = there + distances_from(free, end, corner_cutting)[0]
    aside, _ = distances_from(free, path, corner_cutting)
    through[path] = 0
    count = min(max(most, path.size), int((aside < FAR).sum()))
    marked = np.zeros(free.size, dtype=bool)
    marked[np.argpartition(through * FAR + aside, count - 1)[:count]] = True
    return marked.reshape(free.shape)


def distances_from(free: BoolArray, seeds: IntArray, corner_cutting: bool) -> tuple[IntArray, IntArray]:
    """Return the distance of each cell (rows * columns,) from the nearest of the cells ``seeds``, and its predecessor.

    free            (rows, columns)  whether each cell is free
    corner_cutting  whether a diagonal step may pass beside a blocked cell

    Distances are in fifths of a cell: a straight step counts 5, a diagonal one 7. The distance is FAR for a cell that
    cannot be reached, and the predecessor on the shortest path is -1 for such cells and for seeds.
    """
    distance = np.full(free.size, FAR)
    before = np.full(free.size, np.int64(-1))
    distance[seeds] = 0
    waiting = np.empty((STEPS, free.size), np.int32)
    filled = np.zeros(STEPS, np.int64)
    filled[0] = len(seeds)
    waiting[0, : len(seeds)] = seeds
    fill_distances(free, corner_cutting, distance, before, waiting, filled)
    return distance, before


@lean
def fill_distances(
    free: BoolArray,
    corner_cutting: bool,
    distance: IntArray,
    before: IntArray,
    waiting: NDArray[np.int32],
    filled: IntArray,
) -> None:
    """Compute the distances and predecessors of all cells, by Dijkstra's algorithm with eight neighbours for each cell.

    free      (rows, columns)  whether each cell is free
    corner_cutting             whether a diagonal step may pass beside a blocked cell
    distance  (rows * columns,)  output: distance from the nearest seed, in fifths of a cell; initially 0 at seeds, FAR
              elsewhere
    before    (rows * columns,)  output: predecessor; initially -1
    waiting   (STEPS, .)  bucket queue of Dial 1969: cells at distance d wait in row d mod STEPS, since every step is
              shorter than STEPS; initially with the seeds in row 0
    filled    (STEPS,)  number of cells in each row of ``waiting``
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


@lean
def splice(
    first: IntArray,
    count: IntArray,
    is_new: NDArray[np.bool_],
    heads: NDArray[np.int32],
    kinds: NDArray[np.uint8],
    number: NDArray[np.int32],
    new_heads: NDArray[np.int32],
    new_kinds: NDArray[np.uint8],
    new_number: NDArray[np.int32],
    out_heads: NDArray[np.int32],
    out_kinds: NDArray[np.uint8],
    origin: IntArray,
) -> None:
    """Merge old and new arcs, position by position, into the arrays ``out_heads``, ``out_kinds`` and ``origin`` (m,).

    Old arcs are those before a change of the world; new arcs were checked again after it.

    first, count          (P,)  index of the first arc at each position, and number of its arcs, in the list of old arcs
                          or, where ``is_new``, of new arcs
    is_new                (P,)  whether the arcs at a position were checked again, so that the new arcs apply
    heads, kinds          head state and kind of motion of the old arcs
    number                (n,)  number after the change of each state before it; negative if it is blocked now
    new_heads, new_kinds  head state and kind of motion of the new arcs
    new_number            number, after the change, of each state to which ``new_heads`` refers
    out_heads, out_kinds  output: head state and kind of motion of all arcs
    origin                output: index of each arc before the change; -1 for a new arc
    """
    m = 0
    for p in range(first.size):
        if is_new[p]:
            for a in range(first[p], first[p] + count[p]):
                out_heads[m] = new_number[new_heads[a]]
                out_kinds[m] = new_kinds[a]
                origin[m] = -1
                m += 1
        else:
            for a in range(first[p], first[p] + count[p]):
                out_heads[m] = number[heads[a]]
                out_kinds[m] = kinds[a]
                origin[m] = a
                m += 1
