"""Occupancy cells: free space among them in the plane, and boxes that cover points in space (voxels).

Free cells end at the border of the raster. The border of free space comes directly from the cells, so that a few
changed cells cost little. Other blocked regions, such as keep-out zones, bound a second free space; the clearance of a
point is the smaller of its clearances in both. Values equal those of :class:`.planar.FreeSpace`, which is built as soon
as the region, its edges, or distances of blocked points are needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray, IntArray, marked
from hpop.base.options import FARTHEST
from hpop.errors import MapError
from hpop.world import geometry
from hpop.world.geometry.planar import TOLERANCE, EdgeTree, FreeSpace
from hpop.world.geometry.shapes import Raster
from hpop.world.geometry.solids import MOST_SOLIDS, Box, Solid

FINEST = 1e-3
"""Smallest side of a cell, m."""


def voxels_of(points: FloatArray, resolution: float) -> IntArray:
    """Return the cells (n, 3) that contain points (N, 3), m, each once, in ascending order.

    Cell (i, j, k) reaches from (i, j, k) times the resolution, m, to (i + 1, j + 1, k + 1) times the resolution. A
    point on the border between cells is in the one with the larger index. MapError for points that are too far away.
    """
    if points.size and not np.abs(points).max() <= FARTHEST:
        raise MapError(
            f"points must be within {FARTHEST:,.0f} m of the origin, got one with the coordinate "
            f"{points.flat[np.abs(points).argmax()]:.4g}; give them in m."
        )
    cells = np.floor(points / resolution).astype(np.int64)
    return np.unique(cells, axis=0).reshape(-1, 3)


def boxes_of(cells: IntArray, resolution: float) -> list[Solid]:
    """Return boxes that together cover exactly these cells (n, 3), each given once.

    Adjacent cells in a row along x become one box. Then boxes of equal cross-section that touch along y are joined, and
    finally along z.
    """
    low, high = cells.astype(np.int64), cells.astype(np.int64) + 1
    for axis in range(3):
        low, high = _joined(low, high, axis)
    if len(low) > MOST_SOLIDS:
        coarser = resolution
        while True:
            coarser *= 2.0
            few = np.unique(np.floor(cells * (resolution / coarser)).astype(np.int64), axis=0)
            ends = few, few + 1
            for axis in range(3):
                ends = _joined(*ends, axis)
            if len(ends[0]) <= MOST_SOLIDS:
                break
        raise MapError(
            f"the points fill {len(cells):,} cells of {resolution:g} m, which make {len(low):,} boxes, expected at "
            f"most {MOST_SOLIDS:,}. Give a resolution of {coarser:g} m, or crop the points to the arm's surroundings."
        )
    return [_box(start, end, resolution) for start, end in zip(low, high, strict=True)]


def _joined(low: IntArray, high: IntArray, axis: int) -> tuple[IntArray, IntArray]:
    """Join boxes of cells (n, 3), from low to high, that touch along an axis and are equal in the others."""
    if not len(low):
        return low, high
    others = [i for i in range(3) if i != axis]
    keys = [low[:, axis], *(ends[:, i] for i in others for ends in (low, high))]
    order = np.lexsort(keys)
    low, high = low[order], high[order]
    same = np.all([(ends[1:, i] == ends[:-1, i]) for i in others for ends in (low, high)], axis=0)
    begins = np.append(True, ~(same & (low[1:, axis] == high[:-1, axis])))
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(low)) - 1
    ends = high[first].copy()
    ends[:, axis] = high[last, axis]
    return low[first], ends


def _box(low: IntArray, high: IntArray, resolution: float) -> Solid:
    pose = np.eye(4)
    pose[:3, 3] = 0.5 * resolution * (low + high)
    x, y, z = (resolution * (high - low)).tolist()
    return Solid(Box((x, y, z)), pose, "points")


BITS = 15  # bits of a grid coordinate in the integer that identifies an edge
MOST_ADDED = 8  # an index is built anew once 1 / 8 of its edges has been added or removed


def border_edges(cells: BoolArray) -> IntArray:
    """Return the border of the free cells as edges (E, 4) in grid coordinates: column and row of both ends.

    An edge is straight from corner to corner, with the free cells on its right.
    """
    free = np.pad(~cells, 1)
    south_west, south_east, north_west, north_east = free[:-1, :-1], free[:-1, 1:], free[1:, :-1], free[1:, 1:]
    right, up = south_east != north_east, north_west != north_east  # borders that leave each vertex (H + 1, W + 1)
    corner = (right | (south_west != north_west)) & (up | (south_west != south_east))
    y, x = marked(corner)
    across = _runs(np.stack([x, y], axis=1), right[y, x], south_east[y, x])
    by_column = np.lexsort((y, x))
    y, x = y[by_column], x[by_column]
    return np.concatenate([across, _runs(np.stack([x, y], axis=1), up[y, x], north_east[y, x])])


def _runs(corners: IntArray, leaves: BoolArray, is_forward: BoolArray) -> IntArray:
    """Return edges from each corner (N, 2) that a border leaves, to the next corner in its row or column.

    An edge is reversed where ``is_forward`` is False, so that the free cells are on its right.
    """
    first = np.flatnonzero(leaves)
    edges = np.concatenate([corners[first], corners[first + 1]], axis=1)
    return np.where(is_forward[first, None], edges, edges[:, [2, 3, 0, 1]])


def _keys(edges: IntArray) -> IntArray:
    """Return a unique integer for each edge (E, 4) in grid coordinates."""
    keys = edges[:, 0]
    for column in (1, 2, 3):
        keys = (keys << BITS) | edges[:, column]
    return keys


@dataclass(frozen=True, eq=False)
class ChangingEdges:
    """Index of edges that change. The tree is built once; later, edges are removed from it or added in a second tree.

    keys   (E,)  sorted integers of the edges in ``whole``
    place  (E,)  row of each of these edges in ``whole``
    whole        the tree as it was built
    tree         ``whole`` with removed edges moved infinitely far away
    added        tree of the added edges, or None
    """

    keys: IntArray
    place: IntArray
    whole: EdgeTree
    tree: EdgeTree
    added: EdgeTree | None = None

    @classmethod
    def build(cls, raster: Raster, edges: IntArray) -> ChangingEdges:
        """Build the index of edges (E, 4) in grid coordinates of a raster."""
        keys = _keys(edges)
        place = np.argsort(keys)
        tree = EdgeTree.build(_placed(raster, edges))
        return cls(keys[place], place, tree, tree)

    def updated(self, raster: Raster, edges: IntArray) -> ChangingEdges:
        """Return the index after a change, for all edges (E, 4) that there are now, in grid coordinates.

        Edges without a change cost little time, unless many others came or went.
        """
        keys = _keys(edges)
        order = np.argsort(keys)
        now = keys[order]
        removed = self.place[~_among(self.keys, now)]
        added = order[~_among(now, self.keys)]
        if MOST_ADDED * max(added.size, removed.size) > self.keys.size:
            return self.build(raster, edges)
        far = self.whole.edges.copy()
        far[removed] = np.inf
        more = EdgeTree.build(_placed(raster, edges[added])) if added.size else None
        return replace(self, tree=replace(self.whole, edges=far), added=more)

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (M,), m, of points to the nearest edge."""
        distance = self.tree.distance(x, y)
        return distance if self.added is None else np.minimum(distance, self.added.distance(x, y))

    def compare(self, corners: FloatArray, margin: float, relation: NDArray[np.uint8]) -> None:
        """Mark in ``relation`` (N,) which convex hulls of corners (N, c, 2), m, are within ``margin`` of the edges.

        See :func:`._hulls.compare_hulls` for the values in ``relation``.
        """
        for tree in (self.tree, self.added):
            if tree is not None:
                tree.compare(corners, margin, relation)


def _among(values: IntArray, others: IntArray) -> BoolArray:
    """Return which values (N,) occur in ``others``; both arrays are sorted."""
    if not others.size:
        return np.zeros(values.size, dtype=np.bool_)
    found: BoolArray = others[np.minimum(np.searchsorted(others, values), others.size - 1)] == values
    return found


def _placed(raster: Raster, edges: IntArray) -> FloatArray:
    """Convert edges (E, 4) from grid coordinates to metres."""
    ends = (raster.to_world(edges[:, i].astype(np.float64), edges[:, i + 1].astype(np.float64)) for i in (0, 2))
    return np.stack([column for point in ends for column in point], axis=1)


class CellSpace(FreeSpace):
    """Free cells of a raster that is not rotated, less other blocked regions if there are any."""

    raster: Raster
    rest: FreeSpace | None
    outline: Callable[[], BaseGeometry]
    index: ChangingEdges | None

    def __init__(
        self,
        raster: Raster,
        rest: FreeSpace | None,
        outline: Callable[[], BaseGeometry],
        before: CellSpace | None = None,
    ) -> None:
        """Index the border of the cells.

        Parameters
        ----------
        rest : free space if only the other blocked regions, not the cells, count; None without such regions
        outline : function that returns the whole free region, m
        before : free space of a raster on the same grid; its index is reused
        """
        vars(self).update(raster=raster, rest=rest, outline=outline)
        edges = border_edges(raster.cells)
        index = None if before is None else before.index
        if len(edges):
            index = ChangingEdges.build(raster, edges) if index is None else index.updated(raster, edges)
        else:
            index = None
        vars(self).update(index=index, grid_edges=edges)

    @property
    def nbytes(self) -> int:
        """Return the approximate memory of the index, bytes."""
        edges: IntArray = vars(self)["grid_edges"]
        return 12 * edges.nbytes

    @cached_property
    def whole(self) -> FreeSpace:
        """Return this free space as a plain `FreeSpace`, built on first use from its whole region."""
        return FreeSpace(self.outline())

    @property
    def region(self) -> BaseGeometry:
        """Return the free region, a polygon or multipolygon, m."""
        return self.whole.region

    @property
    def edges(self) -> FloatArray:
        """Return the edges (E, 2, 2), m, of the border."""
        return self.whole.edges

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (m) to the nearest edge of the border, from either side; inf without a border."""
        return self.whole.distance(x, y)

    @cached_property
    def _lines(self) -> tuple[FloatArray, FloatArray]:
        """Return the coordinates, m, of the lines between columns (W + 1,) and between rows (H + 1,)."""
        rows, columns = self.raster.cells.shape
        return (
            self.raster.to_world(np.arange(columns + 1.0), np.zeros(columns + 1))[0],
            self.raster.to_world(np.zeros(rows + 1), np.arange(rows + 1.0))[1],
        )

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points (M,) lie strictly inside the free region."""
        free = np.empty(x.shape, dtype=np.bool_)
        geometry._hulls.inside_cells(
            self.raster.cells, *self._lines, np.asarray(x, np.float64), np.asarray(y, np.float64), free
        )
        if self.rest is not None:
            inside = np.flatnonzero(free)
            free[inside] = self.rest.contains(x[inside], y[inside])
        return free

    def clearance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (m) to the border for points inside, 0 for all others; NaN for NaN."""
        result = np.where(np.isnan(x) | np.isnan(y), np.nan, 0.0)
        inside = self.contains(x, y)
        x, y = x[inside], y[inside]
        if self.index is not None and x.size:
            distance = self.index.distance(x, y)
            result[inside] = distance if self.rest is None else np.minimum(distance, self.rest.distance(x, y))
        return result

    def differs(self, before: FreeSpace, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return at which points (M,) the free space may differ from a previous one somewhere within ``within`` m."""
        changed = self.changed_cells(before)
        if changed is None:
            return super().differs(before, x, y, within)
        near = np.zeros(x.shape, dtype=np.bool_)
        for x0, y0, x1, y1 in changed:
            away = np.hypot(np.maximum(np.maximum(x0 - x, x - x1), 0), np.maximum(np.maximum(y0 - y, y - y1), 0))
            near |= away <= within
        return near

    def changed_cells(self, before: FreeSpace) -> FloatArray | None:
        """Return boxes (B, 4), m, round all cells that differ; None if anything besides cells differs.

        A box is x_min, y_min, x_max, y_max.
        """
        if not isinstance(before, CellSpace) or before.rest is not self.rest:
            return None
        return changed_boxes(before.raster, self.raster)

    def shapes_free(self, shapes: NDArray[np.object_], margin: float) -> BoolArray:
        """Return which shapely geometries (N,) lie in the free region, at least ``margin`` (m) from its border."""
        if margin <= TOLERANCE or "whole" in vars(self) or not len(shapes):
            return self.whole.shapes_free(shapes, margin)
        free = self._beside_cells(shapes, margin)
        return free if self.rest is None else free & self.rest.shapes_free(shapes, margin)

    def compare(self, corners: FloatArray, margin: float, relation: NDArray[np.uint8]) -> None:
        """Mark in ``relation`` (N,) which convex hulls of corners (N, c, 2), m, are within ``margin`` of the border.

        See :func:`._hulls.compare_hulls` for the values in ``relation``.
        """
        if self.index is not None:
            self.index.compare(corners, margin, relation)
        if self.rest is not None:
            self.rest.compare(corners, margin, relation)

    def _beside_cells(self, shapes: NDArray[np.object_], margin: float) -> BoolArray:
        """Return which geometries (N,) lie on free cells, at least ``margin`` (m) from the border of these cells."""
        points, owner = shapely.get_coordinates(shapes, return_index=True)
        first = np.searchsorted(owner, np.arange(len(shapes)))
        free = self.contains(points[first, 0], points[first, 1])
        edges = _placed(self.raster, vars(self)["grid_edges"])
        reach = margin + 1.0  # m: more than rounding
        (x0, y0), (x1, y1) = points.min(axis=0) - reach, points.max(axis=0) + reach
        low, high = np.minimum(edges[:, :2], edges[:, 2:]), np.maximum(edges[:, :2], edges[:, 2:])
        near = ((high >= (x0, y0)) & (low <= (x1, y1))).all(axis=1)
        if near.any():
            tree = shapely.STRtree(np.asarray(shapely.linestrings(edges[near].reshape(-1, 2, 2)), dtype=object))
            free[tree.query(shapes, predicate="dwithin", distance=margin - TOLERANCE)[0]] = False
        return free


def changed_boxes(before: Raster, after: Raster) -> FloatArray | None:
    """Return boxes (B, 4), m, round the changed cells, one per block of `changed_blocks`; None for different grids."""
    if not on_one_grid(before, after):
        return None
    blocks = changed_blocks(before.cells, after.cells)
    x0, y0 = after.to_world(blocks[:, 1].astype(np.float64), blocks[:, 0].astype(np.float64))
    x1, y1 = after.to_world(blocks[:, 3].astype(np.float64), blocks[:, 2].astype(np.float64))
    return np.stack([np.minimum(x0, x1), np.minimum(y0, y1), np.maximum(x0, x1), np.maximum(y0, y1)], axis=1)


def on_one_grid(first: Raster, second: Raster) -> bool:
    """Return whether two rasters have cells of the same number, size, position and heights."""
    alike = ("resolution", "origin", "heights")
    same_cells = first.cells.shape == second.cells.shape
    return same_cells and all(getattr(first, name) == getattr(second, name) for name in alike)


BLOCK = 32  # cells along a side of a block in which changes count as one


def changed_blocks(before: BoolArray, after: BoolArray) -> IntArray:
    """Return bounds (B, 4) of the changed cells in each block of `BLOCK` x `BLOCK` cells that has any.

    A row of the result is first row, first column, last row + 1 and last column + 1.
    """
    rows, columns = marked(before != after)
    if not rows.size:
        return np.zeros((0, 4), np.int64)
    blocks = (rows // BLOCK) * (after.shape[1] // BLOCK + 1) + columns // BLOCK
    _, which = np.unique(blocks, return_inverse=True)
    bounds = np.full((int(which.max()) + 1, 4), np.iinfo(np.int64).max)
    bounds[:, 2:] = 0
    for side, values in ((0, rows), (1, columns)):
        np.minimum.at(bounds[:, side], which, values)
        np.maximum.at(bounds[:, side + 2], which, values + 1)
    return bounds
