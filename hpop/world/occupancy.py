"""Build worlds from occupancy cells in memory, and change some cells of a world without computing all values again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray, copied
from hpop.base.options import real, whole
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.fields.field import TiledField
from hpop.world.geometry.cells import FINEST, CellSpace, boxes_of, changed_blocks, on_one_grid, voxels_of
from hpop.world.geometry.shapes import Raster, check_heights
from hpop.world.ground import WHOLE, Ground, Heights

if TYPE_CHECKING:
    from hpop.world.world import World

COARSEST = 1e3  # m, largest side of a cell for points
UNKNOWN, MOST = -1, 100  # values of a nav_msgs/OccupancyGrid
THRESHOLDS = (19, 65)  # percent up to which a cell is free, and from which it is occupied, as in map_saver


class FromCells:
    """Constructors of a `World` from occupancy cells, and the method that changes some of its cells."""

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
    ) -> Self:
        """Build a world from occupancy cells (H, W), row 0 at the bottom; see `Raster` for resolution and origin.

        ``height`` is (z_min, z_max), m, of all occupied cells. The region ``keep_out``, m, is closed to the robot, but
        does not obstruct the camera; with ``outside_is_obstacle`` the area beyond the cells does.

        >>> import hpop
        >>> import numpy as np
        >>> world = hpop.World.from_cells(np.eye(3, dtype=bool), 0.5, outside_is_obstacle=False)
        >>> world.clearance(np.array([0.25]), np.array([0.75]))  # beside the cell in the middle, above the first
        array([0.25])
        """
        raster = Raster(occupied, resolution, origin, *check_heights(height))
        ground = Ground(raster=raster, outside_is_obstacle=outside_is_obstacle)
        return cls(ground, MultiPolygon() if keep_out is None else keep_out)  # type: ignore[call-arg]  # a World

    @classmethod
    def from_points(cls, points: FloatArray, resolution: float, *, extent: BaseGeometry | None = None) -> Self:
        """Build a world from points (N, 3) in space, m, such as those of a depth camera: boxes that cover them all.

        The boxes are the cells of a grid that contain points, merged; ``resolution`` is the side of a cell, m. Points
        without finite coordinates are left out. What lies between points farther apart than a cell is not covered.
        By default the extent is the bounding box of the boxes, 1 m larger on each side. A note of the world says how
        many points, cells and boxes there are.

        Raises MapError for other arrays, for points without any finite ones, and if they make too many boxes.

        >>> import hpop
        >>> world = hpop.World.from_points([(0.01, 0.02, 0.5), (0.14, 0.05, 0.55), (2.0, 0.0, 0.0)], 0.1)
        >>> [(solid.shape.size, solid.pose[:3, 3].round(3).tolist()) for solid in world.ground.solids]
        [((0.2, 0.1, 0.1), [0.1, 0.05, 0.55]), ((0.1, 0.1, 0.1), [2.05, 0.05, 0.05])]
        """
        try:
            given = np.asarray(points, np.float64)
        except (TypeError, ValueError):
            given = np.empty(0)
        if given.ndim != 2 or given.shape[1] != 3:
            raise MapError(f"points must be an array (N, 3), x, y, z in m; got {shown(points)}.")
        resolution = real("resolution", resolution, FINEST, COARSEST, "the side of a cell in m", error=MapError)
        finite = given[np.isfinite(given).all(axis=1)]
        if not len(finite):
            raise MapError(f"points must have finite coordinates, got {len(given):,} points and none that has.")
        cells = voxels_of(finite, resolution)
        solids = boxes_of(cells, resolution)
        left_out = f"; {len(given) - len(finite):,} without finite coordinates are left out" * (
            len(finite) < len(given)
        )
        note = (
            f"{len(finite):,} points fill {len(cells):,} cells of {resolution:g} m, merged into {len(solids):,} boxes"
            f"{left_out}; what lies between points that are farther apart is not covered"
        )
        world = cls.from_solids(solids, extent=extent)  # type: ignore[attr-defined]  # a World
        return replace(world, notes=(note, *world.notes))  # type: ignore[no-any-return]

    @classmethod
    def from_occupancy_grid(
        cls,
        data: Any,
        resolution: float,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        thresholds: tuple[float, float] = THRESHOLDS,
        unknown_is_free: bool = False,
        height: Heights = WHOLE,
        keep_out: BaseGeometry | None = None,
    ) -> Self:
        """Build a world from the data of a nav_msgs/OccupancyGrid in memory.

        Parameters
        ----------
        data : (H, W) integers
            Occupancy in percent, 0 to 100, or -1 for an unknown cell; row 0 at the bottom. From a message ``msg``:
            ``np.reshape(msg.data, (msg.info.height, msg.info.width))``.
        resolution : float
            Side of a cell, m.
        origin : (x, y, yaw) in m, m and rad
            Lower-left corner of cell [0, 0].
        thresholds : (free, occupied) in percent
            A cell is free up to the first and occupied from the second; cells between are unknown.
        unknown_is_free : bool
            Whether unknown cells, and everything beyond the grid, are free rather than obstacles.
        height : (z_min, z_max) in m
            Heights of all obstacle cells.
        keep_out : shapely geometry in m, optional
            Region that is closed to the robot, but does not obstruct the camera.

        Raises MapError for data of another shape, type or range.

        >>> import hpop
        >>> world = hpop.World.from_occupancy_grid(np.array([[0, 100], [0, -1]], np.int8), 0.5)
        >>> world.raster.cells.tolist()
        [[False, True], [False, True]]
        """
        occupied = occupied_cells(data, thresholds, unknown_is_free=bool(unknown_is_free))
        return cls.from_cells(
            occupied,
            resolution,
            origin=cast("tuple[float, float, float]", origin),
            height=height,
            keep_out=keep_out,
            outside_is_obstacle=not unknown_is_free,
        )

    def updated(
        self, data: Any, at: tuple[int, int] | None = None, *, thresholds: tuple[float, float] = THRESHOLDS
    ) -> Self:
        """Return the world with new occupancy in a rectangle of its cells.

        Values derived from the cells, such as distances, are computed again only near changed cells, and equal those
        of a new world. People, landmarks and zones stay. Unknown cells are obstacles if the area beyond the cells is
        one (`World.outside_is_obstacle`), else free. The description of files, ``source``, becomes None.

        Parameters
        ----------
        data : (h, w) integers or bool
            Occupancy in the rectangle, as in :meth:`from_occupancy_grid`, or True for an occupied cell; row 0 at the
            bottom.
        at : (x, y)
            Column and row of the rectangle's lower-left cell, as in a map_msgs/OccupancyGridUpdate. Without it,
            the data must be those of the whole map.

        Raises MapError in a world without cells, for a rectangle that reaches beyond them, and for invalid data.

        >>> import hpop
        >>> world = hpop.World.from_cells(np.zeros((3, 4), dtype=bool), 0.5)
        >>> world.updated([[100, 100]], at=(1, 2)).raster.cells.astype(int).tolist()
        [[0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 1, 0]]
        """
        world = cast("World", self)
        ground, raster = world.ground, world.raster
        if raster is None:
            raise MapError(
                "updated needs a world with occupancy cells, but this one has none; build it with "
                "World.from_occupancy_grid(data, 0.05), for example"
            )
        part = occupied_cells(data, thresholds, unknown_is_free=not ground.outside_is_obstacle)
        rows, columns = raster.cells.shape
        if at is None and part.shape != (rows, columns):
            raise MapError(
                f"without at, the data must have the {columns} x {rows} cells of the map, got {part.shape[1]} x "
                f"{part.shape[0]}; give at=(column, row) of the part's lower-left cell"
            )
        column, row = _corner((0, 0) if at is None else at)
        if row + part.shape[0] > rows or column + part.shape[1] > columns:
            raise MapError(
                f"the part of {part.shape[1]} x {part.shape[0]} cells at column {column} and row {row} reaches beyond "
                f"the map of {columns} x {rows} cells; crop the part, or build a new world from the larger map"
            )
        cells = raster.cells.copy()
        cells[row : row + part.shape[0], column : column + part.shape[1]] = part
        changed = world.uncached(raster=replace(raster, cells=cells), path=None)
        changed = copied(changed, source=None)
        take_over(world, changed)
        return cast(Self, changed)


def occupied_cells(data: Any, thresholds: tuple[float, float], *, unknown_is_free: bool) -> BoolArray:
    """Return which cells (H, W) are occupied, given occupancy in percent, or -1 for unknown.

    Thresholds are (free, occupied), see `FromCells.from_occupancy_grid`. Cells between them, and cells of -1, are
    unknown; they are occupied unless ``unknown_is_free``.

    Data of type bool are returned unchanged. Raises MapError for other data.
    """
    try:
        free, occupied = thresholds
    except (TypeError, ValueError):
        raise MapError(f"thresholds must be (free, occupied) in percent, got {shown(thresholds)}") from None
    low, high = (
        float(real("a threshold", value, 0, MOST, "a number in percent", error=MapError)) for value in (free, occupied)
    )
    if low >= high:
        raise MapError(f"thresholds must rise from free to occupied, got {shown(thresholds)}")
    try:
        cells = np.asarray(data)
    except ValueError:
        raise MapError(f"data must have rows of one length, got {shown(data)}") from None
    if cells.ndim != 2 or not cells.size:
        raise MapError(
            f"data must be a 2-D array (height, width) with cells, got shape {cells.shape}; for a message msg use "
            "np.reshape(msg.data, (msg.info.height, msg.info.width))"
        )
    if cells.dtype == np.bool_:
        return cells
    if cells.dtype.kind not in "iu":
        raise MapError(f"data must be integers from {UNKNOWN} to {MOST}, or bool, got {cells.dtype}; round it first")
    if cells.min() < UNKNOWN or cells.max() > MOST:
        wrong = cells.min() if cells.min() < UNKNOWN else cells.max()
        hint = "; in data of type uint8, 255 is an unknown cell: use data.astype(np.int8)" if wrong == 255 else ""
        raise MapError(f"data must be from {UNKNOWN} (unknown) to {MOST} percent, got {wrong}{hint}")
    return cells >= high if unknown_is_free else (cells < 0) | (cells > low)


def _corner(at: Any) -> tuple[int, int]:
    try:
        column, row = at
    except (TypeError, ValueError):
        raise MapError(f"at must be the column and row of a cell, got {shown(at)}") from None
    column, row = (
        whole("at", value, 0, MOST_CELLS, "whole numbers of cells (column, row)", error=MapError)
        for value in (column, row)
    )
    return column, row


MOST_CELLS = 2**31


def take_over(before: World, after: World) -> None:
    """Copy derived values, such as distances, from a world to one in which some cells have changed.

    Values near changed cells are not copied but computed again, so all values equal those derived from scratch. Nothing
    is copied if obstacles, extent or the grid of cells differ.
    """
    old, new = before.ground, after.ground
    rasters = old.raster, new.raster
    if old is new or rasters[0] is None or rasters[1] is None or not on_one_grid(*cast(Any, rasters)):
        return
    if old.obstacles != new.obstacles or old.extent.wkb != new.extent.wkb:
        return
    for key, value in old.cache.items():
        if new.cache.find(key) is None:
            match key:
                case ("beside cells", _):
                    new.cache.keep(key, value)
                case ("free", layer) if isinstance(value, CellSpace):
                    new.cache.keep(key, new.cell_space(layer, value.rest, before=value))
                case ("obstruction", radius, z) if isinstance(value, TiledField) and not new.obstacles:
                    samples = new.obstruction_field(radius, z)
                    if isinstance(samples, TiledField) and old.outside_is_obstacle == new.outside_is_obstacle:
                        samples.take_over(value, changed_blocks(rasters[0].cells, rasters[1].cells))
    if after.keep_out is not before.keep_out or after.content is not before.content:
        return
    for key, value in before.cache.items():
        if after.cache.find(key) is None:
            match key:
                case ("closed",) | ("beside cells", _):
                    after.cache.keep(key, value)
                case ("free", layer) if isinstance(value, CellSpace):
                    after.cache.keep(key, new.cell_space(layer, value.rest, after.closed, value))
