"""How far away somebody who moves is noticed by criteria: there, tables are made; beyond, costs are those without time.

It is found by asking: each criterion costs short holds and moves round each person alone, at several times, in rings
about the place. Where a cost differs from what it is in the end by more than a ten-thousandth of the largest such
difference, the person is noticed, and everywhere nearer, in that direction. What is left out stays in the tolerance of
the planned costs.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import HOLD, Law, Model, Motions, States
from hpop.motions.laws import CLOCK
from hpop.world import World
from hpop.world.content.people import Person


class MovingPeople(NamedTuple):
    """The people of a world who move, and what must stay together.

    world   with all of them
    moving  places, among its people, of those who move
    """

    world: World
    moving: tuple[int, ...]

    @classmethod
    def of(cls, world: World) -> MovingPeople:
        """That of a world."""
        people = world.content.people
        return cls(world, tuple(i for i, person in enumerate(people) if person.moves))

    @property
    def people(self) -> tuple[Person, ...]:
        """Those who move."""
        return tuple(self.world.content.people[i] for i in self.moving)

    @property
    def settled(self) -> float:
        """Time, s, from which on nothing about them changes."""
        return max((person.settled for person in self.people), default=0.0)

    def with_those(self, who: Collection[int]) -> World:
        """The world with those who stand and, of those who move, some (places in ``moving``) and who talks to them."""
        content = self.world.content
        kept = {i for i, person in enumerate(content.people) if not person.moves} | {self.moving[i] for i in who}
        return self._with(self._together(kept))

    def alone(self, number: int, person: Person) -> World:
        """The world with one of those who move alone, as somebody else it may be, and with who talks to it."""
        place = self.moving[number]
        return self._with(self._together({place}), {place: person})

    def _together(self, kept: set[int]) -> set[int]:
        """Those, and everybody in conversations with one of them who moves."""
        people, groups = self.world.content.people, self.world.content.groups
        while True:
            more = {i for group in groups if any(people[j].moves and j in kept for j in group) for i in group}
            if more <= kept:
                return kept
            kept = kept | more

    def _with(self, kept: set[int], instead: dict[int, Person] | None = None) -> World:
        content = self.world.content
        places = sorted(kept)
        number = {place: i for i, place in enumerate(places)}
        people = tuple((instead or {}).get(place, content.people[place]) for place in places)
        groups = tuple(tuple(number[i] for i in group) for group in content.groups if set(group) <= kept)
        return replace(self.world, content=replace(content, people=people, groups=groups))


SHARE = 1e-4  # of the largest difference that somebody makes: what is less is not noticed
WORST = 1e-3  # the same where the worst moment counts
STEP = 0.01  # of that difference, a second or at the worst moment: as finely are costs compared, if nobody says
DIRECTIONS = 16  # in which it is looked, from where a person walks to
HEADINGS = 16  # of the moves
RINGS = 16  # distances, from NEAREST to the size of the map
HALVINGS = 4  # of the distance between the last ring where somebody is noticed and the next
NEAREST = 0.2  # m
MOMENTS = 5  # of a prediction, its begin and end among them
PROBE = 0.05  # s, that a hold or a move lasts
PAUSE = 1e-3  # s before a prediction ends


@dataclass(frozen=True, eq=False)
class NoticeRange:
    """How far (m) somebody is noticed from where it is, by time and direction.

    person  one who moves, without futures
    times   (T,)  s, rising
    reach   (T, D)  m, at each time in each of D directions, the first of them that in which it walks
    left    m  the same of the place where it stays when the prediction has ended; 0 if it is gone then
    """

    person: Person
    times: FloatArray
    reach: FloatArray
    left: float

    def beyond(self, x: FloatArray, y: FloatArray, times: FloatArray) -> NDArray[np.float32]:
        """How far (P, T), m, at least, places (P,) are beyond where somebody is noticed at times (T,); < 0 within."""
        columns = (*self.person.at(times), *self.person.ahead_at(times))
        px, py, ux, uy = (np.broadcast_to(column, times.shape).astype(np.float32) for column in columns)
        there = np.broadcast_to(self.person.there(times), times.shape) > 0
        reach = self._reach(times)  # (T, D)
        farthest = np.where(there, reach.max(axis=1) + NEAREST, -np.inf).astype(np.float32)
        dx, dy = x.astype(np.float32)[:, None] - px, y.astype(np.float32)[:, None] - py
        beyond = np.hypot(dx, dy)
        beyond -= farthest  # exact beyond; within, what is noticed in the direction itself is taken
        place, moment = np.nonzero(beyond <= 0)
        sx, sy, cos, sin = dx[place, moment], dy[place, moment], ux[moment], uy[moment]
        size = self.reach.shape[1]
        low = np.floor(np.arctan2(cos * sy - sin * sx, cos * sx + sin * sy) * (size / (2 * math.pi))).astype(np.int64)
        within = np.maximum(reach[moment, low % size], reach[moment, (low + 1) % size])
        beyond[place, moment] = np.hypot(sx, sy) - np.where(within > 0, within, -np.inf)
        if self.left > 0:
            end_x, end_y = (float(column) for column in self.person.at(np.float64(self.person.settled)))
            from_end = (np.hypot(x - end_x, y - end_y) - self.left).astype(np.float32)
            beyond = np.minimum(beyond, from_end[:, None])
        return np.asarray(beyond, dtype=np.float32)

    def _reach(self, times: FloatArray) -> FloatArray:
        """The larger (T, D) of the reaches at the moments before and after each time."""
        after = np.clip(np.searchsorted(self.times, times), 0, self.times.size - 1)
        return np.maximum(self.reach[after], self.reach[np.maximum(after - 1, 0)])


@dataclass(frozen=True, eq=False)
class NoticeRanges:
    """Who is noticed, and how far, by some criteria: all that may be of each person who moves.

    of          for each of those who move, by what may be of it
    overlooked  (k,)  what is not noticed: a second, of all of them together, in a criterion's unit; a moment where the
                      worst counts, of one of them
    """

    of: tuple[tuple[NoticeRange, ...], ...]
    overlooked: FloatArray

    @classmethod
    def by(cls, asked: Sequence[CriterionProbe], company: MovingPeople) -> NoticeRanges:
        """Of criteria that were asked about everybody."""
        found = []
        for number, person in enumerate(company.people):
            each = []
            for rank, (_, likely) in enumerate(person.hypotheses):
                times = _moments(likely)
                reaches = [one.reach(number, rank) for one in asked]
                reach = np.max([np.zeros((MOMENTS, DIRECTIONS)), *reaches], axis=0)
                left = float(reach[-1].max()) if likely.afterwards == "stays" else 0.0
                each.append(NoticeRange(likely, times, reach, left))
            found.append(tuple(each))
        several = [1 if one.criterion.aggregate == "max" else max(1, len(company.people)) for one in asked]
        return cls(tuple(found), np.array([one.threshold for one in asked]) * several)


@dataclass(frozen=True, eq=False)
class CriterionProbe:
    """What a criterion that reads the time costs about each of those who move, alone.

    criterion, company, model
    is_set  whether the problem, or the criterion, says in which steps its costs are compared
    """

    criterion: Criterion
    company: MovingPeople
    model: Model
    is_set: bool

    @cached_property
    def farthest(self) -> float:
        """Size of the map, m."""
        x_min, y_min, x_max, y_max = self.company.world.bounds
        return max(math.hypot(x_max - x_min, y_max - y_min), 2 * NEAREST)

    @property
    def _rings(self) -> FloatArray:
        return np.geomspace(NEAREST, self.farthest, RINGS)

    @cached_property
    def differences(self) -> list[list[FloatArray | None]]:
        """By how much (T, D, R) costs differ in rings, by person and by what may be of it; None: cannot be asked."""
        around = np.broadcast_to(self._rings, (MOMENTS, DIRECTIONS, RINGS))
        found = list[list[FloatArray | None]]()
        for number, person in enumerate(self.company.people):
            each = list[FloatArray | None]()
            for _, likely in person.hypotheses:
                try:
                    each.append(self._differences(number, likely, around))
                except (CriterionError, UnsupportedCriterion):
                    each.append(None)
            found.append(each)
        return found

    @cached_property
    def peak(self) -> float:
        """The largest difference that somebody makes: a second, or at the worst moment."""
        return max((float(d.max()) for some in self.differences for d in some if d is not None), default=0.0)

    @cached_property
    def quantum(self) -> float:
        """In which steps a search on a clock compares the costs: no finer than a clock knows them, if nobody says."""
        if self.is_set or not self.peak > 0.0:
            return self.criterion.quantum
        power = 10.0 ** math.floor(math.log10(STEP * self.peak))
        digit = max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= STEP * self.peak * (1 + 1e-9))
        return max(self.criterion.quantum, digit * power)

    @property
    def threshold(self) -> float:
        """What is less is not noticed: it is less than what rounding does."""
        share = WORST if self.criterion.aggregate == "max" else SHARE
        return max(share * self.peak, self.quantum)

    def reach(self, number: int, rank: int) -> FloatArray:
        """How far (T, D), m, somebody is noticed, as it may be; 0 where nowhere, infinite if it cannot be asked."""
        person = self.company.people[number].hypotheses[rank][1]
        each, rings = self.differences[number][rank], self._rings
        if each is None:
            return np.full((MOMENTS, DIRECTIONS), np.inf)
        noticed = each > self.threshold
        beyond = RINGS - np.argmax(noticed[:, :, ::-1], axis=2)  # the ring after the last
        low, high = rings[beyond - 1], np.append(rings, np.inf)[beyond]
        for _ in range(HALVINGS if np.isfinite(high).all() else 0):
            middle = np.sqrt(low * high)
            inside = self._differences(number, person, middle[:, :, None])[:, :, 0] > self.threshold
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return np.where(noticed.any(axis=2), high, 0.0)

    def _differences(self, number: int, person: Person, rings: FloatArray) -> FloatArray:
        alone = self.company.alone(number, replace(person, afterwards="gone"))
        return _differences(self.criterion, alone, self.model, person, _moments(person), rings)


class Attention(NamedTuple):
    """What criteria said of the people who move: of a question it is the same on every graph.

    asked    the criteria that read the time, asked about each of those people
    notices  how far they are noticed
    """

    asked: Sequence[CriterionProbe]
    notices: NoticeRanges

    @classmethod
    def of(cls, company: MovingPeople, asked: Sequence[CriterionProbe]) -> Attention:
        """That of some criteria."""
        return cls(asked, NoticeRanges.by(asked, company))


def _moments(person: Person) -> FloatArray:
    begin = max(0.0, person.track.begin) if person.track is not None else 0.0
    return np.linspace(min(begin, person.settled), max(0.0, person.settled - PROBE - PAUSE), MOMENTS)


def _differences(
    criterion: Criterion, world: World, model: Model, person: Person, times: FloatArray, rings: FloatArray
) -> FloatArray:
    """By how much (T, D, R), a second, costs at distances, m, and times, s, differ from those when all is over.

    That is the largest of a hold, and of moves in all directions.
    """
    px, py, ux, uy = (
        np.broadcast_to(column, times.shape)[:, None, None] for column in (*person.at(times), *person.ahead_at(times))
    )
    angle = _angles(DIRECTIONS)[:, None]
    x = px + rings * (np.cos(angle) * ux - np.sin(angle) * uy)
    y = py + rings * (np.cos(angle) * uy + np.sin(angle) * ux)
    towards = np.arctan2(py - y, px - x).ravel()
    seconds = np.broadcast_to(times[:, None, None], x.shape).ravel()
    over = np.full(seconds.size, person.settled + PAUSE)
    headings = [towards, *(np.full(towards.size, yaw) for yaw in _angles(HEADINGS))]
    most = np.zeros(x.size)
    for yaws in ([], headings):
        number = max(1, len(yaws))
        at_x, at_y, now, later = (np.tile(column, number) for column in (x.ravel(), y.ravel(), seconds, over))
        law, start, end, lasts = _probe(
            model, at_x, at_y, np.concatenate(yaws) if yaws else np.zeros(x.size), bool(yaws)
        )
        costs = [motion_costs(criterion, Motions(world, model, law, start, end, t0=when)) for when in (now, later)]
        each = np.abs(costs[0] - costs[1]) / (1.0 if criterion.aggregate == "max" else lasts)
        most = np.maximum(most, each.reshape(number, -1).max(axis=0))
    return most.reshape(x.shape)


def _angles(count: int) -> FloatArray:
    return np.linspace(0.0, 2 * math.pi, count, endpoint=False)


def _probe(
    model: Model, x: FloatArray, y: FloatArray, yaw: FloatArray, moves: bool
) -> tuple[Law, States, States, FloatArray]:
    """Short holds or moves (M,) at places, and how long they last, s."""
    others = {name: np.zeros(x.size) for name in model.space.names if name not in ("x", "y", "yaw")}
    start = {"x": x, "y": y, "yaw": yaw, **others}
    columns = {name: start[name] for name in model.space.names}
    if not moves:
        held = States(**columns, **{CLOCK: np.zeros(x.size)})
        return HOLD, held, States(**columns, **{CLOCK: np.full(x.size, PROBE)}), np.full(x.size, PROBE)
    law = model.laws["move"]
    begin = States(**columns)
    a_metre = States(**columns | {"x": x + np.cos(yaw), "y": y + np.sin(yaw)})
    pace = np.broadcast_to(sum(phase.duration for phase in law.phases(begin, a_metre)), x.shape)  # s/m
    short = PROBE / pace
    end = States(**columns | {"x": x + short * np.cos(yaw), "y": y + short * np.sin(yaw)})
    lasts = np.broadcast_to(sum(phase.duration for phase in law.phases(begin, end)), x.shape)
    return law, begin, end, np.array(lasts)
