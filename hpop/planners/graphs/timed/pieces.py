"""Distances between a robot on its way, piece by piece, and people who walk meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from scipy.special import ndtri
from scipy.stats import ncx2

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.collision.parts import Part
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import LegMotions
from hpop.world.content.people import Person

PIECE = 0.5  # s
BETWEEN = 2  # places a tick at which a way is compared with its chord
Place = tuple[FloatArray, FloatArray]


class MotionPieces(NamedTuple):
    """Pieces of motions that last no longer than :data:`PIECE`, so that nobody strays far from a chord meanwhile.

    row         (N,)  the arc that each is of
    start, end  x, y (N,), m
    yaw         (N,)  rad, where they begin
    after       (N,)  ticks since the arc was left for
    lasts       (N,)  ticks
    turns       (N,)  whether the yaw changes
    """

    row: IntArray
    start: Place
    end: Place
    yaw: FloatArray
    after: IntArray
    lasts: IntArray
    turns: BoolArray

    @classmethod
    def of(cls, leg: LegMotions, clock: TickClock) -> MotionPieces:
        """Those of motions of one kind."""
        ticks = clock.of(leg.lasts)
        count = -(-ticks // max(1, clock.within(PIECE)))
        owner = np.repeat(np.arange(ticks.size), count)
        number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        first, last = (part * ticks[owner] // count[owner] for part in (number, number + 1))
        after = np.rint(leg.after / clock.tick).astype(np.int64)[owner] + first
        x, y, to_x, to_y = (column[owner] for column in (leg.start.x, leg.start.y, leg.end.x, leg.end.y))
        shares = first / ticks[owner], last / ticks[owner]
        start, end = ((x + share * (to_x - x), y + share * (to_y - y)) for share in shares)
        rows = np.flatnonzero(leg.of >= 0)
        row = np.empty(ticks.size, np.int64)
        row[leg.of[rows]] = rows
        turns = np.full(owner.size, leg.kind != "move")
        return cls(row[owner], start, end, leg.start.yaw[owner], after, last - first, turns)

    def take(self, rows: IntArray) -> MotionPieces:
        """Some of them."""
        start, end = ((x[rows], y[rows]) for x, y in (self.start, self.end))
        return MotionPieces(
            self.row[rows], start, end, self.yaw[rows], self.after[rows], self.lasts[rows], self.turns[rows]
        )


class PersonMotion(NamedTuple):
    """Where somebody walks during motions (N,).

    ends   x, y (N,), m, at their begin and at their end
    stray  (N,)  m, how far it leaves the line between these, walked evenly
    there  (N,)  whether it is there at any time of them
    """

    ends: tuple[Place, Place]
    stray: FloatArray
    there: BoolArray

    @classmethod
    def of(cls, person: Person, tick: IntArray, lasts: IntArray, clock: TickClock) -> PersonMotion:
        """During motions that begin at ticks (N,) and last so many."""
        most = int(lasts.max(initial=1)) + 1
        keys, which = np.unique(tick * most + lasts, return_inverse=True)
        begin, count = keys // most, keys % most
        share = np.linspace(0.0, 1.0, BETWEEN * most + 1)
        seconds = (begin[:, None] + share * count[:, None]) * clock.tick
        x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
        there = np.broadcast_to(np.asarray(person.there(seconds)), seconds.shape)
        off_x = x - (x[:, :1] + share * (x[:, -1:] - x[:, :1]))
        off_y = y - (y[:, :1] + share * (y[:, -1:] - y[:, :1]))
        stray = np.hypot(off_x, off_y).max(axis=1)
        ends = ((x[which, 0], y[which, 0]), (x[which, -1], y[which, -1]))
        present = np.asarray(np.max(there, axis=1) > 0)
        return cls(ends, stray[which], present[which])

    def seen_from(self, pieces: MotionPieces) -> tuple[Place, Place]:
        """Ways (x, y), m, from the robot to the person at both ends of pieces."""
        (x, y), (to_x, to_y) = self.ends
        (ax, ay), (bx, by) = pieces.start, pieces.end
        return (x - ax, y - ay), (to_x - bx, to_y - by)


def to_segments(ax: FloatArray, ay: FloatArray, bx: FloatArray, by: FloatArray) -> FloatArray:
    """Distance (N,) of the origin from segments a b."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = np.clip(np.divide(-(ax * dx + ay * dy), square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(ax + share * dx, ay + share * dy))


def strips(
    pieces: MotionPieces, seen: tuple[Place, Place], rows: IntArray, stray: float, at_start: BoolArray | None = None
) -> tuple[Place, ...]:
    """Corners of where somebody is, seen from robots on moves that may be so far, m, ahead of or behind their plans.

    pieces    (N,) moves
    seen      from the ends of pieces, of which ``rows`` (N,) are these
    at_start  (N,)  which cannot be behind at their begin
    """
    (ax, ay), (bx, by) = pieces.start, pieces.end
    dx, dy = bx - ax, by - ay
    length = np.hypot(dx, dy)
    share = np.divide(stray, length, out=np.zeros_like(length), where=length > 0)
    back = share if at_start is None else np.where(at_start, 0.0, share)
    (sx, sy), (tx, ty) = ((x[rows], y[rows]) for x, y in seen)
    return (
        (sx + back * dx, sy + back * dy),
        (sx - share * dx, sy - share * dy),
        (tx - share * dx, ty - share * dy),
        (tx + share * dx, ty + share * dy),
    )


def to_strips(corners: tuple[Place, ...]) -> FloatArray:
    """Distance (N,), m, of the origin from convex quadrilaterals; 0 within them."""
    following = [*corners[1:], corners[0]]
    edges = [to_segments(*one, *other) for one, other in zip(corners, following, strict=True)]
    sides = [ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)]
    inside = (np.minimum.reduce(sides) > 0) | (np.maximum.reduce(sides) < 0)
    return np.where(inside, 0.0, np.minimum.reduce(edges))


def to_parts(parts: Sequence[Part], corners: FloatArray) -> FloatArray:
    """Distance (N,) of the hulls of points (N, c, 2) in the frame of the base from the nearest of some parts."""
    hulls = shapely.convex_hull(shapely.multipoints(corners))
    each = [
        shapely.distance(shapely.convex_hull(shapely.MultiPoint(part.corners)), hulls) - part.radius for part in parts
    ]
    return np.asarray(np.minimum.reduce(each))


RISK = 0.05  # of a prediction at a moment
SIGMAS = float(-ndtri(RISK))
HALVINGS = 30
TABLE = 257  # deviations for which a distance is found
SMALLEST = 0.02  # of them, a share of the disc; below, the half-plane is as good


def clear_distance(deviation: FloatArray, disc: float) -> FloatArray:
    """How far (T,), m, the middle of a person must be from that of a disc to be in it with no more than the risk.

    Of an uncertain one the larger of what the nearest deviations in a table need.
    """
    deviations, needed = _table(float(disc))
    after = np.clip(np.searchsorted(deviations, deviation), 1, deviations.size - 1)
    unsure = np.maximum(needed[after - 1], needed[after])
    unsure = np.where(deviation > deviations[-1], 0.0, unsure)  # not even in its middle
    return np.where(deviation < deviations[0], disc + SIGMAS * deviation, unsure)


@lru_cache(maxsize=256)
def _table(disc: float) -> tuple[FloatArray, FloatArray]:
    """Deviations, m, up to the largest that matters, and the distances that they need."""
    largest = disc / math.sqrt(-2.0 * math.log1p(-RISK))
    deviations = np.geomspace(SMALLEST * disc, largest, TABLE)
    size = (disc / deviations) ** 2
    low, high = np.zeros(TABLE), disc + 5.0 * deviations
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        inside = ncx2.cdf(size, 2, (middle / deviations) ** 2) > RISK
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return deviations, high
