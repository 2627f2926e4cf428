"""Corridors: sequences of convex regions in which the robot is free, grown around the segments of a path.

A region is what half-planes leave of a box round a segment. Each half-plane is tangent to the obstacle that is nearest
to the segment among those not yet cut off, as in IRIS (Deits and Tedrake 2015) with the segment in the place of the
ellipsoid: of two convex sets, the plane through the nearest point, normal to the shortest line, leaves each on its own
side. So no half-plane cuts into the segment, and beyond all of them nothing is left inside. Shifted inwards by the
robot's reach they bound where its axis may be, whatever its yaw; unshifted they bound the distance to obstacles from
below, ``d(p) >= min_k (c_k - a_k p)``, at every p: the border of the free space does not enter the region, and outside
the right-hand side is negative.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.models.collision.planar import TOUCH
from hpop.planners.needs import in_plane
from hpop.planners.programs.outcome import Deadline
from hpop.planners.programs.polyline import Polyline
from hpop.trajectories.trajectory import STRAIGHT
from hpop.world import World
from hpop.world.geometry.planar import FreeSpace

if TYPE_CHECKING:
    from hpop.models.base import PlanarModel
    from hpop.problems.problem import Problem

WIDTH = 3.0  # m: regions reach this far beyond the segment they are grown around
TOUCHING = 1e-6  # m: nearer obstacles have no usable direction
ROUNDING = 1e-9  # m: of the half-planes' own arithmetic


@dataclass(frozen=True, eq=False)
class HalfPlanes:
    """``{p: normals p <= offsets}``, none redundant.

    normals  (m, 2)  unit vectors that point outwards
    offsets  (m,)    m
    corners  (m, 2)  m, counter-clockwise, of the bounded polygon that they leave
    """

    normals: FloatArray
    offsets: FloatArray
    corners: FloatArray

    def excess(self, points: FloatArray) -> FloatArray:
        """By how much points (N, 2) lie outside, m: (N,), not positive inside."""
        return np.asarray((points @ self.normals.T - self.offsets).max(axis=1), dtype=np.float64)

    def cut(self, normals: FloatArray, offsets: FloatArray) -> HalfPlanes:
        """What further half-planes leave; raises ValueError where that is nothing."""
        corners = self.corners
        for normal, offset in zip(normals, offsets, strict=True):
            corners = _clipped(corners, normal, offset)
            if not len(corners):
                raise ValueError("half-planes leave nothing")
        every, limits = np.concatenate([self.normals, normals]), np.concatenate([self.offsets, offsets])
        touched = (corners @ every.T - limits).max(axis=0) > -ROUNDING
        return HalfPlanes(every[touched], limits[touched], corners)

    def nearest(self, point: FloatArray) -> FloatArray:
        """The point (2,) inside that is nearest to another one."""
        if self.excess(point[None])[0] <= 0.0:
            return point
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(self.polygon, shapely.points(point)))[0])

    @property
    def polygon(self) -> BaseGeometry:
        """The same as a shapely polygon; a line, where there is no room."""
        return shapely.MultiPoint(self.corners).convex_hull

    @classmethod
    def box(cls, points: FloatArray, width: float) -> HalfPlanes:
        """The upright box that reaches ``width`` metres beyond points (N, 2)."""
        (x_min, y_min), (x_max, y_max) = points.min(axis=0) - width, points.max(axis=0) + width
        normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
        return cls(normals, np.array([x_max, -x_min, y_max, -y_min]), corners)


def clear_of(space: FreeSpace, segment: FloatArray, width: float) -> HalfPlanes | None:
    """Half-planes round a segment (2, 2) whose interior the border of a free space does not enter.

    None where the segment touches the border or lies beyond it.
    """
    within = HalfPlanes.box(segment, width)
    if not space.contains(*segment.T).all():
        return None
    edges = space.edges
    near = (edges.max(axis=1) > segment.min(axis=0) - width) & (edges.min(axis=1) < segment.max(axis=0) + width)
    edges = edges[near.all(axis=1)]
    for normal, offset in zip(within.normals, within.offsets, strict=True):
        edges = _inside(edges, normal, offset)
    line = shapely.linestrings(segment) if (segment[0] != segment[1]).any() else shapely.points(segment[0])
    normals, offsets = [], []
    while len(edges):
        others = np.asarray(shapely.linestrings(edges), dtype=object)
        nearest = int(np.argmin(shapely.distance(others, line)))
        here, there = shapely.get_coordinates(shapely.shortest_line(line, others[nearest]))
        apart = math.hypot(*(there - here))
        if apart < TOUCHING:
            return None
        normals.append((there - here) / apart)
        offsets.append(float(normals[-1] @ there))
        edges = _inside(edges, normals[-1], offsets[-1])
    return within.cut(np.array(normals).reshape(-1, 2), np.array(offsets))


@dataclass(frozen=True, eq=False)
class Region:
    """A convex region in which the axis of the robot may move.

    inside  half-planes of the region
    seed    (2, 2)  m: the segment that it was grown around
    safe    whether the robot is free all over it, at any yaw, by shapely; else only as near to obstacles as the seed is
    """

    inside: HalfPlanes
    seed: FloatArray
    safe: bool

    @classmethod
    def around(cls, segment: FloatArray, model: PlanarModel, world: World) -> Region | None:
        """Grow a region around a segment (2, 2); None where the segment touches an obstacle."""
        inside, reaches = HalfPlanes.box(segment, WIDTH), spaces(model, world)
        for space, reach in reaches:
            clear = clear_of(space, segment, WIDTH + reach)
            if clear is None:
                return None
            # A robot that is not round may be nearer than its reach; then its path is the limit.
            lies = (segment @ clear.normals.T).max(axis=0)
            inside = inside.cut(clear.normals, np.maximum(clear.offsets - reach, lies) + 0.5 * TOUCH)
        shape = np.array([inside.polygon])
        return cls(inside, segment, all(bool(space.shapes_free(shape, reach)[0]) for space, reach in reaches))

    def covers(self, segment: FloatArray) -> bool:
        """Whether a segment (2, 2) lies inside."""
        return bool((self.inside.excess(segment) <= TOUCH).all())

    def distance_planes(self, space: FreeSpace, piece: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Normals (m, 2) and offsets (m,) with ``d(p) >= min(width, min_k (c_k - a_k p))`` for every p inside.

        d is the distance to the border of a free space, 0 beyond it; the bound is closest near ``piece`` (2, 2), a
        segment inside. One plane that is 0 everywhere says nothing.
        """
        clear = clear_of(space, piece, width + WIDTH)
        if clear is None:
            return np.zeros((1, 2)), np.zeros(1)
        farther = (clear.normals @ self.inside.corners.T).max(axis=1) <= clear.offsets - width
        return clear.normals[~farther], clear.offsets[~farther]


@dataclass(frozen=True, eq=False)
class Corridor:
    """Regions that a polyline passes in order, one for each of its segments.

    regions       n, neighbours overlap; one, where start is goal
    overlaps      n - 1, where the vertices may be: what lies in both regions, so that each segment stays in its own
    warm          the path that the regions were grown around
    along_first   whether the first segment keeps the heading at the start, so that there is no turn
    along_last    whether the last one keeps the heading at the goal
    warm_starts   places of the paths that have this corridor
    """

    regions: tuple[Region, ...]
    overlaps: tuple[HalfPlanes, ...]
    warm: Polyline
    along_first: bool
    along_last: bool
    warm_starts: tuple[int, ...]

    @property
    def segments(self) -> int:
        """Number of segments n."""
        return len(self.regions)

    @property
    def warm_segments(self) -> list[FloatArray]:
        """The segments (2, 2) of the warm path, n of them, m."""
        return list(_segments(self.warm))

    @property
    def is_fixed(self) -> bool:
        """Whether nothing is free: no vertex, or one that both headings fix."""
        return self.segments < 2 or (self.segments == 2 and self.along_first and self.along_last)


def corridors(
    polylines: Sequence[Polyline],
    problem: Problem,
    deadline: Deadline = Deadline(),  # noqa: B008  (frozen)
) -> tuple[list[Corridor], int]:
    """The corridors of paths, one for each sequence of regions, and how many paths touch an obstacle.

    Paths that are not looked at before the deadline are in no corridor.

    A segment that lies in regions known from other segments gets the largest of them, so that paths through the same
    rooms share a corridor.
    """
    regions: list[Region] = []
    groups: dict[tuple[tuple[int, ...], bool, bool], list[int]] = {}
    refused = 0
    for number, polyline in enumerate(polylines):
        if deadline.is_past:
            break
        chain = [_region(segment, regions, problem) for segment in _segments(polyline)]
        if -1 in chain:
            refused += 1
            continue
        headings = polyline.headings
        first = bool(len(headings)) and abs(wrap(headings[0] - polyline.start_yaw)) <= STRAIGHT
        goal = polyline.goal_yaw
        last = bool(len(headings)) and goal is not None and abs(wrap(goal - headings[-1])) <= STRAIGHT
        groups.setdefault((tuple(chain), bool(first), bool(last)), []).append(number)
    return [_corridor(key, [regions[i] for i in key[0]], polylines, same) for key, same in groups.items()], refused


def _corridor(
    key: tuple[tuple[int, ...], bool, bool], chain: list[Region], polylines: Sequence[Polyline], same: list[int]
) -> Corridor:
    overlaps = tuple(a.inside.cut(b.inside.normals, b.inside.offsets) for a, b in pairwise(chain))
    return Corridor(tuple(chain), overlaps, polylines[same[0]], key[1], key[2], tuple(same))


def _segments(polyline: Polyline) -> Iterator[FloatArray]:
    vertices = polyline.vertices if len(polyline.vertices) > 1 else polyline.vertices[[0, 0]]
    for a, b in pairwise(vertices):
        yield np.array([a, b])


def _region(segment: FloatArray, regions: list[Region], problem: Problem) -> int:
    """Place of the largest known region around a segment, or of a new one; -1 where the segment touches an obstacle."""
    known = [i for i, region in enumerate(regions) if region.covers(segment)]
    if known:
        return max(known, key=lambda i: regions[i].inside.polygon.area)
    grown = Region.around(segment, in_plane(problem.model), problem.world)
    if grown is None:
        return -1
    regions.append(grown)
    return len(regions) - 1


def spaces(model: PlanarModel, world: World) -> list[tuple[FreeSpace, float]]:
    """The free spaces at the heights of the robot's parts, each with the largest reach of its parts there, m."""
    found: dict[int, tuple[FreeSpace, float]] = {}
    for part in model.platform:
        space = world.free_space((part.z_min, part.z_max))
        found[id(space)] = (space, max(part.reach, found.get(id(space), (space, 0.0))[1]))
    return list(found.values())


def _clipped(corners: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """The part of a convex polygon on the inner side of a line (Sutherland and Hodgman 1974)."""
    beyond = corners @ normal - offset
    if (beyond <= 0.0).all():
        return corners
    kept = []
    for i, (point, s) in enumerate(zip(corners, beyond, strict=True)):
        before, b = corners[i - 1], beyond[i - 1]
        if (b > 0.0) != (s > 0.0):
            kept.append(before + (point - before) * (b / (b - s)))
        if s <= 0.0:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _inside(edges: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """The parts of edges (E, 2, 2) on the inner side of a line, but what only touches it."""
    beyond = edges @ normal - offset  # (E, 2)
    edges, beyond = edges[(beyond < -ROUNDING).any(axis=1)], beyond[(beyond < -ROUNDING).any(axis=1)]
    for end in (0, 1):
        outer = beyond[:, end] > 0.0
        share = (beyond[outer, 1 - end] / (beyond[outer, 1 - end] - beyond[outer, end]))[:, None]
        fixed = edges[outer, 1 - end]
        edges[outer, end] = fixed + share * (edges[outer, end] - fixed)
    return edges
