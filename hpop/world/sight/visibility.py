"""Visibility of landmarks behind obstacles, and openness of the space round a camera, as fields over the plane.

Both are sampled once per ground and camera height, and cached by the ground. Lines of sight are three-dimensional: an
obstacle hides a landmark if the line crosses its outline between its bottom and its top.

An obstacle hides a landmark only if a line from the landmark *enters* it. So a body that contains the landmark (a
display case, or the map cell of a picture) does not hide it, unless the line leaves and re-enters the body. A picture
on a wall needs a ``facing``, or it is also seen from behind the wall.

Obstacles are those of the world, with their heights, and the area beyond the extent if `World.outside_is_obstacle`.
Keep-out zones and people hide nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import Column, FloatArray, IntArray, distinct
from hpop.base.math import is_symbolic
from hpop.base.options import LEAST, MOST, real
from hpop.errors import OptionError
from hpop.runtime import limits
from hpop.world import sight
from hpop.world.content.content import Landmark
from hpop.world.fields.field import PAD, Field, grid_points
from hpop.world.fields.sampling import MAX_HEIGHTS
from hpop.world.sight.bearings import ALL_ROUND, BEHIND, UP_AND_DOWN, in_view, is_whole

if TYPE_CHECKING:
    from hpop.motions import Pose
    from hpop.world.ground import Ground
    from hpop.world.world import World

MAX_NODES = 2_000_000
"""Largest number of samples of a field; a larger world is sampled more coarsely."""
MARGIN = 4
"""Samples added on every side of a window: splines need neighbours, and the outermost samples must be 0."""
SPLIT = 3
"""Each sample is the mean of SPLIT x SPLIT exact lines of sight, spread over its cell."""
RAYS = 360
"""Rays of an isovist."""
FINENESS = 50
"""Largest number of samples of the openness per radius: it changes slowly, and isovists are expensive."""
COARSEST = 0.2
"""Spacing, m, up to which `FINENESS` may make the samples of the openness coarser."""
BEYOND = 1.0
"""Width, m, less two samples, of the obstacle that stands for the outside if the outside is an obstacle."""
SAMPLE = 8
"""Bytes of a sample."""
SCRATCH = 9 * SAMPLE
"""Additional memory per sample, bytes, while lines of sight or isovists are computed."""
SIGHT = "the visibility of landmarks was sampled"
OPENNESS = "the openness was sampled"


class Window(NamedTuple):
    """Samples of a field round a landmark, with their rows and columns on the grid of the world."""

    rows: slice
    columns: slice
    values: FloatArray

    def field(self, ground: Ground) -> Field:
        """Return the samples as a field, constant beyond their border."""
        xs, ys, spacing = _grid(ground)
        return Field(self.values, spacing, (float(xs[self.columns.start]), float(ys[self.rows.start]), 0.0))


def line_of_sight(world: World, landmark: Landmark, camera_z: float, far: float = math.inf) -> Field:
    """Return a `Field` that is 1 where a camera at height ``camera_z``, m, has a free line to a landmark, else 0.

    It is undefined for cameras more than ``far`` m from the landmark, in x or in y. Each sample is the mean of nine
    exact lines spread over its cell, so values between 0 and 1 occur only within two and a half cells of a shadow's
    border.

    >>> from hpop.world import World
    >>> room = World.from_polygons([shapely.box(4, 2, 5, 3)], extent=shapely.box(0, 0, 10, 5))
    >>> line_of_sight(room, Landmark(1.0, 2.5), 1.2)([3.0, 8.0, 8.0], [2.5, 2.5, 0.5]).round(9)
    array([1., 0., 1.])
    """
    key = ("line of sight", landmark, float(camera_z), float(far))
    ground = world.ground
    return ground.derived(key, lambda: _lit(ground, landmark, camera_z, far).field(ground))


def landmark_field(world: World, index: int, camera_z: float, near: float, far: float) -> Field:
    """Return the visibility, in [0, 1], of the landmark ``world.content.landmarks[index]``, for any yaw of the camera.

    It is a product of three factors: 1 if the line of sight is free, else 0; the cosine, at least 0, between the front
    of the landmark and the direction to the camera in the plane (1 without a front); and a factor of distance, which is
    1 up to ``near`` m, then linear to 0 at ``far`` m.
    """
    ground, landmark = world.ground, world.content.landmarks[index]
    key = ("landmark", landmark, float(camera_z), float(near), float(far))
    return ground.derived(key, lambda: _seen(ground, landmark, camera_z, near, far).field(ground))


def _seen(ground: Ground, landmark: Landmark, camera_z: float, near: float, far: float) -> Window:
    """Return the samples of :func:`landmark_field` within a window, outside which they are 0."""
    window = _lit(ground, landmark, camera_z, far)
    xs, ys, _ = _grid(ground)
    dx, dy = (xs[window.columns] - landmark.x)[None, :], (ys[window.rows] - landmark.y)[:, None]
    flat = np.hypot(dx, dy)
    distance = np.hypot(flat, camera_z - landmark.z)
    value = window.values * np.clip((far - distance) / (far - near), 0.0, 1.0)
    if landmark.facing is not None:
        along = dx * math.cos(landmark.facing) + dy * math.sin(landmark.facing)
        value = value * np.where(flat > 0, np.clip(along / np.where(flat > 0, flat, 1.0), 0.0, 1.0), 1.0)
    return window._replace(values=value)


def landmarks_unseen(
    world: World, pose: Pose, *, near: float, far: float, fov: Column = 2 * math.pi, vertical: Column = math.pi
) -> Column:
    """Return the unseen share (M,) of all landmarks, in [0, 1]: 1 - their weighted mean visibility.

    :func:`landmark_field` explains visibility, ``near`` and ``far``; out of view, visibility is 0. A landmark is in
    view if its bearing is within ``fov`` / 2 of the camera's yaw and its elevation within ``vertical`` / 2 of its
    pitch, rad; on symbols these edges are smoothed. Roll is ignored.
    """
    if is_whole(fov, ALL_ROUND) and is_whole(vertical, UP_AND_DOWN):
        return _by_height(pose, lambda z: _unseen_all_round(world, z, near, far)(pose.x, pose.y))
    angles = [fov, vertical, pose.yaw, *([] if is_whole(vertical, UP_AND_DOWN) else [pose.pitch])]
    if any(map(is_symbolic, (pose.x, pose.y, *angles))):
        return _by_height(pose, lambda z: _unseen_on_symbols(world, pose, z, near, far, fov, vertical))
    return _by_height(pose, lambda z: _unseen_in_view(world, pose, z, near, far, fov, vertical))


def sees(world: World, pose: Pose, landmark: Landmark, *, far: float) -> Column:
    """Return which poses (M,) of a camera see a landmark: from its front, within ``far`` m, with a free line to it.

    The camera may look in any direction. Poses must be numbers, not CasADi symbols.
    """
    dx, dy = pose.x - landmark.x, pose.y - landmark.y
    free = _by_height(pose, lambda z: line_of_sight(world, landmark, z, far)(pose.x, pose.y)) > 0.5
    close = dx * dx + dy * dy + (pose.z - landmark.z) ** 2 <= far * far
    if landmark.facing is None:
        return free & close
    return free & close & (dx * math.cos(landmark.facing) + dy * math.sin(landmark.facing) > 0.0)


def openness(world: World, pose: Pose, radius: float) -> Column:
    """Return the visible fraction (M,), 0 to 1, of the disc of ``radius`` m round the camera; see `openness_field`."""
    return _by_height(pose, lambda z: openness_field(world, z, radius)(pose.x, pose.y))


def openness_field(world: World, camera_z: float, radius: float) -> Field:
    """Return the visible fraction, in [0, 1], of the disc of ``radius`` m round a camera at a height, m, as a field.

    It is the area of the isovist, ½ ∫ R(θ)² dθ, over pi radius². R, at most ``radius``, is the distance along 360 rays
    to the first obstacle at the camera's height; 0 within obstacles. A ray at the edge of a gap changes the result by
    at most 1/360.
    """
    radius = real("the radius of an isovist", radius, LEAST, MOST, "a length in m")
    ground = world.ground
    key = ("openness", ground.layer((camera_z, camera_z)), float(radius))
    return ground.derived(key, lambda: _sample_openness(ground, float(camera_z), float(radius)))


def _by_height(pose: Pose, evaluate: Callable[[float], Column]) -> Column:
    """Evaluate a function of the camera height for each distinct height of the poses; return the values (M,)."""
    if is_symbolic(pose.z):
        raise OptionError("visibility needs camera heights as numbers, not variables; use a planner on a graph.")
    heights = np.asarray(pose.z, dtype=np.float64)
    if heights.size and heights.min() == heights.max():
        return evaluate(float(heights.flat[0]))
    several = distinct(heights)
    if several.size > MAX_HEIGHTS:
        raise OptionError(
            f"visibility needs a field for each camera height, at most {MAX_HEIGHTS}; got {several.size} distinct "
            "heights. Round the heights."
        )
    return sum((np.where(heights == z, 1.0, 0.0) * evaluate(float(z)) for z in several), start=0.0 * pose.x)


# Landmarks


def _shares(world: World) -> FloatArray:
    """Return the weights (L,) of the landmarks, normalised to sum 1."""
    weights = np.array([landmark.weight for landmark in world.content.landmarks], dtype=np.float64)
    shares: FloatArray = weights / weights.sum()
    return shares


def _fields(world: World, z: float, near: float, far: float) -> list[Field]:
    return [landmark_field(world, i, z, near, far) for i in range(len(world.content.landmarks))]


def _unseen_all_round(world: World, z: float, near: float, far: float) -> Field:
    ground, landmarks = world.ground, world.content.landmarks

    def make() -> Field:
        xs, ys, spacing = _grid(ground)
        limits.hold(SIGHT, xs.size * ys.size * SAMPLE, xs.size * ys.size * (SCRATCH + SAMPLE))
        seen = np.zeros((ys.size, xs.size))
        for share, landmark in zip(_shares(world), landmarks, strict=True):
            window = _seen(ground, landmark, z, near, far)
            seen[window.rows, window.columns] += share * window.values
        return Field(np.clip(1.0 - seen, 0.0, 1.0), spacing, (float(xs[0]), float(ys[0]), 0.0))

    return ground.derived(("landmarks", landmarks, z, float(near), float(far)), make)


def _unseen_on_symbols(
    world: World, pose: Pose, z: float, near: float, far: float, fov: Column, vertical: Column
) -> Column:
    seen = 0.0
    for share, field, mark in zip(_shares(world), _fields(world, z, near, far), world.content.landmarks, strict=True):
        seen = seen + share * field(pose.x, pose.y) * in_view(pose, mark, fov, vertical)
    return np.maximum(1.0 - seen, 0.0)


def _unseen_in_view(
    world: World, pose: Pose, z: float, near: float, far: float, fov: Column, vertical: Column
) -> FloatArray:
    """Return `landmarks_unseen` (M,) for poses given as numbers. All landmarks share the spline weights of a pose."""
    ground, landmarks = world.ground, world.content.landmarks

    def make() -> tuple[FloatArray, IntArray]:
        sizes = [_part(ground, landmark, far) for landmark in landmarks]
        samples = [(r.stop - r.start) * (c.stop - c.start) for r, c in sizes]
        limits.hold(SIGHT, sum(samples) * SAMPLE, 2 * sum(samples) * SAMPLE + max(samples) * SCRATCH)
        seen = [_seen(ground, landmark, z, near, far) for landmark in landmarks]
        begin = np.cumsum([0, *(window.values.size for window in seen)])
        boxes = [(w.rows.start, w.values.shape[0], w.columns.start, w.values.shape[1]) for w in seen]
        parts = [(share * w.values).ravel() for share, w in zip(_shares(world), seen, strict=True)]
        return np.concatenate(parts), np.column_stack([begin[:-1], boxes])

    values, windows = ground.derived(("landmarks in view", landmarks, z, float(near), float(far)), make)
    marks = np.array([(mark.x, mark.y, mark.z - z) for mark in landmarks])
    xs, ys, spacing = _grid(ground)
    x, y, yaw = np.broadcast_arrays(*(np.asarray(c, dtype=np.float64) for c in (pose.x, pose.y, pose.yaw)))
    limited = not is_whole(vertical, UP_AND_DOWN)
    across, up = (np.array(np.broadcast_to(angle, x.shape), np.float64).ravel() for angle in (fov, vertical))
    pitch = np.array(np.broadcast_to(pose.pitch, x.shape), np.float64).ravel() if limited else np.empty(0)
    corner = (float(xs[0]) - PAD * spacing, float(ys[0]) - PAD * spacing)
    out = np.empty(x.size)
    sight._kernels.unseen(
        values,
        windows,
        (ys.size, xs.size),
        marks,
        np.where(across < ALL_ROUND, np.cos(0.5 * across), BEHIND),
        0.5 * up,
        *corner,
        spacing,
        x.ravel(),
        y.ravel(),
        yaw.ravel(),
        pitch,
        out,
    )
    return out.reshape(x.shape)


def _lit(ground: Ground, landmark: Landmark, camera_z: float, far: float) -> Window:
    """Return a window of samples up to ``far`` m from a landmark in x and y: the fractions of free lines of sight."""
    limits.check(SIGHT)
    xs, ys, spacing = _grid(ground)
    rows, columns = _part(ground, landmark, far)
    edges, bottom, top = _outlines(ground)
    near, beyond = _hiding(bottom, top, landmark.z, camera_z)
    hides = near < beyond
    step = spacing / SPLIT
    first = (SPLIT - 1) / 2
    corner = np.array([xs[0] - first * step, ys[0] - first * step])
    shape = rows.stop - rows.start, columns.stop - columns.start
    turns = np.zeros((shape[0] * SPLIT, shape[1] * SPLIT + 1), dtype=np.int64)
    light = (np.array([landmark.x, landmark.y]) - corner) / step
    lines = (edges[hides] - np.tile(corner, 2)) / step
    whole = ys.size * SPLIT, xs.size * SPLIT
    part = rows.start * SPLIT, columns.start * SPLIT
    sight._kernels.shadows(lines, near[hides], beyond[hides], light[0], light[1], whole, *part, turns)
    out = np.zeros(shape)
    sight._kernels.lit(turns, SPLIT, out)
    return Window(rows, columns, np.clip(out, 0.0, 1.0))


def _part(ground: Ground, landmark: Landmark, far: float) -> tuple[slice, slice]:
    """Return the rows and columns of the samples up to ``far`` m from a landmark, with a margin."""
    xs, ys, _ = _grid(ground)
    return _within(ys, landmark.y, far), _within(xs, landmark.x, far)


def _within(places: FloatArray, centre: float, far: float) -> slice:
    """Return the range of samples of an axis up to ``far`` m from a centre, with a margin; at least one sample."""
    first, last = np.searchsorted(places, [centre - far, centre + far])
    first, last = max(0, int(first) - MARGIN), min(places.size, int(last) + MARGIN)
    return slice(min(first, places.size - 1), max(last, 1))


def _hiding(bottom: FloatArray, top: FloatArray, landmark_z: float, camera_z: float) -> tuple[FloatArray, FloatArray]:
    """Return where the shadow of each edge begins and ends (E,), in multiples of its distance from the landmark.

    At a fraction t of the way to the camera the line of sight has height z(t). It is between bottom and top of a prism
    for t in (low, high), wherever the camera is. So an outline at distance d hides cameras at distances from d / high
    to d / low.
    """
    rise = camera_z - landmark_z
    if abs(rise) < 1e-9:
        within = (bottom < camera_z) & (camera_z < top)
        return np.where(within, 1.0, np.inf), np.full(bottom.shape, np.inf)
    ends = np.sort(np.stack([bottom - landmark_z, top - landmark_z]) / rise, axis=0)
    low, high = np.clip(ends, 0.0, 1.0)
    hides = high > low
    touches = low < 1e-9  # the prism reaches the landmark's height: endless shadow
    far = np.where(touches, np.inf, 1.0 / np.where(touches, 1.0, low))
    return np.where(hides, 1.0 / np.where(hides, high, 1.0), np.inf), far


# Isovists


def _sample_openness(ground: Ground, camera_z: float, radius: float) -> Field:
    xs, ys, spacing = _grid(ground, min(radius / FINENESS, COARSEST))
    limits.hold(OPENNESS, xs.size * ys.size * SAMPLE, xs.size * ys.size * SCRATCH)
    x, y = (c.ravel() for c in np.meshgrid(xs, ys))
    solid = ground.solid((camera_z, camera_z))
    bottom, top = _outside_heights(ground)
    if bottom < camera_z < top:
        solid = shapely.union_all([solid, _outside(ground)])
    edges = _edges(solid)
    angles = (np.arange(RAYS) + 0.5) * (2 * math.pi / RAYS)
    cos, sin = np.cos(angles), np.sin(angles)
    share = np.empty(x.size)
    low, high = np.minimum(edges[:, :2], edges[:, 2:]), np.maximum(edges[:, :2], edges[:, 2:])
    for points in _tiles(x, y, 0.5 * radius):
        limits.check(OPENNESS)
        corner = np.array([x[points].min(), y[points].min()]) - radius
        other = np.array([x[points].max(), y[points].max()]) + radius
        close = np.flatnonzero((low <= other).all(axis=1) & (high >= corner).all(axis=1))
        part = np.empty(points.size)
        sight._kernels.isovists(edges[close], x[points], y[points], radius, cos, sin, part)
        share[points] = part
    shapely.prepare(solid)
    share[shapely.contains_xy(solid, x, y)] = 0.0
    return Field(np.clip(share, 0.0, 1.0).reshape(ys.size, xs.size), spacing, (float(xs[0]), float(ys[0]), 0.0))


def _tiles(x: FloatArray, y: FloatArray, side: float) -> list[Any]:
    """Return the indices of the points in each square tile of the given side, m."""
    column, row = np.floor((x - x.min()) / side), np.floor((y - y.min()) / side)
    number = (row * (column.max() + 1) + column).astype(np.int64)
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


# Geometry


def _grid(ground: Ground, least: float = 0.0) -> tuple[FloatArray, FloatArray, float]:
    """Return the sample positions along x and along y, m, and their spacing, at least ``least`` m."""
    x0, y0, x1, y1 = ground.bounds
    spacing = max(ground.cell, least, math.sqrt((x1 - x0) * (y1 - y0) / MAX_NODES))
    xs, ys = grid_points(ground.bounds, spacing)
    return xs, ys, spacing


def _outside(ground: Ground) -> BaseGeometry:
    """Return the obstacle beyond the extent, m, a band round it; empty if the area beyond is no obstacle."""
    width = BEYOND + 2 * _grid(ground)[2]
    around = shapely.box(*ground.bounds).buffer(width, join_style="mitre")
    return shapely.difference(around, ground.extent) if ground.outside_is_obstacle else shapely.MultiPolygon()


def _outside_heights(ground: Ground) -> tuple[float, float]:
    return ground.raster.heights if ground.raster is not None else (-math.inf, math.inf)


def _outlines(ground: Ground) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the edges (E, 4) of all obstacles, m, and the bottom and the top (E,) of the obstacle of each edge, m."""

    def make() -> tuple[FloatArray, FloatArray, FloatArray]:
        solids: list[tuple[BaseGeometry, tuple[float, float]]]
        solids = [(obstacle.polygon, obstacle.heights) for obstacle in ground.obstacles]
        if ground.raster is not None:
            solids.append((ground.raster_solid(), ground.raster.heights))
        solids.append((_outside(ground), _outside_heights(ground)))
        edges = [_edges(geometry) for geometry, _ in solids]
        heights = np.repeat([heights for _, heights in solids], [len(part) for part in edges], axis=0)
        return np.concatenate(edges), heights[:, 0].copy(), heights[:, 1].copy()

    return ground.derived(("outlines",), make)


def _edges(geometry: BaseGeometry) -> FloatArray:
    """Return the edges (E, 4) of polygons: x0, y0, x1, y1 in m, with the inside on the left."""
    parts = [part for part in shapely.get_parts(geometry) if part.area > 0]
    rings = shapely.get_rings(shapely.orient_polygons(np.array(parts, dtype=object)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    ends = np.concatenate([points[:-1], points[1:]], axis=1)[ring[1:] == ring[:-1]]
    proper: FloatArray = ends[(ends[:, :2] != ends[:, 2:]).any(axis=1)]
    return proper
