"""Reader for GeoJSON (RFC 7946) floor plans: polygons as obstacles, or as the free space between them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon, shape
from shapely.geometry.base import BaseGeometry

from hpop.errors import MapError
from hpop.options import FARTHEST, one_of
from hpop.text import shown
from hpop.world import limits
from hpop.world.crossings import check_each_joinable, check_joinable, check_mendable
from hpop.world.features import Feature, FeatureNotes
from hpop.world.files import file_source, read_bytes, read_text
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.limits import READING
from hpop.world.shapes import Obstacle, check_coordinates, check_heights, check_positive
from hpop.world.world import World

Meaning = Literal["obstacles", "free", "outline"]
POINTS, LINES = ("Point", "MultiPoint"), ("LineString", "MultiLineString")
POLYGONS = ("Polygon", "MultiPolygon")
GEOMETRIES = (*POINTS, *LINES, *POLYGONS)
FARTHEST_UNIT = 1000 * FARTHEST
"""Greatest coordinate of a file, in its units, which may be millimetres."""
WORDS: dict[tuple[str, ...], str] = {POINTS: "point", LINES: "line", POLYGONS: "polygon"}
BLOCK = 1_000
"""Features that are read between two looks at the limits, or objects of JSON: hundredths of a second."""
STAYS, PARSED = 6, 24
"""Bytes for each of a file: of geometries, and of Python's objects while it is read."""


class Placement(NamedTuple):
    """Where a file lies in the world: metres per unit, and its point that becomes (0, 0)."""

    scale: float
    origin: tuple[float, float]


def read(
    path: str | Path,
    *,
    scale: float = 1.0,
    origin: tuple[float, float] = (0.0, 0.0),
    polygons: Meaning = "obstacles",
) -> World:
    """Read the polygons of a GeoJSON file as a `World`.

    Parameters
    ----------
    path : path of the file
    scale : float
        Metres per unit of the file. EPSG:3857 stretches lengths: its scale is cos(latitude).
    origin : (x, y)
        The file's point that becomes (0, 0); projected coordinates are millions of metres otherwise.
    polygons : "obstacles", "free" or "outline"
        What a polygon stands for. *obstacles*: the extent is their bounding box. *free*: the robot must stay
        in their union, and all beyond is obstacle to the camera. *outline*: the same for the largest polygon;
        every other is an obstacle: a building and its columns.

    An obstacle's property ``height`` is the number of metres from the floor, or a pair [z_min, z_max]; it has
    the whole height without. What is left out or mended is told in ``world.notes``: features without
    geometry, properties, or polygons, and self-crossing outlines.

    Raises
    ------
    MapError
        If the file is missing or no GeoJSON, has no polygons, or a polygon or height makes no sense.
    """
    one_of("polygons", polygons, get_args(Meaning), error=MapError)
    scale = check_positive("scale", scale)
    x0, y0 = check_origin(origin)
    content = read_bytes(path, "GeoJSON file")
    noted = FeatureNotes()
    shapes: list[tuple[Polygon, Heights]] = []
    for feature, parts in geometries(content, path, POLYGONS, Placement(scale, (x0, y0)), noted):
        heights = _heights(feature, noted)
        shapes += [(part, heights) for part in parts]
    notes = noted.lines()
    if not shapes:
        raise MapError(f"{path} has no polygon: nothing to make a world of. {' '.join(notes)}")
    source = file_source("geojson", path, {"scale": scale, "origin": [x0, y0], "polygons": polygons}, content)
    if polygons == "obstacles":
        return World(Ground(tuple(Obstacle(p, *z) for p, z in shapes)), notes=notes).read_from(source)
    free = shapes
    if polygons == "outline":
        free = [max(shapes, key=lambda part: part[0].area)]
    check_joinable([p for p, _ in free], str(path))
    ground = Ground(
        tuple(Obstacle(p, *z) for p, z in shapes if all(p is not q for q, _ in free)),
        extent=shapely.union_all([p for p, _ in free]),
        outside_is_obstacle=True,
    )
    return World(ground, notes=notes).read_from(source)


def check_origin(origin: Any) -> tuple[float, float]:
    """The file's point that becomes (0, 0), as two finite floats, or `MapError`."""
    try:
        x, y = (float(value) for value in origin)
    except (TypeError, ValueError, OverflowError):
        x = y = math.nan
    if not (abs(x) <= FARTHEST_UNIT and abs(y) <= FARTHEST_UNIT):
        raise MapError(
            f"origin must be two finite numbers (x, y) in the file's units, at most {FARTHEST_UNIT:,.0f}; got "
            f"{shown(origin)}."
        )
    return x, y


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
        feature = Feature(path, number, data)
        if not isinstance(data, dict):
            raise MapError(f"{feature} must be an object; got {shown(data)}.")
        yield feature


def geometries(
    content: bytes, path: str | Path, kinds: tuple[str, ...], placement: Placement, notes: FeatureNotes
) -> Iterator[tuple[Feature, list[Any]]]:
    """Yield the features of some kinds, each with the parts of its geometry, m; what is left out or mended is noted.

    In blocks, between which the limits are looked at. Polygons are valid, and a self-crossing outline is mended;
    `MapError` for one that crosses itself so often that to mend it would take for ever.
    """
    rest = features(content, path)
    while block := list(islice(rest, BLOCK)):
        limits.check(READING)
        found = [(feature, shaped) for feature in block if (shaped := _shaped(feature, kinds, notes)) is not None]
        if not found:
            continue
        of, shapes = [feature for feature, _ in found], np.array([shaped for _, shaped in found], dtype=object)
        placed = _placed(of, shapes, placement)
        if kinds == POLYGONS:
            placed = _mended(of, placed, notes)
        parts, owner = shapely.get_parts(placed, return_index=True)
        parts, outer = shapely.get_parts(parts, return_index=True)  # what was mended may be nested
        owner = owner[outer]
        if kinds == POLYGONS:
            solid = (shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & (shapely.area(parts) > 0)
            parts, owner = parts[solid], owner[solid]
        ends = np.searchsorted(owner, np.arange(len(of) + 1)).tolist()
        yield from ((each, parts[ends[i] : ends[i + 1]].tolist()) for i, each in enumerate(of))


def _shaped(feature: Feature, kinds: tuple[str, ...], notes: FeatureNotes) -> BaseGeometry | None:
    """A feature's geometry, in the file's units; None, and a note, unless it is one of the kinds."""
    data = feature.data.get("geometry")
    if data is None:
        notes.add(feature, "no geometry, left out")
        return None
    kind = data.get("type") if isinstance(data, dict) else None
    if kind not in kinds:
        notes.add(feature, f"a {shown(kind)}, not a {WORDS[kinds]}, left out")
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


def _placed(of: Sequence[Feature], shapes: NDArray[np.object_], placement: Placement) -> NDArray[np.object_]:
    """Geometries of features from the file's units to metres, in the plane; `MapError` where no building lies."""
    points, owner = shapely.get_coordinates(shapes, return_index=True)
    beyond = ~(np.abs(points) <= FARTHEST_UNIT).all(axis=1)
    if beyond.any():
        raise MapError(
            f"{of[owner[beyond.argmax()]]}: its coordinates must be finite numbers, at most {FARTHEST_UNIT:,.0f}."
        )
    flat = shapely.force_2d(shapes)
    placed = shapely.transform(flat, lambda points: (points - placement.origin) * placement.scale)
    check_coordinates(placed, "a geometry, less the origin and times the scale,")
    return np.asarray(placed, dtype=object)


def _mended(of: Sequence[Feature], shapes: NDArray[np.object_], notes: FeatureNotes) -> NDArray[np.object_]:
    """Geometries of features, those made valid that were not."""
    check_each_joinable(shapes, of)
    for i in np.flatnonzero(~shapely.is_valid(shapes)).tolist():
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
