"""Walls: what is solid along the lines of a floor plan."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon

from hpop.world.geometry.crossings import check_widenable
from hpop.world.geometry.shapes import check_positive

SHARPEST = 2.0
"""How far a corner may reach beyond its two lines, in half widths: to sixty degrees it is pointed, then cut."""


def check_width(width: Any) -> float | None:
    """The thickness of walls, m, or None for none; `MapError` for what is no length."""
    return None if width is None else check_positive("wall_width", width)


def walls(line: LineString, width: float, what: str) -> list[Polygon]:
    """What is within half a width (m) of a line; its ends reach as far beyond, so that walls that meet leave no notch.

    >>> [wall.bounds for wall in walls(LineString([(0, 0), (4, 0)]), 0.5, "the line")]
    [(-0.25, -0.25, 4.25, 0.25)]
    """
    if line.length == 0:
        return []
    check_widenable(line, width / 2, what)
    return widened(np.array([line]), width)


def widened(lines: NDArray[np.object_], width: float, cap: Literal["square", "flat"] = "square") -> list[Polygon]:
    """The same for many lines (n,), of which none comes near to itself again and again."""
    found = shapely.buffer(lines, width / 2, cap_style=cap, join_style="mitre", mitre_limit=SHARPEST)
    parts: NDArray[np.object_] = shapely.get_parts(found)
    return [part for part in parts.tolist() if isinstance(part, Polygon) and part.area > 0]
