"""Sample obstruction and clearance of a world on a grid, and evaluate obstruction at several heights."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, Column, FloatArray, distinct
from hpop.base.math import is_symbolic
from hpop.errors import OptionError
from hpop.runtime import limits
from hpop.world.fields.field import Field, LazyField, TiledField, grid_points
from hpop.world.fields.obstruction import RasterBalls, disjoint_prisms, prism_obstruction
from hpop.world.geometry.planar import EdgeTree, FreeSpace, edges_of_one
from hpop.world.geometry.shapes import Obstacle, Raster

if TYPE_CHECKING:
    from hpop.motions import Pose
    from hpop.world.ground import Ground
    from hpop.world.world import World

MAX_NODES = 25_000_000
"""Largest number of samples of a field; larger worlds are sampled more coarsely."""
FINENESS = 10
"""Least number of samples of the obstruction along a radius of the ball."""
MAX_HEIGHTS = 16
"""Largest number of distinct camera heights in one call of `World.obstruction`."""
PAD = 3
SAMPLE = 8
"""Bytes of a sample."""
WHOLE = 250_000
"""Number of clearance samples up to which all are computed at once; in larger fields only those that are read."""
BLOCK = 8
"""Samples along a side of a block whose clearance is computed, or copied, as a whole."""
SLACK = 1e-6
"""Tolerance, m, when deciding whether an edge is near enough to change a sample."""
CLEARANCE = "the clearance was sampled"
OBSTRUCTION = "the obstruction was sampled"


def sample_clearance(ground: Ground, free: FreeSpace, last: tuple[FreeSpace, Field] | None) -> Field:
    """Sample the signed clearance of a free space on a grid, at least 0.5 m beyond the extent.

    See `World.clearance_field`.
    ``last`` is a previous free space of this ground with its samples. Samples with an unchanged nearest edge are
    copied, since they would be equal to the last bit. Blocks with other samples are computed again.
    """
    spacing = _spacing(ground, math.inf)
    border = max(4 * spacing, 0.5)
    x0, y0, x1, y1 = ground.bounds
    xs, ys = grid_points((x0 - border, y0 - border, x1 + border, y1 + border), spacing)
    limits.hold(CLEARANCE, xs.size * ys.size * SAMPLE, 2 * xs.size * ys.size * SAMPLE)
    limit = math.hypot(x1 - x0, y1 - y0)  # the distance is infinite if nothing is free

    def sample(x: FloatArray, y: FloatArray) -> FloatArray:
        limits.check(CLEARANCE)
        return np.clip(free.signed_clearance(x, y), -limit, limit)

    if last is None and xs.size * ys.size > WHOLE:
        return LazyField(xs, ys, spacing, sample, (-limit, limit))
    if last is None:
        values, anew = np.empty((ys.size, xs.size)), np.ones((-(-ys.size // BLOCK), -(-xs.size // BLOCK)), dtype=bool)
    else:
        values, anew = last[1].values.copy(), _near(edges_of_one(free, last[0]), last[1].values, xs, ys)
    for begin, blocks in zip(range(0, ys.size, BLOCK), anew, strict=True):
        rows, columns = slice(begin, begin + BLOCK), blocks.repeat(BLOCK)[: xs.size]
        x, y = np.meshgrid(xs[columns], ys[rows])
        values[rows, columns] = sample(x.ravel(), y.ravel()).reshape(x.shape)
    return Field(values, spacing, (float(xs[0]), float(ys[0]), 0.0))


def _near(edges: FloatArray, clearance: FloatArray, xs: FloatArray, ys: FloatArray) -> BoolArray:
    """Return a mask of the blocks, `BLOCK` samples a side, in which changed edges (E, 4) may change the clearance.

    ``clearance`` (H, W), m, was sampled before the change at the points of the grid ``ys`` (H,) and ``xs`` (W,).
    """
    rows, columns = (np.arange(0, size, BLOCK) for size in clearance.shape)
    if not len(edges):
        return np.zeros((rows.size, columns.size), dtype=bool)
    farthest = np.maximum.reduceat(np.maximum.reduceat(np.abs(clearance), rows), columns, axis=1)
    middle = 0.5 * (BLOCK - 1) * (xs[1] - xs[0])
    x, y = np.meshgrid(xs[columns] + middle, ys[rows] + middle)
    apart = EdgeTree.build(edges).distance(x.ravel(), y.ravel()).reshape(x.shape)
    near: BoolArray = apart - math.sqrt(2) * middle <= farthest + SLACK
    return near


def sample_obstruction(ground: Ground, radius: float, z: float) -> Field:
    """Sample the obstruction of a ball at height z, m; see `World.obstruction_field`."""
    if ground.raster is None:
        return _sample_polygons(ground, radius, z)
    return _sample_raster(ground, ground.raster, radius, z)


def obstructed(world: World, pose: Pose, radius: float) -> Column:
    """Return the obstruction (M,) at the positions of poses, from one field per height; see `World.obstruction`."""
    x, y = pose.x, pose.y
    if not world.has_heights:
        return world.obstruction_field(radius)(x, y)
    if is_symbolic(pose.z):
        raise OptionError(
            "obstruction needs camera heights as numbers, but here they are variables of an optimisation; use a "
            "planner on a graph, or obstacles of unlimited height."
        )
    z = np.round(np.asarray(pose.z, dtype=np.float64), 9)
    heights = distinct(z)
    if heights.size > MAX_HEIGHTS:
        raise OptionError(
            f"obstruction needs a field for each camera height, at most {MAX_HEIGHTS}; got "
            f"{heights.size} distinct heights. Round the heights, or use obstacles of unlimited height."
        )
    if heights.size == 1:
        return world.obstruction_field(radius, float(heights[0]))(x, y)
    if is_symbolic(x) or is_symbolic(y):
        fields = [world.obstruction_field(radius, float(h))(x, y) for h in heights]
        return sum(np.where(z == h, 1.0, 0.0) * f for h, f in zip(heights, fields, strict=True))
    x, y, z = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64), z)
    result = np.zeros(z.shape)
    for h in heights:
        at = z == h
        result[at] = world.obstruction_field(radius, float(h))(x[at], y[at])
    return result


def _spacing(ground: Ground, limit: float) -> float:
    x0, y0, x1, y1 = ground.bounds
    return max(min(ground.cell, limit), math.sqrt((x1 - x0) * (y1 - y0) / MAX_NODES))


def _sample_polygons(ground: Ground, radius: float, z: float) -> Field:
    spacing = _spacing(ground, radius / FINENESS)
    xs, ys = grid_points(ground.bounds, spacing)
    limits.hold(OBSTRUCTION, xs.size * ys.size * (SAMPLE + 1))
    obstacles = list(ground.obstacles)
    if ground.outside_is_obstacle:
        inside = [(shapely.intersection(o.polygon, ground.extent), o) for o in obstacles]
        obstacles = [part for geometry, o in inside for part in _prisms(geometry, o.z_min, o.z_max)]
        around = shapely.box(*ground.bounds).buffer(2 * radius + 2 * spacing, join_style="mitre")
        obstacles += _prisms(shapely.difference(around, ground.extent))
    prisms = disjoint_prisms(obstacles)
    return LazyField(xs, ys, spacing, lambda x, y: prism_obstruction(*prisms, x, y, z, radius))


def _sample_raster(ground: Ground, raster: Raster, radius: float, z: float) -> Field:
    finest = int(math.sqrt(MAX_NODES / raster.cells.size))
    split = max(1, min(math.ceil(FINENESS * raster.resolution / radius), finest))
    fine = raster
    limits.hold(OBSTRUCTION, raster.cells.size * split**2 * (SAMPLE + (split > 1)))
    if split > 1:
        cells = raster.cells.repeat(split, axis=0).repeat(split, axis=1)
        fine = Raster(cells, raster.resolution / split, raster.origin, *raster.heights)
    balls = RasterBalls(fine, radius, z, ground.outside_is_obstacle, pad=PAD)
    beside = [part for o in ground.obstacles for part in _beside_cells(ground, raster, o)]
    prisms = disjoint_prisms(beside)

    def sample(rows: slice, columns: slice) -> FloatArray:
        limits.check(OBSTRUCTION)
        values = balls.values(rows, columns)
        if beside:
            column, row = np.meshgrid(*(np.arange(s.start, s.stop) + 0.5 - PAD for s in (columns, rows)))
            x, y = fine.to_world(column.ravel(), row.ravel())
            values = np.clip(values + prism_obstruction(*prisms, x, y, z, radius).reshape(values.shape), 0, 1)
        return values

    def reads(rows: slice, columns: slice) -> list[tuple[float, float]]:
        return [(low / split, high / split) for low, high in balls.spans(rows, columns)]

    x, y = fine.to_world(0.5 - PAD, 0.5 - PAD)
    origin = float(x), float(y), raster.origin[2]
    return TiledField(balls.shape, fine.resolution, origin, balls.side, sample, reads)


def _beside_cells(ground: Ground, raster: Raster, obstacle: Obstacle) -> list[Obstacle]:
    """Return the parts of an obstacle that the cells of the raster do not cover, so that no volume counts twice.

    If everything outside of the grid is an obstacle, parts out there at the heights of the raster are left out too.
    """
    bottom, top = max(obstacle.z_min, raster.z_min), min(obstacle.z_max, raster.z_max)
    if bottom >= top:
        return [obstacle]
    rest = shapely.difference(obstacle.polygon, ground.raster_solid())
    if ground.outside_is_obstacle:
        rest = shapely.intersection(rest, raster.rectangle())
    parts = _prisms(rest, bottom, top)
    if obstacle.z_min < bottom:
        parts.append(Obstacle(obstacle.polygon, obstacle.z_min, bottom))
    if top < obstacle.z_max:
        parts.append(Obstacle(obstacle.polygon, top, obstacle.z_max))
    return parts


def _prisms(geometry: BaseGeometry, z_min: float = -math.inf, z_max: float = math.inf) -> list[Obstacle]:
    """Return the polygons of a geometry as obstacles, without the lines and points that an overlay may leave."""
    parts = shapely.get_parts(geometry)
    return [Obstacle(part, z_min, z_max) for part in parts if part.area > 0]
