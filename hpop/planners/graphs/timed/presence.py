"""Find the places and times at which costs depend on moving people, the criteria concerned, and costs of standing.

A person is noticed at a place if the cost of some criterion there differs because of this person. A place is a position
of the graph, and a tick a unit of time of the search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import CriterionError, UnsupportedCriterion
from hpop.motions import HOLD, Law, Motions, States
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.arcs import blocks
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import TimedArcs
from hpop.planners.graphs.timed.notice import MovingPeople, NoticeRanges
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.runtime import limits
from hpop.world import World

TOLD_APART = 62  # number of people with a bit of their own in a mask; all further people share one bit
ALONE = 2048  # pairs of place and tick with the same people noticed; if there are fewer, all people are evaluated
NOTICED = "places where moving people affect costs were computed"

Masks = NDArray[np.unsignedinteger[Any]]  # people who are noticed: bit i for moving person i, the last bit for the rest


@dataclass(frozen=True, eq=False)
class Presence:
    """The places and ticks at which each moving person is noticed, that is, may change a cost.

    moving_people  the people who move
    notices        distances within which each person is noticed
    clock          clock of the search
    horizon        number H of ticks that are considered
    x, y           (P,)  m, positions of the places
    """

    moving_people: MovingPeople
    notices: NoticeRanges
    clock: TickClock
    horizon: int
    x: FloatArray
    y: FloatArray
    _worlds: dict[int, World] = field(default_factory=dict, init=False)
    _masks: dict[tuple[float, float], Masks] = field(default_factory=dict, init=False)

    @property
    def over(self) -> float:
        """Time, s, after which no cost changes any more, since all predictions of people have ended."""
        return self.moving_people.settled + self.clock.tick

    @property
    def at_last(self) -> World:
        """World in which costs at the time ``over`` or later are evaluated."""
        return self.moving_people.world

    @cached_property
    def _beyond(self) -> list[NDArray[np.float32]]:
        """Distances, m, of places from the range of each moving person at each tick; negative inside the range.

        The list has an array (P, H) for each person.
        """
        times = self.clock.seconds(np.arange(self.horizon))
        distances = self.x.size * self.horizon * np.dtype(np.float32).itemsize
        limits.hold(NOTICED, len(self.notices.of) * distances, 2 * distances)
        if not self.notices.overlooked.size:
            return [np.full((self.x.size, self.horizon), np.inf, np.float32) for _ in self.notices.of]
        each = ([likely.beyond(self.x, self.y, times) for likely in ranges] for ranges in self.notices.of)
        return [np.minimum.reduce(distances) for distances in each]

    def masks(self, length: float, lasts: float) -> Masks:
        """Return which people are noticed during a motion, for each place and tick at which it may begin, (P, H).

        Bit i of an entry stands for moving person i; the last bit stands for all people who have no bit.

        length  m  largest distance of the motion from the place
        lasts   s  duration of the motion
        """
        if (length, lasts) not in self._masks:
            people = self.moving_people.people
            kind = np.dtype(np.min_scalar_type(1 << min(len(people), TOLD_APART)))
            limits.hold(NOTICED, self.x.size * self.horizon * kind.itemsize, self.x.size * self.horizon)
            masks = np.zeros((self.x.size, self.horizon), kind)
            for i, (person, beyond) in enumerate(zip(people, self._beyond, strict=True)):
                near = beyond <= np.float32(length + person.speed * lasts)
                masks |= near.astype(masks.dtype) << masks.dtype.type(min(i, TOLD_APART))
            self._masks[length, lasts] = masks
        return self._masks[length, lasts]

    def parts(self, masks: Masks) -> Iterator[tuple[IntArray, World]]:
        """Group masks by the people in them; yield the indices (N,) of each group, and a world with these people only.

        Combinations of people that are rare, or include people without a bit of their own, form one group, with the
        world of all people.
        """
        among_all = []
        values, which, counts = np.unique(masks, return_inverse=True, return_counts=True)
        for number, (mask, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True)):
            own = np.flatnonzero(which == number)
            if count < ALONE or mask >> TOLD_APART:
                among_all.append(own)
            else:
                yield own, self._world(mask)
        if among_all:
            yield np.concatenate(among_all), self.moving_people.world

    def _world(self, mask: int) -> World:
        if mask not in self._worlds:
            self._worlds[mask] = self.moving_people.with_those([i for i in range(TOLD_APART) if mask >> i & 1])
        return self._worlds[mask]


TRIED_ARCS = 64  # number of arcs on which criteria are evaluated to see whether they depend on time


def reading_time(criteria: Sequence[Criterion], space: StateGraph | JoinedEnds) -> list[int]:
    """Return the indices of the criteria whose costs depend on time, among the people of a graph's world.

    The criteria are evaluated on a sample of arcs, at several times.
    """
    tried = list(_tried(space))
    return [j for j, criterion in enumerate(criteria) if any(_reads_time(criterion, motions) for motions in tried)]


def _tried(space: StateGraph | JoinedEnds) -> Iterator[Motions]:
    """Yield the motions of a sample of arcs; for a graph without arcs, those from the start or to goals, and a hold."""
    inner = space.states_alone
    size = inner.arcs.heads.size
    if size:
        sample = np.unique(np.linspace(0, size - 1, TRIED_ARCS).astype(np.int64))
        yield from (motions for _, motions in inner.legs(sample))
        return
    if space.joins is not None:
        yield from (motions for _, motions in space.joins.motions() if len(motions))
    states = space.states(np.zeros(1, np.int64))
    columns = {name: np.nan_to_num(column) for name, column in states.__dict__.items()}
    start, end = (States(**columns, **{CLOCK: np.array([clock])}) for clock in (0.0, 1.0))
    yield Motions(space.world, space.model, HOLD, start, end)


def _reads_time(criterion: Criterion, motions: Motions) -> bool:
    """Return whether a criterion's costs depend on the time at which the motions begin, or need this time."""
    try:
        plain = motion_costs(criterion, motions)
    except (CriterionError, UnsupportedCriterion):
        return True
    world, model, law = motions.world, motions.model, motions.law
    for t0 in (0.0, 1.0, 5.0):
        then = Motions(world, model, law, motions.start, motions.end, t0=np.full(len(motions), t0))
        if (motion_costs(criterion, then) != plain).any():
            return True
    return False


ALIKE = 1e-9  # relative difference of costs of standing that counts as rounding error
IN_PLACE = 1e-2  # relative difference of costs of turning and of standing that counts as error of numerical integration
TRIED_PLACES = 200  # number of places and ticks at which turning and standing are compared
DOING = "costs of standing were computed"


def hold_costs(
    criteria: Sequence[Criterion],
    space: TrajectoryGraph,
    states: States,
    lasts: FloatArray,
    presence: Presence | None = None,
    seconds: FloatArray | None = None,
) -> FloatArray:
    """Return the costs (N, k) of standing in given states (N,), by k criteria, in their units.

    lasts     (N,) s  durations
    presence  moving people; None if the criteria do not depend on them
    seconds   (N,) s  times at which standing begins; None if the criteria do not depend on time
    """
    world = space.world if presence is None else presence.moving_people.world
    columns = {name: np.nan_to_num(column) for name, column in states.__dict__.items()}
    start, end = States(**columns, **{CLOCK: 0.0 * lasts}), States(**columns, **{CLOCK: lasts})
    motions = Motions(world, space.model, HOLD, start, end, t0=seconds)
    return np.stack([motion_costs(criterion, motions) for criterion in criteria], axis=1)


def standing_rates(criteria: Sequence[Criterion], space: TrajectoryGraph, tick: float) -> FloatArray:
    """Return the costs (n, k) of standing for a tick in each state of a graph, by criteria that ignore time.

    For a criterion that takes the worst moment, it is the cost at one moment.

    tick  s, duration of a tick
    """
    rates = np.zeros((space.size, len(criteria)))
    if not criteria:
        return rates

    def rates_of(part: slice) -> tuple[slice, FloatArray]:
        states = space.states(np.arange(part.start, part.stop))
        return part, hold_costs(criteria, space, states, np.ones(states.size))

    for part, costs in space.spending.each(rates_of, blocks(space.size), DOING):
        rates[part] = costs
    adds_up = np.array([criterion.aggregate != "max" for criterion in criteria], dtype=bool)
    rates[:, adds_up] *= tick
    return rates


def alike_at_places(rates: FloatArray, place: IntArray) -> BoolArray:
    """Return for which criteria (k,) standing costs the same in all states of a place, whatever the heading.

    rates  (n, k)  costs of standing for a tick in each node
    place  (n,)    number of the place of each node
    """
    size = int(place.max(initial=-1)) + 1
    low, high = np.full((size, rates.shape[1]), np.inf), np.full((size, rates.shape[1]), -np.inf)
    np.minimum.at(low, place, rates)
    np.maximum.at(high, place, rates)
    alike: BoolArray = (high - low <= ALIKE * np.maximum(1.0, high)).all(axis=0)
    return alike


def turn_as_they_stand(criteria: Sequence[Criterion], arcs: TimedArcs, presence: Presence) -> BoolArray:
    """Return for which criteria (k,) turning costs as much as standing at that place for the same time.

    This holds for criteria that depend only on the position of the base and the time. It is tested on a sample of
    turns at places and times at which a person is noticed.
    """
    places, ticks = np.nonzero(presence.masks(0.0, presence.clock.tick))
    in_place = np.flatnonzero(arcs.inner.arcs.kinds > 0)
    at = arcs.place[arcs.tails[arcs.own[in_place]]]
    order = np.argsort(at, kind="stable")
    rng = np.random.default_rng(0)
    if not (places.size and in_place.size and criteria):
        return np.ones(len(criteria), dtype=bool)
    tried = rng.choice(places.size, min(TRIED_PLACES, places.size), replace=False)
    begin, end = (np.searchsorted(at[order], places[tried], side=side) for side in ("left", "right"))
    has_turns = np.flatnonzero(end > begin)
    picked = order[(begin + (rng.random(tried.size) * (end - begin)).astype(np.int64))[has_turns]]
    chosen, seconds = in_place[picked], presence.clock.seconds(ticks[tried[has_turns]])
    unique, which = np.unique(chosen, return_inverse=True)
    worst, largest = np.zeros(len(criteria)), np.zeros(len(criteria))
    for rows, motions in arcs.inner.legs(unique):
        number = np.searchsorted(rows, unique)
        own = np.flatnonzero(rows[np.minimum(number[which], rows.size - 1)] == chosen)
        rows_of = number[which[own]]
        moved = _at(motions, motions.law, rows_of, seconds[own])
        lasts = np.asarray(np.broadcast_to(motions.duration, len(motions)))[rows_of]
        here = arcs.states.take(arcs.place[arcs.tails[arcs.own[chosen[own]]]])
        for states in (motions.start.take(rows_of), here):
            stood = hold_costs(criteria, arcs.inner, states, lasts, presence, seconds[own])
            turned = np.stack([motion_costs(criterion, moved) for criterion in criteria], axis=1)
            worst = np.maximum(worst, np.abs(turned - stood).max(axis=0, initial=0.0))
            largest = np.maximum(largest, np.maximum(turned, stood).max(axis=0, initial=0.0))
    alike: BoolArray = worst <= IN_PLACE * largest
    return alike


def _at(motions: Motions, law: Law, rows: IntArray, seconds: FloatArray) -> Motions:
    start, end = motions.start.take(rows), motions.end.take(rows)
    return Motions(motions.world, motions.model, law, start, end, t0=seconds)
