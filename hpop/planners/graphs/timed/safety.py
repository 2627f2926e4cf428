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
stay: it holds nowhere there, and for :data:`LEAVING` seconds only contact blocks what leads away. A round robot that
starts in contact may leave that too, by what makes the gap no smaller. What begins at time 0 is not off the clock.
There may be several starts, at different times: each place of a way where another may be taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.errors import QueryError
from hpop.models.collision.parts import Part
from hpop.models.execution import Ramps
from hpop.planners.graphs.timed.clock import SLACK, TickClock, TimeOptions
from hpop.planners.graphs.timed.legs import LegMotions
from hpop.planners.graphs.timed.notice import MovingPeople
from hpop.planners.graphs.timed.pieces import (
    SIGMAS,
    MotionPieces,
    PersonMotion,
    clear_distance,
    strips,
    to_parts,
    to_segments,
    to_strips,
)
from hpop.planners.spending import Spending
from hpop.world.content.people import Person

TOUCH = 1e-9  # m
PAIRS = 1 << 20  # of arcs and ticks that are looked at together
LEAVING = 5.0  # s
SOON = 1.0  # s
DOING = "it was reckoned where people who move are in the way"


class Separation(NamedTuple):
    """What keeps a robot clear of somebody, at times (T,).

    gap   m  between the surfaces, or
    axis  m  from the robot's axis to the middle of the person
    """

    gap: FloatArray
    axis: FloatArray


class Start(NamedTuple):
    """Where plans may begin, x and y in m, and when, s on the clock."""

    x: float
    y: float
    time: float


@dataclass(frozen=True, eq=False)
class Safety:
    """Keeping a robot clear of people by a margin.

    parts    of the robot
    people   who move, each that may be: without futures
    clock
    horizon  H
    margin   m
    starts   where plans begin; none if the robot comes from farther away than anybody's margin
    stray    m  by how much executions are off along their way
    """

    parts: Sequence[Part]
    people: tuple[Person, ...]
    clock: TickClock
    horizon: int
    margin: float
    starts: tuple[Start, ...]
    stray: float
    spending: Spending

    @classmethod
    def of(
        cls,
        company: MovingPeople,
        model: Any,
        options: TimeOptions,
        horizon: int,
        starts: tuple[Start, ...],
        spending: Spending,
        people: Sequence[Person] | None = None,
    ) -> Safety:
        """Return what keeps a robot clear of all that may come of a company, or of those people of it."""
        moving = company.people if people is None else people
        people = tuple(each for person in moving for _, each in person.hypotheses)
        ramps = Ramps.of(model)
        stray = 0.0 if ramps is None else ramps.stray  # where that is not known, each execution is looked at
        return cls(model.platform, people, TickClock(options.tick), horizon, options.margin, starts, stray, spending)

    @cached_property
    def reach(self) -> float:
        """Of the robot about its axis, m."""
        return max((part.reach for part in self.parts), default=0.0)

    @property
    def _slack(self) -> int:
        return self.clock.up_to(SLACK)

    def _axis(self, person: Person, need: Separation) -> FloatArray:
        """How far (T,), m, somebody must be from the robot's axis."""
        return np.asarray(np.minimum(need.gap + self.reach + person.radius, need.axis))

    @cached_property
    def _round(self) -> bool:
        return all(part.on_axis for part in self.parts)

    def needed(self, person: Person, seconds: FloatArray) -> Separation:
        """What keeps the robot clear of somebody at times (T,)."""
        deviation = np.broadcast_to(np.asarray(person.deviation(seconds), float), seconds.shape)
        disc = self.reach + person.radius + self.margin
        return Separation(self.margin + SIGMAS * deviation, clear_distance(deviation, disc))

    @cached_property
    def about_start(self) -> tuple[Person, ...]:
        """Those in whose margin the robot starts, or who come so near within a second."""
        return tuple(dict.fromkeys(person for start in self.starts for person in self.near(start)))

    def near(self, start: Start) -> list[Person]:
        """Those in whose margin a place is at a time, or who come so near within a second."""
        return [person for person, _ in self.coming(start, SOON)]

    def coming(self, start: Start, within: float = LEAVING) -> Iterator[tuple[Person, float]]:
        """Those in whose margin a place is within so many seconds from a time on, and how many first."""
        since = self.clock.seconds(np.arange(self.clock.within(within) + 1))
        for person in self.people:
            need = self._axis(person, self.needed(person, start.time + since)) + self.stray
            inside = _apart(start, person, start.time + since) < need
            if inside.any():
                yield person, float(since[np.argmax(inside)])

    @cached_property
    def touched(self) -> tuple[Person, ...]:
        """Those with whom the robot starts in contact."""
        pairs = ((start, person) for start in self.starts for person in self.people)
        return tuple(dict.fromkeys(person for start, person in pairs if self._touches(start, person)))

    def _touches(self, start: Start, person: Person) -> bool:
        apart = float(_apart(start, person, np.array([start.time]))[0])
        return apart < self.reach + person.radius - TOUCH

    def refuse_contact(self) -> None:
        """Raise QueryError where a robot that is not round would start in contact with somebody."""
        for start in () if self._round else self.starts:
            for person in self.people:
                (apart,) = _apart(start, person, np.array([start.time])).tolist()
                if self._touches(start, person):
                    raise QueryError(
                        f"the start ({start.x:.3f}, {start.y:.3f}) is not usable: {person.name or 'a person who moves'}"
                        f" is there at time {start.time:g}, {apart:.2f} m from the robot's axis, which needs "
                        f"{self.reach + person.radius:.2f} m. Move one of them, or plan for when they are apart."
                    )

    @cached_property
    def _left_by(self) -> int:
        """Tick after which a robot is expected to have left those about its start."""
        return self.clock.up_to(max((start.time for start in self.starts), default=0.0) + LEAVING)

    def cut(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """At which ticks (P, H + 1) nobody may stand at places (P,) until the next one."""
        cut = np.zeros((x.size, self.horizon + 1), dtype=bool)
        ticks = np.arange(self.horizon + 1)
        ones = np.ones_like(ticks)
        places = KDTree(np.stack([x, y], axis=1))
        for person in self.people:
            way, need = PersonMotion.of(person, ticks, ones, self.clock), self._needed_on(person, ticks, ones)
            near = self._axis(person, need) + self.stray + way.stray
            (x0, y0), (x1, y1) = way.ends
            walked = np.hypot(x1 - x0, y1 - y0)
            middles = np.stack([0.5 * (x0 + x1), 0.5 * (y0 + y1)], axis=1)
            found = places.query_ball_point(middles, near + 0.5 * walked)
            for tick in np.flatnonzero(way.there & (near > 0)).tolist():
                own = np.array(found[tick], np.int64)
                gone = (x[own] - x0[tick], y[own] - y0[tick], x[own] - x1[tick], y[own] - y1[tick])
                cut[own, tick] |= to_segments(*gone) < near[tick] - TOUCH
        return self._widened(cut)

    def blocked(self, legs: Sequence[LegMotions], first: int) -> BlockedArcs:
        """Which arcs of some legs must not be left for at which ticks; those from ``first`` on begin a plan."""
        rows, ticks = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for pieces in (MotionPieces.of(leg, self.clock) for leg in legs):
            for person in self.people:
                for own, tick in self._near(pieces, person):
                    some = pieces.take(own)
                    hit = self._hits(some, tick + some.after, person)
                    if person in self.about_start:
                        hit &= ~self._leaves(some, tick + some.after, person)
                    rows.append(some.row[hit])
                    ticks.append(tick[hit])
        blocked = BlockedArcs.of(np.concatenate(rows), np.concatenate(ticks), self.horizon)
        table = self._widened(blocked.table)
        begins = blocked.rows >= first
        table[begins, 0] = blocked.table[begins, 0]
        return BlockedArcs(blocked.rows, table)

    def _near(self, pieces: MotionPieces, person: Person) -> Iterator[tuple[IntArray, IntArray]]:
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

    def _hits(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Whether pieces (N,) that begin at ticks come too near to somebody."""
        way = PersonMotion.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts)
        seen = way.seen_from(pieces)
        near, stray = self._axis(person, need), self.stray
        distance = to_segments(*seen[0], *seen[1]) - way.stray
        hit: BoolArray = way.there & (distance < near + stray - TOUCH)
        some = np.flatnonzero(hit & ~pieces.turns)
        corners = strips(pieces.take(some), seen, some, stray)
        hit[some] = to_strips(corners) - way.stray[some] < near[some] - TOUCH
        if self._round:
            return hit
        own = np.flatnonzero(hit[some])
        some = some[own]
        cos, sin = np.cos(pieces.yaw[some]), np.sin(pieces.yaw[some])
        turned = [np.stack([cos * x[own] + sin * y[own], cos * y[own] - sin * x[own]], axis=1) for x, y in corners]
        gap = to_parts(self.parts, np.stack(turned, axis=1)) - person.radius
        hit[some] = gap - way.stray[some] < need.gap[some] - TOUCH
        return hit

    def _leaves(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Whether pieces lead from where somebody is near, or will be, without contact, soon after such a start.

        One that begins at a start goes ahead of it only, and before it the robot has stood or turned there at most.
        """
        way = PersonMotion.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts)
        begin, end = way.seen_from(pieces)
        comes = person.speed * (SLACK + SOON)
        inside = np.hypot(*begin) < self._axis(person, need) + self.stray + comes
        distance = to_segments(*begin, *end)
        some = np.flatnonzero(inside & ~pieces.turns)
        moves = pieces.take(some)
        each = [np.hypot(moves.start[0] - x, moves.start[1] - y) < TOUCH for x, y, _ in self.starts]
        at_start = np.logical_or.reduce(each)
        distance[some] = to_strips(strips(moves, (begin, end), some, self.stray, at_start))
        clear = distance - way.stray >= self.reach + person.radius - TOUCH
        if self._round and person in self.touched:
            (x, y), (to_x, to_y) = begin, end
            in_contact = np.hypot(x, y) < self.reach + person.radius
            clear |= in_contact & (x * (to_x - x) + y * (to_y - y) >= -TOUCH) & (way.stray <= TOUCH)
        found: BoolArray = inside & clear & (tick <= self._left_by)
        return found

    def _needed_on(self, person: Person, tick: IntArray, lasts: IntArray) -> Separation:
        """The most that is needed at the ends and in the middle of so many ticks."""
        each = [self.needed(person, self.clock.seconds(tick + share * lasts)) for share in (0.0, 0.5, 1.0)]
        return Separation(*(np.maximum.reduce([getattr(need, name) for need in each]) for name in Separation._fields))

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


def _apart(start: Start, person: Person, seconds: FloatArray) -> FloatArray:
    """How far (T,), m, the middle of somebody is from a start, if that is there."""
    x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
    there = np.broadcast_to(np.asarray(person.there(seconds)), seconds.shape) > 0
    return np.where(there, np.hypot(start.x - x, start.y - y), np.inf)


class BlockedArcs(NamedTuple):
    """Arcs that must not be left for at some ticks.

    rows   (b,)  which arcs, rising
    table  (b, H + 1)
    """

    rows: IntArray
    table: BoolArray

    @classmethod
    def of(cls, rows: IntArray, ticks: IntArray, horizon: int) -> BlockedArcs:
        """From pairs (N,) of an arc and a tick, in any order."""
        arcs, which = np.unique(rows, return_inverse=True)
        table = np.zeros((arcs.size, horizon + 1), dtype=bool)
        table[which, ticks] = True
        return cls(arcs, table)
