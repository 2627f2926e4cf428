"""Reader for floor plans in GeoJSON (RFC 7946): polygons are obstacles, or the free space between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from hpop.base.options import MOST, one_of
from hpop.base.text import counted, printable, shown
from hpop.errors import MapError
from hpop.world.files import file_source, read_bytes
from hpop.world.geometry.outlines import check_joinable
from hpop.world.geometry.shapes import Obstacle, check_heights
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.readers import placement as systems
from hpop.world.readers.features import Feature, FeatureFilter, FeatureNotes, chosen_features, length, notes_of_levels
from hpop.world.readers.geojson_document import (
    LINES,
    POINTS,
    POLYGONS,
    GeoJsonDocument,
    left_out,
    placed,
    read_document,
    shaped,
)
from hpop.world.readers.placement import Placement, Units
from hpop.world.readers.rooms import (
    SOLID,
    WALL_WIDTH,
    Door,
    PlanRoom,
    check_width,
    is_door,
    kind_of,
    touching,
    walled,
    walls,
)
from hpop.world.world import World

HEIGHTS = ("min_height", "height")
"""Properties that state the lower and upper end of an obstacle, m."""
ESTIMATED = "est_height"
"""OpenStreetMap's estimate of a height, for features without ``height``."""
FLOORS = ("building:levels", "building:min_level")
"""Numbers of floors in OpenStreetMap, which are no heights."""
Meaning = Literal["obstacles", "free", "outline", "rooms"]
FAR = 100_000.0
"""Size, m, above which coordinates come from a map projection, not from a plan with its origin in the building."""


def read(
    path: str | Path,
    *,
    scale: float = 1.0,
    origin: tuple[float, float] | None = None,
    polygons: Meaning = "obstacles",
    units: Units | None = None,
    wall_width: float | None = None,
    crs: str | None = None,
    where: Mapping[str, Any] | None = None,
) -> World:
    """Read the polygons and lines of a GeoJSON file as a `World`.

    Parameters
    ----------
    path : path of the file
        A FeatureCollection, a Feature, a geometry, or several of them one a line (GeoJSONSeq, RFC 8142).
    scale : float
        Metres per unit of the file. EPSG:3857 stretches lengths: its scale is cos(latitude).
    origin : (x, y)
        The file's point that becomes (0, 0), in its units; projected coordinates are millions of metres otherwise.
        By default (0, 0) stays; for degrees or a ``crs`` the default is the south-west corner of the plan.
    polygons : "obstacles", "free", "outline" or "rooms"
        Meaning of a polygon. *obstacles*: the extent is their bounding box. *free*: the robot must stay in their union,
        and everything beyond obstructs the camera. *outline*: the largest polygon is free, such as a building, and the
        others are obstacles, such as columns. *rooms*: as *free*, with walls along the outlines of rooms, opened by
        points and lines with a property ``door`` or ``entrance``.
    units : "m" or "deg", optional
        Degrees of longitude and latitude (RFC 7946: geojson.io, QGIS) are put on a plane that touches the earth at
        the origin, x east and y north, on which lengths are right to 0.02 %. Without ``units`` a file is in degrees if
        all of it lies within 180 and 90 and spans less than 0.1 each way, and no ``scale`` is given.
    wall_width : float, optional
        Thickness of walls along lines, m. Without it lines are left out, and the walls of rooms are 0.1 m thick.
    crs : str, optional
        Coordinate system, such as "EPSG:3857"; default: the file's member ``crs``, unless scale or units are given.
        Coordinates are projected to a plane as degrees are. Needs pyproj (extra ``plans``).
    where : mapping, optional
        Properties that a feature must have, each with a value or several: ``{"indoor": "room", "level": [0, 1]}``.
        Text and numbers are compared as text; "0;1" in a feature means both values, and a level "0-2" all three.
        Doors are chosen by their level alone.

    An obstacle's property ``height`` is its height above the floor, m, also as text ("3", "12 ft"), or a pair [z_min,
    z_max]; ``min_height`` is its lower end, and ``est_height`` stands for a missing height. Without a readable height
    above 0 it is unlimited. Its property ``contrast``, 0 to 1, weights its optic flow. ``world.notes`` tell what was
    left out or mended, such as features without geometry and self-crossing or open outlines; how degrees became metres;
    and which rooms touch, so that they are one.

    Raises
    ------
    MapError
        If the file is missing or no GeoJSON, has no polygons, mixes degrees with metres, is in an unknown crs, or has
        an invalid polygon or pair of heights.
    """
    one_of("polygons", polygons, get_args(Meaning), error=MapError)
    given = Placement(scale, origin, units)
    width = check_width(wall_width)
    chosen = FeatureFilter(where)
    if crs is not None and (units is not None or given.scale != 1.0):
        raise MapError(f"crs {shown(crs)} already states the unit of the coordinates; leave out scale and units.")
    content = read_bytes(path, "GeoJSON file")
    document = read_document(content, path)
    noted = FeatureNotes()
    are_rooms = polygons == "rooms"
    width = width or (WALL_WIDTH if are_rooms else None)
    kinds = POLYGONS if width is None else POLYGONS + LINES
    features, said = chosen_features(document.features, chosen, path, by_level=is_door if are_rooms else None)
    of, shapes = _shapes(features, kinds, noted, doors=are_rooms)
    placement, shapes, options = _placed_by(given, crs, document, of, shapes, path)
    plan = _Plan([], [], [])
    for feature, parts in placed(of, shapes, placement, noted, rooms=are_rooms):
        plan.add(feature, parts, width if width is not None else 0.0, noted, doors=are_rooms)
    hint = (f"{path}: wall_width: 0.1 makes walls of its lines, 0.1 m thick.",) * any(
        left_out(kind, POLYGONS) in noted for kind in LINES
    )
    areas, lines = plan.areas, plan.lines
    if not areas and (polygons != "obstacles" or not lines):
        what = "polygon" if width is None or polygons != "obstacles" else "polygon or line"
        raise MapError(
            f"{path} has no {what} to build a world from. {' '.join((*document.notes, *noted.lines(), *hint))}"
        )
    options |= {"polygons": polygons, "wall_width": wall_width if wall_width is None else width}
    options |= {"where": chosen.given} if chosen else {}
    source = file_source("geojson", path, options, content)
    ground, more = _ground(plan, polygons, width, noted, path)
    notes = (*document.notes, *placement.note(path, options.get("crs")), *said)
    if given.units is None and crs is None and options["scale"] == 1.0 and placement.units == "m":
        notes += _in_metres(document.crs, shapes, path)
    notes += (*noted.lines(), *hint, *more, *notes_of_levels(of, chosen, path))
    return World(ground, notes=notes).read_from(source)


def _ground(
    plan: _Plan, polygons: Meaning, width: float | None, noted: FeatureNotes, path: str | Path
) -> tuple[Ground, list[str]]:
    """Return the obstacles and the extent of a plan, and notes (warnings to print).

    ``polygons`` states whether the polygons of the plan are obstacles, free space, an outline or rooms.
    """
    areas, lines = plan.areas, plan.lines
    if polygons == "obstacles":
        notes = [*_closing(areas, lines, width or 0.0)]
        return Ground(tuple(part.obstacle for part in areas + lines)), notes
    if polygons == "rooms":
        check_joinable([part.area for part in areas], str(path))
        rooms = [PlanRoom(part.feature, part.area) for part in areas if kind_of(part.feature) not in SOLID]
        if not rooms:
            raise MapError(
                f"{path}: polygons: rooms needs a polygon that is a room, but all are walls or columns. Give "
                "polygons: obstacles."
            )
        walls_of = [part.area for part in (*lines, *(each for each in areas if kind_of(each.feature) in SOLID))]
        free, solid = walled(rooms, plan.doors, walls_of, width or WALL_WIDTH, noted)
        size = f"{counted(len(rooms), 'room')} with walls {width or WALL_WIDTH:g} m thick"
        notes = [f"{path}: {size} and {counted(len(plan.doors), 'door')}."]
        if not plan.doors:
            notes = [f"{notes[0]} For a door, add a point with a property door on a wall."]
        return Ground(tuple(Obstacle(part) for part in solid), extent=free, outside_is_obstacle=True), notes
    free_parts = areas if polygons == "free" else [max(areas, key=lambda part: part.area.area)]
    check_joinable([part.area for part in free_parts], str(path))
    joined = touching([PlanRoom(part.feature, part.area) for part in free_parts]) if polygons == "free" else None
    notes = []
    if joined is not None:
        first, second = (each.feature.called for each in joined)
        notes = [
            f"{path}: polygons that touch, such as features {first} and {second}, are one free space without a wall "
            "between them. For walls there, in which points can be doors, give polygons: rooms."
        ]
    inner = [part for part in areas + lines if all(part is not other for other in free_parts)]
    extent = shapely.union_all([part.area for part in free_parts])
    return Ground(tuple(part.obstacle for part in inner), extent=extent, outside_is_obstacle=True), notes


def _shapes(
    features: Sequence[Feature], kinds: tuple[str, ...], noted: FeatureNotes, *, doors: bool
) -> tuple[list[Feature], NDArray[np.object_]]:
    """Return geometries of the given kinds with their features; with ``doors``, also all doors, which come last."""
    if not doors:
        return shaped(features, kinds, noted)
    opening = [feature for feature in features if is_door(feature)]
    others = [feature for feature in features if not is_door(feature)]
    of, shapes = shaped(others, kinds, noted)
    of_doors, shapes_of_doors = shaped(opening, POLYGONS + LINES + POINTS, noted)
    return of + of_doors, np.concatenate([shapes, shapes_of_doors])


def _placed_by(
    given: Placement,
    crs: str | None,
    document: GeoJsonDocument,
    of: Sequence[Feature],
    shapes: NDArray[np.object_],
    path: str | Path,
) -> tuple[Placement, NDArray[np.object_], dict[str, Any]]:
    """Determine how coordinates become metres.

    The option ``crs`` decides. Without it, units or a scale in ``given`` decide; without these, the document's crs; and
    without that, whether the coordinates look like degrees.

    Return the conversion, the geometries in the units that it expects, and the options to be saved with the world.
    """
    is_open = given.units is None and given.scale == 1.0
    system = systems.crs_of(crs) if crs is not None else document.crs if is_open else None
    if system is None or system == systems.DEGREES:
        units: Units | None = "deg" if crs is not None else given.units
        settled = Placement(given.scale, given.origin, units).settled(of, shapes)
        return (
            settled,
            shapes,
            {"scale": settled.scale, "origin": list(settled.origin or (0.0, 0.0)), "units": settled.units},
        )
    points = shapely.get_coordinates(shapes)
    if not len(points):
        return given.settled(of, shapes), shapes, {"scale": 1.0}
    Placement(1.0, None, "m").settled(of, shapes)  # finite
    origin = given.origin or (float(points[:, 0].min()), float(points[:, 1].min()))
    ((x, y),) = systems.degrees_of(np.array([origin]), system, path).tolist()
    shapes = systems.on_earth(shapes, system, path)
    placement = Placement(1.0, (x, y), "deg").settled(of, shapes)
    return placement, shapes, {"scale": 1.0, "origin": list(origin), "units": None, "crs": system}


class _FeaturePolygon(NamedTuple):
    """Polygon of a feature, m, with its heights."""

    feature: Feature
    area: Polygon
    heights: Heights

    @property
    def obstacle(self) -> Obstacle:
        properties = self.feature.data.get("properties") or {}
        contrast = properties.get("contrast") if isinstance(properties, dict) else None
        try:
            return Obstacle(
                self.area, *self.heights, name=self.feature.name, contrast=1.0 if contrast is None else contrast
            )
        except MapError as error:
            raise MapError(f"{self.feature}: {error}") from None


def _in_metres(declared: str | None, shapes: NDArray[np.object_], path: str | Path) -> tuple[str, ...]:
    """Return a note if coordinates are read as metres although their crs, or their size, suggests another unit."""
    x0, y0, x1, y1 = shapely.total_bounds(shapes)
    if declared is not None:
        return (
            f"{path}: its crs ({declared}) says degrees, but it spans {x1 - x0:.4g} x {y1 - y0:.4g} at ({x0:.6g}, "
            f"{y0:.6g}), so it is read as metres. Give units: m or units: deg to say which is right.",
        )
    if max(abs(x0), abs(y0), abs(x1), abs(y1)) > FAR:
        return (
            f"{path}: its coordinates, such as ({x0:.9g}, {y0:.9g}), are those of a projection, and are read as metres."
            " If they are metres, give units: m. Otherwise name the projection, such as crs: EPSG:3857.",
        )
    return ()


def _closing(areas: Sequence[_FeaturePolygon], lines: Sequence[_FeaturePolygon], width: float) -> Iterator[str]:
    """Yield a note if one obstacle encloses all others: it may be the outline of the building."""
    if not areas:
        return
    largest = max(areas, key=lambda part: part.area.area)
    others = [part.area for part in (*areas, *lines) if part is not largest]
    within = shapely.buffer(largest.area, width, join_style="mitre")  # walls stand on the outline
    if len(largest.area.interiors) == 0 and shapely.covers(within, others).all():
        what = "contains all else" if others else "is all that is there"
        yield (
            f"{largest.feature} {what}, and is an obstacle: the robot has no room in it. If it is the outline of the "
            "building, give polygons: outline."
        )


class _Plan(NamedTuple):
    """Contents of a floor plan, m: polygons, walls along lines, and doors."""

    areas: list[_FeaturePolygon]
    lines: list[_FeaturePolygon]
    doors: list[Door]

    def add(self, feature: Feature, parts: Sequence[Any], width: float, notes: FeatureNotes, *, doors: bool) -> None:
        """Add the geometries ``parts`` of a feature, m: polygons as areas, lines as walls of thickness ``width``, m.

        With ``doors``, the geometries of a door are added as doors instead.
        """
        if doors and is_door(feature):
            self.doors.extend(Door(feature, part) for part in parts)
            return
        heights = _heights(feature, notes)
        for part in parts:
            if isinstance(part, Polygon):
                self.areas.append(_FeaturePolygon(feature, part, heights))
            else:
                self.lines.extend(_FeaturePolygon(feature, wall, heights) for wall in walls(part, width, str(feature)))


def _heights(feature: Feature, notes: FeatureNotes) -> Heights:
    """Return the heights (z_min, z_max) of a feature, m.

    A missing lower end is 0 if there is an upper end; a missing upper end is unlimited. Both ends are unlimited, with a
    note, if a height cannot be read.
    """
    properties = feature.data.get("properties")
    if not isinstance(properties, dict):
        notes.add(feature, "no properties, so of unlimited height")
        return WHOLE
    given = properties.get("height")
    if isinstance(given, list):
        try:
            return check_heights(given)
        except MapError as error:
            raise MapError(f"{feature}: property height must be a number or [z_min, z_max]: {error}") from None
    for name, value in properties.items():
        if name not in HEIGHTS and name.lower() in HEIGHTS and value is not None:
            notes.add(feature, f"{printable(name)} {shown(value)} is not read: name it {name.lower()}")
    upper = "height"
    if given is None:
        if any(properties.get(key) is not None for key in FLOORS):
            notes.add(feature, f"{' and '.join(FLOORS)} are numbers of floors, not read; give height in m")
        if properties.get(ESTIMATED) is not None:
            upper, given = ESTIMATED, properties[ESTIMATED]
            notes.add(feature, f"{ESTIMATED} is read as its height")
    low, high = (_in_bounds(length(properties.get(key))) for key in ("min_height", upper))
    if given is None and properties.get("min_height") is None:
        return WHOLE
    if (given is not None and (high is None or high <= 0)) or (
        low is None and properties.get("min_height") is not None
    ):
        what = {key: properties[key] for key in (upper, "min_height") if properties.get(key) is not None}
        said = ", ".join(f"{key} {shown(value)}" for key, value in what.items())
        notes.add(feature, f"{said}, which is no height above 0 in m, so of unlimited height")
        return WHOLE
    z_min = low if low is not None else 0.0 if high is not None else WHOLE[0]
    z_max = WHOLE[1] if high is None else high
    if not z_min < z_max:
        notes.add(feature, f"min_height {z_min:g} is not below height {z_max:g}, so of unlimited height")
        return WHOLE
    return check_heights((z_min, z_max))


def _in_bounds(height: float | None) -> float | None:
    """Return a height, m; None if it is None, or more than `MOST` m from the floor."""
    return height if height is not None and abs(height) <= MOST else None
