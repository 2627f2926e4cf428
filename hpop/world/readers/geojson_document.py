"""Read GeoJSON documents (RFC 7946, RFC 8142): features, coordinate system, and valid geometries in metres.

Files of another format raise an error that names the format.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import read_text
from hpop.world.geometry.outlines import check_each_joinable, check_mendable, check_mendable_together
from hpop.world.readers import placement
from hpop.world.readers.features import Feature, FeatureNotes
from hpop.world.readers.placement import Placement

GEOMETRIES = (
    *("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon"),
    "GeometryCollection",
)
BLOCK = 1_000
"""JSON objects that are read between two checks of the time and memory limits: hundredths of a second."""
STAYS, PARSED = 6, 24
"""Bytes of memory per byte of a file: for its geometries, and for Python objects while it is read."""
BETWEEN = re.compile(r"[\s\x1e]*")
"""Separators of JSON texts in a file: white space, and the record separators of RFC 8142."""
CONVERT = "convert it, such as by ogr2ogr -f GeoJSON -t_srs EPSG:4326 plan.geojson"
BINARY = (
    (b"PK\x03\x04", f"a zip archive, of a Shapefile perhaps: unpack it and {CONVERT} plan.shp"),
    (b"SQLite format 3\0", f"a GeoPackage or another database of SQLite: {CONVERT} plan.gpkg"),
    (b"\x00\x00\x27\x0a", f"a Shapefile: {CONVERT} plan.shp"),
    (b"fgb\x03", f"a FlatGeobuf file: {CONVERT} plan.fgb"),
    (b"PAR1", f"a Parquet file: {CONVERT} plan.parquet"),
    (b"\x1f\x8b", "compressed by gzip: unpack it"),
    (b"%PDF", "a PDF: it is read by the reader pdf"),
    (b"AC10", "a DWG drawing: save it as DXF"),
)
"""First bytes of files often mistaken for GeoJSON, with advice."""
MARKED = (
    ("<osm", "OpenStreetMap's XML: convert it by osmtogeojson"),
    ("<kml", f"KML: {CONVERT} plan.kml"),
    ("<gml", f"GML: {CONVERT} plan.gml"),
    ("<svg", "an SVG: save it as PDF or PNG"),
    ("<html", "a web page: download the file itself"),
    ("<!doctype html", "a web page: download the file itself"),
    ("version https://git-lfs", "a pointer of Git LFS: fetch the file by git lfs pull"),
)
"""Words in the first lines of files that are no JSON, in lower case, with advice."""
POINTS, LINES = ("Point", "MultiPoint"), ("LineString", "MultiLineString")
POLYGONS = ("Polygon", "MultiPolygon")
COLLECTION = "GeometryCollection"
AREAS = (shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON)
WORDS: dict[tuple[str, ...], str] = {POINTS: "point", LINES: "line", POLYGONS: "polygon"}
LEAST_RING = 3
"""Least number of different points of a ring that bounds an area."""
MOST_DEEP = 20
"""Deepest nesting of geometry collections that is read."""


class GeoJsonDocument(NamedTuple):
    """Contents of a GeoJSON file.

    features  in the order of the file
    crs       declared coordinate system, or None
    notes     on unusual contents
    """

    features: list[Feature]
    crs: str | None
    notes: tuple[str, ...]


def read_document(content: bytes, path: str | Path) -> GeoJsonDocument:
    """Read the features of a file: a FeatureCollection, a Feature or a geometry, or several of these, one per line.

    Raises MapError for other contents; it names the probable format and how to convert it.
    """
    limits.hold(READING, STAYS * len(content), PARSED * len(content))
    for start, what in BINARY:
        if content.startswith(start):
            raise MapError(f"{path} is no GeoJSON but {what}.")
    texts = _texts(read_text(content, path, "GeoJSON file"), path)
    features: list[Feature] = []
    declared: str | None = None
    elsewhere = False
    notes: list[str] = []
    for text in texts:
        found = _features(text, path, several=len(texts) > 1)
        own, said = placement.declared_by(text, found, path) if isinstance(text, dict) else (None, ())
        notes += said
        if own is not None and declared not in (None, own):
            raise MapError(f"{path}: its JSON texts declare different crs, {declared} and {own}; give a file for each.")
        declared = own or declared
        for data in found:
            if not isinstance(data, dict):
                raise MapError(f"{path}: feature {len(features)} must be an object; got {shown(data)}.")
            elsewhere |= data is not text and any(data.get(key) is not None for key in placement.MEMBERS)
            features.append(Feature(path, len(features), data))
    if len(texts) > 1:
        notes.append(f"{path}: {len(texts):,} texts of JSON, read as one collection.")
    if elsewhere:
        own = declared or "not declared"
        notes.append(f"{path}: a crs or coordRefSys of single features is not read; the file's own is {own}.")
    return GeoJsonDocument(features, declared, tuple(notes))


def _texts(text: str, path: str | Path) -> list[Any]:
    """Parse the JSON values in a file: one, or one per line (GeoJSONSeq, newline-delimited GeoJSON)."""
    count = 0

    def look(parsed: Any) -> Any:
        nonlocal count
        count += 1
        if count % BLOCK == 0:
            limits.check(READING)
        return parsed

    decoder = json.JSONDecoder(object_hook=look)
    found: list[Any] = []
    place = _after(text, 0)
    try:
        while place < len(text) or not found:
            value, place = decoder.raw_decode(text, place)
            found.append(value)
            place = _after(text, place)
            if place < len(text) and not isinstance(value, dict):
                raise json.JSONDecodeError("Extra data", text, place)
    except (ValueError, RecursionError) as error:
        if found and isinstance(found[0], dict):
            raise MapError(f"{path}: text {len(found) + 1} of it is not JSON: {error}.") from None
        raise MapError(f"{path} is not JSON: {error}.{_hint(text)}") from None
    return found


def _after(text: str, place: int) -> int:
    """Return the index after the separators between JSON texts that begin at index ``place``."""
    found = BETWEEN.match(text, place)
    return found.end() if found else place


def _hint(text: str) -> str:
    """Return a hint at the probable format of a text that is not JSON, for an error message; "" if unknown."""
    begin = text[:2_000].lower()
    return next((f" It seems to be {what}." for mark, what in MARKED if mark in begin), "")


def _features(data: Any, path: str | Path, *, several: bool) -> list[Any]:
    """Return the JSON of all features in one parsed value; MapError if it is no GeoJSON.

    ``several`` says that the file has more such values, for the message.
    """
    kind = data.get("type") if isinstance(data, dict) else None
    if kind == "FeatureCollection":
        found = data.get("features")
        if not isinstance(found, list):
            raise MapError(f"{path}: a FeatureCollection must have a list of features; got {shown(found)}.")
        return found
    if kind == "Feature":
        return [data]
    if isinstance(kind, str) and kind in GEOMETRIES:
        return [{"type": "Feature", "properties": {}, "geometry": data}]
    got = f"type {shown(kind)}" if isinstance(data, dict) else shown(data)
    where = " in each of its texts" if several else ""
    raise MapError(
        f"{path} must hold a GeoJSON FeatureCollection, Feature or geometry{where}; got {got}.{_other(data)}"
    )


def _other(data: Any) -> str:
    """Return a hint at another JSON format, and how to convert it, for an error message; "" if unknown."""
    if not isinstance(data, dict):
        return ""
    if data.get("type") == "Topology":
        return " It is TopoJSON: convert it, such as by mapshaper plan.json -o format=geojson plan.geojson."
    if isinstance(data.get("elements"), list):
        return " It is OpenStreetMap's JSON, as Overpass gives it: convert it by osmtogeojson."
    if "geometryType" in data or "spatialReference" in data:
        return f" It is Esri's JSON: {CONVERT} plan.json."
    if data.get("type") == "CityJSON":
        return " It is CityJSON: export a floor of it as GeoJSON."
    return ""


def two_numbers(data: Any) -> Any:
    """Return nested coordinates with only the first two numbers of each position."""
    if isinstance(data, list) and data and not isinstance(data[0], list):
        return data[:2]
    return [two_numbers(item) for item in data] if isinstance(data, list) else data


WORDS[POLYGONS + LINES] = "polygon or line"
WORDS[POLYGONS + LINES + POINTS] = "polygon, line or door"


def shaped(
    features: Sequence[Feature], kinds: tuple[str, ...], notes: FeatureNotes
) -> tuple[list[Feature], NDArray[np.object_]]:
    """Return the geometries of the given kinds, in units of the file, each with its feature.

    All other geometries are left out with a note.
    """
    of: list[Feature] = []
    shapes: list[BaseGeometry] = []
    rest = iter(features)
    while block := list(islice(rest, BLOCK)):
        limits.check(READING)
        for feature in block:
            for found in _shaped(feature, feature.data.get("geometry"), kinds, notes):
                of.append(feature)
                shapes.append(found)
    return of, np.array(shapes, dtype=object)


def placed(
    of: Sequence[Feature],
    shapes: NDArray[np.object_],
    placement: Placement,
    notes: FeatureNotes,
    *,
    rooms: bool = False,
) -> Iterator[tuple[Feature, list[Any]]]:
    """Yield each feature of ``of`` with the polygons, lines or points of its geometry in ``shapes``, m.

    Repaired geometries get a note.
    Polygons are valid: a self-crossing outline is repaired, or refused with `MapError` if that would take too long.
    With ``rooms`` the polygons of a MultiPolygon are not merged where they touch or overlap. Time and memory limits are
    checked between blocks of features.
    """
    for begin in range(0, len(of), BLOCK):
        limits.check(READING)
        some = of[begin : begin + BLOCK]
        there = placement.place(shapes[begin : begin + BLOCK])
        areas = np.isin(shapely.get_type_id(there), AREAS)
        there = _mended(some, there, areas, notes, rooms)
        parts, owner = shapely.get_parts(there, return_index=True)
        parts, outer = shapely.get_parts(parts, return_index=True)  # a mended geometry may be nested
        owner = owner[outer]
        kept = ~areas[owner] | (np.isin(shapely.get_type_id(parts), AREAS) & (shapely.area(parts) > 0))
        parts, owner = parts[kept], owner[kept]
        for i in np.setdiff1d(np.flatnonzero(areas), owner).tolist():
            notes.add(some[i], "a polygon without area, left out")
        ends = np.searchsorted(owner, np.arange(len(some) + 1)).tolist()
        yield from ((each, parts[ends[i] : ends[i + 1]].tolist()) for i, each in enumerate(some))


def left_out(kind: Any, kinds: tuple[str, ...]) -> str:
    """Return the note for a geometry that is left out because it is not of the expected kinds."""
    return f"a {shown(kind)}, not a {WORDS[kinds]}, left out"


def _shaped(
    feature: Feature, data: Any, kinds: tuple[str, ...], notes: FeatureNotes, deep: int = 0
) -> Iterator[BaseGeometry]:
    """Yield the geometries of a feature, also those in collections, in units of the file; other kinds get a note."""
    if data is None:
        place = " but a place of JSON-FG" if feature.data.get("place") is not None else ""
        notes.add(feature, f"no geometry{place}, left out")
        return
    kind = data.get("type") if isinstance(data, dict) else None
    if kind == COLLECTION and isinstance(data.get("geometries"), list) and deep < MOST_DEEP:
        if not data["geometries"]:
            notes.add(feature, f"an empty {kind}, left out")
        for each in data["geometries"]:
            yield from _shaped(feature, each, kinds, notes, deep + 1)
        return
    if kind not in kinds:
        notes.add(feature, left_out(kind, kinds))
        return
    try:
        geometry = _geometry(feature, data, notes)
    except Exception as error:  # coordinates may raise any exception in shapely
        raise MapError(
            f"{feature}: its coordinates make no {kind}, which must have positions [x, y] of two numbers: "
            f"{error!s:.200}."
        ) from None
    if geometry is None or geometry.is_empty:
        notes.add(feature, f"an empty {kind}, left out")
    else:
        yield geometry


def _geometry(feature: Feature, data: dict[str, Any], notes: FeatureNotes) -> BaseGeometry | None:
    """Build a geometry from coordinates as GIS programs write them, with extra numbers or rings that are not closed."""
    kind = data["type"]
    if kind in POLYGONS:
        data = _with_rings(feature, data, notes)
    try:
        with np.errstate(invalid="ignore"):
            geometry = shape(data)
    except (TypeError, ValueError):  # some positions have three numbers, or null in place of the third
        data = {**data, "coordinates": two_numbers(data["coordinates"])}
        with np.errstate(invalid="ignore"):
            geometry = shape(data)
        notes.add(feature, "positions of more than two numbers, of which only the first two are read")
    else:
        if geometry.has_z and (shapely.get_coordinates(geometry, include_z=True)[:, 2] != 0).any():
            notes.add(feature, "positions of more than two numbers, of which only the first two are read")
    return geometry


def _with_rings(feature: Feature, data: dict[str, Any], notes: FeatureNotes) -> dict[str, Any]:
    """Return the JSON of a polygon or multipolygon with only the rings that bound an area.

    Removed rings, and rings that are not closed, get a note.
    """
    polygons = data["coordinates"] if data["type"] == "MultiPolygon" else [data["coordinates"]]
    kept, is_whole = [], True
    for polygon in polygons if isinstance(polygons, list) else ():
        rings = []
        for i, ring in enumerate(polygon) if isinstance(polygon, list) else ():
            if not isinstance(ring, list) or not all(isinstance(p, list) and len(p) > 1 for p in ring):
                return data  # shapely explains the fault
            if not _bounds_area(ring):
                is_whole = False
                if ring:
                    notes.add(feature, f"a ring of fewer than {LEAST_RING} different points, left out")
                if i == 0:
                    break  # without an outer ring its holes do not count
                continue
            if ring[0][:2] != ring[-1][:2]:
                notes.add(feature, "a ring that is not closed, closed")
            rings.append(ring)
        if rings:
            kept.append(rings)
    if is_whole:
        return data
    return {"type": "MultiPolygon", "coordinates": kept}


def _bounds_area(ring: list[list[Any]]) -> bool:
    """Return whether a ring has at least `LEAST_RING` different points."""
    seen: set[Any] = set()
    for point in ring:
        seen.add(tuple(item if isinstance(item, int | float | str) else None for item in point[:2]))
        if len(seen) == LEAST_RING:
            return True
    return False


def _mended(
    of: Sequence[Feature], shapes: NDArray[np.object_], areas: BoolArray, notes: FeatureNotes, rooms: bool
) -> NDArray[np.object_]:
    """Make invalid polygons valid, in the array ``shapes`` itself, and return it; ``areas`` marks the polygons.

    With ``rooms`` each polygon of a MultiPolygon is repaired by itself.
    """
    check_each_joinable(shapes[areas], [each for each, area in zip(of, areas, strict=True) if area])
    invalid = np.flatnonzero(areas & ~shapely.is_valid(shapes)).tolist()
    crossings = [check_mendable(shapes[i], str(of[i])) for i in invalid]
    check_mendable_together(crossings, str(of[0].path) if of else "")
    for i in invalid:
        limits.check(READING)
        polygons = shapely.get_parts(shapes[i])
        if not rooms or len(polygons) == 1:
            shapes[i] = _valid(of[i], shapes[i], notes)
            continue
        mended = [polygon if shapely.is_valid(polygon) else _valid(of[i], polygon, notes) for polygon in polygons]
        notes.add(of[i], "its polygons touch or overlap, so each is a room of its own")
        shapes[i] = shapely.geometrycollections(shapely.get_parts(shapely.get_parts(mended)))
    return shapes


def _valid(feature: Feature, shape: BaseGeometry, notes: FeatureNotes) -> BaseGeometry:
    """Return an invalid polygon made valid, and add a note."""
    reason, *_ = shapely.is_valid_reason(shape).split("[")  # without the position: features share a note
    notes.add(feature, f"no valid polygon ({reason}), mended")
    return shapely.make_valid(shape)
