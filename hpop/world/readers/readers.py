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
from pathlib import Path
from typing import Any

from hpop.base.registry import readers
from hpop.base.text import shown
from hpop.errors import HpopError, MapError, did_you_mean
from hpop.runtime.limits import LimitPassed
from hpop.world.files import named
from hpop.world.readers import drawing, geojson, image, moveit_scene, movingai, point_cloud, ros_map
from hpop.world.world import World

readers.add("dxf", drawing.read_dxf)
readers.add("geojson", geojson.read)
readers.add("image", image.read)
readers.add("moveit_scene", moveit_scene.read)
readers.add("movingai", movingai.read)
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
}
"""Endings of file names, each with the name of its reader."""
CONVERT = "convert it to GeoJSON, such as by ogr2ogr -f GeoJSON -t_srs EPSG:4326 plan.geojson {}"
OTHERS = {
    **dict.fromkeys((".shp", ".gpkg", ".kml", ".gml", ".gdb", ".fgb", ".parquet", ".gpx"), CONVERT),
    ".zip": "unpack it",
    ".topojson": "convert it to GeoJSON, such as by mapshaper {} -o format=geojson plan.geojson",
    **dict.fromkeys((".osm", ".pbf"), "convert it to GeoJSON, such as by osmtogeojson"),
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
    ".svg": "save it as PDF, or as PNG",
    **dict.fromkeys((".tif", ".tiff", ".webp", ".heic", ".avif", ".psd"), "save it as PNG"),
}
"""Endings of files that no reader reads, and what to do with them."""


def reader_of(path: str | Path) -> str:
    """Return the name of the reader for a file, by its ending; a folder counts as a ROS bag.

    Raises `MapError` for an unknown ending.
    """
    try:
        ending = Path(path).suffix.lower()
        if os.path.isdir(path):
            return "ros_bag"
    except (TypeError, ValueError):
        raise MapError(f"a map must be given by its path, a str or Path; got {shown(path)}.") from None
    if ending in OTHERS:
        todo = OTHERS[ending].format(shlex.quote(Path(path).name))
        raise MapError(f"{named(path)} has a format that no reader reads; {todo}.")
    if ending not in ENDINGS:
        raise MapError(
            f"{named(path)}: no reader is known for this ending; give reader, one of {', '.join(readers)}. Known "
            f"endings: {', '.join(sorted(ENDINGS))}."
        )
    return ENDINGS[ending]


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
        hints = (did_you_mean(name, known.parameters) for name in options if name not in known.parameters)
        raise MapError(f"reader {reader!r}: {error}.{''.join(hints)} It takes {known}") from None
    try:
        world = read(path, **options)
    except (HpopError, LimitPassed):
        raise
    except Exception as error:  # a plugin may raise anything
        raise MapError(f"reader {reader!r} cannot read {str(path)!r}: {type(error).__name__}: {error}") from error
    if not isinstance(world, World):
        raise MapError(f"reader {reader!r} must return a World, got {type(world).__name__}")
    return world
