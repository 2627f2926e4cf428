"""Obstacles as they are seen from the side: those among some paths, each from its lower to its upper end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from hpop.arrays import FloatArray
from hpop.view.ground import View
from hpop.view.paths import Heights
from hpop.view.section import Section
from hpop.world import World

SHADE, EDGE = "#d8cfbf", "#9c9078"
ASIDE = 0.1  # of the paths' longer side: how far beyond their hull obstacles are still beside them
LEAST_ASIDE = 0.4  # m
ENDLESS = 1e5  # m: so far what has no end is drawn


@dataclass(frozen=True)
class Surroundings:
    """What is shown from the side of what stands round some paths.

    among    the hull of the paths on the ground
    beside   the same, grown
    heights  those of the paths
    """

    among: BaseGeometry
    beside: BaseGeometry
    heights: Heights

    @classmethod
    def of(cls, paths: Sequence[FloatArray]) -> Surroundings:
        """Those of paths (N, 3), m."""
        points = np.concatenate(paths)
        hull = shapely.convex_hull(shapely.MultiPoint(points[:, :2]))
        x0, y0, x1, y1 = hull.bounds
        beside = hull.buffer(max(ASIDE * max(x1 - x0, y1 - y0), LEAST_ASIDE))
        return cls(hull, beside, Heights(float(points[:, 2].min()), float(points[:, 2].max())))

    def silhouettes(self, world: World, section: Section) -> list[Polygon]:
        """Outlines in the plane of a section, m, of what is among the paths, and beside them.

        What is beside them at all of their heights is left out: walls of a room would hide all and tell nothing.
        """
        found = []
        for geometry, low, high in _prisms(world):
            at_all = low <= self.heights.low and self.heights.high <= high
            for part in shapely.get_parts(shapely.intersection(geometry, self.among if at_all else self.beside)):
                if part.area > 0.0:
                    along = shapely.get_coordinates(part) @ section.direction
                    found.append(shapely.box(along.min(), max(low, -ENDLESS), along.max(), min(high, ENDLESS)))
        return found


def draw_silhouettes(axes: Axes, found: Sequence[Polygon], view: View) -> list[Patch]:
    """Draw what is solid, light: it may be before the paths or behind them. Returns its legend entry."""
    shown = shapely.box(view.x_min - 1.0, view.y_min - 1.0, view.x_max + 1.0, view.y_max + 1.0)
    outlines = [shapely.get_coordinates(shapely.intersection(shown, one)) for one in found if shown.intersects(one)]
    if not outlines:
        return []
    look: dict[str, Any] = {"facecolor": (SHADE, 0.6), "edgecolor": EDGE, "linewidth": 0.7}
    axes.add_collection(PolyCollection(outlines, zorder=1.0, gid="silhouettes", **look), autolim=False)
    return [Patch(**look, label="obstacle among the paths or beside\nthem, in front of them or behind")]


def tallest(found: Sequence[Polygon]) -> float:
    """The highest upper end, m, of what has one; minus infinity without any."""
    tops = [one.bounds[3] for one in found]
    return max((top for top in tops if top < ENDLESS), default=-np.inf)


def _prisms(world: World) -> Iterator[tuple[BaseGeometry, float, float]]:
    for obstacle in world.obstacles:
        yield obstacle.polygon, *obstacle.heights
    if world.raster is not None:
        yield world.ground.raster_solid(), *world.raster.heights
