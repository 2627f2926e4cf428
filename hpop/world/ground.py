"""Ground of a world: its obstacles, the extent where the robot must stay, and a cache of values derived from them.

People are not part of the ground, so worlds that differ only in people share a ground and its cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import count
from threading import RLock
from typing import Any, NamedTuple, TypeVar
from weakref import WeakSet

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.errors import MapError, OptionError
from hpop.world.bodies import solid_bodies
from hpop.world.fields.field import Field
from hpop.world.fields.sampling import sample_clearance, sample_obstruction
from hpop.world.geometry.cells import CellSpace
from hpop.world.geometry.outlines import check_joinable
from hpop.world.geometry.planar import FreeSpace, without
from hpop.world.geometry.shapes import LARGEST, Obstacle, Raster, check_coordinates, check_prisms, overlaps
from hpop.world.geometry.solids import Solid, check_solids, not_upright

LIMIT = 2_000_000_000
"""Largest total size, bytes, of the derived values that all worlds on one ground cache."""
WHOLE = (-math.inf, math.inf)
CELL = 0.1
"""Spacing of the fields of a world of polygons, m."""
T = TypeVar("T")
Heights = tuple[float, float]


class Cache:
    """Cache of values by key, limited in bytes: least recently used values are dropped first, the last one used never.

    A cache created ``beside`` another one shares its limit and lock. So all worlds on one ground together stay within
    one limit.
    """

    def __init__(self, limit: int | None = None, *, beside: Cache | None = None) -> None:
        budget = _Budget(LIMIT if limit is None else limit) if beside is None else beside._budget
        self._budget: _Budget = budget
        self._values: dict[Hashable, tuple[int, Any]] = {}  # number of the last use, and the value
        with budget.lock:
            budget.caches.add(self)

    @property
    def size(self) -> int:
        """Return the total size of all values, bytes."""
        return sum(nbytes(value) for _, value in self._values.values())

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the value of a key. If it is missing, compute it with ``make`` while other threads wait.

        ``make`` may read other keys.
        """
        with self._budget.lock:
            value = self.find(key)
            if value is None:
                value = make()
                self.keep(key, value)
            return value

    def find(self, key: Hashable) -> Any:
        """Return the value of a key, which then counts as just used, or None if it is missing."""
        with self._budget.lock:
            if key not in self._values:
                return None
            _, value = self._values[key]
            self._values[key] = next(self._budget.uses), value
            return value

    def items(self) -> list[tuple[Any, Any]]:
        """Return all keys with their values."""
        with self._budget.lock:
            return [(key, value) for key, (_, value) in self._values.items()]

    def keep(self, key: Hashable, value: Any) -> None:
        """Store a value, and drop the least recently used values beyond the limit."""
        with self._budget.lock:
            self._values[key] = next(self._budget.uses), value
            self._budget.drop()


class _Budget:
    """Limit, lock and use counter shared by caches."""

    def __init__(self, limit: int) -> None:
        self.limit, self.lock, self.uses = limit, RLock(), count()
        self.caches: WeakSet[Cache] = WeakSet()

    def drop(self) -> None:
        """Drop the least recently used values until the total is within the limit."""
        kept = [
            (used, key, nbytes(value), cache) for cache in self.caches for key, (used, value) in cache._values.items()
        ]
        total = sum(size for _, _, size, _ in kept)
        for _, key, size, cache in sorted(kept, key=lambda item: item[0])[:-1]:
            if total <= self.limit:
                break
            if size:
                total -= size
                del cache._values[key]


def nbytes(value: Any, within: tuple[int, ...] = ()) -> int:
    """Return the memory, bytes, of a value: of all arrays and coordinates in it, its items, or its attributes.

    Caches are not counted, since they have a budget of their own. Nor are values whose ids are in ``within``: a value
    that contains itself, such as a person who is their own prediction, is counted once.
    """
    if isinstance(value, Cache) or id(value) in within:
        return 0
    if isinstance(value, BaseGeometry):
        return 16 * int(shapely.get_num_coordinates(value))
    size = getattr(value, "nbytes", None)
    if isinstance(size, int):
        return size
    parts: Iterable[Any] = ()
    if isinstance(value, tuple | list):
        parts = value
    elif isinstance(value, dict):
        parts = value.values()
    elif type(value).__module__.startswith("hpop."):
        parts, within = vars(value).values(), (*within, id(value))
    return sum(nbytes(part, within) for part in parts)


def extent_of(obstacles: Sequence[Obstacle], raster: Raster | None) -> BaseGeometry:
    """Return the rectangle of a raster, or without a raster the bounding box of the obstacles, m."""
    if raster is not None:
        return raster.rectangle()
    if obstacles:
        return shapely.box(*shapely.total_bounds([o.polygon for o in obstacles]))
    raise MapError("a world without obstacles needs an extent: give the area in which the robot must stay.")


def check_area(name: str, area: BaseGeometry) -> None:
    """Raise MapError unless an area is a valid polygon or multipolygon; ``name`` is for the message."""
    if not isinstance(area, Polygon | MultiPolygon):
        raise MapError(f"{name} must be a valid shapely Polygon or MultiPolygon; got {shown(area)}.")
    check_coordinates(area, name)
    check_joinable([area], name)
    if not area.is_valid:
        reason = shapely.is_valid_reason(area)
        raise MapError(f"{name} is no valid polygon ({reason}); repair it with shapely.make_valid.")


def check_size(extent: BaseGeometry) -> None:
    """Raise MapError for an extent more than `LARGEST` m across: its coordinates are not in metres."""
    x_min, y_min, x_max, y_max = extent.bounds
    if max(x_max - x_min, y_max - y_min) > LARGEST:
        raise MapError(
            f"the world is {x_max - x_min:.3g} x {y_max - y_min:.3g} m, expected at most {LARGEST:,.0f} m across; "
            "check that its coordinates are in metres."
        )


class Layer(NamedTuple):
    """Set of the obstacles that overlap a range of heights, used as a key for cached geometry.

    prisms  indices of the obstacles that overlap the range
    cells   whether the occupied cells of the raster overlap it too
    """

    prisms: tuple[int, ...]
    cells: bool


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Ground:
    """Obstacles of a world and the extent where a robot must stay, m.

    obstacles            upright prisms, including one round each solid; these come last
    raster               occupancy cells, or None
    extent               shapely polygon, m: where the robot must stay; default: the raster's rectangle, or the
                         bounding box of the obstacles
    outside_is_obstacle  whether the area beyond the extent obstructs the camera (at the heights of the raster's
                         cells; at all heights without a raster)
    solids               boxes, cylinders, spheres and hulls in space; ``obstacles`` holds the prisms round them
    path                 file that the ground was read from, or None

    Values derived from these fields are computed on first use, cached, and not pickled. All worlds on this ground share
    them.
    """

    obstacles: tuple[Obstacle, ...] = ()
    raster: Raster | None = None
    extent: BaseGeometry = field(default_factory=MultiPolygon)
    outside_is_obstacle: bool = False
    solids: tuple[Solid, ...] = ()
    path: str | None = field(default=None, init=False)
    cache: Cache = field(default_factory=Cache, init=False, repr=False)

    def __post_init__(self) -> None:
        """Fill in the extent and check the geometries."""
        prisms = check_prisms(self.obstacles)
        # Prisms round solids come from the ground that this one was derived from.
        around = {prism.solid: prism for prism in prisms if prism.solid is not None}
        around |= {solid: Obstacle.around(solid) for solid in check_solids(self.solids) if solid not in around}
        object.__setattr__(self, "solids", tuple(around))
        object.__setattr__(self, "obstacles", (*(p for p in prisms if p.solid is None), *around.values()))
        if not isinstance(self.raster, Raster | None):
            raise MapError(
                f"raster must be a hpop.world.Raster; got {shown(self.raster)}. See World.from_cells(cells)."
            )
        given = self.extent
        nothing = isinstance(given, BaseGeometry) and given.is_empty  # other types are refused below
        extent = extent_of(self.obstacles, self.raster) if nothing else given
        check_area("extent", extent)
        check_size(extent)
        check_joinable([*(o.polygon for o in self.obstacles), extent], "the world")
        object.__setattr__(self, "extent", extent)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for pickling, without the values derived from them."""
        return {key: value for key, value in self.__dict__.items() if key != "cache"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the pickled fields, with an empty cache."""
        self.__dict__.update(state, cache=Cache())

    def derived(self, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        """Return ``make()``, cached under ``key``; besides this ground, the key must name all inputs of ``make``."""
        return self.cache.get(key, make)  # type: ignore[no-any-return]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Return (x_min, y_min, x_max, y_max) of the extent, m."""
        x0, y0, x1, y1 = shapely.bounds(self.extent)
        return float(x0), float(y0), float(x1), float(y1)

    @property
    def cell(self) -> float:
        """Return the longest step, m, for numerical integration along motions: about the sample spacing of fields."""
        if self.raster is not None:
            return min(self.raster.resolution, 2 * CELL)
        x0, y0, x1, y1 = self.bounds
        return min(CELL, min(x1 - x0, y1 - y0) / 50)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes (warnings to print) on solids that planning in the plane replaces by larger upright prisms."""
        return not_upright(self.solids)

    # Solid parts

    @property
    def bodies(self) -> tuple[Solid, ...]:
        """Return all obstacles as convex solids: the given solids, convex pieces of prisms, and boxes of cells.

        Prisms and cells of unlimited height are cut 10 m below or above the floor (z = 0), or 10 m from their other
        end if that is farther. Raises MapError for more than 5,000 bodies of prisms and solids, or of cells.
        """
        return self.derived(("bodies",), lambda: solid_bodies(self.obstacles, self.raster))

    @property
    def has_heights(self) -> bool:
        """Return whether any obstacle has limited height, so that the view depends on the camera's height."""
        ranges = [o.heights for o in self.obstacles] + ([self.raster.heights] if self.raster else [])
        return any(r != WHOLE for r in ranges)

    def layer(self, z: Heights) -> Layer:
        """Return the set of obstacles that overlap an open range of heights (z_min, z_max), m."""
        low, high = float(z[0]), float(z[1])
        if not low <= high:
            raise OptionError(f"a height range must be (z_min, z_max) with z_min <= z_max; got {shown(z)}.")
        prisms = tuple(i for i, o in enumerate(self.obstacles) if overlaps(o.heights, (low, high)))
        return Layer(prisms, self.raster is not None and overlaps(self.raster.heights, (low, high)))

    def raster_solid(self) -> BaseGeometry:
        """Return the union (m) of the occupied cells at all heights; empty without a raster.

        Raises MapError, naming the file, if their outlines have too many corners.
        """

        def make() -> BaseGeometry:
            try:
                return MultiPolygon() if self.raster is None else self.raster.solid()
            except MapError as error:
                if self.path is None:
                    raise
                raise MapError(f"{self.path}: {error}") from None

        return self.derived(("raster",), make)

    def solid(self, z: Heights = WHOLE) -> BaseGeometry:
        """Return the union (m) of all obstacles that overlap the open range of heights ``z``."""
        return self._solid(self.layer(z))

    def _solid(self, layer: Layer) -> BaseGeometry:
        def make() -> BaseGeometry:
            shapes: list[BaseGeometry] = [self.obstacles[i].polygon for i in layer.prisms]
            if layer.cells and not shapes:
                return self.raster_solid()
            return union([*shapes, self.raster_solid()] if layer.cells else shapes)

        return self.derived(("solid", layer), make)

    def obstruction_field(self, radius: float, z: float) -> Field:
        """Return the fraction of a ball of ``radius`` (m) at height ``z`` (m) that is inside obstacles, as a field."""
        z = z if self.has_heights else 0.0
        return self.derived(("obstruction", float(radius), z), lambda: sample_obstruction(self, float(radius), z))

    # Distances to solid parts

    def free_space(self, z: Heights = WHOLE) -> FreeSpace:
        """Return the extent less the obstacles in a range of heights, indexed for exact distances to its border."""
        layer = self.layer(z)

        def make() -> FreeSpace:
            return self.cell_space(layer, self.beside_cells(layer)) or FreeSpace(self.free_region(layer))

        return self.derived(("free", layer), make)

    def free_region(self, layer: Layer, closed: BaseGeometry | None = None) -> BaseGeometry:
        """Return the extent, m, less the obstacles of a layer, and less the region ``closed`` if given."""
        solid = self._solid(layer)
        return without(self.extent, solid if closed is None else union([solid, closed]))

    def beside_cells(self, layer: Layer) -> FreeSpace | None:
        """Return the extent less the prisms of a layer, ignoring its occupied cells; None without prisms."""
        if not layer.prisms:
            return None
        solid = union([self.obstacles[i].polygon for i in layer.prisms])
        return self.derived(("beside cells", layer), lambda: FreeSpace(without(self.extent, solid)))

    def cell_space(
        self, layer: Layer, rest: FreeSpace | None, closed: BaseGeometry | None = None, before: CellSpace | None = None
    ) -> CellSpace | None:
        """Return the free space in a range of heights as a `CellSpace`, in which a few changed cells cost little.

        Return None if this is impossible: without cells, with an extent that is not their rectangle, or if an edge of
        the cells or of ``rest`` is not parallel to an axis.

        Parameters
        ----------
        rest : free space if the cells blocked nothing: the extent less all other blocked regions; None if only cells
            block
        closed : region closed to the robot, in addition to the obstacles of the layer, m
        before : free space of other cells on the same grid; its index is reused
        """
        raster = self.raster if layer.cells else None
        if raster is None or raster.origin[2] != 0.0 or raster.rectangle().wkb != self.extent.wkb:
            return None
        if rest is not None and (rest.edges[:, 0] != rest.edges[:, 1]).all(axis=1).any():
            return None
        return CellSpace(raster, rest, lambda: self.free_region(layer, closed), before)

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        """Return the signed distance (m) to the border of the free space, as a field; see `World.clearance_field`."""
        return self.derived(("clearance", self.layer(z)), lambda: self.sampled_clearance(self.free_space(z), z))

    def sampled_clearance(self, free: FreeSpace, z: Heights) -> Field:
        """Sample the signed distance (m) to the border of a free space, which may exclude more than the obstacles.

        The last result is reused: after people have moved, only samples near them are computed again.
        """
        key = ("last clearance", self.layer(z))
        field = sample_clearance(self, free, self.cache.find(key))
        self.cache.keep(key, (free, field))
        return field

    def __repr__(self) -> str:
        x0, y0, x1, y1 = self.extent.bounds or (0.0,) * 4
        prisms, solids = len(self.obstacles) - len(self.solids), len(self.solids)
        parts = [f"{x1 - x0:.4g} x {y1 - y0:.4g} m from ({x0:.4g}, {y0:.4g})"]
        parts += [f"{name}: {count}" for name, count in (("obstacles", prisms), ("solids", solids)) if count]
        return f"<Ground: {', '.join([*parts, *filter(None, [self.path])])}>"


def union(geometries: Sequence[BaseGeometry]) -> BaseGeometry:
    """Return the union of geometries, m. A single geometry is returned unchanged, which saves time."""
    filled = [geometry for geometry in geometries if not geometry.is_empty]
    return filled[0] if len(filled) == 1 else shapely.union_all(filled)
