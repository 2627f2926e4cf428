"""Registry of map readers by name: the readers of hpop and those of installed packages.

A reader is a function ``read(path, **options) -> World``. A package registers its own readers in the entry-point group
``hpop.readers``::

    [project.entry-points."hpop.readers"]
    text_plan = "my_package.text_plan:read"

and then ``read_world("text_plan", "office.txt")`` and ``world: {text_plan: {path: office.txt}}`` in a scenario work.
"""

from __future__ import annotations

import inspect
import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hpop.base.registry import readers
from hpop.base.text import shown
from hpop.errors import HpopError, MapError, did_you_mean
from hpop.runtime.limits import LimitPassed
from hpop.world.files import named
from hpop.world.readers import commonroad, drawing, geojson, image, moveit_scene, point_cloud, ros_map
from hpop.world.world import World

readers.add("commonroad", commonroad.read)
readers.add("dxf", drawing.read_dxf)
readers.add("geojson", geojson.read)
readers.add("image", image.read)
readers.add("moveit_scene", moveit_scene.read)
readers.add("movingai", image.read_movingai)
readers.add("pdf", drawing.read_pdf)
readers.add("point_cloud", point_cloud.read)
readers.add("ros_bag", ros_map.read_bag)
readers.add("ros_map", ros_map.read)

ENDINGS = {
    **dict.fromkeys((".geojson", ".json", ".geojsonl", ".geojsons", ".geojsonseq", ".ndjson", ".jsonl"), "geojson"),
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".bmp", ".gif", ".pgm", ".ppm"), "image"),
    **dict.fromkeys((".bag", ".mcap", ".db3"), "ros_bag"),
    **dict.fromkeys((".yaml", ".yml"), "ros_map"),
    ".dxf": "dxf",
    ".map": "movingai",
    ".pdf": "pdf",
    **dict.fromkeys((".pcd", ".ply"), "point_cloud"),
    ".scene": "moveit_scene",
    ".xml": "commonroad",
}
"""Endings of file names, each with the name of its reader."""
MOST_MAPS = 3  # maps that are named in a folder
EXAMPLES = {"resolution": "0.05"}  # m for each pixel
"""Examples of options that readers need."""
CONVERT = "convert it to GeoJSON, such as by ogr2ogr -f GeoJSON -t_srs EPSG:4326 plan.geojson {}"
OTHERS = {
    **dict.fromkeys((".shp", ".gpkg", ".kml", ".gml", ".gdb", ".fgb", ".parquet", ".gpx"), CONVERT),
    ".zip": "unpack it",
    ".xodr": "convert it to CommonRoad, such as by crdesigner --input-file {} --output-file road.xml odrcr (pip "
    "install commonroad-scenario-designer)",
    ".topojson": "convert it to GeoJSON, such as by mapshaper {} -o format=geojson plan.geojson",
    **dict.fromkeys(
        (".osm", ".pbf"),
        "convert it to GeoJSON, such as by osmtogeojson; a road of lanelet2 to "
        "CommonRoad, such as by crdesigner --input-file {} --output-file road.xml lanelet2cr",
    ),
    **dict.fromkeys((".dwg", ".rvt", ".skp", ".ifc"), "save it as DXF"),
    **dict.fromkeys(
        (".bt", ".ot"),
        "write the centres of its cells as points, by octree2pointcloud {} map.pcd (a command "
        "of octomap), and read them with the side of a cell as resolution: reader point_cloud",
    ),
    ".sdf": "give its boxes, cylinders and spheres as solids",
    **dict.fromkeys(
        (".las", ".laz", ".e57", ".npy", ".npz"), "save it as PLY or PCD, or give an array to World.from_points"
    ),
    **dict.fromkeys(
        (".urdf", ".xacro", ".srdf"),
        "it is a robot, not a map: write a scenario as in docs/arm.md, with the robot as model: {{serial_arm: {{urdf: "
        "FILE, tip: LINK, acceleration: 6}}}} and the map as world; `hpop look FILE.urdf` draws the robot",
    ),
    ".svg": "save it as PDF, or as PNG",
    **dict.fromkeys((".tif", ".tiff", ".webp", ".heic", ".avif", ".psd"), "save it as PNG"),
}
"""Endings of files that no reader reads, and what to do with them."""


def reader_of(path: str | Path) -> str:
    """Return the name of the reader for a file, by its ending; a folder of a ROS 2 bag has its reader too.

    Raises `MapError` for an unknown ending and for any other folder.
    """
    try:
        ending = Path(path).suffix.lower()
        is_folder = os.path.isdir(path)
    except (TypeError, ValueError):
        raise MapError(f"a map must be given by its path, a str or Path; got {shown(path)}.") from None
    if is_folder:
        return _reader_of_folder(Path(path))
    if advice := _advice(path):
        raise MapError(advice)
    if ending not in ENDINGS:
        raise MapError(
            f"{named(path)}: no reader is known for this ending; give reader, one of {', '.join(readers)}. Known "
            f"endings: {', '.join(sorted(ENDINGS))}."
        )
    return ENDINGS[ending]


def _advice(path: str | Path) -> str:
    """Return what to do with a file whose ending no reader reads, as a sentence; "" for other endings."""
    todo = OTHERS.get(Path(path).suffix.lower(), "").format(shlex.quote(Path(path).name))
    return todo and f"{named(path)} has a format that no reader reads; {todo}."


def _said(reader: str, path: str | Path, options: Mapping[str, Any], known: inspect.Signature) -> str:
    """Return a text on unknown options, or on required ones that are missing; "" without a fault.

    A reader that accepts options of all names (``**options``) never has one.
    """
    _, *names = known.parameters
    if any(parameter.kind == parameter.VAR_KEYWORD for parameter in known.parameters.values()):
        return ""
    if unknown := [name for name in options if name not in names]:
        near = "".join(did_you_mean(name, names) for name in unknown)
        return f"it has no option {', '.join(unknown)}.{near} Its options are {', '.join(names) or 'none'}"
    missing = [
        name for name in names if name not in options and known.parameters[name].default is inspect.Parameter.empty
    ]
    if not missing:
        return ""
    example = ", ".join(f"{name}={EXAMPLES.get(name, '...')}" for name in missing)
    return (
        f"it needs {', '.join(missing)}, which {named(path)} does not state; give it, such as "
        f"World.from_file({str(path)!r}, {example}){map_beside(path)}. `hpop explain {reader}` says what it is"
    )


def map_beside(path: str | Path) -> str:
    """Return the advice to give the YAML file of a ROS map instead of its image, if it is there; "" otherwise."""
    file = Path(path).with_suffix(".yaml")
    return f"; or give {shlex.quote(str(file))}, which states it" if file.is_file() else ""


def _reader_of_folder(folder: Path) -> str:
    """Return the reader of ROS 2 bags if a folder is one; else raise MapError and name maps in the folder."""
    files = sorted(entry.name for entry in os.scandir(folder))
    maps = [name for name in files if Path(name).suffix.lower() in ENDINGS]
    if "metadata.yaml" in files or any(ENDINGS[Path(name).suffix.lower()] == "ros_bag" for name in maps):
        return "ros_bag"
    inside = (
        f"such as {', '.join(shlex.quote(str(folder / name)) for name in maps[:MOST_MAPS])}" if maps else "an image"
    )
    raise MapError(f"{named(folder)} is a folder; give the path of a map, {inside}.")


def read_world(reader: str, path: str | Path, **options: Any) -> World:
    """Read a world with the named reader.

    Raises UnknownName with a list of the readers, and MapError if the reader has no such option, fails, or returns no
    World.
    """
    read = readers[reader]
    known = inspect.signature(read)
    try:
        known.bind(path, **options)
    except TypeError as error:
        raise MapError(f"reader {reader!r}: {_said(reader, path, options, known) or error}") from None
    try:
        world = read(path, **options)
    except MapError as error:
        if advice := _advice(path):
            raise MapError(f"{error} {advice}") from error
        raise
    except (HpopError, LimitPassed):
        raise
    except Exception as error:  # a plugin may raise anything
        raise MapError(f"reader {reader!r} cannot read {str(path)!r}: {type(error).__name__}: {error}") from error
    if not isinstance(world, World):
        raise MapError(f"reader {reader!r} must return a World, got {type(world).__name__}")
    return world
