"""The compiled inner loop of `hpop.world.edge_grid.EdgeGrid`."""

from __future__ import annotations

import math

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import lean

# A first answer waits for this to be compiled, which takes longer for each function that is called.


@lean
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
        u = min(max((x[n] - corner_x) / side, 0.0), columns)
        v = min(max((y[n] - corner_y) / side, 0.0), rows)
        j, i = int(min(u, columns - 0.5)), int(min(v, rows - 0.5))
        own = min(u - j, j + 1.0 - u, v - i, i + 1.0 - v)
        best = math.inf
        k = rings[i, j]
        while k <= rows + columns:
            for a in range(max(i - k, 0), min(i + k, rows - 1) + 1):
                # Whole rows at the top and bottom of the ring, else its two ends.
                step = 1 if abs(a - i) == k else 2 * k
                for b in range(j - k, j + k + 1, step):
                    if b < 0 or b >= columns:
                        continue
                    for m in range(start[a * columns + b], start[a * columns + b + 1]):
                        e = members[m]
                        wx, wy = x[n] - edges[e, 0], y[n] - edges[e, 1]
                        dx, dy = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
                        length2 = dx * dx + dy * dy
                        if length2 > 0.0:
                            t = min(max((wx * dx + wy * dy) / length2, 0.0), 1.0)
                            wx -= t * dx
                            wy -= t * dy
                        best = min(best, wx * wx + wy * wy)
            bound = (k + own) * side
            if best <= bound * bound:
                break
            k += 1
        out[n] = math.sqrt(best)
