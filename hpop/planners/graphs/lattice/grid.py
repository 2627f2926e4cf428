"""The grid under a lattice: positions, headings, and which neighbours a step may reach.

Plain arrays, no robots: a lattice with headings and a position grid without (as in the MovingAI benchmarks) step alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import one_of

# One step along each heading, in cells (columns, rows), counter-clockwise from +x.
STEPS_8 = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
STEPS_16 = (
    (1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1),
    (-1, 0), (-2, -1), (-1, -1), (-1, -2), (0, -1), (1, -2), (1, -1), (2, -1),
)  # fmt: skip
STEPS = {4: STEPS_8[::2], 8: STEPS_8, 16: STEPS_16}


@dataclass(frozen=True)
class Headings:
    """A set of 4, 8 or 16 headings and the step that the grid takes along each.

    With 16 the new ones point to a knight's move (2, 1), so they are 26.57 and 63.43 degrees, not multiples of 22.5.
    """

    count: int

    def __post_init__(self) -> None:
        one_of("headings", self.count, STEPS)

    @property
    def steps(self) -> tuple[tuple[int, int], ...]:
        """Cells (columns, rows) of one step along each heading."""
        return STEPS[self.count]

    @cached_property
    def yaw(self) -> FloatArray:
        """Angle (H,) of each heading, rad, in [0, 2 pi)."""
        return np.array([math.atan2(dy, dx) % (2 * math.pi) for dx, dy in self.steps])


def steps_from(
    free: BoolArray, step: tuple[int, int], *, corner_cutting: bool
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Rows and columns (M,) of the free cells from which one step reaches a free cell, and of the cells reached.

    Without corner cutting every cell that the step's straight line passes must be free: both orthogonal neighbours of a
    diagonal, both middle cells of a knight's move.

    Parameters
    ----------
    free : (rows, columns) bool
    step : (columns, rows) of one step
    """
    dx, dy = step
    rows, columns = np.nonzero(free)
    to_rows, to_columns = rows + dy, columns + dx
    inside = (to_rows >= 0) & (to_rows < free.shape[0]) & (to_columns >= 0) & (to_columns < free.shape[1])
    rows, columns, to_rows, to_columns = (a[inside] for a in (rows, columns, to_rows, to_columns))
    allowed = free[to_rows, to_columns]
    if not corner_cutting:
        for across, up in passed_cells(step):
            allowed &= free[rows + up, columns + across]
    return rows[allowed], columns[allowed], to_rows[allowed], to_columns[allowed]


def passed_cells(step: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Cells (columns, rows) that the straight line of a step touches between its ends.

    >>> passed_cells((1, -1)), passed_cells((-2, 1)), passed_cells((1, 0))
    (((1, 0), (0, -1)), ((-1, 0), (-1, 1)), ())
    """
    dx, dy = step
    if abs(dx) == 1 and abs(dy) == 1:
        return (dx, 0), (0, dy)
    if abs(dx) == 2:
        return (dx // 2, 0), (dx // 2, dy)
    if abs(dy) == 2:
        return (0, dy // 2), (dx, dy // 2)
    return ()
