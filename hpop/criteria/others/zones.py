"""Rules of zones: motion against the direction of one-way zones, and driving faster than the limits of speed zones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import smooth_abs
from hpop.criteria.base import criterion
from hpop.criteria.others import base_velocity
from hpop.motions import Instants, Motions
from hpop.runtime import limits
from hpop.world import World
from hpop.world.content.content import Zone
from hpop.world.fields.field import Field, grid_points


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
        flows = one_way_flows(m.world)

        def against(s: Instants) -> Column:
            x, y = s.base.x, s.base.y
            vx, vy = base_velocity(m, s)
            return sum(np.maximum(-(vx * ahead(x, y) + vy * left(x, y)), 0.0) for ahead, left in flows)

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


ROWS = 1 << 16  # samples per block


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
    zones = [zone for zone in world.content.zones if zone.kind == "one-way"]
    key = ("one-way flows", *((zone.area, zone.path) for zone in zones))
    return world.ground.derived(key, lambda: tuple(_flow(world, zone) for zone in zones))


def _flow(world: World, zone: Zone) -> tuple[Field, Field]:
    """Return the allowed direction in one zone, as fields of its x and y components."""
    xs, ys = _grid(world, zone.area)
    shares = _shares(zone.area, xs, ys)
    limits.hold(ZONES, xs.size * ys.size * SAMPLE, xs.size * ys.size * POINT)
    corners = shapely.get_coordinates(zone.path)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0], lengths[lengths > 0]
    ahead = steps / lengths[:, None]  # (segments, 2)
    ends = np.cumsum(lengths)
    x, y = np.meshgrid(xs, ys)
    along = shapely.line_locate_point(zone.path, shapely.points(x, y))
    slack = SAME_PLACE * ends[-1]
    before, after = (
        np.minimum(np.searchsorted(ends, along + shift, side="right"), lengths.size - 1) for shift in (-slack, slack)
    )
    mean = ahead[before] + ahead[after]  # (H, W, 2)
    norm = np.hypot(mean[..., 0], mean[..., 1])[..., None]
    # At a corner where a path turns back on itself, no direction is halfway between both: use the next segment's.
    direction = np.where(norm > SAME_PLACE, mean / np.maximum(norm, SAME_PLACE), ahead[after])
    return _field(xs, ys, shares * direction[..., 0]), _field(xs, ys, shares * direction[..., 1])


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
    """Return which share (H, W), 0 to 1, of the grid square about each sample lies in an area."""
    half = 0.5 * float(xs[1] - xs[0])
    limits.hold(ZONES, xs.size * ys.size * SAMPLE)
    shapely.prepare(area)
    inside = np.empty((ys.size, xs.size))
    step = max(1, ROWS // xs.size)
    for begin in range(0, ys.size, step):
        limits.check(ZONES)
        x, y = np.meshgrid(xs, ys[begin : begin + step])
        squares = shapely.box(x - half, y - half, x + half, y + half)
        shares = np.where(shapely.contains_properly(area, squares), 1.0, 0.0)
        border = shapely.intersects(area, squares) & (shares == 0)
        shares[border] = shapely.area(shapely.intersection(area, squares[border])) / (4.0 * half * half)
        inside[begin : begin + step] = np.clip(shares, 0.0, 1.0)
    return inside
