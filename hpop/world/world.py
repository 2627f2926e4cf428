"""The workspace: obstacles, where a robot may be, and how much of a camera's surroundings is obstructed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.arrays import BoolArray, Column
from hpop.errors import MapError, OptionError
from hpop.math import is_symbolic
from hpop.text import shown
from hpop.world.cache import Cache
from hpop.world.content import Content, Landmark, Person, Zone
from hpop.world.crossings import check_joinable
from hpop.world.extent import check_area, check_size, extent_of
from hpop.world.field import Field
from hpop.world.planar import FreeSpace, without
from hpop.world.sampling import obstructed, sample_clearance, sample_obstruction
from hpop.world.shapes import Obstacle, Raster, check_heights, check_prisms, overlaps

if TYPE_CHECKING:
    from hpop.motions import Pose

WHOLE = (-math.inf, math.inf)
CELL = 0.1
"""Field cell of a polygon world, m."""

T = TypeVar("T")
Heights = tuple[float, float]


@dataclass(frozen=True, eq=False, repr=False)
class World:
    """Obstacles and free space, in metres, x right and y up (REP-103). Build one with a ``from_`` method.

    obstacles            upright prisms
    raster               occupancy cells, or None
    keep_out             shapely geometry, m: closed to the robot, invisible to the camera
    extent               shapely polygon, m: where the robot must stay; default: the image's rectangle, or the
                         bounding box of the obstacles
    outside_is_obstacle  whether the camera counts all beyond the extent as obstacle (as high as the raster's
                         cells; the whole height without a raster)
    notes                what a reader left out or mended
    content              people, landmarks and zones; see `with_content`
    source               how to build the same world again, see `describe`

    Values derived from these are computed when first needed, kept (:mod:`hpop.world.cache`), and not pickled.
    """

    obstacles: tuple[Obstacle, ...] = ()
    raster: Raster | None = None
    keep_out: BaseGeometry = field(default_factory=MultiPolygon)
    extent: BaseGeometry = field(default_factory=MultiPolygon)
    outside_is_obstacle: bool = False
    notes: tuple[str, ...] = ()
    content: Content = field(default_factory=Content)
    source: Mapping[str, Any] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Fill in the extent and check the geometries."""
        object.__setattr__(self, "obstacles", check_prisms(self.obstacles))
        if not isinstance(self.raster, Raster | None):
            raise MapError(
                f"raster must be a hpop.world.Raster; got {shown(self.raster)}. See World.from_cells(cells)."
            )
        extent = extent_of(self.obstacles, self.raster) if _is_empty(self.extent) else self.extent
        check_area("extent", extent)
        check_area("keep_out", self.keep_out)
        check_size(extent)
        areas = [zone.area for zone in self.content.zones]
        check_joinable([*(o.polygon for o in self.obstacles), extent, self.keep_out, *areas], "the world")
        object.__setattr__(self, "extent", extent)
        object.__setattr__(self, "_cache", Cache())

    def __repr__(self) -> str:
        from hpop.world.description import summary

        return summary(self)

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields without what was derived from them."""
        return {key: value for key, value in self.__dict__.items() if key != "_cache"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields."""
        self.__dict__.update(state, _cache=Cache())

    def _cached(self, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        return self.cache.get(key, make)  # type: ignore[no-any-return]

    @property
    def cache(self) -> Cache:
        """What was derived from this world, and is dropped with it."""
        cache: Cache = self.__dict__["_cache"]
        return cache

    # Constructors

    @classmethod
    def from_polygons(
        cls,
        obstacles: Iterable[BaseGeometry | tuple[BaseGeometry, Heights]],
        *,
        extent: BaseGeometry | None = None,
        keep_out: BaseGeometry | None = None,
    ) -> World:
        """Build a world from shapely polygons, each alone or as (polygon, (z_min, z_max)), in metres.

        >>> world = World.from_polygons([shapely.box(4, 0, 6, 3)], extent=shapely.box(0, 0, 10, 5))
        >>> world.clearance(np.array([1.0, 3.5, 5.0]), np.array([2.5, 2.0, 1.0]))
        array([1. , 0.5, 0. ])
        """
        if not isinstance(obstacles, Iterable) or (isinstance(obstacles, np.ndarray) and not obstacles.ndim):
            raise MapError(
                f"obstacles must be a list of shapely polygons; got {shown(obstacles)}. Put one in brackets."
            )
        prisms = []
        for item in obstacles:
            shape, heights = item if isinstance(item, tuple) and len(item) == 2 else (item, WHOLE)
            if not isinstance(shape, Polygon | MultiPolygon):
                raise MapError(
                    "an obstacle must be a shapely Polygon or MultiPolygon, such as shapely.Polygon([(0, 0), (1, 0), "
                    f"(1, 1)]); got {shown(shape)}."
                )
            prisms += [Obstacle(part, *check_heights(heights)) for part in shapely.get_parts(shape)]
        if _is_empty(extent):
            raise MapError("extent is empty: the robot would have nowhere to be.")
        return cls(tuple(prisms), keep_out=_or_nothing(keep_out), extent=_or_nothing(extent))

    @classmethod
    def from_cells(
        cls,
        occupied: BoolArray,
        resolution: float,
        *,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        height: Heights = WHOLE,
        keep_out: BaseGeometry | None = None,
        outside_is_obstacle: bool = True,
    ) -> World:
        """Build a world from occupancy cells (H, W), row 0 at the bottom; see `Raster` for the rest.

        >>> world = World.from_cells(np.eye(3, dtype=bool), 0.5)
        >>> world.clearance(np.array([1.25]), np.array([0.25]))
        array([0.25])
        """
        raster = Raster(occupied, resolution, origin, *check_heights(height))
        return cls(raster=raster, keep_out=_or_nothing(keep_out), outside_is_obstacle=outside_is_obstacle)

    @classmethod
    def from_ros_map(
        cls,
        path: str | Path,
        *,
        unknown_is_free: bool = False,
        keep_out: str | Path | None = None,
        height: Heights | None = None,
    ) -> World:
        """Read a ROS map_server map; see `hpop.world.ros_map.read`."""
        from hpop.world import ros_map

        return ros_map.read(path, unknown_is_free=unknown_is_free, keep_out=keep_out, height=height)

    @classmethod
    def from_movingai(cls, path: str | Path, *, resolution: float = 1.0) -> World:
        """Read a grid map of the MovingAI benchmark; see `hpop.world.movingai.read`."""
        from hpop.world import movingai

        return movingai.read(path, resolution=resolution)

    @classmethod
    def from_geojson(
        cls,
        path: str | Path,
        *,
        scale: float = 1.0,
        origin: tuple[float, float] = (0.0, 0.0),
        polygons: Literal["obstacles", "free", "outline"] = "obstacles",
    ) -> World:
        """Read a vector floor plan; see `hpop.world.geojson.read`."""
        from hpop.world import geojson

        return geojson.read(path, scale=scale, origin=origin, polygons=polygons)

    @classmethod
    def from_image(
        cls,
        path: str | Path,
        resolution: float,
        *,
        threshold: float = 0.5,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        height: Heights | None = None,
        outside_is_obstacle: bool = True,
    ) -> World:
        """Read a blueprint image; see `hpop.world.image.read`."""
        from hpop.world import image

        return image.read(
            path,
            resolution,
            threshold=threshold,
            origin=origin,
            height=height,
            outside_is_obstacle=outside_is_obstacle,
        )

    def read_from(self, source: Mapping[str, Any]) -> World:
        """Note, as a reader does, which files this world comes from; `dataclasses.replace` drops the note."""
        object.__setattr__(self, "source", source)
        return self

    # Geometry in the plane

    def _active(self, z: Heights) -> tuple[tuple[int, ...], bool]:
        """Which obstacles, and whether the raster, overlap a height range: the key of all cached geometry."""
        low, high = float(z[0]), float(z[1])
        if not low <= high:
            raise OptionError(f"a height range must be (z_min, z_max) with z_min <= z_max; got {shown(z)}.")
        prisms = tuple(i for i, o in enumerate(self.obstacles) if overlaps(o.heights, (low, high)))
        return prisms, self.raster is not None and overlaps(self.raster.heights, (low, high))

    def raster_solid(self) -> BaseGeometry:
        """Union (m) of the occupied cells, whatever their heights; empty without a raster.

        Raises MapError, with the file that they were read from, where their outlines have too many corners.
        """

        def make() -> BaseGeometry:
            try:
                return MultiPolygon() if self.raster is None else self.raster.solid()
            except MapError as error:
                if self.source is None:
                    raise
                raise MapError(f"{self.source['path']}: {error}") from None

        return self._cached(("raster",), make)

    def _solid(self, active: tuple[tuple[int, ...], bool]) -> BaseGeometry:
        def make() -> BaseGeometry:
            prisms, cells = active
            shapes: list[BaseGeometry] = [self.obstacles[i].polygon for i in prisms]
            if cells and not shapes:
                return self.raster_solid()
            return _union([*shapes, self.raster_solid()] if cells else shapes)

        return self._cached(("solid", active), make)

    def solid(self, z_min: float = -math.inf, z_max: float = math.inf) -> BaseGeometry:
        """Union (m) of all obstacles whose heights overlap the open range (z_min, z_max)."""
        return self._solid(self._active((z_min, z_max)))

    @property
    def closed(self) -> BaseGeometry:
        """Where the robot must not be though nothing solid is there, m: keep-out zones and people who stand."""
        return self._cached(("closed",), lambda: shapely.union_all([self.keep_out, self.content.closed]))

    def blocked(self, z_min: float = -math.inf, z_max: float = math.inf) -> BaseGeometry:
        """`solid` and `closed`, m: where the robot must not be. The extent bounds it besides."""
        active = self._active((z_min, z_max))
        return self._cached(("blocked", active), lambda: _union([self._solid(active), self.closed]))

    def free_space(self, z: Heights = WHOLE) -> FreeSpace:
        """Return the extent without all that is blocked, its border indexed for exact distances."""
        return self._cached(
            ("free", self._active(z)),
            lambda: FreeSpace(without(self.extent, self.blocked(*z))),
        )

    def clearance(self, x: Column, y: Column, *, z: Heights = WHOLE) -> Column:
        """Distance (M,), m, to the nearest obstacle, keep-out zone or border of the extent; 0 beyond them.

        x and y are (M,) in metres; ``z`` is the range of heights that counts. Exact for arrays (about 1 us a
        point in a building at 0.05 m). CasADi columns get the `clearance_field`, which is signed and
        smoothed.
        """
        if is_symbolic(x) or is_symbolic(y):
            return self.clearance_field(z=z)(x, y)
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return self.free_space(z).clearance(np.ravel(x), np.ravel(y)).reshape(x.shape)

    def segments_free(
        self, x0: Column, y0: Column, x1: Column, y1: Column, margin: float, *, z: Heights = WHOLE
    ) -> BoolArray:
        """Whether each segment (M,) stays in the extent and ``margin`` (m, within 1e-9) off all blocked."""
        if not margin >= 0:
            raise OptionError(f"margin must be a distance of at least 0 m; got {shown(margin)}.")
        columns = (np.asarray(c, dtype=np.float64) for c in (x0, y0, x1, y1))
        ends = [np.ravel(c) for c in np.broadcast_arrays(*columns)]
        return self.free_space(z).segments_free(ends[0], ends[1], ends[2], ends[3], float(margin))

    @property
    def contents(self) -> frozenset[str]:
        """What this world has of that which a criterion may require."""
        present = {
            "obstacles": self.obstacles or self.raster is not None,
            "keep_out": not (self.keep_out.is_empty and all(z.kind != "keep-out" for z in self.content.zones)),
        }
        return frozenset(name for name, is_present in present.items() if is_present) | self.content.present

    def with_content(
        self,
        *,
        people: Iterable[Person] = (),
        groups: Iterable[Iterable[int]] = (),
        landmarks: Iterable[Landmark] = (),
        zones: Iterable[Zone] = (),
    ) -> World:
        """Return this world with people, conversations (places in ``people``), landmarks and zones in it."""
        content = Content(people, groups, landmarks, zones)  # type: ignore[arg-type]  # it makes tuples of them
        world = replace(self, content=content)
        return world if self.source is None else world.read_from(self.source)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of the extent, m."""
        x0, y0, x1, y1 = shapely.bounds(self.extent)
        return float(x0), float(y0), float(x1), float(y1)

    @property
    def cell(self) -> float:
        """Longest panel (m) for quadrature along a motion, about the spacing of the fields."""
        if self.raster is not None:
            return min(self.raster.resolution, 2 * CELL)
        x0, y0, x1, y1 = self.bounds
        return min(CELL, min(x1 - x0, y1 - y0) / 50)

    # Fields

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        """Signed clearance as a `Field`: positive in free space, minus the distance to it elsewhere.

        Sampled exactly every `cell` metres (more coarsely beyond 25 million samples). Clearance changes by at
        most one metre a metre, so the field is within ``sqrt(2/3) * cell`` (0.82 of a cell) of it everywhere
        in the extent, and usually far closer: check a result with `clearance`, which is exact.
        """
        return self._cached(("clearance", self._active(z)), lambda: sample_clearance(self, self.free_space(z)))

    def obstruction(self, pose: Pose, radius: float) -> Column:
        """Obstructed fraction (M,) in [0, 1] of the ball of ``radius`` (m) round each camera position.

        x and y are arrays or CasADi columns, z numbers. One `Field` is built for each radius and distinct
        height, and kept; at most 16 heights a call. Worlds whose obstacles all have the whole height need
        only one.
        """
        return obstructed(self, pose, radius)

    @property
    def has_heights(self) -> bool:
        """Whether any obstacle has a height range, so that what a camera sees depends on its height."""
        ranges = [o.heights for o in self.obstacles] + ([self.raster.heights] if self.raster else [])
        return any(r != WHOLE for r in ranges)

    def obstruction_field(self, radius: float, z: float = 0.0) -> Field:
        """Obstruction as a `Field` for a ball of ``radius`` (m) at height ``z`` (m).

        Samples are exact; between and at them the spline smooths. With a spacing of at most a tenth of the
        radius the field is within .003 of phi beside straight walls, and within .005 among cells no larger
        than the radius; see `Field` for the general statement.
        """
        if not (math.isfinite(radius) and radius > 0):
            raise OptionError(f"radius must be a finite length above 0 m; got {shown(radius)}.")
        if not math.isfinite(z):
            raise OptionError(f"a camera height must be finite; got {shown(z)}.")
        z = z if self.has_heights else 0.0
        return self._cached(("obstruction", float(radius), z), lambda: sample_obstruction(self, float(radius), z))

    # Saving

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description; `from_description` builds the identical world from it.

        A world read from files stores the reader, its options, the absolute path and the files' SHA-256;
        others store coordinates or compressed cells.
        """
        from hpop.world.description import describe

        return describe(self)

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> World:
        """Build the world that `describe` described; `MapError` if a file has changed since or is missing."""
        from hpop.world.description import build

        return build(description)


def _union(geometries: Sequence[BaseGeometry]) -> BaseGeometry:
    """Union, m; one alone is not computed again, which in a building takes a tenth of a second."""
    filled = [geometry for geometry in geometries if not geometry.is_empty]
    return filled[0] if len(filled) == 1 else shapely.union_all(filled)


def _is_empty(geometry: Any) -> bool:
    """Whether a geometry is empty; what is none is refused elsewhere."""
    return isinstance(geometry, BaseGeometry) and geometry.is_empty


def _or_nothing(geometry: BaseGeometry | None) -> BaseGeometry:
    return MultiPolygon() if geometry is None else geometry
