"""Reader for GeoJSON (RFC 7946) floor plans: polygons as obstacles, or as the free space between them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon, shape
from shapely.geometry.base import BaseGeometry

from hpop import limits
from hpop.arrays import BoolArray
from hpop.errors import MapError
from hpop.limits import READING
from hpop.options import one_of
from hpop.text import shown
from hpop.world.crossings import check_each_joinable, check_joinable, check_mendable
from hpop.world.features import Feature, FeatureNotes
from hpop.world.files import file_source, read_bytes, read_text
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.placement import Placement, Units
from hpop.world.shapes import Obstacle, check_heights
from hpop.world.walls import check_width, walls
from hpop.world.world import World

Meaning = Literal["obstacles", "free", "outline"]
POINTS, LINES = ("Point", "MultiPoint"), ("LineString", "MultiLineString")
POLYGONS = ("Polygon", "MultiPolygon")
GEOMETRIES = (*POINTS, *LINES, *POLYGONS)
AREAS = (shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON)
WORDS: dict[tuple[str, ...], str] = {POINTS: "point", LINES: "line", POLYGONS: "polygon"}
WORDS[POLYGONS + LINES] = "polygon or line"
BLOCK = 1_000
"""Features that are read between two looks at the limits, or objects of JSON: hundredths of a second."""
STAYS, PARSED = 6, 24
"""Bytes for each of a file: of geometries, and of Python's objects while it is read."""


def read(
    path: str | Path,
    *,
    scale: float = 1.0,
    origin: tuple[float, float] | None = None,
    polygons: Meaning = "obstacles",
    units: Units | None = None,
    wall_width: float | None = None,
) -> World:
    """Read the polygons and lines of a GeoJSON file as a `World`.

    Parameters
    ----------
    path : path of the file
    scale : float
        Metres per unit of the file. EPSG:3857 stretches lengths: its scale is cos(latitude).
    origin : (x, y)
        The file's point that becomes (0, 0), in its units; projected coordinates are millions of metres otherwise.
        Without it, (0, 0) stays where it is, and of degrees it is the plan's south-west corner.
    polygons : "obstacles", "free" or "outline"
        What a polygon stands for. *obstacles*: the extent is their bounding box. *free*: the robot must stay
        in their union, and all beyond is obstacle to the camera. *outline*: the same for the largest polygon;
        every other is an obstacle: a building and its columns.
    units : "m" or "deg", optional
        Degrees of longitude and latitude (RFC 7946: geojson.io, QGIS) are put on a plane that touches the earth at
        the origin, x east and y north, on which lengths are right to 0.02 %. Without ``units`` a file is in degrees if
        all of it lies within 180 and 90 and spans less than 0.1 each way, and no ``scale`` is given.
    wall_width : float, optional
        Thickness of walls, m: lines are walls, as thick as that. Without it lines are left out.

    An obstacle's property ``height`` is the number of metres from the floor, or a pair [z_min, z_max]; it has
    the whole height without. What is left out or mended is told in ``world.notes``: features without
    geometry, properties, or polygons, and self-crossing outlines; and how degrees became metres.

    Raises
    ------
    MapError
        If the file is missing or no GeoJSON, has no polygons, mixes degrees with metres, or a polygon or height makes
        no sense.
    """
    one_of("polygons", polygons, get_args(Meaning), error=MapError)
    placement, wall_width = Placement(scale, origin, units), check_width(wall_width)
    content = read_bytes(path, "GeoJSON file")
    noted = FeatureNotes()
    of, shapes = shaped(content, path, POLYGONS if wall_width is None else POLYGONS + LINES, noted)
    placement = placement.settled(of, shapes)
    areas: list[_Part] = []
    lines: list[_Part] = []
    for feature, parts in placed(of, shapes, placement, noted):
        heights = _heights(feature, noted)
        for part in parts:
            if isinstance(part, Polygon):
                areas.append(_Part(feature, part, heights))
            elif wall_width is not None:
                lines += [_Part(feature, wall, heights) for wall in walls(part, wall_width, str(feature))]
    hint = (f"{path}: wall_width: 0.1 makes walls of its lines, 0.1 m thick.",) * any(
        _left_out(kind, POLYGONS) in noted for kind in LINES
    )
    if not areas and (polygons != "obstacles" or not lines):
        what = "polygon" if wall_width is None or polygons != "obstacles" else "polygon or line"
        raise MapError(f"{path} has no {what}: nothing to make a world of. {' '.join((*noted.lines(), *hint))}")
    options = {
        "scale": placement.scale,
        "origin": list(placement.origin or (0.0, 0.0)),
        "polygons": polygons,
        "units": placement.units,
        "wall_width": wall_width,
    }
    source = file_source("geojson", path, options, content)
    notes = (*placement.note(path), *noted.lines(), *hint)
    if polygons == "obstacles":
        notes += tuple(_closing(areas, lines, wall_width or 0.0))
        return World(Ground(tuple(part.obstacle for part in areas + lines)), notes=notes).read_from(source)
    free = areas if polygons == "free" else [max(areas, key=lambda part: part.area.area)]
    check_joinable([part.area for part in free], str(path))
    solid = [part for part in areas + lines if all(part is not other for other in free)]
    ground = Ground(
        tuple(part.obstacle for part in solid),
        extent=shapely.union_all([part.area for part in free]),
        outside_is_obstacle=True,
    )
    return World(ground, notes=notes).read_from(source)


class _Part(NamedTuple):
    """A polygon, m, of a feature, and its heights."""

    feature: Feature
    area: Polygon
    heights: Heights

    @property
    def obstacle(self) -> Obstacle:
        return Obstacle(self.area, *self.heights, name=self.feature.name)


def _closing(areas: Sequence[_Part], lines: Sequence[_Part], width: float) -> Iterator[str]:
    """Say of an obstacle that everything else lies in it, as in the outline of a building."""
    if not areas:
        return
    largest = max(areas, key=lambda part: part.area.area)
    others = [part.area for part in (*areas, *lines) if part is not largest]
    within = shapely.buffer(largest.area, width, join_style="mitre")  # walls stand on the outline
    if len(largest.area.interiors) == 0 and shapely.covers(within, others).all():
        what = "contains all else" if others else "is all that is there"
        yield (
            f"{largest.feature} {what}, and is an obstacle: the robot has no room in it. If it is the outline of the "
            "building, say polygons: outline."
        )


def _parse(text: str, path: str | Path) -> Any:
    count = 0

    def look(parsed: Any) -> Any:
        nonlocal count
        count += 1
        if count % BLOCK == 0:
            limits.check(READING)
        return parsed

    try:
        return json.loads(text, object_hook=look)
    except (ValueError, RecursionError) as error:
        raise MapError(f"{path} is not JSON: {error}.") from None


def features(content: bytes, path: str | Path) -> Iterator[Feature]:
    """Yield the features of a file that holds a FeatureCollection, a Feature, or a bare geometry."""
    limits.hold(READING, STAYS * len(content), PARSED * len(content))
    data = _parse(read_text(content, path, "GeoJSON file"), path)
    kind = data.get("type") if isinstance(data, dict) else None
    if kind == "FeatureCollection":
        found = data.get("features")
        if not isinstance(found, list):
            raise MapError(f"{path}: a FeatureCollection must have a list of features; got {shown(found)}.")
    elif kind == "Feature":
        found = [data]
    elif isinstance(kind, str) and kind in GEOMETRIES:
        found = [{"type": "Feature", "properties": {}, "geometry": data}]
    else:
        got = f"type {shown(kind)}" if isinstance(data, dict) else shown(data)
        raise MapError(f"{path} must hold a GeoJSON FeatureCollection, Feature or geometry; got {got}.")
    for number, data in enumerate(found):
        if not isinstance(data, dict):
            raise MapError(f"{path}: feature {number} must be an object; got {shown(data)}.")
        yield Feature(path, number, data)


def shaped(
    content: bytes, path: str | Path, kinds: tuple[str, ...], notes: FeatureNotes
) -> tuple[list[Feature], NDArray[np.object_]]:
    """The features of some kinds and their geometries (n,), in the file's units; what is left out is noted."""
    of: list[Feature] = []
    shapes: list[BaseGeometry] = []
    rest = features(content, path)
    while block := list(islice(rest, BLOCK)):
        limits.check(READING)
        for feature in block:
            if (found := _shaped(feature, kinds, notes)) is not None:
                of.append(feature)
                shapes.append(found)
    return of, np.array(shapes, dtype=object)


def placed(
    of: Sequence[Feature], shapes: NDArray[np.object_], placement: Placement, notes: FeatureNotes
) -> Iterator[tuple[Feature, list[Any]]]:
    """Yield features, each with the parts of its geometry, m; what is mended is noted.

    In blocks, between which the limits are looked at. Polygons are valid, and a self-crossing outline is mended;
    `MapError` for one that crosses itself so often that to mend it would take for ever.
    """
    for begin in range(0, len(of), BLOCK):
        limits.check(READING)
        some = of[begin : begin + BLOCK]
        there = placement.place(shapes[begin : begin + BLOCK])
        areas = np.isin(shapely.get_type_id(there), AREAS)
        there = _mended(some, there, areas, notes)
        parts, owner = shapely.get_parts(there, return_index=True)
        parts, outer = shapely.get_parts(parts, return_index=True)  # what was mended may be nested
        owner = owner[outer]
        kept = ~areas[owner] | (np.isin(shapely.get_type_id(parts), AREAS) & (shapely.area(parts) > 0))
        parts, owner = parts[kept], owner[kept]
        ends = np.searchsorted(owner, np.arange(len(some) + 1)).tolist()
        yield from ((each, parts[ends[i] : ends[i + 1]].tolist()) for i, each in enumerate(some))


def _left_out(kind: Any, kinds: tuple[str, ...]) -> str:
    return f"a {shown(kind)}, not a {WORDS[kinds]}, left out"


def _shaped(feature: Feature, kinds: tuple[str, ...], notes: FeatureNotes) -> BaseGeometry | None:
    """A feature's geometry, in the file's units; None, and a note, unless it is one of the kinds."""
    data = feature.data.get("geometry")
    if data is None:
        notes.add(feature, "no geometry, left out")
        return None
    kind = data.get("type") if isinstance(data, dict) else None
    if kind not in kinds:
        notes.add(feature, _left_out(kind, kinds))
        return None
    try:
        with np.errstate(invalid="ignore"):
            geometry = shape(data)
    except Exception as error:  # shapely passes on whatever the coordinates provoke
        raise MapError(f"{feature}: its coordinates make no {kind}: {error!s:.200}.") from None
    if geometry.is_empty:
        notes.add(feature, f"an empty {kind}, left out")
        return None
    return geometry


def _mended(
    of: Sequence[Feature], shapes: NDArray[np.object_], areas: BoolArray, notes: FeatureNotes
) -> NDArray[np.object_]:
    """Geometries of features, those among the areas made valid that were not."""
    check_each_joinable(shapes[areas], [each for each, area in zip(of, areas, strict=True) if area])
    for i in np.flatnonzero(areas & ~shapely.is_valid(shapes)).tolist():
        limits.check(READING)
        reason, *_ = shapely.is_valid_reason(shapes[i]).split("[")  # less where, which no other feature shares
        notes.add(of[i], f"no valid polygon ({reason}), mended")
        check_mendable(shapes[i], str(of[i]))
        shapes[i] = shapely.make_valid(shapes[i])
    return shapes


def _heights(feature: Feature, notes: FeatureNotes) -> Heights:
    properties = feature.data.get("properties")
    if not isinstance(properties, dict):
        notes.add(feature, "no properties, so of the whole height")
        return WHOLE
    height = properties.get("height")
    if height is None:
        return WHOLE
    if isinstance(height, int | float) and not isinstance(height, bool):
        height = (0.0, height)
    try:
        return check_heights(height)
    except MapError as error:
        raise MapError(f"{feature}: property height must be a number or [z_min, z_max]: {error}") from None
