"""Compiled loops for fields: values of cubic B-splines, and the volume of obstacles in a ball."""

from __future__ import annotations

import math

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean

Four = tuple[float, float, float, float]


@lean
def _primitive(t: float, d: float, r: float, a: float) -> float:
    """Return an antiderivative, over the angle psi, of (r^2 - rho^2)^(3/2) along a line at distance d from the camera.

    rho is the distance from the camera to a point on the line, t = d tan(psi) the position of the point along the line,
    and a = sqrt(r^2 - d^2).
    """
    sin_u = min(max(t / a, -1.0), 1.0)
    cos_u = math.sqrt(1.0 - sin_u * sin_u)
    u = math.asin(sin_u)
    return (
        r * r * r * math.atan2(r * sin_u, d * cos_u)
        - 0.5 * d * (3.0 * r * r - d * d) * u
        - 0.5 * d * (r * r - d * d) * sin_u * cos_u
    )


@lean
def ball_volumes(
    edges: FloatArray,
    slab: IntArray,
    heights: FloatArray,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    r: float,
    out: FloatArray,
) -> None:
    """Add to out (M,) the volume (m^3) of the obstacles in the ball of radius r round each camera (x, y, z).

    edges (E, 4) m: x0, y0, x1, y1, outer rings counter-clockwise, holes clockwise, sorted by slab
    slab (S + 1,): the edges of slab s are slab[s]:slab[s + 1]; heights (S, 2) m: its bottom and top

    An edge from p to q adds the part of the ball over the triangle (camera, p, q), between bottom and top, with the
    sign of the triangle's orientation. This part is the difference of two volumes between the camera's height and a
    height c, one for c = top and one for c = bottom; terms that do not depend on c are computed once.
    """
    for k in range(x.size):
        total = 0.0
        for s in range(heights.shape[0]):
            bottom = min(max(heights[s, 0] - z[k], -r), r)
            top = min(max(heights[s, 1] - z[k], -r), r)
            if bottom >= top:
                continue
            for e in range(slab[s], slab[s + 1]):
                px, py = edges[e, 0] - x[k], edges[e, 1] - y[k]
                qx, qy = edges[e, 2] - x[k], edges[e, 3] - y[k]
                cross = px * qy - py * qx
                length = math.hypot(qx - px, qy - py)
                if cross == 0.0 or length == 0.0:
                    continue
                d = abs(cross) / length
                seen = math.atan2(abs(cross), px * qx + py * qy)
                lo, hi, swept, whole = 0.0, 0.0, 0.0, 0.0
                if d < r:
                    t0 = (px * (qx - px) + py * (qy - py)) / length
                    a = math.sqrt(r * r - d * d)
                    lo, hi = max(t0, -a), min(t0 + length, a)
                    if lo < hi:
                        swept = math.atan2(hi, d) - math.atan2(lo, d)
                        whole = _primitive(hi, d, r, a) - _primitive(lo, d, r, a)
                between = 0.0
                for level in (top, -bottom):
                    c = abs(level)
                    far = 0.5 * c * r * r - c * c * c / 6.0
                    volume = far * seen
                    if lo < hi:
                        psi, above = swept, whole
                        rho2 = r * r - c * c
                        if d * d < rho2:
                            b = math.sqrt(rho2 - d * d)
                            near_lo, near_hi = max(lo, -b), min(hi, b)
                            if near_lo < near_hi:
                                near = math.atan2(near_hi, d) - math.atan2(near_lo, d)
                                above -= _primitive(near_hi, d, r, a) - _primitive(near_lo, d, r, a)
                                volume += 0.5 * c * d * (near_hi - near_lo) - far * near
                                psi -= near
                        volume += (0.5 * c * rho2 + c * c * c / 3.0 - far) * psi - above / 3.0
                    between += math.copysign(volume, level)
                total += between if cross > 0.0 else -between
        out[k] += total


@lean
def _weights(s: float) -> Four:
    """Return the cubic B-spline weights of four successive samples, at s steps (0 to 1) beyond the second of them."""
    r = 1.0 - s
    inner, outer = (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0
    return r * r * r / 6.0, inner, outer, s * s * s / 6.0


@kernel
def _slopes(s: float) -> Four:
    """Return the derivatives of `_weights` with respect to s."""
    r = 1.0 - s
    return -0.5 * r * r, -2.0 * s + 1.5 * s * s, 2.0 * r - 1.5 * r * r, 0.5 * s * s


@lean
def spline(
    coefficients: FloatArray, row: IntArray, column: IntArray, up: FloatArray, right: FloatArray, out: FloatArray
) -> None:
    """Add to out (M,) the values of the cubic B-spline at M points inside the grid.

    coefficients (H, W); row, column (M,): the sample before each point, within [1, n - 3]; up, right (M,): the distance
    of the point from this sample, in grid steps. NaN gives NaN. The kernel is short, because the first plan waits until
    it is compiled; array operations prepare its inputs.
    """
    for k in range(row.size):
        across, along = _weights(right[k]), _weights(up[k])
        for p in range(4):
            value = 0.0
            for q in range(4):
                value += across[q] * coefficients[row[k] - 1 + p, column[k] - 1 + q]
            out[k] += along[p] * value


@kernel
def quadratics(coefficients: FloatArray, places: FloatArray, out: FloatArray) -> None:
    """Write to out (M, 8) the second-order expansion of the B-spline about M points inside the grid.

    coefficients (H, W); places (M, 2): points (u, v) in grid steps, within [1, n - 2]. A row of out holds u, v, the
    value, d/du, d/dv, d²/du², d²/dudv and d²/dv². NaN gives NaN.
    """
    rows, columns = coefficients.shape
    for k in range(places.shape[0]):
        u, v = places[k]
        if math.isnan(u) or math.isnan(v):
            out[k] = math.nan
            continue
        j = min(int(u), columns - 3)
        i = min(int(v), rows - 3)
        s, t = u - j, v - i
        wu, wv, du, dv = _weights(s), _weights(t), _slopes(s), _slopes(t)
        bu, bv = (1.0 - s, 3.0 * s - 2.0, 1.0 - 3.0 * s, s), (1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t)
        value, gu, gv, huu, huv, hvv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for p in range(4):
            row, drow, brow = 0.0, 0.0, 0.0
            for q in range(4):
                c = coefficients[i - 1 + p, j - 1 + q]
                row += wu[q] * c
                drow += du[q] * c
                brow += bu[q] * c
            value += wv[p] * row
            gu += wv[p] * drow
            gv += dv[p] * row
            huu += wv[p] * brow
            huv += dv[p] * drow
            hvv += bv[p] * row
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = u, v, value, gu, gv
        out[k, 5], out[k, 6], out[k, 7] = huu, huv, hvv
