"""Appearance of surfaces in panoramas: colours, light, and a texture that shows motion without shimmering.

The texture is a sum of cosine waves with whole numbers of periods on a square tile, so that it repeats without a seam
and has no detail finer than its shortest wave. Waves that a pixel cannot resolve are left out, so nothing flickers at a
distance, unlike pixel noise. Over it is a grid of thin lines every half metre.

All factors apply to stored sRGB values.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray

Colour = tuple[int, int, int]
"""Red, green and blue in sRGB, 0 to 255."""

PERIOD = 8.0
"""Side of the tile, m."""
LONGEST, SHORTEST = 2.5, 0.12
"""Longest and shortest wavelength of the texture, m."""
WAVES = 36
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
ROUGHNESS = 0.3
"""Exponent by which amplitudes grow with the wavelength: coarse patches, fine grain."""
PITCH, LINE = 0.5, 0.02
"""Distance between the lines of the grid, and their width, m."""
CONTRAST = {"floor": 0.075, "outside": 0.03, "wall": 0.028}
"""Contrast of the texture: root mean square of its waves, as a share of the surface's colour."""
GRID = {"floor": 0.20, "wall": 0.10}
"""Share by which the lines of the grid are darker."""
SKIRTING, SKIRTING_SHADE = 0.08, 0.68
"""Height of the dark strip at the foot of walls, m, and its brightness as a share of the wall's."""

FLOOR: Colour = (158, 147, 132)
OUTSIDE: Colour = (134, 137, 134)
WALL: Colour = (222, 215, 202)
THINGS: tuple[Colour, ...] = (
    (186, 140, 96),
    (122, 156, 142),
    (150, 134, 168),
    (196, 166, 92),
    (120, 146, 176),
    (188, 120, 106),
)
ZONES: dict[str, Colour] = {"speed": (196, 120, 60), "keep-out": (150, 70, 110), "one-way": (60, 110, 160)}
ZONE_SHARE = 0.35
"""Share of a zone's colour in the colour of the floor."""
SKY_HORIZON, SKY_ZENITH = (232, 236, 238), (168, 194, 222)
LIGHT = (0.48, 0.6, 0.64)
"""Direction towards the light, a unit vector, equal everywhere."""
AMBIENT, DIFFUSE = 0.84, 0.18
"""A surface with unit normal n is AMBIENT + DIFFUSE n . LIGHT times its colour, at most 1."""
HAZE = 400.0
"""At a distance of d m in the plane, the horizon's colour has the share d / (d + HAZE)."""


def waves() -> FloatArray:
    """Return the waves (WAVES, 4) of the texture: periods i, j along the tile's sides, amplitude, phase (rad).

    The texture at (u, v), m, is the sum of ``a cos(2 pi (i u + j v) / PERIOD + phase)``; its mean square is 1.
    Directions follow the golden angle and wavelengths a geometric series, so that no direction stands out.
    """
    k = np.arange(WAVES)
    number = PERIOD / (LONGEST * (SHORTEST / LONGEST) ** (k / (WAVES - 1)))
    i = np.round(number * np.cos(2.0 * math.pi * GOLDEN * k))
    j = np.round(number * np.sin(2.0 * math.pi * GOLDEN * k))
    amplitude = np.hypot(i, j) ** -ROUGHNESS
    phase = 2.0 * math.pi * (GOLDEN**2 * k * k % 1.0)
    return np.stack([i, j, amplitude * math.sqrt(2.0 / np.sum(amplitude**2)), phase], axis=1)


def description() -> dict[str, Any]:
    """Return all settings of surfaces as JSON, for the ride page, which draws the scene itself."""
    return {
        "period": PERIOD,
        "waves": [[int(i), int(j), float(a), float(phase)] for i, j, a, phase in waves()],
        "pitch": PITCH,
        "line": LINE,
        "contrast": CONTRAST,
        "grid": GRID,
        "skirting": [SKIRTING, SKIRTING_SHADE],
        "floor": list(FLOOR),
        "outside": list(OUTSIDE),
        "zone_share": ZONE_SHARE,
        "sky": [list(SKY_HORIZON), list(SKY_ZENITH)],
        "light": list(LIGHT),
        "ambient": AMBIENT,
        "diffuse": DIFFUSE,
        "haze": HAZE,
    }
