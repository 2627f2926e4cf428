"""Measure the distance from each moving person within which the person changes the cost of a criterion.

Within this distance, the range, the person is said to be noticed, and costs are computed for each tick; elsewhere they
do not depend on time. To measure it, each criterion evaluates short holds and moves on rings around each person alone,
at several times. The range in a direction ends where costs differ from their final value, after the prediction, by at
most a ten-thousandth of the largest difference (a thousandth for a criterion that takes the worst moment) or, if that
is more, by a quantum. Neglected differences are part of the tolerance of planned costs.
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
    """A world, and which of its people move.

    world   world with all people, moving or not
    moving  indices of the people who move
    """

    world: World
    moving: tuple[int, ...]

    @classmethod
    def of(cls, world: World) -> MovingPeople:
        """Find the moving people of a world."""
        people = world.content.people
        return cls(world, tuple(i for i, person in enumerate(people) if person.moves))

    @property
    def people(self) -> tuple[Person, ...]:
        """The moving people."""
        return tuple(self.world.content.people[i] for i in self.moving)

    @property
    def settled(self) -> float:
        """Time, s, at which the last prediction ends; after it, no predicted position changes."""
        return max((person.settled for person in self.people), default=0.0)

    def with_those(self, numbers: Collection[int]) -> World:
        """Return the world with all standing people and some moving ones; the other moving people are left out.

        Moving people in conversation with one of those in ``numbers`` are kept too.

        numbers  indices into ``moving``
        """
        content = self.world.content
        kept = {i for i, person in enumerate(content.people) if not person.moves} | {self.moving[i] for i in numbers}
        return self._with(self._together(kept))

    def alone(self, number: int, person: Person) -> World:
        """Return the world with one moving person only, and people in conversation with this person.

        number  index into ``moving``
        person  one of the person's hypotheses (possible futures), which replaces the person
        """
        place = self.moving[number]
        return self._with(self._together({place}), {place: person})

    def _together(self, people_kept: set[int]) -> set[int]:
        """Return the given people, by index, and all people in conversation with those of them who move."""
        people, groups = self.world.content.people, self.world.content.groups
        while True:
            talking = {i for group in groups if any(people[j].moves and j in people_kept for j in group) for i in group}
            if talking <= people_kept:
                return people_kept
            people_kept = people_kept | talking

    def _with(self, kept: set[int], instead: dict[int, Person] | None = None) -> World:
        content = self.world.content
        places = sorted(kept)
        number = {place: i for i, place in enumerate(places)}
        people = tuple((instead or {}).get(place, content.people[place]) for place in places)
        groups = tuple(tuple(number[i] for i in group) for group in content.groups if set(group) <= kept)
        return replace(self.world, content=replace(content, people=people, groups=groups))


SHARE = 1e-4  # smaller differences of a cost are neglected, as a share of the largest difference due to one person
WORST = 1e-3  # that share for criteria that take the worst moment
STEP = 0.01  # default quantum of costs, as a share of that largest difference (per second, or at the worst moment)
DIRECTIONS = 16  # number of directions from a person in which costs are evaluated, from the walking direction on
HEADINGS = 16  # number of headings of the evaluated moves
RINGS = 16  # number of distances at which costs are evaluated, from NEAREST to the size of the map
HALVINGS = 4  # how often the interval of distances in which the range ends is halved
NEAREST = 0.2  # m, smallest distance
MOMENTS = 5  # number of times at which costs are evaluated, from the beginning to the end of a prediction
PROBE = 0.05  # s, duration of an evaluated hold or move
PAUSE = 1e-3  # s, small distance in time from the end of a prediction


@dataclass(frozen=True, eq=False)
class NoticeRange:
    """Distance within which a person is noticed (changes a cost), depending on time and direction.

    person  one hypothesis (possible future) of a moving person
    times   (T,)  s, ascending
    reach   (T, D)  m, distance at each time in each of D directions, counted from the walking direction
    left    m  distance around the place where the person stays after the prediction; 0 if the person leaves
    """

    person: Person
    times: FloatArray
    reach: FloatArray
    left: float

    def beyond(self, x: FloatArray, y: FloatArray, times: FloatArray) -> NDArray[np.float32]:
        """Return by how much places (P,) are outside the range at times (T,), as lower bounds (P, T), m.

        Values are negative inside the range.
        """
        columns = (*self.person.at(times), *self.person.ahead_at(times))
        px, py, ux, uy = (np.broadcast_to(column, times.shape).astype(np.float32) for column in columns)
        is_there = np.broadcast_to(self.person.there(times), times.shape) > 0
        reach = self._reach(times)  # (T, D)
        farthest = np.where(is_there, reach.max(axis=1) + NEAREST, -np.inf).astype(np.float32)
        dx, dy = x.astype(np.float32)[:, None] - px, y.astype(np.float32)[:, None] - py
        beyond = np.hypot(dx, dy)
        beyond -= farthest  # exact beyond the largest range; within it, the range of the direction is taken
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
        """Return the range (T, D), m, at times (T,), s: the larger of those at the tabulated times before and after."""
        after = np.clip(np.searchsorted(self.times, times), 0, self.times.size - 1)
        return np.maximum(self.reach[after], self.reach[np.maximum(after - 1, 0)])


@dataclass(frozen=True, eq=False)
class NoticeRanges:
    """Distances within which any of k criteria notices each hypothesis of each moving person.

    of          for each moving person, the range of each hypothesis
    overlooked  (k,)  largest cost that is neglected outside the ranges, in the criteria's units: per second and for all
                people together; for criteria that take the worst moment, at one moment and for one person
    """

    of: tuple[tuple[NoticeRange, ...], ...]
    overlooked: FloatArray

    @classmethod
    def by(cls, probes: Sequence[CriterionProbe], moving_people: MovingPeople) -> NoticeRanges:
        """Combine the ranges that were measured for several criteria: the largest counts."""
        ranges = []
        for number, person in enumerate(moving_people.people):
            each = []
            for rank, (_, likely) in enumerate(person.hypotheses):
                times = _moments(likely)
                reaches = [probe.reach(number, rank) for probe in probes]
                reach = np.max([np.zeros((MOMENTS, DIRECTIONS)), *reaches], axis=0)
                left = float(reach[-1].max()) if likely.afterwards == "stays" else 0.0
                each.append(NoticeRange(likely, times, reach, left))
            ranges.append(tuple(each))
        several = [1 if probe.criterion.aggregate == "max" else max(1, len(moving_people.people)) for probe in probes]
        return cls(tuple(ranges), np.array([probe.threshold for probe in probes]) * several)


@dataclass(frozen=True, eq=False)
class CriterionProbe:
    """Measurement of the range of one criterion: its costs around each moving person, without the other people.

    criterion      criterion that depends on time
    moving_people  the people who move
    model          robot that the criterion evaluates
    is_set         whether the user or the criterion has set the quantum of its costs
    """

    criterion: Criterion
    moving_people: MovingPeople
    model: Model
    is_set: bool

    @cached_property
    def farthest(self) -> float:
        """Largest distance at which costs are evaluated, m: the diagonal of the map, but at least 2 NEAREST."""
        x_min, y_min, x_max, y_max = self.moving_people.world.bounds
        return max(math.hypot(x_max - x_min, y_max - y_min), 2 * NEAREST)

    @property
    def _rings(self) -> FloatArray:
        return np.geomspace(NEAREST, self.farthest, RINGS)

    @cached_property
    def differences(self) -> list[list[FloatArray | None]]:
        """Differences of costs around a person from their final values, for each person and each hypothesis.

        An item has one value for each time, direction and ring, (T, D, R). It is None if the criterion cannot be
        evaluated there.
        """
        around = np.broadcast_to(self._rings, (MOMENTS, DIRECTIONS, RINGS))
        differences = list[list[FloatArray | None]]()
        for number, person in enumerate(self.moving_people.people):
            each = list[FloatArray | None]()
            for _, likely in person.hypotheses:
                try:
                    each.append(self._differences(number, likely, around))
                except (CriterionError, UnsupportedCriterion):
                    each.append(None)
            differences.append(each)
        return differences

    @cached_property
    def peak(self) -> float:
        """Largest difference of a cost due to one person: per second or, if the worst moment counts, at one moment."""
        return max((float(d.max()) for rings in self.differences for d in rings if d is not None), default=0.0)

    @cached_property
    def quantum(self) -> float:
        """Quantum of the costs in the search among moving people.

        If none was set, it is about a hundredth of ``peak``, since costs on a clock are not more accurate.
        """
        if self.is_set or not self.peak > 0.0:
            return self.criterion.quantum
        power = 10.0 ** math.floor(math.log10(STEP * self.peak))
        digit = max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= STEP * self.peak * (1 + 1e-9))
        return max(self.criterion.quantum, digit * power)

    @property
    def threshold(self) -> float:
        """Difference of a cost above which a person is noticed; smaller ones are neglected."""
        share = WORST if self.criterion.aggregate == "max" else SHARE
        return max(share * self.peak, self.quantum)

    def reach(self, number: int, rank: int) -> FloatArray:
        """Return the distance (T, D), m, within which this criterion notices a person, at each time and direction.

        It is 0 where the person is not noticed, and infinite if the criterion cannot be evaluated.

        number  index of the moving person
        rank    index of the person's hypothesis
        """
        person = self.moving_people.people[number].hypotheses[rank][1]
        each, rings = self.differences[number][rank], self._rings
        if each is None:
            return np.full((MOMENTS, DIRECTIONS), np.inf)
        noticed = each > self.threshold
        beyond = RINGS - np.argmax(noticed[:, :, ::-1], axis=2)  # the ring after the last one with a noticed person
        low, high = rings[beyond - 1], np.append(rings, np.inf)[beyond]
        for _ in range(HALVINGS if np.isfinite(high).all() else 0):
            middle = np.sqrt(low * high)
            inside = self._differences(number, person, middle[:, :, None])[:, :, 0] > self.threshold
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return np.where(noticed.any(axis=2), high, 0.0)

    def _differences(self, number: int, person: Person, rings: FloatArray) -> FloatArray:
        alone = self.moving_people.alone(number, replace(person, afterwards="gone"))
        return _differences(self.criterion, alone, self.model, person, _moments(person), rings)


class Attention(NamedTuple):
    """Distances within which criteria notice people, which several graphs can share.

    probes   measurement for each criterion that depends on time
    notices  the resulting ranges
    """

    probes: Sequence[CriterionProbe]
    notices: NoticeRanges

    @classmethod
    def of(cls, moving_people: MovingPeople, probes: Sequence[CriterionProbe]) -> Attention:
        """Measure the ranges for some criteria."""
        return cls(probes, NoticeRanges.by(probes, moving_people))


def _moments(person: Person) -> FloatArray:
    begin = max(0.0, person.track.begin) if person.track is not None else 0.0
    return np.linspace(min(begin, person.settled), max(0.0, person.settled - PROBE - PAUSE), MOMENTS)


def _differences(
    criterion: Criterion, world: World, model: Model, person: Person, times: FloatArray, rings: FloatArray
) -> FloatArray:
    """Return how much costs around a person differ from their values after the prediction, (T, D, R).

    Each value is the largest difference for a hold and for moves in all directions: per second or, for criteria that
    take the worst moment, at one moment.

    times  (T,)  s, at which the differences are computed
    rings  (T, D, R)  m, distances from the person
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
    """Return short holds or, if ``moves``, short moves, for a criterion to evaluate: law, start, end and duration, s.

    x, y, yaw  (M,)  positions, m, and headings, rad, at which they begin
    """
    zeros = {name: np.zeros(x.size) for name in model.space.names if name not in ("x", "y", "yaw")}
    start = {"x": x, "y": y, "yaw": yaw, **zeros}
    columns = {name: start[name] for name in model.space.names}
    if not moves:
        held = States(**columns, **{CLOCK: np.zeros(x.size)})
        return HOLD, held, States(**columns, **{CLOCK: np.full(x.size, PROBE)}), np.full(x.size, PROBE)
    law = next(law for law in (model.laws.get("move"), *model.laws.values()) if law and "x" in law.varies)
    begin = States(**columns)
    a_metre = States(**columns | {"x": x + np.cos(yaw), "y": y + np.sin(yaw)})
    pace = np.broadcast_to(sum(phase.duration for phase in law.phases(begin, a_metre)), x.shape)  # s/m
    short = PROBE / pace
    end = States(**columns | {"x": x + short * np.cos(yaw), "y": y + short * np.sin(yaw)})
    lasts = np.broadcast_to(sum(phase.duration for phase in law.phases(begin, end)), x.shape)
    return law, begin, end, np.array(lasts)
