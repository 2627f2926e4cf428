"""Readers of maps by name: those that come with hpop, and those of installed packages.

A reader is a function ``read(path, **options) -> World``. A package names its own in the entry-point group
``hpop.readers``::

    [project.entry-points."hpop.readers"]
    text_plan = "my_package.text_plan:read"

and then ``read_world("text_plan", "office.txt")`` and ``world: {text_plan: {path: office.txt}}`` in a scenario work.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

from hpop.errors import HpopError, MapError, did_you_mean
from hpop.registry import readers
from hpop.world import geojson, image, moveit_scene, movingai, ros_map
from hpop.world.limits import LimitPassed
from hpop.world.world import World

readers.add("geojson", geojson.read)
readers.add("image", image.read)
readers.add("moveit_scene", moveit_scene.read)
readers.add("movingai", movingai.read)
readers.add("ros_map", ros_map.read)


def read_world(reader: str, path: str | Path, **options: Any) -> World:
    """Read a world by the reader of that name.

    Raises UnknownName that lists the known readers, and MapError where the options are not the reader's, it fails, or
    what it returns is no World.
    """
    read = readers[reader]
    known = inspect.signature(read)
    try:
        known.bind(path, **options)
    except TypeError as error:
        hints = (did_you_mean(name, known.parameters) for name in options if name not in known.parameters)
        raise MapError(f"reader {reader!r} takes {known}; {error}.{''.join(hints)}") from None
    try:
        world = read(path, **options)
    except (HpopError, LimitPassed):
        raise
    except Exception as error:  # a plugin may raise anything
        raise MapError(f"reader {reader!r} cannot read {str(path)!r}: {type(error).__name__}: {error}") from error
    if not isinstance(world, World):
        raise MapError(f"reader {reader!r} must return a World, got {type(world).__name__}")
    return world
