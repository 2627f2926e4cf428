"""Compiled helpers: the outline of a box or hull as seen from a point, compared with rays that are aimed at a disc.

A plane through the point meets the disc in a line. So a hull is seen as a convex polygon on the disc, whose sides are
such lines, and each ray is a point on the disc.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import inlined, lean
from hpop.world.geometry._kernels import TOUCH

BOX = 3  # most planes of a box that face a point outside it
EDGES, CORNERS = 12, 8  # of a box
NONE, UNSURE = -1, -2  # no ray enters a hull; the outline of a hull does not decide it
Memory = tuple[FloatArray, NDArray[np.uint8], FloatArray, IntArray]
"""Scratch memory: a gap and a flag of each face, three coordinates of each corner, and numbers of edges."""


@inlined
def _side(a: tuple[float, ...], b: tuple[float, ...], inward: bool) -> tuple[float, float, float]:
    """Return numbers x, y, z of the line through two points a and b of the disc: x + y s + z t > 0 is outside it.

    a, b    as `_seen` returns them
    inward  whether the outside is to the right of the way from a to b
    """
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return (x, y, z) if inward else (-x, -y, -z)


@inlined
def _where(side: tuple[float, float, float], spot: tuple[float, float, float]) -> int:
    """Return whether a circle on the disc is outside a side (1), inside it (-1), or neither for sure (0).

    spot  coordinates s, t of its centre, and its radius
    """
    middle = side[0] + side[1] * spot[0] + side[2] * spot[1]
    if middle * middle <= spot[2] * spot[2] * (side[1] * side[1] + side[2] * side[2]):
        return 0
    return 1 if middle > 0.0 else -1


@inlined
def _seen(corners: FloatArray, c: int, o: tuple[float, ...], rays: tuple[float, ...]) -> tuple[float, float, float]:
    """Return homogeneous coordinates of a corner on the disc, as seen from the point o: (1, s, t) times its depth."""
    x, y, z = corners[0, c] - o[0], corners[1, c] - o[1], corners[2, c] - o[2]
    return (
        x * rays[0] + y * rays[1] + z * rays[2],
        x * rays[3] + y * rays[4] + z * rays[5],
        x * rays[6] + y * rays[7] + z * rays[8],
    )


@lean
def still_apart(
    columns: FloatArray,
    first: int,
    corners: FloatArray,
    tip: int,
    side: NDArray[np.uint32],
    o: tuple[float, ...],
    rays: tuple[float, ...],
    spot: tuple[float, float, float],
) -> bool:
    """Return whether an edge of a hull belongs to its outline and keeps all rays of a spot off the hull; see `cut`."""
    i, j = first + side[0], first + side[1]
    faces_i = columns[3, i] < columns[0, i] * o[0] + columns[1, i] * o[1] + columns[2, i] * o[2]
    faces_j = columns[3, j] < columns[0, j] * o[0] + columns[1, j] * o[1] + columns[2, j] * o[2]
    if faces_i == faces_j:
        return False
    ends = _seen(corners, tip + side[2], o, rays), _seen(corners, tip + side[3], o, rays)
    return bool(_where(_side(ends[0], ends[1], faces_i), spot) == 1)


@lean
def cut(
    columns: FloatArray,
    first: int,
    last: int,
    corners: FloatArray,
    tip: int,
    past: int,
    sides: NDArray[np.uint32],
    begin: int,
    end: int,
    o: tuple[float, ...],
    rays: tuple[float, ...],
    spot: tuple[float, float, float],
    memory: Memory,
    lines: FloatArray,
) -> tuple[int, int]:
    """Write the sides of a hull's outline, as seen from o, that lie among the rays of a spot.

    Return their number: 0 if all rays enter the hull, NONE if no ray does, and UNSURE if o is not clear of the hull;
    and an edge whose side keeps all rays off the hull, or -1. The outline consists of the edges between a
    face that faces o and a face that does not; rays that enter the hull are inside all sides. See `_side` for what is
    written.

    columns  planes (4, P); the hull has numbers ``first`` to ``last``
    corners  (3, C); the hull has numbers ``tip`` to ``past``
    sides    edges, see `Surfaces`; the hull has numbers ``begin`` to ``end``
    rays     vectors from o to the middle of the disc, and from there to its points (1, 0) and (0, 1), each divided by
             the square of its length
    spot     centre and radius of a circle on the disc, which contains the rays
    memory   scratch memory
    """
    gaps, facing, seen, outline = memory
    for k in range(last - first):
        gap = columns[3, first + k] - columns[0, first + k] * o[0] - columns[1, first + k] * o[1]
        gaps[k] = gap - columns[2, first + k] * o[2]
    for k in range(last - first):
        facing[k] = gaps[k] < 0.0
    count = 0
    for e in range(begin, end):  # without branches, which the processor would guess wrongly
        outline[count] = e
        count += facing[sides[e, 0]] != facing[sides[e, 1]]
    if count == 0:
        return UNSURE, -1
    for k in range(past - tip):
        x, y, z = corners[0, tip + k] - o[0], corners[1, tip + k] - o[1], corners[2, tip + k] - o[2]
        seen[0, k] = x * rays[0] + y * rays[1] + z * rays[2]
        seen[1, k] = x * rays[3] + y * rays[4] + z * rays[5]
        seen[2, k] = x * rays[6] + y * rays[7] + z * rays[8]
    room, is_clear = 0, False
    for at in range(count):
        e = outline[at]
        i, j, a, b = sides[e, 0], sides[e, 1], sides[e, 2], sides[e, 3]
        is_clear |= min(gaps[i], gaps[j]) < -2.0 * TOUCH
        side = _side((seen[0, a], seen[1, a], seen[2, a]), (seen[0, b], seen[1, b], seen[2, b]), facing[i] > 0)
        where = _where(side, spot)
        if where == 1:
            return NONE, e
        if where == 0:
            lines[room, 0], lines[room, 1], lines[room, 2] = side
            room += 1
    return room if is_clear else UNSURE, -1


@lean
def depths(columns: FloatArray, first: int, d: tuple[float, ...], o: tuple[float, ...]) -> tuple[float, float]:
    """Return how far a box is along a vector d from the point o: the least and greatest product of d with its points.

    first  number of the first plane of the box, whose planes face its axes x, y, z, and away from them
    """
    low = high = -d[0] * o[0] - d[1] * o[1] - d[2] * o[2]
    for k in range(first, first + BOX):
        along = columns[0, k] * d[0] + columns[1, k] * d[1] + columns[2, k] * d[2]
        far, near = along * columns[3, k], -along * columns[3, k + BOX]
        low, high = low + min(far, near), high + max(far, near)
    return low, high
