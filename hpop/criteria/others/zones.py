"""Rules of zones: motion against the direction of one-way zones, and driving faster than the limits of speed zones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import is_symbolic, smooth_abs
from hpop.criteria.base import criterion
from hpop.criteria.others import base_velocity
from hpop.motions import Instants, Motions
from hpop.runtime import limits
from hpop.world import World
from hpop.world.content.content import Zone
from hpop.world.fields.field import Field, grid_points


class Blocks(NamedTuple):
    """Blocks of BLOCK by BLOCK samples of a field, and whether the field may differ from 0 in each.

    x, y  m      corner of the first block
    size  m      length of a block
    used  (H, W)
    """

    x: float
    y: float
    size: float
    used: BoolArray

    @classmethod
    def of(cls, xs: FloatArray, ys: FloatArray, samples: BoolArray) -> Blocks:
        """Return the blocks of a grid in which samples (H, W) differ from 0, and those next to them.

        Samples at the border of the grid must be 0, so that the field is 0 beyond it.
        """
        row, column = np.nonzero(samples)
        used = np.zeros((-(-ys.size // BLOCK) + 4, -(-xs.size // BLOCK) + 4), dtype=np.bool_)
        for down in range(3):  # a spline reaches two samples
            for right in range(3):
                used[row // BLOCK + down + 1, column // BLOCK + right + 1] = True
        size = BLOCK * float(xs[1] - xs[0])
        return cls(float(xs[0]) - 2.0 * size, float(ys[0]) - 2.0 * size, size, used)

    def at(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return whether the field may differ from 0 at positions."""
        row = np.clip((y - self.y) / self.size, 0, self.used.shape[0] - 1).astype(np.int64)
        return np.asarray(self.used[row, np.clip((x - self.x) / self.size, 0, self.used.shape[1] - 1).astype(np.int64)])


Flow = tuple[Field, Field, Blocks]
BLOCK = 8


@criterion("against_flow", group="O", unit="m", aggregate="sum", requires=("base", "one-way zones"))
@dataclass(frozen=True)
class AgainstFlow:
    """Metres moved against the direction of one-way zones: ∫ (-v · direction)₊ dt.

    v is the velocity of the base's axis, the point x, y of its pose. The direction at a point is that of the nearest
    segment of the zone's path; beyond a corner, it is halfway between those of two segments. Moving across the
    direction costs nothing. Where zones overlap, each counts. Unit m; a sum over motions. The definition is this
    library's own, not a published measure.

    The border of a zone, and the line where the direction changes, are blurred over about two cells of the distance
    grid on either side (see :class:`hpop.world.fields.field.Field`), so that the cost has a gradient.
    """

    def cost(self, m: Motions) -> Column:
        """Return for each motion (M,) its velocity component against one-way zones, integrated over time, m."""
        if m.base.stays:
            return 0.0 * m.base.start.x  # a turn in place moves in no direction
        flows = _flows(m.world)

        def against(s: Instants) -> Column:
            x, y = s.base.x, s.base.y
            vx, vy = base_velocity(m, s)
            if is_symbolic(x):
                return sum(np.maximum(-(vx * ahead(x, y) + vy * left(x, y)), 0.0) for ahead, left, _ in flows)
            total = np.zeros(np.broadcast(x, y, vx, vy).shape)
            x, y, vx, vy = (np.broadcast_to(column, total.shape) for column in (x, y, vx, vy))
            for ahead, left, blocks in flows:  # of many zones, a position is in few
                near = np.nonzero(blocks.at(x, y))
                at = x[near], y[near]
                total[near] += np.maximum(-(vx[near] * ahead(*at) + vy[near] * left(*at)), 0.0)
            return total

        return m.integrate(against)


@criterion("speeding", group="O", unit="m", aggregate="sum", requires=("base", "speed zones"))
@dataclass(frozen=True)
class Speeding:
    """Distance that the base covers in excess of the limits in speed zones: ∫ (v - limit)₊ dt in speed zones.

    A path of 10 m at 2 m/s where 1 m/s is allowed takes 5 s and costs (2 - 1) · 5 = 5 m, not 10 m.

    v is the speed of the base; a zone applies while the base's axis is in it. Where zones overlap, the lowest limit
    holds. Unit m; a sum over motions. The definition is this library's own, not a published measure.

    The border of a zone is blurred over about two cells of the distance grid on either side (see
    :class:`hpop.world.fields.field.Field`), so that the cost has a gradient. This does not change the cost of a path
    straight across the border.
    """

    def cost(self, m: Motions) -> Column:
        """Return for each motion (M,) its speed above the limits of speed zones, integrated over time, m."""
        if m.base.stays:
            return 0.0 * m.base.start.x  # a turn in place covers no metres
        limits = speed_limits(m.world)

        def excess(s: Instants) -> Column:
            x, y, speed = s.base.x, s.base.y, smooth_abs(s.speed)
            return sum(np.maximum(speed - limit, 0.0) * inside(x, y) for limit, inside in limits)

        return m.integrate(excess)


MAX_SAMPLES = 4_000_000


ROWS = 1 << 16  # blocks looked at together


FINER = 4  # times as small: the next blocks of squares


SAMPLE = 8  # bytes of a sample


POINT = 200  # bytes of a sample's nearest point on a path


ZONES = "zones were sampled"


SAME_PLACE = 1e-9  # share of a path's length: a nearest point within this of a corner counts as the corner


def speed_limits(world: World) -> tuple[tuple[float, Field], ...]:
    """Return pairs of a speed limit, m/s, and a field that is 1 where this limit holds and 0 elsewhere.

    Where speed zones overlap, the lowest limit holds.
    """
    zones = tuple((float(zone.limit), zone.area) for zone in world.content.zones if zone.limit is not None)

    def make() -> tuple[tuple[float, Field], ...]:
        fields = []
        lower: BaseGeometry = shapely.Polygon()
        for limit in sorted({limit for limit, _ in zones}):
            area = shapely.union_all([area for zone_limit, area in zones if zone_limit == limit])
            remaining = shapely.difference(area, lower)
            lower = shapely.union(lower, area)
            if remaining.area > 0:
                xs, ys = _grid(world, remaining)
                fields.append((limit, _field(xs, ys, _shares(remaining, xs, ys))))
        return tuple(fields)

    return world.ground.derived(("speed limits", zones), make)


def one_way_flows(world: World) -> tuple[tuple[Field, Field], ...]:
    """Return the allowed direction of each one-way zone, as two fields: its x and y components.

    The direction is that of the nearest segment of the zone's path. Beyond a corner, where two segments are equally
    near, it is halfway between theirs. Its length is 1 inside the zone and 0 outside.
    """
    return tuple((ahead, left) for ahead, left, _ in _flows(world))


def _flows(world: World) -> tuple[Flow, ...]:
    """Return the flows of :func:`one_way_flows`, each with the blocks outside which it is 0."""
    zones = [zone for zone in world.content.zones if zone.kind == "one-way"]
    key = ("one-way flows", *((zone.area, zone.path) for zone in zones))
    return world.ground.derived(key, lambda: tuple(_flow(world, zone) for zone in zones))


def _flow(world: World, zone: Zone) -> Flow:
    """Return the allowed direction in one zone: its x and y components, and the blocks outside which they are 0."""
    xs, ys = _grid(world, zone.area)
    shares = _shares(zone.area, xs, ys)
    limits.hold(ZONES, xs.size * ys.size * SAMPLE, xs.size * ys.size * POINT)
    corners = shapely.get_coordinates(zone.path)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0], lengths[lengths > 0]
    ahead = steps / lengths[:, None]  # (segments, 2)
    ends = np.cumsum(lengths)
    used = np.nonzero(shares)
    along = shapely.line_locate_point(zone.path, shapely.points(xs[used[1]], ys[used[0]]))
    slack = SAME_PLACE * ends[-1]
    before, after = (
        np.minimum(np.searchsorted(ends, along + shift, side="right"), lengths.size - 1) for shift in (-slack, slack)
    )
    mean = ahead[before] + ahead[after]  # (N, 2)
    norm = np.hypot(mean[..., 0], mean[..., 1])[..., None]
    # At a corner where a path turns back on itself, no direction is halfway between both: use the next segment's.
    direction = np.where(norm > SAME_PLACE, mean / np.maximum(norm, SAME_PLACE), ahead[after])
    right, up = np.zeros_like(shares), np.zeros_like(shares)
    right[used], up[used] = shares[used] * direction[:, 0], shares[used] * direction[:, 1]
    return _field(xs, ys, right), _field(xs, ys, up), Blocks.of(xs, ys, shares > 0.0)


def _grid(world: World, area: BaseGeometry) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates x (W,) and y (H,) of a grid of samples over an area, m.

    Samples are a cell of the world's distance grid apart, or farther if they would be more than four million.
    """
    x0, y0, x1, y1 = shapely.bounds(area)
    spacing = max(world.cell, math.sqrt((x1 - x0) * (y1 - y0) / MAX_SAMPLES))
    return grid_points((x0, y0, x1, y1), spacing)


def _field(xs: FloatArray, ys: FloatArray, values: FloatArray) -> Field:
    """Return the field with given values (H, W) at the samples of a grid."""
    return Field(values, float(xs[1] - xs[0]), (float(xs[0]), float(ys[0]), 0.0))


def _shares(area: BaseGeometry, xs: FloatArray, ys: FloatArray) -> FloatArray:
    """Return which share (H, W), 0 to 1, of the grid square about each sample lies in an area.

    Blocks of squares that lie in the area or beside it as a whole are found first.
    """
    half = 0.5 * float(xs[1] - xs[0])
    limits.hold(ZONES, xs.size * ys.size * SAMPLE)
    shapely.prepare(area)
    inside = np.zeros((ys.size, xs.size))
    rows, columns = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)  # of the first square of each block
    size = max(xs.size, ys.size)
    while True:
        open_rows, open_columns = [], []
        for begin in range(0, rows.size, ROWS):
            limits.check(ZONES)
            row, column = rows[begin : begin + ROWS], columns[begin : begin + ROWS]
            last_row, last_column = np.minimum(row + size, ys.size) - 1, np.minimum(column + size, xs.size) - 1
            blocks = shapely.box(xs[column] - half, ys[row] - half, xs[last_column] + half, ys[last_row] + half)
            whole = shapely.contains_properly(area, blocks)
            for i in np.flatnonzero(whole).tolist():
                inside[row[i] : last_row[i] + 1, column[i] : last_column[i] + 1] = 1.0
            border = np.flatnonzero(~whole)
            border = border[shapely.intersects(area, blocks[border])]
            if size == 1:
                parts = shapely.area(shapely.intersection(area, blocks[border])) / (4.0 * half * half)
                inside[row[border], column[border]] = np.clip(parts, 0.0, 1.0)
            open_rows.append(row[border])
            open_columns.append(column[border])
        if size == 1:
            return inside
        before, size = size, max(1, -(-size // FINER))
        steps = np.arange(0, before, size)
        rows, columns = (np.concatenate(each) for each in (open_rows, open_columns))
        rows = (rows[:, None, None] + steps[:, None] + 0 * steps).ravel()
        columns = (columns[:, None, None] + 0 * steps[:, None] + steps).ravel()
        within = (rows < ys.size) & (columns < xs.size)
        rows, columns = rows[within], columns[within]
