"""Corridors: sequences of convex regions in which the robot is free, grown around the segments of a path.

A region is the intersection of half-planes and a box around a segment. As in IRIS (Deits and Tedrake 2015), with a
segment instead of the ellipsoid, each half-plane is tangent to the obstacle nearest to the segment that is not cut off
yet. Its border passes through the obstacle's nearest point, normal to the shortest connection. So no half-plane cuts
the segment, and no obstacle remains inside all of them.

Shifted inwards by the robot's reach, the half-planes bound the positions of the robot's axis, for any yaw. Unshifted,
they bound the distance to obstacles from below: ``d(p) >= min_k (c_k - a_k p)`` at every p. Inside the region this is
so because no obstacle enters it; outside, the right-hand side is negative.
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
from hpop.planners.needs import in_plane, reaches
from hpop.planners.programs import Deadline
from hpop.planners.programs.polyline import Polyline
from hpop.trajectories.trajectory import STRAIGHT
from hpop.world import World
from hpop.world.geometry.planar import FreeSpace

if TYPE_CHECKING:
    from hpop.models.base import PlanarModel
    from hpop.problems.problem import Problem

WIDTH = 3.0  # m: regions reach this far beyond the segment around which they are grown
TOUCHING = 1e-6  # m: if an obstacle is nearer, the direction to it cannot be computed reliably
ROUNDING = 1e-9  # m: rounding error of half-planes


@dataclass(frozen=True, eq=False)
class HalfPlanes:
    """Convex polygon as an intersection of half-planes, ``{p: normals p <= offsets}``, none of them redundant.

    normals  (m, 2)  unit vectors that point outwards
    offsets  (m,)    m
    corners  (m, 2)  m, corners of the polygon, counter-clockwise
    """

    normals: FloatArray
    offsets: FloatArray
    corners: FloatArray

    def excess(self, points: FloatArray) -> FloatArray:
        """Return how far points (N, 2) lie outside the half-plane that they exceed most, m; at most 0 if inside all."""
        return np.asarray((points @ self.normals.T - self.offsets).max(axis=1), dtype=np.float64)

    def cut(self, normals: FloatArray, offsets: FloatArray) -> HalfPlanes:
        """Return the intersection with further half-planes; raises ValueError if nothing is left.

        normals, offsets  fields of the further half-planes
        """
        corners = self.corners
        for normal, offset in zip(normals, offsets, strict=True):
            corners = _clipped(corners, normal, offset)
            if not len(corners):
                raise ValueError("half-planes must have a common point, got an empty intersection; pass other ones")
        all_normals, limits = np.concatenate([self.normals, normals]), np.concatenate([self.offsets, offsets])
        touched = (corners @ all_normals.T - limits).max(axis=0) > -ROUNDING
        return HalfPlanes(all_normals[touched], limits[touched], corners)

    def nearest(self, point: FloatArray) -> FloatArray:
        """Return the position (2,) inside all half-planes that is nearest to a point."""
        if self.excess(point[None])[0] <= 0.0:
            return point
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(self.polygon, shapely.points(point)))[0])

    @property
    def polygon(self) -> BaseGeometry:
        """The intersection of the half-planes as a shapely polygon; a line or point if it has no area."""
        return shapely.MultiPoint(self.corners).convex_hull

    @classmethod
    def box(cls, points: FloatArray, width: float) -> HalfPlanes:
        """Return the axis-aligned box that reaches ``width`` metres beyond points (N, 2)."""
        (x_min, y_min), (x_max, y_max) = points.min(axis=0) - width, points.max(axis=0) + width
        normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
        return cls(normals, np.array([x_max, -x_min, y_max, -y_min]), corners)


def clear_of(space: FreeSpace, segment: FloatArray, width: float) -> HalfPlanes | None:
    """Return half-planes around a segment (2, 2) that contain no obstacle.

    ``width`` is how far they reach beyond the segment, m. The result is None if the segment touches an obstacle (the
    border of the free space), or lies outside the free space.
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
        borders = np.asarray(shapely.linestrings(edges), dtype=object)
        nearest = int(np.argmin(shapely.distance(borders, line)))
        on_line, on_border = shapely.get_coordinates(shapely.shortest_line(line, borders[nearest]))
        distance = math.hypot(*(on_border - on_line))
        if distance < TOUCHING:
            return None
        normals.append((on_border - on_line) / distance)
        offsets.append(float(normals[-1] @ on_border))
        edges = _inside(edges, normals[-1], offsets[-1])
    return within.cut(np.array(normals).reshape(-1, 2), np.array(offsets))


@dataclass(frozen=True, eq=False)
class FreeRegion:
    """Convex region in which the axis of the robot may move.

    inside  half-planes that bound the region
    seed    (2, 2)  m: the segment around which it was grown
    safe    whether the robot is free everywhere in the region at any yaw; if not, it may come as near to obstacles as
            on the seed
    """

    inside: HalfPlanes
    seed: FloatArray
    safe: bool

    @classmethod
    def around(cls, segment: FloatArray, model: PlanarModel, world: World) -> FreeRegion | None:
        """Grow a region around a segment (2, 2); return None if the segment touches an obstacle."""
        inside, free_spaces = HalfPlanes.box(segment, WIDTH), spaces(model, world)
        for space, reach in free_spaces:
            clear = clear_of(space, segment, WIDTH + reach)
            if clear is None:
                return None
            # A robot that is not round may be nearer than its reach; then its path bounds the region.
            lies = (segment @ clear.normals.T).max(axis=0)
            inside = inside.cut(clear.normals, np.maximum(clear.offsets - reach, lies) + 0.5 * TOUCH)
        shape = np.array([inside.polygon])
        return cls(inside, segment, all(bool(space.shapes_free(shape, reach)[0]) for space, reach in free_spaces))

    def covers(self, segment: FloatArray) -> bool:
        """Return whether a segment (2, 2) lies inside the region."""
        return bool((self.inside.excess(segment) <= TOUCH).all())

    def distance_planes(self, space: FreeSpace, piece: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Return planes that bound the distance d(p) to obstacles from below, everywhere in the region.

        They have normals a (m, 2) and offsets c (m,), with ``d(p) >= min(width, min_k (c_k - a_k p))``; d is 0 outside
        the free space. The bound is tightest near ``piece`` (2, 2), a segment in the region. If no bound is found, the
        result is one plane of zeros.
        """
        clear = clear_of(space, piece, width + WIDTH)
        if clear is None:
            return np.zeros((1, 2)), np.zeros(1)
        farther = (clear.normals @ self.inside.corners.T).max(axis=1) <= clear.offsets - width
        return clear.normals[~farther], clear.offsets[~farther]


@dataclass(frozen=True, eq=False)
class Corridor:
    """Sequence of overlapping convex regions, one for each segment of a polyline.

    regions       n regions, of which neighbours overlap; one region if the start is the goal
    overlaps      n - 1 intersections of neighbouring regions; if vertices lie in these, each segment is in its region
    warm          polyline around which the regions were grown
    along_first   whether the first segment must keep the heading of the start, so that the robot does not turn there
    along_last    whether the last segment must keep the heading of the goal
    warm_starts   indices of the warm starts that lead through this corridor
    """

    regions: tuple[FreeRegion, ...]
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
        """The n segments of the warm polyline, (2, 2) each, m."""
        return list(_segments(self.warm))

    @property
    def is_fixed(self) -> bool:
        """True if no vertex can move: there is no inner vertex, or the headings of start and goal fix the only one."""
        return self.segments < 2 or (self.segments == 2 and self.along_first and self.along_last)


def corridors(
    polylines: Sequence[Polyline],
    problem: Problem,
    deadline: Deadline = Deadline(),  # noqa: B008  (frozen)
) -> tuple[list[Corridor], int]:
    """Grow corridors around polylines; return them, and the number of polylines that touch an obstacle.

    A segment that lies in regions grown for earlier segments gets the largest of them, so that polylines through the
    same rooms share a corridor. After the deadline, the remaining polylines get no corridor.
    """
    regions: list[FreeRegion] = []
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
    return [
        _corridor(key, [regions[i] for i in key[0]], polylines, numbers) for key, numbers in groups.items()
    ], refused


def _corridor(
    key: tuple[tuple[int, ...], bool, bool], chain: list[FreeRegion], polylines: Sequence[Polyline], numbers: list[int]
) -> Corridor:
    overlaps = tuple(a.inside.cut(b.inside.normals, b.inside.offsets) for a, b in pairwise(chain))
    return Corridor(tuple(chain), overlaps, polylines[numbers[0]], key[1], key[2], tuple(numbers))


def _segments(polyline: Polyline) -> Iterator[FloatArray]:
    vertices = polyline.vertices if len(polyline.vertices) > 1 else polyline.vertices[[0, 0]]
    for a, b in pairwise(vertices):
        yield np.array([a, b])


def _region(segment: FloatArray, regions: list[FreeRegion], problem: Problem) -> int:
    """Return the index of the largest of the ``regions`` that covers a segment; if none does, grow one and append it.

    The result is -1 if the segment touches an obstacle.
    """
    covering = [i for i, region in enumerate(regions) if region.covers(segment)]
    if covering:
        return max(covering, key=lambda i: regions[i].inside.polygon.area)
    grown = FreeRegion.around(segment, in_plane(problem.model), problem.world)
    if grown is None:
        return -1
    regions.append(grown)
    return len(regions) - 1


def spaces(model: PlanarModel, world: World) -> list[tuple[FreeSpace, float]]:
    """Return the free space at each height range of the robot's parts, with the largest reach of the parts there, m."""
    return [(world.free_space(z), reach) for z, reach in reaches(model, world)]


def _clipped(corners: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """Clip a convex polygon (n, 2) by a line; return the corners of its part on the inner side of the line.

    This is the algorithm of Sutherland and Hodgman (1974). The inner side has ``corners @ normal <= offset``.
    """
    beyond = corners @ normal - offset
    if (beyond <= 0.0).all():
        return corners
    inner = []
    for i, (point, s) in enumerate(zip(corners, beyond, strict=True)):
        before, b = corners[i - 1], beyond[i - 1]
        if (b > 0.0) != (s > 0.0):
            inner.append(before + (point - before) * (b / (b - s)))
        if s <= 0.0:
            inner.append(point)
    return np.array(inner).reshape(-1, 2)


def _inside(edges: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """Clip edges (E, 2, 2) by a line; return the pieces on its inner side, without edges that only touch the line.

    The inner side has ``points @ normal <= offset``.
    """
    beyond = edges @ normal - offset  # (E, 2)
    edges, beyond = edges[(beyond < -ROUNDING).any(axis=1)], beyond[(beyond < -ROUNDING).any(axis=1)]
    for end in (0, 1):
        outer = beyond[:, end] > 0.0
        share = (beyond[outer, 1 - end] / (beyond[outer, 1 - end] - beyond[outer, end]))[:, None]
        fixed = edges[outer, 1 - end]
        edges[outer, end] = fixed + share * (edges[outer, end] - fixed)
    return edges
