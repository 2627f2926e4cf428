"""Museum-like occupancy grids for benchmarks: rooms of equal size with two doors a wall, and exhibits, by seed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

import hpop
from hpop.base.arrays import BoolArray

CELL = 0.25  # m
DOOR = 6  # cells
SIZES = {"m60": (60, 1), "m100": (100, 2), "m160": (160, 3), "m200": (200, 1), "m300": (300, 5)}  # cells a side, seed


def museum(side: int, seed: int) -> BoolArray:
    """Occupied cells (side, side): an outer wall, inner walls every fifth of the side, exhibits of 1-3 cells."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((side, side), dtype=bool)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    room = max(16, side // 5)
    walls = range(room, side - DOOR, room)
    for x in walls:
        occupied[:, x] = True
    for y in walls:
        occupied[y, :] = True
    edges = [0, *walls, side - 1]
    for wall in walls:
        for low, high in pairwise(edges):
            for line in (occupied[:, wall], occupied[wall, :]):
                door = rng.integers(low + 1, max(low + 2, high - DOOR))
                line[door : min(door + DOOR, high)] = False
    for x, y, width, height in np.c_[
        rng.integers(2, side - 4, size=(side * side // 350, 2)),
        rng.integers(1, 4, size=(side * side // 350, 2)),
    ]:
        occupied[y : y + height, x : x + width] = True
    return occupied


def problem(name: str) -> hpop.Problem:
    """Exposure, turns and length between the free cells nearest to two corners, heading along +x at both."""
    side, seed = SIZES[name]
    world = hpop.World.from_cells(museum(side, seed), CELL)
    model = hpop.DifferentialDrive(radius=0.3)
    centres = (np.arange(side) + 0.5) * CELL
    x, y = np.meshgrid(centres, centres)
    free = world.clearance(x.ravel(), y.ravel()).reshape(x.shape) > 0.6
    rows, columns = np.nonzero(free)
    order = np.argsort(rows + columns, kind="stable")
    first, last = order[0], order[-1]
    start = (float(x[rows[first], columns[first]]), float(y[rows[first], columns[first]]), 0.0)
    goal = (float(x[rows[last], columns[last]]), float(y[rows[last], columns[last]]), 0.0)
    return hpop.Problem(world, model, start, goal, ["exposure", "turns", "length"])
