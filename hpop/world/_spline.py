"""The compiled inner loops of `hpop.world.field.Field`."""

from __future__ import annotations

import math

from hpop.arrays import FloatArray
from hpop.compiled import kernel

Four = tuple[float, float, float, float]


@kernel
def _weights(s: float) -> Four:
    """Cubic B-spline weights of the four samples around a point, s of a step behind the second."""
    r = 1.0 - s
    inner, outer = (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0
    return r * r * r / 6.0, inner, outer, s * s * s / 6.0


@kernel
def _slopes(s: float) -> Four:
    """First derivatives of the weights."""
    r = 1.0 - s
    return -0.5 * r * r, -2.0 * s + 1.5 * s * s, 2.0 * r - 1.5 * r * r, 0.5 * s * s


@kernel
def spline(coefficients: FloatArray, u: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Cubic B-spline at (u, v) in grid steps, clamped to [1, n - 2].

    coefficients (H, W); u, v (M,); out (M, 3) receives the value, d/du and d/dv. NaN gives NaN.
    """
    rows, columns = coefficients.shape
    for k in range(u.size):
        a, b = u[k], v[k]
        if math.isnan(a) or math.isnan(b):
            out[k, 0] = out[k, 1] = out[k, 2] = math.nan
            continue
        inside_u = 1.0 <= a <= columns - 2.0
        inside_v = 1.0 <= b <= rows - 2.0
        a = min(max(a, 1.0), columns - 2.0)
        b = min(max(b, 1.0), rows - 2.0)
        j = min(int(a), columns - 3)
        i = min(int(b), rows - 3)
        wu, wv, du, dv = _weights(a - j), _weights(b - i), _slopes(a - j), _slopes(b - i)
        value = 0.0
        gu = 0.0
        gv = 0.0
        for p in range(4):
            row = 0.0
            drow = 0.0
            for q in range(4):
                c = coefficients[i - 1 + p, j - 1 + q]
                row += wu[q] * c
                drow += du[q] * c
            value += wv[p] * row
            gu += wv[p] * drow
            gv += dv[p] * row
        out[k, 0] = value
        out[k, 1] = gu if inside_u else 0.0
        out[k, 2] = gv if inside_v else 0.0


@kernel
def quadratics(coefficients: FloatArray, places: FloatArray, out: FloatArray) -> None:
    """Second-order expansions of the B-spline at places inside the grid.

    coefficients (H, W); places (M, 2) in grid steps, within [1, n - 2]; out (M, 8) receives the place, the value, d/du,
    d/dv, d²/du², d²/dudv and d²/dv². NaN gives NaN.
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
