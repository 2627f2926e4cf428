"""World: obstacles, people, landmarks and zones, with queries about free space and about the camera's surroundings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, copied
from hpop.base.math import is_symbolic
from hpop.base.options import LEAST, MOST, real
from hpop.base.table import facts_html, picture_html
from hpop.base.text import shown
from hpop.errors import MapError, OptionError
from hpop.world.bodies import LinkRules, closed_bodies
from hpop.world.content.content import Content, Landmark, Person, Zone
from hpop.world.description import FromFiles, build, describe, facts, summary
from hpop.world.fields.field import Field
from hpop.world.fields.measured import MeasuredField, checked_fields, named_field
from hpop.world.fields.sampling import obstructed
from hpop.world.geometry.outlines import check_joinable
from hpop.world.geometry.planar import FreeSpace, without
from hpop.world.geometry.shapes import Obstacle, Raster, prisms_of
from hpop.world.geometry.solids import MARGIN, Solid, check_solids
from hpop.world.ground import WHOLE, Cache, Ground, Heights, Layer, check_area, union
from hpop.world.occupancy import FromCells

if TYPE_CHECKING:
    from hpop.motions import Pose

T = TypeVar("T")
W = TypeVar("W", bound="World")


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class World(FromCells, FromFiles):
    """Workspace of a robot, in metres, x right and y up (REP-103); build it with a ``from_...`` method.

    ground    obstacles, and the extent where the robot must stay
    keep_out  shapely geometry, m: closed to the robot, invisible to the camera
    notes     warnings to print: parts that a reader left out or repaired, and solids that are no upright prisms
    content   people, landmarks and zones; see `with_content`
    link_rules  rules of a planning scene for an arm's links: padding, scale, pairs that may touch
    fields    quantities that were measured over the floor; see `with_fields`
    source    description of the files that the world was read from, see `describe`; None for other worlds

    Values derived from these fields are computed on first use, cached (:mod:`hpop.world.ground`), and not pickled.
    Values that depend only on the ground are cached with it, so worlds with other people in the same building share
    them.
    """

    ground: Ground
    keep_out: BaseGeometry = field(default_factory=MultiPolygon)
    notes: tuple[str, ...] = ()
    content: Content = field(default_factory=Content)
    link_rules: LinkRules = field(default_factory=LinkRules)
    fields: Sequence[MeasuredField] = ()
    source: Mapping[str, Any] | None = field(default=None, init=False)
    cache: Cache = field(init=False)

    def __post_init__(self) -> None:
        """Check the geometries, and collect notes."""
        if not isinstance(self.ground, Ground):
            raise MapError(
                f"ground must be a hpop.world.Ground, with obstacles and an extent; got {shown(self.ground)}. Rather "
                "build a world with World.from_geojson(path) or World.from_polygons(polygons)."
            )
        check_area("keep_out", self.keep_out)
        measured, said = checked_fields(self.fields, self.ground)
        object.__setattr__(self, "fields", measured)
        object.__setattr__(self, "notes", tuple(dict.fromkeys((*self.notes, *self.ground.notes, *said))))
        areas = [self.keep_out, *(zone.area for zone in self.content.zones)]
        if not all(area.is_empty for area in areas):
            check_joinable([*(o.polygon for o in self.obstacles), self.extent, *areas], "the world")
        object.__setattr__(self, "cache", Cache(beside=self.ground.cache))

    def __repr__(self) -> str:
        return summary(self)

    def _repr_html_(self) -> str:
        notes = [(f"note {number}", note) for number, note in enumerate(self.notes, 1)]
        return facts_html([*facts(self).items(), *notes]) + picture_html(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for pickling, without the values derived from them."""
        return {key: value for key, value in self.__dict__.items() if key != "cache"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the pickled fields, with an empty cache."""
        self.__dict__.update(state, cache=Cache(beside=state["ground"].cache))

    def derived(self, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        """Return ``make()``, cached under ``key``; besides this world, the key must name all inputs of ``make``.

        One thread computes the value while others wait. For values that depend only on the ground use `Ground.derived`.
        """
        return self.cache.get(key, make)  # type: ignore[no-any-return]

    def stand_in(self, kind: type[W]) -> W:
        """Return this world as an object of a subclass, which interprets its fields differently; both share a cache."""
        view = object.__new__(kind)  # nothing is checked or computed again
        view.__dict__.update(self.__dict__)
        return view

    def uncached(self, **of_ground: Any) -> World:
        """Return a copy of this world with an empty cache and the given fields of its ground replaced, unchecked."""
        ground = copied(self.ground, cache=Cache(), **of_ground)
        derived = vars(self).keys() - {each.name for each in fields(self)}
        return copied(self, without=derived, ground=ground, cache=Cache(beside=ground.cache))

    # Constructors

    @classmethod
    def from_polygons(
        cls,
        obstacles: Iterable[BaseGeometry | tuple[BaseGeometry, Heights] | Obstacle],
        *,
        extent: BaseGeometry | None = None,
        keep_out: BaseGeometry | None = None,
    ) -> World:
        """Build a world from shapely polygons, each alone, as (polygon, (z_min, z_max)), m, or as an `Obstacle`.

        By default the extent is the bounding box of the obstacles. ``keep_out`` is closed to the robot, but does not
        obstruct the camera.

        >>> world = World.from_polygons([shapely.box(4, 0, 6, 3)], extent=shapely.box(0, 0, 10, 5))
        >>> world.clearance(np.array([1.0, 3.5, 5.0]), np.array([2.5, 2.0, 1.0]))
        array([1. , 0.5, 0. ])
        """
        if isinstance(extent, BaseGeometry) and extent.is_empty:
            raise MapError("extent is empty, so the robot has no room: give a polygon with an area, or leave it out.")
        return cls(Ground(prisms_of(obstacles), extent=_or_nothing(extent)), _or_nothing(keep_out))

    @classmethod
    def from_solids(cls, solids: Iterable[Solid], *, extent: BaseGeometry | None = None) -> World:
        """Build a world from solids in space; by default the extent is their bounding box, 1 m larger on each side.

        There is no floor unless it is one of the solids. In the plane each solid counts as its enclosing upright prism.

        >>> from hpop.world import Box, pose_at
        >>> world = World.from_solids([Solid(Box((2.0, 3.0, 1.0)), pose_at((5.0, 1.5, 0.5)))])
        >>> world.bounds, world.clearance(np.array([3.25]), np.array([1.0]))
        ((3.0, -1.0, 7.0, 4.0), array([0.25]))
        """
        checked = check_solids(solids)
        if extent is None:
            if not checked:
                raise MapError("a world without solids needs an extent: give the area in which the robot must stay.")
            bounds = np.stack([solid.bounds for solid in checked])
            (x0, y0), (x1, y1) = bounds[:, 0, :2].min(axis=0) - MARGIN, bounds[:, 1, :2].max(axis=0) + MARGIN
            extent = shapely.box(x0, y0, x1, y1)
        elif isinstance(extent, BaseGeometry) and extent.is_empty:
            raise MapError("extent is empty, so the robot has no room: give a polygon with an area, or leave it out.")
        return cls(Ground(extent=extent, solids=checked))

    def read_from(self, source: Mapping[str, Any]) -> World:
        """Return this world with a description of the files it was read from, which `dataclasses.replace` drops."""
        return copied(self, source=source, ground=copied(self.ground, path=source["path"]))

    # Geometry in the plane

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Return the upright prisms, including those that enclose solids."""
        return self.ground.obstacles

    @property
    def bodies(self) -> tuple[Solid, ...]:
        """Return the convex solids that a robot in space must avoid: obstacles, standing people and keep-out zones.

        See `Ground.bodies` for the obstacles. Standing people and keep-out zones are columns from 10 m below the floor
        to 10 m above it. The border of the extent is not among them: it limits only the robot's base.
        """
        return self.derived(("bodies",), lambda: self.ground.bodies + closed_bodies(self.content, self.keep_out))

    @property
    def raster(self) -> Raster | None:
        """Return the occupancy cells, or None in a world without them."""
        return self.ground.raster

    @property
    def extent(self) -> BaseGeometry:
        """Return the area where the robot must stay, m."""
        return self.ground.extent

    @property
    def outside_is_obstacle(self) -> bool:
        """Return whether the area beyond the extent obstructs the camera."""
        return self.ground.outside_is_obstacle

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Return (x_min, y_min, x_max, y_max) of the extent, m."""
        return self.ground.bounds

    @property
    def cell(self) -> float:
        """Return the longest step, m, for numerical integration along motions: about the sample spacing of fields."""
        return self.ground.cell

    @property
    def has_heights(self) -> bool:
        """Return whether any obstacle has limited height, so that the view depends on the camera's height."""
        return self.ground.has_heights

    def solid(self, z_min: float = -math.inf, z_max: float = math.inf) -> BaseGeometry:
        """Return the union (m) of all obstacles that overlap the open range of heights (z_min, z_max)."""
        return self.ground.solid((z_min, z_max))

    @property
    def closed(self) -> BaseGeometry:
        """Return the regions, m, closed to the robot that are not obstacles: keep-out zones and standing people."""
        return self.derived(("closed",), lambda: shapely.union_all([self.keep_out, self.content.closed]))

    @property
    def for_robots(self) -> World:
        """Return the world for collision checks of the robot, with the margin and people set by :meth:`keeping`.

        Its people are left out; a standing person becomes a keep-out zone, enlarged by the margin. Standing people that
        the robot touches at its start are no obstacles in it. Without a margin and such people it is this world itself.
        """
        content = self.content
        if not content.left and not (content.kept and content.bodies):
            return self

        def make() -> World:
            bodies = [Zone("keep-out", body) for i, body in content.bodies.items() if i not in content.left]
            return self.with_content(zones=[*content.zones, *bodies])

        return self.derived(("for robots",), make)

    def keeping(self, margin: float, left: tuple[int, ...] = ()) -> World:
        """Return this world with the margin, m, that a robot keeps from standing people; see :meth:`for_robots`.

        ``left`` are indices of standing people that the robot touches at its start. They are no obstacles in
        :meth:`for_robots`, so that the robot can move away from them.
        """
        content = self.content
        if (content.kept, content.left) == (margin, left):
            return self
        if (margin, left) not in self._kept_clear:
            self._kept_clear[margin, left] = replace(self, content=replace(content, kept=margin, left=left))
        return self._kept_clear[margin, left]

    @cached_property
    def _kept_clear(self) -> dict[tuple[float, tuple[int, ...]], World]:
        """Return the worlds that `keeping` has returned so far by (margin, left), so that derived values are reused."""
        return {}

    def blocked(self, z_min: float = -math.inf, z_max: float = math.inf) -> BaseGeometry:
        """Return the region, m, where the robot must not be: `solid` in a range of heights, and `closed` at any height.

        The robot must also stay in the extent.
        """
        layer = self.ground.layer((z_min, z_max))
        return self.derived(("blocked", layer), lambda: union([self.solid(z_min, z_max), self.closed]))

    def free_space(self, z: Heights = WHOLE) -> FreeSpace:
        """Return the extent less what is `blocked` in a range of heights, indexed for exact distances to its border."""
        if self.closed.is_empty:
            return self.ground.free_space(z)
        layer = self.ground.layer(z)

        def make() -> FreeSpace:
            rest = self.beside_cells(layer) if layer.cells else None
            space = None if rest is None else self.ground.cell_space(layer, rest, self.closed)
            return space or FreeSpace(without(self.extent, self.blocked(*z)))

        return self.derived(("free", layer), make)

    def beside_cells(self, layer: Layer) -> FreeSpace:
        """Return the extent less `closed` (keep-out zones, people) and the prisms of a layer; its cells are ignored."""
        blocked = union([*(self.obstacles[i].polygon for i in layer.prisms), self.closed])
        return self.derived(("beside cells", layer), lambda: FreeSpace(without(self.extent, blocked)))

    def clearance(self, x: Column, y: Column, *, z: Heights = WHOLE) -> Column:
        """Return the distance (M,), m, to the nearest obstacle, keep-out zone, standing person or border of the extent.

        It is 0 inside an obstacle, a keep-out zone or a person, and beyond the extent.

        x and y are (M,) in metres; only obstacles in the range of heights ``z`` count. Exact for arrays (about 1 us per
        point in a building at 0.05 m). For CasADi columns `clearance_field` is used, which is signed and smoothed.
        """
        if is_symbolic(x) or is_symbolic(y):
            return self.clearance_field(z=z)(x, y)
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return self.free_space(z).clearance(np.ravel(x), np.ravel(y)).reshape(x.shape)

    def segments_free(
        self, x0: Column, y0: Column, x1: Column, y1: Column, margin: float, *, z: Heights = WHOLE
    ) -> BoolArray:
        """Return which straight segments (M,) keep ``margin`` (m) from blocked regions and from the extent's border.

        Segments run from (x0, y0) to (x1, y1), columns (M,) in metres; those beyond the extent are not free. The margin
        may be missed by 1e-9 m.
        """
        if not margin >= 0:
            raise OptionError(f"margin must be a distance of at least 0 m; got {shown(margin)}.")
        columns = (np.asarray(c, dtype=np.float64) for c in (x0, y0, x1, y1))
        ends = [np.ravel(c) for c in np.broadcast_arrays(*columns)]
        return self.free_space(z).segments_free(ends[0], ends[1], ends[2], ends[3], float(margin))

    @property
    def contents(self) -> frozenset[str]:
        """Return the kinds of content that this world has: "obstacles", "keep_out", and those of `Content.present`.

        A world with measured fields has "fields", and "field NAME" for each.
        """
        present = {
            "obstacles": self.obstacles or self.raster is not None,
            "keep_out": not (self.keep_out.is_empty and all(z.kind != "keep-out" for z in self.content.zones)),
        }
        named = {name for each in self.fields for name in ("fields", f"field {each.name}")}
        return frozenset(name for name, is_present in present.items() if is_present) | self.content.present | named

    def with_content(
        self,
        *,
        people: Iterable[Person] = (),
        groups: Iterable[Iterable[int]] = (),
        landmarks: Iterable[Landmark] = (),
        zones: Iterable[Zone] = (),
    ) -> World:
        """Return the world with this content in place of all it had; kinds that are not given are empty.

        ``groups`` are conversations: each lists the indices of two or more people.
        """
        content = Content(people, groups, landmarks, zones)  # type: ignore[arg-type]  # it makes tuples of them
        return copied(replace(self, content=content), source=self.source)

    def with_fields(self, fields: Iterable[MeasuredField]) -> World:
        """Return the world with these measured fields in place of those it had; `notes` tell what they leave out."""
        return copied(replace(self, fields=tuple(fields)), source=self.source)

    # Fields

    def field(self, name: str = "") -> Field:
        """Return the measured field with a name, or the only one; MapError if there is no such field."""
        return named_field(self.fields, name)

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        """Return the signed clearance as a `Field`: positive in free space, else minus the distance to free space, m.

        It is sampled exactly every `cell` metres (more coarsely beyond 25 million samples). Clearance changes by at
        most one metre per metre, so the interpolated field is within ``sqrt(2/3) * cell`` (0.82 of a cell) of the
        clearance everywhere in the extent, and usually far closer. To check a result use `clearance`, which is exact.
        The samples end at least 0.5 m beyond the extent; farther away the field is constant.
        """
        if self.closed.is_empty:
            return self.ground.clearance_field(z=z)
        return self.derived(
            ("clearance", self.ground.layer(z)), lambda: self.ground.sampled_clearance(self.free_space(z), z)
        )

    def obstruction(self, pose: Pose, radius: float) -> Column:
        """Return the fraction (M,), in [0, 1], of the ball of ``radius`` (m) round the camera that is inside obstacles.

        In ``pose``, x and y are arrays or CasADi columns, and z are numbers. One `Field` is built and cached for each
        radius and height, so a call may have at most 16 distinct heights. If all obstacles have unlimited height, one
        field serves all heights.
        """
        return obstructed(self, pose, radius)

    def obstruction_field(self, radius: float, z: float = 0.0) -> Field:
        """Return a `Field` of the fraction of a ball of ``radius`` (m) at height ``z`` (m) that is inside obstacles.

        Samples are exact, but the spline between them smooths. With a spacing of at most a tenth of the radius, the
        field is within .003 of the exact fraction beside straight walls, and within .005 among cells no larger than the
        radius; :mod:`hpop.world.fields.field` states the general error.
        """
        radius = real("radius", radius, LEAST, MOST, "a length in m")
        z = real("the height of a camera", z, -MOST, MOST, "a length in m")
        return self.ground.obstruction_field(radius, z)

    # Saving

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description, from which `from_description` builds the world again.

        A world read from files is described by the reader, its options, and the absolute path and SHA-256 of the files.
        Other worlds are described by coordinates or compressed cells.
        """
        return describe(self)

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> World:
        """Build the world of a description; `MapError` if a file is missing or has changed."""
        return build(description)


def _or_nothing(geometry: BaseGeometry | None) -> BaseGeometry:
    return MultiPolygon() if geometry is None else geometry
