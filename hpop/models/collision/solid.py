"""Collision test for verification, in three dimensions by python-fcl, at sampled states of each motion.

It is slower than :mod:`hpop.models.collision.planar` and independent of it, so it can verify planned results.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import fcl
import numpy as np
import shapely
from numpy.typing import NDArray

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray, IntArray, numbered
from hpop.models.collision import Part, joints_of
from hpop.models.collision.planar import blocking_reason
from hpop.motions import Law, Motions, States, is_curve, slopes

if TYPE_CHECKING:
    from hpop.world import World

MARGIN = 1e-6  # m: the robot is shrunk by this margin, so that touching is no collision
SPACING = 0.05  # m or rad: largest distance between sampled states of a motion
SAMPLES = 2**14  # number of states that are tested in one block
CURVE_STEPS = 8  # the speed along a curve is sampled at so many steps, to choose the number of sampled states
AXES = ("x", "y", "yaw")


@dataclass(frozen=True, eq=False)
class SolidCollision:
    """Collision test in three dimensions with obstacles, keep-out zones and the border of the map.

    parts  collision parts of the robot: upright prisms, placed by x, y, yaw and joints of a state
    world  obstacles and zones

    Motions are sampled at states at most 5 cm or 3 degrees apart. A state that several motions share is tested once.
    """

    parts: tuple[Part, ...]
    world: World

    @cached_property
    def _top(self) -> float:
        return max(part.swept.z_max for part in self.parts)

    @cached_property
    def _names(self) -> tuple[str, ...]:
        """Names of the states that place the parts: x, y, yaw and the joints that carry parts."""
        return (*AXES, *joints_of(self.parts))

    @cached_property
    def _obstacles(self) -> Any:
        """Broad-phase collision manager of all that blocks, up to 1 m above the robot, as prisms over triangles."""
        objects = []
        for shape, z_min, z_max in self._prisms():
            low, high = max(z_min, -1.0), min(z_max, self._top + 1.0)
            if low >= high:
                continue
            for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(shape)):
                corners = np.array(triangle.exterior.coords[:3])
                objects.append(fcl.CollisionObject(_convex_prism(corners, low, high), fcl.Transform()))
        manager = fcl.DynamicAABBTreeCollisionManager()
        manager.registerObjects(objects)
        manager.setup()
        return manager

    def _prisms(self) -> Iterable[tuple[shapely.Geometry, float, float]]:
        """Yield polygon, lower and upper height, m, of all that blocks: obstacles, outside of the map, closed areas."""
        for obstacle in self.world.obstacles:
            yield obstacle.polygon, obstacle.z_min, obstacle.z_max
        if self.world.raster is not None:
            yield self.world.raster.solid(), self.world.raster.z_min, self.world.raster.z_max
        reach = max(part.reach for part in self.parts)
        frame = shapely.box(*shapely.buffer(self.world.extent, 2 * reach).bounds)
        yield shapely.difference(frame, self.world.extent), -np.inf, np.inf
        if not shapely.is_empty(self.world.closed):
            yield self.world.closed, -np.inf, np.inf

    @cached_property
    def _robot(self) -> list[tuple[Part, Any]]:
        return [
            (part, fcl.CollisionObject(_part_geometry(replace(part, on=())), fcl.Transform())) for part in self.parts
        ]

    @checked_arguments
    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""
        rows = np.stack([getattr(states, name) for name in self._names], axis=1)
        return self._rows_free(rows)

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free in all sampled states of each motion (M,), both ends included."""
        law, start, end = motions.law, motions.start, motions.end
        free = np.ones(len(motions), dtype=bool)
        counts = _sample_counts(law, start, end, self._names)
        together = np.cumsum(counts) // SAMPLES
        for part in (np.flatnonzero(together == number) for number in np.unique(together)):
            rows, owner = _sampled_states(law, start.take(part), end.take(part), counts[part], self._names)
            free[part] = np.bincount(owner, ~self._rows_free(rows), minlength=part.size) == 0
        return free

    @checked_arguments
    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        if self.states_free(state)[0]:
            return ""
        blocked = (part for part in self.parts if not SolidCollision((part,), self.world).states_free(state)[0])
        return blocking_reason(self.world, next(blocked), float(state.x[0]), float(state.y[0]))

    @cached_property
    def _plan(self) -> shapely.Geometry:
        """Union of all blocking polygons, seen from above."""
        plan = shapely.union_all([polygon for polygon, _, _ in self._prisms()])
        shapely.prepare(plan)
        return plan

    def _far_from_prisms(self, places: NDArray[np.floating[Any]]) -> BoolArray:
        """Return whether all that blocks is out of the robot's reach, seen from above, at positions (N, 3 + k).

        places  rows of x, y, yaw and joint values; x and y are used
        """
        reach = max(part.reach for part in self.parts)
        near = shapely.dwithin(self._plan, shapely.points(places[:, :2]), reach + MARGIN)
        return ~np.asarray(near, dtype=bool)

    def _rows_free(self, rows: FloatArray) -> BoolArray:
        """Return whether the robot is free in each state (N,), given as rows (N, 3 + k) of x, y, yaw and k joints."""
        yaw = np.zeros(len(rows)) if all(part.on_axis for part in self.parts) else rows[:, 2] % (2 * np.pi)
        places = np.round(
            np.column_stack([rows[:, :2], yaw, rows[:, 3:]]), 9
        )  # a disc on the axis is the same at every yaw
        places, inverse = np.unique(places, axis=0, return_inverse=True)
        free = np.asarray(shapely.intersects_xy(self.world.extent, places[:, 0], places[:, 1]))
        for i in np.flatnonzero(free & ~self._far_from_prisms(places)):
            place = dict(zip(self._names, places[i].tolist(), strict=True))
            for part, body in self._robot:
                body.setTransform(_transform_of(part, place))
                data = fcl.CollisionData()
                self._obstacles.collide(body, data, fcl.defaultCollisionCallback)
                if data.result.is_collision:
                    free[i] = False
                    break
        found: BoolArray = free[inverse.ravel()]
        return found


def _sample_counts(law: Law, start: States, end: States, names: Sequence[str]) -> IntArray:
    """Return at how many states (M,) each motion is sampled, ends included.

    None of the states ``names`` then changes by more than ``SPACING`` from one sample to the next.
    """
    if is_curve(law):
        shares = np.linspace(0.0, 1.0, CURVE_STEPS + 1)
        rates = (slopes(law, name, start, end, share)[0] for share in shares for name in names)
        longest = np.max([np.abs(rate) for rate in rates], axis=0)
    else:
        longest = np.max([np.abs(getattr(end, name) - getattr(start, name)) for name in names], axis=0)
    pieces: IntArray = np.maximum(1, np.ceil(longest / SPACING - 1e-9)).astype(np.int64)
    return pieces + 1


def _sampled_states(
    law: Law, start: States, end: States, counts: IntArray, names: Sequence[str]
) -> tuple[FloatArray, IntArray]:
    """Return the sampled states of motions as rows (N, k), with the index of each row's motion (N,).

    counts  (M,) number of states of each motion, at equal shares of it
    names   names of the k states in a row
    """
    owner, number = numbered(counts)
    share = number / (counts - 1)[owner]
    begin, stop = start.take(owner), end.take(owner)
    columns = (
        law.interpolate(name, begin, stop, share) if name in law.varies else getattr(begin, name) for name in names
    )
    return np.stack([*columns], axis=1), owner


def _part_geometry(part: Part) -> Any:
    if len(part.corners) == 1:
        return fcl.Cylinder(part.radius - MARGIN, part.z_max - part.z_min - 2 * MARGIN)
    corners = np.array(part.corners)
    centre = corners.mean(axis=0)
    shrunk = centre + (corners - centre) * (1 - MARGIN / part.reach)
    return _convex_prism(shrunk, part.z_min + MARGIN, part.z_max - MARGIN)


def _transform_of(part: Part, place: dict[str, float]) -> Any:
    if not part.on:
        return _transform_on_base(part, place["x"], place["y"], place["yaw"])
    frame = _translation(place["x"], place["y"], 0.0) @ _rotation_matrix(place["yaw"])
    for joint in part.on:
        value, (ahead, left) = place[joint.name], joint.at
        if joint.along == "round":
            frame = frame @ _translation(ahead, left, 0.0) @ _rotation_matrix(value) @ _translation(-ahead, -left, 0.0)
        else:
            frame = frame @ _translation(*(value * (joint.along == axis) for axis in ("ahead", "left", "up")))
    if len(part.corners) == 1:
        frame = frame @ _translation(*part.corners[0], (part.z_min + part.z_max) / 2)
    return fcl.Transform(frame[:3, :3], frame[:3, 3])


def _transform_on_base(part: Part, x: float, y: float, yaw: float) -> Any:
    cos, sin = math.cos(yaw), math.sin(yaw)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    if len(part.corners) > 1:
        return fcl.Transform(rotation, np.array([x, y, 0.0]))
    ahead, left = part.corners[0]
    middle = (part.z_min + part.z_max) / 2
    return fcl.Transform(rotation, np.array([x + cos * ahead - sin * left, y + sin * ahead + cos * left, middle]))


def _rotation_matrix(yaw: float) -> FloatArray:
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0, 0.0], [sin, cos, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def _translation(x: float, y: float, z: float) -> FloatArray:
    return np.array([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def _convex_prism(corners: FloatArray, z_min: float, z_max: float) -> Any:
    """Return a python-fcl prism between two heights, m, over a convex polygon with ordered corners (c, 2)."""
    count = len(corners)
    if shapely.Polygon(corners).exterior.is_ccw is False:
        corners = corners[::-1]
    vertices = np.vstack([np.c_[corners, np.full(count, z)] for z in (z_min, z_max)])
    faces: list[int] = [count, *range(count - 1, -1, -1), count, *range(count, 2 * count)]
    for i in range(count):
        j = (i + 1) % count
        faces += [4, i, j, count + j, count + i]
    return fcl.Convex(vertices, count + 2, np.array(faces))
