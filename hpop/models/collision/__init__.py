"""Collision parts of a robot, and tests with them: in the plane for planning, and by python-fcl for verification.

A part is an upright prism, whose outline is a convex hull grown by a radius.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.models.joints import Joint, carried_point, joint_sum, swept_corners
from hpop.motions import States


@checked_arguments
@dataclass(frozen=True)
class Part:
    """Collision part of a robot: an upright prism, whose outline is the convex hull of its corners grown by a radius.

    corners       (x ahead, y left) m, in the frame of the base; a single corner makes a disc
    radius        m
    z_min, z_max  m above the floor
    on            joints that carry the part, from the base outwards; the geometry is given for joint values of 0
    """

    corners: tuple[tuple[float, float], ...]
    radius: float
    z_min: float
    z_max: float
    on: tuple[Joint, ...] = ()

    @cached_property
    def reach(self) -> float:
        """Largest horizontal distance of the part's points from the axis of the base, m; with joints an upper bound."""
        if self.on:
            return self.swept.reach
        return max(math.hypot(*corner) for corner in self.corners) + self.radius

    @cached_property
    def inner_reach(self) -> float:
        """Radius of the largest disc about the axis of the base that lies in the part, m; 0 for a part on joints."""
        axis, outline = shapely.Point(0.0, 0.0), shapely.convex_hull(shapely.MultiPoint(self.corners))
        if self.on:
            return 0.0
        if outline.geom_type == "Polygon" and shapely.contains(outline, axis):
            return float(shapely.distance(shapely.boundary(outline), axis)) + self.radius
        return max(0.0, self.radius - float(shapely.distance(outline, axis)))

    def covers(self, x: float, y: float) -> bool:
        """Return whether a point (x ahead, y left), m, is within the part's outline, seen from above."""
        outline = shapely.convex_hull(shapely.MultiPoint(self.corners))
        return bool(shapely.distance(outline, shapely.Point(x, y)) <= self.radius + 1e-9)

    @property
    def on_axis(self) -> bool:
        """True for a disc centred on the axis of the base: a turn in place does not change the area that it covers."""
        return self.corners == ((0.0, 0.0),) and all(joint.along == "up" for joint in self.on)

    @cached_property
    def swept(self) -> Part:
        """Part without joints that contains this part at all its joint values; the part itself if it has no joints."""
        if not self.on:
            return self
        points, grown = swept_corners(np.array(self.corners, float), self.on)
        hull = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(points)))
        corners = tuple((x, y) for x, y in (hull[:-1] if len(hull) > 3 else hull).tolist())
        lifts = [(joint.low, joint.high) for joint in self.on if joint.along == "up"]
        low, high = (sum(stops) for stops in zip((0.0, 0.0), *lifts, strict=True))
        return Part(corners, self.radius + grown, self.z_min + low, self.z_max + high)

    def between(self, low: float, high: float) -> Part:
        """Return a part with this outline, between the heights ``low`` and ``high``, m, and without joints."""
        return replace(self, z_min=low, z_max=high, on=())

    def lift(self, states: States) -> FloatArray:
        """Return how far (N,), m, joints lift the part in each state."""
        return np.asarray(np.zeros(states.size) + joint_sum(self.on, "up", states))

    def placed(self, states: States) -> FloatArray:
        """Return the part's corners in the world (N, c, 2), m, in each of the states (N,)."""
        if self.on:
            columns = {name: getattr(states, name)[:, None] for name in ("x", "y", "yaw", *joints_of([self]))}
            ahead, left = np.array(self.corners, float).T[:, None]  # (1, c) each
            return np.stack(carried_point((ahead, left), self.on, States(**columns)).place, axis=2)
        ahead, left = np.array(self.corners).T
        cos, sin = np.cos(states.yaw)[:, None], np.sin(states.yaw)[:, None]
        x = states.x[:, None] + cos * ahead - sin * left
        y = states.y[:, None] + sin * ahead + cos * left
        return np.stack([x, y], axis=2)


def joints_of(parts: Iterable[Part]) -> tuple[str, ...]:
    """Return the names of the joints that carry the given parts; each name is returned once."""
    return tuple(dict.fromkeys(joint.name for part in parts for joint in part.on))


def convex_parts(outline: tuple[tuple[float, float], ...], z_min: float, z_max: float) -> tuple[Part, ...]:
    """Return collision parts that together have the outline of a polygon: one part, or triangles if it is not convex.

    >>> len(convex_parts(((1, 1), (-1, 1), (-1, -1), (1, -1)), 0, 1))
    1
    """
    polygon = shapely.Polygon(outline)
    hull = shapely.convex_hull(polygon)
    convex = hull.area <= polygon.area * (1 + 1e-12)
    pieces = [hull] if convex else shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    rings = [shapely.get_coordinates(piece)[:-1].tolist() for piece in pieces]
    return tuple(Part(tuple((x, y) for x, y in ring), 0.0, z_min, z_max) for ring in rings)


def notes_on_seat(seat: tuple[float, float, float] | None, parts: Iterable[Part]) -> tuple[str, ...]:
    """Return a remark on a seat (ahead, left, height), m, outside the robot's parts, seen from above; else none."""
    if seat is None or any(part.covers(*seat[:2]) for part in parts):
        return ()
    return (
        f"the seat, {seat[0]:g} m ahead and {seat[1]:g} m to the left of the axis, is outside the robot's footprint, "
        "so that collisions of the passenger are not tested; move the seat, or widen the footprint",
    )
