"""Where the robot must stay: the extent of a world where none is given, and what is asked of it."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.geometry.crossings import check_joinable
from hpop.world.geometry.shapes import LARGEST, Obstacle, Raster, check_coordinates


def extent_of(obstacles: Sequence[Obstacle], raster: Raster | None) -> BaseGeometry:
    """The rectangle of an image, or the bounding box of obstacles, m."""
    if raster is not None:
        return raster.rectangle()
    if obstacles:
        return shapely.box(*shapely.total_bounds([o.polygon for o in obstacles]))
    raise MapError("a world without obstacles needs an extent, the area in which the robot must stay.")


def check_area(name: str, area: BaseGeometry) -> None:
    """Raise MapError unless an area is made of valid polygons."""
    if not isinstance(area, Polygon | MultiPolygon):
        raise MapError(f"{name} must be a valid shapely Polygon or MultiPolygon; got {shown(area)}.")
    check_coordinates(area, name)
    check_joinable([area], name)
    if not area.is_valid:
        raise MapError(f"{name} is no valid polygon: {shapely.is_valid_reason(area)}.")


def check_size(extent: BaseGeometry) -> None:
    """Raise MapError for a world that is larger than any building."""
    x_min, y_min, x_max, y_max = extent.bounds
    if max(x_max - x_min, y_max - y_min) > LARGEST:
        raise MapError(
            f"the world is {x_max - x_min:.3g} x {y_max - y_min:.3g} m; expected metres, at most {LARGEST:,.0f} across."
        )
