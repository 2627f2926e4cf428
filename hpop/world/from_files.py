"""The ways from a file to a world, one a format: what `hpop.World.from_file` and its like take."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from hpop.world.ground import Heights

if TYPE_CHECKING:
    from hpop.world.world import World


class FromFiles:
    """Constructors of a `World` that read files. Each reader, and what it imports, is loaded when it is asked for."""

    @staticmethod
    def from_file(path: str | Path, *, reader: str | None = None, **options: Any) -> World:
        """Read a map by a reader's name, or by the ending of the file's: .geojson, .dxf, .pdf, .png, .yaml, .bag, ...

        The options are the reader's, see :mod:`hpop.world.readers.dxf`, :mod:`~hpop.world.readers.pdf`,
        :mod:`~hpop.world.readers.ros_bag` and the other modules called as the readers are;
        :mod:`hpop.world.readers.readers` has all of them.
        """
        from hpop.world.readers.readers import read_world, reader_of  # readers build worlds

        return read_world(reader_of(path) if reader is None else reader, path, **options)

    @staticmethod
    def from_moveit_scene(path: str | Path) -> World:
        """Read a planning scene of MoveIt or MotionBenchMaker; see `hpop.world.readers.moveit_scene.read`."""
        from hpop.world.readers import moveit_scene  # readers build worlds

        return moveit_scene.read(path)

    @staticmethod
    def from_ros_map(
        path: str | Path,
        *,
        unknown_is_free: bool = False,
        keep_out: str | Path | None = None,
        height: Heights | None = None,
    ) -> World:
        """Read a ROS map_server map; see `hpop.world.readers.ros_map.read`."""
        from hpop.world.readers import ros_map  # readers build worlds

        return ros_map.read(path, unknown_is_free=unknown_is_free, keep_out=keep_out, height=height)

    @staticmethod
    def from_movingai(path: str | Path, *, resolution: float = 1.0) -> World:
        """Read a grid map of the MovingAI benchmark; see `hpop.world.readers.movingai.read`."""
        from hpop.world.readers import movingai  # readers build worlds

        return movingai.read(path, resolution=resolution)

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
        from hpop.world.readers import geojson  # readers build worlds

        placed: dict[str, Any] = {"scale": scale, "origin": origin, "units": units, "crs": crs}
        return geojson.read(path, **placed, polygons=polygons, wall_width=wall_width, where=where)

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
    ) -> World:
        """Read a blueprint image; see `hpop.world.readers.image.read`."""
        from hpop.world.readers import image  # readers build worlds

        return image.read(
            path,
            resolution,
            threshold=threshold,
            smallest_obstacle=smallest_obstacle,
            inside=inside,
            origin=origin,
            height=height,
            outside_is_obstacle=outside_is_obstacle,
            thinnest_obstacle=thinnest_obstacle,
        )
