"""Distances between a robot on its way and where somebody is seen from it meanwhile."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.collision.parts import Part
from hpop.planners.graphs.timed.pieces import Pieces, Place


def to_segments(ax: FloatArray, ay: FloatArray, bx: FloatArray, by: FloatArray) -> FloatArray:
    """Distance (N,) of the origin from segments a b."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = np.clip(np.divide(-(ax * dx + ay * dy), square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(ax + share * dx, ay + share * dy))


def strips(
    pieces: Pieces, seen: tuple[Place, Place], rows: IntArray, stray: float, at_start: BoolArray | None = None
) -> tuple[Place, ...]:
    """Corners of where somebody is, seen from robots on moves that may be so far, m, ahead of or behind their plans.

    pieces    (N,) moves
    seen      from the ends of pieces, of which ``rows`` (N,) are these
    at_start  (N,)  which cannot be behind at their begin
    """
    (ax, ay), (bx, by) = pieces.start, pieces.end
    dx, dy = bx - ax, by - ay
    length = np.hypot(dx, dy)
    share = np.divide(stray, length, out=np.zeros_like(length), where=length > 0)
    back = share if at_start is None else np.where(at_start, 0.0, share)
    (sx, sy), (tx, ty) = ((x[rows], y[rows]) for x, y in seen)
    return (
        (sx + back * dx, sy + back * dy),
        (sx - share * dx, sy - share * dy),
        (tx - share * dx, ty - share * dy),
        (tx + share * dx, ty + share * dy),
    )


def to_strips(corners: tuple[Place, ...]) -> FloatArray:
    """Distance (N,), m, of the origin from convex quadrilaterals; 0 within them."""
    following = [*corners[1:], corners[0]]
    edges = [to_segments(*one, *other) for one, other in zip(corners, following, strict=True)]
    sides = [ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)]
    inside = (np.minimum.reduce(sides) > 0) | (np.maximum.reduce(sides) < 0)
    return np.where(inside, 0.0, np.minimum.reduce(edges))


def to_parts(parts: Sequence[Part], corners: FloatArray) -> FloatArray:
    """Distance (N,) of the hulls of points (N, c, 2) in the frame of the base from the nearest of some parts."""
    hulls = shapely.convex_hull(shapely.multipoints(corners))
    each = [
        shapely.distance(shapely.convex_hull(shapely.MultiPoint(part.corners)), hulls) - part.radius for part in parts
    ]
    return np.asarray(np.minimum.reduce(each))
