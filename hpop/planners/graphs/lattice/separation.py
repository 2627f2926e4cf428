"""What separates start and goal when no path exists: the widest passage between them, or the wall."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.planners.graphs.lattice.grid import STEPS_8, steps_from

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from hpop.planners.graphs.lattice.graph import StateLattice

NEGLIGIBLE = 1e-9  # length of a wide link against that of a narrow one


def what_separates(lattice: StateLattice, start: int, goals: list[int]) -> str:
    """Say in words why no path leads from a state to any of the goals.

    Looks for the passage whose narrowest point leaves the robot most room, on the lattice's positions: room is the
    clearance less the robot's reach, so a negative room is what the robot is too wide by. The path in a maximum
    spanning tree of the room has the widest passage; where it is narrow, a path shows that is no longer narrow than it
    need be.
    """
    from scipy.sparse import csr_array  # on first use: most problems have a path, and the import takes its time
    from scipy.sparse.csgraph import breadth_first_order, dijkstra, minimum_spanning_tree

    columns = lattice.shape[1]
    cells = lattice.cells[0] * columns + lattice.cells[1]
    begin, *ends = cells[lattice.places(np.array([start, *goals]))].tolist()
    room = _room(lattice).ravel()
    tails, heads = _links(lattice, room)
    narrow = np.minimum(room[tails], room[heads])

    def graph(weight: FloatArray, kept: Any = slice(None)) -> csr_array:
        return csr_array((weight[kept], (tails[kept], heads[kept])), shape=(room.size, room.size))

    tree = minimum_spanning_tree(graph(1.0 + narrow.max(initial=0.0) - narrow))
    reached, before = breadth_first_order(tree, begin, directed=False)
    widest, end = max(
        ((room[_path(before, begin, end)].min(), end) for end in ends if end in reached), default=(0.0, -1)
    )
    if end < 0:
        x, y = lattice.position(*np.divmod(reached.astype(np.int64), columns))
        return (
            f"no path: a wall closes off the start, however small the robot; the part of the map that it can reach "
            f"spans x {x.min():.2f} to {x.max():.2f} m, y {y.min():.2f} to {y.max():.2f} m"
        )
    if widest >= 0:
        return (
            "no path: positions are connected, but not by steps and turns of this lattice; take a smaller step, more "
            "headings, or allow corner cutting"
        )
    wide = graph(np.where(narrow > widest, NEGLIGIBLE, 1.0), narrow >= widest)
    _, onward = dijkstra(wide, directed=False, indices=begin, return_predecessors=True)
    passage = _path(onward, begin, end)
    x, y = lattice.position(*np.divmod(passage[np.argmin(room[passage])], columns))
    return (
        f"no path: the widest passage between start and goal is too narrow by about {-2 * widest:.2f} m, near "
        f"({x:.2f}, {y:.2f}); take a smaller robot, a smaller step or open the passage (seen on the lattice, so "
        f"within {lattice.step} m)"
    )


def _room(lattice: StateLattice) -> FloatArray:
    """Clearance less reach (rows, columns), m, at the tightest part of the robot; -inf where even a point collides.

    A robot that is not round has room wherever it is free at some heading.
    """
    rows, columns = np.indices(lattice.shape).reshape(2, -1)
    x, y = lattice.position(rows, columns)
    room = np.full(x.shape, np.inf)
    for part in lattice.model.platform:
        clearance = np.asarray(lattice.world.clearance(x, y, z=(part.z_min, part.z_max)))
        room = np.minimum(room, np.where(clearance > 0, clearance - part.reach, -np.inf))
    free = lattice.free.any(axis=2).ravel()
    return np.where(free, np.maximum(room, 0.0), room).reshape(lattice.shape)


def _links(lattice: StateLattice, room: FloatArray) -> tuple[IntArray, IntArray]:
    """Neighbouring positions (row * columns + column) between which a point, or the robot itself, can move."""
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


def _path(before: NDArray[np.integer[Any]], begin: int, end: int) -> list[int]:
    """Positions from the end back to the beginning."""
    path = [end]
    while path[-1] != begin:
        path.append(int(before[path[-1]]))
    return path
