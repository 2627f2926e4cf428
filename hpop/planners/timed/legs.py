"""The arcs of a graph of states as motions in time: which stay in place, how long all last, and the others' legs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion, motion_costs
from hpop.motions import Motions, States
from hpop.planners.graphs.arcs import MOVE, blocks
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.timed.clock import Clock
from hpop.world import World


class Leg(NamedTuple):
    """One motion of each of some rows of arcs that go from place to place.

    kind        of the motions
    of          (rows,)  the leg of each row, as its place among these; -1 where it has none
    start, end  states (L,)
    after       (L,)  s, from the departure of the arc to that of its leg
    lasts       (L,)  s
    """

    kind: str
    of: IntArray
    start: States
    end: States
    after: FloatArray
    lasts: FloatArray


@dataclass(frozen=True, eq=False)
class TimedArcs:
    """The arcs of a graph of states, each a motion or, where ends are joined, a chain of them.

    space      the graph
    inner      the graph without joined ends; itself if none are
    own        (m_inner,)  the place, among all arcs, of each of the inner graph's
    joins      (C,)  and of each join
    tails      (m,)  node
    durations  (m,)  s
    ticks      (m,)  the same on the clock
    stays      (m,)  whether an arc is a motion in place
    place      (n,)  number of the place of each node, from 0
    """

    space: StateGraph | JoinedEnds
    inner: StateGraph
    own: IntArray
    joins: IntArray
    tails: IntArray
    durations: FloatArray
    ticks: IntArray
    stays: BoolArray
    place: IntArray

    def costed_on(self, space: StateGraph | JoinedEnds) -> TimedArcs:
        """The same arcs of the same states in another world."""
        return replace(self, space=space, inner=space.inner if isinstance(space, JoinedEnds) else space)

    @classmethod
    def of(cls, space: StateGraph | JoinedEnds, clock: Clock) -> TimedArcs:
        """Those of a graph on a clock."""
        joined = space if isinstance(space, JoinedEnds) else None
        inner = space.inner if isinstance(space, JoinedEnds) else space
        size = inner.arcs.heads.size
        own, joins = (np.arange(size), np.zeros(0, np.int64)) if joined is None else joined.order
        m = size + joins.size
        tails, durations = np.empty(m, np.int64), np.empty(m)
        ticks, stays = np.empty(m, np.int64), np.zeros(m, dtype=bool)

        inner_tails = np.repeat(np.arange(inner.arcs.start.size - 1), np.diff(inner.arcs.start))

        def timed(part: slice) -> list[tuple[IntArray, IntArray, FloatArray, IntArray, bool]]:
            found = []
            for number, rows, motions in motions_of(inner, np.arange(part.start, part.stop)):
                seconds = np.broadcast_to(motions.duration, rows.size)
                at = own[rows]
                if number == MOVE:
                    count = clock.along(motions.start, motions.end, seconds)
                else:
                    count = clock.in_place(seconds, inner.places(inner_tails[rows]))
                found.append((at, rows, np.asarray(seconds), count, number != MOVE))
            return found

        for batch in space.spending.each(timed, blocks(size), f"{space.words} was timed"):
            for at, rows, seconds, count, in_place in batch:
                tails[at], durations[at], ticks[at], stays[at] = inner_tails[rows], seconds, count, in_place
        if joined is not None:
            seconds = np.zeros(joins.size)
            for rows, motions in joined.joins.motions():
                seconds[rows] += motions.duration
            tails[joins], durations[joins], ticks[joins] = joined.joins.tails, seconds, clock.of(seconds)
        place = space.places(np.arange(space.size))
        ends = np.flatnonzero(place < 0)  # joined ends have places of their own
        place = place.astype(np.int64)
        place[ends] = place.max(initial=-1) + 1 + np.arange(ends.size)
        return cls(space, inner, own, joins, tails, durations, ticks, stays, place)

    @cached_property
    def moving(self) -> IntArray:
        """Arcs (r,), rising, that do not stay in place: the rows of :meth:`legs`."""
        return np.flatnonzero(~self.stays)

    @cached_property
    def states(self) -> States:
        """A state (P,) at each place."""
        first = np.unique(self.place, return_index=True)[1]
        states = self.space.states(first)
        return States(**{name: np.nan_to_num(column) for name, column in states.__dict__.items()})

    def legs(self, arcs: IntArray) -> list[Leg]:
        """The motions of some arcs (r,), rising, leg by leg."""
        found = []
        number = np.full(self.durations.size, -1, np.int64)
        number[arcs] = np.arange(arcs.size)
        mine = number[self.own]
        for _, rows, motions in motions_of(self.inner, np.flatnonzero(mine >= 0)):
            found.append(_leg(arcs.size, mine[rows], motions, np.zeros(rows.size)))
        if isinstance(self.space, JoinedEnds):
            row = number[self.joins]
            elapsed = np.zeros(row.size)
            for chains, motions in self.space.joins.motions():
                asked = np.flatnonzero(row[chains] >= 0)
                some = Motions(
                    motions.world, motions.model, motions.law, motions.start.take(asked), motions.end.take(asked)
                )
                found.append(_leg(arcs.size, row[chains][asked], some, elapsed[chains][asked]))
                elapsed[chains] += motions.duration
        return [leg for leg in found if leg.lasts.size]


def motions_of(space: StateGraph, arcs: IntArray) -> Iterator[tuple[int, IntArray, Motions]]:
    """Arcs (N,), rising, of a graph of states as motions: the number of their kind, which of them, and these."""
    kinds = space.arcs.kinds[arcs]
    tails = np.searchsorted(space.arcs.start, arcs, side="right") - 1
    heads = space.arcs.heads[arcs].astype(np.int64)
    for number, kind in enumerate(space.kinds):
        own = np.flatnonzero(kinds == number)
        if own.size:
            yield number, arcs[own], space.motions(kind, tails[own], heads[own])


def _leg(rows: int, own: IntArray, motions: Motions, after: FloatArray) -> Leg:
    of = np.full(rows, -1, np.int64)
    of[own] = np.arange(own.size)
    lasts = np.array(np.broadcast_to(motions.duration, own.size))
    return Leg(motions.kind, of, motions.start, motions.end, after, lasts)


def costs_of(
    legs: Sequence[Leg],
    criteria: Sequence[Criterion],
    space: StateGraph,
    world: World,
    rows: IntArray,
    seconds: FloatArray,
) -> FloatArray:
    """Costs (N, k) of rows (N,) of arcs that leave at some times (N,), s, in a world."""
    costs = np.zeros((rows.size, len(criteria)))
    worst = np.array([criterion.aggregate == "max" for criterion in criteria])
    for leg in legs:
        has = np.flatnonzero(leg.of[rows] >= 0)
        own = leg.of[rows[has]]
        if not has.size:
            continue
        law = space.model.laws[leg.kind]
        start, end = leg.start.take(own), leg.end.take(own)
        motions = Motions(world, space.model, law, start, end, t0=seconds[has] + leg.after[own])
        for j, criterion in enumerate(criteria):
            paid = motion_costs(criterion, motions)
            costs[has, j] = np.maximum(costs[has, j], paid) if worst[j] else costs[has, j] + paid
    return costs
