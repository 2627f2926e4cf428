"""Reader for the content of a world from GeoJSON (RFC 7946): points of interest, visitor flows, zones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.content.content import Content, Landmark, Zone
from hpop.world.files import read_bytes
from hpop.world.geometry.outlines import check_widenable
from hpop.world.geometry.shapes import check_positive
from hpop.world.readers import placement as systems
from hpop.world.readers.features import (
    Feature,
    FeatureFilter,
    FeatureNotes,
    chosen_features,
    length,
    notes_of_levels,
    number,
    truth,
)
from hpop.world.readers.geojson_document import LINES, POINTS, POLYGONS, WORDS, placed, read_document, shaped
from hpop.world.readers.placement import MOST_DEGREES, Placement, Units

FLOW_WIDTH = 3.0
"""Default width of the lane along a flow, m."""
ContentFile = str | Path | Mapping[str, Any]
"""Path of a file, or a mapping with ``path`` and ``where``, which states properties that features must have."""
ContentFiles = ContentFile | Sequence[ContentFile]
Maker = Callable[[Any, Feature], Landmark | Zone | str | None]
"""Function from a geometry, m, and its feature to a landmark or zone; or else to a text for a note, or None."""


def read(
    *,
    landmarks: ContentFiles = (),
    flows: ContentFiles = (),
    zones: ContentFiles = (),
    scale: float = 1.0,
    origin: tuple[float, float] = (0.0, 0.0),
    units: Units | None = "m",
    width: float = FLOW_WIDTH,
    crs: str | None = None,
) -> tuple[Content, tuple[str, ...]]:
    """Read the content of a world from GeoJSON files: ``world.with_content(landmarks=content.landmarks, ...)``.

    A file is a path, or a mapping such as ``{"path": "zones.geojson", "where": {"level": 0}}``; then only features with
    all properties of ``where`` are read, see `hpop.world.readers.geojson.read`.

    Parameters
    ----------
    landmarks : file or files
        Each point is a `Landmark`. Its name is the first of: properties ``name``, ``label``, ``title``; the feature's
        ``id``; properties ``id``, ``type``. The properties ``z`` (m), ``facing`` (rad) and ``weight`` are used too.
    flows : file or files
        Each line is a one-way `Zone` in the direction in which it is drawn, ``width`` across, or as the property
        ``width`` (m) says; it ends where the line ends.
    zones : file or files
        Each polygon with a rule is a `Zone`: property ``limit`` (m/s) makes a speed zone, ``closed`` (true, yes, or a
        number other than 0) a keep-out zone; ``kind`` (speed or keep-out) comes first.
    scale, origin, units, crs
        Those of the plan of the world, see `hpop.world.readers.geojson.read`; ``world.source["options"]`` has the
        values that were used. If the plan is in degrees or a crs, a file may be in degrees or in its own ``crs``.
    width : float
        Width of the lane along a flow, m.

    Returns
    -------
    The content, and notes: on features left out or repaired (no geometry, properties or rule, or another
    geometry than expected), on the number of chosen features, and on several levels read as one.

    Raises
    ------
    MapError
        If a file is missing or no GeoJSON, lacks the expected geometry, has no feature with the properties of
        ``where``, or has an invalid property.
    """
    width = check_positive("width", width)
    plan = systems.DEGREES if crs is None else systems.crs_of(crs)
    if plan != systems.DEGREES:
        ((x, y),) = systems.degrees_of(np.array([origin]), plan, "the plan's origin").tolist()
        origin, units = (x, y), "deg"
    source = _Source(Placement(scale, origin, units), plan, FeatureNotes(), [])
    seen = source.made(landmarks, POINTS, _landmark)
    ways = source.made(flows, LINES, lambda line, feature: _flow(line, feature, width))
    rules = source.made(zones, POLYGONS, _zone)
    content = Content(
        landmarks=tuple(item for item in seen if isinstance(item, Landmark)),
        zones=tuple(item for item in (*ways, *rules) if isinstance(item, Zone)),
    )
    return content, (*source.chosen, *source.notes.lines())


@dataclass(frozen=True)
class _Source:
    """Reader of content files: conversion of their coordinates, crs of the plan, and notes collected while reading."""

    placement: Placement
    crs: str
    notes: FeatureNotes
    chosen: list[str]

    def made(self, files: ContentFiles, kinds: tuple[str, ...], make: Maker) -> list[Landmark | Zone]:
        """Read files, and return the content that ``make`` builds from their geometries of the given kinds."""
        things: list[Landmark | Zone] = []
        for file in [files] if isinstance(files, str | Path | Mapping) else files:
            path, choice = _path_and_choice(file)
            found = False
            document = read_document(read_bytes(path, "GeoJSON file"), path)
            features, said = chosen_features(document.features, choice, path)
            of, shapes = shaped(features, kinds, self.notes)
            self.chosen.extend((*said, *notes_of_levels(of, choice, path)))
            self.placement.refuse_degrees(of, shapes)
            shapes = self._in_degrees(shapes, document.crs, path)
            for feature, parts in placed(of, shapes, self.placement.settled(of, shapes), self.notes):
                found = True
                if not isinstance(feature.data.get("properties"), dict):
                    self.notes.add(feature, "no properties")
                for part in parts:
                    thing = _content_of(make, part, feature)
                    if isinstance(thing, str):
                        self.notes.add(feature, thing)
                    elif thing is not None:
                        things.append(thing)
            if not found:
                raise MapError(f"{path} has no {WORDS[kinds]}. {' '.join(self.notes.lines(path))}".rstrip())
        return things

    def _in_degrees(self, shapes: NDArray[np.object_], crs: str | None, path: str | Path) -> NDArray[np.object_]:
        """Return the geometries of a file, converted to degrees if the plan is in degrees."""
        if self.placement.units != "deg" or not len(shapes):
            return shapes
        if crs is None:
            away = np.abs(shapely.get_coordinates(shapes)) > MOST_DEGREES
            crs = self.crs if away.any() else systems.DEGREES
        return systems.on_earth(shapes, crs, path)


def _path_and_choice(file: ContentFile) -> tuple[str | Path, FeatureFilter]:
    """Return the path of a file, and the filter of its features."""
    if not isinstance(file, Mapping):
        return file, FeatureFilter(None)
    path = file.get("path")
    if not isinstance(path, str | Path) or not file.keys() <= {"path", "where"}:
        raise MapError(
            "a file of landmarks, flows or zones must be a path, or a mapping with path and where, such as "
            f"{{path: zones.geojson, where: {{level: 0}}}}; got {shown(dict(file))}."
        )
    return path, FeatureFilter(file.get("where"))


def _content_of(make: Maker, part: BaseGeometry, feature: Feature) -> Landmark | Zone | str | None:
    """Return the content, or the text for a note, that ``make`` builds from a geometry; an error names the feature."""
    try:
        return make(part, feature)
    except MapError as error:
        raise MapError(f"{feature}: {error}") from None


def _landmark(point: Point, feature: Feature) -> Landmark:
    given = {key: number(feature.properties.get(key)) for key in ("z", "facing", "weight")}
    return Landmark(
        point.x, point.y, name=feature.name, **{key: value for key, value in given.items() if value is not None}
    )


def _flow(line: LineString, feature: Feature, width: float) -> Zone | str:
    own = feature.properties.get("width")
    if own is not None:
        across = length(own)
        width = check_positive("property width", own if across is None else across)
    if line.length == 0:
        return "a line without length, left out"
    check_widenable(line, width / 2, "the flow")
    return Zone("one-way", line.buffer(width / 2, cap_style="flat"), path=line, name=feature.name)


def _zone(area: Polygon, feature: Feature) -> Zone | str | None:
    kind, limit, closed = (number(feature.properties.get(key)) for key in ("kind", "limit", "closed"))
    if kind == "speed" or (kind is None and limit is not None):
        return Zone("speed", area, limit=limit, name=feature.name)
    if kind == "keep-out" or (kind is None and truth(closed)):
        return Zone("keep-out", area, name=feature.name)
    if kind is None and truth(closed) is False:
        return None  # the zone states that it is open
    got = (
        f"; its kind is {shown(kind)}"
        if kind is not None
        else ""
        if closed is None
        else f"; its closed is {shown(closed)}"
    )
    return f"no rule (kind speed or keep-out, limit, or closed){got}, left out"
