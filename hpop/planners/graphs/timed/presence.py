"""Where and when people are noticed, which criteria read the time, and what standing costs in each state."""

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
from hpop.planners.graphs.timed.legs import TimedArcs, motions_of
from hpop.planners.graphs.timed.notice import MovingPeople, NoticeRanges
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.runtime import limits
from hpop.world import World

TOLD_APART = 62  # people; of more, each pair is evaluated among all
ALONE = 2048  # pairs: fewer are evaluated among all people, which is as quick as to make a world for them
NOTICED = "it was reckoned where people who move are noticed"

Masks = NDArray[np.unsignedinteger[Any]]  # bit i for the i-th of those who move, the last one for all others


@dataclass(frozen=True, eq=False)
class Presence:
    """Who is noticed where and when.

    company, notices
    clock
    horizon  H: ticks 0 to H - 1 are asked about
    x, y     (P,) m  places
    """

    company: MovingPeople
    notices: NoticeRanges
    clock: TickClock
    horizon: int
    x: FloatArray
    y: FloatArray
    _worlds: dict[int, World] = field(default_factory=dict, init=False)
    _masks: dict[tuple[float, float], Masks] = field(default_factory=dict, init=False)

    @property
    def over(self) -> float:
        """A time, s, from which on nothing changes any more."""
        return self.company.settled + self.clock.tick

    @property
    def at_last(self) -> World:
        """A world that costs what this one does when all is over."""
        return self.company.world

    @cached_property
    def _beyond(self) -> list[NDArray[np.float32]]:
        """For each of those who move, how far (P, H), m, places are beyond where it is noticed."""
        times = self.clock.seconds(np.arange(self.horizon))
        distances = self.x.size * self.horizon * np.dtype(np.float32).itemsize
        limits.hold(NOTICED, len(self.notices.of) * distances, 2 * distances)
        if not self.notices.overlooked.size:
            return [np.full((self.x.size, self.horizon), np.inf, np.float32) for _ in self.notices.of]
        each = ([one.beyond(self.x, self.y, times) for one in some] for some in self.notices.of)
        return [np.minimum.reduce(some) for some in each]

    def masks(self, way: float, lasts: float) -> Masks:
        """Who (P, H) is noticed within some metres of each place, from each tick on for some seconds."""
        if (way, lasts) not in self._masks:
            people = self.company.people
            kind = np.dtype(np.min_scalar_type(1 << min(len(people), TOLD_APART)))
            limits.hold(NOTICED, self.x.size * self.horizon * kind.itemsize, self.x.size * self.horizon)
            masks = np.zeros((self.x.size, self.horizon), kind)
            for i, (person, beyond) in enumerate(zip(people, self._beyond, strict=True)):
                near = beyond <= np.float32(way + person.speed * lasts)
                masks |= near.astype(masks.dtype) << masks.dtype.type(min(i, TOLD_APART))
            self._masks[way, lasts] = masks
        return self._masks[way, lasts]

    def parts(self, masks: Masks) -> Iterator[tuple[IntArray, World]]:
        """Pairs (N,) with the same people, each with a world in which those are."""
        rest = []
        values, which, counts = np.unique(masks, return_inverse=True, return_counts=True)
        for number, (mask, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True)):
            own = np.flatnonzero(which == number)
            if count < ALONE or mask >> TOLD_APART:
                rest.append(own)
            else:
                yield own, self._world(mask)
        if rest:
            yield np.concatenate(rest), self.company.world

    def _world(self, mask: int) -> World:
        if mask not in self._worlds:
            self._worlds[mask] = self.company.with_those([i for i in range(TOLD_APART) if mask >> i & 1])
        return self._worlds[mask]


TRIED_ARCS = 64  # arcs that are asked about


def reading_time(criteria: Sequence[Criterion], space: StateGraph | JoinedEnds) -> list[int]:
    """Return the columns of the criteria that read the time, among the people of a graph's world."""
    tried = list(_tried(space))
    return [j for j, criterion in enumerate(criteria) if any(_reads_time(criterion, motions) for motions in tried)]


def _tried(space: StateGraph | JoinedEnds) -> Iterator[Motions]:
    """Yield motions of some arcs; of a graph that has none, those of joined ends and a hold."""
    inner = space.states_alone
    size = inner.arcs.heads.size
    if size:
        some = np.unique(np.linspace(0, size - 1, TRIED_ARCS).astype(np.int64))
        yield from (motions for _, _, motions in motions_of(inner, some))
        return
    if space.joins is not None:
        yield from (motions for _, motions in space.joins.motions() if len(motions))
    states = space.states(np.zeros(1, np.int64))
    columns = {name: np.nan_to_num(column) for name, column in states.__dict__.items()}
    start, end = (States(**columns, **{CLOCK: np.array([clock])}) for clock in (0.0, 1.0))
    yield Motions(space.world, space.model, HOLD, start, end)


def _reads_time(criterion: Criterion, motions: Motions) -> bool:
    """Return whether costs depend on when a motion begins: none can be had without, or they differ."""
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


ALIKE = 1e-9  # relative: what standing costs at two headings is the same
IN_PLACE = 1e-2  # relative: turning costs what standing meanwhile does, but for the quadrature
TRIED_PLACES = 200  # turns of which that is tried
DOING = "what standing costs was reckoned"


def hold_costs(
    criteria: Sequence[Criterion],
    space: TrajectoryGraph,
    states: States,
    lasts: FloatArray,
    presence: Presence | None = None,
    seconds: FloatArray | None = None,
) -> FloatArray:
    """Costs (N, k) of holds in states (N,), which last so long, s; from some times on, s, if these are given."""
    world = space.world if presence is None else presence.company.world
    columns = {name: np.nan_to_num(column) for name, column in states.__dict__.items()}
    start, end = States(**columns, **{CLOCK: 0.0 * lasts}), States(**columns, **{CLOCK: lasts})
    motions = Motions(world, space.model, HOLD, start, end, t0=seconds)
    return np.stack([motion_costs(criterion, motions) for criterion in criteria], axis=1)


def standing_rates(criteria: Sequence[Criterion], space: TrajectoryGraph, tick: float) -> FloatArray:
    """What standing for a tick costs in each state (n, k) of a graph, by criteria that read no time."""
    rates = np.zeros((space.size, len(criteria)))
    if not criteria:
        return rates

    def found(part: slice) -> tuple[slice, FloatArray]:
        states = space.states(np.arange(part.start, part.stop))
        return part, hold_costs(criteria, space, states, np.ones(states.size))

    for part, costs in space.spending.each(found, blocks(space.size), DOING):
        rates[part] = costs
    adds_up = np.array([criterion.aggregate != "max" for criterion in criteria], dtype=bool)
    rates[:, adds_up] *= tick
    return rates


def alike_at_places(rates: FloatArray, place: IntArray) -> BoolArray:
    """Whether (k,) each column of rates (n, k) is the same, but for rounding, at all nodes of each place."""
    size = int(place.max(initial=-1)) + 1
    low, high = np.full((size, rates.shape[1]), np.inf), np.full((size, rates.shape[1]), -np.inf)
    np.minimum.at(low, place, rates)
    np.maximum.at(high, place, rates)
    found: BoolArray = (high - low <= ALIKE * np.maximum(1.0, high)).all(axis=0)
    return found


def turn_as_they_stand(criteria: Sequence[Criterion], arcs: TimedArcs, presence: Presence) -> BoolArray:
    """Whether (k,) a motion in place costs by each criterion what standing at the place does meanwhile.

    Tried where somebody is noticed, at all headings: of a criterion that reads where the base is, and when, it holds.
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
    there = np.flatnonzero(end > begin)
    picked = order[(begin + (rng.random(tried.size) * (end - begin)).astype(np.int64))[there]]
    chosen, seconds = in_place[picked], presence.clock.seconds(ticks[tried[there]])
    unique, which = np.unique(chosen, return_inverse=True)
    worst, largest = np.zeros(len(criteria)), np.zeros(len(criteria))
    for _, rows, motions in motions_of(arcs.inner, unique):
        number = np.searchsorted(rows, unique)
        own = np.flatnonzero(rows[np.minimum(number[which], rows.size - 1)] == chosen)
        one = number[which[own]]
        moved = _at(motions, motions.law, one, seconds[own])
        lasts = np.asarray(np.broadcast_to(motions.duration, len(motions)))[one]
        here = arcs.states.take(arcs.place[arcs.tails[arcs.own[chosen[own]]]])
        for states in (motions.start.take(one), here):
            stood = hold_costs(criteria, arcs.inner, states, lasts, presence, seconds[own])
            turned = np.stack([motion_costs(criterion, moved) for criterion in criteria], axis=1)
            worst = np.maximum(worst, np.abs(turned - stood).max(axis=0, initial=0.0))
            largest = np.maximum(largest, np.maximum(turned, stood).max(axis=0, initial=0.0))
    found: BoolArray = worst <= IN_PLACE * largest
    return found


def _at(motions: Motions, law: Law, rows: IntArray, seconds: FloatArray) -> Motions:
    start, end = motions.start.take(rows), motions.end.take(rows)
    return Motions(motions.world, motions.model, law, start, end, t0=seconds)
