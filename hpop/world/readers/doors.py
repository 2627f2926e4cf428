"""Arcs along which doors swing, as floor plans draw them: lines that close a passage which is open."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime import limits
from hpop.runtime.limits import READING

DoorArcs = Literal["closed", "open"]
RADII = (0.4, 1.6)
"""Least and greatest width of the leaf of a door, m."""
SWEEPS = (math.radians(55), math.radians(125))
"""Least and greatest angle by which it turns."""
ROUND = 0.01
"""How far points of an arc are from a circle, for each unit of its radius, at most."""
POINTS = (5, 200)
"""Fewest and most points of such a line."""
BLOCK = 1_000
"""Lines that are looked at between two looks at the limits."""
TOLD = 3


class Arc(NamedTuple):
    """The arc of a door in a line.

    line         which
    first, last  its points in the line's array, both included
    radius       m
    middle       (x, y), m
    """

    line: int
    first: int
    last: int
    radius: float
    middle: tuple[float, float]


def door_arcs(points: FloatArray, starts: IntArray, lines: IntArray) -> Iterator[Arc]:
    """Yield the arcs of doors in lines of points (n, 2), m; a line may also hold the leaf, at either end of its arc."""
    sizes = starts[lines + 1] - starts[lines]
    for number, line in enumerate(lines[(sizes >= POINTS[0]) & (sizes <= POINTS[1])].tolist()):
        if number % BLOCK == 0:
            limits.check(READING)
        begin, end = int(starts[line]), int(starts[line + 1])
        for first, last in ((begin, end), (begin + 1, end), (begin, end - 1), (begin + 1, end - 1)):
            radius = _radius(points[first:last])
            if radius is not None:
                x, y = points[(first + last) // 2].tolist()
                yield Arc(line, first, last - 1, radius, (x, y))
                break


def _radius(arc: FloatArray) -> float | None:
    """The radius, m, of points (n, 2) that a door swings through; None where they are no such arc."""
    if len(arc) < POINTS[0]:
        return None
    a, b, c = arc[0], arc[len(arc) // 2], arc[-1]
    (ux, uy), (vx, vy) = b - a, c - a
    doubled = 2 * (ux * vy - uy * vx)
    if abs(doubled) < 1e-9:
        return None
    u, v = ux * ux + uy * uy, vx * vx + vy * vy
    centre = a + np.array([vy * u - uy * v, ux * v - vx * u]) / doubled
    spokes = arc - centre
    radius = float(np.hypot(*spokes[0]))
    if not RADII[0] <= radius <= RADII[1] or not (np.abs(np.hypot(*spokes.T) - radius) < ROUND * radius).all():
        return None
    turns = np.diff(np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0])))
    swept = abs(float(turns.sum()))
    return radius if SWEEPS[0] <= swept <= SWEEPS[1] and (turns > 0).all() | (turns < 0).all() else None


def said(arcs: list[Arc], treated: DoorArcs) -> str:
    """Return a note on arcs of doors."""
    places = ", ".join(f"({arc.middle[0]:.2f}, {arc.middle[1]:.2f})" for arc in arcs[:TOLD])
    radii = sorted(arc.radius for arc in arcs)
    size = f"{radii[0]:.2g}" if radii[-1] - radii[0] < 0.01 else f"{radii[0]:.2g} to {radii[-1]:.2g}"
    what = f"{len(arcs):,} arcs look like the swing of a door, {size} m wide, such as at {places}"
    if treated == "open":
        return f"{what}: they are left out"
    return f"{what}, and close passages; door_arcs: open leaves them out"
