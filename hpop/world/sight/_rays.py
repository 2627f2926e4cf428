"""The compiled inner loops of `hpop.world.sight.bearings`."""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel


@kernel
def _hit(x: float, y: float, cos: float, sin: float, edges: FloatArray, e: int) -> float:
    """Distance from a point along a direction to an edge, m; inf if the ray misses it or runs along it."""
    dx, dy = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
    across = cos * dy - sin * dx
    if across == 0.0:
        return math.inf
    wx, wy = edges[e, 0] - x, edges[e, 1] - y
    along: float = (wx * dy - wy * dx) / across
    share = (wx * sin - wy * cos) / across
    if along < 0.0 or share < -1e-12 or share > 1.0 + 1e-12:
        return math.inf
    return along


@kernel
def cast(
    edges: FloatArray,
    start: IntArray,
    members: IntArray,
    shape: tuple[int, int],
    corner: tuple[float, float],
    side: float,
    x: FloatArray,
    y: FloatArray,
    directions: FloatArray,
    reach: float,
    out: FloatArray,
) -> None:
    """Write to out (M, B) the distance of each point, along each direction (B, 2), to the first edge; at most reach.

    The ray visits the buckets of an `EdgeGrid` in order; a hit counts once it lies in the buckets visited.
    """
    rows, columns = shape
    right, top = corner[0] + columns * side, corner[1] + rows * side
    for n in range(x.size):
        for b in range(directions.shape[0]):
            cos, sin = directions[b]
            # Where the ray enters and leaves the grid.
            enter, leave = 0.0, reach
            for p, d, low, high in ((x[n], cos, corner[0], right), (y[n], sin, corner[1], top)):
                if abs(d) < 1e-15:
                    if p < low or p > high:
                        leave = -1.0
                else:
                    first, last = (low - p) / d, (high - p) / d
                    enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
            best = reach
            if enter <= leave:
                u, v = (x[n] + enter * cos - corner[0]) / side, (y[n] + enter * sin - corner[1]) / side
                j, i = min(max(int(u), 0), columns - 1), min(max(int(v), 0), rows - 1)
                right_first = enter + ((j + 1 if cos > 0 else j) - u) * side / cos if abs(cos) > 1e-15 else math.inf
                up_first = enter + ((i + 1 if sin > 0 else i) - v) * side / sin if abs(sin) > 1e-15 else math.inf
                right_step = side / abs(cos) if abs(cos) > 1e-15 else math.inf
                up_step = side / abs(sin) if abs(sin) > 1e-15 else math.inf
                while True:
                    for m in range(start[i * columns + j], start[i * columns + j + 1]):
                        best = min(best, _hit(x[n], y[n], cos, sin, edges, members[m]))
                    t = min(right_first, up_first)
                    if best <= t or t > leave:
                        break
                    if right_first <= up_first:
                        j += 1 if cos > 0 else -1
                        right_first += right_step
                    else:
                        i += 1 if sin > 0 else -1
                        up_first += up_step
                    if j < 0 or j >= columns or i < 0 or i >= rows:
                        break
            out[n, b] = best


@kernel
def flow(
    layers: FloatArray,
    directions: FloatArray,
    u: FloatArray,
    v: FloatArray,
    velocity_x: FloatArray,
    velocity_y: FloatArray,
    turn_rate: FloatArray,
    tilt: FloatArray,
    yaw: FloatArray,
    width: float,
    nearest: float,
    largest: bool,
    out: FloatArray,
) -> None:
    """Write to out (M,) the mean, or the largest, angular speed over the bearings; see `Bearings`.

    layers (H, W, 3 B): `Bearings.layers`, or the distances (H, W, B) alone; (u, v): positions in grid steps, clamped as
    in `Field`. tilt (3, M): the velocity upwards and the rotation about x and y, or (3, 0) where all are zero. yaw (M,)
    is the middle of the bearings seen, and width their angle; or (0,) where all are seen.
    """
    rows, columns, splines = layers.shape
    count = directions.shape[0]
    sector = 2.0 * math.pi / count
    partial, tilts = yaw.size > 0, tilt.shape[1] > 0
    value = np.empty(splines)
    wu, wv = np.empty(4), np.empty(4)
    for n in range(u.size):
        if math.isnan(u[n]) or math.isnan(v[n]):
            out[n] = math.nan
            continue
        a = min(max(u[n], 1.0), columns - 2.0)
        b = min(max(v[n], 1.0), rows - 2.0)
        j, i = min(int(a), columns - 3), min(int(b), rows - 3)
        _weights(a - j, wu)
        _weights(b - i, wv)
        value[:] = 0.0
        for p in range(4):
            for q in range(4):
                weight = wv[p] * wu[q]
                for k in range(splines):
                    value[k] += weight * layers[i - 1 + p, j - 1 + q, k]
        total = worst = 0.0
        seen = 0.0 if partial else float(count)
        for k in range(count):
            across = velocity_x[n] * directions[k, 1] - velocity_y[n] * directions[k, 0]
            inverse = 1.0 / max(value[k], nearest)
            if splines > count:
                inverse += value[2 * count + k] * (value[count + k] - inverse)
            speed = abs(across * inverse - turn_rate[n])
            if tilts:
                speed = math.hypot(
                    speed, tilt[0, n] * inverse + tilt[1, n] * directions[k, 1] - tilt[2, n] * directions[k, 0]
                )
            if partial:
                off = abs((k * sector - yaw[n] + math.pi) % (2.0 * math.pi) - math.pi)
                share = min(1.0, width / sector, (0.5 * width - off) / sector + 0.5)
                if share <= 0.0:
                    continue
                seen += share
                total += share * speed
            else:
                total += speed
            worst = max(worst, speed)
        out[n] = worst if largest else total / seen


@kernel
def _weights(s: float, out: FloatArray) -> None:
    """Cubic B-spline weights of four neighbours."""
    r = 1.0 - s
    out[0] = r * r * r / 6.0
    out[1] = (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0
    out[2] = (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0
    out[3] = s * s * s / 6.0
