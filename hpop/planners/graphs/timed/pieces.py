"""Distances between a moving robot and walking people during short pieces of motions, and risks of contact.

A piece is a part of one motion, of at most :data:`PIECE` seconds. A tick is the unit of time of the search.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.motions import HOLD, States, is_curve
from hpop.motions.laws import Phase
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import LegMotions
from hpop.planners.graphs.timed.outlines import Place
from hpop.world.content.people import Person

PAIRS = 1 << 20  # number of pairs of a piece and a tick in one block
PIECE = 0.5  # s, longest duration of a piece
SWUNG = 0.05  # m, by which a point of the robot may leave its place by the change of yaw in a piece of a curve
BETWEEN = 2  # points per tick at which a person's path is compared with a straight line


class Swing(NamedTuple):
    """Distances by which a robot may be beside its plan while it executes a path with curves.

    reach        m     largest distance of a point of the robot from its axis
    stray        m     largest distance by which it is ahead of its plan or behind it, along the path
    curvature    1/m   largest curvature of its paths
    sharpness    1/m²  largest change of the curvature per metre
    """

    reach: float
    stray: float
    curvature: float = 0.0
    sharpness: float = 0.0

    def bend(self, curvature: FloatArray) -> FloatArray:
        """Return the largest curvature (N,), 1/m, near places of given curvature (N,): also within ``stray``."""
        nearby = self.sharpness * self.stray if self.stray > 0.0 else 0.0
        return np.asarray(np.minimum(curvature + nearby, np.maximum(curvature, self.curvature)))

    @property
    def standing(self) -> float:
        """Largest distance, m, of any point from its place while the plan stands, beyond ``stray`` itself."""
        return self.reach * self.stray * self.curvature  # an arc may begin with its whole curvature


def near_people(
    leg: LegMotions, law: Any, people: Iterable[tuple[Person, FloatArray, float]], swing: Swing
) -> LegMotions:
    """Return those motions of a leg that may be near a person, since cutting all curves into pieces takes long.

    people  persons, each with times (T,), s, one tick apart, and a distance, m, that is enough
    """
    from scipy.spatial import KDTree  # slow to import

    bend, stray, near = swing.curvature, swing.stray, np.zeros(leg.lasts.size, dtype=bool)
    travel = law.travel(leg.start, leg.end, swing.reach + 0.0 * leg.lasts) * (1.0 + bend * stray)
    travel = travel + stray * (1.0 + bend * (swing.reach + stray)) + SWUNG
    starts = np.stack([leg.start.x, leg.start.y], axis=1)
    for person, seconds, enough in people:
        path = KDTree(np.stack(np.broadcast_arrays(*person.at(seconds), seconds)[:2], axis=1))
        near |= path.query(starts)[0] <= travel + enough + person.speed * float(np.diff(seconds[:2]).sum())
    return leg.take(np.flatnonzero(near))


class MotionPieces(NamedTuple):
    """Pieces of the robot's motions, so short (:data:`PIECE`) that people walk nearly straight meanwhile.

    row         (N,)  arc to which each piece belongs, as an index into the listed arcs
    start, end  (N,)  m, x and y of the robot
    yaw         (N,)  rad, at the start; on a curve the mean of those at start and end
    after       (N,)  ticks from the departure on the arc to the beginning of the piece
    lasts       (N,)  ticks
    moves       (N,)  whether the robot moves, straight or along a curve
    stands      (N,)  whether it stands; if it neither moves nor stands, it turns in place
    off         (N,)  m, largest distance of any point of the robot from where it is if the robot moves straight, with
                constant yaw, at constant speed; also if it is ahead of its plan or behind it
    """

    row: IntArray
    start: Place
    end: Place
    yaw: FloatArray
    after: IntArray
    lasts: IntArray
    moves: BoolArray
    stands: BoolArray
    off: FloatArray

    @classmethod
    def of(cls, leg: LegMotions, clock: TickClock, law: Any, swing: Swing) -> MotionPieces:
        """Cut the motions of a leg, which are of one kind, into pieces.

        law    law of these motions
        swing  how far the robot may be beside its plan
        """
        ticks = clock.of(leg.lasts)
        count = -(-ticks // max(1, clock.within(PIECE)))
        curved: bool = is_curve(law)
        if curved:
            turned = swing.reach * np.asarray(law.swept(leg.start, leg.end))
            count = np.clip(np.ceil(0.5 * turned / SWUNG).astype(np.int64), count, ticks)
        owner = np.repeat(np.arange(ticks.size), count)
        number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        first, last = (part * ticks[owner] // count[owner] for part in (number, number + 1))
        after = np.rint(leg.after / clock.tick).astype(np.int64)[owner] + first
        rows = np.flatnonzero(leg.of >= 0)
        row = np.empty(ticks.size, np.int64)
        row[leg.of[rows]] = rows
        shares = first / ticks[owner], last / ticks[owner]
        if curved:
            curve = _curve_pieces(law, leg.start.take(owner), leg.end.take(owner), shares, swing)
            return cls(row[owner], *curve[:3], after, last - first, *curve[3:])
        x, y, to_x, to_y = (column[owner] for column in (leg.start.x, leg.start.y, leg.end.x, leg.end.y))
        start, end = ((x + share * (to_x - x), y + share * (to_y - y)) for share in shares)
        moves, stands = (np.full(owner.size, leg.kind == kind) for kind in ("move", HOLD.kind))
        off = np.where(stands, swing.standing, 0.0)
        return cls(row[owner], start, end, leg.start.yaw[owner], after, last - first, moves, stands, off)

    def take(self, rows: IntArray) -> MotionPieces:
        """Return the pieces with the given indices."""
        start, end = ((x[rows], y[rows]) for x, y in (self.start, self.end))
        columns: Any = (column[rows] for column in self[3:])
        return MotionPieces(self.row[rows], start, end, *columns)

    def pairs(self, at: FloatArray, near: float, horizon: int) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield blocks of pairs of a piece and a departure tick, 0 to ``horizon``, at which it may be near a person.

        at    (T, 2)  m, positions of the person at all ticks at which pieces begin
        near  m, distance from the path of the robot's axis, during the piece, that is enough
        """
        from scipy.spatial import KDTree  # slow to import

        (ax, ay), (bx, by) = self.start, self.end
        near += 0.5 * float(np.hypot(bx - ax, by - ay).max(initial=0.0)) + float(self.off.max(initial=0.0))
        middles = KDTree(0.5 * np.stack([ax + bx, ay + by], axis=1))
        step = max(1, PAIRS // max(1, self.row.size))
        for begin in range(0, len(at), step):
            candidates: Any = middles.query_ball_point(at[begin : begin + step], near)
            counts = np.array([len(rows) for rows in candidates])
            own = np.concatenate([np.array(rows, np.int64) for rows in candidates])
            tick = np.repeat(begin + np.arange(counts.size), counts) - self.after[own]
            kept = (tick >= 0) & (tick <= horizon)
            if kept.any():
                yield own[kept], tick[kept]


def _curve_pieces(
    law: Any, start: States, end: States, times: tuple[FloatArray, FloatArray], swing: Swing
) -> tuple[Place, Place, FloatArray, BoolArray, BoolArray, FloatArray]:
    """Return pieces (N,) of curves: start, end, yaw, moves, stands and off of :class:`MotionPieces`.

    On a piece of length l, let the curvature be at most k, also within the distance s by which the robot may be ahead
    of its plan or behind it. Then the path leaves its chord by at most k l²/8, and beyond the ends of the piece by
    k s (l + s)/2 + k² l² s/24 more; the yaw differs from the mean by at most k (l/2 + s).

    start, end  states (N,) at the ends of the curves
    times       (N,)  share of a curve's duration at which each piece begins, and at which it ends
    """
    phases = law.phases(start, end)
    shares = [_share_at(phases, time) for time in times]
    first, last = ({name: law.interpolate(name, start, end, share) for name in ("x", "y", "yaw")} for share in shares)
    way = np.abs(law.travel(start, end, np.zeros(start.size)))
    length = way * (shares[1] - shares[0])
    slopes = [np.abs(law.slopes("yaw", start, end, share)[0]) for share in shares]
    curvature = np.maximum(*slopes) / np.where(way > 0, way, 1.0)
    k, s = swing.bend(curvature), swing.stray
    aside = k * length**2 / 8.0 + k * s * (length + s) / 2.0 + (k * length) ** 2 * s / 24.0
    stands = length <= 0.0
    off = np.where(stands, swing.standing, aside + swing.reach * k * (0.5 * length + s))
    begin, stop = ((each["x"], each["y"]) for each in (first, last))
    return begin, stop, 0.5 * (first["yaw"] + last["yaw"]), ~stands, stands, off


def _share_at(phases: Sequence[Phase], time: FloatArray) -> FloatArray:
    """Return the share (N,) of N motions that is done after a share ``time`` (N,) of their durations."""
    left = time * sum(phase.duration for phase in phases)
    done = np.zeros(time.size)
    for phase in phases:
        lasts = np.broadcast_to(phase.duration, time.shape)
        begun = np.clip(np.divide(left, lasts, out=np.ones(time.size), where=lasts > 0), 0.0, 1.0)
        done = np.where(left > 0.0, phase.share(begun), done)
        left = left - lasts
    return done


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
        key = tick * most + lasts
        seen = np.zeros(int(key.max(initial=0)) + 1, dtype=bool)
        seen[key] = True
        keys, which = np.flatnonzero(seen), (np.cumsum(seen) - 1)[key]
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
