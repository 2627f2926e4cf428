"""Separation from people who move: ticks at which arcs are blocked, and at which the robot must not stand at a place.

The gap is the distance between the surfaces of the robot's parts and of a person. It is kept all along a motion, by the
plan and by its execution, even if the plan deviates from the clock by :data:`.clock.SLACK` and the robot from the plan
by the distance of :class:`hpop.models.execution.Ramps` (in any direction where it stands). Where a prediction is
uncertain, the probability that the person is nearer than the margin must not exceed 5 % at any moment, in any
hypothesis. Two upper bounds of it are used, and either is enough: the half-plane beyond the nearest point (1.645
sigma), and a disc about the robot that covers it and the person's body (the noncentral chi-squared distribution).

Along a straight move the gap is exact for people who walk straight meanwhile. Other paths of people are replaced by
their chords, and the gap is reduced by their distance from it. While a robot that is not round turns or waits, it
counts as the disc that it sweeps.

A robot that starts within a person's margin, or comes into it within a second, may leave but not stay: it must not hold
there, and for :data:`LEAVING` seconds only contact blocks the arcs that lead away, or a chance of contact above 5 %. A
round robot that starts in contact, and any robot that starts with such a chance or gets it within a second, may leave
by motions that do not reduce the gap. Plans that begin at time 0 do not deviate from the clock there. There may be
several starts at different times: each place where a drive may change its plan.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
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
    Place,
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
EARLY = 1e-3  # of a piece, at whose beginning a convex gap is seen to grow
DOING = "arcs in the way of moving people were computed"


class Separation(NamedTuple):
    """Distances (T,) from a person; either one is enough.

    gap   m  between the surfaces
    axis  m  from the robot's axis to the person's centre
    """

    gap: FloatArray
    axis: FloatArray


class Start(NamedTuple):
    """A place where plans may begin: x and y, m, yaw, rad, and time, s on the clock."""

    x: float
    y: float
    yaw: float
    time: float


@dataclass(frozen=True, eq=False)
class Safety:
    """Separation constraints for every hypothesis of every moving person.

    parts    of the robot
    people   hypotheses of the moving people
    clock
    margin   m
    starts   where plans begin; empty if the robot comes from outside every person's margin
    stray    m  largest deviation of executions along their path
    """

    parts: Sequence[Part]
    people: tuple[Person, ...]
    clock: TickClock
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
        starts: tuple[Start, ...],
        spending: Spending,
        people: Sequence[Person] | None = None,
    ) -> Safety:
        """Return the constraints for all hypotheses of the moving people, or of some people."""
        moving = moving_people.people if people is None else people
        people = tuple(each for person in moving for _, each in person.hypotheses)
        ramps = Ramps.of(model)
        stray = 0.0 if ramps is None else ramps.stray  # if unknown, each execution is checked
        return cls(model.platform, people, TickClock(options.tick), options.margin, starts, stray, spending)

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

    def needed(self, person: Person, seconds: FloatArray, margin: float) -> Separation:
        """Return the distances from a person needed at times (T,) for a margin, m; 0: for no contact."""
        deviation = np.broadcast_to(np.asarray(person.deviation(seconds), float), seconds.shape)
        disc = self.reach + person.radius + margin
        return Separation(margin + SIGMAS * deviation, clear_distance(deviation, disc))

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
            need = self._axis(person, self.needed(person, start.time + since, self.margin)) + self.stray
            inside = _apart(start, person, start.time + since) < need
            if inside.any():
                yield person, float(since[np.argmax(inside)])

    @cached_property
    def touched(self) -> tuple[Person, ...]:
        """Hypotheses in contact with the robot at its start, or with a chance above 5 % of contact within a second."""
        pairs = ((start, person) for start in self.starts for person in self.people)
        return tuple(dict.fromkeys(person for start, person in pairs if self._touches(start, person)))

    def _touches(self, start: Start, person: Person) -> bool:
        is_certain = not (person.spread or person.growth)
        since = np.zeros(1) if is_certain else self.clock.seconds(np.arange(self.clock.within(SOON) + 1))
        seconds = start.time + since
        need = self.needed(person, seconds, 0.0)
        near = _apart(start, person, seconds) < need.axis - TOUCH
        return bool((near & (self._gap(start, person, seconds) < need.gap - TOUCH)).any())

    def _gap(self, start: Start, person: Person, seconds: FloatArray) -> FloatArray:
        """Return the gaps (T,), m, between the surfaces of the robot at a start and a person, where that is there."""
        x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
        return to_parts(self.parts, np.full(x.size, start.yaw), [(x - start.x, y - start.y)]) - person.radius

    def refuse_contact(self) -> None:
        """Raise QueryError where a robot that is not round would start in contact with a person."""
        for start in () if self._round else self.starts:
            now = np.array([start.time])
            for person in self.people:
                (gap,) = self._gap(start, person, now).tolist()
                if gap < -TOUCH and np.isfinite(_apart(start, person, now)).all():
                    raise QueryError(
                        f"the start ({start.x:.3f}, {start.y:.3f}) is not usable: {person.name or 'a person who moves'}"
                        f" is there at time {start.time:g}, and overlaps the robot's outline by {-gap:.3f} m. Move "
                        "one of them, or plan for when they are apart."
                    )

    @cached_property
    def _left_by(self) -> int:
        """Tick by which a robot must have left the people about its start."""
        return self.clock.up_to(self._leaves_until)

    @property
    def _leaves_until(self) -> float:
        """Time, s, by which a robot must have left the people about its start."""
        return max((start.time for start in self.starts), default=0.0) + LEAVING

    def settled(self, seconds: float) -> float:
        """Return the time, s, from which on no tick is blocked or cut anew, if people are settled from a time on, s.

        Until it may leave no more, a robot may be near people who stay about its start.
        """
        stays = any(person.there(seconds + SLACK) > 0 for person in self.about_start)
        return max(seconds, self._leaves_until) if stays else seconds

    def cut(self, x: FloatArray, y: FloatArray, horizon: int) -> BoolArray:
        """Mark ticks (P, H + 1), up to a horizon, from which the robot must not stand at places (P,) for a tick."""
        cut = np.zeros((x.size, horizon + 1), dtype=bool)
        ticks = np.arange(horizon + 1)
        lasts = np.ones_like(ticks)
        places = KDTree(np.stack([x, y], axis=1))
        for person in self.people:
            walk = PersonMotion.of(person, ticks, lasts, self.clock)
            need = self._needed_on(person, ticks, lasts, self.margin)
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

    def blocked(self, legs: Sequence[LegMotions], first: int, horizon: int) -> BlockedArcs:
        """Return the ticks, up to a horizon, at which arcs are blocked; arcs from ``first`` on begin a plan."""
        rows, ticks = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for pieces in (MotionPieces.of(leg, self.clock) for leg in legs):
            for person in self.people:
                for own, tick in self._near(pieces, person, horizon):
                    part = pieces.take(own)
                    hit = self._hits(part, tick + part.after, person)
                    if person in self.about_start:
                        hit &= ~self._leaves(part, tick + part.after, person)
                    rows.append(part.row[hit])
                    ticks.append(tick[hit])
        blocked = BlockedArcs.of(np.concatenate(rows), np.concatenate(ticks), horizon)
        table = self._widened(blocked.table)
        begins = blocked.rows >= first
        table[begins, 0] = blocked.table[begins, 0]
        return BlockedArcs(blocked.rows, table)

    def _near(self, pieces: MotionPieces, person: Person, horizon: int) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield pieces, with the ticks at which their arcs depart, that may be near a person."""
        seconds = self.clock.seconds(np.arange(horizon + 1))
        need = self.needed(person, seconds, self.margin)
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
        need = self._needed_on(person, tick, pieces.lasts, self.margin)
        seen = walk.seen_from(pieces)
        near, stray = self._axis(person, need), self.stray
        distance = to_segments(*seen[0], *seen[1]) - walk.stray
        hit: BoolArray = walk.there & (distance < near + stray - TOUCH)
        some = np.flatnonzero(hit & pieces.moves)
        corners = strips(pieces.take(some), seen, some, stray)
        hit[some] = to_strips(corners) - walk.stray[some] < near[some] - TOUCH
        if self._round:
            return hit
        own = np.flatnonzero(hit[some])
        some, corners = some[own], _of_rows(corners, own)
        hit[some] = self._outline_gaps(pieces, some, corners, person, walk) < need.gap[some] - TOUCH
        some = np.flatnonzero(hit & pieces.stands)
        ends = _of_rows(seen, some)
        hit[some] = self._outline_gaps(pieces, some, ends, person, walk) - stray < need.gap[some] - TOUCH
        return hit

    def _outline_gaps(
        self, pieces: MotionPieces, rows: IntArray, corners: tuple[Place, ...], person: Person, walk: PersonMotion
    ) -> FloatArray:
        """Return the gaps (N,), m, of a person within a hull of points from the robot, in some pieces without turns."""
        return to_parts(self.parts, pieces.yaw[rows], corners) - person.radius - walk.stray[rows]

    def _leaves(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Mark pieces (N,) that leave a person who is near or comes near, without contact, soon after a start.

        A piece that begins at a start only goes ahead of it, as the robot has at most stood or turned there before.
        """
        walk = PersonMotion.of(person, tick, pieces.lasts, self.clock)
        need, touch = (self._needed_on(person, tick, pieces.lasts, margin) for margin in (self.margin, 0.0))
        seen = begin, end = walk.seen_from(pieces)
        comes = person.speed * (SLACK + SOON)
        inside = np.hypot(*begin) < self._axis(person, need) + self.stray + comes
        near, distance = self._axis(person, touch), to_segments(*begin, *end)
        some = np.flatnonzero(inside & pieces.moves)
        moves = pieces.take(some)
        each = [np.hypot(moves.start[0] - start.x, moves.start[1] - start.y) < TOUCH for start in self.starts]
        corners = strips(moves, seen, some, self.stray, np.logical_or.reduce(each))
        distance[some] = to_strips(corners)
        clear = distance - walk.stray >= near - TOUCH
        if not self._round:
            own = np.flatnonzero(~clear[some])
            some, corners = some[own], _of_rows(corners, own)
            clear[some] = self._outline_gaps(pieces, some, corners, person, walk) >= touch.gap[some] - TOUCH
            some = np.flatnonzero(inside & pieces.stands)
            ends = _of_rows(seen, some)
            clear[some] |= self._outline_gaps(pieces, some, ends, person, walk) >= touch.gap[some] - TOUCH
        if person in self.touched:
            clear |= self._parts_from(pieces, tick, person, touch)
        leaves: BoolArray = inside & clear & (tick <= self._left_by)
        return leaves

    def _parts_from(self, pieces: MotionPieces, tick: IntArray, person: Person, touch: Separation) -> BoolArray:
        """Mark pieces (N,) that begin in contact, or so near that a robot behind its plan is, and never reduce the gap.

        Between the corners of a person's path, the gap of a robot that does not turn is convex in time, so it never
        shrinks if it does not shrink at first.
        """
        begin, end = (self.clock.seconds(ticks)[:, None] for ticks in (tick, tick + pieces.lasts))
        corners = person.way()[:, 0]
        corners = corners[(corners > begin.min(initial=np.inf)) & (corners < end.max(initial=-np.inf))]
        times = np.concatenate([begin, np.clip(corners, begin, end), end], axis=1)
        share = (times - begin) / (end - begin)
        (ax, ay), (bx, by) = pieces.start, pieces.end
        x, y = person.at(times)
        x, y = x - ax[:, None] - share * (bx - ax)[:, None], y - ay[:, None] - share * (by - ay)[:, None]
        parts = np.ones(tick.size, dtype=bool)
        if self._round:
            in_contact = np.hypot(x[:, 0], y[:, 0]) < self._axis(person, touch) + self.stray
        else:
            parts = pieces.moves | pieces.stands
            in_contact = to_parts(self.parts, pieces.yaw, [(x[:, 0], y[:, 0])]) - person.radius < touch.gap + self.stray
        for (x0, x1), (y0, y1), (since, until) in zip(*(pairwise(c.T) for c in (x, y, times)), strict=True):
            dx, dy = x1 - x0, y1 - y0
            if self._round:
                grows = x0 * dx + y0 * dy >= -TOUCH
            else:
                gap, then = (to_parts(self.parts, pieces.yaw, [(x0 + s * dx, y0 + s * dy)]) for s in (0.0, EARLY))
                grows = then >= gap - TOUCH
            parts &= grows | (until <= since) | ~(np.asarray(person.there(0.5 * (since + until))) > 0)
        return np.asarray(in_contact & parts)

    def _needed_on(self, person: Person, tick: IntArray, lasts: IntArray, margin: float) -> Separation:
        """Return the largest distances for a margin, m, needed at the ends and in the middle of some ticks."""
        each = [self.needed(person, self.clock.seconds(tick + share * lasts), margin) for share in (0.0, 0.5, 1.0)]
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


def _of_rows(places: tuple[Place, ...], rows: IntArray) -> tuple[Place, ...]:
    """Return some rows of places."""
    return tuple((x[rows], y[rows]) for x, y in places)


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
