"""Distances between a moving robot and walking people during short pieces of motions, and risks of contact.

A piece is a part of one motion, of at most :data:`PIECE` seconds. A tick is the unit of time of the search.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.collision import Part
from hpop.motions import HOLD
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import LegMotions
from hpop.world.content.people import Person

PIECE = 0.5  # s, longest duration of a piece
BETWEEN = 2  # points per tick at which a person's path is compared with a straight line
Place = tuple[FloatArray, FloatArray]  # x and y (N,) of points, m


class MotionPieces(NamedTuple):
    """Pieces of the robot's motions, so short (:data:`PIECE`) that people walk nearly straight meanwhile.

    row         (N,)  arc to which each piece belongs, as an index into the listed arcs
    start, end  (N,)  m, x and y of the robot
    yaw         (N,)  rad, at the start
    after       (N,)  ticks from the departure on the arc to the beginning of the piece
    lasts       (N,)  ticks
    moves       (N,)  whether the robot moves straight
    stands      (N,)  whether it stands; if it neither moves nor stands, it turns in place
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
        """Cut the motions of a leg, which are of one kind, into pieces."""
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
        """Return the pieces with the given indices."""
        start, end = ((x[rows], y[rows]) for x, y in (self.start, self.end))
        after, lasts, moves, stands = self.after[rows], self.lasts[rows], self.moves[rows], self.stands[rows]
        return MotionPieces(self.row[rows], start, end, self.yaw[rows], after, lasts, moves, stands)


class PersonMotion(NamedTuple):
    """Motion of a person during each of N motions of a robot, approximated by a straight walk at constant speed.

    ends   x, y (N,), m, of the person at the beginning and at the end of each motion
    stray  (N,)  m, largest distance of the person from that straight walk
    there  (N,)  whether the person is present at any time during the motion
    """

    ends: tuple[Place, Place]
    stray: FloatArray
    there: BoolArray

    @classmethod
    def of(cls, person: Person, tick: IntArray, lasts: IntArray, clock: TickClock) -> PersonMotion:
        """Return a person's motion while a robot moves, from each tick (N,) on, for ``lasts`` (N,) ticks."""
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
        """Return the positions x, y (N,), m, of the person relative to the robot at the start and end of pieces."""
        (x, y), (to_x, to_y) = self.ends
        (ax, ay), (bx, by) = pieces.start, pieces.end
        return (x - ax, y - ay), (to_x - bx, to_y - by)


def to_segments(ax: FloatArray, ay: FloatArray, bx: FloatArray, by: FloatArray) -> FloatArray:
    """Return the distance (N,), m, of the origin from the line segments from a to b, given by coordinates."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = np.clip(np.divide(-(ax * dx + ay * dy), square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(ax + share * dx, ay + share * dy))


def strips(
    pieces: MotionPieces, seen: tuple[Place, Place], rows: IntArray, stray: float, at_start: BoolArray | None = None
) -> tuple[Place, ...]:
    """Return quadrilaterals that contain all positions of a person relative to a robot during straight moves.

    The robot may be ahead of its plan or behind it, so the relative path is widened to a strip along the move. The
    result is the four corners, each as x and y (N,), m.

    pieces    (N,) moves of the robot
    seen      positions of the person relative to the robot at the beginning and end of all pieces
    rows      (N,) indices of ``pieces`` among all pieces
    stray     m, largest distance of the robot from its planned position
    at_start  (N,)  mask of pieces at whose beginning the robot cannot be behind its plan
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


class Separation(NamedTuple):
    """Distances (T,) from a person at some times; a robot is far enough away if it keeps at least one of the two.

    gap   m  between the surfaces
    axis  m  from the robot's axis to the person's centre
    """

    gap: FloatArray
    axis: FloatArray


def of_rows(places: tuple[Place, ...], rows: IntArray) -> tuple[Place, ...]:
    """Return the points with the given indices, for each of several arrays of points."""
    return tuple((x[rows], y[rows]) for x, y in places)


def to_strips(corners: tuple[Place, ...]) -> FloatArray:
    """Return the distance (N,), m, of the origin from N convex quadrilaterals, given by four corners; 0 inside."""
    following = [*corners[1:], corners[0]]
    edges = [to_segments(*begin, *end) for begin, end in zip(corners, following, strict=True)]
    sides = [ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)]
    inside = (np.minimum.reduce(sides) > 0) | (np.maximum.reduce(sides) < 0)
    return np.where(inside, 0.0, np.minimum.reduce(edges))


def to_parts(parts: Sequence[Part], yaw: FloatArray, corners: Sequence[Place]) -> FloatArray:
    """Return the distance (N,), m, of the nearest part of a robot with yaws (N,), rad, from a convex set of points.

    It is the distance between surfaces; the radius of a rounded part is taken off.

    parts    parts of the robot's outline
    corners  x, y (N,), m, of points whose convex hull is the set, relative to the robot's axis, in the map's frame
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = [np.stack([cos * x + sin * y, cos * y - sin * x], axis=1) for x, y in corners]
    hulls = shapely.convex_hull(shapely.multipoints(np.stack(turned, axis=1)))
    each = [
        shapely.distance(shapely.convex_hull(shapely.MultiPoint(part.corners)), hulls) - part.radius for part in parts
    ]
    return np.asarray(np.minimum.reduce(each))


RISK = 0.05  # accepted probability that a person with an uncertain position is too near, at any moment
SIGMAS = 1.6448536269514729  # a normal variable exceeds this many standard deviations with probability RISK
HALVINGS = 30
TABLE = 257  # number of standard deviations for which a distance is tabulated
SMALLEST = 0.02  # smallest of them, as a share of the disc's radius; below it, the disc is replaced by a half-plane


def clear_distance(deviation: FloatArray, disc: float) -> FloatArray:
    """Return the distance (T,), m, from a person's expected position at which a disc is safe enough.

    At this distance or more, the probability that the person is within the disc is at most RISK. Between two tabulated
    deviations, the larger of their distances is returned.

    deviation  (T,) m, standard deviation of the person's position
    disc       m, radius of the disc
    """
    if np.all(deviation < SMALLEST * disc):
        return disc + SIGMAS * deviation
    deviations, needed = _table(float(disc))
    after = np.clip(np.searchsorted(deviations, deviation), 1, deviations.size - 1)
    unsure = np.maximum(needed[after - 1], needed[after])
    unsure = np.where(deviation > deviations[-1], 0.0, unsure)  # no risk even at its centre
    return np.where(deviation < deviations[0], disc + SIGMAS * deviation, unsure)


@lru_cache(maxsize=256)
def _table(disc: float) -> tuple[FloatArray, FloatArray]:
    """Return standard deviations, m, and for each the distance, m, at which the probability of :data:`RISK` is reached.

    At larger deviations than the last one, the probability is smaller even if the person is expected in the centre.

    disc  m, radius of the disc
    """
    from scipy.stats import ncx2  # slow to import

    largest = disc / math.sqrt(-2.0 * math.log1p(-RISK))
    deviations = np.geomspace(SMALLEST * disc, largest, TABLE)
    size = (disc / deviations) ** 2
    low, high = np.zeros(TABLE), disc + 5.0 * deviations
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        inside = ncx2.cdf(size, 2, (middle / deviations) ** 2) > RISK
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return deviations, high
