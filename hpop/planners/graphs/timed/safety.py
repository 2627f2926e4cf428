"""Distances from moving people: ticks at which arcs are blocked, and at which the robot must not stand at a place.

The gap is the distance between the surfaces of the robot and of a person. It must not be less than the margin during
any motion, even if the plan is early or late by :data:`.clock.SLACK`, and the robot away from its planned position by
the distance of :class:`hpop.models.execution.Ramps` (in any direction while it stands). If a prediction is uncertain,
the probability of a smaller gap must not exceed 5 % at any moment, in any hypothesis (possible future). Two upper
bounds of this probability are used, and one is enough: for a half-plane beyond the nearest point (1.645 sigma), and for
a disc around the robot that covers it and the person's body (noncentral chi-squared distribution).

On a straight move, the gap is exact for people who walk straight meanwhile. Other walks are replaced by straight ones,
and the gap is reduced by the largest difference. A robot that is not round counts as the disc that it covers by
turning, while it turns or waits.

A robot that starts within a person's margin, or is approached within a second, may leave but not stay. It must not hold
there. For :data:`LEAVING` seconds, an arc that leads away is blocked only by contact, or by a chance of contact above
5 %. Motions that do not reduce the gap are allowed even then, for a round robot that starts in contact, and for any
robot that has such a chance at the start or within a second. Plans that begin at time 0 are not early or late there.
There may be several starts at different times: the places at which a drive may change its plan.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.errors import QueryError
from hpop.models.collision import Part
from hpop.models.execution import Ramps
from hpop.motions import Law, is_curve, laws_of
from hpop.planners.graphs.timed.clock import SLACK, BlockedArcs, TickClock, TimeOptions, widened
from hpop.planners.graphs.timed.legs import LegMotions
from hpop.planners.graphs.timed.notice import MovingPeople
from hpop.planners.graphs.timed.outlines import Place, nearer_than, of_rows, to_parts, to_segments, to_strips
from hpop.planners.graphs.timed.pieces import (
    SIGMAS,
    MotionPieces,
    PersonMotion,
    Separation,
    Swing,
    clear_distance,
    near_people,
    strips,
)
from hpop.planners.spending import Spending
from hpop.world.content.people import Person

TOUCH = 1e-9  # m, rounding error of distances
LEAVING = 5.0  # s after a start, within which the robot may leave a person's margin
SOON = 1.0  # s after a start, within which a person may approach so that the robot may leave
EARLY = 1e-3  # share of a piece after which its gap is compared with the gap at its beginning
DOING = "edges blocked by moving people were computed"


class Start(NamedTuple):
    """Position (m), yaw (rad) and time on the clock (s) at which plans may begin."""

    x: float
    y: float
    yaw: float
    time: float


@dataclass(frozen=True, eq=False)
class Safety:
    """Separation constraints: distances to keep from every moving person, for every possible future (hypothesis).

    parts    parts of the robot's outline
    people   hypotheses of the moving people, each as a person of its own
    margin   m  gap to keep from people
    starts   where plans begin; empty if the robot comes from outside every person's margin
    stray    m  largest distance of the robot from its planned position along the path
    laws     motion laws of the robot, by kind
    bends    largest curvature of its paths, 1/m, and largest change of the curvature per metre, 1/m²
    """

    parts: Sequence[Part]
    people: tuple[Person, ...]
    clock: TickClock
    margin: float
    starts: tuple[Start, ...]
    stray: float
    spending: Spending
    laws: Mapping[str, Law] = field(default_factory=dict)
    bends: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(
        cls,
        moving_people: MovingPeople,
        model: Any,
        options: TimeOptions,
        starts: tuple[Start, ...],
        spending: Spending,
        people: Sequence[Person] | None = None,
        bends: tuple[float, float] = (0.0, 0.0),
    ) -> Safety:
        """Return the constraints for all possible futures of the moving people, or of ``people`` instead."""
        moving = moving_people.people if people is None else people
        futures = tuple(each for person in moving for _, each in person.hypotheses)
        ramps = Ramps.of(model)
        stray = 0.0 if ramps is None else ramps.stray  # if unknown, each execution is checked
        clock, laws = TickClock(options.tick), laws_of(model)
        return cls(model.platform, futures, clock, options.margin, starts, stray, spending, laws, bends)

    @cached_property
    def swing(self) -> Swing:
        """Distances by which the robot may be beside its plan."""
        return Swing(self.reach, self.stray, *self.bends)

    @cached_property
    def reach(self) -> float:
        """Radius of the robot, m: the largest distance of a part from its axis."""
        return max((part.reach for part in self.parts), default=0.0)

    def _axis(self, person: Person, need: Separation) -> FloatArray:
        """Return the distances (T,), m, of a person's centre from the robot's axis that are always enough."""
        return np.asarray(np.minimum(need.gap + self.reach + person.radius, need.axis))

    @cached_property
    def _round(self) -> bool:
        return all(part.on_axis for part in self.parts)

    def needed(self, person: Person, seconds: FloatArray, margin: float) -> Separation:
        """Return the distances needed from a person at times (T,), s.

        margin  m, gap to keep; with 0, only contact is avoided
        """
        deviation = np.broadcast_to(np.asarray(person.deviation(seconds), float), seconds.shape)
        disc = self.reach + person.radius + margin
        return Separation(margin + SIGMAS * deviation, clear_distance(deviation, disc))

    @cached_property
    def about_start(self) -> tuple[Person, ...]:
        """Possible futures of people who may be too near to a start when a plan begins there, or within a second."""
        return tuple(dict.fromkeys(person for start in self.starts for person in self.near(start)))

    def near(self, start: Start) -> list[Person]:
        """Return the possible futures of people who may be too near to a start at its time, or within a second.

        A plan that begins later than time 0 may be early there, so people who were too near shortly before count too.
        """
        early = start._replace(time=max(0.0, start.time - SLACK))
        return [person for person, _ in self.coming(early, start.time - early.time + SOON)]

    def coming(self, start: Start, within: float = LEAVING) -> Iterator[tuple[Person, float]]:
        """Yield the possible futures of people who may come too near to a start, up to ``within`` s after its time.

        They come nearer than the distance that is enough for any heading of the robot. Each is yielded with the time,
        s, from the start's time until the person first comes so near.
        """
        since = self.clock.seconds(np.arange(self.clock.within(within) + 1))
        for person in self.people:
            need = self._axis(person, self.needed(person, start.time + since, self.margin)) + self.stray
            inside = _apart(start, person, start.time + since) < need
            if inside.any():
                yield person, float(since[np.argmax(inside)])

    @cached_property
    def touched(self) -> tuple[Person, ...]:
        """Possible futures of people in contact with the robot at a start, when a plan begins there.

        A person whose position is uncertain counts if the chance of contact is above 5 % at a time within a second.
        """
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
        """Return the gaps (T,), m, between the robot at a start and a person, at times (T,), s."""
        x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
        return to_parts(self.parts, np.full(x.size, start.yaw), [(x - start.x, y - start.y)]) - person.radius

    def refuse_contact(self) -> None:
        """Raise QueryError if a robot that is not round would start in contact with a person."""
        for start in () if self._round else self.starts:
            now = np.array([start.time])
            for person in self.people:
                (gap,) = self._gap(start, person, now).tolist()
                if gap < -TOUCH and np.isfinite(_apart(start, person, now)).all():
                    raise QueryError(
                        f"the start ({start.x:.3f}, {start.y:.3f}) is not usable: {person.name or 'a person who moves'}"
                        f" is there at {start.time:g} s, and overlaps the robot's outline by {-gap:.3f} m. Move the "
                        "start or the person, or plan for a time when they are apart."
                    )

    @property
    def _leaves_until(self) -> float:
        """Last time on the clock, s, at which a robot may still leave people who are too near to its start."""
        return max((start.time for start in self.starts), default=0.0) + LEAVING

    def settled(self, seconds: float) -> float:
        """Return the time, s, after which arcs and places stay blocked or free, if predictions end at ``seconds``.

        It is later than ``seconds`` if people stay near a start, as the robot may leave them for a while.
        """
        stays = any(person.there(seconds + SLACK) > 0 for person in self.about_start)
        return max(seconds, self._leaves_until) if stays else seconds

    def cut(self, x: FloatArray, y: FloatArray, horizon: int, yaw: FloatArray | None = None) -> BoolArray:
        """Return at which ticks, up to a horizon H, the robot must not stand at places (P,): a mask (P, H + 1).

        yaw  (P,)  rad, heading in which the robot stands; None if it may have any
        """
        from scipy.spatial import KDTree  # slow to import

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
                inside = to_segments(*relative) < near[tick] - TOUCH
                if yaw is not None and not self._round and (rows := np.flatnonzero(inside)).size:
                    ends = [(-relative[i][rows], -relative[i + 1][rows]) for i in (0, 2)]
                    least = need.gap[tick] - TOUCH + person.radius + walk.stray[tick]
                    least += self.stray + self.swing.standing
                    inside[rows] = nearer_than(self.parts, yaw[own[rows]], ends, least)
                cut[own, tick] |= inside
        return widened(cut, self.clock.up_to(SLACK))

    def blocked(self, legs: Sequence[LegMotions], first: int, horizon: int) -> BlockedArcs:
        """Return the departure ticks, 0 to ``horizon``, at which people block arcs.

        A departure is also blocked if one at most SLACK earlier or later is, except one at tick 0 that begins a plan.

        legs   motions of r arcs
        first  arcs with this index and larger ones begin plans
        """
        rows, ticks = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for leg in legs:
            law = self.laws[leg.kind]
            some = near_people(leg, law, self._walked(leg, horizon), self.swing) if is_curve(law) else leg
            pieces = MotionPieces.of(some, self.clock, law, self.swing)
            for person in self.people:
                for own, tick in self._near(pieces, person, horizon):
                    part = pieces.take(own)
                    hit = self._hits(part, tick + part.after, person)
                    if person in self.about_start:
                        hit &= ~self._leaves(part, tick + part.after, person)
                    rows.append(part.row[hit])
                    ticks.append(tick[hit])
        blocked = BlockedArcs.of(np.concatenate(rows), np.concatenate(ticks), horizon)
        table = widened(blocked.table, self.clock.up_to(SLACK))
        begins = blocked.rows >= first
        table[begins, 0] = blocked.table[begins, 0]
        return BlockedArcs(blocked.rows, table)

    def _walked(self, leg: LegMotions, horizon: int) -> Iterator[tuple[Person, FloatArray, float]]:
        """Yield each person with times (T,), s, while motions last, and a distance, m, that is then enough."""
        last = horizon + self.clock.up_to(float((leg.after + leg.lasts).max(initial=0.0)))
        seconds = self.clock.seconds(np.arange(last + 1))
        for person in self.people:
            yield person, seconds, float(self._axis(person, self.needed(person, seconds, self.margin)).max())

    def _near(self, pieces: MotionPieces, person: Person, horizon: int) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield the pairs of :meth:`.MotionPieces.pairs` for a person."""
        last, longest = horizon + int(pieces.after.max(initial=0)), int(pieces.lasts.max(initial=0))
        seconds = self.clock.seconds(np.arange(last + 1))  # at which pieces begin
        need = self.needed(person, seconds, self.margin)
        near = float(self._axis(person, need).max()) + self.stray + person.speed * self.clock.tick * longest
        at = np.stack(np.broadcast_arrays(*person.at(seconds), seconds)[:2], axis=1)
        for pairs in pieces.pairs(at, near, horizon):
            self.spending.check(DOING)
            yield pairs

    def _hits(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Return which pieces (N,), beginning at ticks (N,), come too near to a person."""
        walk = PersonMotion.of(person, tick, pieces.lasts, self.clock)
        need = self._needed_on(person, tick, pieces.lasts, self.margin)
        seen = walk.seen_from(pieces)
        near, stray = self._axis(person, need), self.stray
        unsure = walk.stray + pieces.off
        distance = to_segments(*seen[0], *seen[1]) - unsure
        hit: BoolArray = walk.there & (distance < near + stray - TOUCH)
        some = np.flatnonzero(hit & pieces.moves)
        corners = strips(pieces.take(some), seen, some, stray)
        hit[some] = to_strips(corners) - unsure[some] < near[some] - TOUCH
        if self._round:
            return hit
        own = np.flatnonzero(hit[some])
        some, corners = some[own], of_rows(corners, own)
        hit[some] = self._nearer(pieces, some, corners, person, walk, need.gap[some])
        some = np.flatnonzero(hit & pieces.stands)
        ends = of_rows(seen, some)
        hit[some] = self._nearer(pieces, some, ends, person, walk, need.gap[some] + stray)
        return hit

    def _nearer(
        self,
        pieces: MotionPieces,
        rows: IntArray,
        corners: tuple[Place, ...],
        person: Person,
        walk: PersonMotion,
        gap: FloatArray,
    ) -> BoolArray:
        """Return where the robot is nearer than a gap (N,), m, to a person anywhere in the hull of ``corners``.

        rows     (N,)  indices of the pieces, in which the robot does not turn
        corners        positions of the person relative to the robot's axis, m, along the axes of the map
        """
        least = gap - TOUCH + person.radius + walk.stray[rows] + pieces.off[rows]
        return nearer_than(self.parts, pieces.yaw[rows], corners, least)

    def _leaves(self, pieces: MotionPieces, tick: IntArray, person: Person) -> BoolArray:
        """Return which pieces (N,), beginning at ticks (N,), are allowed since they leave a person near a start.

        They begin soon after a start, near the person, and avoid contact or do not reduce the gap.
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
        clear = distance - walk.stray - pieces.off >= near - TOUCH
        if not self._round:
            own = np.flatnonzero(~clear[some])
            some, corners = some[own], of_rows(corners, own)
            clear[some] = ~self._nearer(pieces, some, corners, person, walk, touch.gap[some])
            some = np.flatnonzero(inside & pieces.stands)
            ends = of_rows(seen, some)
            clear[some] |= ~self._nearer(pieces, some, ends, person, walk, touch.gap[some])
        if person in self.touched:
            clear |= self._parts_from(pieces, tick, person, touch)
        leaves: BoolArray = inside & clear & (tick <= self.clock.up_to(self._leaves_until))
        return leaves

    def _parts_from(self, pieces: MotionPieces, tick: IntArray, person: Person, touch: Separation) -> BoolArray:
        """Return which pieces (N,), beginning at ticks (N,), begin in (possible) contact and never reduce the gap.

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
        parts: BoolArray = pieces.off <= 0.0
        if self._round:
            in_contact = np.hypot(x[:, 0], y[:, 0]) < self._axis(person, touch) + self.stray
        else:
            parts &= pieces.moves | pieces.stands
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
        """Return the distances needed during pieces (N,) that begin at ticks (N,) and last ``lasts`` (N,) ticks.

        They are the largest of those at the beginning, the middle and the end of each piece.
        """
        each = [self.needed(person, self.clock.seconds(tick + share * lasts), margin) for share in (0.0, 0.5, 1.0)]
        return Separation(*(np.maximum.reduce([getattr(need, name) for need in each]) for name in Separation._fields))


def _apart(start: Start, person: Person, seconds: FloatArray) -> FloatArray:
    """Return the distances (T,), m, of a person's centre from a start; infinite while the person is not there."""
    x, y = (np.broadcast_to(column, seconds.shape) for column in person.at(seconds))
    is_there = np.broadcast_to(np.asarray(person.there(seconds)), seconds.shape) > 0
    return np.where(is_there, np.hypot(start.x - x, start.y - y), np.inf)
