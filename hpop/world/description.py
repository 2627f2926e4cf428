"""Read worlds from files, and convert worlds to JSON-able descriptions, which are saved with Pareto fronts."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import math
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon, mapping, shape
from shapely.geometry.base import BaseGeometry

from hpop.base import registry
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world import readers
from hpop.world.bodies import LinkRules
from hpop.world.content.content import Content
from hpop.world.fields.measured import MeasuredField
from hpop.world.files import by_names, place_seen_from, places_found_from
from hpop.world.geometry.shapes import MAX_CELLS, Obstacle, Raster, packed, unpack_cells, unpacked
from hpop.world.geometry.solids import Solid
from hpop.world.ground import Ground, Heights

if TYPE_CHECKING:
    from hpop.world.world import World


class FromFiles:
    """Constructors of a `World` from files. A reader and its libraries are imported on first use."""

    @staticmethod
    def from_file(path: str | Path, *, reader: str | None = None, **options: Any) -> World:
        """Read a map with the named reader, or with the one for the file's ending: .geojson, .dxf, .png, .yaml, ...

        Options are passed to the reader. Each reader is a module that explains its options, such as
        :mod:`hpop.world.readers.drawing` or :mod:`~hpop.world.readers.ros_map`; :mod:`hpop.world.readers.readers` lists
        all.
        """
        return readers.read_world(readers.reader_of(path) if reader is None else reader, path, **options)

    @staticmethod
    def from_moveit_scene(path: str | Path) -> World:
        """Read a planning scene of MoveIt or MotionBenchMaker; see `hpop.world.readers.moveit_scene.read`."""
        return readers.moveit_scene.read(path)

    @staticmethod
    def from_ros_map(
        path: str | Path,
        *,
        unknown_is_free: bool = False,
        keep_out: str | Path | None = None,
        height: Heights | None = None,
    ) -> World:
        """Read a ROS map_server map; see `hpop.world.readers.ros_map.read`."""
        return readers.ros_map.read(path, unknown_is_free=unknown_is_free, keep_out=keep_out, height=height)

    @staticmethod
    def from_movingai(path: str | Path, *, resolution: float = 1.0) -> World:
        """Read a grid map of the MovingAI benchmark; see `hpop.world.readers.image.read_movingai`."""
        return readers.image.read_movingai(path, resolution=resolution)

    @staticmethod
    def from_geojson(
        path: str | Path,
        *,
        scale: float = 1.0,
        origin: tuple[float, float] | None = None,
        polygons: Literal["obstacles", "free", "outline", "rooms"] = "obstacles",
        units: Literal["m", "deg"] | None = None,
        wall_width: float | None = None,
        crs: str | None = None,
        where: Mapping[str, Any] | None = None,
    ) -> World:
        """Read a vector floor plan, in metres, degrees or a projection; see `hpop.world.readers.geojson.read`."""
        placed: dict[str, Any] = {"scale": scale, "origin": origin, "units": units, "crs": crs}
        return readers.geojson.read(path, **placed, polygons=polygons, wall_width=wall_width, where=where)

    @staticmethod
    def from_image(
        path: str | Path,
        resolution: float,
        *,
        threshold: float = 0.5,
        smallest_obstacle: float | None = None,
        inside: tuple[float, float] | None = None,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        height: Heights | None = None,
        outside_is_obstacle: bool = True,
        thinnest_obstacle: float | None = None,
        contrast: bool = False,
    ) -> World:
        """Read a blueprint image; see `hpop.world.readers.image.read`."""
        return readers.image.read(
            path,
            resolution,
            threshold=threshold,
            smallest_obstacle=smallest_obstacle,
            inside=inside,
            origin=origin,
            height=height,
            outside_is_obstacle=outside_is_obstacle,
            thinnest_obstacle=thinnest_obstacle,
            contrast=contrast,
        )


def describe(world: World) -> dict[str, Any]:
    """Return a JSON-able description of a world: the files it came from, else its geometry; see `World.describe`."""
    content = {"content": _lists(world.content.describe())} if world.content.present or world.content.zones else {}
    if world.fields:
        content["fields"] = [each.describe() for each in world.fields]
    if world.source is not None:
        return {**_lists(world.source), **content}
    raster, solids = world.raster, [solid.describe() for solid in world.ground.solids]
    prisms = [obstacle for obstacle in world.obstacles if obstacle.solid is None]
    return {
        "kind": "geometry",
        "obstacles": [_prism(prism) for prism in prisms],
        **({"solids": solids} if solids else {}),
        "raster": None if raster is None else _raster(raster),
        "keep_out": _geometry(world.keep_out),
        "extent": _geometry(world.extent),
        "outside_is_obstacle": world.outside_is_obstacle,
        "notes": [by_names(note) for note in world.notes],
        **({"link_rules": world.link_rules.describe()} if world.link_rules else {}),
        **content,
    }


def summary(world: World) -> str:
    """Summarise a world in a line: its size, contents and source."""
    said = facts(world)
    size, source = said.pop("size"), said.pop("source", None)
    cells = said.pop("cells", None)
    parts = [size, *filter(None, [cells]), *(f"{name}: {count}" for name, count in said.items())]
    return f"<World: {', '.join([*parts, *filter(None, [source])])}>"


def facts(world: World) -> dict[str, str]:
    """Return the size, the number of each kind of content, and the source of a world, each as text."""
    x0, y0, x1, y1 = world.bounds
    said = {"size": f"{x1 - x0:.4g} x {y1 - y0:.4g} m from ({x0:.4g}, {y0:.4g})"}
    if world.raster is not None:
        rows, columns = world.raster.cells.shape
        said["cells"] = f"{columns} x {rows} cells of {world.raster.resolution:g} m"
    content = world.content
    solids = world.ground.solids
    prisms = world.obstacles[: len(world.obstacles) - len(solids)]
    things = (prisms, solids, content.people, content.landmarks, content.zones, world.fields)
    names = ("obstacles", "solids", "people", "landmarks", "zones", "fields")
    said |= {name: str(len(some)) for name, some in zip(names, things, strict=True) if some}
    if world.source is not None:
        said["source"] = str(world.source["path"])
    return said


def build(description: Mapping[str, Any]) -> World:
    """Build a world from its description. Every value is checked, because the description may come from any file."""
    kind = description.get("kind") if isinstance(description, Mapping) else None
    try:
        if kind == "geometry" or kind in registry.readers:
            world = _from_geometry(description) if kind == "geometry" else _from_files(description, str(kind))
            if description.get("fields"):
                world = world.with_fields([MeasuredField.build(each) for each in description["fields"]])
            content = description.get("content")
            if content is None:
                return world
            built = Content.build(content)
            return world.with_content(
                people=built.people, groups=built.groups, landmarks=built.landmarks, zones=built.zones
            )
    except MapError:
        raise
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError, shapely.errors.ShapelyError) as error:
        raise MapError(
            "the description of a world is malformed: expected a dict as World.describe returns, got one that fails "
            f"with {shown(error)}; describe the world anew"
        ) from None
    known = ", ".join(("geometry", *registry.readers))
    raise MapError(f'a world\'s description must have a "kind", one of {known}; got {shown(kind)}.')


def seen_from(folder: str, description: Any) -> Any:
    """Return a world's description with absolute file paths replaced by paths relative to a folder.

    The key "relative" lists these paths by "path" and the names of reader options, for :func:`found_from`. Thus a saved
    front and its map can be moved together.
    """
    relative = {key: place_seen_from(folder, path) for key, path in _paths(description).items() if os.path.isabs(path)}
    return {**_at(description, relative), "relative": relative} if relative else description


def found_from(folder: str, description: Any) -> Any:
    """Return a world's description with the absolute paths of its files, given the folder where the front now lies.

    This undoes :func:`seen_from`. A file is looked for at its relative path, at its old absolute path if stated, and by
    name in the folder. The old absolute path is preferred only if its file is unchanged and the other is not. If a file
    is missing, the key "relative" lists where the files were expected.
    """
    relative = description.get("relative") if isinstance(description, Mapping) else None
    if not isinstance(relative, Mapping):
        return description
    plain = {key: value for key, value in description.items() if key != "relative"}
    first, places, seen = {}, {}, {}
    for key, text in relative.items():
        path = plain.get("path") if key == "path" else dict(plain.get("options") or {}).get(key)
        if not (isinstance(text, str) and isinstance(path, str)):
            continue  # malformed
        seen[key], beside = places_found_from(folder, text)
        whole = path if os.path.isabs(path) else seen[key]
        places[key] = next(filter(os.path.exists, (seen[key], whole, beside)), whole)
        first[key] = whole
    described, found = _at(plain, first), _at(plain, places)
    if not all(map(os.path.exists, places.values())):
        return {**found, "relative": seen}
    same = all(os.path.exists(path) and os.path.samefile(path, places[key]) for key, path in first.items())
    others = not same and all(map(os.path.exists, first.values()))
    return described if same or (others and not _unchanged(found) and _unchanged(described)) else found


def _at(description: Mapping[str, Any], places: Mapping[str, str]) -> dict[str, Any]:
    """Return a description with the file paths in ``places``, given by "path" or by the name of a reader option."""
    changed = {**description, **{key: place for key, place in places.items() if key == "path"}}
    if others := {key: place for key, place in places.items() if key != "path"}:
        changed["options"] = {**description["options"], **others}
    return changed


def _unchanged(description: Any) -> bool:
    """Return whether a world can be built from a description: its files exist and have the hashes that it states."""
    try:
        build(description)
    except MapError:
        return False
    return True


def without_places(description: Any) -> Any:
    """Return a world's description that is equal for equal maps: file paths are left out, cells replaced by a hash."""
    raster = description.get("raster") if isinstance(description, Mapping) else None
    if isinstance(raster, Mapping) and isinstance(raster.get("cells"), str):
        try:
            cells = zlib.decompressobj().decompress(base64.b64decode(raster["cells"]), MAX_CELLS)
        except (zlib.error, binascii.Error):
            return description
        return {**description, "raster": {**raster, "cells": hashlib.sha256(cells).hexdigest()}}
    paths = _paths(description)
    if "sha256" not in (description if isinstance(description, Mapping) else ()):
        return description
    remaining = {key: value for key, value in description.items() if key not in ("path", "relative")}
    options = remaining.get("options")
    if isinstance(options, Mapping):
        remaining["options"] = {key: None if key in paths else value for key, value in options.items()}
    return remaining


def _paths(description: Any) -> dict[str, str]:
    """Return the file paths in a description: the map, and reader options that are absolute paths, such as a mask."""
    if not isinstance(description, Mapping) or not isinstance(description.get("path"), str):
        return {}
    options = description.get("options")
    named = options.items() if isinstance(options, Mapping) else ()
    others = {key: value for key, value in named if isinstance(value, str) and os.path.isabs(value)}
    return {**others, "path": description["path"]}


def _from_files(description: Mapping[str, Any], kind: str) -> World:
    options = dict(description["options"])
    try:
        world = readers.read_world(kind, description["path"], **options)
    except MapError:
        _refuse_lost(description)
        raise
    hashes = None if world.source is None else list(world.source["sha256"])
    if hashes != list(description["sha256"]):
        raise MapError(
            f"the map {description['path']!r} has changed since the result that refers to it was saved: its SHA-256 "
            "differs. Restore the old map, or plan again on the new one."
        )
    return world


def _refuse_lost(description: Mapping[str, Any]) -> None:
    """Raise MapError if a file is neither at its old path nor at the path relative to the saved front."""
    beside = description.get("relative")
    seen = beside if isinstance(beside, Mapping) else {}
    for key, path in _paths(description).items():
        there = str(seen.get(key))
        if os.path.isabs(there) and not os.path.exists(path):
            what = "the map of this front" if key == "path" else f"the {key} of this front's map"
            if there == path:
                raise MapError(
                    f"{what} is missing: it is not at {path!r}. Put the unchanged file there, or beside the front "
                    "under the same name."
                )
            raise MapError(
                f"{what} is missing: it is neither at its old path, {path!r}, nor at {there!r}, where it would be if "
                "it had been moved together with the front. Put the unchanged file at one of these paths."
            )


def _from_geometry(data: Mapping[str, Any]) -> World:
    from hpop.world.world import World  # a world is one of these files and descriptions

    prisms = tuple(
        Obstacle(_polygons(o["polygon"]), *_range(o["z"]), name=str(o.get("name", "")), contrast=o.get("contrast", 1.0))
        for o in data["obstacles"]
    )
    raster = data["raster"]
    ground = Ground(
        obstacles=prisms,
        raster=None if raster is None else _build_raster(raster),
        extent=_polygons(data["extent"]),
        outside_is_obstacle=bool(data["outside_is_obstacle"]),
        solids=tuple(Solid.build(solid) for solid in data.get("solids", ())),
    )
    notes, rules = tuple(str(note) for note in data["notes"]), data.get("link_rules")
    found = LinkRules() if rules is None else LinkRules.build(rules)
    return World(ground, _polygons(data["keep_out"]), notes, link_rules=found)


def _prism(prism: Obstacle) -> dict[str, Any]:
    called: dict[str, Any] = {"name": prism.name} if prism.name else {}
    if prism.contrast != 1.0:
        called["contrast"] = prism.contrast
    return {"polygon": _geometry(prism.polygon), "z": _heights(prism.heights), **called}


def _raster(raster: Raster) -> dict[str, Any]:
    return {
        "shape": list(raster.cells.shape),
        "cells": packed(np.packbits(raster.cells)),
        "resolution": raster.resolution,
        "origin": list(raster.origin),
        "z": _heights(raster.heights),
        **({} if raster.contrasts is None else {"contrasts": packed(raster.contrasts)}),
    }


def _build_raster(data: Mapping[str, Any]) -> Raster:
    rows, columns = data["shape"]
    if type(rows) is not int or type(columns) is not int:
        raise MapError(f"a raster's shape must be two integers; got {shown(data['shape'])}.")
    cells = unpack_cells(data["cells"], rows, columns)
    shades = data.get("contrasts")
    contrasts = (
        None
        if shades is None
        else unpacked(shades, rows * columns, f"{columns} x {rows} contrasts").reshape(rows, columns)
    )
    return Raster(cells, data["resolution"], data["origin"], *_range(data["z"]), contrasts)


def _heights(heights: Heights) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in heights]


def _range(z: Any) -> Heights:
    low, high = z
    return (-math.inf if low is None else low, math.inf if high is None else high)


def _geometry(geometry: BaseGeometry) -> dict[str, Any]:
    lists: dict[str, Any] = _lists(mapping(geometry)) if geometry.is_empty else json.loads(shapely.to_geojson(geometry))
    return lists  # the text of GEOS is exact, and read faster than shapely's mapping


def _polygons(data: Any) -> Any:
    geometry = shape(data)
    if not isinstance(geometry, Polygon | MultiPolygon):
        raise MapError(f"a described geometry must be a Polygon or MultiPolygon; got {geometry.geom_type}.")
    return geometry


def _lists(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _lists(item) for key, item in value.items()}
    return [_lists(item) for item in value] if isinstance(value, tuple | list) else value
