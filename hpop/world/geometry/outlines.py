"""Outlines of cells and polygons: traced round occupied cells, and checked before the library GEOS processes them.

GEOS cannot be interrupted, and its time grows fast with the input. Joining squares takes more than linear time (a
minute for 800 x 800 cells of noise), so only the borders of cells become rings here. Mending an outline (making a
self-crossing polygon valid) takes at least quadratic time in its crossings. Testing an outline takes time in proportion
to the pairs of segments with overlapping boxes. Crossings and pairs are counted here with NumPy, exactly up to
rounding, and outlines with too many are refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray, IntArray, marked
from hpop.errors import MapError
from hpop.runtime import limits

MOST_CORNERS = 500_000
"""Largest number of corners of outlines, some seconds of work.

Large real maps have thousands; noise has more than this.
"""
MOST_MENDED = 1_000
"""Largest number of crossings of an outline that is mended."""
MOST_SQUARES = 5 * MOST_MENDED**2
"""Largest sum, over the outlines of a file, of their squared numbers of crossings: some seconds of mending."""
MOST_JOINED = 100_000
"""Largest number of crossings of outlines that are joined."""
MOST_NEAR = 200_000
"""Largest number of pairs of segments of a line, neighbours included, whose strips may overlap when it is widened."""
MOST_PAIRS = 20_000_000
"""Largest number of pairs of segments whose bounding boxes overlap."""
AT_ONCE = 1_000_000
"""Pairs of segments that are compared together, approximately."""


def outlined(cells: BoolArray) -> BaseGeometry:
    """Return the exact union of unit squares, one for each True cell (H, W); corners only where its outline turns.

    Raises MapError for more than `MOST_CORNERS` corners.
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
    y, x = marked(corner)
    turned_x, turned_y = marked(corner.T)
    across, upward = _borders(x, y, right), _borders(turned_x, turned_y, up)
    borders: NDArray[np.object_] = np.asarray(shapely.linestrings(np.concatenate([across, upward])))
    faces = shapely.get_parts(shapely.polygonize(borders))
    column, row = _lowest(shapely.get_exterior_ring(faces)).T
    found = faces[cells[row, column]].tolist()
    return found[0] if len(found) == 1 else MultiPolygon(found)


def _borders(x: IntArray, y: IntArray, leave: BoolArray) -> IntArray:
    """Return straight borders (n, 2, 2): from each corner marked in ``leave`` to the next of the corners (x, y).

    x, y   coordinates of the corners, sorted along rows or columns
    leave  mask by y and x
    """
    first = np.flatnonzero(leave[y, x])
    points = np.stack([x, y], axis=1)
    return np.stack([points[first], points[first + 1]], axis=1)


def _lowest(rings: NDArray[np.object_]) -> IntArray:
    """Return the lowest point (n, 2) of each ring, the leftmost if there are several.

    The cell above and to the right of this point is inside the ring.
    """
    points, ring = shapely.get_coordinates(rings, return_index=True)
    order = np.lexsort((points[:, 0], points[:, 1], ring))
    first = order[np.flatnonzero(np.append(True, np.diff(ring) > 0))]
    lowest: IntArray = points[first].astype(np.int64)
    return lowest


def check_mendable(outline: BaseGeometry, what: str) -> int:
    """Return the number of times an outline crosses itself, after checking that it can be mended in reasonable time.

    ``what`` names it in messages. Raises MapError for more than `MOST_MENDED` crossings, or too many points where it
    touches itself.
    """
    segments = _segments([outline])
    crossings = _bound(what, "crosses itself", MOST_MENDED, (_crossings(*pair) for pair in _pairs(segments, what)))
    touching = (_crossings(*pair, touching=True) for pair in _pairs(segments, what))
    _bound(what, "touches itself", MOST_JOINED + 10 * len(segments), touching)  # neighbours do
    return crossings


def check_mendable_together(crossings: Sequence[int], what: str) -> None:
    """Raise MapError for outlines that would take too long to mend together, given the crossings of each."""
    if sum(count * count for count in crossings) > MOST_SQUARES:
        raise MapError(
            f"{what}: {len(crossings):,} of its outlines cross themselves {sum(crossings):,} times in all, up to "
            f"{max(crossings):,} times each; a floor plan has far fewer crossings. Simplify them, or leave them out."
        )


def check_each_joinable(outlines: NDArray[np.object_], names: Sequence[object]) -> None:
    """Raise MapError if any outline crosses itself more than `MOST_JOINED` times."""
    for i in np.flatnonzero(_may_cross(shapely.get_num_coordinates(outlines))).tolist():
        check_joinable([outlines[i]], str(names[i]))


def check_joinable(outlines: Sequence[BaseGeometry], what: str) -> None:
    """Raise MapError for outlines with more than `MOST_JOINED` crossings among their segments."""
    if _may_cross(shapely.get_num_coordinates(outlines).sum()):
        crossings = (_crossings(*pair) for pair in _pairs(_segments(outlines), what))
        _bound(what, "has outlines that cross", MOST_JOINED, crossings)


def check_widenable(line: BaseGeometry, distance: float, what: str) -> None:
    """Raise MapError if a strip of half-width ``distance``, m, along a line would overlap itself too often.

    Pairs of segments whose enlarged bounding boxes overlap are counted, up to `MOST_NEAR`.
    """
    near = (len(first) for first, _ in _pairs(_segments([line]), what, margin=distance))
    _bound(what, "comes near to itself", MOST_NEAR, near)


def _may_cross(count: Any) -> Any:
    """Return whether outlines of ``count`` points, a number or an array, can cross more than `MOST_JOINED` times."""
    return count * count > 2 * MOST_JOINED


def _bound(what: str, does: str, most: int, counts: Iterator[int]) -> int:
    """Return the sum of counts; raise MapError as soon as it is above ``most``.

    ``what`` and ``does`` are for the message, such as "a line of plan.dxf" and "crosses itself".
    """
    found = 0
    for count in counts:
        found += count
        if found > most:
            raise MapError(
                f"{what} {does} at least {found:,} times; expected at most {most:,} times in a floor plan. Simplify "
                "it, or leave it out."
            )
    return found


def _pairs(segments: FloatArray, what: str, margin: float = 0.0) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield pairs of segments, two arrays (m, 2, 2), with overlapping bounding boxes, enlarged by ``margin``, m.

    Each pair comes once, in large batches.
    """
    corners = np.concatenate([segments.min(axis=1) - margin, segments.max(axis=1) + margin], axis=1)
    boxes = np.atleast_1d(shapely.box(*corners.T))
    tree = shapely.STRtree(boxes)
    begin, step, looked = 0, 64, 0
    while begin < len(segments):
        limits.check("crossings of outlines were counted")
        first, second = tree.query(boxes[begin : begin + step])
        later = second > first + begin
        looked += int(np.count_nonzero(later))
        if looked > MOST_PAIRS:
            raise MapError(
                f"{what} has {len(segments):,} segments, of which more than {MOST_PAIRS:,} pairs lie so near "
                "that they may cross, too many for a floor plan. Simplify it, or leave it out."
            )
        yield segments[first[later] + begin], segments[second[later]]
        begin += step
        step = max(1, min(2 * step, step * AT_ONCE // max(1, first.size)))


def _segments(outlines: Sequence[BaseGeometry]) -> FloatArray:
    """Return the ends (n, 2, 2) of the segments of all lines and rings, except segments of length 0."""
    parts = shapely.get_parts(outlines)
    polygons = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    lines = np.concatenate([parts[~polygons], shapely.get_rings(parts[polygons])])
    points, line = shapely.get_coordinates(lines, return_index=True)
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    return np.asarray(pairs[(line[:-1] == line[1:]) & (pairs[:, 0] != pairs[:, 1]).any(axis=1)])


def _crossings(first: FloatArray, second: FloatArray, *, touching: bool = False) -> int:
    """Count the pairs of segments (m, 2, 2) that cross, or with ``touching`` also those that touch.

    The bounding boxes of each pair must overlap, as those from `_pairs` do.
    """
    for _ in range(2):
        apart = _side(first, second[:, 0]) * _side(first, second[:, 1])
        meet = apart <= 0 if touching else apart < 0
        first, second = second[meet], first[meet]
    return len(first)


def _side(segments: FloatArray, points: FloatArray) -> FloatArray:
    """Return the side of each point, relative to the line through its segment: 1 left, -1 right, 0 on the line (m,)."""
    u, v = segments[:, 1] - segments[:, 0], points - segments[:, 0]
    return np.asarray(np.sign(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))
