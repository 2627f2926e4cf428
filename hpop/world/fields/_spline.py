"""The compiled inner loops of `hpop.world.fields.field.Field`."""

from __future__ import annotations

import math

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean

Four = tuple[float, float, float, float]


@lean
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


@lean
def spline(
    coefficients: FloatArray, row: IntArray, column: IntArray, up: FloatArray, right: FloatArray, out: FloatArray
) -> None:
    """Add to out (M,) the cubic B-spline at places inside the grid.

    coefficients (H, W); row, column (M,) of the sample before a place, within [1, n - 3]; up, right (M,) of a step from
    there on, from 0 to 1. NaN gives NaN. (A first answer waits for this to be compiled, which takes as long as the text
    is: what arrays can do is done before.)
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
