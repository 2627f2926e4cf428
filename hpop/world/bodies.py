"""Bodies of a world for the collision checks of robot arms, and rules of a planning scene for a robot's links.

Bodies are convex and stand for obstacles. Solids are taken as they are. Prisms (extruded polygons) are cut into convex
pieces, and occupied cells are merged into boxes. Rules are padding, scale, pairs of bodies that may touch, and objects
that links carry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import LEAST, MOST, real
from hpop.base.text import counted, shown
from hpop.errors import MapError, did_you_mean
from hpop.runtime import limits
from hpop.world.content.content import Content
from hpop.world.geometry.shapes import Obstacle, Raster
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid

ENDLESS = 10.0
"""Height above the floor, m, at which a prism without a top is cut off; a prism without a bottom is cut off this far
below the floor. Such a prism is made taller where needed, so that it is at least this tall."""
MOST_BODIES = 5_000
"""Largest number of convex bodies in a world."""
MOST_RUNS = 1_000_000
"""Largest number of runs (occupied cells side by side in one row) that are merged into rectangles."""
EXACT = 1e-12
"""Relative difference of two areas up to which they count as equal: rounding."""
SLIVER = 10 * LEAST
"""Width, m, below which a piece of a prism is replaced by its bounding rectangle."""

MAKING = "the bodies of the world were made"


def solid_bodies(obstacles: Sequence[Obstacle], raster: Raster | None) -> tuple[Solid, ...]:
    """Return all obstacles as named convex bodies: solids, convex pieces of prisms, and boxes over occupied cells.

    Raises MapError for more than `MOST_BODIES` bodies of prisms and solids, or of cells.
    """
    bodies: list[Solid] = []
    solid_count = 0
    for index, obstacle in enumerate(obstacles):
        limits.check(MAKING)
        if (solid := obstacle.solid) is not None:
            bodies.append(solid if solid.name else replace(solid, name=f"solid {solid_count}"))
            solid_count += 1
        else:
            bodies += prisms(obstacle.polygon, obstacle.heights, f"obstacle {index}")
        _check_count(len(bodies), "obstacles")
    return (*bodies, *(_boxes(raster) if raster is not None else ()))


def closed_bodies(content: Content, keep_out: BaseGeometry) -> tuple[Solid, ...]:
    """Return keep-out zones and standing people as tall columns, which robots must avoid as they avoid obstacles.

    ``keep_out`` is the region of the world's own, m, in addition to the zones of the content.
    """
    bodies = []
    for index, person in enumerate(content.people):
        if not person.moves:
            pose = np.eye(4)
            pose[:2, 3] = person.x, person.y
            bodies.append(Solid(Cylinder(person.radius, 2 * ENDLESS), pose, person.name or f"person {index}"))
    zones = [(zone.area, zone.name) for zone in content.zones if zone.kind == "keep-out"]
    for area, name in [(keep_out, ""), *zones]:
        for polygon in shapely.get_parts(area):
            bodies += prisms(polygon, (-math.inf, math.inf), name or "keep-out zone")
            _check_count(len(bodies), "keep-out zones")
    return tuple(bodies)


def prisms(polygon: Polygon, heights: tuple[float, float], name: str) -> Iterator[Solid]:
    """Cut a prism (a polygon, m, between two heights, m) into convex prisms, and yield them as named solids.

    Infinite heights are replaced by finite ones, see `ENDLESS`.
    """
    low, high = heights
    bottom = low if math.isfinite(low) else min(-ENDLESS, high - ENDLESS)
    top = high if math.isfinite(high) else max(ENDLESS, low + ENDLESS)
    for piece in convex_pieces(polygon):
        yield _prism(piece, bottom, top, name)


def convex_pieces(polygon: Polygon) -> list[Polygon]:
    """Cut a polygon, which may have holes, into convex polygons.

    The polygon is first cut into triangles. Then neighbouring pieces are merged if their union is convex, those with
    the longest common side first. There may be more pieces than necessary.

    >>> sorted(p.area for p in convex_pieces(shapely.Polygon([(0, 0), (9, 0), (9, 1), (1, 1), (1, 3), (0, 3)])))
    [2.5, 8.5]
    """
    hull = shapely.convex_hull(polygon)
    if hull.area <= polygon.area * (1 + EXACT):
        return [hull]  # type: ignore[list-item]  # a polygon's hull is one
    triangles: list[Any] = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)).tolist()
    pieces: dict[int, Any] = dict(enumerate(triangles))
    owner = list(range(len(triangles)))

    def piece_of(triangle: int) -> int:
        while owner[triangle] != triangle:
            owner[triangle] = triangle = owner[owner[triangle]]
        return triangle

    for first, second in _neighbours(triangles):
        a, b = piece_of(first), piece_of(second)
        joined = shapely.convex_hull(shapely.GeometryCollection([pieces[a], pieces[b]]))
        if a != b and joined.area <= (pieces[a].area + pieces[b].area) * (1 + EXACT):
            owner[b] = a
            pieces[a] = joined
            del pieces[b]
    return list(pieces.values())


def _neighbours(triangles: Sequence[Polygon]) -> list[tuple[int, int]]:
    """Return the pairs of triangles that share a side, in order of decreasing length of this side."""
    first: dict[tuple[tuple[float, ...], ...], int] = {}
    shared: list[tuple[float, int, int]] = []
    for number, triangle in enumerate(triangles):
        corners = triangle.exterior.coords[:3]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            side = tuple(sorted((corners[a], corners[b])))
            if side in first:
                shared.append((math.dist(*side), first[side], number))
            first[side] = number
    return [(a, b) for _, a, b in sorted(shared, key=lambda pair: -pair[0])]


def _prism(piece: Polygon, bottom: float, top: float, name: str) -> Solid:
    """Return the upright prism over a convex polygon: a box for a rectangle or a sliver, else a convex hull."""
    corners = shapely.get_coordinates(shapely.convex_hull(piece))[:-1]
    pose = np.eye(4)
    pose[2, 3] = (bottom + top) / 2
    height = max(top - bottom, LEAST)
    if not _is_rectangle(corners):
        around = shapely.get_coordinates(shapely.minimum_rotated_rectangle(piece))[:-1]
        if not np.hypot(*np.diff(around[:3], axis=0).T).min() < SLIVER:
            pose[:2, 3] = middle = corners.mean(axis=0)
            ends = [np.c_[corners - middle, np.full(len(corners), z)] for z in (-height / 2, height / 2)]
            return Solid(Hull(np.concatenate(ends)), pose, name)
        corners = around
    ahead, left = corners[1] - corners[0], corners[2] - corners[1]
    length, width = float(np.hypot(*ahead)), float(np.hypot(*left))
    cos, sin = ahead / length
    pose[:2, :2] = (cos, -sin), (sin, cos)
    pose[:2, 3] = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return Solid(Box((max(length, LEAST), max(width, LEAST), height)), pose, name)


def _is_rectangle(corners: FloatArray) -> bool:
    if len(corners) != 4:
        return False
    ahead, left = corners[1] - corners[0], corners[3] - corners[0]
    size = EXACT * (np.abs(corners).max() + np.hypot(*ahead))
    square = abs(ahead @ left) <= size * np.hypot(*left)
    return bool(square and (np.abs(corners[0] + ahead + left - corners[2]) <= size).all())


def _boxes(raster: Raster) -> Iterator[Solid]:
    """Yield boxes that cover the occupied cells between the heights of the raster; see `ENDLESS` for infinite ones."""
    rectangles = _rectangles(raster.cells)
    _check_count(len(rectangles), "cells")
    bottom = max(raster.z_min, min(-ENDLESS, raster.z_max - ENDLESS))
    top = min(raster.z_max, max(ENDLESS, raster.z_min + ENDLESS))
    for left, low, right, high in rectangles.tolist():
        corners = [raster.to_world(*corner) for corner in ((left, low), (right, low), (right, high), (left, high))]
        yield _prism(Polygon(corners), bottom, top, "cells")


def _rectangles(cells: BoolArray) -> IntArray:
    """Return rectangles that together cover exactly the occupied cells (H, W).

    Each row of the result (n, 4) is first column, first row, last column + 1, last row + 1. A run is a row of adjacent
    occupied cells; runs with the same columns in successive rows become one rectangle.
    """
    limits.check(MAKING)
    padded = np.pad(cells, ((0, 0), (1, 1)))
    begins, ends = padded[:, 1:] & ~padded[:, :-1], padded[:, :-1] & ~padded[:, 1:]
    runs = int(np.count_nonzero(begins))
    if runs > MOST_RUNS:
        _check_count(runs, "rows of neighbouring cells")
    (row, left), right = np.nonzero(begins), np.nonzero(ends)[1]
    order = np.lexsort((row, right, left))
    row, left, right = row[order], left[order], right[order]
    new = (np.diff(left) != 0) | (np.diff(right) != 0) | (np.diff(row) != 1)
    first, last = np.flatnonzero(np.append(True, new)), np.flatnonzero(np.append(new, True))
    if not runs:
        return np.empty((0, 4), dtype=np.int64)
    return np.stack([left[first], row[first], right[first], row[last] + 1], axis=1).astype(np.int64)


def _check_count(count: int, what: str) -> None:
    if count > MOST_BODIES:
        raise MapError(
            f"the {what} of this world make {count:,} convex bodies in space, expected at most {MOST_BODIES:,}. Use a "
            "smaller part of the map, larger cells, or simpler outlines."
        )


Pair = tuple[str, str]
"""Names of two bodies, in alphabetical order."""
MOST_ATTACHED = 100
"""Largest number of objects attached to links."""
MOST_NAMED = 8
"""Largest number of links that a note names."""
WIDEST = 10.0
"""Largest padding of a link, m."""


@dataclass(frozen=True)
class LinkRules:
    """Rules for the links of an arm, by their names.

    padding   m, by link: distance that a link keeps from obstacles, in addition to the usual distance
    scale     by link: factor by which a link is enlarged before it is tested with obstacles
    pairs     by two names, of links or of obstacles, in alphabetical order: whether the two may touch
    others    by name of a link or an obstacle: whether it may touch other bodies. Read for two bodies without an entry
              in ``pairs``: all entries that the two have must allow it, and at least one must exist
    attached  objects that links carry, as the option ``attached`` of an arm lists them
    frames    by name of an obstacle: frame in which it is given, such as a link, until a robot places it in the world
    joints    rad or m, by joint of the robot: its state when the scene was saved; read only if a frame may need it
    """

    padding: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    pairs: Mapping[Pair, bool] = field(default_factory=dict)
    others: Mapping[str, bool] = field(default_factory=dict)
    attached: tuple[Mapping[str, Any], ...] = ()
    frames: Mapping[str, str] = field(default_factory=dict)
    joints: Mapping[str, float] = field(default_factory=dict)

    def may_touch(self, one: str, other: str) -> bool:
        """Return whether two bodies may touch.

        An entry for the pair decides. Without one, the entries of single names decide: they must all allow it. Bodies
        without any entry may not touch.

        >>> rules = LinkRules(pairs={("can", "hand"): False}, others={"hand": True, "wall": False})
        >>> rules.may_touch("hand", "can"), rules.may_touch("hand", "cup"), rules.may_touch("hand", "wall")
        (False, True, False)
        """
        pair = (one, other) if one < other else (other, one)
        if pair in self.pairs:
            return self.pairs[pair]
        given = [self.others[name] for name in pair if name in self.others]
        return bool(given) and all(given)

    def notes_on(self, links: Collection[str], obstacles: Callable[[], Iterable[str]]) -> Iterator[str]:
        """Yield notes on names without effect: padded links that a robot with these links lacks, unknown pairs.

        ``obstacles`` returns the names of the obstacles; it is called only if a pair names no link.
        """
        changed = {name for name, by in self.padding.items() if by} | {
            name for name, by in self.scale.items() if by != 1.0
        }
        if strange := sorted(changed.difference(links)):
            number, listed = _counted_names(strange, "link", links)
            yield f"the scene pads or scales {number} that the robot does not have, to no effect: {listed}"
        listed_names = {*self.others, *(name for pair in self.pairs for name in pair)}
        strange = sorted(listed_names.difference(links, (str(each["name"]) for each in self.attached)))
        known = {*links, *obstacles()} if strange else set()
        if strange := [name for name in strange if name not in known]:
            number, listed = _counted_names(strange, "name", known)
            yield (
                f"the scene's allowed_collision_matrix has {number} of neither a link of the robot nor an obstacle, to "
                f"no effect: {listed}"
            )

    def __bool__(self) -> bool:
        return any((self.padding, self.scale, self.pairs, self.others, self.attached, self.frames))

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description; :meth:`build` turns it into equal rules."""
        return {
            "padding": dict(self.padding),
            "scale": dict(self.scale),
            "pairs": [[*pair, allowed] for pair, allowed in self.pairs.items()],
            "others": dict(self.others),
            **({"attached": [dict(each) for each in self.attached]} if self.attached else {}),
            **({"frames": dict(self.frames), "joints": dict(self.joints)} if self.frames else {}),
        }

    @classmethod
    def build(cls, data: Mapping[str, Any]) -> LinkRules:
        """Build rules from their description; MapError, TypeError or LookupError if it is malformed."""
        pairs = {(str(a), str(b)) if a < b else (str(b), str(a)): _flag(allowed) for a, b, allowed in data["pairs"]}
        return cls(
            {str(link): padding_of(f"the padding of {shown(link)}", by) for link, by in data["padding"].items()},
            {str(link): scale_of(f"the scale of {shown(link)}", by) for link, by in data["scale"].items()},
            pairs,
            {str(name): _flag(allowed) for name, allowed in data["others"].items()},
            tuple(map(_attached, data.get("attached", ()))),
            {str(name): str(frame) for name, frame in data.get("frames", {}).items()},
            {str(name): float(value) for name, value in data.get("joints", {}).items()},
        )


def _counted_names(strange: Sequence[str], kind: str, known: Iterable[str]) -> tuple[str, str]:
    """Return two texts: how many names are unknown, such as "2 links"; the first of them, with a similar known one."""
    listed = ", ".join(map(shown, strange[:MOST_NAMED])) + (", ..." if len(strange) > MOST_NAMED else "")
    hint = next(filter(None, (did_you_mean(name, known) for name in strange)), "")
    return counted(len(strange), kind), f"{listed}." + hint


def padding_of(what: str, given: Any) -> float:
    """Return the padding of a link, m, as a float; MapError, which calls it ``what``, for any other value."""
    return float(real(what, given, 0.0, WIDEST, "a length in m", error=MapError))


def scale_of(what: str, given: Any) -> float:
    """Return the scale of a link, a factor, as a float; MapError, which calls it ``what``, for any other value."""
    return float(real(what, given, LEAST, MOST, "a factor", error=MapError))


def _attached(given: Any) -> dict[str, Any]:
    if not isinstance(given, Mapping) or not all(isinstance(given.get(key), str) for key in ("name", "link")):
        raise MapError(f"an object attached to a link must be a mapping with name and link; got {shown(given)}.")
    return dict(given)


def _flag(given: Any) -> bool:
    if not isinstance(given, bool):
        raise MapError(f"whether two bodies may touch must be true or false; got {shown(given)}.")
    return given
