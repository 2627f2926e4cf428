"""Compiled loops that test whether convex hulls come near edges, and look points up in occupancy cells.

Imported on first use, because importing numba is slow.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.runtime.compiled import is_cached, lean

MEETS, CLEAR, UNSURE = 0, 1, 2
FEW = 10_000  # hulls that GEOS compares in half of the time that the loop takes to compile
THIN = 1e-3  # area of a hull over its squared perimeter; thinner hulls are too thin for the test by half-planes


@lean
def make_hull(points: FloatArray, hull: FloatArray) -> int:
    """Write the convex hull of points (c, 2) to ``hull`` (2 c, 2), counter-clockwise; return its number of corners.

    The points are sorted in place (Andrew's monotone chain).
    """
    count = len(points)
    for i in range(1, count):
        x, y = points[i, 0], points[i, 1]
        j = i - 1
        while j >= 0 and (points[j, 0] > x or (points[j, 0] == x and points[j, 1] > y)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = x, y
    size = 0
    for side in range(2):
        least = size + 1 if side == 0 else size
        for i in range(count):
            k = i if side == 0 else count - 1 - i
            x, y = points[k, 0], points[k, 1]
            while size > least and (
                (hull[size - 1, 0] - hull[size - 2, 0]) * (y - hull[size - 2, 1])
                - (hull[size - 1, 1] - hull[size - 2, 1]) * (x - hull[size - 2, 0])
                <= 0.0
            ):
                size -= 1
            if size == 0 or x != hull[size - 1, 0] or y != hull[size - 1, 1]:
                hull[size, 0], hull[size, 1] = x, y
                size += 1
    if size > 1 and hull[size - 1, 0] == hull[0, 0] and hull[size - 1, 1] == hull[0, 1]:
        size -= 1
    return size


@lean
def meets_within(
    hull: FloatArray, normals: FloatArray, size: int, grown: float, ax: float, ay: float, bx: float, by: float
) -> bool:
    """Return whether the segment from a to b meets a hull whose sides have been moved outwards by ``grown``, m.

    A negative ``grown`` moves them inwards.

    normals  (size, 3)  outward unit normal (x, y) of each side, and its offset from the origin, m
    """
    first, last = 0.0, 1.0
    for i in range(size):
        off = normals[i, 2] + grown
        a = normals[i, 0] * ax + normals[i, 1] * ay - off
        b = normals[i, 0] * bx + normals[i, 1] * by - off
        if a > 0.0:
            if b > 0.0:
                return False
            first = max(first, a / (a - b))
        elif b > 0.0:
            last = min(last, a / (a - b))
        if first > last:
            return False
    return True


@lean
def square_away(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance, m², from a point to the segment from a to b."""
    wx, wy, dx, dy = x - ax, y - ay, bx - ax, by - ay
    length2 = dx * dx + dy * dy
    if length2 > 0.0:
        t = min(max((wx * dx + wy * dy) / length2, 0.0), 1.0)
        wx -= t * dx
        wy -= t * dy
    return wx * wx + wy * wy


@lean
def crosses(hull: FloatArray, slack: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether the segment between the first two corners of a hull crosses the segment from a to b.

    Return False if any of the four ends is within ``slack``, m, of the line of the other segment.
    """
    x, y, u, v = hull[0, 0], hull[0, 1], hull[1, 0], hull[1, 1]
    p = (u - x) * (ay - y) - (v - y) * (ax - x)
    q = (u - x) * (by - y) - (v - y) * (bx - x)
    r = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    s = (bx - ax) * (v - ay) - (by - ay) * (u - ax)
    beside = slack * math.sqrt((u - x) * (u - x) + (v - y) * (v - y))
    beyond = slack * math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
    is_apart: bool = min(abs(p), abs(q)) > beside and min(abs(r), abs(s)) > beyond
    is_crossed: bool = p * q < 0.0 and r * s < 0.0
    return is_apart and is_crossed


@lean
def square_between(hull: FloatArray, size: int, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance, m2, of the sides of a hull from the segment from a to b, which does not meet it."""
    least = math.inf
    for i in range(size):
        j = i + 1 if i + 1 < size else 0
        x, y, u, v = hull[i, 0], hull[i, 1], hull[j, 0], hull[j, 1]
        least = min(least, square_away(x, y, ax, ay, bx, by))
        least = min(least, square_away(ax, ay, x, y, u, v), square_away(bx, by, x, y, u, v))
    return least


@lean
def compare_hulls(
    edges: FloatArray,
    members: IntArray,
    boxes: FloatArray,
    waiting: IntArray,
    corners: FloatArray,
    points: FloatArray,
    hull: FloatArray,
    normals: FloatArray,
    margin: float,
    slack: float,
    out: NDArray[np.uint8],
) -> None:
    """Test how near the edges of a tree come to the convex hulls of corners (N, c, 2), m.

    The result for each hull is written to out (N,), which must be CLEAR before the first call. It becomes MEETS if an
    edge comes closer than ``margin``, m, or, without a margin, passes through the interior. It becomes UNSURE if the
    answer depends on rounding, up to ``slack``, m. Hulls that are MEETS before the call are skipped.

    See `EdgeTree` for edges, members and boxes. waiting, points (c, 2), hull (2 c, 2), normals (2 c, 3) are scratch.
    """
    inner, width = len(boxes) - len(members), members.shape[1]
    for n in range(len(corners)):
        if out[n] == MEETS:
            continue
        for i in range(len(points)):
            points[i, 0], points[i, 1] = corners[n, i, 0], corners[n, i, 1]
        size = make_hull(points, hull)
        x_min = y_min = math.inf
        x_max = y_max = -math.inf
        area = round_it = 0.0
        for i in range(size):
            x, y = hull[i, 0], hull[i, 1]
            x_min, y_min, x_max, y_max = min(x_min, x), min(y_min, y), max(x_max, x), max(y_max, y)
            j = i + 1 if i + 1 < size else 0
            dx, dy = hull[j, 0] - x, hull[j, 1] - y
            length = math.sqrt(dx * dx + dy * dy)
            area += 0.5 * ((x - hull[0, 0]) * dy - (y - hull[0, 1]) * dx)
            round_it += length
            if length > 0.0:
                normals[i, 0], normals[i, 1] = dy / length, -dx / length
            else:
                normals[i, 0] = normals[i, 1] = 0.0
            normals[i, 2] = normals[i, 0] * x + normals[i, 1] * y
        reach = margin + slack
        x_min, y_min, x_max, y_max = x_min - reach, y_min - reach, x_max + reach, y_max + reach
        is_thin = size > 2 and area < THIN * round_it * round_it
        unsure = meets = False
        waiting[0] = 0
        count = 1
        while count > 0 and not meets:
            count -= 1
            node = waiting[count]
            if boxes[node, 0] > x_max or boxes[node, 2] < x_min or boxes[node, 1] > y_max or boxes[node, 3] < y_min:
                continue
            if node < inner:
                waiting[count], waiting[count + 1] = 2 * node + 1, 2 * node + 2
                count += 2
                continue
            for m in range(width):
                e = members[node - inner, m]
                ax, ay, bx, by = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
                if min(ax, bx) > x_max or max(ax, bx) < x_min or min(ay, by) > y_max or max(ay, by) < y_min:
                    continue
                if math.isinf(ax) or not meets_within(hull, normals, size, reach, ax, ay, bx, by):
                    continue
                if size == 2 and crosses(hull, slack, ax, ay, bx, by):
                    meets = True
                    break
                if is_thin or (margin <= 0.0 and size > 2):
                    unsure = True
                    if not is_thin and meets_within(hull, normals, size, -slack, ax, ay, bx, by):
                        meets = True
                        break
                    continue
                least = math.sqrt(square_between(hull, size, ax, ay, bx, by))
                if size > 2 and meets_within(hull, normals, size, 0.0, ax, ay, bx, by):
                    least = 0.0
                if least < margin - slack:
                    meets = True
                    break
                unsure |= least <= reach
        if meets:
            out[n] = MEETS
        elif unsure:
            out[n] = UNSURE


class HullCount:
    """Number of hulls that `is_worth_compiling` has counted in this process.

    It begins at 0, and is set to `FEW` if the compiled loop is on disk. From `FEW` on, the loop compares hulls.
    """

    hulls = 0


def is_worth_compiling(hulls: int) -> bool:
    """Count ``hulls`` more hulls, and return whether to compare them by the compiled loop rather than by GEOS.

    The loop is used if its compiled form is on disk, or if at least `FEW` hulls have been counted in this process, with
    these. Its first call then compiles it.
    """
    if HullCount.hulls < FEW and is_cached(compare_hulls):
        HullCount.hulls = FEW
    HullCount.hulls += hulls
    return HullCount.hulls >= FEW


@lean
def inside_cells(
    cells: BoolArray, xs: FloatArray, ys: FloatArray, x: FloatArray, y: FloatArray, out: BoolArray
) -> None:
    """Write to out (M,) whether each point is strictly inside the free region: all cells that touch it are free.

    xs (W + 1,) and ys (H + 1,) are the coordinates, m, of the lines between columns and between rows.
    """
    rows, columns = cells.shape
    across, up = columns / (xs[columns] - xs[0]), rows / (ys[rows] - ys[0])
    for n in range(x.size):
        out[n] = False
        if not (xs[0] < x[n] < xs[columns] and ys[0] < y[n] < ys[rows]):
            continue
        column = min(max(int((x[n] - xs[0]) * across), 0), columns - 1)
        while xs[column] > x[n]:
            column -= 1
        while xs[column + 1] <= x[n]:
            column += 1
        row = min(max(int((y[n] - ys[0]) * up), 0), rows - 1)
        while ys[row] > y[n]:
            row -= 1
        while ys[row + 1] <= y[n]:
            row += 1
        free = True
        for j in range(column - 1 if xs[column] == x[n] else column, column + 1):
            for i in range(row - 1 if ys[row] == y[n] else row, row + 1):
                free &= not cells[i, j]
        out[n] = free
