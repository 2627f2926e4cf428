"""The compiled inner loop of `hpop.world.geometry.edge_tree.EdgeTree`."""

from __future__ import annotations

import math

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean

# A first answer waits for this to be compiled, which takes longer for each function that is called.


@lean
def nearest(
    edges: FloatArray,
    members: IntArray,
    boxes: FloatArray,
    waiting: IntArray,
    away: FloatArray,
    x: FloatArray,
    y: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (M,) the distance of each point to its nearest edge; see `EdgeTree` for the arrays.

    ``waiting`` and ``away`` are scratch, two numbers for each level of the tree.

    The nearer of two boxes is looked into first, and none that is farther than the nearest edge so far. Points in a row
    are mostly near each other, so the leaf of the last nearest edge comes before all.
    """
    inner = len(boxes) - len(members)
    width = members.shape[1]
    last = inner
    for n in range(x.size):
        if math.isnan(x[n]) or math.isnan(y[n]):
            out[n] = math.nan
            continue
        best = math.inf
        waiting[0], away[0], waiting[1], away[1] = 0, 0.0, last, 0.0
        count = 2
        while count > 0:
            count -= 1
            node = waiting[count]
            if away[count] > best:
                continue
            if node >= inner:
                for m in range(width):
                    e = members[node - inner, m]
                    wx, wy = x[n] - edges[e, 0], y[n] - edges[e, 1]
                    dx, dy = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
                    length2 = dx * dx + dy * dy
                    if length2 > 0.0:
                        t = min(max((wx * dx + wy * dy) / length2, 0.0), 1.0)
                        wx -= t * dx
                        wy -= t * dy
                    distance2 = wx * wx + wy * wy
                    if distance2 < best:
                        best, last = distance2, node
                continue
            for side in range(2):
                child = 2 * node + 1 + side
                u = max(boxes[child, 0] - x[n], x[n] - boxes[child, 2], 0.0)
                v = max(boxes[child, 1] - y[n], y[n] - boxes[child, 3], 0.0)
                waiting[count], away[count] = child, u * u + v * v
                count += 1
            if away[count - 1] > away[count - 2]:  # the nearer one is next
                waiting[count - 1], waiting[count - 2] = waiting[count - 2], waiting[count - 1]
                away[count - 1], away[count - 2] = away[count - 2], away[count - 1]
        out[n] = math.sqrt(best)
