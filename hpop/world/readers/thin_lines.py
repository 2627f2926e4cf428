"""Lines among the obstacles of a blueprint that are thinner than its walls: swings of doors, windows, dimensions."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.geometry.shapes import Raster
from hpop.world.readers.blueprint import MOST_SPECKS, TOLD, areas_of, numbered

THIN = 3
"""Pixels that a line is thick, at most, which is told apart from walls."""
WALLS = 0.5
"""Share of the dark pixels that are of walls, at least, where lines are told apart: else walls are lines as well."""
ROOM = 1.0
"""Area, m², of a part of the free space that counts as a room."""
MOST = 1_000
"""Pixels up to which lines are left out."""

_ROUND = np.ones((3, 3), dtype=bool)


def without_lines(raster: Raster, thinnest: float) -> tuple[BoolArray, str]:
    """Return cells without what is thinner than ``thinnest`` (m), and a note on how much is left out."""
    pixels = min(MOST, math.ceil(thinnest / raster.resolution - 1e-9))
    kept = _thick(raster.cells, pixels)
    left = np.count_nonzero(raster.cells) - np.count_nonzero(kept)
    square = raster.resolution**2
    return kept, f"lines thinner than {thinnest:g} m are left out, {left:,} pixels, {left * square:.3g} m² in all"


def closing(raster: Raster) -> Iterator[str]:
    """Yield a note on thin lines that part rooms where all walls are thicker, such as the swings of doors."""
    cells = raster.cells
    thick = _thick(cells, THIN + 1)
    thin = cells & ~thick
    if not thin.any() or np.count_nonzero(thick) < WALLS * np.count_nonzero(cells):
        return
    from scipy import ndimage

    lines, count = numbered(thin, _ROUND)
    if count > MOST_SPECKS:
        return
    rooms, found = numbered(~cells, None)
    large = areas_of(rooms, found) * raster.resolution**2 >= ROOM
    large[0] = False
    pairs = np.unique(np.concatenate([*_beside(lines, rooms, large)]), axis=0)
    numbers, beside = np.unique(pairs[:, 0], return_counts=True)
    parting = numbers[beside > 1]
    if not parting.size:
        return
    boxes = ndimage.find_objects(lines)
    places = []
    for number in parting[:TOLD].tolist():
        rows, columns = boxes[number - 1]
        x, y = raster.to_world((columns.start + columns.stop) / 2, (rows.start + rows.stop) / 2)
        places.append(f"({x:.2f}, {y:.2f})")
    thickness = (THIN + 1) * raster.resolution
    yield (
        f"{parting.size:,} lines of up to {THIN * raster.resolution:.2g} m close passages, thinner than the walls, at "
        f"{', '.join(places)}{', ...' * (parting.size > TOLD)}: swings of doors, or windows. thinnest_obstacle: "
        f"{thickness:.3g} (m) leaves out all lines as thin"
    )


def _beside(lines: NDArray[np.int32], rooms: NDArray[np.int32], large: BoolArray) -> Iterator[NDArray[np.int32]]:
    """Yield pairs (n, 2) of a line and a room whose pixels are neighbours."""
    for a, b in (
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
    ):
        for line, room in ((lines[a], rooms[b]), (lines[b], rooms[a])):
            both = (line > 0) & large[room]
            yield np.unique(np.stack([line[both], room[both]], axis=1), axis=0)


def _thick(cells: BoolArray, pixels: int) -> BoolArray:
    """Cells of which a square of some pixels fits into the obstacles, or which are next to one."""
    if pixels <= 1:
        return cells
    from scipy import ndimage

    limits.hold(READING, 0, 3 * cells.size)
    found = cells.astype(np.uint8)
    for axis in (0, 1):  # what is beyond the image is as what is at its edge
        found = ndimage.minimum_filter1d(found, pixels, axis=axis, mode="nearest")
    even = -1 if pixels % 2 == 0 else 0  # the squares are those whose least pixels were taken
    for axis in (0, 1):
        found = ndimage.maximum_filter1d(found, pixels, axis=axis, mode="constant", cval=0, origin=even)
    near = ndimage.maximum_filter(found, 2 * (pixels // 2) + 1)  # corners of walls that are turned
    return np.asarray(cells & (near > 0))
