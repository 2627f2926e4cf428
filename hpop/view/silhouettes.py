"""Outlines of obstacles: all of them on a map, or those near some paths in a view from the side.

A camera in a robot's hand moves over, under and between obstacles, so a map of its paths shows
obstacles of all heights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.patches import Patch
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.problems.problem import Problem
from hpop.view.ground import View, draw_obstacles, outline
from hpop.view.robot import solid_outline
from hpop.view.style import Heights
from hpop.world import World

STEP = 15  # degrees
MINUS = "\N{MINUS SIGN}"


@dataclass(frozen=True)
class Section:
    """Vertical plane onto which a view from the side is projected.

    degrees  direction of the plane, counter-clockwise from x: a multiple of 15, above -90 and up to 90
    """

    degrees: int

    @classmethod
    def along(cls, paths: Sequence[FloatArray]) -> Section:
        """Return the plane along the direction in which paths (N, 3), m, spread most; along x if they do not spread."""
        pieces = np.concatenate([np.stack([path[:-1, :2], path[1:, :2]], axis=1) for path in paths])  # (n, 2, 2)
        middle = pieces.mean(axis=1)
        weight = np.hypot(*(pieces[:, 1] - pieces[:, 0]).T)
        if not weight.sum() > 0.0:
            return cls(0)
        off = middle - np.average(middle, axis=0, weights=weight)
        spread = np.einsum("n,ni,nj->ij", weight, off, off)
        yaw = 0.5 * math.atan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1])
        degrees = STEP * round(math.degrees(yaw) / STEP)
        return cls(90 if degrees == -90 else degrees)

    @property
    def direction(self) -> FloatArray:
        """Return the unit vector (2,) along the plane, in the map."""
        yaw = math.radians(self.degrees)
        return np.array([math.cos(yaw), math.sin(yaw)])

    @property
    def label(self) -> str:
        """Return the label of the horizontal axis: x or y of the map, or a combination.

        >>> Section(0).label, Section(90).label, Section(-30).label
        ('x (m)', 'y (m)', 'along −30°: x cos 30° − y sin 30° (m)')
        """
        if self.degrees in (0, 90):
            return "y (m)" if self.degrees else "x (m)"
        angle, sign = f"{abs(self.degrees)}°", "+" if self.degrees > 0 else MINUS
        return f"along {sign.strip('+')}{angle}: x cos {angle} {sign} y sin {angle} (m)"

    def flattened(self, points: FloatArray) -> FloatArray:
        """Project points in space (..., 3), m, to the picture (..., 2): position along the plane, and height."""
        return np.stack([points[..., :2] @ self.direction, points[..., 2]], axis=-1)


LOOK: dict[str, Any] = {"facecolor": ("#d8cfbf", 0.45), "edgecolor": "#9c9078", "linewidth": 0.7}
ASIDE = 0.1  # width of the zone beside the paths' hull, as a share of their longer side
LEAST_ASIDE = 0.4  # m
ENDLESS = 1e5  # m: drawn height of unlimited obstacles


@dataclass(frozen=True)
class PathSurroundings:
    """Area round some paths, which decides which obstacles a view from the side shows.

    among    convex hull of the paths, seen from above
    beside   the hull, grown by a border
    heights  range of the paths' heights
    """

    among: BaseGeometry
    beside: BaseGeometry
    heights: Heights

    @classmethod
    def of(cls, paths: Sequence[FloatArray]) -> PathSurroundings:
        """Return the area round paths (N, 3), m."""
        points = np.concatenate(paths)
        hull = shapely.convex_hull(shapely.MultiPoint(points[:, :2]))
        x0, y0, x1, y1 = hull.bounds
        beside = hull.buffer(max(ASIDE * max(x1 - x0, y1 - y0), LEAST_ASIDE))
        return cls(hull, beside, Heights(float(points[:, 2].min()), float(points[:, 2].max())))

    def silhouettes(self, world: World, section: Section) -> list[Polygon]:
        """Return the outlines, m, of obstacles near the paths, projected to the plane of a side view.

        Prisms and cells beside the paths that span all heights of the paths, such as walls of a room, are left out,
        because they would hide everything.
        """
        solids = (solid for solid in world.ground.solids if solid.outline.intersects(self.beside))
        found = [solid_outline(solid, section.flattened) for solid in solids]
        for geometry, low, high in _prisms(world):
            at_all = low <= self.heights.low and self.heights.high <= high
            for part in shapely.get_parts(shapely.intersection(geometry, self.among if at_all else self.beside)):
                if part.area > 0.0:
                    along = shapely.get_coordinates(part) @ section.direction
                    found.append(shapely.box(along.min(), max(low, -ENDLESS), along.max(), min(high, ENDLESS)))
        return found


def draw_map_obstacles(axes: Axes, problem: Problem, heights: Heights, view: View) -> list[Patch]:
    """Draw obstacles on a map, shaded by the camera's heights if the robot has a base; return the legend entries."""
    world = problem.world
    if "base" in problem.model.provides:
        return draw_obstacles(axes, world, heights, view)
    solid = [*(obstacle.polygon for obstacle in world.obstacles), world.ground.raster_solid()]
    outlines = [outline(geometry) for geometry in solid if not geometry.is_empty]
    axes.add_collection(PathCollection(outlines, zorder=1.0, gid="silhouettes", **LOOK), autolim=False)
    return [Patch(**LOOK, label="obstacle of any height")]


BESIDE = "obstacle among the paths or beside\nthem, in front of them or behind"


def draw_silhouettes(axes: Axes, found: Sequence[Polygon], view: View, label: str = BESIDE) -> list[Patch]:
    """Draw outlines of obstacles lightly, since they may be before or behind the paths; return the legend entry."""
    shown = shapely.box(view.x_min - 1.0, view.y_min - 1.0, view.x_max + 1.0, view.y_max + 1.0)
    outlines = [shapely.get_coordinates(shapely.intersection(shown, one)) for one in found if shown.intersects(one)]
    if not outlines:
        return []
    axes.add_collection(PolyCollection(outlines, zorder=1.0, gid="silhouettes", **LOOK), autolim=False)
    return [Patch(**LOOK, label=label)]


def ends_of(found: Sequence[Polygon]) -> Heights:
    """Return the lowest and highest end of some outlines, m, leaving out unlimited ends; (inf, -inf) for none."""
    ends = np.array([(one.bounds[1], one.bounds[3]) for one in found]).reshape(-1, 2)
    lows, highs = (side[np.abs(side) < ENDLESS] for side in ends.T)
    return Heights(float(lows.min(initial=np.inf)), float(highs.max(initial=-np.inf)))


def _prisms(world: World) -> Iterator[tuple[BaseGeometry, float, float]]:
    """Yield the outline, bottom and top, m, of each obstacle that is an upright prism, and of the raster's cells."""
    for obstacle in world.obstacles:
        if obstacle.solid is None:
            yield obstacle.polygon, *obstacle.heights
    if world.raster is not None:
        yield world.ground.raster_solid(), *world.raster.heights
