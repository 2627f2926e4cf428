"""How often outlines cross, counted before GEOS looks at them: what it does with crossings cannot be stopped.

GEOS mends an outline in a time that grows with the square of its crossings and more (1,700 take 1 s, 10,000 take 22 s),
joins outlines in 15 microseconds a crossing, and tests an outline in time that grows with the pairs of segments whose
boxes overlap. The counts are exact but for rounding, made in NumPy, and end once they are beyond a bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.errors import MapError
from hpop.runtime import limits

MOST_MENDED = 1_000
"""Crossings of an outline that is mended."""
MOST_SQUARES = 5 * MOST_MENDED**2
"""Sum of the squared numbers of crossings of all outlines of a file that are mended: some seconds."""
MOST_JOINED = 100_000
"""Crossings of outlines that are joined."""
MOST_NEAR = 200_000
"""Pairs of segments of a line that are so near to each other that their strips overlap."""
MOST_PAIRS = 20_000_000
"""Pairs of segments whose boxes overlap."""
AT_ONCE = 1_000_000
"""Pairs of segments that are looked at together, about."""


def check_mendable(outline: BaseGeometry, what: str) -> int:
    """Return how often an outline crosses itself.

    Raises MapError where that is more than `MOST_MENDED` times, or the outline lies on itself again and again.
    """
    segments = _segments([outline])
    found = _bound(what, "crosses itself", MOST_MENDED, (_crossings(*pair) for pair in _pairs(segments, what)))
    touching = (_crossings(*pair, touching=True) for pair in _pairs(segments, what))
    _bound(what, "touches itself", MOST_JOINED + 10 * len(segments), touching)  # neighbours do
    return found


def check_mendable_together(crossings: Sequence[int], what: str) -> None:
    """Refuse outlines whose numbers of crossings are each within `MOST_MENDED`, but take too long together."""
    if sum(count * count for count in crossings) > MOST_SQUARES:
        raise MapError(
            f"{what}: {len(crossings):,} of its outlines cross themselves {sum(crossings):,} times in all, up to "
            f"{max(crossings):,} times each; expected a floor plan. Simplify them, or leave them out."
        )


def check_each_joinable(outlines: NDArray[np.object_], names: Sequence[object]) -> None:
    """Refuse outlines any of which crosses itself more than `MOST_JOINED` times; most have too few points for that."""
    for i in np.flatnonzero(_may_cross(shapely.get_num_coordinates(outlines))).tolist():
        check_joinable([outlines[i]], str(names[i]))


def check_joinable(outlines: Sequence[BaseGeometry], what: str) -> None:
    """Refuse outlines whose segments cross more than `MOST_JOINED` times."""
    if _may_cross(shapely.get_num_coordinates(outlines).sum()):
        crossings = (_crossings(*pair) for pair in _pairs(_segments(outlines), what))
        _bound(what, "has outlines that cross", MOST_JOINED, crossings)


def check_widenable(line: BaseGeometry, distance: float, what: str) -> None:
    """Refuse a line of so many segments that a strip along it, as far as the distance to its sides, is of no use."""
    near = (len(first) for first, _ in _pairs(_segments([line]), what, margin=distance))
    _bound(what, "comes near to itself", MOST_NEAR, near)


def _may_cross(count: Any) -> Any:
    """Whether outlines of so many points can cross more than `MOST_JOINED` times."""
    return count * count > 2 * MOST_JOINED


def _bound(what: str, does: str, most: int, counts: Iterator[int]) -> int:
    """Return how often something is done; raise MapError where that is more often than ``most`` times."""
    found = 0
    for count in counts:
        found += count
        if found > most:
            raise MapError(
                f"{what} {does} at least {found:,} times; expected a floor plan, at most {most:,} times. Simplify it, "
                "or leave it out."
            )
    return found


def _pairs(segments: FloatArray, what: str, margin: float = 0.0) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Pairs of segments (m, 2, 2) whose boxes, grown by a margin, overlap; each pair once, about a million at once."""
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
                f"{what} has {len(segments):,} segments that lie across one another; expected a floor plan. Simplify "
                "it, or leave it out."
            )
        yield segments[first[later] + begin], segments[second[later]]
        begin += step
        step = max(1, min(2 * step, step * AT_ONCE // max(1, first.size)))


def _segments(outlines: Sequence[BaseGeometry]) -> FloatArray:
    """Ends (n, 2, 2) of the segments of all lines and rings, those of no length left out."""
    parts = shapely.get_parts(outlines)
    polygons = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    lines = np.concatenate([parts[~polygons], shapely.get_rings(parts[polygons])])
    points, line = shapely.get_coordinates(lines, return_index=True)
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    return np.asarray(pairs[(line[:-1] == line[1:]) & (pairs[:, 0] != pairs[:, 1]).any(axis=1)])


def _crossings(first: FloatArray, second: FloatArray, *, touching: bool = False) -> int:
    """How many pairs of segments (m, 2, 2), whose boxes overlap, cross, or also touch."""
    for _ in range(2):
        apart = _side(first, second[:, 0]) * _side(first, second[:, 1])
        meet = apart <= 0 if touching else apart < 0
        first, second = second[meet], first[meet]
    return len(first)


def _side(segments: FloatArray, points: FloatArray) -> FloatArray:
    """-1, 0 or 1 (m,): on which side of the lines through segments the points lie."""
    u, v = segments[:, 1] - segments[:, 0], points - segments[:, 0]
    return np.asarray(np.sign(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))
