"""What separates start and goal when no path exists: the widest passage between them, or the wall."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from hpop.arrays import FloatArray

if TYPE_CHECKING:
    from hpop.planners.lattice_graph import StateLattice

EIGHT = np.ones((3, 3), dtype=bool)


def what_separates(lattice: StateLattice, start: int, goals: list[int]) -> str:
    """Say in words why no path leads from a state to any of the goals.

    Looks for the passage whose narrowest point leaves the robot most room, on the lattice's positions: room is the
    clearance less the robot's reach, so a negative room is what the robot is too wide by.
    """
    count = lattice.headings.count
    rows, columns = (axis[np.array([start, *goals]) // count] for axis in lattice.cells)
    room = _room(lattice)
    begin, ends = (rows[0], columns[0]), (rows[1:], columns[1:])

    def connected(least: float) -> bool:
        parts, _ = ndimage.label(room >= least, structure=EIGHT)
        return bool(parts[begin] > 0 and (parts[ends] == parts[begin]).any())

    levels = np.unique(room[np.isfinite(room)])
    low, high = -1, levels.size - 1  # connected at low (or nowhere), not above high
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if connected(levels[middle]) else (low, middle - 1)
    if low < 0:
        parts, _ = ndimage.label(np.isfinite(room), structure=EIGHT)
        reached = parts == parts[begin]
        r, c = np.nonzero(reached)
        x, y = lattice.position(r, c)
        return (
            f"no path: a wall closes off the start, however small the robot; the part of the map that it can reach spans "
            f"x {x.min():.2f} to {x.max():.2f} m, y {y.min():.2f} to {y.max():.2f} m"
        )
    widest = float(levels[low])
    if widest >= 0:
        return (
            "no path: positions are connected, but not by steps and turns of this lattice; take a smaller step, more "
            "headings, or allow corner cutting"
        )
    x, y = _narrowest(lattice, room, begin, ends, widest)
    return (
        f"no path: the widest passage between start and goal is too narrow by about {-2 * widest:.2f} m, near "
        f"({x:.2f}, {y:.2f}); take a smaller robot or open the passage (seen on the lattice, so within {lattice.step} m)"
    )


def _room(lattice: StateLattice) -> FloatArray:
    """Clearance less reach (rows, columns), m, at the tightest part of the robot; -inf where even a point collides."""
    rows, columns = np.indices(lattice.shape).reshape(2, -1)
    x, y = lattice.position(rows, columns)
    room = np.full(x.shape, np.inf)
    for part in lattice.model.parts:
        clearance = np.asarray(lattice.world.clearance(x, y, z=(part.z_min, part.z_max)))
        room = np.minimum(room, np.where(clearance > 0, clearance - part.reach, -np.inf))
    return room.reshape(lattice.shape)


def _narrowest(
    lattice: StateLattice, room: FloatArray, begin: tuple[int, int], ends: tuple[np.ndarray, ...], widest: float
) -> tuple[float, float]:
    """Where the best passage is narrowest: a cell at that level which touches what is reached without it."""
    parts, _ = ndimage.label(room > widest, structure=EIGHT)
    ours = ndimage.binary_dilation((parts == parts[begin]) & (parts > 0), structure=EIGHT)
    ours[begin] = True
    level = room == widest
    touching = level & ours if (level & ours).any() else level
    goal_row, goal_column = int(ends[0][0]), int(ends[1][0])
    rows, columns = np.nonzero(touching)
    best = np.argmin(np.hypot(rows - goal_row, columns - goal_column))
    x, y = lattice.position(rows[best : best + 1], columns[best : best + 1])
    return float(x[0]), float(y[0])
