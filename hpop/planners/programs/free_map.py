"""Grid map of where a planar robot is free of collisions, and of the connected parts of this free space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage, sparse

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.motions import Model, States
from hpop.planners.needs import HEADINGS

if TYPE_CHECKING:
    from hpop.world import World

ACROSS = 500  # grid positions along the longer side of the map
ACROSS_TURNED = 200  # grid positions for a robot that is not round, which is checked at each heading
ROOM = 0.5  # m: additional clearance of chosen starts and goals, if possible
INDOORS = 0.1  # share of the largest part's area: an indoor part of at least this area is preferred


@dataclass(frozen=True, eq=False)
class FreeMap:
    """Grid of positions, each marked free if the robot collides with nothing there at one heading at least.

    x, y   (w,), (h,)  m  of the columns from left to right, and of the rows from bottom to top
    free   (h, w)      whether the robot is free at the position
    world  world of the map
    """

    x: FloatArray
    y: FloatArray
    free: BoolArray
    world: World

    @classmethod
    def of(cls, model: Model, world: World) -> FreeMap | None:
        """Return the map of a robot model in a world, or None if the model does not drive in the plane.

        Joints are at 0.
        """
        if "plane" not in model.provides or set(model.space.names) < {"x", "y", "yaw"}:
            return None
        x0, y0, x1, y1 = world.bounds
        collision: Any = model.collision(world)
        pitch = max(x1 - x0, y1 - y0) / (ACROSS_TURNED if collision.yaw_matters else ACROSS)
        x, y = (np.arange(low + pitch / 2, high, pitch) for low, high in ((x0, x1), (y0, y1)))
        positions = [axis.ravel() for axis in np.meshgrid(x, y)]
        free = collision.clear(*positions)
        if collision.yaw_matters:
            left = np.flatnonzero(~free)
            for heading in np.arange(HEADINGS) * 2 * math.pi / HEADINGS:
                columns = {name: np.zeros(left.size) for name in model.space.names}
                columns |= {"x": positions[0][left], "y": positions[1][left], "yaw": np.full(left.size, heading)}
                free[left] |= collision.states_free(States(**columns))
        return cls(x, y, free.reshape(y.size, x.size), world)

    @property
    def pitch(self) -> float:
        """Spacing of the grid, m."""
        x0, _, x1, _ = self.world.bounds
        return float(self.x[1] - self.x[0]) if self.x.size > 1 else x1 - x0

    @cached_property
    def parts(self) -> IntArray:
        """Number (h, w) of the connected part of free space at each position: 1, 2, ...; 0 where it is not free."""
        labels, _ = ndimage.label(self.free)
        return np.asarray(labels, dtype=np.int64)

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each connected part, m², indexed by its number; 0 for number 0, which is no part."""
        areas = np.bincount(self.parts.ravel()).astype(np.float64) * self.pitch**2
        areas[0] = 0.0
        return areas

    def part_at(self, x: float, y: float) -> int:
        """Return the number of the connected part at the grid position nearest to (x, y).

        If that is not free, a part at one of its eight neighbours counts; 0 if there is none.
        """
        row, column = (int(np.abs(axis - value).argmin()) for axis, value in ((self.y, y), (self.x, x)))
        near = self.parts[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        part = int(self.parts[row, column])
        return part or int(near.max(initial=0))

    @property
    def main(self) -> int:
        """Number of the largest connected part, or 0 if nothing is free.

        In a world read from an image, it is the largest part indoors, unless that is tiny (INDOORS).
        """
        areas, indoors = self.areas, self.areas.copy()
        indoors[self._open_parts()] = 0.0
        if indoors.max() >= INDOORS * areas.max():
            areas = indoors
        return int(areas.argmax()) if areas.max() > 0.0 else 0

    def _open_parts(self) -> IntArray:
        """Return the numbers of the parts outside the building on a map image: those that reach the image's edge.

        The result is empty if the world is no image, or if walls run along the whole edge.
        """
        raster = self.world.raster
        if raster is None or not self.free.any():
            return np.zeros(0, dtype=np.int64)
        cells = raster.cells
        if cells[[0, -1]].all() and cells[:, [0, -1]].all():
            return np.zeros(0, dtype=np.int64)
        sides = [np.minimum(np.arange(n), np.arange(n)[::-1]) for n in self.free.shape]
        steps = np.minimum(sides[0][:, None], sides[1])
        return np.unique(self.parts[self.free & (steps <= steps[self.free].min() + 1)])

    def far_apart(self, part: int = 0) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return two positions (x, y) in a part, by default the main part, with a long shortest path between them.

        One is the position farthest from an arbitrary one, and the other is the position farthest from that. Both have
        additional clearance if possible. Some position of the map must be free.
        """
        inside = self.parts == (part or self.main)
        roomy = ndimage.distance_transform_edt(inside) * self.pitch >= ROOM
        roomy_nodes = np.flatnonzero((roomy if roomy.any() else inside)[inside])
        graph, cells = _neighbour_graph(inside)
        first = int(roomy_nodes[_steps(graph, int(roomy_nodes[0]))[roomy_nodes].argmax()])
        second = int(roomy_nodes[_steps(graph, first)[roomy_nodes].argmax()])
        ends = sorted((float(self.x[column]), float(self.y[row])) for row, column in cells[[first, second]])
        return ends[0], ends[1]


def _neighbour_graph(inside: BoolArray) -> tuple[Any, IntArray]:
    """Return a graph that joins True positions side by side in a grid, and the row and column (n, 2) of each node."""
    cells = np.argwhere(inside)
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(len(cells))
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    tails, heads = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
    are_nodes = (tails >= 0) & (heads >= 0)
    ones = np.ones(int(are_nodes.sum()))
    size = len(cells)
    return sparse.coo_array((ones, (tails[are_nodes], heads[are_nodes])), shape=(size, size)).tocsr(), cells


def _steps(graph: Any, source: int) -> FloatArray:
    """Return the number of edges (n,) on the shortest path from node ``source`` to each node; -1 without a path."""
    steps = sparse.csgraph.dijkstra(graph, directed=False, indices=np.array([source]), unweighted=True)[0]
    return np.where(np.isfinite(steps), steps, -1.0)
