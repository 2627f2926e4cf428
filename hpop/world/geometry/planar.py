"""Distances in the plane: trees and grids of edges, and the clearance of points and segments in a free region.

The free region is the extent less obstacles and keep-out zones. Its border consists of their outlines and the outline
of the extent. Distances of points use a tree of boxes, other shapes a tree of GEOS, and rays the buckets of a grid. All
distances are exact.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray, IntArray, distinct
from hpop.world import geometry

LEAF = 4  # pieces of edges in a leaf
ROUNDING = 8  # units in the last place by which boxes are enlarged against rounding
BITS = 16  # bits of each coordinate by which pieces are sorted
TOLERANCE = 1e-9
"""Distance, m, by which a segment may come closer to the border than its margin: rounding."""
SLACK = 2.0**-40
"""Distance between hull and border within which GEOS decides, relative to the largest coordinate."""
GRID = 2.0**-43
"""Grid to which free regions with slanting edges are rounded, relative to the largest coordinate: 1e-10 m in 1 km."""


@dataclass(frozen=True, eq=False)
class EdgeTree:
    """Edges in a binary tree of boxes; the children of node i are 2 i + 1 and 2 i + 2.

    The time for a point is mostly logarithmic in the number of edges. The worst case is the square root: at the centre
    of a circle of many edges, all are about equally near.

    edges    (E, 4)     m   x0, y0, x1, y1; at least one
    members  (L, LEAF)      the edges in each leaf, filled up with repetitions; L is a power of two
    boxes    (2 L - 1, 4)   m   x_min, y_min, x_max, y_max of each node; the last L are the leaves
    """

    edges: FloatArray
    members: IntArray
    boxes: FloatArray

    @classmethod
    def build(cls, edges: FloatArray) -> EdgeTree:
        """Build a tree of edges (E, 4), m. Long edges are cut, so that boxes are small."""
        edge, pieces = _pieces(edges)
        middle = 0.5 * (pieces[:, :2] + pieces[:, 2:])
        order = np.argsort(_curve(middle), kind="stable")
        leaves = 1 << max(0, math.ceil(order.size / LEAF) - 1).bit_length()
        filled = np.minimum(np.arange(leaves * LEAF), order.size - 1)
        members = edge[order[filled]].reshape(leaves, LEAF)
        low, high = (
            reach(pieces[:, :2], pieces[:, 2:])[order[filled]].reshape(leaves, LEAF, 2)
            for reach in (np.minimum, np.maximum)
        )
        slack = ROUNDING * np.spacing(np.abs(edges).max())
        boxes = np.empty((2 * leaves - 1, 4))
        boxes[leaves - 1 :] = np.concatenate([low.min(axis=1) - slack, high.max(axis=1) + slack], axis=1)
        while leaves > 1:
            leaves //= 2
            below = boxes[2 * leaves - 1 : 4 * leaves - 1].reshape(leaves, 2, 4)
            boxes[leaves - 1 : 2 * leaves - 1] = np.concatenate(
                [below[:, :, :2].min(axis=1), below[:, :, 2:].max(axis=1)], axis=1
            )
        return cls(edges, members, boxes)

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (M,), m, of points to the nearest edge."""
        out, levels = np.empty(x.shape), len(self.members).bit_length() + 1
        scratch = np.empty(2 * levels, np.int64), np.empty(2 * levels)
        geometry._kernels.nearest(self.edges, self.members, self.boxes, *scratch, x, y, out)
        return out

    def compare(self, corners: FloatArray, margin: float, relation: NDArray[np.uint8]) -> None:
        """Mark in ``relation`` (N,) which convex hulls of corners (N, c, 2), m, are within ``margin`` of the edges.

        See :func:`._hulls.compare_hulls` for the values in ``relation``.
        """
        levels, count = len(self.members).bit_length() + 1, corners.shape[1]
        scratch = np.empty(2 * levels, np.int64), *np.split(np.empty((6 * count, 3)), [count, 3 * count])
        slack = SLACK * float(np.abs(self.boxes[0]).max())
        geometry._hulls.compare_hulls(
            self.edges, self.members, self.boxes, *scratch[:1], corners, *scratch[1:], margin, slack, relation
        )


def _pieces(edges: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cut long slanting edges (E, 4), m, into pieces; return the edge index (P,) and the ends (P, 4) of each piece."""
    size = edges.reshape(-1, 2).max(axis=0) - edges.reshape(-1, 2).min(axis=0)
    most = max(math.sqrt(2.0 * size[0] * size[1] / len(edges)), size.max() * 2.0 / len(edges), 1e-9)
    slanting = (edges[:, :2] != edges[:, 2:]).all(axis=1)  # an edge parallel to an axis fills its box
    length = np.where(slanting, np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]), 0.0)
    count = np.maximum(1, np.ceil(length / most)).astype(np.int64)
    edge = np.repeat(np.arange(len(edges)), count)
    number = np.arange(edge.size) - np.repeat(np.cumsum(count) - count, count)
    begin, end = (share[:, None] / count[edge][:, None] for share in (number, number + 1))
    first, last = edges[edge, :2], edges[edge, 2:]
    return edge, np.concatenate([first + begin * (last - first), first + end * (last - first)], axis=1)


def _curve(points: FloatArray) -> IntArray:
    """Return for each point (P, 2) its place along a Morton curve, a number: near points mostly have near numbers."""
    low = points.min(axis=0)
    side = max(float((points.max(axis=0) - low).max()), 1e-9)
    cells = np.minimum((points - low) / side * 2**BITS, 2**BITS - 1).astype(np.int64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << shift)) & mask
    return np.asarray(cells[:, 0] | (cells[:, 1] << 1))


def without(region: BaseGeometry, blocked: BaseGeometry) -> BaseGeometry:
    """Return a region less a blocked region, m.

    If there are slanting edges, coordinates are snapped to a fine grid. Otherwise GEOS may silently lose whole polygons
    where edges almost coincide, as edges of cells on a rotated map do: once in a thousand small maps.
    """
    points, ring = shapely.get_coordinates(shapely.get_rings(shapely.get_parts([region, blocked])), return_index=True)
    slanting = np.diff(points, axis=0).all(axis=1) & (np.diff(ring) == 0)
    if not slanting.any():
        return shapely.difference(region, blocked)
    return shapely.difference(region, blocked, grid_size=GRID * float(np.abs(points).max()))


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Free region (polygon or multipolygon, m) and the edges of its border."""

    region: BaseGeometry
    edges: FloatArray = field(init=False)  # (E, 2, 2) m
    _nearest: EdgeTree = field(init=False, repr=False)
    _tree: shapely.STRtree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Index the border."""
        rings = shapely.get_rings(shapely.get_parts(self.region))
        points, ring = shapely.get_coordinates(rings, return_index=True)
        same = ring[1:] == ring[:-1]
        edges = np.stack([points[:-1][same], points[1:][same]], axis=1)
        shapely.prepare(self.region)
        x_min, y_min, x_max, y_max = shapely.bounds(self.region)
        shapely.contains_xy(self.region, (x_min + x_max) / 2, (y_min + y_max) / 2)  # builds its index before threads do
        object.__setattr__(self, "edges", edges)
        if len(edges):
            object.__setattr__(self, "_nearest", EdgeTree.build(edges.reshape(-1, 4)))
        lines = np.asarray(shapely.linestrings(edges), dtype=object)
        object.__setattr__(self, "_tree", shapely.STRtree(lines))

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (m) to the nearest edge of the border, from either side; inf without a border."""
        if not len(self.edges):
            return np.full(x.shape, np.inf)
        return self._nearest.distance(x, y)

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points (M,) lie strictly inside the free region."""
        return shapely.contains_xy(self.region, x, y)

    def clearance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (m) to the border for points inside, 0 for all others; NaN for NaN."""
        result = np.where(np.isnan(x) | np.isnan(y), np.nan, 0.0)
        inside = self.contains(x, y)
        result[inside] = self.distance(x[inside], y[inside])
        return result

    def differs(self, before: FreeSpace, x: FloatArray, y: FloatArray, within: float) -> BoolArray:
        """Return at which points (M,) the free space may differ from a previous one somewhere within ``within`` m.

        The free space is equal there if no edge within that distance was added or removed, and the point is free in
        both or in neither.
        """
        if self is before:
            return np.zeros(x.shape, dtype=np.bool_)
        both = np.concatenate([_distinct(space.edges) for space in (self, before)])
        edges, count = np.unique(both, axis=0, return_counts=True)
        found: BoolArray = self.contains(x, y) != before.contains(x, y)
        if (count == 1).any():
            found |= EdgeTree.build(edges[count == 1]).distance(x, y) <= within
        return found

    def signed_clearance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (m) to the border for points inside the free region, and minus this distance outside."""
        return np.where(self.contains(x, y), 1.0, -1.0) * self.distance(x, y)

    def segments_free(self, x0: FloatArray, y0: FloatArray, x1: FloatArray, y1: FloatArray, margin: float) -> BoolArray:
        """Return which segments (M,) lie in the free region, at least ``margin`` (>= 0, m) from its border.

        The margin may be missed by `TOLERANCE`.

        Cheap tests decide most: a segment is free if the clearance of its midpoint exceeds the margin plus half its
        length, and not free if an end is closer than the margin. The remaining ones are looked up in the tree of edges.
        """
        middle = self.clearance((x0 + x1) / 2, (y0 + y1) / 2)
        free = middle >= margin + np.hypot(x1 - x0, y1 - y0) / 2
        free &= middle > 0
        open_ = np.flatnonzero(~free & (middle >= margin - TOLERANCE))
        for x, y in ((x0, y0), (x1, y1)):
            open_ = open_[self.clearance(x[open_], y[open_]) >= margin - TOLERANCE]
        ends = np.stack([x0[open_], y0[open_], x1[open_], y1[open_]], axis=1).reshape(-1, 2, 2)
        free[open_] = self.hulls_free(ends, margin)
        return free

    def shapes_free(self, shapes: NDArray[np.object_], margin: float) -> BoolArray:
        """Return which shapely geometries (N,) lie in the free region, at least ``margin`` (m) from its border."""
        if margin <= TOLERANCE:
            return np.asarray(shapely.covers(_own(self), shapes), dtype=bool)
        # If the border is out of reach, a shape is all inside or all outside, so one of its points decides.
        free = self.contains(*_first_point(shapes))
        free[self._tree.query(shapes, predicate="dwithin", distance=margin - TOLERANCE)[0]] = False
        return free

    def hulls_free(self, corners: FloatArray, margin: float) -> BoolArray:
        """Return which convex hulls of corners (N, c, 2), m, are free, at least ``margin`` (m) from the border.

        The result equals that of :meth:`shapes_free`, which is slower. That method is called only while the compiled
        loop does not pay, and for hulls that the loop cannot decide, such as those at the margin up to rounding.
        """
        hulls = geometry._hulls
        if not hulls.is_worth_compiling(len(corners)):
            return self.shapes_free(convex_hulls(corners), margin)
        relation = np.full(len(corners), hulls.CLEAR, np.uint8)
        self.compare(corners, margin - TOLERANCE if margin > TOLERANCE else 0.0, relation)
        free: BoolArray = relation == hulls.CLEAR
        free[free] = self.contains(corners[free, 0, 0], corners[free, 0, 1])
        unsure = np.flatnonzero(relation == hulls.UNSURE)
        if unsure.size:
            free[unsure] = self.shapes_free(convex_hulls(corners[unsure]), margin)
        return free

    def compare(self, corners: FloatArray, margin: float, relation: NDArray[np.uint8]) -> None:
        """Mark in ``relation`` (N,) which convex hulls of corners (N, c, 2), m, are within ``margin`` of the border.

        See :func:`._hulls.compare_hulls` for the values in ``relation``.
        """
        if len(self.edges):
            self._nearest.compare(corners, margin, relation)


def convex_hulls(corners: FloatArray) -> NDArray[np.object_]:
    """Return the convex hulls of corners (N, c, 2) as shapely geometries."""
    size, count, _ = corners.shape
    if count == 2 and (corners[:, 0] != corners[:, 1]).any(axis=1).all():  # takes a tenth of the time
        return np.asarray(shapely.linestrings(corners), dtype=object)
    points = shapely.multipoints(corners.reshape(-1, 2), indices=np.repeat(np.arange(size), count))
    return np.asarray(shapely.convex_hull(points), dtype=object)


def _distinct(edges: FloatArray) -> FloatArray:
    """Return the different edges among (N, 2, 2), m, as rows (E, 4); an edge and its reverse count as one."""
    (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
    swapped = (x0 > x1) | ((x0 == x1) & (y0 > y1))
    return np.unique(np.where(swapped[:, None, None], edges[:, ::-1], edges).reshape(-1, 4), axis=0)


class _Copies(threading.local):
    """Prepared copies of regions, one set per thread."""

    def __init__(self) -> None:
        self.regions: WeakKeyDictionary[FreeSpace, BaseGeometry] = WeakKeyDictionary()


_COPIES = _Copies()


def _own(space: FreeSpace) -> BaseGeometry:
    """Return a copy of the region that only this thread uses, prepared for fast queries.

    Queries change the state of a prepared geometry, so two threads would corrupt memory (libgeos/geos#825).
    """
    copies = _COPIES.regions
    if space not in copies:
        copies[space] = shapely.from_wkb(shapely.to_wkb(space.region))
        shapely.prepare(copies[space])
    return copies[space]


def edges_of_one(one: FreeSpace, other: FreeSpace) -> FloatArray:
    """Return the edges (E, 4), m, on the border of exactly one of two free spaces.

    Edges are directed, with the free region on the right; an edge and its reverse are different.
    """
    edges = np.concatenate([one.edges, other.edges]).reshape(-1, 4)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    alone: FloatArray = distinct[count == 1]
    return alone


def _first_point(shapes: NDArray[np.object_]) -> tuple[FloatArray, FloatArray]:
    points, owner = shapely.get_coordinates(shapes, return_index=True)
    first = np.searchsorted(owner, np.arange(len(shapes)))
    return points[first, 0], points[first, 1]


@dataclass(frozen=True, eq=False)
class EdgeGrid:
    """Grid of square buckets, each with the edges that cross it, for rays that go from bucket to bucket.

    edges    (E, 4)    m   x0, y0, x1, y1; at least one
    corner   (x, y)    m   lower-left corner of bucket [0, 0]
    side     float     m   of a bucket
    start    (R C + 1,)    the edges of bucket [i, j] are members[start[i C + j]:start[i C + j + 1]]
    members  (K,)          indices of edges, bucket after bucket
    shape    (R, C)        rows and columns of buckets
    """

    edges: FloatArray
    corner: tuple[float, float]
    side: float
    start: IntArray
    members: IntArray
    shape: tuple[int, int]

    @classmethod
    def build(cls, edges: FloatArray) -> EdgeGrid:
        """Build a grid of edges (E, 4), m, with about two edges per bucket."""
        corner = np.minimum(edges[:, :2], edges[:, 2:]).min(axis=0)
        size = np.maximum(edges[:, :2], edges[:, 2:]).max(axis=0) - corner
        least = size.max() * max(2.0 / len(edges), 1.0 / 2000.0)  # of a flat box: one row of buckets
        side = max(math.sqrt(2.0 * size[0] * size[1] / len(edges)), least, 1e-9)
        columns, rows = np.floor(size / side).astype(np.int64) + 1
        bucket, member = _crossings(edges, corner, side, (int(rows), int(columns)))
        start = np.searchsorted(bucket, np.arange(rows * columns + 1))
        return cls(edges, (float(corner[0]), float(corner[1])), side, start, member, (int(rows), int(columns)))


def _crossings(edges: FloatArray, corner: FloatArray, side: float, shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Return two arrays: for each bucket that an edge crosses, the bucket and the edge, sorted by bucket.

    Long edges are cut; each piece counts for the buckets that its bounding box overlaps.
    """
    length = np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1])
    pieces = np.maximum(1, np.ceil(length / side)).astype(np.int64)
    edge = np.repeat(np.arange(len(edges)), pieces)
    number = np.arange(edge.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    step = (edges[edge, 2:] - edges[edge, :2]) / pieces[edge, None]
    ends = edges[edge, :2] + step * number[:, None]
    cells = np.floor((np.stack([ends, ends + step]) - corner) / side).astype(np.int64)  # (2, P, 2)
    cells = np.clip(cells, 0, np.array(shape[::-1]) - 1)
    buckets = [cells[i, :, 1] * shape[1] + cells[j, :, 0] for i in (0, 1) for j in (0, 1)]
    return np.divmod(distinct(np.concatenate(buckets) * len(edges) + np.tile(edge, 4)), len(edges))
