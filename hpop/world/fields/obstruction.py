"""Obstruction phi: the fraction of a ball around the camera that is inside obstacles.

``phi(p) = volume(ball(p, r) and O) / volume(ball(p, r))``, where p is the position of the camera, r the radius of the
ball, and O the obstacles (Becerra et al. 2020). There are three kinds of obstacles:

- Polygons with a height: phi is computed in closed form, exact up to rounding.
- Occupied cells of a grid, with a height: phi is a convolution of the occupancy with the closed form of one cell, also
  exact up to rounding.
- Solids in space: phi is approximated by rays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise, product
from threading import RLock
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.runtime import limits
from hpop.world import fields
from hpop.world.geometry.rays_in_space import Surfaces, surfaces_of
from hpop.world.geometry.shapes import Obstacle, Raster, overlaps

if TYPE_CHECKING:
    from hpop.world.world import World

NOISE = 1e-9
"""Value below which a result of the FFT counts as 0: it is rounding."""
BLOCK = 256
"""Polygons whose neighbours are searched together."""
ROUNDING = 1e-12
"""Value below which a result of the closed form counts as 0: it is rounding."""
PER_RADIUS = 10  # nodes of the grid per radius of the ball
RAYS = 1000  # per node, over the ball: errors at edges and corners are one or two thousandths
MOST = 1 << 22  # most nodes in the cache, 64 MB
SIDE = 1 << 20  # nodes on either side of the middle that a key can number
STRIDES = np.array([1 << 42, 1 << 21, 1], np.int64)
AROUND = np.array([*product(range(-1, 3), repeat=3)], np.int64) @ STRIDES  # nodes that interpolate a cell
CUBICS = 0.5 * np.array([[0.0, 2.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [2.0, -5.0, 4.0, -1.0], [-1.0, 3.0, -3.0, 1.0]])


class RasterBalls:
    """Obstructed fraction of the ball round each cell centre, computed tile by tile as a convolution by FFT.

    The kernel of the convolution is the exact obstruction by a single cell at every offset. So the result is exact for
    the union of the occupied squares at any resolution. Tiles overlap by the kernel's width. NumPy's transforms are
    used because importing scipy.signal takes longer than convolving a building.

    raster               occupied cells, with their heights
    radius               m, of the ball
    camera_z             m, height of the ball's centre; without effect if the cells have unlimited height
    outside_is_obstacle  whether the plane beyond the raster counts as occupied
    pad                  cells to add on every side of the raster
    """

    def __init__(
        self, raster: Raster, radius: float, camera_z: float = 0.0, outside_is_obstacle: bool = True, *, pad: int = 0
    ) -> None:
        reach, self._tile, self._transform = _transform_of_cell(raster.resolution, *raster.heights, radius, camera_z)
        self._raster, self._outside, self._border = raster, outside_is_obstacle, reach + pad
        self._overlap = 2 * reach
        rows, columns = raster.cells.shape
        self.shape = rows + 2 * pad, columns + 2 * pad

    @property
    def side(self) -> int:
        """Return the number of cells along a side of a tile."""
        return self._tile - self._overlap

    def values(self, rows: slice, columns: slice) -> FloatArray:
        """Return the obstructed fractions, in [0, 1], at the cells of a tile; tiles begin at multiples of `side`."""
        height, width = rows.stop - rows.start, columns.stop - columns.start
        cells = self._cells(rows, columns)
        product = self._transform * np.fft.rfft2(cells, (self._tile, self._tile))
        own_rows = np.fft.ifft(product, axis=0)[self._overlap : self._overlap + height]
        phi: FloatArray = np.fft.irfft(own_rows, self._tile)[:, self._overlap : self._overlap + width]
        return np.minimum(np.where(phi < NOISE, 0.0, phi), 1.0)

    def spans(self, rows: slice, columns: slice) -> list[tuple[int, int]]:
        """Return the range of rows and the range of columns of cells that the balls of a tile reach, end excluded.

        Both ranges count from the first row and column of the raster, and may extend beyond it. The tile is given by
        its rows and columns in the result, which has ``pad`` more cells on every side.
        """
        border = self._border
        return [
            (part.start - border, min(part.start + self._tile - border, size + border))
            for part, size in zip((rows, columns), self._raster.cells.shape, strict=True)
        ]

    def _cells(self, rows: slice, columns: slice) -> FloatArray:
        """Return the occupancy, 0 or 1, of the cells that a tile reaches (:meth:`spans`), also beyond the raster."""
        cells, spans = self._raster.cells, self.spans(rows, columns)
        out = np.full([stop - start for start, stop in spans], float(self._outside))
        inside = [(max(start, 0), min(stop, size)) for (start, stop), size in zip(spans, cells.shape, strict=True)]
        if all(start < stop for start, stop in inside):
            place = tuple(slice(a - start, b - start) for (a, b), (start, _) in zip(inside, spans, strict=True))
            out[place] = cells[inside[0][0] : inside[0][1], inside[1][0] : inside[1][1]]
        return out


@lru_cache(maxsize=4)
def _transform_of_cell(
    resolution: float, z_min: float, z_max: float, radius: float, camera_z: float
) -> tuple[int, int, NDArray[np.complex128]]:
    """Return the reach of a ball and the side of the transform, cells; the Fourier transform of a cell's obstruction.

    A tile is smaller than the transform by twice the reach, see `RasterBalls.side`.
    """
    reach = math.ceil(radius / resolution + 0.5)
    offsets = np.arange(-reach, reach + 1) * resolution
    half = resolution / 2
    cell = Obstacle(shapely.box(-half, -half, half, half), z_min, z_max)
    dx, dy = np.meshgrid(offsets, offsets)
    kernel = polygon_obstruction([cell], dx.ravel(), dy.ravel(), camera_z, radius).reshape(dx.shape)
    tile = 1 << max(7, (8 * reach).bit_length())
    return reach, tile, np.fft.rfft2(kernel, (tile, tile))


def polygon_obstruction(obstacles: Sequence[Obstacle], x: Column, y: Column, z: Column, radius: float) -> FloatArray:
    """Return the obstructed fraction of the ball round each camera position, in closed form.

    The volume over a polygon is a signed sum over its edges of elementary integrals of the ball's column height
    (derived for this project, checked against Monte Carlo). Overlapping obstacles count once: groups that touch are cut
    into slabs between their heights, and merged within each slab. Points are processed tile by tile, with polygons
    clipped to the reach of the tile's balls.

    Parameters
    ----------
    obstacles : sequence of Obstacle
    x, y, z : (M,) arrays or numbers, broadcast
        Camera positions, m.
    radius : float
        Of the ball, m.

    Returns
    -------
    (M,) values in [0, 1].

    Examples
    --------
    A wall that fills the half-plane x > 1 takes (r - d)^2 (2 r + d) / (4 r^3) of the ball with r = 2:

    >>> wall = Obstacle(shapely.box(1, -9, 9, 9))
    >>> polygon_obstruction([wall], 0.0, 0.0, 0.0, 2.0).round(9)
    array([0.15625])
    """
    return prism_obstruction(*disjoint_prisms(obstacles), x, y, z, radius)


def prism_obstruction(
    parts: Sequence[BaseGeometry], heights: FloatArray, x: Column, y: Column, z: Column, radius: float
) -> FloatArray:
    """Return the obstructed fraction (M,) of the ball round each camera position, like :func:`polygon_obstruction`.

    The obstacles are prisms that do not overlap: polygons ``parts``, S of them, and their heights (S, 2), m, as
    :func:`disjoint_prisms` returns them.
    """
    columns = (np.asarray(c, dtype=np.float64) for c in (x, y, z))
    x, y, z = (np.ravel(c) for c in np.broadcast_arrays(*columns))
    volume = np.zeros(x.shape)
    if not parts:
        return volume
    order, cuts, boxes = _tiles(x, y, radius)
    tile, part_of = shapely.STRtree(parts).query(boxes, predicate="intersects")
    by_tile = np.lexsort((part_of, tile))
    tile, part_of = tile[by_tile], part_of[by_tile]
    first = np.flatnonzero(np.diff(tile, prepend=-1))
    for i, begin, end in zip(tile[first].tolist(), first, np.append(first, tile.size)[1:], strict=True):
        limits.check("the obstruction was sampled")
        points, box, found = order[cuts[i] : cuts[i + 1]], boxes[i], part_of[begin:end]
        edges, slab = _edges([shapely.intersection(parts[i], box) for i in found])
        part = np.zeros(points.size)
        fields._kernels.ball_volumes(edges, slab, heights[found], x[points], y[points], z[points], radius, part)
        volume[points] = part
    phi = volume / (4.0 / 3.0 * math.pi * radius**3)
    phi[np.abs(phi) < ROUNDING] = 0.0
    return np.clip(phi, 0.0, 1.0)


def disjoint_prisms(obstacles: Sequence[Obstacle]) -> tuple[list[BaseGeometry], FloatArray]:
    """Cut obstacles into S prisms that do not overlap; return their polygons and heights (S, 2), m.

    Obstacles whose polygons touch are cut at each height at which one of them begins or ends. Between two such heights
    there is one prism: the union of the polygons of the obstacles there.
    """
    geometries: list[BaseGeometry] = []
    heights: list[tuple[float, float]] = []
    for group in _groups([o.polygon for o in obstacles]):
        levels = sorted({level for i in group for level in obstacles[i].heights})
        for slab in pairwise(levels):
            inside = [obstacles[i].polygon for i in group if overlaps(obstacles[i].heights, slab)]
            if inside:
                geometries.append(inside[0] if len(inside) == 1 else shapely.union_all(inside))
                heights.append(slab)
    return geometries, np.array(heights).reshape(-1, 2)


def _groups(polygons: Sequence[Polygon]) -> list[IntArray]:
    """Group the indices of polygons that touch each other, directly or through other polygons."""
    if not polygons:
        return []
    tree, shapes = shapely.STRtree(polygons), np.asarray(polygons, dtype=object)
    label = np.arange(len(polygons))  # the lowest index so far of each polygon's group
    for begin in range(0, len(shapes), BLOCK):  # all pairs at once would be gigabytes where thousands overlap
        a, b = tree.query(shapes[begin : begin + BLOCK], predicate="intersects")
        a = label[a + begin]
        b = label[b]
        while (a != b).any():  # without scipy.sparse, which takes longer to import than most maps to sample
            np.minimum.at(label, np.maximum(a, b), np.minimum(a, b))
            while (label != label[label]).any():
                label = label[label]
            a, b = label[a], label[b]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _tiles(x: FloatArray, y: FloatArray, radius: float) -> tuple[IntArray, IntArray, NDArray[np.object_]]:
    """Sort points by square tiles of side 2 r, so that points of a tile need the same obstacles.

    Return the order of the points, the index (T + 1,) at which each tile begins in this order, and the boxes (T,) that
    the balls of each tile can reach.
    """
    side = 2.0 * radius
    column, row = np.floor(x / side), np.floor(y / side)
    order = np.lexsort((row, column))
    cuts = np.flatnonzero((np.diff(column[order]) != 0) | (np.diff(row[order]) != 0)) + 1
    cuts = np.concatenate([[0], cuts, [order.size]]) if order.size else np.zeros(1, np.int64)
    x0, y0 = (corner[order[cuts[:-1]]] * side for corner in (column, row))
    low, high = -1.01 * radius, side + 1.01 * radius
    return order, cuts, np.atleast_1d(shapely.box(x0 + low, y0 + low, x0 + high, y0 + high))


def _edges(geometries: Sequence[BaseGeometry]) -> tuple[FloatArray, IntArray]:
    """Return the edges (E, 4) of all rings, x0, y0, x1, y1 in m, and where those of each geometry begin (S + 1,)."""
    parts, owner = shapely.get_parts(np.asarray(geometries, dtype=object), return_index=True)
    area = shapely.area(parts) > 0
    rings, part = shapely.get_rings(shapely.orient_polygons(parts[area]), return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    edges = np.concatenate([points[:-1][same], points[1:][same]], axis=1)
    slab = owner[area][part[ring[:-1][same]]]
    return edges, np.searchsorted(slab, np.arange(len(geometries) + 1)).astype(np.int64)


class SolidBalls:
    """Fraction of the ball of ``radius`` m round a point that convex bodies fill, as a function of the point.

    The fraction changes slowly: by at most 3/4 when the centre moves by the radius. Rays measure it at the nodes of a
    grid, a tenth of the radius apart, and smooth cubics (Catmull and Rom 1974) interpolate. A node is computed when a
    point near it is first needed. Its value does not depend on the order of the points.
    """

    def __init__(self, surfaces: Surfaces, radius: float) -> None:
        self._surfaces, self._radius, self._spacing = surfaces, radius, radius / PER_RADIUS
        self._middle = surfaces.rounds[:, :3].mean(axis=0) if len(surfaces) else np.zeros(3)
        self._keys, self._values = np.empty(0, np.int64), np.empty(0)
        self._lock = RLock()

    @property
    def nbytes(self) -> int:
        """Return the memory of the nodes computed so far, bytes."""
        return self._keys.nbytes + self._values.nbytes

    def __call__(self, places: FloatArray) -> FloatArray:
        """Return the filled fractions (N,), in [0, 1], of the balls round points (N, 3), m."""
        if not len(self._surfaces):
            return np.zeros(len(places))
        scaled = np.clip((places - self._middle) / self._spacing, 4.0 - SIDE, SIDE - 4.0)
        corner = np.floor(scaled)
        cells, which = np.unique((corner.astype(np.int64) + SIDE) @ STRIDES, return_inverse=True)
        share = self._at(cells[:, None] + AROUND).reshape(-1, 4, 4, 4)[which]  # (N, 4, 4, 4)
        powers = (scaled - corner)[..., None] ** np.arange(4)
        for weights in np.einsum("nik,kj->inj", powers, CUBICS)[::-1]:
            share = np.einsum("n...j,nj->n...", share, weights)
        return np.clip(share, 0.0, 1.0)

    def _at(self, nodes: IntArray) -> FloatArray:
        """Return the filled fractions at nodes, integer keys of any shape; missing ones are computed by one thread."""
        some, which = np.unique(nodes, return_inverse=True)
        with self._lock:
            place = np.minimum(np.searchsorted(self._keys, some), max(0, self._keys.size - 1))
            new = some[self._keys[place] != some] if self._keys.size else some
            if new.size:
                made = self._surfaces.filled(self._places(new), self._radius, RAYS)
                if self._keys.size + new.size > MOST:
                    known = np.isin(self._keys, some, assume_unique=True)
                    self._keys, self._values = self._keys[known], self._values[known]
                keys, values = np.append(self._keys, new), np.append(self._values, made)
                order = np.argsort(keys, kind="stable")
                self._keys, self._values = keys[order], values[order]
                place = np.searchsorted(self._keys, some)
            found: FloatArray = self._values[place][which.reshape(nodes.shape)]
        return found

    def _places(self, nodes: IntArray) -> FloatArray:
        """Return the positions (N, 3), m, of nodes, which are numbered by integer keys (N,)."""
        numbers = np.stack([nodes >> 42, nodes >> 21 & 2 * SIDE - 1, nodes & 2 * SIDE - 1], axis=1) - SIDE
        return self._middle + self._spacing * numbers


def filled(world: World, radius: float) -> SolidBalls:
    """Return a function of points, cached: the fraction of the ball of ``radius`` m round each that obstacles fill."""
    ground = world.ground
    return ground.derived(("filled balls", radius), lambda: SolidBalls(surfaces_of(world), radius))
