"""Rays in space against boxes, cylinders, spheres and convex hulls, for cameras that rise and tilt.

Each body is convex, so a line is inside it along one interval, whose ends are known in closed form. Compiled loops
compute many rays at once. For cameras of fixed height the planar methods (:mod:`hpop.world.sight.bearings`,
:mod:`hpop.world.sight.visibility`, fields of obstruction) are faster and have gradients.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.base.math import is_symbolic
from hpop.errors import OptionError
from hpop.runtime import limits
from hpop.world import geometry
from hpop.world.geometry.solids import Box, Cylinder, Hull, Shape, Solid, Sphere

if TYPE_CHECKING:
    from hpop.motions.states import Vector
    from hpop.world.world import World

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""Angle, rad, from one point to the next of a spiral that covers a disc or a sphere evenly (Vogel 1979)."""
CAST = 4096
"""Origins whose rays are cast together."""
ASKED = 2
"""Mark of a ray that is to be tested."""
RAYS = "rays were cast"


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Convex bodies in the form that rays need: intersections of half-spaces, and of an endless cylinder or a ball.

    planes  (P, 4)    outward unit normal of each half-space, and its distance from the origin, m; body by body
    begin   (B + 1,)  index of each body's first plane
    rounds  (B, 8)    of each body: centre, m; axis of its cylinder (0, 0, 0 for a ball); radius of its cylinder or
                      ball (0 without one); radius of a ball round the centre that holds the body, m
    edges   (B + 1,)  index of the first edge of each box and hull; the first twelve of a hull are those of its box
    sides   (E, 4)    of each edge: the two planes that meet in it, as numbers in the box, or among the planes after it;
                      its two corners, in the same way; the first plane's face is to the left as seen from outside
    tips    (B + 1,)  index of the first corner of each box and hull; the first eight of a hull are those of its box
    corners (C, 3)    of boxes and hulls, m

    >>> can = Surfaces.of([Solid(Cylinder(0.1, 0.4), np.eye(4))])
    >>> ahead, up = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    >>> can.first_hits(np.array([[-1.0, 0.0, 0.0]]), np.array([[ahead, up]]), 9.0).round(9)
    array([[0.9, 9. ]])
    """

    planes: FloatArray
    begin: IntArray
    rounds: FloatArray
    edges: IntArray
    sides: NDArray[np.uint32]
    tips: IntArray
    corners: FloatArray

    @classmethod
    def of(cls, solids: Sequence[Solid]) -> Surfaces:
        """Build surfaces from solids in space."""
        planes, rounds = [np.empty((0, 4))], [np.empty((0, 8))]
        sides, corners = [np.empty((0, 4), np.uint32)], [np.empty((0, 3))]
        for solid in solids:
            faces, centre, axis, radius, bound = _form(solid.shape)
            turned, place = solid.pose[:3, :3], solid.pose[:3, 3]
            normals = faces[:, :3] @ turned.T
            planes.append(np.column_stack([normals, faces[:, 3] + normals @ place]))
            rounds.append(np.array([[*(turned @ centre + place), *(turned @ axis), radius, bound]]))
            between, points = _edges(solid.shape, faces)
            sides.append(between)
            corners.append(points @ turned.T + place)
        begin, edges, tips = (np.cumsum([len(each) for each in parts]) for parts in (planes, sides, corners))
        stacked = np.concatenate(planes), begin, np.concatenate(rounds), edges
        return cls(*stacked, np.concatenate(sides), tips, np.concatenate(corners))

    def __len__(self) -> int:
        return len(self.rounds)

    def first_hits(self, origins: FloatArray, directions: FloatArray, reach: float) -> FloatArray:
        """Return the length (N, K), m, of rays until they enter a body; at most ``reach``.

        The rays have unit directions (N, K, 3) and begin at origins (N, 3), m. A body that contains or touches the
        origin, such as the case of the camera, does not stop a ray.
        """
        out = np.full(directions.shape[:2], float(reach))
        if len(self):
            for begin in range(0, len(origins), CAST):
                limits.check(RAYS)
                part = slice(begin, begin + CAST)
                o, d = (np.ascontiguousarray(of[part], dtype=np.float64) for of in (origins, directions))
                geometry._kernels.first_hits(self.planes, self.begin, self.rounds, o, d, float(reach), out[part])
        return out

    def blocked(
        self,
        own: Surfaces,
        poses: FloatArray,
        origins: FloatArray,
        centre: Sequence[float] | FloatArray,
        radius: float,
        rays: int,
    ) -> FloatArray:
        """Return the fraction (N,) of rays from origins (N, 3), m, to a ball that enter a body before they reach it.

        Bodies are these surfaces, and the robot's surfaces ``own``, each of which moves with a frame: poses (B, N, 4,
        4). See :meth:`find_blocked` for the rays.
        """
        found = np.full((len(origins), rays), ASKED, np.int8)
        self.joined(own).find_blocked(len(self), poses, origins, np.array(centre) - origins, radius, found)
        return np.asarray(found.mean(axis=1))

    def find_blocked(
        self,
        fixed: int,
        poses: FloatArray,
        origins: FloatArray,
        offsets: FloatArray,
        radius: float,
        rays: NDArray[np.int8],
    ) -> None:
        """Write to rays (N, K), where they are ASKED, whether rays to a ball enter a body before they reach it: 0 or 1.

        Bodies from number ``fixed`` on move with frames: poses (B - fixed, N, 4, 4). The rays from each origin (N, 3),
        m, are aimed at K points spread evenly over a disc, which has the ball's centre and radius and faces the origin.
        ``offsets`` (N, 3) lead from the origins to the centre. From within the ball, all rays are free.
        """
        limits.check(RAYS)
        arrays = (np.ascontiguousarray(array, dtype=np.float64) for array in (poses, origins, offsets))
        bodies = self.planes, self.begin, self.rounds, self.edges, self.sides, self.tips, self.corners
        disc = over_disc(rays.shape[1])
        geometry._sight_in_space.blocked(*bodies, fixed, *arrays, float(radius), disc, rays)

    def joined(self, other: Surfaces) -> Surfaces:
        """Return these bodies and those of ``other``, in this order."""
        values, starts = ("planes", "rounds", "sides", "corners"), ("begin", "edges", "tips")
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in values}
        for name in starts:
            own, more = getattr(self, name), getattr(other, name)
            arrays[name] = np.append(own, own[-1] + more[1:])
        return Surfaces(**arrays)

    def flow(
        self,
        places: FloatArray,
        axes: FloatArray,
        velocity: FloatArray,
        rotation: FloatArray,
        view: FloatArray,
        reach: float,
        nearest: float,
        angles: FloatArray | None = None,
        *,
        largest: bool,
    ) -> FloatArray:
        """Return the mean or largest angular speed (N,), rad/s, of surfaces that a camera sees; see `_kernels.flow`.

        ``angles`` (N, 2) are the angles of view, rad, if they change; None if all directions of ``view`` are seen.
        """
        half = np.empty((0, 2)) if angles is None else 0.5 * angles
        out = np.empty(len(places))
        for begin in range(0, len(places), CAST):
            limits.check(RAYS)
            part = slice(begin, begin + CAST)
            camera = (np.ascontiguousarray(of[part], dtype=np.float64) for of in (places, axes, velocity, rotation))
            geometry._kernels.flow(
                self.planes, self.begin, self.rounds, *camera, view, half[part], reach, nearest, largest, out[part]
            )
        return out

    def filled(self, centres: FloatArray, radius: float, rays: int) -> FloatArray:
        """Return the fraction (N,) of the ball of ``radius`` m around each centre (N, 3), m, that bodies fill.

        The fraction is measured along ``rays`` rays from each centre, spread evenly over the sphere.
        """
        out = np.zeros(len(centres))
        if len(self):
            directions = over_sphere(rays)
            for begin in range(0, len(centres), CAST):
                limits.check(RAYS)
                part = slice(begin, begin + CAST)
                o = np.ascontiguousarray(centres[part], dtype=np.float64)
                geometry._kernels.filled(self.planes, self.begin, self.rounds, o, directions, float(radius), out[part])
        return out


def surfaces_of(world: World) -> Surfaces:
    """Return the surfaces of all obstacles of a world as convex bodies; cached with its ground."""
    ground = world.ground
    return ground.derived(("bodies for rays",), lambda: Surfaces.of(ground.bodies))


def rows(vector: Vector, size: int) -> FloatArray:
    """Stack the x, y and z of a vector, columns (N,) or numbers, into rows (N, 3); OptionError for CasADi symbols."""
    refuse_symbols(vector)
    return np.stack([np.broadcast_to(column, (size,)) for column in vector], axis=1)


def stacked_poses(poses: Sequence[FloatArray], size: int) -> FloatArray:
    """Stack the poses (N, 4, 4) of B bodies to (B, N, 4, 4); no copy is made if they are the rows of one array."""
    if not poses:
        return np.empty((0, size, 4, 4))
    whole = poses[0].base
    if not isinstance(whole, np.ndarray) or whole.shape != (len(poses), size, 4, 4):
        return np.stack(poses)
    is_whole = all(a.__array_interface__ == b.__array_interface__ for a, b in zip(whole, poses, strict=True))
    return whole if is_whole else np.stack(poses)


def refuse_symbols(columns: Iterable[Column]) -> None:
    """Raise OptionError for CasADi symbols."""
    if any(map(is_symbolic, columns)):
        raise OptionError(
            "rays in space need positions as numbers, but here they are variables of an optimisation; use a planner on "
            "a graph."
        )


def over_sphere(count: int, width: float = 2.0 * math.pi, height: float = math.pi) -> FloatArray:
    """Return unit vectors (count, 3), spread evenly over a field of view centred on +x; by default over the sphere.

    width   rad  whole horizontal angle of the field of view, half of it to each side of +x
    height  rad  whole vertical angle, half of it above and half below the horizontal plane
    """
    number = np.arange(count) + 0.5
    z = math.sin(0.5 * height) * (2.0 * number / count - 1.0)
    across, angle = np.sqrt(1.0 - z * z), width * (number * GOLDEN % (2.0 * math.pi) / (2.0 * math.pi) - 0.5)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def over_disc(count: int) -> FloatArray:
    """Return points (count, 2), spread evenly over the unit disc."""
    number = np.arange(count)
    distance, angle = np.sqrt((number + 0.5) / count), GOLDEN * number
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)


def _edges(shape: Shape, planes: FloatArray) -> tuple[NDArray[np.uint32], FloatArray]:
    """Return the edges of a box or hull, see `Surfaces`: sides (E, 4), corners (C, 3); none for other shapes.

    planes  those of the shape, from `_form`
    """
    nothing = np.empty((0, 4), np.uint32), np.empty((0, 3))
    if not isinstance(shape, Box | Hull):
        return nothing
    high, low, power = planes[:3, 3], -planes[3:6, 3], np.array([1, 2, 4])
    i, j = np.nonzero(np.triu(planes[:6, :3] @ planes[:6, :3].T == 0.0))
    out, along = planes[i, :3] + planes[j, :3], np.cross(planes[i, :3], planes[j, :3])
    sides = np.column_stack([i, j, (out - along > 0.0) @ power, (out + along > 0.0) @ power]).astype(np.uint32)
    corners = np.where(np.arange(8)[:, None] & power, high, low)
    if isinstance(shape, Box):
        return sides, corners
    triangles = shape.triangles
    face = np.unique(np.round(_faces(shape), 12), axis=0, return_inverse=True)[1].ravel()
    a, b, of = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel(), np.repeat(face, 3)
    there, back = np.lexsort((b, a)), np.lexsort((a, b))  # each edge, and the same one as seen from the other triangle
    if not (np.array_equal(a[there], b[back]) and np.array_equal(b[there], a[back])):
        return nothing
    own = (a[there] < b[there]) & (of[there] != of[back])
    there, back = there[own], back[own]
    faces = np.column_stack([of[there], of[back], a[there], b[there]]).astype(np.uint32)
    return np.concatenate([sides, faces]), np.concatenate([corners, shape.points])


def _faces(hull: Hull) -> FloatArray:
    """Return the planes (F, 4) of a hull's triangles: outward unit normals, and distances from the origin, m."""
    a, b, c = (hull.points[hull.triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return np.column_stack([normals, np.sum(normals * a, axis=1)])


def _form(shape: Shape) -> tuple[FloatArray, FloatArray, FloatArray, float, float]:
    """Return planes (P, 4), centre, axis, radius and bounding radius of a shape in its own frame, see `Surfaces`."""
    zero, up = np.zeros(3), np.array([0.0, 0.0, 1.0])
    match shape:
        case Box():
            half = 0.5 * np.array(shape.size)
            normals = np.concatenate([np.eye(3), -np.eye(3)])
            return np.column_stack([normals, np.tile(half, 2)]), zero, zero, 0.0, float(np.linalg.norm(half))
        case Cylinder():
            half_length = 0.5 * shape.length
            ends = np.array([[0.0, 0.0, 1.0, half_length], [0.0, 0.0, -1.0, half_length]])
            return ends, zero, up, shape.radius, math.hypot(shape.radius, half_length)
        case Sphere():
            return np.empty((0, 4)), zero, zero, shape.radius, shape.radius
        case Hull():
            planes = _faces(shape)
            _, once = np.unique(np.round(planes, 12), axis=0, return_index=True)
            low, high = shape.points.min(axis=0), shape.points.max(axis=0)
            centre = 0.5 * (low + high)
            box = np.column_stack([np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([high, -low])])
            planes = np.concatenate([box, planes[once]])  # most lines that miss the hull already miss its box
            return planes, centre, zero, 0.0, float(np.linalg.norm(shape.points - centre, axis=1).max())
