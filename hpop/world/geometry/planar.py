"""Distances in the plane: how far points and segments are from the border of a free region, exactly.

The free region is the extent without everything blocked; its border therefore holds the obstacles' outlines,
the keep-out zones' and the extent's own. A tree of boxes answers for points, another one for other shapes.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray
from hpop.world.geometry.edge_tree import EdgeTree

TOLERANCE = 1e-9
"""Metres by which a segment may miss its margin."""
GRID = 2.0**-43
"""Share of the largest coordinate to which free regions with slanting edges are rounded: 1e-10 m in 1 km."""


def without(region: BaseGeometry, blocked: BaseGeometry) -> BaseGeometry:
    """A region without what is blocked, m.

    GEOS may lose whole polygons, and not say so, where edges all but coincide, as those of cells on a map that is
    turned: seen once in a thousand small maps, and never on a grid.
    """
    points, ring = shapely.get_coordinates(shapely.get_rings(shapely.get_parts([region, blocked])), return_index=True)
    slanting = np.diff(points, axis=0).all(axis=1) & (np.diff(ring) == 0)
    if not slanting.any():
        return shapely.difference(region, blocked)
    return shapely.difference(region, blocked, grid_size=GRID * float(np.abs(points).max()))


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """A free region (polygon or multipolygon, m) and the edges of its border."""

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
        shapely.contains_xy(self.region, (x_min + x_max) / 2, (y_min + y_max) / 2)  # indexes it, before threads ask
        object.__setattr__(self, "edges", edges)
        if len(edges):
            object.__setattr__(self, "_nearest", EdgeTree.build(edges.reshape(-1, 4)))
        lines = np.asarray(shapely.linestrings(edges), dtype=object)
        object.__setattr__(self, "_tree", shapely.STRtree(lines))

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Distance (m) to the nearest edge of the border, inside and outside alike; inf without a border."""
        if not len(self.edges):
            return np.full(x.shape, np.inf)
        return self._nearest.distance(x, y)

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether points are strictly inside the free region."""
        return shapely.contains_xy(self.region, x, y)

    def clearance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Distance (m) to the border for points inside, 0 for all others; NaN for NaN."""
        result = np.where(np.isnan(x) | np.isnan(y), np.nan, 0.0)
        inside = self.contains(x, y)
        result[inside] = self.distance(x[inside], y[inside])
        return result

    def signed_clearance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """`clearance` for points inside, minus the distance to the free region for all others."""
        return np.where(self.contains(x, y), 1.0, -1.0) * self.distance(x, y)

    def segments_free(self, x0: FloatArray, y0: FloatArray, x1: FloatArray, y1: FloatArray, margin: float) -> BoolArray:
        """Whether segments lie in the free region, at least ``margin`` (>= 0, m) from its border.

        Cheap tests decide most: free if the midpoint's clearance exceeds margin + half the length, not free
        if an end is closer than the margin. The rest asks the tree of edges for anything within the margin.
        """
        middle = self.clearance((x0 + x1) / 2, (y0 + y1) / 2)
        free = middle >= margin + np.hypot(x1 - x0, y1 - y0) / 2
        free &= middle > 0
        open_ = np.flatnonzero(~free & (middle >= margin - TOLERANCE))
        for x, y in ((x0, y0), (x1, y1)):
            open_ = open_[self.clearance(x[open_], y[open_]) >= margin - TOLERANCE]
        ends = np.stack([x0[open_], y0[open_], x1[open_], y1[open_]], axis=1).reshape(-1, 2, 2)
        free[open_] = self.shapes_free(np.asarray(shapely.linestrings(ends), dtype=object), margin)
        return free

    def shapes_free(self, shapes: NDArray[np.object_], margin: float) -> BoolArray:
        """Whether shapely geometries (N,) lie in the free region, at least ``margin`` (m) from its border."""
        if margin <= TOLERANCE:
            return np.asarray(shapely.covers(_own(self), shapes), dtype=bool)
        # A border out of reach leaves a shape all inside or all outside: one of its points tells.
        free = self.contains(*_first_point(shapes))
        free[self._tree.query(shapes, predicate="dwithin", distance=margin - TOLERANCE)[0]] = False
        return free


class _Copies(threading.local):
    """Prepared copies of regions, of one thread."""

    def __init__(self) -> None:
        self.regions: WeakKeyDictionary[FreeSpace, BaseGeometry] = WeakKeyDictionary()


_COPIES = _Copies()


def _own(space: FreeSpace) -> BaseGeometry:
    """The region, prepared for this thread alone.

    A prepared geometry keeps state while its edges are asked: two threads that do so corrupt memory (libgeos/geos#825).
    """
    copies = _COPIES.regions
    if space not in copies:
        copies[space] = shapely.from_wkb(shapely.to_wkb(space.region))
        shapely.prepare(copies[space])
    return copies[space]


def edges_of_one(one: FreeSpace, other: FreeSpace) -> FloatArray:
    """Edges (E, 4), m, that the border of one of two free spaces has, and that of the other has not.

    An edge has a direction, by which the free region is on its right: between the same points it may have two.
    """
    edges = np.concatenate([one.edges, other.edges]).reshape(-1, 4)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    alone: FloatArray = distinct[count == 1]
    return alone


def _first_point(shapes: NDArray[np.object_]) -> tuple[FloatArray, FloatArray]:
    points, owner = shapely.get_coordinates(shapes, return_index=True)
    first = np.searchsorted(owner, np.arange(len(shapes)))
    return points[first, 0], points[first, 1]
