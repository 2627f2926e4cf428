"""Outlines of occupied cells: where solid meets free, and nothing else, is looked at.

GEOS joins squares in a time that grows faster than their number, and cannot be stopped meanwhile: 800 x 800 cells of
noise take a minute. Their borders are known, so it is only asked which rings they make: 13 microseconds a corner.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, IntArray
from hpop.errors import MapError
from hpop.runtime import limits

MOST_CORNERS = 500_000
"""Corners of outlines: some seconds. The largest real maps at hand have some thousands; noise has them."""


def outlined(cells: BoolArray) -> BaseGeometry:
    """Union of unit squares, one for each cell (H, W) that is True, exact; a corner wherever an outline turns.

    Raises MapError where there are more than `MOST_CORNERS`.
    """
    limits.check("cells were outlined")
    padded = np.pad(cells, 1)
    south_west, south_east, north_west, north_east = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    right, up = south_east != north_east, north_west != north_east  # borders that leave each vertex (H + 1, W + 1)
    corner = (right | (south_west != north_west)) & (up | (south_west != south_east))
    count = int(np.count_nonzero(corner))
    if count > MOST_CORNERS:
        rows, columns = cells.shape
        raise MapError(
            f"the outlines of {columns:,} x {rows:,} cells have {count:,} corners, expected at most {MOST_CORNERS:,}. "
            "So many are noise: remove specks from the image (a median filter), or make its cells larger."
        )
    if count == 0:
        return MultiPolygon()
    limits.check("cells were outlined")
    y, x = np.nonzero(corner)
    turned_x, turned_y = np.nonzero(corner.T)
    across, upward = _borders(x, y, right), _borders(turned_x, turned_y, up)
    borders: NDArray[np.object_] = np.asarray(shapely.linestrings(np.concatenate([across, upward])))
    faces = shapely.get_parts(shapely.polygonize(borders))
    column, row = _lowest(shapely.get_exterior_ring(faces)).T
    found = faces[cells[row, column]].tolist()
    return found[0] if len(found) == 1 else MultiPolygon(found)


def _borders(x: IntArray, y: IntArray, leave: BoolArray) -> IntArray:
    """Straight borders (n, 2, 2) from corners to the next ones in their row or column, which the corners follow."""
    first = np.flatnonzero(leave[y, x])
    points = np.stack([x, y], axis=1)
    return np.stack([points[first], points[first + 1]], axis=1)


def _lowest(rings: NDArray[np.object_]) -> IntArray:
    """The lowest point (n, 2) of each ring, of several the leftmost: the cell above to the right lies within."""
    points, ring = shapely.get_coordinates(rings, return_index=True)
    order = np.lexsort((points[:, 0], points[:, 1], ring))
    first = order[np.flatnonzero(np.append(True, np.diff(ring) > 0))]
    lowest: IntArray = points[first].astype(np.int64)
    return lowest
