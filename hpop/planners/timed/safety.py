"""Keeping clear of people who move: when arcs must not be left for, and when nobody may stand at a place.

The gap is that between the surfaces of the robot, as its parts say, and of a person. It is kept all along a motion, by
the plan and by its execution: also if the plan is off the clock by :data:`.clock.SLACK`, and the robot, for its ramps,
so far ahead of the plan or behind it as :class:`hpop.models.execution.Ramps` says; where it stands, in any direction,
for it may have come from there, or go there. Where a prediction is uncertain the person must not be nearer
than the margin with more than 5 % at any moment, in any of its futures. That is bounded from above twice, and either is
enough: by the half-plane beyond the nearest point, 1.645 sigma, and by a disc about the robot that holds it and the
person's body, whose share of a normal distribution is one of the noncentral chi-squared.

Along a straight move the gap is exact for people who walk straight on meanwhile; for others the way is taken for its
chord, and the gap for smaller by how far it leaves it. While a robot that is not round turns or stands it counts as the
disc that it sweeps.

A robot that starts within somebody's margin, or into whose margin somebody comes within a second, may leave, but not
stay: it holds nowhere there, and for :data:`LEAVING` seconds only contact blocks what leads away. What begins at time 0
is not off the clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import KDTree
from scipy.special import ndtri
from scipy.stats import ncx2

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.errors import QueryError
from hpop.models.collision.parts import Part
from hpop.planners.spending import Spending
from hpop.planners.timed.clock import SLACK, Clock
from hpop.planners.timed.legs import Leg
from hpop.world.people import Person

RISK = 0.05  # of a prediction at a moment
SIGMAS = float(-ndtri(RISK))
HALVINGS = 30
TABLE = 257  # deviations for which a distance is found
SMALLEST = 0.02  # of them, a share of the disc; below, the half-plane is as good
TOUCH = 1e-9  # m
PAIRS = 1 << 20  # of arcs and ticks that are looked at together
LEAVING = 5.0  # s
SOON = 1.0  # s
PIECE = 0.5  # s
BETWEEN = 2  # places a tick at which a way is compared with its chord
Place = tuple[FloatArray, FloatArray]
DOING = "it was reckoned where people who move are in the way"


class Needed(NamedTuple):
    """What keeps a robot clear of somebody, at times (T,).

    gap   m  between the surfaces, or
    axis  m  from the robot's axis to the middle of the person
    """

    gap: FloatArray
    axis: FloatArray


@dataclass(frozen=True, eq=False)
class Safety:
    """Keeping a robot clear of people by a margin.

    parts    of the robot
    people   who move, each that may be: without futures
    clock
    horizon  H
    margin   m
    start    (x, y) m  where the robot is at tick 0; None if it is under way then
    stray    m  by how much executions are off along their way
    """

    parts: Sequence[Part]
    people: tuple[Person, ...]
    clock: Clock
    horizon: int
    margin: float
    start: tuple[float, float] | None
    stray: float
    spending: Spending

    @cached_property
    def reach(self) -> float:
        """Of the robot about its axis, m."""
        return max((part.reach for part in self.parts), default=0.0)

    @property
    def _slack(self) -> int:
        return self.clock.up_to(SLACK)

    def _axis(self, person: Person, need: Needed) -> FloatArray:
        """How far (T,), m, somebody must be from the robot's axis."""
        return np.asarray(np.minimum(need.gap + self.reach + person.radius, need.axis))

    @cached_property
    def _round(self) -> bool:
        return all(part.on_axis for part in self.parts)

    def needed(self, person: Person, seconds: FloatArray) -> Needed:
        """What keeps the robot clear of somebody at times (T,)."""
        deviation = np.broadcast_to(np.asarray(person.deviation(seconds), float), seconds.shape)
        disc = self.reach + person.radius + self.margin
        return Needed(self.margin + SIGMAS * deviation, _clear_distance(deviation, disc))

    @cached_property
    def about_start(self) -> tuple[Person, ...]:
        """Those in whose margin the robot starts, or who come so near within a second.

        Raises QueryError where it would be in contact with somebody.
        """
        if self.start is None:
            return ()
        found = []
        x, y = self.start
        seconds = self.clock.seconds(np.arange(self.clock.within(SOON) + 1))
        for person in self.people:
            px, py = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
            there = np.broadcast_to(np.asarray(person.there(seconds)), seconds.shape) > 0
            axis = np.where(there, np.hypot(x - px, y - py), np.inf)
            if axis[0] < self.reach + person.radius - TOUCH:
                raise QueryError(
                    f"the start ({x:.3f}, {y:.3f}) is not usable: {person.name or 'a person who moves'} is there at "
                    f"time 0, {axis[0]:.2f} m from the robot's axis, which needs {self.reach + person.radius:.2f} m"
                )
            if (axis < self._axis(person, self.needed(person, seconds)) + self.stray).any():
                found.append(person)
        return tuple(found)

    def cut(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """At which ticks (P, H + 1) nobody may stand at places (P,) until the next one."""
        cut = np.zeros((x.size, self.horizon + 1), dtype=bool)
        ticks = np.arange(self.horizon + 1)
        ones = np.ones_like(ticks)
        places = KDTree(np.stack([x, y], axis=1))
        for person in self.people:
            way, need = _Way.of(person, ticks, ones, self.clock), self._needed_on(person, ticks, ones)
            near = self._axis(person, need) + self.stray + way.stray
            (x0, y0), (x1, y1) = way.ends
            walked = np.hypot(x1 - x0, y1 - y0)
            middles = np.stack([0.5 * (x0 + x1), 0.5 * (y0 + y1)], axis=1)
            found = places.query_ball_point(middles, near + 0.5 * walked)
            for tick in np.flatnonzero(way.there & (near > 0)).tolist():
                own = np.array(found[tick], np.int64)
                gone = (x[own] - x0[tick], y[own] - y0[tick], x[own] - x1[tick], y[own] - y1[tick])
                cut[own, tick] |= _to_segments(*gone) < near[tick] - TOUCH
        return self._widened(cut)

    def blocked(self, legs: Sequence[Leg], first: int) -> Blocked:
        """Which arcs of some legs must not be left for at which ticks; those from ``first`` on begin a plan."""
        rows, ticks = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for pieces in (_Pieces.of(leg, self.clock) for leg in legs):
            for person in self.people:
                for own, tick in self._near(pieces, person):
                    some = pieces.take(own)
                    hit = self._hits(some, tick + some.after, person)
                    if person in self.about_start:
                        hit &= ~self._leaves(some, tick + some.after, person)
                    rows.append(some.row[hit])
                    ticks.append(tick[hit])
        blocked = Blocked.of(np.concatenate(rows), np.concatenate(ticks), self.horizon)
        table = self._widened(blocked.table)
        begins = blocked.rows >= first
        table[begins, 0] = blocked.table[begins, 0]
        return Blocked(blocked.rows, table)

    def _near(self, pieces: _Pieces, person: Person) -> Iterator[tuple[IntArray, IntArray]]:
        """Pieces and the ticks at which their arcs are left for, where somebody may be near."""
        seconds = self.clock.seconds(np.arange(self.horizon + 1))
        need = self.needed(person, seconds)
        near = float(self._axis(person, need).max()) + self.stray
        (ax, ay), (bx, by) = pieces.start, pieces.end
        half = 0.5 * float(np.hypot(bx - ax, by - ay).max(initial=0.0))
        walked = person.speed * self.clock.tick * int((pieces.after + pieces.lasts).max(initial=0))
        at = np.stack(np.broadcast_arrays(*person.at(seconds), seconds)[:2], axis=1)
        middles = KDTree(0.5 * np.stack([ax + bx, ay + by], axis=1))
        step = max(1, PAIRS // max(1, pieces.row.size))
        for begin in range(0, seconds.size, step):
            self.spending.check(DOING)
            found = middles.query_ball_point(at[begin : begin + step], near + walked + half)
            counts = np.array([len(some) for some in found])
            if counts.any():
                own = np.concatenate([np.array(some, np.int64) for some in found])
                yield own, np.repeat(begin + np.arange(counts.size), counts)

    def _hits(self, pieces: _Pieces, tick: IntArray, person: Person) -> BoolArray:
        """Whether pieces (N,) that begin at ticks come too near to somebody."""
        way = _Way.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts)
        seen = way.seen_from(pieces)
        near, stray = self._axis(person, need), self.stray
        distance = _to_segments(*seen[0], *seen[1]) - way.stray
        hit: BoolArray = way.there & (distance < near + stray - TOUCH)
        some = np.flatnonzero(hit & ~pieces.turns)
        strips = _strips(pieces.take(some), seen, some, stray)
        hit[some] = _to_strips(strips) - way.stray[some] < near[some] - TOUCH
        if self._round:
            return hit
        own = np.flatnonzero(hit[some])
        some = some[own]
        cos, sin = np.cos(pieces.yaw[some]), np.sin(pieces.yaw[some])
        corners = np.stack(
            [np.stack([cos * x[own] + sin * y[own], cos * y[own] - sin * x[own]], axis=1) for x, y in strips], axis=1
        )
        gap = _to_parts(self.parts, corners) - person.radius
        hit[some] = gap - way.stray[some] < need.gap[some] - TOUCH
        return hit

    def _leaves(self, pieces: _Pieces, tick: IntArray, person: Person) -> BoolArray:
        """Whether pieces lead from where somebody is near, or will be, without contact, soon after such a start.

        One that begins at the start goes ahead of it only, and before it the robot has stood or turned there at most.
        """
        way = _Way.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts)
        begin, end = way.seen_from(pieces)
        comes = person.speed * (SLACK + SOON)
        inside = np.hypot(*begin) < self._axis(person, need) + self.stray + comes
        distance = _to_segments(*begin, *end)
        some = np.flatnonzero(inside & ~pieces.turns)
        moves = pieces.take(some)
        assert self.start is not None, "or nobody is near it"
        at_start = np.hypot(moves.start[0] - self.start[0], moves.start[1] - self.start[1]) < TOUCH
        distance[some] = _to_strips(_strips(moves, (begin, end), some, self.stray, at_start))
        clear = distance - way.stray >= self.reach + person.radius
        found: BoolArray = inside & clear & (tick <= self.clock.up_to(LEAVING))
        return found

    def _needed_on(self, person: Person, tick: IntArray, lasts: IntArray) -> Needed:
        """The most that is needed at the ends and in the middle of so many ticks."""
        each = [self.needed(person, self.clock.seconds(tick + share * lasts)) for share in (0.0, 0.5, 1.0)]
        return Needed(*(np.maximum.reduce([getattr(need, name) for need in each]) for name in Needed._fields))

    def _widened(self, table: BoolArray) -> BoolArray:
        """What holds at a tick (q, H + 1) also holds so much before and after."""
        slack, width = self._slack, table.shape[1]
        if not table.any() or not slack:
            return table
        some = np.flatnonzero(table.any(axis=1))
        padded = np.pad(table[some], ((0, 0), (slack, slack)), mode="edge")
        counts = np.cumsum(padded, axis=1, dtype=np.int32)
        counts = np.pad(counts, ((0, 0), (1, 0)))
        wide = table.copy()
        wide[some] = counts[:, 2 * slack + 1 :] - counts[:, :width] > 0
        return wide


class Blocked(NamedTuple):
    """Arcs that must not be left for at some ticks.

    rows   (b,)  which arcs, rising
    table  (b, H + 1)
    """

    rows: IntArray
    table: BoolArray

    @classmethod
    def of(cls, rows: IntArray, ticks: IntArray, horizon: int) -> Blocked:
        """From pairs (N,) of an arc and a tick, in any order."""
        arcs, which = np.unique(rows, return_inverse=True)
        table = np.zeros((arcs.size, horizon + 1), dtype=bool)
        table[which, ticks] = True
        return cls(arcs, table)


class _Pieces(NamedTuple):
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
    def of(cls, leg: Leg, clock: Clock) -> _Pieces:
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

    def take(self, rows: IntArray) -> _Pieces:
        """Some of them."""
        start, end = ((x[rows], y[rows]) for x, y in (self.start, self.end))
        return _Pieces(self.row[rows], start, end, self.yaw[rows], self.after[rows], self.lasts[rows], self.turns[rows])


class _Way(NamedTuple):
    """Where somebody walks during motions (N,).

    ends   x, y (N,), m, at their begin and at their end
    stray  (N,)  m, how far it leaves the line between these, walked evenly
    there  (N,)  whether it is there at any time of them
    """

    ends: tuple[Place, Place]
    stray: FloatArray
    there: BoolArray

    @classmethod
    def of(cls, person: Person, tick: IntArray, lasts: IntArray, clock: Clock) -> _Way:
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

    def seen_from(self, pieces: _Pieces) -> tuple[Place, Place]:
        """Ways (x, y), m, from the robot to the person at both ends of pieces."""
        (x, y), (to_x, to_y) = self.ends
        (ax, ay), (bx, by) = pieces.start, pieces.end
        return (x - ax, y - ay), (to_x - bx, to_y - by)


def _clear_distance(deviation: FloatArray, disc: float) -> FloatArray:
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


def _to_segments(ax: FloatArray, ay: FloatArray, bx: FloatArray, by: FloatArray) -> FloatArray:
    """Distance (N,) of the origin from segments a b."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = np.clip(np.divide(-(ax * dx + ay * dy), square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(ax + share * dx, ay + share * dy))


def _strips(
    pieces: _Pieces, seen: tuple[Place, Place], rows: IntArray, stray: float, at_start: BoolArray | None = None
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


def _to_strips(corners: tuple[Place, ...]) -> FloatArray:
    """Distance (N,), m, of the origin from convex quadrilaterals; 0 within them."""
    following = [*corners[1:], corners[0]]
    edges = [_to_segments(*one, *other) for one, other in zip(corners, following, strict=True)]
    sides = [ax * by - ay * bx for (ax, ay), (bx, by) in zip(corners, following, strict=True)]
    inside = (np.minimum.reduce(sides) > 0) | (np.maximum.reduce(sides) < 0)
    return np.where(inside, 0.0, np.minimum.reduce(edges))


def _to_parts(parts: Sequence[Part], corners: FloatArray) -> FloatArray:
    """Distance (N,) of the hulls of points (N, c, 2) in the frame of the base from the nearest of some parts."""
    hulls = shapely.convex_hull(shapely.multipoints(corners))
    each = [
        shapely.distance(shapely.convex_hull(shapely.MultiPoint(part.corners)), hulls) - part.radius for part in parts
    ]
    return np.asarray(np.minimum.reduce(each))
