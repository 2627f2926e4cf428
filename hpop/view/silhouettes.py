"""Obstacles as they are seen from the side: those among some paths, each from its lower to its upper end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from shapely.geometry.base import BaseGeometry

from hpop.arrays import FloatArray
from hpop.view.ground import View
from hpop.view.section import Section
from hpop.world import World

SHADE, EDGE = "#d8cfbf", "#9c9078"
ASIDE = 0.1  # of the paths' longer side: how far beyond their hull obstacles are still among them
LEAST_ASIDE = 0.25  # m


class Span(NamedTuple):
    """From where to where something is along the section, and from what height to what height, m."""

    begin: float
    end: float
    low: float
    high: float


@dataclass(frozen=True)
class Region:
    """Where on the ground what stands there is shown from the side.

    among   the hull of paths
    beside  the same, grown: there what has an upper or a lower end; walls of a room would hide all
    """

    among: BaseGeometry
    beside: BaseGeometry

    @classmethod
    def of(cls, paths: Sequence[FloatArray]) -> Region:
        """That of paths (N, 3), m."""
        hull = shapely.convex_hull(shapely.MultiPoint(np.concatenate(paths)[:, :2]))
        x0, y0, x1, y1 = hull.bounds
        return cls(hull, hull.buffer(max(ASIDE * max(x1 - x0, y1 - y0), LEAST_ASIDE)))


def spans(world: World, section: Section, region: Region) -> list[Span]:
    """What is solid in a region, as it is seen from the side."""
    found = []
    for geometry, low, high in _prisms(world):
        near = region.beside if math.isfinite(low) or math.isfinite(high) else region.among
        for part in shapely.get_parts(shapely.intersection(geometry, near)):
            if part.area > 0.0:
                along = shapely.get_coordinates(part) @ section.direction
                found.append(Span(float(along.min()), float(along.max()), low, high))
    return found


def draw_silhouettes(axes: Axes, found: Sequence[Span], view: View) -> list[Patch]:
    """Draw what is solid, light: it may be before the paths or behind them. Returns its legend entry."""
    low, high = view.y_min - 1.0, view.y_max + 1.0  # beyond the picture: what has no end
    boxes = [
        shapely.get_coordinates(shapely.box(span.begin, max(span.low, low), span.end, min(span.high, high)))
        for span in found
        if span.begin < view.x_max and span.end > view.x_min and span.low < high and span.high > low
    ]
    if not boxes:
        return []
    look: dict[str, Any] = {"facecolor": (SHADE, 0.6), "edgecolor": EDGE, "linewidth": 0.7}
    axes.add_collection(PolyCollection(boxes, zorder=1.0, gid="silhouettes", **look), autolim=False)
    return [Patch(**look, label="obstacle among the paths or beside\nthem, in front of them or behind")]


def tallest(found: Sequence[Span]) -> float:
    """The highest upper end, m, of what has one; minus infinity without any."""
    return max((span.high for span in found if math.isfinite(span.high)), default=-math.inf)


def _prisms(world: World) -> Iterator[tuple[BaseGeometry, float, float]]:
    for obstacle in world.obstacles:
        yield obstacle.polygon, *obstacle.heights
    if world.raster is not None:
        yield world.ground.raster_solid(), *world.raster.heights
