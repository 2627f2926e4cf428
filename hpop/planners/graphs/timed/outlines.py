"""Distances of a robot's outline from points, segments and strips in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.collision import Part

Place: TypeAlias = tuple[FloatArray, FloatArray]
"""x and y (N,) of points, m."""
ROUNDED = 1e-12  # m: rounding error of distances


def to_segments(ax: FloatArray, ay: FloatArray, bx: FloatArray, by: FloatArray) -> FloatArray:
    """Return the distance (N,), m, of the origin from the line segments from a to b, given by coordinates."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = np.clip(np.divide(-(ax * dx + ay * dy), square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(ax + share * dx, ay + share * dy))


def of_rows(places: tuple[Place, ...], rows: IntArray) -> tuple[Place, ...]:
    """Return the points with the given indices, for each of several arrays of points."""
    return tuple((x[rows], y[rows]) for x, y in places)


def to_strips(corners: tuple[Place, ...]) -> FloatArray:
    """Return the distance (N,), m, of the origin from N convex quadrilaterals, given by four corners; 0 inside."""
    following = [*corners[1:], corners[0]]
    edges = [to_segments(*begin, *end) for begin, end in zip(corners, following, strict=True)]
    sides = [ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)]
    inside = (np.minimum.reduce(sides) > 0) | (np.maximum.reduce(sides) < 0)
    return np.where(inside, 0.0, np.minimum.reduce(edges))


def to_parts(parts: Sequence[Part], yaw: FloatArray, corners: Sequence[Place]) -> FloatArray:
    """Return the distance (N,), m, of the nearest part of a robot with yaws (N,), rad, from a convex set of points.

    It is the distance between surfaces; the radius of a rounded part is taken off.

    parts    parts of the robot's outline
    corners  x, y (N,), m, of points whose convex hull is the set, relative to the robot's axis, in the map's frame
    """
    hulls = shapely.convex_hull(shapely.multipoints(_in_robot_frame(yaw, corners)))
    each = [shapely.distance(_hull(part), hulls) - part.radius for part in parts]
    return np.asarray(np.minimum.reduce(each))


def nearer_than(
    parts: Sequence[Part], yaw: FloatArray, corners: Sequence[Place], least: FloatArray | float
) -> BoolArray:
    """Return where :func:`to_parts` is less than a distance ``least`` (N,), m; few cases need shapely for that.

    A set is far enough from a part if they are apart along the normal of an edge of the part, and too near if a corner
    of one is too near to an edge of the other.
    """
    points, least = _in_robot_frame(yaw, corners), np.broadcast_to(least, yaw.shape)
    near = np.zeros(yaw.size, dtype=bool)
    for part in parts:
        outline, needed = _outline(part), least + part.radius
        apart = np.full(yaw.size, -np.inf)
        for (ax, ay), (bx, by) in pairwise(outline):  # clockwise: the normal to the left points out of the part
            length = math.hypot(bx - ax, by - ay)
            nx, ny = (ay - by) / length, (bx - ax) / length
            apart = np.maximum(apart, (nx * (points[..., 0] - ax) + ny * (points[..., 1] - ay)).min(axis=1))
        unsure = np.flatnonzero(~near & (apart < needed + ROUNDED))
        some, close = points[unsure], np.full(unsure.size, np.inf)
        ends = [*pairwise(range(some.shape[1])), (some.shape[1] - 1, 0)]
        for ax, ay in outline[:-1]:
            for i, j in ends:
                (x, y), (to_x, to_y) = some[:, i].T, some[:, j].T
                close = np.minimum(close, to_segments(x - ax, y - ay, to_x - ax, to_y - ay))
        for (ax, ay), (bx, by) in pairwise(outline):
            for x, y in some.transpose(1, 2, 0):
                close = np.minimum(close, to_segments(ax - x, ay - y, bx - x, by - y))
        near[unsure] = close < needed[unsure] - ROUNDED
        unsure = unsure[~near[unsure]]
        if unsure.size:
            hulls = shapely.convex_hull(shapely.multipoints(points[unsure]))
            near[unsure] = shapely.distance(_hull(part), hulls) < needed[unsure]
    return near


def _outline(part: Part) -> list[tuple[float, float]]:
    """Return the corners of a part clockwise, and the first one again; [] if they are no polygon."""
    hull = _hull(part)
    if hull.geom_type != "Polygon":
        return []
    return [(x, y) for x, y in shapely.orient_polygons(hull, exterior_cw=True).exterior.coords]


def _hull(part: Part) -> Any:
    return shapely.convex_hull(shapely.MultiPoint(part.corners))


def _in_robot_frame(yaw: FloatArray, corners: Sequence[Place]) -> FloatArray:
    """Return corners (N, c, 2), m, relative to a robot with yaws (N,), rad, in its own frame."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([np.stack([cos * x + sin * y, cos * y - sin * x], axis=1) for x, y in corners], axis=1)
