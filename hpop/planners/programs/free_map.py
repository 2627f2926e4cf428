"""Where a robot in the plane is free: places on a fine grid, in parts between which it cannot go."""

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

ACROSS = 500  # places along the longer side of the map
ACROSS_TURNED = 200  # the same for a robot that is not round, which is tried at each heading
ROOM = 0.5  # m: start and goal that are chosen keep away from what blocks by so much more, where there is room
INDOORS = 0.1  # of the largest part: what is indoors is taken if it is not smaller than that


@dataclass(frozen=True, eq=False)
class FreeMap:
    """Places of a grid at which a robot is free at some heading, by rows from below.

    x, y   (w,), (h,)  m
    free   (h, w)      whether the robot is free there
    world
    """

    x: FloatArray
    y: FloatArray
    free: BoolArray
    world: World

    @classmethod
    def of(cls, model: Model, world: World) -> FreeMap | None:
        """The map of a model; None where it is none in the plane."""
        if "plane" not in model.provides or set(model.space.names) < {"x", "y", "yaw"}:
            return None
        x0, y0, x1, y1 = world.bounds
        collision: Any = model.collision(world)
        pitch = max(x1 - x0, y1 - y0) / (ACROSS_TURNED if collision.yaw_matters else ACROSS)
        x, y = (np.arange(low + pitch / 2, high, pitch) for low, high in ((x0, x1), (y0, y1)))
        places = [axis.ravel() for axis in np.meshgrid(x, y)]
        free = collision.clear(*places)
        if collision.yaw_matters:
            left = np.flatnonzero(~free)
            for heading in np.arange(HEADINGS) * 2 * math.pi / HEADINGS:
                columns = {name: np.zeros(left.size) for name in model.space.names}
                columns |= {"x": places[0][left], "y": places[1][left], "yaw": np.full(left.size, heading)}
                free[left] |= collision.states_free(States(**columns))
        return cls(x, y, free.reshape(y.size, x.size), world)

    @property
    def pitch(self) -> float:
        """From one place to the next, m."""
        x0, _, x1, _ = self.world.bounds
        return float(self.x[1] - self.x[0]) if self.x.size > 1 else x1 - x0

    @cached_property
    def parts(self) -> IntArray:
        """(h, w): the number of the connected part to which a place belongs, from 1 on; 0 where it is not free."""
        numbered, _ = ndimage.label(self.free)
        return np.asarray(numbered, dtype=np.int64)

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each part by its number, m²; the first is that of no part, 0."""
        areas = np.bincount(self.parts.ravel()).astype(np.float64) * self.pitch**2
        areas[0] = 0.0
        return areas

    def part_at(self, x: float, y: float) -> int:
        """The part at a place, or within one and a half places of it; 0 where there is none."""
        row, column = (int(np.abs(axis - value).argmin()) for axis, value in ((self.y, y), (self.x, x)))
        near = self.parts[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        here = int(self.parts[row, column])
        return here or int(near.max(initial=0))

    @property
    def main(self) -> int:
        """The largest part; on an image one indoors, which does not go on beyond the edge. 0 if nothing is free."""
        areas, indoors = self.areas, self.areas.copy()
        indoors[self._open_parts()] = 0.0
        if indoors.max() >= INDOORS * areas.max():
            areas = indoors
        return int(areas.argmax()) if areas.max() > 0.0 else 0

    def _open_parts(self) -> IntArray:
        """Parts as near to the edge of an image as any, if that is not all wall: what is outside of a building."""
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
        """Two places of a part, or of the main one, far from each other by the way that goes between them.

        The place farthest from an end of the part, and the place farthest from that one, where there is room. Something
        must be free.
        """
        inside = self.parts == (part or self.main)
        roomy = ndimage.distance_transform_edt(inside) * self.pitch >= ROOM
        kept = np.flatnonzero((roomy if roomy.any() else inside)[inside])
        graph, places = _joined(inside)
        first = int(kept[_steps(graph, int(kept[0]))[kept].argmax()])
        second = int(kept[_steps(graph, first)[kept].argmax()])
        ends = sorted((float(self.x[column]), float(self.y[row])) for row, column in places[[first, second]])
        return ends[0], ends[1]


def _joined(inside: BoolArray) -> tuple[Any, IntArray]:
    """The graph of neighbouring places, and the row and column (n, 2) of each of its nodes."""
    places = np.argwhere(inside)
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(len(places))
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    tails, heads = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
    both = (tails >= 0) & (heads >= 0)
    ones = np.ones(int(both.sum()))
    size = len(places)
    return sparse.coo_array((ones, (tails[both], heads[both])), shape=(size, size)).tocsr(), places


def _steps(graph: Any, source: int) -> FloatArray:
    """Number of steps (n,) from a node to each."""
    found = sparse.csgraph.dijkstra(graph, directed=False, indices=np.array([source]), unweighted=True)[0]
    return np.where(np.isfinite(found), found, -1.0)
