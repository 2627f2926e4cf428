"""A picture all round for a camera that is tilted or rolled, looked up in a level one."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

from hpop.runtime.compiled import lean
from hpop.view.ride.rows import PI, arctangent


@lean
def _angle(x, y):
    """Angle of a vector, rad, as `math.atan2` gives it."""
    if abs(y) > abs(x):
        return math.copysign(0.5 * PI, y) - arctangent(x / y)
    if x == 0.0:
        return 0.0
    found = arctangent(y / x)
    if x > 0.0:
        return found
    return found + math.copysign(PI, y)


@lean
def turned(level, columns, slopes, axes, out):
    """Fill ``out`` (H, W, 3) from a level picture that looks along x, for a camera with axes (3, 3): ahead, left, up.

    columns  (W, 2)  cos and sin of the bearing of each column from ahead
    slopes   (H,)    of the rows

    Each pixel is looked up bilinearly, and rounded to whole numbers, halves up.
    """
    rows, width = len(level), len(level[0])
    for row in range(len(slopes)):
        across = 1.0 / math.sqrt(1.0 + slopes[row] * slopes[row])
        rise = slopes[row] * across
        for column in range(len(columns)):
            a, b = across * columns[column, 0], across * columns[column, 1]
            x = a * axes[0, 0] + b * axes[0, 1] + rise * axes[0, 2]
            y = a * axes[1, 0] + b * axes[1, 1] + rise * axes[1, 2]
            z = a * axes[2, 0] + b * axes[2, 1] + rise * axes[2, 2]
            u = (0.5 - _angle(x, y) / (2.0 * PI)) * width - 0.5
            v = (0.5 - _angle(math.sqrt(x * x + y * y), z) / PI) * rows - 0.5
            v = min(max(v, 0.0), rows - 1.001)
            left, under = math.floor(u), int(v)
            u, v = u - left, v - under
            left %= width
            right = (left + 1) % width
            for channel in range(3):
                above = level[under, left, channel] * (1.0 - u) + level[under, right, channel] * u
                below = level[under + 1, left, channel] * (1.0 - u) + level[under + 1, right, channel] * u
                out[row, column, channel] = math.floor(above + v * (below - above) + 0.5)
