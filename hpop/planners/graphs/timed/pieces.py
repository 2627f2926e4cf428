"""Distances between a moving robot and walking people, for short pieces of the robot's motions."""

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
from hpop.motions import HOLD
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import LegMotions
from hpop.world.content.people import Person

PIECE = 0.5  # s
BETWEEN = 2  # points per tick at which a person's path is compared with its chord
Place = tuple[FloatArray, FloatArray]


class MotionPieces(NamedTuple):
    """Pieces of motions no longer than :data:`PIECE`, during which people walk nearly straight.

    row         (N,)  arc of each piece
    start, end  x, y (N,), m
    yaw         (N,)  rad, at the start
    after       (N,)  ticks since the departure of the arc
    lasts       (N,)  ticks
    moves       (N,)  whether the robot moves straight
    stands      (N,)  whether it stands; otherwise it turns in place
    """

    row: IntArray
    start: Place
    end: Place
    yaw: FloatArray
    after: IntArray
    lasts: IntArray
    moves: BoolArray
    stands: BoolArray

    @classmethod
    def of(cls, leg: LegMotions, clock: TickClock) -> MotionPieces:
        """Return the pieces of motions of one kind."""
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
        moves, stands = (np.full(owner.size, leg.kind == kind) for kind in ("move", HOLD.kind))
        return cls(row[owner], start, end, leg.start.yaw[owner], after, last - first, moves, stands)

    def take(self, rows: IntArray) -> MotionPieces:
        """Return some of the pieces, by index."""
        start, end = ((x[rows], y[rows]) for x, y in (self.start, self.end))
        after, lasts, moves, stands = self.after[rows], self.lasts[rows], self.moves[rows], self.stands[rows]
        return MotionPieces(self.row[rows], start, end, self.yaw[rows], after, lasts, moves, stands)


class PersonMotion(NamedTuple):
    """Motion of a person during motions (N,) of a robot.

    ends   x, y (N,), m, of the person at the beginning and the end of each motion
    stray  (N,)  m, largest distance of the person from a steady walk along the line between these positions
    there  (N,)  whether the person is present at any time during the motion
    """

    ends: tuple[Place, Place]
    stray: FloatArray
    there: BoolArray

    @classmethod
    def of(cls, person: Person, tick: IntArray, lasts: IntArray, clock: TickClock) -> PersonMotion:
        """Return the motion of a person during motions that begin at ticks (N,) and last for numbers (N,) of ticks."""
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
        """Return the positions x, y (N,), m, of the person relative to the robot at both ends of pieces."""
        (x, y), (to_x, to_y) = self.ends
        (ax, ay), (bx, by) = pieces.start, pieces.end
        return (x - ax, y - ay), (to_x - bx, to_y - by)


def to_segments(ax: FloatArray, ay: FloatArray, bx: FloatArray, by: FloatArray) -> FloatArray:
    """Return the distance (N,), m, of the origin from segments from a to b."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = np.clip(np.divide(-(ax * dx + ay * dy), square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(ax + share * dx, ay + share * dy))


def strips(
    pieces: MotionPieces, seen: tuple[Place, Place], rows: IntArray, stray: float, at_start: BoolArray | None = None
) -> tuple[Place, ...]:
    """Return quadrilaterals that hold the positions of a person relative to a robot, ahead of or behind its plan.

    pieces    (N,) moves of the robot
    seen      positions of the person relative to the robot at both ends of the pieces of all motions
    rows      (N,) indices of ``pieces`` among all pieces
    stray     m, largest distance of the robot from its plan
    at_start  (N,)  mask of pieces that the robot begins without being behind its plan
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
    """Return the distance (N,), m, of the origin from convex quadrilaterals; 0 within them."""
    following = [*corners[1:], corners[0]]
    edges = [to_segments(*begin, *end) for begin, end in zip(corners, following, strict=True)]
    sides = [ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)]
    inside = (np.minimum.reduce(sides) > 0) | (np.maximum.reduce(sides) < 0)
    return np.where(inside, 0.0, np.minimum.reduce(edges))


def to_parts(parts: Sequence[Part], yaw: FloatArray, corners: Sequence[Place]) -> FloatArray:
    """Return the distance (N,), m, of convex hulls of points from the nearest part of a robot with yaws (N,), rad.

    corners  x, y (N,), m, of points relative to the robot's axis, in the frame of the map
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = [np.stack([cos * x + sin * y, cos * y - sin * x], axis=1) for x, y in corners]
    hulls = shapely.convex_hull(shapely.multipoints(np.stack(turned, axis=1)))
    each = [
        shapely.distance(shapely.convex_hull(shapely.MultiPoint(part.corners)), hulls) - part.radius for part in parts
    ]
    return np.asarray(np.minimum.reduce(each))


RISK = 0.05  # accepted probability of contact with an uncertain person at a moment
SIGMAS = float(-ndtri(RISK))
HALVINGS = 30
TABLE = 257  # number of deviations with a tabulated distance
SMALLEST = 0.02  # least tabulated deviation, as a share of the disc; below, a half-plane replaces the disc


def clear_distance(deviation: FloatArray, disc: float) -> FloatArray:
    """Return the distances (T,), m, beyond which a person is within a disc with at most the accepted risk.

    deviation  (T,) m, standard deviation of the person's position
    disc       m, radius of the disc

    Between two tabulated deviations, the larger of their distances is returned.
    """
    deviations, needed = _table(float(disc))
    after = np.clip(np.searchsorted(deviations, deviation), 1, deviations.size - 1)
    unsure = np.maximum(needed[after - 1], needed[after])
    unsure = np.where(deviation > deviations[-1], 0.0, unsure)  # no risk even at its centre
    return np.where(deviation < deviations[0], disc + SIGMAS * deviation, unsure)


@lru_cache(maxsize=256)
def _table(disc: float) -> tuple[FloatArray, FloatArray]:
    """Return deviations, m, up to the largest with any risk, and the distances, m, that reduce it to RISK."""
    largest = disc / math.sqrt(-2.0 * math.log1p(-RISK))
    deviations = np.geomspace(SMALLEST * disc, largest, TABLE)
    size = (disc / deviations) ** 2
    low, high = np.zeros(TABLE), disc + 5.0 * deviations
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        inside = ncx2.cdf(size, 2, (middle / deviations) ** 2) > RISK
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return deviations, high
