"""Collision in space by python-fcl: the robot's prisms against obstacles with heights, state by state.

Slower than :mod:`hpop.models.collision.planar` and independent of it, so it is what verifies a result.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from hpop.arrays import BoolArray, FloatArray
from hpop.models.differential_drive.model import DifferentialDrive
from hpop.motions import States

if TYPE_CHECKING:
    from hpop.models.collision.parts import Part
    from hpop.world import World

MARGIN = 1e-6  # m: the robot is shrunk by this, so that touching is no collision


@dataclass(frozen=True, eq=False)
class SolidCollision:
    """Tells which states collide: obstacles, keep-out zones and the border of the extent, in three dimensions."""

    model: DifferentialDrive
    world: World

    @cached_property
    def _top(self) -> float:
        return max(part.z_max for part in self.model.parts)

    @cached_property
    def _obstacles(self) -> Any:
        """Broad-phase manager over convex prisms: everything below the robot's top."""
        import fcl

        objects = []
        for shape, z_min, z_max in self._prisms():
            low, high = max(z_min, -1.0), min(z_max, self._top + 1.0)
            if low >= high:
                continue
            for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(shape)):
                corners = np.array(triangle.exterior.coords[:3])
                objects.append(fcl.CollisionObject(_convex(corners, low, high), fcl.Transform()))
        manager = fcl.DynamicAABBTreeCollisionManager()
        manager.registerObjects(objects)
        manager.setup()
        return manager

    def _prisms(self) -> Iterable[tuple[shapely.Geometry, float, float]]:
        for obstacle in self.world.obstacles:
            yield obstacle.polygon, obstacle.z_min, obstacle.z_max
        if self.world.raster is not None:
            yield self.world.raster.solid(), self.world.raster.z_min, self.world.raster.z_max
        reach = max(part.reach for part in self.model.parts)
        frame = shapely.box(*shapely.buffer(self.world.extent, 2 * reach).bounds)
        yield shapely.difference(frame, self.world.extent), -np.inf, np.inf
        if not shapely.is_empty(self.world.closed):
            yield self.world.closed, -np.inf, np.inf

    def free(self, states: States) -> BoolArray:
        """Whether the robot is free in each state (N,)."""
        import fcl

        robot = [(part, fcl.CollisionObject(_part_geometry(part), fcl.Transform())) for part in self.model.parts]
        free = np.asarray(shapely.intersects_xy(self.world.extent, states.x, states.y))
        for i in np.flatnonzero(free):
            x, y, yaw = (float(column[i]) for column in (states.x, states.y, states.yaw))
            for part, body in robot:
                body.setTransform(_placed(part, x, y, yaw))
                data = fcl.CollisionData()
                self._obstacles.collide(body, data, fcl.defaultCollisionCallback)
                if data.result.is_collision:
                    free[i] = False
                    break
        return free


def _part_geometry(part: Part) -> Any:
    import fcl

    if len(part.corners) == 1:
        return fcl.Cylinder(part.radius - MARGIN, part.z_max - part.z_min - 2 * MARGIN)
    corners = np.array(part.corners)
    centre = corners.mean(axis=0)
    shrunk = centre + (corners - centre) * (1 - MARGIN / part.reach)
    return _convex(shrunk, part.z_min + MARGIN, part.z_max - MARGIN)


def _placed(part: Part, x: float, y: float, yaw: float) -> Any:
    import fcl

    cos, sin = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    if len(part.corners) > 1:
        return fcl.Transform(rotation, np.array([x, y, 0.0]))
    ahead, left = part.corners[0]
    middle = (part.z_min + part.z_max) / 2
    return fcl.Transform(rotation, np.array([x + cos * ahead - sin * left, y + sin * ahead + cos * left, middle]))


def _convex(corners: FloatArray, z_min: float, z_max: float) -> Any:
    """A convex prism over corners (c, 2) in order."""
    import fcl

    count = len(corners)
    if shapely.Polygon(corners).exterior.is_ccw is False:
        corners = corners[::-1]
    vertices = np.vstack([np.c_[corners, np.full(count, z)] for z in (z_min, z_max)])
    faces: list[int] = [count, *range(count - 1, -1, -1), count, *range(count, 2 * count)]
    for i in range(count):
        j = (i + 1) % count
        faces += [4, i, j, count + j, count + i]
    return fcl.Convex(vertices, count + 2, np.array(faces))
