"""What a GeoJSON text (RFC 7946, RFC 8142) says: its features and the crs it declares; or which other format it is."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import read_text
from hpop.world.readers import crs
from hpop.world.readers.features import Feature

GEOMETRIES = (
    *("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon"),
    "GeometryCollection",
)
BLOCK = 1_000
"""Objects of JSON that are read between two looks at the limits: hundredths of a second."""
STAYS, PARSED = 6, 24
"""Bytes for each of a file: of geometries, and of Python's objects while it is read."""
BETWEEN = re.compile(r"[\s\x1e]*")
"""What stands between texts: line ends, and the record separators of RFC 8142."""
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
"""What files begin with that are given for GeoJSON by mistake, and what to do."""
MARKED = (
    ("<osm", "OpenStreetMap's XML: convert it by osmtogeojson"),
    ("<kml", f"KML: {CONVERT} plan.kml"),
    ("<gml", f"GML: {CONVERT} plan.gml"),
    ("<svg", "an SVG: save it as PDF or PNG"),
    ("<html", "a web page: download the file itself"),
    ("<!doctype html", "a web page: download the file itself"),
    ("version https://git-lfs", "a pointer of Git LFS: fetch the file by git lfs pull"),
)
"""The same of texts that are no JSON, by what stands in their first lines, in lower case."""


class Document(NamedTuple):
    """What a file holds.

    features  in the file's order
    crs       the code of what it declares, or None
    notes     what was unusual
    """

    features: list[Feature]
    crs: str | None
    notes: tuple[str, ...]


def read_document(content: bytes, path: str | Path) -> Document:
    """Read the features of a FeatureCollection, a Feature or a bare geometry, or of several texts, one a line.

    Raises MapError for what is none of them; it says which format it seems to be, and how to convert it.
    """
    limits.hold(READING, STAYS * len(content), PARSED * len(content))
    for start, what in BINARY:
        if content.startswith(start):
            raise MapError(f"{path} is no GeoJSON but {what}.")
    texts = _texts(read_text(content, path, "GeoJSON file"), path)
    features: list[Feature] = []
    declared: str | None = None
    elsewhere = False
    for text in texts:
        found = _features(text, path, several=len(texts) > 1)
        own = crs.declared(text.get("crs")) if isinstance(text, dict) else None
        if own is not None and declared not in (None, own):
            raise MapError(f"{path}: its texts declare several crs, {declared} and {own}; give one file of each.")
        declared = own or declared
        for data in found:
            if not isinstance(data, dict):
                raise MapError(f"{path}: feature {len(features)} must be an object; got {shown(data)}.")
            elsewhere |= data is not text and data.get("crs") is not None
            features.append(Feature(path, len(features), data))
    notes = []
    if len(texts) > 1:
        notes.append(f"{path}: {len(texts):,} texts of JSON, read as one collection.")
    if elsewhere:
        notes.append(f"{path}: a crs of single features is not read; the file's own is {declared or 'not declared'}.")
    return Document(features, declared, tuple(notes))


def _texts(text: str, path: str | Path) -> list[Any]:
    """The texts of JSON in a text: one, or one a line (GeoJSONSeq, newline-delimited GeoJSON)."""
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
    """The place after what stands between texts."""
    found = BETWEEN.match(text, place)
    return found.end() if found else place


def _hint(text: str) -> str:
    """Say what a text that is no JSON seems to be."""
    begin = text[:2_000].lower()
    return next((f" It seems to be {what}." for mark, what in MARKED if mark in begin), "")


def _features(data: Any, path: str | Path, *, several: bool) -> list[Any]:
    """The features of one text."""
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
    """Say which other format of JSON it is, and what to do."""
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
    """Return coordinates with the first two numbers of each position."""
    if isinstance(data, list) and data and not isinstance(data[0], list):
        return data[:2]
    return [two_numbers(item) for item in data] if isinstance(data, list) else data
