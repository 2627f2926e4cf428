"""Collision geometry of a robot: upright prisms whose outlines are convex, each a set of corners grown by a radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from hpop.arguments import checked_arguments
from hpop.arrays import FloatArray
from hpop.motions import States


@checked_arguments
@dataclass(frozen=True)
class Part:
    """One convex prism in the frame of the base.

    corners       (x ahead, y left) m; one corner is a disc
    radius        m, by which the hull of the corners is grown
    z_min, z_max  m above the floor
    """

    corners: tuple[tuple[float, float], ...]
    radius: float
    z_min: float
    z_max: float

    @cached_property
    def reach(self) -> float:
        """Distance of the farthest point from the axis of the base, m."""
        return max(math.hypot(*corner) for corner in self.corners) + self.radius

    @property
    def on_axis(self) -> bool:
        """Whether turning in place leaves the part where it is: a disc on the axis."""
        return self.corners == ((0.0, 0.0),)

    def placed(self, states: States) -> FloatArray:
        """Corners (N, c, 2), m, world frame, in each state."""
        ahead, left = np.array(self.corners).T
        cos, sin = np.cos(states.yaw)[:, None], np.sin(states.yaw)[:, None]
        x = states.x[:, None] + cos * ahead - sin * left
        y = states.y[:, None] + sin * ahead + cos * left
        return np.stack([x, y], axis=2)


def convex_parts(outline: tuple[tuple[float, float], ...], z_min: float, z_max: float) -> tuple[Part, ...]:
    """A polygon as convex parts: itself, or its triangles where it is not convex.

    >>> len(convex_parts(((1, 1), (-1, 1), (-1, -1), (1, -1)), 0, 1))
    1
    """
    polygon = shapely.Polygon(outline)
    hull = shapely.convex_hull(polygon)
    convex = hull.area <= polygon.area * (1 + 1e-12)
    pieces = [hull] if convex else shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    rings = [shapely.get_coordinates(piece)[:-1].tolist() for piece in pieces]
    return tuple(Part(tuple((x, y) for x, y in ring), 0.0, z_min, z_max) for ring in rings)
