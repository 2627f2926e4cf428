"""Solids in space: boxes, cylinders, spheres and convex hulls with poses, for worlds and for arms.

For a robot in the plane each solid counts as the upright prism that encloses it, `Solid.outline` between
`Solid.heights`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray, frozen
from hpop.base.math import not_radians
from hpop.base.options import FARTHEST, LEAST, MOST, real
from hpop.base.text import printable, shown
from hpop.errors import MapError

SAGITTA = 1e-3
"""Largest distance, m, between a circle and the polygon that replaces it; relative to the radius if above 1 m."""
ORTHONORMAL = 1e-6
"""Tolerance of the axes of a pose, which have length 1 and are at right angles."""
TILT = 1e-9
"""Sine of the angle between an axis and the vertical up to which the axis counts as upright."""
MOST_SOLIDS = 5_000
"""Largest number of solids of a world."""
MARGIN = 1.0
"""Distance, m, from the solids to the border of the extent if no extent is given: room for a robot beside them."""
MOST_POINTS = 100_000
"""Largest number of points of a hull: some tenths of a second."""


@checked_arguments
@dataclass(frozen=True)
class Box:
    """Box centred at the origin of its frame, with sides along the axes.

    size  (x, y, z)  m
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if isinstance(self.size, str) or not isinstance(self.size, Iterable) or len(sides := tuple(self.size)) != 3:
            raise MapError(f"a box's size must be 3 numbers, its sides (x, y, z) in m; got {shown(self.size)}.")
        object.__setattr__(self, "size", tuple(_length("a box's size", side) for side in sides))

    @property
    def corners(self) -> FloatArray:
        """Return the eight corners (8, 3), m."""
        ends = [(x, y, z) for z in (-0.5, 0.5) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
        corners: FloatArray = np.array(ends) * np.array(self.size)
        return corners

    def support(self, directions: FloatArray) -> FloatArray:
        """Return how far (N,), m, the box reaches from its centre in each unit direction (N, 3)."""
        reach: FloatArray = np.abs(directions) @ (np.array(self.size) / 2)
        return reach


@checked_arguments
@dataclass(frozen=True)
class Cylinder:
    """Cylinder centred at the origin of its frame, with its axis along z.

    radius, length  m
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        for name in ("radius", "length"):
            object.__setattr__(self, name, _length(f"a cylinder's {name}", getattr(self, name)))

    @property
    def corners(self) -> FloatArray:
        """Return the corners (V, 3), m, of an upright prism that encloses the cylinder."""
        rim = _rim(self.radius)
        return np.concatenate([np.c_[rim, np.full(len(rim), z)] for z in (-self.length / 2, self.length / 2)])

    def support(self, directions: FloatArray) -> FloatArray:
        """Return how far (N,), m, the cylinder reaches from its centre in each unit direction (N, 3)."""
        x, y, z = directions.T
        reach: FloatArray = self.radius * np.hypot(x, y) + self.length / 2 * np.abs(z)
        return reach


@checked_arguments
@dataclass(frozen=True)
class Sphere:
    """Ball centred at the origin of its frame.

    radius  m
    """

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _length("a sphere's radius", self.radius))

    def support(self, directions: FloatArray) -> FloatArray:
        """Return how far (N,), m, the ball reaches from its centre in each unit direction (N, 3): its radius."""
        return np.full(len(directions), self.radius)


@checked_arguments
@dataclass(frozen=True, eq=False)
class Hull:
    """Convex hull of points that are not all in one plane; points that are not corners of the hull are dropped.

    points  (V, 3)  m
    """

    points: FloatArray

    def __post_init__(self) -> None:
        from scipy.spatial import ConvexHull, QhullError  # slow to import

        try:
            points = np.asarray(self.points, dtype=np.float64)
        except (TypeError, ValueError):
            points = np.empty(0)
        if points.ndim != 2 or points.shape[1] != 3 or not 4 <= len(points) <= MOST_POINTS:
            raise MapError(f"a hull needs 4 to {MOST_POINTS:,} points, an array (V, 3) in m; got {shown(self.points)}.")
        if not (np.abs(points) <= MOST).all():
            raise MapError(
                f"a hull's points must be finite numbers from {-MOST:,.0f} to {MOST:,.0f} m; got {shown(self.points)}."
            )
        flat = MapError(
            "a hull needs four points that are not in one plane, or it has no volume. Use a thin box instead."
        )
        if np.ptp(points, axis=0).min() < LEAST:
            raise flat
        try:
            hull = ConvexHull(points)
        except QhullError:
            raise flat from None
        object.__setattr__(self, "points", frozen(points[np.sort(hull.vertices)]))

    @property
    def corners(self) -> FloatArray:
        """Return the corners (V, 3), m."""
        return self.points

    @cached_property
    def triangles(self) -> IntArray:
        """Return the faces as triangles (F, 3) of indices into ``points``, counter-clockwise as seen from outside."""
        from scipy.spatial import ConvexHull  # slow to import

        hull = ConvexHull(self.points)
        a, b, c = (self.points[hull.simplices[:, i]] for i in range(3))
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
        triangles: IntArray = hull.simplices.astype(np.int64)
        triangles[inward] = triangles[inward][:, ::-1]
        return triangles

    @cached_property
    def volume(self) -> float:
        """Return the volume, m³."""
        a, b, c = self.points[self.triangles.T] - self.points.mean(axis=0)
        return float(np.einsum("ij,ij->", np.cross(a, b), c)) / 6

    def support(self, directions: FloatArray) -> FloatArray:
        """Return how far (N,), m, the hull reaches from the origin of its frame in each unit direction (N, 3)."""
        reach: FloatArray = (self.points @ directions.T).max(axis=0)
        return reach


Shape = Box | Cylinder | Sphere | Hull


@checked_arguments
@dataclass(frozen=True, eq=False)
class Solid:
    """Solid body in space: a shape with a pose.

    shape  Box, Cylinder, Sphere or Hull
    pose   (4, 4)  homogeneous, m: from the frame of the shape to the frame of the world, or of a robot link
    name   in messages and pictures

    >>> can = Solid(Cylinder(radius=0.03, length=0.14), pose_at((1.0, 2.0, 0.07)), "can")
    >>> can.heights, can.is_upright, can.outline.area > np.pi * 0.03**2
    ((0.0, 0.14), True, True)
    """

    shape: Shape
    pose: FloatArray
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.shape, Shape):
            raise MapError(f"a solid's shape must be a Box, Cylinder, Sphere or Hull; got {shown(self.shape)}.")
        if not isinstance(self.name, str):
            raise MapError(f"a solid's name must be text; got {shown(self.name)}.")
        object.__setattr__(self, "pose", _checked_pose(self.pose, self.name))

    @property
    def corners(self) -> FloatArray:
        """Return the corners (V, 3), m, of a box or hull, or of a polyhedron that encloses a cylinder.

        Raises MapError for a sphere.
        """
        if isinstance(self.shape, Sphere):
            raise MapError("a sphere has no corners; use its outline, its bounds or its radius.")
        corners: FloatArray = self.shape.corners @ self.pose[:3, :3].T + self.pose[:3, 3]
        return corners

    @cached_property
    def bounds(self) -> FloatArray:
        """Return the exact bounding box (2, 3), m: the least x, y and z, and the greatest x, y and z."""
        reach = self.shape.support(self.pose[:3, :3])
        away = self.shape.support(-self.pose[:3, :3])
        return frozen(np.stack([self.pose[:3, 3] - away, self.pose[:3, 3] + reach]))

    @property
    def heights(self) -> tuple[float, float]:
        """Return the exact heights (z_min, z_max), m."""
        low, high = self.bounds[:, 2].tolist()
        return low, high

    @cached_property
    def outline(self) -> Polygon:
        """Return the outline as seen from above, m: exact for boxes and hulls, else a polygon that encloses it.

        This polygon reaches at most `SAGITTA` beyond it, times the radius in m if that is above 1 m.
        """
        if isinstance(self.shape, Sphere):
            return shapely.Polygon(self.pose[:2, 3] + _rim(self.shape.radius))
        outline: Polygon = shapely.convex_hull(shapely.MultiPoint(self.corners[:, :2]))  # type: ignore[assignment]
        return outline

    @cached_property
    def is_upright(self) -> bool:
        """Return whether the solid is an upright prism, so that its outline and heights describe it in full.

        An upright cylinder counts as one; a sphere never does.
        """
        vertical = np.hypot(self.pose[0, :3], self.pose[1, :3]) <= TILT
        match self.shape:
            case Box():
                return bool(vertical.any())
            case Cylinder():
                return bool(vertical[2])
            case Sphere():
                return False
        low, high = self.heights
        return self.shape.volume >= (1 - 1e-9) * self.outline.area * (high - low)

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description; :meth:`build` turns it into an equal solid."""
        match self.shape:
            case Box():
                shape: dict[str, Any] = {"box": list(self.shape.size)}
            case Cylinder():
                shape = {"cylinder": {"radius": self.shape.radius, "length": self.shape.length}}
            case Sphere():
                shape = {"sphere": self.shape.radius}
            case _:
                shape = {"hull": self.shape.points.tolist()}
        return {**shape, "pose": self.pose[:3].tolist(), "name": self.name}

    @classmethod
    def build(cls, data: Mapping[str, Any]) -> Solid:
        """Build a solid from its description; MapError, TypeError or LookupError if it is malformed."""
        (kind,) = set(data) - {"pose", "name"}
        dimensions = data[kind]
        shapes: dict[str, Any] = {"box": Box, "sphere": Sphere, "hull": Hull}
        shape = Cylinder(**dimensions) if kind == "cylinder" else shapes[kind](dimensions)
        return cls(shape, [*data["pose"], [0.0, 0.0, 0.0, 1.0]], data["name"])  # type: ignore[arg-type]  # a list


def check_solids(solids: Any) -> tuple[Solid, ...]:
    """Return solids as a tuple; `MapError` if there are too many or one is of another type."""
    found = tuple(islice(solids, MOST_SOLIDS + 1)) if isinstance(solids, Iterable) else (solids,)
    if not all(isinstance(solid, Solid) for solid in found):
        raise MapError(
            f"solids must be a list of hpop.world.Solid, each a shape with its pose; got {shown(solids)}. See "
            "World.from_solids(solids) and World.from_moveit_scene(path)."
        )
    if len(found) > MOST_SOLIDS:
        raise MapError(f"a world has at most {MOST_SOLIDS:,} solids; got more. Give a part of it.")
    return found


def not_upright(solids: Sequence[Solid]) -> tuple[str, ...]:
    """Return a note (a warning to print) on solids that are no upright prisms; empty if there are none."""
    names = [solid.name or f"solid {place}" for place, solid in enumerate(solids) if not solid.is_upright]
    if not names:
        return ()
    listed = ", ".join([*(printable(name)[:40] for name in names[:8]), *["..."] * (len(names) > 8)])
    return (
        f"solids that are no upright prisms, {len(names):,} of {len(solids):,} ({listed}): for a robot in the plane, "
        "and for its clearance and obstruction, each counts as the upright prism that encloses it.",
    )


@checked_arguments
def pose_at(
    position: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    rpy: Sequence[float] = (0.0, 0.0, 0.0),
    quaternion: Sequence[float] | None = None,
) -> FloatArray:
    """Return a pose (4, 4), m, from roll, pitch and yaw, rad, about the fixed axes x, y, z, or from a quaternion.

    A quaternion is (x, y, z, w), and is normalised to length 1.
    """
    from scipy.spatial.transform import Rotation  # slow to import

    pose = np.eye(4)
    pose[:3, 3] = _numbers("a position", position, 3)
    if quaternion is not None:
        turned = _numbers("a quaternion (x, y, z, w)", quaternion, 4)
        if not LEAST <= math.hypot(*turned) <= MOST:
            raise MapError(
                f"a quaternion (x, y, z, w) must have a length from {LEAST:g} to {MOST:,.0f}, best 1; got "
                f"{shown(quaternion)}."
            )
        pose[:3, :3] = Rotation.from_quat(turned).as_matrix()
    else:
        angles = _numbers("roll, pitch and yaw", rpy, 3)
        if advice := next(filter(None, map(not_radians, angles)), ""):
            raise MapError(f"each of roll, pitch and yaw {advice}.")
        if any(angles):  # zero angles leave the numbers exactly unchanged
            pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    return pose


def rpy_of(pose: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (3,), rad, about the fixed axes x, y, z, of a pose (4, 4).

    If the x axis of the pose is vertical, roll is 0.

    >>> rpy_of(pose_at(rpy=(0.1, -0.2, 3.0))).round(12).tolist()
    [0.1, -0.2, 3.0]
    """
    turned = pose[:3, :3]
    upright = math.hypot(turned[0, 0], turned[1, 0])
    roll, yaw = math.atan2(turned[2, 1], turned[2, 2]), math.atan2(turned[1, 0], turned[0, 0])
    if upright < LEAST:
        roll, yaw = 0.0, math.atan2(-turned[0, 1], turned[1, 1])
    return np.array([roll, math.atan2(-turned[2, 0], upright), yaw]) + 0.0  # no -0.0


def _checked_pose(pose: Any, name: str) -> FloatArray:
    what = f"the pose of solid {name!r}" if name else "a solid's pose"
    try:
        given = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != (4, 4) or not np.isfinite(given).all() or (given[3] != (0, 0, 0, 1)).any():
        way = f"; for a position write pose_at({tuple(given.tolist())})" if given.shape == (3,) else ""
        raise MapError(f"{what} must be a homogeneous matrix (4, 4), its last row 0, 0, 0, 1; got {shown(pose)}{way}.")
    axes = given[:3, :3]
    if not (np.abs(axes @ axes.T - np.eye(3)) <= ORTHONORMAL).all() or np.linalg.det(axes) < 0:
        raise MapError(f"{what} must turn by a rotation matrix (axes of length 1, at right angles, right-handed).")
    if not (np.abs(given[:3, 3]) <= FARTHEST).all():
        raise MapError(f"{what} must be within {FARTHEST:,.0f} m of the origin.")
    return frozen(given)


def _numbers(what: str, vector: Any, count: int) -> tuple[float, ...]:
    """Return a vector as ``count`` finite floats; MapError otherwise, which names the vector as ``what``."""
    try:
        values = tuple(vector)
    except TypeError:
        values = ()
    if isinstance(vector, str) or len(values) != count:
        raise MapError(f"{what} must be {count} numbers; got {shown(vector)}.")
    return tuple(float(real(what, value, -FARTHEST, FARTHEST, "finite numbers", error=MapError)) for value in values)


def _length(what: str, value: Any) -> float:
    return float(real(what, value, LEAST, MOST, "a length in m", error=MapError))


def _rim(radius: float) -> FloatArray:
    """Return the corners (N, 2), m, of a polygon whose sides touch a circle round the origin from outside.

    The corners are at most `SAGITTA` off the circle, times the radius in m if that is above 1 m.
    """
    excess = SAGITTA / min(radius, 1.0)
    count = max(16, 4 * math.ceil(math.pi / math.acos(1.0 / (1.0 + excess)) / 4))
    angles = 2.0 * math.pi * np.arange(count) / count
    return radius / math.cos(math.pi / count) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
