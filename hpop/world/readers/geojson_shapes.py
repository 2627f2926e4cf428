"""Geometries of GeoJSON features: as a file has them, and in metres, valid; what is left out or mended is noted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

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
from hpop.world.geometry.crossings import check_each_joinable, check_mendable, check_mendable_together
from hpop.world.readers.features import Feature, FeatureNotes
from hpop.world.readers.geojson_text import BLOCK, two_numbers
from hpop.world.readers.placement import Placement

POINTS, LINES = ("Point", "MultiPoint"), ("LineString", "MultiLineString")
POLYGONS = ("Polygon", "MultiPolygon")
COLLECTION = "GeometryCollection"
AREAS = (shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON)
WORDS: dict[tuple[str, ...], str] = {POINTS: "point", LINES: "line", POLYGONS: "polygon"}
WORDS[POLYGONS + LINES] = "polygon or line"
WORDS[POLYGONS + LINES + POINTS] = "polygon, line or door"
LEAST_RING = 3
"""Different points of a ring that bounds an area, at least."""
MOST_DEEP = 20
"""Collections within collections that are read."""


def shaped(
    features: Sequence[Feature], kinds: tuple[str, ...], notes: FeatureNotes
) -> tuple[list[Feature], NDArray[np.object_]]:
    """Return geometries of some kinds (n,), in the file's units, and the feature of each; the others are noted."""
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
        for i in np.setdiff1d(np.flatnonzero(areas), owner).tolist():
            notes.add(some[i], "a polygon without area, left out")
        ends = np.searchsorted(owner, np.arange(len(some) + 1)).tolist()
        yield from ((each, parts[ends[i] : ends[i + 1]].tolist()) for i, each in enumerate(some))


def left_out(kind: Any, kinds: tuple[str, ...]) -> str:
    """Return the note on a geometry of another kind than was asked for."""
    return f"a {shown(kind)}, not a {WORDS[kinds]}, left out"


def _shaped(
    feature: Feature, data: Any, kinds: tuple[str, ...], notes: FeatureNotes, deep: int = 0
) -> Iterator[BaseGeometry]:
    """Yield the geometries of a feature in the file's units, those of a collection one by one; notes on the others."""
    if data is None:
        notes.add(feature, "no geometry, left out")
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
    except Exception as error:  # shapely passes on whatever the coordinates provoke
        raise MapError(
            f"{feature}: its coordinates make no {kind}, which has positions [x, y] of two numbers: {error!s:.200}."
        ) from None
    if geometry is None or geometry.is_empty:
        notes.add(feature, f"an empty {kind}, left out")
    else:
        yield geometry


def _geometry(feature: Feature, data: dict[str, Any], notes: FeatureNotes) -> BaseGeometry | None:
    """The geometry of coordinates, as GIS writes them: of two or more numbers each, with rings that are not closed."""
    kind = data["type"]
    if kind in POLYGONS:
        data = _with_rings(feature, data, notes)
    try:
        with np.errstate(invalid="ignore"):
            geometry = shape(data)
    except ValueError:
        data = {**data, "coordinates": two_numbers(data["coordinates"])}
        with np.errstate(invalid="ignore"):
            geometry = shape(data)
        notes.add(feature, "positions of more than two numbers, of which only the first two are read")
    else:
        if geometry.has_z and (shapely.get_coordinates(geometry, include_z=True)[:, 2] != 0).any():
            notes.add(feature, "positions of more than two numbers, of which only the first two are read")
    return geometry


def _with_rings(feature: Feature, data: dict[str, Any], notes: FeatureNotes) -> dict[str, Any]:
    """A polygon or several with the rings that bound an area; notes on those that do not, or are not closed."""
    polygons = data["coordinates"] if data["type"] == "MultiPolygon" else [data["coordinates"]]
    kept, is_whole = [], True
    for polygon in polygons if isinstance(polygons, list) else ():
        rings = []
        for i, ring in enumerate(polygon) if isinstance(polygon, list) else ():
            if not isinstance(ring, list) or not all(isinstance(p, list) and len(p) > 1 for p in ring):
                return data  # shapely says what is wrong
            if not _bounds_area(ring):
                is_whole = False
                if ring:
                    notes.add(feature, f"a ring of fewer than {LEAST_RING} different points, left out")
                if i == 0:
                    break  # holes of nothing
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
    """Whether a ring has enough different points; of most the first few tell."""
    seen: set[Any] = set()
    for point in ring:
        seen.add(tuple(item if isinstance(item, int | float | str) else None for item in point[:2]))
        if len(seen) == LEAST_RING:
            return True
    return False


def _mended(
    of: Sequence[Feature], shapes: NDArray[np.object_], areas: BoolArray, notes: FeatureNotes
) -> NDArray[np.object_]:
    """Geometries of features, those among the areas made valid that were not."""
    check_each_joinable(shapes[areas], [each for each, area in zip(of, areas, strict=True) if area])
    invalid = np.flatnonzero(areas & ~shapely.is_valid(shapes)).tolist()
    crossings = [check_mendable(shapes[i], str(of[i])) for i in invalid]
    check_mendable_together(crossings, str(of[0].path) if of else "")
    for i in invalid:
        limits.check(READING)
        reason, *_ = shapely.is_valid_reason(shapes[i]).split("[")  # less where, which no other feature shares
        notes.add(of[i], f"no valid polygon ({reason}), mended")
        shapes[i] = shapely.make_valid(shapes[i])
    return shapes
