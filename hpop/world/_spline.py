"""The compiled inner loop of `hpop.world.field.Field`."""

from __future__ import annotations

import math

from numba import njit

from hpop.arrays import FloatArray


@njit(cache=True)
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
        s = a - j
        t = b - i
        s1 = 1.0 - s
        t1 = 1.0 - t
        wu = (
            s1 * s1 * s1 / 6.0,
            (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
            (4.0 - 6.0 * s1 * s1 + 3.0 * s1 * s1 * s1) / 6.0,
            s * s * s / 6.0,
        )
        wv = (
            t1 * t1 * t1 / 6.0,
            (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
            (4.0 - 6.0 * t1 * t1 + 3.0 * t1 * t1 * t1) / 6.0,
            t * t * t / 6.0,
        )
        du = (-0.5 * s1 * s1, -2.0 * s + 1.5 * s * s, 2.0 * s1 - 1.5 * s1 * s1, 0.5 * s * s)
        dv = (-0.5 * t1 * t1, -2.0 * t + 1.5 * t * t, 2.0 * t1 - 1.5 * t1 * t1, 0.5 * t * t)
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
