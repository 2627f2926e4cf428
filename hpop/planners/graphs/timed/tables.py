"""Tables of what arcs and standing cost by the tick where somebody who moves is noticed; elsewhere it is all one.

Costs come from the criteria themselves: motions are evaluated from the tick at which they are left for, and for
standing at a place short holds, a tick each. Of the people who move those are asked about who are noticed there. A pair
of place and tick that nobody can have reached by then is left out.
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

PAIRS = 1 << 18  # pairs of an arc or place and a tick that are looked at together, in one thread
BATCH = 1 << 13  # of these, evaluated together: what criteria make of them stays in the processor's cache
WAY = 0.5  # m: arcs whose ways are as long, to so much, are alike in where they notice somebody
DOING = "costs of people who move were reckoned"

Counts = NDArray[Any]  # int32 or int64


class ArcTable(NamedTuple):
    """Costs of arcs by the tick, in quanta.

    rows    (q,)  which of the arcs asked about, rising
    costs   k of them, (q, H + 1): by each criterion; the last column when all is over
    static  (r, k)  of all arcs, when all is over
    pairs   how many costs of an arc at a tick were reckoned
    """

    rows: IntArray
    costs: list[Counts]
    static: IntArray
    pairs: int


class StandingCosts(NamedTuple):
    """What standing at places costs, in quanta.

    tables  k of them, (P, H + 1) int64: of a sum since tick 0, of a worst moment during the tick
    rates   (P, k)  when all is over: a tick, not rounded
    pairs   how many costs of a place at a tick were reckoned
    """

    tables: list[IntArray]
    rates: FloatArray
    pairs: int


@dataclass(frozen=True, eq=False)
class TimedCosts:
    """What makes tables.

    space, presence
    criteria  those that read the time
    quanta    (k,)  what one count of each is
    spending
    """

    space: StateGraph
    presence: Presence
    criteria: Sequence[Criterion]
    quanta: FloatArray
    spending: Spending

    def arcs(
        self, legs: Sequence[LegMotions], place: IntArray, lasts: FloatArray, earliest: IntArray, wanted: BoolArray
    ) -> ArcTable:
        """Of arcs (r,) that leave from places at a tick or later and last so long, s; all that are wanted among them.

        Other rows are those of arcs that notice somebody.
        """
        size, horizon, number = place.size, self.presence.horizon, len(self.criteria)
        static = self._final(legs, size)
        way = _ways(legs, size)
        alike = np.ceil(way / WAY).astype(np.int64)

        def made(part: slice) -> tuple[IntArray, list[Counts], int]:
            asked = np.arange(part.start, part.stop)
            masks = np.empty((asked.size, horizon), self.presence.masks(0.0, 0.0).dtype)
            for kind in np.unique(alike[asked]).tolist():
                own = np.flatnonzero(alike[asked] == kind)
                longest = float(lasts[alike == kind].max())
                masks[own] = self.presence.masks(kind * WAY, longest)[place[asked[own]]]
            masks[np.arange(horizon) < earliest[asked, None]] = 0
            some = np.flatnonzero(masks.any(axis=1) | wanted[asked])
            rows, masks = asked[some], masks[some]
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
        for _ in range(number):  # each is dropped as it is put together: two of all of them would be too many
            self.spending.check(DOING, sum(part[1][0].nbytes for part in parts))
            columns.append(np.concatenate([np.zeros((0, horizon + 1), np.int32), *(part[1].pop(0) for part in parts)]))
        return ArcTable(rows, columns, static, sum(part[2] for part in parts))

    def standing(self, states: States, earliest: IntArray) -> StandingCosts:
        """At places, in these states (P,), from a tick on."""
        size, horizon = states.size, self.presence.horizon
        tick = self.presence.clock.tick
        over = np.full(size, self.presence.over)
        rates = np.zeros((size, len(self.criteria)))

        def at_last(part: slice) -> tuple[slice, FloatArray]:
            return part, self._holds(states.take(part), over[part], self.presence.at_last)

        for part, each in self.spending.each(at_last, _slices(size, BATCH), DOING):
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
        """Costs (N, k) in quanta, the nearest, for sums of many that are rounded up would be too large."""
        counts: FloatArray = np.rint(costs / self.quanta)
        return [counts[:, j].astype(np.int64) for j in range(self.quanta.size)]

    def _totals(self, j: int, paid: FloatArray) -> IntArray:
        """What standing costs, (P, H + 1), as a search takes it; what is paid is overwritten, to save memory."""
        paid /= self.quanta[j]
        if self.criteria[j].aggregate == "max":
            return np.rint(paid, out=paid).astype(np.int64)
        np.cumsum(paid, axis=1, out=paid)
        totals = np.zeros(paid.shape, np.int64)
        np.rint(paid[:, :-1], out=totals[:, 1:], casting="unsafe")
        return totals

    def _holds(self, states: States, seconds: FloatArray, world: World) -> FloatArray:
        """Costs (N, k) of standing for a tick from some times (N,), s, on."""
        costs = np.zeros((states.size, len(self.criteria)))
        lasts = np.full(states.size, self.presence.clock.tick)
        start = States(**states.__dict__, **{CLOCK: 0.0 * lasts})
        motions = Motions(world, self.space.model, HOLD, start, States(**states.__dict__, **{CLOCK: lasts}), t0=seconds)
        for j, criterion in enumerate(self.criteria):
            costs[:, j] = motion_costs(criterion, motions)
        return costs

    def _final(self, legs: Sequence[LegMotions], size: int) -> IntArray:
        """Costs (r, k) of arcs in quanta when all is over."""
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
    """The same in 32 bits if they hold it."""
    return column.astype(np.int32) if column.max(initial=0) < 2**31 else column


def _ways(legs: Sequence[LegMotions], size: int) -> FloatArray:
    """How far (r,), m, each arc leads."""
    ways = np.zeros(size)
    for leg in legs:
        has = np.flatnonzero(leg.of >= 0)
        own = leg.of[has]
        ways[has] += np.hypot(leg.end.x[own] - leg.start.x[own], leg.end.y[own] - leg.start.y[own])
    return ways
