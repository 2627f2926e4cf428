"""Readers of maps, mostly one module per format, and the registry of readers by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use

if TYPE_CHECKING:  # imported on first use: readers build worlds, and a world reads files
    from hpop.world.readers import geojson as geojson
    from hpop.world.readers import image as image
    from hpop.world.readers import moveit_scene as moveit_scene
    from hpop.world.readers import ros_map as ros_map
    from hpop.world.readers.readers import read_world, reader_of

__all__ = ["read_world", "reader_of"]

__getattr__ = on_first_use(__name__, homes_of(__name__))
