"""What is solid in a workspace, and all that follows from it alone: it stays as it is while people come and go."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.errors import MapError, OptionError
from hpop.world.bodies import solid_bodies
from hpop.world.cache import Cache
from hpop.world.extent import check_area, check_size, extent_of
from hpop.world.fields.field import Field
from hpop.world.fields.sampling import sample_clearance, sample_obstruction
from hpop.world.geometry.crossings import check_joinable
from hpop.world.geometry.planar import FreeSpace, without
from hpop.world.geometry.shapes import Obstacle, Raster, check_prisms, overlaps
from hpop.world.geometry.solids import Solid, check_solids, not_upright

WHOLE = (-math.inf, math.inf)
CELL = 0.1
"""Field cell of a polygon world, m."""

T = TypeVar("T")
Heights = tuple[float, float]


class Layer(NamedTuple):
    """What is solid somewhere in a range of heights; geometry is kept by it, as ranges that meet the same are one.

    prisms  places of the obstacles
    cells   whether the raster's cells are
    """

    prisms: tuple[int, ...]
    cells: bool


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Ground:
    """Obstacles, and where a robot must stay, in metres: a world without its content.

    obstacles            upright prisms; those round the solids are the last of them
    raster               occupancy cells, or None
    extent               shapely polygon, m: where the robot must stay; default: the image's rectangle, or the
                         bounding box of the obstacles
    outside_is_obstacle  whether the camera counts all beyond the extent as obstacle (as high as the raster's
                         cells; the whole height without a raster)
    solids               boxes, cylinders, spheres and hulls in space; those whose prisms are among ``obstacles`` too
    path                 the file that all this was read from, or None

    Values derived from these are computed when first needed, kept (:mod:`hpop.world.cache`), and not pickled. They
    serve every world on this ground: another content does not make them anew.
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
        around = {
            prism.solid: prism for prism in prisms if prism.solid is not None
        }  # of a ground of which this is made
        around |= {solid: Obstacle.around(solid) for solid in check_solids(self.solids) if solid not in around}
        object.__setattr__(self, "solids", tuple(around))
        object.__setattr__(self, "obstacles", (*(p for p in prisms if p.solid is None), *around.values()))
        if not isinstance(self.raster, Raster | None):
            raise MapError(
                f"raster must be a hpop.world.Raster; got {shown(self.raster)}. See World.from_cells(cells)."
            )
        given = self.extent
        nothing = isinstance(given, BaseGeometry) and given.is_empty  # what is no geometry is refused below
        extent = extent_of(self.obstacles, self.raster) if nothing else given
        check_area("extent", extent)
        check_size(extent)
        check_joinable([*(o.polygon for o in self.obstacles), extent], "the world")
        object.__setattr__(self, "extent", extent)

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields without what was derived from them."""
        return {key: value for key, value in self.__dict__.items() if key != "cache"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields."""
        self.__dict__.update(state, cache=Cache())

    def derived(self, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        """What ``make`` gives, kept with the ground by a key that says all on which it depends besides."""
        return self.cache.get(key, make)  # type: ignore[no-any-return]

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

    @property
    def notes(self) -> tuple[str, ...]:
        """What a robot in the plane meets otherwise than it is, in words."""
        return not_upright(self.solids)

    # What is solid

    @property
    def bodies(self) -> tuple[Solid, ...]:
        """All that is solid, as convex solids: the given ones, pieces of prisms that were given as such, and cells.

        Prisms and cells without a lower or upper end are cut 10 m below or above the floor (z = 0), or that far from
        the end that they have. Raises MapError where there are more than 5,000.
        """
        return self.derived(("bodies",), lambda: solid_bodies(self.obstacles, self.raster))

    @property
    def has_heights(self) -> bool:
        """Whether any obstacle has a height range, so that what a camera sees depends on its height."""
        ranges = [o.heights for o in self.obstacles] + ([self.raster.heights] if self.raster else [])
        return any(r != WHOLE for r in ranges)

    def layer(self, z: Heights) -> Layer:
        """Which obstacles, and whether the raster, overlap the open range of heights, m."""
        low, high = float(z[0]), float(z[1])
        if not low <= high:
            raise OptionError(f"a height range must be (z_min, z_max) with z_min <= z_max; got {shown(z)}.")
        prisms = tuple(i for i, o in enumerate(self.obstacles) if overlaps(o.heights, (low, high)))
        return Layer(prisms, self.raster is not None and overlaps(self.raster.heights, (low, high)))

    def raster_solid(self) -> BaseGeometry:
        """Union (m) of the occupied cells, whatever their heights; empty without a raster.

        Raises MapError, with the file that they were read from, where their outlines have too many corners.
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
        """Union (m) of all obstacles whose heights overlap the open range."""
        layer = self.layer(z)

        def make() -> BaseGeometry:
            shapes: list[BaseGeometry] = [self.obstacles[i].polygon for i in layer.prisms]
            if layer.cells and not shapes:
                return self.raster_solid()
            return union([*shapes, self.raster_solid()] if layer.cells else shapes)

        return self.derived(("solid", layer), make)

    def obstruction_field(self, radius: float, z: float) -> Field:
        """Obstructed fraction of a ball of ``radius`` (m) at height ``z`` (m); see `World.obstruction_field`."""
        z = z if self.has_heights else 0.0
        return self.derived(("obstruction", float(radius), z), lambda: sample_obstruction(self, float(radius), z))

    # How far the robot is from it

    def free_space(self, z: Heights = WHOLE) -> FreeSpace:
        """Return the extent without what is solid, its border indexed for exact distances."""
        return self.derived(("free", self.layer(z)), lambda: FreeSpace(without(self.extent, self.solid(z))))

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        """Signed distance (m) to the border of the free space, sampled; see `World.clearance_field`."""
        return self.derived(("clearance", self.layer(z)), lambda: self.sampled_clearance(self.free_space(z), z))

    def sampled_clearance(self, free: FreeSpace, z: Heights) -> Field:
        """Sample the signed distance to the border of a free space at these heights, whatever else may block it.

        The last one sampled is kept: where people have moved, only the samples near to them are others.
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
    """Union, m; one alone is not computed again, which in a building takes a tenth of a second."""
    filled = [geometry for geometry in geometries if not geometry.is_empty]
    return filled[0] if len(filled) == 1 else shapely.union_all(filled)
