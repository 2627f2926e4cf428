"""Shapes in the plane: prisms (`Obstacle`) and occupancy cells (`Raster`), each with heights."""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray, frozen
from hpop.base.options import FARTHEST, MOST, real
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.geometry.outlines import check_joinable, outlined
from hpop.world.geometry.solids import Solid

MAX_CELLS = 100_000_000
"""Largest number of cells of a raster that is read, such as 500 m x 500 m at 0.05 m."""
VANISHING = 1e-100
"""Size of a coordinate, m, below which products of two coordinates underflow to 0."""
SMALLEST, LARGEST = 0.1, 1e6
"""Least and greatest longer side of a map that is read, m."""


def check_prisms(obstacles: Any) -> tuple[Obstacle, ...]:
    """Return the obstacles of a world as a tuple; `MapError` unless all are `Obstacle`."""
    prisms = tuple(obstacles) if isinstance(obstacles, Iterable) else (obstacles,)
    if not all(isinstance(prism, Obstacle) for prism in prisms):
        raise MapError(
            f"obstacles must be hpop.world.Obstacle prisms; got {shown(obstacles)}. Rather build a world with "
            "World.from_geojson(path), World.from_polygons([...]) or another from_... method."
        )
    return prisms


def check_heights(heights: Any) -> tuple[float, float]:
    """Return (z_min, z_max), m, as floats; None means unbounded. `MapError` unless z_min < z_max."""
    try:
        low, high = heights
        z_min = -math.inf if low is None else float(low)
        z_max = math.inf if high is None else float(high)
    except (TypeError, ValueError, OverflowError):
        raise MapError(f"heights must be a pair (z_min, z_max) in metres; got {shown(heights)}.") from None
    if not z_min < z_max:
        raise MapError(f"heights must satisfy z_min < z_max; got ({z_min}, {z_max}).")
    if any(math.isfinite(z) and abs(z) > MOST for z in (z_min, z_max)):
        raise MapError(f"heights must be within {MOST:,.0f} m of the floor; got ({z_min:g}, {z_max:g}).")
    return z_min, z_max


def check_pose(origin: Any) -> tuple[float, float, float]:
    """Return an origin (x, y, yaw), metres and radians, as finite floats; `MapError` otherwise."""
    try:
        x, y, yaw = (float(value) for value in origin)
    except (TypeError, ValueError, OverflowError):
        x = y = yaw = math.nan
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(yaw) <= MOST):
        raise MapError(
            f"origin must be three finite numbers [x, y, yaw] (m, m, rad), a place within {FARTHEST:,.0f} m; got "
            f"{shown(origin)}."
        )
    return x, y, yaw


def check_coordinates(geometry: BaseGeometry | NDArray[np.object_], what: str) -> None:
    """Raise MapError for coordinates that are not finite, above `FARTHEST` m, or so small that products underflow.

    ``what`` names the geometry in the message.
    """
    away = np.abs(shapely.get_coordinates(geometry))
    if (far := away[~(away <= FARTHEST)]).size:
        raise MapError(
            f"{what} must have finite coordinates, within {FARTHEST:,.0f} m of the origin; got one {far[0]:g} m away. "
            "Shift it there."
        )
    if (near := away[(away > 0) & (away < VANISHING)]).size:
        raise MapError(f"{what} has a coordinate of {near[0]:g} m, too small for GEOS to compute with; write 0.")


def check_positive(name: str, value: Any) -> float:
    """Return a value as a float from 1e-9 to 1e9; a `MapError` names the quantity otherwise."""
    return float(real(name, value, 1e-9, 1e9, "a number above 0,", error=MapError))


def check_inside(point: Any) -> tuple[float, float] | None:
    """Return the option ``inside``, a point (x, y), m, as floats; None stays None, `MapError` for anything else."""
    if point is None:
        return None
    try:
        x, y = point
    except (TypeError, ValueError):
        raise MapError(f"inside must be a point [x, y] in m; got {shown(point)}.") from None
    x, y = (
        float(real("inside", value, -FARTHEST, FARTHEST, "a point [x, y] in m", error=MapError)) for value in (x, y)
    )
    return x, y


def check_size(height: int, width: int, what: str) -> None:
    """Raise MapError for a raster without cells or with more than `MAX_CELLS`, before memory is allocated."""
    if height < 1 or width < 1:
        raise MapError(f"{what} must have at least one cell; got {width} x {height}.")
    if height * width > MAX_CELLS:
        raise MapError(
            f"{what} is {width} x {height} = {height * width:,} cells; at most {MAX_CELLS:,} are read. "
            "Crop the map or lower its resolution."
        )


def check_span(height: int, width: int, resolution: float, path: Any) -> None:
    """Raise MapError if the resolution (m per cell) makes the longer side of a map less than 0.1 m or above 1000 km."""
    side = max(height, width) * resolution
    if not SMALLEST <= side <= LARGEST:
        raise MapError(
            f"{path}: a resolution of {resolution:g} m makes {width} x {height} cells a map {side:.3g} m across; "
            "give the side of a cell in m as resolution, such as 0.05."
        )


def rotate(x: Any, y: Any, yaw: float) -> tuple[Any, Any]:
    """Rotate plane vectors by `yaw` (rad, counter-clockwise); yaw 0 returns exactly the same numbers."""
    if yaw == 0.0:
        return x, y
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x - s * y, s * x + c * y


def overlaps(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Return whether two open height ranges share a point; touching ranges do not. (z, z) counts as the height z."""
    return a[0] < b[1] and b[0] < a[1]


@checked_arguments
@dataclass(frozen=True, eq=False)
class Obstacle:
    """Upright prism: a polygon between two heights.

    polygon       shapely Polygon   m   outline in the world frame, holes allowed
    z_min, z_max  float             m   -inf and inf: unlimited height
    solid         Solid or None     the solid that this prism encloses; None if the obstacle is itself a prism
    name          str               shown in messages
    contrast      float             0 (a surface without any pattern) to 1; weight of its optic flow
    """

    polygon: Polygon
    z_min: float = -math.inf
    z_max: float = math.inf
    solid: Solid | None = None
    name: str = ""
    contrast: float = 1.0

    def __post_init__(self) -> None:
        """Check the outline, the heights and the contrast."""
        contrast = float(real("the contrast of an obstacle", self.contrast, 0, 1, "a number", error=MapError))
        object.__setattr__(self, "contrast", contrast)
        if not isinstance(self.polygon, Polygon) or self.polygon.is_empty:
            raise MapError(f"an obstacle must be a shapely Polygon with an area; got {shown(self.polygon)}.")
        if not isinstance(self.solid, Solid | None):
            raise MapError(f"an obstacle's solid must be a hpop.world.Solid; got {shown(self.solid)}.")
        check_coordinates(self.polygon, "an obstacle")
        check_joinable([self.polygon], "an obstacle")
        if not self.polygon.is_valid:
            reason = shapely.is_valid_reason(self.polygon)
            raise MapError(f"an obstacle's outline is not valid ({reason}); repair it with shapely.make_valid.")
        z_min, z_max = check_heights((self.z_min, self.z_max))
        object.__setattr__(self, "z_min", z_min)
        object.__setattr__(self, "z_max", z_max)

    @classmethod
    def around(cls, solid: Solid) -> Obstacle:
        """Return the upright prism that encloses a solid."""
        return cls(solid.outline, *solid.heights, solid, solid.name)

    @property
    def heights(self) -> tuple[float, float]:
        """Return (z_min, z_max), m."""
        return self.z_min, self.z_max


def prisms_of(obstacles: Any) -> tuple[Obstacle, ...]:
    """Return prisms from shapely polygons, each alone or as (polygon, (z_min, z_max)), m; MapError otherwise.

    Each part of a MultiPolygon becomes a prism of its own. An `Obstacle` is returned as it is.
    """
    if not isinstance(obstacles, Iterable) or (isinstance(obstacles, np.ndarray) and not obstacles.ndim):
        raise MapError(
            f"obstacles must be a list of shapely polygons; got {shown(obstacles)}. Put a single polygon in brackets."
        )
    prisms = list[Obstacle]()
    for item in obstacles:
        if isinstance(item, Obstacle):
            prisms.append(item)
            continue
        shape, heights = item if isinstance(item, tuple) and len(item) == 2 else (item, (None, None))
        if not isinstance(shape, Polygon | MultiPolygon):
            raise MapError(
                "an obstacle must be a shapely Polygon or MultiPolygon, such as shapely.Polygon([(0, 0), (1, 0), "
                f"(1, 1)]); got {shown(shape)}."
            )
        prisms += [Obstacle(part, *check_heights(heights)) for part in shapely.get_parts(shape)]
    return tuple(prisms)


@checked_arguments
@dataclass(frozen=True, eq=False)
class Raster:
    """Occupancy cells, each an upright square prism.

    cells         (H, W) bool   True is an obstacle; row 0 is at the bottom, so y grows with the row
    resolution    float         m     side of a cell
    origin        (x, y, yaw)   m, m, rad   lower-left corner of cell [0, 0], world frame
    z_min, z_max  float         m     heights of all occupied cells
    contrasts     (H, W) uint8  contrast of each occupied cell, 0 to 100 %; None if it is 100 % everywhere
    """

    cells: BoolArray
    resolution: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    z_min: float = -math.inf
    z_max: float = math.inf
    contrasts: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        """Copy the cells and check sizes and numbers."""
        try:
            cells = np.asarray(self.cells)
        except ValueError:  # numpy refuses ragged rows
            raise MapError(
                f"cells must be a 2-D array of bool (H, W), all rows of one length; got {shown(self.cells)}."
            ) from None
        if cells.ndim != 2 or cells.dtype != np.bool_:
            raise MapError(
                f"cells must be a 2-D array of bool (H, W); got shape {cells.shape}, {cells.dtype}. "
                "Threshold first, e.g. cells > 0.5."
            )
        check_size(cells.shape[0], cells.shape[1], "the raster")
        z_min, z_max = check_heights((self.z_min, self.z_max))
        if self.contrasts is not None and np.shape(self.contrasts) != cells.shape:
            raise MapError(f"contrasts must have the shape of the cells {cells.shape}, got {np.shape(self.contrasts)}")
        object.__setattr__(self, "cells", frozen(cells))
        object.__setattr__(self, "resolution", check_positive("resolution", self.resolution))
        object.__setattr__(self, "origin", check_pose(self.origin))
        object.__setattr__(self, "z_min", z_min)
        object.__setattr__(self, "z_max", z_max)

    @property
    def heights(self) -> tuple[float, float]:
        """Return (z_min, z_max), m."""
        return self.z_min, self.z_max

    def to_world(self, column: Column, row: Column) -> tuple[Any, Any]:
        """Convert points, in cells from the lower-left corner of the raster, to world coordinates (m)."""
        dx, dy = rotate(column * self.resolution, row * self.resolution, self.origin[2])
        return dx + self.origin[0], dy + self.origin[1]

    def contrast(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the contrast, 0 to 1, of the cells at points, m; 1 outside occupied cells."""
        found = np.ones(np.shape(x))
        if self.contrasts is not None:
            along, across = rotate(x - self.origin[0], y - self.origin[1], -self.origin[2])
            rows, columns = (np.floor(at / self.resolution).astype(np.int64) for at in (across, along))
            height, width = self.cells.shape
            inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
            rows, columns = rows[inside], columns[inside]
            found[inside] = np.where(self.cells[rows, columns], self.contrasts[rows, columns] / 100.0, 1.0)
        return found

    def rectangle(self) -> BaseGeometry:
        """Return the rectangle that the cells cover, m."""
        rows, columns = self.cells.shape
        return self._placed(shapely.box(0, 0, columns, rows))

    def solid(self) -> BaseGeometry:
        """Return the exact union of the occupied squares, m; MapError if its outlines have too many corners."""
        return self._placed(outlined(self.cells))

    def _placed(self, geometry: BaseGeometry) -> BaseGeometry:
        def place(points: FloatArray) -> FloatArray:
            return np.stack(self.to_world(points[:, 0], points[:, 1]), axis=1)

        return shapely.transform(geometry, place)


def packed(numbers: NDArray[np.uint8]) -> str:
    """Return numbers as base64 text of compressed bytes; level 9 takes fifteen times as long for a tenth less."""
    return base64.b64encode(zlib.compress(numbers.tobytes(), 6)).decode("ascii")


def unpack_cells(text: str, rows: int, columns: int) -> BoolArray:
    """Unpack cells (rows, columns) from base64 text of zlib-compressed bits; MapError for more or fewer cells.

    At most one byte more is decompressed than these cells take.
    """
    check_size(rows, columns, "the described raster")
    data = unpacked(text, -(-rows * columns // 8), f"{columns} x {rows} cells")
    return np.unpackbits(data, count=rows * columns).reshape(rows, columns).astype(bool)


def unpacked(text: str, size: int, what: str) -> NDArray[np.uint8]:
    """Return the bytes that :func:`packed` packed; MapError unless there are exactly ``size``, those of ``what``."""
    try:
        inflate = zlib.decompressobj()
        data = inflate.decompress(base64.b64decode(text, validate=True), size + 1)
    except (zlib.error, binascii.Error) as error:
        raise MapError(f"the described raster cannot be unpacked: {error}.") from None
    if len(data) != size or not inflate.eof:
        raise MapError(f"the described raster must hold exactly {what}; describe the world anew.")
    return np.frombuffer(data, dtype=np.uint8)
