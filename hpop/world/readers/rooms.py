"""Rooms, walls and doors of floor plans: walls along lines and around rooms, opened at doors.

In indoor maps rooms share walls, and doors are points or lines. In drawings the swing of a door is an arc, which would
close an open passage if it were a wall.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.geometry.outlines import check_joinable, check_widenable
from hpop.world.geometry.shapes import check_positive
from hpop.world.readers.features import Feature, FeatureNotes, length, truth

WALL_WIDTH = 0.1
"""Default thickness of the walls of rooms, m."""
DOOR_WIDTH = 0.9
"""Assumed width of a door without a property ``width``, m."""
UNWALLED = frozenset({"area", "corridor", "level", "outline", "building_outline"})
"""Kinds of areas without walls of their own (OpenStreetMap, Simple Indoor Tagging)."""
SOLID = frozenset({"wall", "column", "pillar", "window"})
"""Kinds of features that are solid, not rooms."""
TOUCHING = 0.05
"""Least length of common outline, m, for rooms that touch."""
GRID = 1e-3
"""Distance, m, up to which outlines coincide."""
MOST_PAIRS = 5_000
"""Largest number of pairs of rooms whose outlines are compared."""
SHARPEST = 2.0
"""Largest distance of a corner of a widened line from the line, in half widths: sharp corners are cut off."""
DoorArcs = Literal["closed", "open"]
RADII = (0.4, 1.6)
"""Least and greatest width of a door leaf, m."""
SWEEPS = (math.radians(55), math.radians(125))
"""Least and greatest angle, rad, by which a door swings."""
ROUND = 0.01
"""Largest distance of the points of an arc from a circle, relative to its radius."""
POINTS = (5, 200)
"""Least and greatest number of points of an arc."""
LINES_AT_ONCE = 1_000
"""Lines that are examined between two checks of the limits."""
PLACES_TOLD = 3


class PlanRoom(NamedTuple):
    """Room of a floor plan: its feature and its area, m."""

    feature: Feature
    area: Polygon


class Door(NamedTuple):
    """Door of a floor plan, m: a point, a line or a polygon where walls are open."""

    feature: Feature
    place: BaseGeometry


def kind_of(feature: Feature) -> str:
    """Return the kind of a feature, such as "room" or "wall": its property ``indoor``, or else ``type``."""
    own = feature.properties
    return str(own.get("indoor", own.get("type", ""))).lower()


def is_door(feature: Feature) -> bool:
    """Return whether a feature is a door: its kind is "door", or it has a property door or entrance, not "no"."""
    own = feature.properties
    tagged = any(own.get(key) is not None and truth(own.get(key)) is not False for key in ("door", "entrance"))
    return tagged or kind_of(feature) == "door"


def walled(
    rooms: Sequence[PlanRoom], doors: Sequence[Door], lines: Sequence[BaseGeometry], width: float, notes: FeatureNotes
) -> tuple[BaseGeometry, list[Polygon]]:
    """Return the free space of rooms without their walls, m, and the polygons of the other walls, m.

    A wall of thickness ``width`` is centred on each outline of a room; ``lines`` are other walls. Areas such as
    corridors have no walls, so that they are connected. A door opens both kinds of walls over its width.
    """
    outlined = [room for room in rooms if kind_of(room.feature) not in UNWALLED]
    outlines = [room.area.boundary for room in outlined]
    for outline, room in zip(outlines, outlined, strict=True):
        check_widenable(outline, width / 2, str(room.feature))
    band = shapely.union_all(shapely.buffer(outlines, width / 2, join_style="mitre"))
    limits.check(READING)
    solid = shapely.union_all([band, *lines])
    openings = []
    for door in doors:
        opening = _opening(door, width, notes)
        if shapely.intersects(opening, solid):
            openings.append(opening)
        else:
            notes.add(door.feature, "a door that is at no wall, left out")
    opened = shapely.union_all(openings)
    check_joinable([band, opened, *(room.area for room in rooms)], str(rooms[0].feature.path))
    limits.check(READING)
    thresholds = [door.place for door in doors if isinstance(door.place, Polygon)]
    inner = shapely.union_all([*(room.area for room in rooms), *thresholds, shapely.intersection(opened, band)])
    free = shapely.difference(inner, shapely.difference(band, opened))
    return free, [part for line in lines for part in _polygons(shapely.difference(line, opened))]


def _opening(door: Door, width: float, notes: FeatureNotes) -> BaseGeometry:
    """Return the opening of a door in a wall, m: a disc round a point, a strip along a line, or the door's area."""
    if isinstance(door.place, Polygon):
        return door.place
    if door.place.length > 0:
        return shapely.buffer(door.place, width, cap_style="flat")
    own = door.feature.properties.get("width", door.feature.properties.get("door:width"))
    across = length(own)
    if across is None or not 0 < across <= 1e3:
        said = "without" if own is None else "of no readable"
        notes.add(door.feature, f"a door {said} width, {DOOR_WIDTH:g} m wide")
        across = DOOR_WIDTH
    return shapely.buffer(door.place, float(np.hypot(across, width)) / 2)


def _polygons(geometry: BaseGeometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(geometry).tolist() if isinstance(part, Polygon) and part.area > 0]


def touching(rooms: Sequence[PlanRoom]) -> tuple[PlanRoom, PlanRoom] | None:
    """Return two rooms whose outlines share a part, or None; at most `MOST_PAIRS` pairs are compared."""
    areas = np.array([room.area for room in rooms], dtype=object)
    tree = shapely.STRtree(areas)
    looked = 0
    for i in range(len(areas)):
        limits.check(READING)
        near = tree.query(areas[i])
        for j in near[near > i].tolist():
            shared = shapely.intersection(areas[i].boundary, areas[j].boundary, grid_size=GRID)
            if shared.length > TOUCHING:
                return rooms[i], rooms[j]
            looked += 1
            if looked >= MOST_PAIRS:
                return None
    return None


def check_width(width: Any) -> float | None:
    """Return the thickness of walls, m, or None; `MapError` if it is no length."""
    return None if width is None else check_positive("wall_width", width)


def walls(line: LineString, width: float, what: str) -> list[Polygon]:
    """Return the wall of thickness ``width`` (m) along a line; ends are square, so that walls meet without a notch.

    >>> [wall.bounds for wall in walls(LineString([(0, 0), (4, 0)]), 0.5, "the line")]
    [(-0.25, -0.25, 4.25, 0.25)]
    """
    if line.length == 0:
        return []
    check_widenable(line, width / 2, what)
    return widened(np.array([line]), width)


def widened(lines: NDArray[np.object_], width: float, cap: Literal["square", "flat"] = "square") -> list[Polygon]:
    """Return the walls of thickness ``width`` (m) along lines (n,): the polygons of all lines, in one list.

    ``cap`` is the shape of the ends. Lines are not checked here: call `check_widenable` first for a line that may be
    long and close to itself.
    """
    strips = shapely.buffer(lines, width / 2, cap_style=cap, join_style="mitre", mitre_limit=SHARPEST)
    parts: NDArray[np.object_] = shapely.get_parts(strips)
    return [part for part in parts.tolist() if isinstance(part, Polygon) and part.area > 0]


class Arc(NamedTuple):
    """Swing of a door, drawn as an arc that is a part of a line.

    line         index of the line
    first, last  indices of the first and the last point of the arc among all points
    radius       m, the width of the door
    middle       (x, y), m, point in the middle of the arc
    """

    line: int
    first: int
    last: int
    radius: float
    middle: tuple[float, float]


def door_arcs(points: FloatArray, starts: IntArray, lines: IntArray) -> Iterator[Arc]:
    """Yield the arcs that look like door swings, at most one for each of the lines with the numbers ``lines``.

    Line i has the points ``points[starts[i]:starts[i + 1]]``, m. It may also include the leaf of the door: one point
    more at either end or at both.
    """
    sizes = starts[lines + 1] - starts[lines]
    for number, line in enumerate(lines[(sizes >= POINTS[0]) & (sizes <= POINTS[1])].tolist()):
        if number % LINES_AT_ONCE == 0:
            limits.check(READING)
        begin, end = int(starts[line]), int(starts[line + 1])
        for first, last in ((begin, end), (begin + 1, end), (begin, end - 1), (begin + 1, end - 1)):
            radius = _radius(points[first:last])
            if radius is not None:
                x, y = points[(first + last) // 2].tolist()
                yield Arc(line, first, last - 1, radius, (x, y))
                break


def _radius(arc: FloatArray) -> float | None:
    """Return the radius, m, of the arc through points (n, 2) if it can be the swing of a door, else None."""
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


def said_of_doors(arcs: list[Arc], treated: DoorArcs) -> str:
    """Return a note on the arcs of door swings: number, widths, positions, and by ``treated`` if they are left out."""
    examples = ", ".join(f"({arc.middle[0]:.2f}, {arc.middle[1]:.2f})" for arc in arcs[:PLACES_TOLD])
    radii = sorted(arc.radius for arc in arcs)
    size = f"{radii[0]:.2g}" if radii[-1] - radii[0] < 0.01 else f"{radii[0]:.2g} to {radii[-1]:.2g}"
    what = f"{len(arcs):,} arcs look like the swing of a door, {size} m wide, such as at {examples}"
    if treated == "open":
        return f"{what}: they are left out"
    return f"{what}, and close passages; to leave them out, give door_arcs: open"
