"""The compiled inner loop of `hpop.world.edge_grid.EdgeGrid`."""

from __future__ import annotations

import math

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import kernel


@kernel
def _squared(x: float, y: float, edges: FloatArray, e: int) -> float:
    """Squared distance of a point to an edge, m^2."""
    px, py = edges[e, 0], edges[e, 1]
    dx, dy = edges[e, 2] - px, edges[e, 3] - py
    wx, wy = x - px, y - py
    length2 = dx * dx + dy * dy
    if length2 > 0.0:
        t = min(max((wx * dx + wy * dy) / length2, 0.0), 1.0)
        wx -= t * dx
        wy -= t * dy
    squared: float = wx * wx + wy * wy
    return squared


@kernel
def nearest(
    edges: FloatArray,
    start: IntArray,
    members: IntArray,
    rings: IntArray,
    corner_x: float,
    corner_y: float,
    side: float,
    x: FloatArray,
    y: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (M,) the distance of each point to its nearest edge; see `EdgeGrid` for the arrays.

    All edges outside the first k rings of buckets round the point are at least k sides and the way to the
    border of its own bucket away. That also holds for a point off the grid, seen from its projection on the
    grid.
    """
    rows, columns = rings.shape
    for n in range(x.size):
        if math.isnan(x[n]) or math.isnan(y[n]):
            out[n] = math.nan
            continue
        u = min(max((x[n] - corner_x) / side, 0.0), float(columns))
        v = min(max((y[n] - corner_y) / side, 0.0), float(rows))
        j, i = min(int(u), columns - 1), min(int(v), rows - 1)
        own = min(min(u - j, j + 1 - u), min(v - i, i + 1 - v))
        best = math.inf
        k = rings[i, j]
        while k <= rows + columns:
            for a in range(max(i - k, 0), min(i + k, rows - 1) + 1):
                # Whole rows at the top and bottom of the ring, else its two ends.
                step = 1 if a == i - k or a == i + k else max(2 * k, 1)
                for b in range(j - k, j + k + 1, step):
                    if 0 <= b < columns:
                        for m in range(start[a * columns + b], start[a * columns + b + 1]):
                            best = min(best, _squared(x[n], y[n], edges, members[m]))
            bound = (k + own) * side
            if best <= bound * bound:
                break
            k += 1
        out[n] = math.sqrt(best)
