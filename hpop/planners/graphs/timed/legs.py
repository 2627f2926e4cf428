"""Arcs of a graph with their durations on a clock, and the motions of which each arc consists.

An arc is one motion, or a chain of motions at the start or at a goal. A leg is one motion of an arc: the first, the
second, and so on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import LEAST
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import HOLD, Motions, States, laws_of
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.arcs import MOVE, blocks
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.trajectory_graph import NO_MARKER
from hpop.search import Graph
from hpop.world import World

TIMED, NODE = 27, 16  # bytes of memory for an arc and for a node with its time


class LegMotions(NamedTuple):
    """Motions (L,) of one kind, each the n-th leg (motion) of an arc that is a chain of motions; n is the same for all.

    kind        kind of the motions, such as "move"
    of          (rows,)  for each listed arc, the index (below L) of its n-th motion; -1 if it has none of this kind
    start, end  states (L,) at the beginning and end of the motions
    after       (L,)  s, from the departure on the arc to the beginning of the motion
    lasts       (L,)  s, duration
    """

    kind: str
    of: IntArray
    start: States
    end: States
    after: FloatArray
    lasts: FloatArray

    def take(self, rows: IntArray) -> LegMotions:
        """Return the motions with the given indices; other arcs then have none of this kind."""
        number = np.full(self.lasts.size + 1, -1, np.int64)
        number[rows] = np.arange(rows.size)
        start, end = self.start.take(rows), self.end.take(rows)
        return LegMotions(self.kind, number[self.of], start, end, self.after[rows], self.lasts[rows])


@dataclass(frozen=True, eq=False)
class TimedArcs:
    """The m arcs of a graph with their durations; an arc is one motion, or a chain from the start or to a goal.

    A robot needs time to accelerate, which a plan at constant speed ignores. So before a first move, it stands for a
    short time (``half``), in order that its execution can keep the times of the plan (:mod:`hpop.models.execution`).
    Therefore plans begin at an extra node beside the start, with copies of the start's arcs that include this time; a
    copied turn does not need it.

    space      the graph
    inner      the graph without the nodes that were added for start and goals
    own        (m_inner,)  index, among all arcs, of each arc of ``inner``
    joins      (C,)  index, among all arcs, of each arc from the start or to a goal that was added
    copied     (d,)  the arcs of which the last d arcs are copies, which leave the extra node
    begin      node at which plans begin
    half       s     time for which the robot stands there before it moves
    tails      (m,)  node at which each arc begins
    durations  (m,)  s     duration of each arc
    ticks      (m,)  durations in ticks of the clock
    stays      (m,)  whether an arc is a motion in place
    stands     (m,)  whether the robot stands before the motion of an arc, which therefore lasts longer
    states_of  (n,)  state of the graph for each node
    place      (n,)  number of the place of each node, from 0
    """

    space: StateGraph | JoinedEnds
    inner: StateGraph
    own: IntArray
    joins: IntArray
    copied: IntArray
    begin: int
    half: float
    tails: IntArray
    durations: FloatArray
    ticks: IntArray
    stays: BoolArray
    stands: BoolArray
    states_of: IntArray
    place: IntArray

    def costed_on(self, space: StateGraph | JoinedEnds) -> TimedArcs:
        """Return these arcs for a graph with the same arcs in another world, so that costs are computed there."""
        return replace(self, space=space, inner=space.states_alone)

    @classmethod
    def of(cls, space: StateGraph | JoinedEnds, clock: TickClock, start: int = -1, half: float = 0.0) -> TimedArcs:
        """Compute the durations of all arcs of a graph.

        start  node of the start
        half   s, time for which the robot stands before a first move. If it is not 0 and a move leaves the start, plans
               begin at an added node with copies of the arcs that leave the start, of which moves last longer by half
        """
        inner, (own, joins) = space.states_alone, space.order
        size = inner.arcs.heads.size
        m = size + joins.size
        space.spending.hold(m * TIMED + space.size * NODE, f"{space.words} was timed")
        tails, durations = np.empty(m, np.int64), np.empty(m)
        ticks, stays = np.empty(m, np.int64), np.zeros(m, dtype=bool)
        moves = np.zeros(m, dtype=bool)  # begins with a move
        space_places = inner.places(np.arange(inner.size))

        inner_tails = np.repeat(np.arange(inner.arcs.start.size - 1), np.diff(inner.arcs.start))

        def timed(part: slice) -> tuple[slice, FloatArray, IntArray]:
            seconds = np.zeros(part.stop - part.start)
            for rows, motions in inner.legs(np.arange(part.start, part.stop)):
                seconds[rows - part.start] += motions.duration
            begin, end = inner_tails[part], inner.arcs.heads[part].astype(np.int64)
            count = clock.in_place(seconds, space_places[begin])
            in_line = np.flatnonzero(inner.arcs.kinds[part] == MOVE)
            ends = inner.states(begin[in_line]), inner.states(end[in_line])
            count[in_line] = clock.along(*ends, seconds[in_line])
            return part, seconds, count

        for part, seconds, count in space.spending.each(timed, blocks(size), f"{space.words} was timed"):
            at, tail = own[part], inner_tails[part]
            tails[at], durations[at], ticks[at] = tail, seconds, count
            stays[at] = space_places[tail] == space_places[inner.arcs.heads[part]]
            moves[at] = inner.arcs.kinds[part] == MOVE
        if space.joins is not None:
            seconds = np.zeros(joins.size)
            for rows, motions in space.joins.motions():
                at_once = joins[rows[seconds[rows] == 0.0]]
                moves[at_once] = motions.kind == space.kinds[MOVE]
                seconds[rows] += motions.duration
            tails[joins], durations[joins], ticks[joins] = space.joins.tails, seconds, clock.of(seconds)
        place = _numbered_places(space.places(np.arange(space.size)))
        leaving, states_of = np.flatnonzero(tails == start), np.arange(space.size)
        stands, begin = np.zeros(m, dtype=bool), start
        if half > 0.0 and moves[leaving].any():
            begin, states_of, place = space.size, np.append(states_of, start), np.append(place, place[start])
            stands, stays = np.append(stands, moves[leaving]), np.append(stays, stays[leaving])
            tails = np.append(tails, np.full(leaving.size, begin))
            durations = np.append(durations, durations[leaving]) + half * stands
            ticks = np.append(ticks, ticks[leaving]) + round(half / clock.tick) * stands
        copied = leaving[: tails.size - m]
        return cls(
            space,
            inner,
            own,
            joins,
            copied,
            begin,
            half,
            tails,
            durations,
            ticks,
            stays,
            stands,
            states_of,
            place,
        )

    def with_copies(self, graph: Graph) -> Graph:
        """Return a search graph extended by the extra node where plans begin, with copies of the start's arcs."""
        if not self.copied.size:
            return graph
        heads, costs = (
            np.append(graph.heads, graph.heads[self.copied]),
            graph.costs[np.append(np.arange(graph.arcs), self.copied)],
        )
        indptr = np.append(graph.indptr, graph.arcs + self.copied.size)
        for column in (heads, costs):
            column.setflags(write=False)
        return Graph.from_csr(indptr, heads, costs, aggregates=graph.aggregates)

    @cached_property
    def _markers(self) -> IntArray | None:
        markers = self.space.markers
        return None if markers is None else np.append(markers, markers[self.copied])

    def through(self, nodes: IntArray, arcs: IntArray, offsets: IntArray | int = 0) -> IntArray:
        """Return the nodes of the graph through which a path leads, with markers of its arcs.

        nodes    (s + 1,)  states of its nodes, without holds
        arcs     (s,)      its arcs; below 0 for what is no arc of this graph
        offsets  (s,)      added to markers: the first node of a layer in which the arc begins
        """
        if self._markers is None:
            return nodes
        markers = np.where(arcs >= 0, self._markers[arcs], NO_MARKER)
        marked = np.flatnonzero(markers != NO_MARKER)
        return np.insert(nodes, marked + 1, (markers + offsets)[marked])

    def motion_counts(self, arcs: IntArray) -> IntArray:
        """Return the number (s,) of motions in each of some arcs, without pauses."""
        if self.space.joins is None:
            return self.inner.motion_counts(arcs)  # copies, at the end, are of single motions
        number = np.ones(self.durations.size, np.int64)
        number[self.joins] = np.sum(self.space.joins.present, axis=0)
        number[number.size - self.copied.size :] = number[self.copied]
        return np.asarray(number[arcs])

    def pauses(self, arcs: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pauses within some arcs (s,): for each the arc's position, the motions before it, and seconds."""
        alone = self.space.joins is None and not self.copied.size
        return self.inner.pauses(arcs if alone else arcs[:0])

    @cached_property
    def moving(self) -> IntArray:
        """Indices (r,), ascending, of the arcs that lead to another place: neither turns in place nor waits."""
        return np.flatnonzero(~self.stays)

    @cached_property
    def states(self) -> States:
        """One state at each place, (P,)."""
        first = np.unique(self.place, return_index=True)[1]
        states = self.space.states(self.states_of[first])
        return States(**{name: np.nan_to_num(column) for name, column in states.__dict__.items()})

    def legs(self, arcs: IntArray) -> list[LegMotions]:
        """Return the motions of arcs (r,), given in ascending order: all first motions, all second ones, and so on.

        Motions of different kinds are in different items. Their field ``of`` refers to the arcs by position in
        ``arcs``.
        """
        row = np.full(self.tails.size, -1, np.int64)
        row[arcs] = np.arange(arcs.size)
        copies = self.tails.size - self.copied.size
        legs = [*self._legs(arcs.size, row[:copies], np.zeros(copies))]
        if (row[copies:] >= 0).any():
            for after, own in ((0.0, ~self.stands), (self.half, self.stands)):
                numbers = np.full(copies, -1, np.int64)
                numbers[self.copied] = np.where(own[copies:], row[copies:], -1)
                legs += self._legs(arcs.size, numbers, np.full(copies, after))
            stood = np.flatnonzero(self.stands & (row >= 0))
            legs.append(_leg(arcs.size, row[stood], self._standing(stood.size), np.zeros(stood.size)))
        return [leg for leg in legs if leg.lasts.size]

    def _legs(self, size: int, row: IntArray, after: FloatArray) -> Iterator[LegMotions]:
        """Yield the motions of some arcs, by kind and by position in the chains of motions.

        size   number of wanted arcs
        row    (m,)  index of each arc among the wanted arcs; -1 if it is not wanted
        after  (m,)  s, from the departure on each arc to its first motion
        """
        mine, passed = row[self.own], after[self.own]
        for rows, motions in self.inner.legs(np.flatnonzero(mine >= 0)):
            yield _leg(size, mine[rows], motions, passed[rows])
            passed[rows] += motions.duration
        if self.space.joins is None:
            return
        joined, elapsed = row[self.joins], after[self.joins]
        for chains, motions in self.space.joins.motions():
            own = np.flatnonzero(joined[chains] >= 0)
            start, end = motions.start.take(own), motions.end.take(own)
            part = Motions(motions.world, motions.model, motions.law, start, end)
            yield _leg(size, joined[chains][own], part, elapsed[chains][own])
            elapsed[chains] += motions.duration

    def _standing(self, count: int) -> Motions:
        """Return ``count`` copies of the hold in which the robot stands before a first move."""
        states = self.space.states(np.full(count, self.states_of[self.begin]))
        start, end = (States(**states.__dict__, **{CLOCK: np.full(count, clock)}) for clock in (0.0, self.half))
        return Motions(self.space.world, self.space.model, HOLD, start, end)


def _numbered_places(places: IntArray) -> IntArray:
    """Return numbers from 0 without gaps for the places (n,) of all nodes, by which tables have rows for places.

    Negative numbers belong to nodes that were added for start and goals; each of these gets a number of its own at the
    end. Gaps occur in roadmaps, where a position without a collision-free link has no node.
    """
    inside = places >= 0
    used = np.zeros(int(places.max(initial=-1)) + 1, dtype=bool)
    used[places[inside]] = True
    numbers = np.empty(places.size, np.int64)
    numbers[inside] = (np.cumsum(used) - 1)[places[inside]]
    numbers[~inside] = used.sum() + np.arange(places.size - inside.sum())
    return numbers


def _leg(rows: int, own: IntArray, motions: Motions, after: FloatArray) -> LegMotions:
    of = np.full(rows, -1, np.int64)
    of[own] = np.arange(own.size)
    lasts = np.array(np.broadcast_to(motions.duration, own.size))
    return LegMotions(motions.kind, of, motions.start, motions.end, after, lasts)


def arrivals(legs: Sequence[LegMotions], ends: BoolArray, durations: FloatArray, half: float) -> list[LegMotions]:
    """Return the holds at goals in which the robot's execution completes a plan that ends with a move.

    The robot needs time to slow down, so it arrives later than a plan at constant speed.

    legs       motions of r arcs
    ends       (r,)  whether each arc leads to a goal
    durations  (r,)  s, duration of each arc
    half       s, how much later the robot arrives
    """
    holds = []
    for leg in legs if half > 0.0 else ():
        own = leg.of[ends]
        rows = np.flatnonzero(ends)[own >= 0]
        own = own[own >= 0]
        last = leg.after[own] + leg.lasts[own] > durations[rows] - LEAST
        rows, own = rows[last], own[last]
        if leg.kind == "move" and own.size:
            of = np.full(ends.size, -1, np.int64)
            of[rows] = np.arange(own.size)
            there = leg.end.take(own)
            holds.append(LegMotions(HOLD.kind, of, there, there, durations[rows], np.full(own.size, half)))
    return holds


def costs_of(
    legs: Sequence[LegMotions],
    criteria: Sequence[Criterion],
    space: StateGraph,
    world: World,
    rows: IntArray,
    seconds: FloatArray,
) -> FloatArray:
    """Return the costs (N, k) of arcs at given departure times, by k criteria, in their units.

    legs     motions of all listed arcs, of :meth:`TimedArcs.legs`
    rows     (N,)  index of each arc among the listed ones
    seconds  (N,)  s, departure times
    """
    costs = np.zeros((rows.size, len(criteria)))
    worst = np.array([criterion.aggregate == "max" for criterion in criteria])
    for leg in legs:
        has = np.flatnonzero(leg.of[rows] >= 0)
        own = leg.of[rows[has]]
        if not has.size:
            continue
        law = laws_of(space.model)[leg.kind]
        start, end = leg.start.take(own), leg.end.take(own)
        motions = Motions(world, space.model, law, start, end, t0=seconds[has] + leg.after[own])
        for j, criterion in enumerate(criteria):
            paid = motion_costs(criterion, motions)
            costs[has, j] = np.maximum(costs[has, j], paid) if worst[j] else costs[has, j] + paid
    return costs
