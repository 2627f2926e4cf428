"""Separation from people who move: ticks at which arcs are blocked, and at which the robot must not stand at a place.

The gap is the distance between the surfaces of the robot's parts and of a person. It is kept all along a motion, by the
plan and by its execution, even if the plan deviates from the clock by :data:`.clock.SLACK` and the robot from the plan
by the distance of :class:`hpop.models.execution.Ramps` (in any direction where it stands). Where a prediction is
uncertain, the probability that the person is nearer than the margin must not exceed 5 % at any moment, in any
hypothesis. Two upper bounds of it are used, and either is enough: the half-plane beyond the nearest point (1.645
sigma), and a disc about the robot that covers it and the person's body (the noncentral chi-squared distribution).

Along a straight move the gap is exact for people who walk straight meanwhile. Other paths of people are replaced by
their chords, and the gap is reduced by their distance from it. While a robot that is not round turns or stands, it
counts as the disc that it sweeps.

A robot that starts within a person's margin, or comes into it within a second, may leave but not stay: it must not hold
there, and for :data:`LEAVING` seconds only contact blocks the arcs that lead away. A round robot that starts in contact
may leave it by motions that do not reduce the gap. Plans that begin at time 0 do not deviate from the clock there.
There may be several starts at different times: each place where a drive may change its plan.
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
PAIRS = 1 << 20  # of arcs and ticks in one block
LEAVING = 5.0  # s
SOON = 1.0  # s
DOING = "arcs in the way of moving people were computed"


class Separation(NamedTuple):
    """Distances (T,) from a person; either one is enough.

    gap   m  between the surfaces
    axis  m  from the robot's axis to the person's centre
    """

    gap: FloatArray
    axis: FloatArray


class Start(NamedTuple):
    """A place where plans may begin: x and y, m, and time, s on the clock."""

    x: float
    y: float
    time: float


@dataclass(frozen=True, eq=False)
class Safety:
    """Separation constraints for every hypothesis of every moving person.

    parts    of the robot
    people   hypotheses of the moving people
    clock
    horizon  H
    margin   m
    starts   where plans begin; empty if the robot comes from outside every person's margin
    stray    m  largest deviation of executions along their path
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
        moving_people: MovingPeople,
        model: Any,
        options: TimeOptions,
        horizon: int,
        starts: tuple[Start, ...],
        spending: Spending,
        people: Sequence[Person] | None = None,
    ) -> Safety:
        """Return the constraints for all hypotheses of the moving people, or of some people."""
        moving = moving_people.people if people is None else people
        people = tuple(each for person in moving for _, each in person.hypotheses)
        ramps = Ramps.of(model)
        stray = 0.0 if ramps is None else ramps.stray  # if unknown, each execution is checked
        return cls(model.platform, people, TickClock(options.tick), horizon, options.margin, starts, stray, spending)

    @cached_property
    def reach(self) -> float:
        """Reach of the robot about its axis, m."""
        return max((part.reach for part in self.parts), default=0.0)

    @property
    def _slack(self) -> int:
        return self.clock.up_to(SLACK)

    def _axis(self, person: Person, need: Separation) -> FloatArray:
        """Return the least distances (T,), m, of a person from the robot's axis."""
        return np.asarray(np.minimum(need.gap + self.reach + person.radius, need.axis))

    @cached_property
    def _round(self) -> bool:
        return all(part.on_axis for part in self.parts)

    def needed(self, person: Person, seconds: FloatArray) -> Separation:
        """Return the distances from a person needed at times (T,)."""
        deviation = np.broadcast_to(np.asarray(person.deviation(seconds), float), seconds.shape)
        disc = self.reach + person.radius + self.margin
        return Separation(self.margin + SIGMAS * deviation, clear_distance(deviation, disc))

    @cached_property
    def about_start(self) -> tuple[Person, ...]:
        """Hypotheses with the robot's start in their margin, then or within a second."""
        return tuple(dict.fromkeys(person for start in self.starts for person in self.near(start)))

    def near(self, start: Start) -> list[Person]:
        """Return the hypotheses with a start in their margin, then or within a second."""
        return [person for person, _ in self.coming(start, SOON)]

    def coming(self, start: Start, within: float = LEAVING) -> Iterator[tuple[Person, float]]:
        """Yield the hypotheses that have a start in their margin within some seconds, each with the first time, s."""
        since = self.clock.seconds(np.arange(self.clock.within(within) + 1))
        for person in self.people:
            need = self._axis(person, self.needed(person, start.time + since)) + self.stray
            inside = _apart(start, person, start.time + since) < need
            if inside.any():
                yield person, float(since[np.argmax(inside)])

    @cached_property
    def touched(self) -> tuple[Person, ...]:
        """Hypotheses in contact with the robot at its start."""
        pairs = ((start, person) for start in self.starts for person in self.people)
        return tuple(dict.fromkeys(person for start, person in pairs if self._touches(start, person)))

    def _touches(self, start: Start, person: Person) -> bool:
        apart = float(_apart(start, person, np.array([start.time]))[0])
        return apart < self.reach + person.radius - TOUCH

    def refuse_contact(self) -> None:
        """Raise QueryError where a robot that is not round would start in contact with a person."""
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
        """Tick by which a robot must have left the people about its start."""
        return self.clock.up_to(max((start.time for start in self.starts), default=0.0) + LEAVING)

    def cut(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Mark ticks (P, H + 1) from which the robot must not stand at places (P,) until the next tick."""
        cut = np.zeros((x.size, self.horizon + 1), dtype=bool)
        ticks = np.arange(self.horizon + 1)
        lasts = np.ones_like(ticks)
        places = KDTree(np.stack([x, y], axis=1))
        for person in self.people:
            walk, need = PersonMotion.of(person, ticks, lasts, self.clock), self._needed_on(person, ticks, lasts)
            near = self._axis(person, need) + self.stray + walk.stray
            (x0, y0), (x1, y1) = walk.ends
            walked = np.hypot(x1 - x0, y1 - y0)
            middles = np.stack([0.5 * (x0 + x1), 0.5 * (y0 + y1)], axis=1)
            candidates = places.query_ball_point(middles, near + 0.5 * walked)
            for tick in np.flatnonzero(walk.there & (near > 0)).tolist():
                own = np.array(candidates[tick], np.int64)
                relative = (x[own] - x0[tick], y[own] - y0[tick], x[own] - x1[tick], y[own] - y1[tick])
                cut[own, tick] |= to_segments(*relative) < near[tick] - TOUCH
        return self._widened(cut)

    def blocked(self, legs: Sequence[LegMotions], first: int) -> BlockedArcs:
        """Return the ticks at which arcs are blocked; arcs from ``first`` on begin a plan."""
        rows, ticks = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for pieces in (MotionPieces.of(leg, self.clock) for leg in legs):
            for person in self.people:
                for own, tick in self._near(pieces, person):
                    part = pieces.take(own)
                    hit = self._hits(part, tick + part.after, person)
                    if person in self.about_start:
                        hit &= ~self._leaves(part, tick + part.after, person)
                    rows.append(part.row[hit])
                    ticks.append(tick[hit])
        blocked = BlockedArcs.of(np.concatenate(rows), np.concatenate(ticks), self.horizon)
        table = self._widened(blocked.table)
        begins = blocked.rows >= first
        table[begins, 0] = blocked.table[begins, 0]
        return BlockedArcs(blocked.rows, table)

    def _near(self, pieces: MotionPieces, person: Person) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield pieces, with the ticks at which their arcs depart, that may be near a person."""
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
            candidates = middles.query_ball_point(at[begin : begin + step], near + walked + half)
            counts = np.array([len(rows) for rows in candidates])
            if counts.any():
                own = np.concatenate([np.array(rows, np.int64) for rows in candidates])
                yield own, np.repeat(begin + np.arange(counts.size), counts)

    def _hits(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Mark pieces (N,), which begin at ticks (N,), that come too near to a person."""
        walk = PersonMotion.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts)
        seen = walk.seen_from(pieces)
        near, stray = self._axis(person, need), self.stray
        distance = to_segments(*seen[0], *seen[1]) - walk.stray
        hit: BoolArray = walk.there & (distance < near + stray - TOUCH)
        some = np.flatnonzero(hit & ~pieces.turns)
        corners = strips(pieces.take(some), seen, some, stray)
        hit[some] = to_strips(corners) - walk.stray[some] < near[some] - TOUCH
        if self._round:
            return hit
        own = np.flatnonzero(hit[some])
        some = some[own]
        cos, sin = np.cos(pieces.yaw[some]), np.sin(pieces.yaw[some])
        turned = [np.stack([cos * x[own] + sin * y[own], cos * y[own] - sin * x[own]], axis=1) for x, y in corners]
        gap = to_parts(self.parts, np.stack(turned, axis=1)) - person.radius
        hit[some] = gap - walk.stray[some] < need.gap[some] - TOUCH
        return hit

    def _leaves(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Mark pieces (N,) that leave a person who is near or comes near, without contact, soon after a start.

        A piece that begins at a start only goes ahead of it, as the robot has at most stood or turned there before.
        """
        walk = PersonMotion.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts)
        begin, end = walk.seen_from(pieces)
        comes = person.speed * (SLACK + SOON)
        inside = np.hypot(*begin) < self._axis(person, need) + self.stray + comes
        distance = to_segments(*begin, *end)
        some = np.flatnonzero(inside & ~pieces.turns)
        moves = pieces.take(some)
        each = [np.hypot(moves.start[0] - x, moves.start[1] - y) < TOUCH for x, y, _ in self.starts]
        at_start = np.logical_or.reduce(each)
        distance[some] = to_strips(strips(moves, (begin, end), some, self.stray, at_start))
        clear = distance - walk.stray >= self.reach + person.radius - TOUCH
        if self._round and person in self.touched:
            (x, y), (to_x, to_y) = begin, end
            in_contact = np.hypot(x, y) < self.reach + person.radius
            clear |= in_contact & (x * (to_x - x) + y * (to_y - y) >= -TOUCH) & (walk.stray <= TOUCH)
        leaves: BoolArray = inside & clear & (tick <= self._left_by)
        return leaves

    def _needed_on(self, person: Person, tick: IntArray, lasts: IntArray) -> Separation:
        """Return the largest distances needed at the ends and in the middle of some ticks."""
        each = [self.needed(person, self.clock.seconds(tick + share * lasts)) for share in (0.0, 0.5, 1.0)]
        return Separation(*(np.maximum.reduce([getattr(need, name) for need in each]) for name in Separation._fields))

    def _widened(self, table: BoolArray) -> BoolArray:
        """Extend marks (q, H + 1) to the ticks within the slack before and after them."""
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
    """Return the distances (T,), m, of a person's centre from a start; infinite while the person is absent."""
    x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
    is_there = np.broadcast_to(np.asarray(person.there(seconds)), seconds.shape) > 0
    return np.where(is_there, np.hypot(start.x - x, start.y - y), np.inf)


class BlockedArcs(NamedTuple):
    """Arcs that are blocked for departures at some ticks.

    rows   (b,)  arcs, rising
    table  (b, H + 1)  mask
    """

    rows: IntArray
    table: BoolArray

    @classmethod
    def of(cls, rows: IntArray, ticks: IntArray, horizon: int) -> BlockedArcs:
        """Return the mask of pairs (N,) of an arc and a tick, in any order."""
        arcs, which = np.unique(rows, return_inverse=True)
        table = np.zeros((arcs.size, horizon + 1), dtype=bool)
        table[which, ticks] = True
        return cls(arcs, table)
