"""Headings of a lattice, steps between positions of its grid, and the reason why no path exists."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, marked
from hpop.base.options import one_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from hpop.planners.graphs.lattice.graph import StateLattice

# Headings and steps know no robot, so grids without headings (as in the MovingAI benchmarks) use them too.


# One step along each heading, as numbers of cells (columns, rows), counter-clockwise from the x axis.
STEPS_8 = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
STEPS_16 = (
    (1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1),
    (-1, 0), (-2, -1), (-1, -1), (-1, -2), (0, -1), (1, -2), (1, -1), (2, -1),
)  # fmt: skip
STEPS = {4: STEPS_8[::2], 8: STEPS_8, 16: STEPS_16}


@dataclass(frozen=True)
class Headings:
    """The 4, 8 or 16 headings of a lattice, with the step on the grid along each of them.

    With 16 headings, the additional ones are those of steps by (2, 1) cells: 26.57 and 63.43 degrees, not multiples of
    22.5 degrees.
    """

    count: int

    def __post_init__(self) -> None:
        one_of("headings", self.count, STEPS)

    @property
    def steps(self) -> tuple[tuple[int, int], ...]:
        """One step along each heading, as numbers of cells (columns, rows)."""
        return STEPS[self.count]

    @cached_property
    def yaw(self) -> FloatArray:
        """Angle (H,) of each heading, rad, in [0, 2 pi)."""
        return np.array([math.atan2(dy, dx) % (2 * math.pi) for dx, dy in self.steps])


def steps_from(
    free: BoolArray, step: tuple[int, int], *, corner_cutting: bool
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return all possible steps between free cells: rows and columns (M,) of the first, then of the reached cells.

    Without corner cutting, the cells that the straight line of the step passes must be free too. A diagonal step passes
    two cells, and so does a step by (2, 1) cells.

    Parameters
    ----------
    free : (rows, columns) whether each cell is free
    step : numbers of cells (columns, rows) of the step
    corner_cutting : whether a step may pass blocked cells
    """
    dx, dy = step
    rows, columns = marked(free)
    to_rows, to_columns = rows + dy, columns + dx
    inside = (to_rows >= 0) & (to_rows < free.shape[0]) & (to_columns >= 0) & (to_columns < free.shape[1])
    rows, columns, to_rows, to_columns = (a[inside] for a in (rows, columns, to_rows, to_columns))
    allowed = free[to_rows, to_columns]
    if not corner_cutting:
        for across, up in passed_cells(step):
            allowed &= free[rows + up, columns + across]
    return rows[allowed], columns[allowed], to_rows[allowed], to_columns[allowed]


def passed_cells(step: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Return the cells that the straight line of a step touches between its ends, relative to the first cell.

    Steps and cells are given as (columns, rows).

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


NEGLIGIBLE = 1e-9  # length of a link with enough room, where a narrow link has length 1


def what_separates(lattice: StateLattice, start: int, goals: list[int]) -> str:
    """Return the reason, as text, why no path leads from a state to any of the goals: usually a passage is too narrow.

    The text gives the place of the widest passage, and by how much it is too narrow. Room at a position is the
    distance to obstacles minus the robot's radius; if it is negative, the robot is too wide by twice as much. The
    widest passage is the path whose narrowest position has the most room, found by a maximum spanning tree. Of several
    such paths, one with the fewest narrow positions is taken.
    """
    from scipy.sparse import csr_array  # on first use: most problems have a path, and the import takes its time
    from scipy.sparse.csgraph import breadth_first_order, dijkstra, minimum_spanning_tree

    columns = lattice.shape[1]
    cells = lattice.cells[0] * columns + lattice.cells[1]
    begin, *ends = cells[lattice.places(np.array([start, *goals]))].tolist()
    room = _room_at_positions(lattice).ravel()
    tails, heads = _neighbour_pairs(lattice, room)
    narrow = np.minimum(room[tails], room[heads])

    def graph(weight: FloatArray, rows: Any = slice(None)) -> csr_array:
        return csr_array((weight[rows], (tails[rows], heads[rows])), shape=(room.size, room.size))

    tree = minimum_spanning_tree(graph(1.0 + narrow.max(initial=0.0) - narrow))
    reached, before = breadth_first_order(tree, begin, directed=False)
    widest, end = max(
        ((room[_traced_path(before, begin, end)].min(), end) for end in ends if end in reached), default=(0.0, -1)
    )
    if end < 0:
        x, y = lattice.position(*np.divmod(reached.astype(np.int64), columns))
        return (
            f"no path: obstacles separate start and goal, even for a robot of no size that moves in steps of "
            f"{lattice.step:g} m; the part of the map that can be reached spans x {x.min():.2f} to {x.max():.2f} m, "
            f"y {y.min():.2f} to {y.max():.2f} m; move the start or the goal, change the map, or take a smaller step"
        )
    if widest >= 0:
        return (
            "no path: there is room for the robot from start to goal, but the steps and turns of this lattice do not "
            "connect them; take a smaller step, more headings, or allow corner cutting"
        )
    wide = graph(np.where(narrow > widest, NEGLIGIBLE, 1.0), narrow >= widest)
    _, onward = dijkstra(wide, directed=False, indices=begin, return_predecessors=True)
    passage = _traced_path(onward, begin, end)
    x, y = lattice.position(*np.divmod(passage[np.argmin(room[passage])], columns))
    return (
        f"no path: the widest passage between start and goal is too narrow by about {-2 * widest:.2f} m, near "
        f"({x:.2f}, {y:.2f}); take a smaller robot or a smaller step, or widen the passage (computed at the positions "
        f"of the lattice, so the place is exact to {lattice.step} m)"
    )


def _room_at_positions(lattice: StateLattice) -> FloatArray:
    """Return the room for the robot at each position (rows, columns), m.

    Room is the distance to obstacles minus the radius of the robot, for the part of the robot with the least room. It
    is -inf where even a robot of no size collides, and at least 0 where the robot is free at some heading.
    """
    rows, columns = np.indices(lattice.shape).reshape(2, -1)
    x, y = lattice.position(rows, columns)
    room = np.full(x.shape, np.inf)
    for part in lattice.model.platform:
        clearance = np.asarray(lattice.world.clearance(x, y, z=(part.z_min, part.z_max)))
        room = np.minimum(room, np.where(clearance > 0, clearance - part.reach, -np.inf))
    free = lattice.free.any(axis=2).ravel()
    return np.where(free, np.maximum(room, 0.0), room).reshape(lattice.shape)


def _neighbour_pairs(lattice: StateLattice, room: FloatArray) -> tuple[IntArray, IntArray]:
    """Return pairs of positions between which a robot of no size, or the robot itself, can move by one step.

    A position is given by its number, row * columns + column. ``room`` is that of :func:`_room_at_positions`.
    """
    possible = np.isfinite(room).reshape(lattice.shape)
    ends = np.hstack([np.stack(steps_from(possible, step, corner_cutting=True)) for step in STEPS_8[:4]])
    segments = (*lattice.position(ends[0], ends[1]), *lattice.position(ends[2], ends[3]))
    free = np.ones(ends.shape[1], dtype=bool)
    for z in {(part.z_min, part.z_max) for part in lattice.model.platform}:
        free &= lattice.world.segments_free(*segments, margin=0.0, z=z)
    columns = lattice.shape[1]
    cells = lattice.cells[0] * columns + lattice.cells[1]
    moves = cells[lattice.places(np.stack(lattice.edges("move")))]
    points = ends[::2, free] * columns + ends[1::2, free]
    tails, heads = np.unique(np.sort(np.hstack([points, moves]), axis=0), axis=1)
    return tails, heads


def _traced_path(before: NDArray[np.integer[Any]], begin: int, end: int) -> list[int]:
    """Return the positions on the path from ``end`` back to ``begin``.

    before  predecessor of each position on its path from ``begin``
    """
    path = [end]
    while path[-1] != begin:
        path.append(int(before[path[-1]]))
    return path
