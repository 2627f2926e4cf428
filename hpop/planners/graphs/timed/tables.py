"""Tables of time-dependent costs: for each tick, the costs of arcs and of standing at places near moving people.

Only places where moving people are noticed have a table; elsewhere costs do not depend on time. The criteria evaluate
each motion at the tick at which it begins, and standing at a place as holds of one tick each. A place is left out at
ticks before the robot can reach it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import HOLD, Motions, States
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.legs import LegMotions, costs_of
from hpop.planners.graphs.timed.presence import Presence
from hpop.planners.spending import Spending
from hpop.world import World

PAIRS = 1 << 18  # number of costs (of an arc or place at a tick) in a block that a thread computes
BATCH = 1 << 13  # number of costs evaluated at once, so that the arrays stay in the processor's cache
LENGTH = 0.5  # m: arcs are grouped by length in steps of this, and a group shares the places where people are noticed
DOING = "costs near moving people were computed"

Counts = NDArray[Any]  # int32 or int64


class ArcTable(NamedTuple):
    """Costs of arcs for each tick at which the robot may depart, in quanta.

    People have settled when their predictions have ended, so that costs no longer change.

    rows    (q,)  indices of the arcs with a table, ascending
    costs   for each of k criteria a table (q, H + 1); the last column has the costs after all people have settled
    static  (r, k)  costs of all arcs after all people have settled
    pairs   number of costs that were computed, for statistics
    """

    rows: IntArray
    costs: list[Counts]
    static: IntArray
    pairs: int


class StandingCosts(NamedTuple):
    """Costs of standing at P places, in quanta; from tick H on, they no longer change.

    tables  for each of k criteria a table (P, H + 1), int64: if it adds up, the cost of standing from tick 0 until
            each tick; if it takes the worst moment, the cost during each tick
    rates   (P, k)  costs per tick from tick H on, not rounded
    pairs   number of pairs of a place and a tick for which costs were computed, for statistics
    """

    tables: list[IntArray]
    rates: FloatArray
    pairs: int


@dataclass(frozen=True, eq=False)
class TimedCosts:
    """Computation of the cost tables of a graph, for each tick.

    space     the graph
    presence  places and ticks at which people are noticed
    criteria  the k criteria that depend on time
    quanta    (k,)  their quanta
    spending  time and memory limits
    """

    space: StateGraph
    presence: Presence
    criteria: Sequence[Criterion]
    quanta: FloatArray
    spending: Spending

    def arcs(
        self, legs: Sequence[LegMotions], place: IntArray, lasts: FloatArray, earliest: IntArray, wanted: BoolArray
    ) -> ArcTable:
        """Compute the costs of r arcs for each tick of departure.

        An arc gets a table if a person is noticed on it, or if it is marked in ``wanted``.

        legs      motions of the arcs, of :meth:`.legs.TimedArcs.legs`
        place     (r,)    place where each arc begins
        lasts     (r,) s  duration of each arc
        earliest  (r,)    earliest tick of departure; at earlier ticks, costs are not computed
        wanted    (r,)    mask of the arcs that get a table in any case
        """
        size, horizon, number = place.size, self.presence.horizon, len(self.criteria)
        static = self._final(legs, size)
        lengths = _lengths(legs, size)
        alike = np.ceil(lengths / LENGTH).astype(np.int64)

        def made(part: slice) -> tuple[IntArray, list[Counts], int]:
            arcs = np.arange(part.start, part.stop)
            masks = np.empty((arcs.size, horizon), self.presence.masks(0.0, 0.0).dtype)
            for kind in np.unique(alike[arcs]).tolist():
                own = np.flatnonzero(alike[arcs] == kind)
                longest = float(lasts[alike == kind].max())
                masks[own] = self.presence.masks(kind * LENGTH, longest)[place[arcs[own]]]
            masks[np.arange(horizon) < earliest[arcs, None]] = 0
            timed = np.flatnonzero(masks.any(axis=1) | wanted[arcs])
            rows, masks = arcs[timed], masks[timed]
            row, tick = np.nonzero(masks)
            costs = [np.repeat(static[rows, j, None], horizon + 1, axis=1) for j in range(number)]
            for pairs, world in self._batches(masks[row, tick]):
                paid = costs_of(legs, self.criteria, self.space, world, rows[row[pairs]], self._seconds(tick[pairs]))
                for j, counts in enumerate(self._counts(paid)):
                    costs[j][row[pairs], tick[pairs]] = counts
            return rows, [_small(column) for column in costs], row.size

        parts = []
        for part in self.spending.each(made, self._slices(size), DOING):
            self.spending.hold(sum(column.nbytes for column in part[1]), DOING)
            parts.append(part)
        rows = np.concatenate([np.zeros(0, np.int64), *(part[0] for part in parts)])
        columns = []
        for _ in range(number):  # one criterion after another, so that no second copy of all tables is in memory
            self.spending.check(DOING, sum(part[1][0].nbytes for part in parts))
            columns.append(np.concatenate([np.zeros((0, horizon + 1), np.int32), *(part[1].pop(0) for part in parts)]))
        return ArcTable(rows, columns, static, sum(part[2] for part in parts))

    def standing(self, states: States, earliest: IntArray) -> StandingCosts:
        """Compute the costs of standing at P places for each tick.

        states    (P,)  a state at each place
        earliest  (P,)  tick before which the place cannot be reached, so that people are not considered
        """
        size, horizon = states.size, self.presence.horizon
        tick = self.presence.clock.tick
        over = np.full(size, self.presence.over)
        rates = np.zeros((size, len(self.criteria)))

        def final(part: slice) -> tuple[slice, FloatArray]:
            return part, self._holds(states.take(part), over[part], self.presence.at_last)

        for part, each in self.spending.each(final, _slices(size, BATCH), DOING):
            rates[part] = each
        paid = [np.empty((size, horizon + 1)) for _ in self.criteria]
        self.spending.hold(2 * 8 * size * (horizon + 1) * len(paid), DOING)
        for j, column in enumerate(paid):
            column[:] = rates[:, j, None]

        def made(part: slice) -> int:
            masks = self.presence.masks(0.0, tick)[part].copy()
            masks[np.arange(horizon) < earliest[part, None]] = 0
            place, at = np.nonzero(masks)
            for pairs, world in self._batches(masks[place, at]):
                here = part.start + place[pairs]
                each = self._holds(states.take(here), self._seconds(at[pairs]), world)
                for j, column in enumerate(paid):
                    column[here, at[pairs]] = each[:, j]
            return int(place.size)

        pairs = sum(self.spending.each(made, self._slices(size), DOING))
        totals = [self._totals(j, paid.pop(0)) for j in range(len(self.criteria))]
        self.spending.release(8 * size * (horizon + 1) * len(totals))
        return StandingCosts(totals, rates / self.quanta, pairs)

    def _counts(self, costs: FloatArray) -> list[IntArray]:
        """Convert costs (N, k) to quanta, as k columns (N,) of integers.

        They are rounded to the nearest integer, since rounding up would make long sums too large.
        """
        counts: FloatArray = np.rint(costs / self.quanta)
        return [counts[:, j].astype(np.int64) for j in range(self.quanta.size)]

    def _totals(self, j: int, paid: FloatArray) -> IntArray:
        """Convert costs of standing for each tick to the table that the search needs, in quanta.

        For a criterion that adds up, the table has cumulative sums over ticks; for one that takes the worst moment, the
        cost of each tick.

        j     index of the criterion
        paid  (P, H + 1)  costs in the criterion's unit; overwritten
        """
        paid /= self.quanta[j]
        if self.criteria[j].aggregate == "max":
            return np.rint(paid, out=paid).astype(np.int64)
        np.cumsum(paid, axis=1, out=paid)
        totals = np.zeros(paid.shape, np.int64)
        np.rint(paid[:, :-1], out=totals[:, 1:], casting="unsafe")
        return totals

    def _holds(self, states: States, seconds: FloatArray, world: World) -> FloatArray:
        """Return the costs (N, k) of standing for one tick in states (N,), from times ``seconds`` (N,), s, on."""
        costs = np.zeros((states.size, len(self.criteria)))
        lasts = np.full(states.size, self.presence.clock.tick)
        start = States(**states.__dict__, **{CLOCK: 0.0 * lasts})
        motions = Motions(world, self.space.model, HOLD, start, States(**states.__dict__, **{CLOCK: lasts}), t0=seconds)
        for j, criterion in enumerate(self.criteria):
            costs[:, j] = motion_costs(criterion, motions)
        return costs

    def _final(self, legs: Sequence[LegMotions], size: int) -> IntArray:
        """Return the costs (size, k) of arcs, in quanta, after all predictions of people have ended.

        legs  motions of the arcs
        """
        static = np.zeros((size, len(self.criteria)), np.int64)

        def costs(part: slice) -> tuple[slice, list[IntArray]]:
            rows = np.arange(part.start, part.stop)
            over = np.full(rows.size, self.presence.over)
            paid = costs_of(legs, self.criteria, self.space, self.presence.at_last, rows, over)
            return part, self._counts(paid)

        for part, counts in self.spending.each(costs, _slices(size, BATCH), DOING):
            for j, column in enumerate(counts):
                static[part, j] = column
        return static

    def _batches(self, masks: NDArray[Any]) -> Iterator[tuple[IntArray, World]]:
        for pairs, world in self.presence.parts(masks):
            for part in _slices(pairs.size, BATCH):
                yield pairs[part], world

    def _seconds(self, ticks: IntArray) -> FloatArray:
        return self.presence.clock.seconds(ticks)

    def _slices(self, size: int) -> Iterator[slice]:
        return _slices(size, max(1, PAIRS // max(1, self.presence.horizon)))


def _slices(size: int, step: int) -> Iterator[slice]:
    return (slice(begin, min(begin + step, size)) for begin in range(0, size, step))


def _small(column: IntArray) -> Counts:
    """Return an array of costs as 32-bit integers if its values are small enough, to save memory."""
    return column.astype(np.int32) if column.max(initial=0) < 2**31 else column


def _lengths(legs: Sequence[LegMotions], size: int) -> FloatArray:
    """Return the length (r,), m, of each of ``size`` arcs: the distance driven in all its motions (``legs``)."""
    lengths = np.zeros(size)
    for leg in legs:
        has = np.flatnonzero(leg.of >= 0)
        own = leg.of[has]
        lengths[has] += np.hypot(leg.end.x[own] - leg.start.x[own], leg.end.y[own] - leg.start.y[own])
    return lengths
