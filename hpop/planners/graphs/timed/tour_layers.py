"""Graph of a tour for a search in time steps: one copy (layer) of the graph on its clock for each set of decided stops.

All layers share the tables of the graph: an arc of any layer refers to a row of its original, and a node to its place
(:class:`hpop.search.timed.TimedGraph`). Further arcs lead to later layers (:mod:`hpop.planners.graphs.tour`):

- A visit with a dwell time stands at its place, with the costs of any hold, while no person comes too near. It lasts
  for the dwell time, and for the time in which the robot stops before it and starts after it
  (:class:`hpop.models.execution.Ramps`). So the robot that executes the plan stands there for the whole dwell time.
- A visit without a dwell time, and the end of a tour that skips optional stops, take no time, but an arc takes at least
  one tick. So they are not arcs themselves: each arc that leads to such a state has a copy for each layer that can be
  reached there at once. Arcs that leave the start have copies too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion, index_of_role
from hpop.errors import OptionError
from hpop.goals.tour import Tour
from hpop.planners.graphs.state_graph import ARC
from hpop.planners.graphs.timed.plans import GraphOnClock
from hpop.planners.graphs.tour import NONE, TourGraph
from hpop.search import Graph
from hpop.search.timed.graph import HOLD, MAX_TICKS, RATE_BITS, PathSteps, TimedGraph
from hpop.trajectories.trajectory import Trajectory

SCRATCH = 80  # bytes for each arc while arcs are sorted
NEVER = 2**62  # weight of skipped stops, where a layer cannot be reached


class TourSteps(NamedTuple):
    """Steps of a path of a tour, as a path of one layer.

    steps  arcs and holds of the layer, with departures; visits with a dwell time are holds
    least  (s,)  s, shortest duration of each step: of visits, 0 for others
    walk   (w,)  nodes of the tour's graph without clock, one after another
    """

    steps: PathSteps
    least: FloatArray
    walk: IntArray


@dataclass(frozen=True, eq=False)
class TimedTour:
    """Graph of a tour on a clock. Node v of the graph of one layer, of n nodes, has the number l * n + v in layer l.

    timed    graph of one layer on the clock
    tour     graph of the tour without a clock
    graph    graph that is searched
    goals    goals in the last layer
    origins  (m,)  arc of ``timed`` for each arc; NONE for visits with a dwell time, and for an arc that is a whole tour
             without motion: the start is a goal, and its stops are visited in no time
    stops    (m,)  stop at which the robot stands during each arc; NONE for other arcs
    needed   s     shortest duration of a visit, for each stop of the tour
    """

    timed: GraphOnClock
    tour: TourGraph
    graph: TimedGraph
    goals: list[int]
    origins: NDArray[np.int32]
    stops: NDArray[np.int32]
    needed: FloatArray

    def steps(self, path: PathSteps) -> TourSteps:
        """Return the steps of a path as steps of one layer."""
        count = self.timed.graph.graph.nodes
        moved = path.arcs != HOLD
        if moved.any() and self.origins[path.arcs[moved][0]] == NONE == self.stops[path.arcs[moved][0]]:
            path, moved = PathSteps(path.nodes[:1], path.arcs[:0], path.departures[:1]), moved[:0]
        origins, stops = np.full(path.arcs.size, HOLD), np.full(path.arcs.size, NONE)
        origins[moved], stops[moved] = self.origins[path.arcs[moved]], self.stops[path.arcs[moved]]
        origins[stops != NONE] = HOLD
        least = np.where(stops != NONE, self.needed[stops], 0.0)
        layers, nodes = np.divmod(path.nodes, count)
        arcs, begins, own = self.timed.arcs, layers * self.tour.inner.size, np.append(True, moved)
        walk = arcs.through((begins + arcs.states_of[nodes])[own], origins[moved], begins[:-1][moved])
        return TourSteps(PathSteps(nodes, origins, path.departures), least, walk)

    def moved(self, paths: Sequence[TourSteps]) -> tuple[Trajectory, ...]:
        """Return the trajectories of some paths, without any holds."""
        if not paths:
            return ()
        sizes = np.array([path.walk.size for path in paths], np.int64)
        stretches = self.tour.stretches(np.concatenate([np.zeros(0, np.int64), *(path.walk for path in paths)]), sizes)
        return stretches.trajectories(self.tour.model, self.tour.kinds)

    def closed(self, one_layer: BoolArray) -> BoolArray:
        """Return the mask (m,) of the closed arcs, from that of the arcs of one layer."""
        return np.asarray(one_layer[np.maximum(self.origins, 0)] & (self.origins != NONE))

    def blocked_stops(self) -> Iterator[str]:
        """Yield the names of the stops at which people leave no time for a visit; optional stops are left out."""
        graph, clock = self.timed.graph, self.timed.clock
        earliest = self.timed.earliest
        last = np.where(graph.cut, np.arange(1, graph.cut.shape[1] + 1), 0)
        since = np.pad(np.maximum.accumulate(last[:, :-1], axis=1), ((0, 0), (1, 0)))  # free from then to each tick
        latest = MAX_TICKS if graph.arrive_by is None else graph.arrive_by
        for stop, members, needed in zip(self.tour.tour.stops, self.tour.members, self.needed, strict=True):
            ticks = max(1, clock.up_to(float(needed)))
            places = graph.place[members]
            begins = np.arange(max(0, since.shape[1] - ticks))
            free = (since[places, ticks:] <= begins) & (begins >= earliest[members, None])
            free &= begins + ticks <= latest
            later = ~graph.cut[places, -1] & (np.maximum(earliest[members], graph.horizon) + ticks <= latest)
            if members.size and not (stop.optional or free.any() or later.any()):
                yield stop.name


def timed_tour(
    timed: GraphOnClock, tour: TourGraph, goals: Sequence[int], criteria: Sequence[Criterion], *, anywhere: bool = False
) -> TimedTour:
    """Return the graph of a tour on a clock, with a layer for each set of decided stops.

    Raises Exhausted if a limit is passed, and OptionError for a dwell time of too many ticks.

    timed     graph of one layer on the clock, with ``passes_goals``
    goals     nodes of the goals in it
    criteria  costs of the search
    anywhere  whether paths may begin at any node, in any layer, as in a drive
    """
    return _Layering(timed, tour, tuple(goals), tuple(criteria), anywhere).layered()


class _Arcs(NamedTuple):
    """Arcs of all layers, as columns (c,): tail, head, arc of one layer, stop, and weight of skipped stops in quanta.

    Arc and stop are NONE as in :class:`TimedTour`.
    """

    tails: IntArray
    heads: IntArray
    origins: IntArray
    stops: IntArray
    missed: IntArray

    @classmethod
    def joined(cls, parts: Sequence[_Arcs]) -> _Arcs:
        """Return all arcs of several lists, in their order."""
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def take(self, rows: IntArray) -> _Arcs:
        """Return the arcs with the given indices."""
        return _Arcs(*(column[rows] for column in self))


@dataclass(frozen=True, eq=False)
class _Layering:
    """Intermediate results of :func:`timed_tour`; the fields are the arguments of that function."""

    timed: GraphOnClock
    tour_graph: TourGraph
    goals: tuple[int, ...]
    criteria: tuple[Criterion, ...]
    anywhere: bool = False

    @property
    def tour(self) -> Tour:
        return self.tour_graph.tour

    @property
    def count(self) -> int:
        """Number of nodes of a layer."""
        return self.timed.graph.graph.nodes

    @property
    def last(self) -> int:
        """Number of the last layer, in which all stops are decided."""
        return len(self.tour.layers) - 1

    @cached_property
    def _missed(self) -> int | None:
        """Column of the cost that counts skipped stops; None if it is no cost."""
        return index_of_role("stops_missed", self.criteria)

    def _mask(self, states: IntArray) -> BoolArray:
        """Return a mask (n,) of the nodes whose state is in ``states``; two nodes may have the start's state."""
        mask = np.zeros(self.tour_graph.inner.size, np.bool_)
        mask[states] = True
        return np.asarray(mask[self.timed.arcs.states_of])

    @cached_property
    def _members(self) -> list[BoolArray]:
        """For each stop, a mask (n,) of the nodes at which it can be visited."""
        return [self._mask(members) for members in self.tour_graph.members]

    @cached_property
    def _is_goal(self) -> BoolArray:
        return self._mask(np.array(self.goals, np.int64))

    @cached_property
    def needed(self) -> FloatArray:
        """Shortest duration (s,), s, of a visit of each stop: 0 without a dwell time."""
        half = 0.0 if self.timed.ramps is None else self.timed.ramps.half
        return np.array([stop.dwell + 2.0 * half if stop.dwell else 0.0 for stop in self.tour.stops])

    @cached_property
    def _ticks(self) -> IntArray:
        """Duration (s,) of a visit of each stop, ticks."""
        ticks = np.array([self.timed.clock.up_to(needed) for needed in self.needed.tolist()], np.int64)
        if (longest := int(ticks.max())) >= MAX_TICKS:
            raise OptionError(
                f"among moving people, a dwell must last less than {MAX_TICKS:,} time steps, got {longest:,} of "
                f"{self.timed.clock.tick:g} s; shorten the dwell, or give a larger clock"
            )
        return ticks

    def _weight(self, skipped: Sequence[int]) -> int:
        """Return the cost, in quanta, of skipping some stops."""
        costs = self.tour_graph.missed_costs([skipped], self.criteria)
        return 0 if self._missed is None else int(costs[0, self._missed])

    def _at_once(self, layer: int) -> dict[int, IntArray]:
        """Return, for each layer that some node of ``layer`` reaches in no time, the least weight (n,) to get there.

        Stops without a dwell time are visited at their nodes. At a goal, the tour may also skip the optional stops that
        remain, which leads to the last layer. A weight is the cost, in quanta, of the stops skipped on the way; it
        is NEVER at nodes that do not reach the layer.
        """
        endings = {i: skipped for i, skipped in self.tour.endings if skipped}
        found = {layer: np.zeros(self.count, np.int64)}
        for at in range(layer, self.last):
            if at not in found:
                continue
            further = [
                (step.layer, self._members[step.stop], step.skipped)
                for step in self.tour.steps[at]
                if not self.tour.stops[step.stop].dwell
            ]
            if at in endings:
                further.append((self.last, self._is_goal, endings[at]))
            for to, here, skipped in further:
                weights = np.where(here & (found[at] < NEVER), found[at] + self._weight(skipped), NEVER)
                found[to] = np.minimum(found.get(to, NEVER), weights)
        return {to: weights for to, weights in found.items() if to != layer and (weights < NEVER).any()}

    def _visits(self) -> dict[int, list[_Arcs]]:
        """Return the arcs that visit stops with a dwell time, by the layer to which they lead."""
        arcs: dict[int, list[_Arcs]] = {}
        for layer, steps in enumerate(self.tour.steps):
            for step in steps:
                if not self.tour.stops[step.stop].dwell:
                    continue
                tails = np.flatnonzero(self._members[step.stop])
                heads = self.timed.arcs.states_of[tails]
                columns = tails + layer * self.count, heads + step.layer * self.count, NONE, step.stop
                made = (*columns, self._weight(step.skipped))
                arcs.setdefault(step.layer, []).append(
                    _Arcs(*(np.broadcast_to(np.asarray(column, np.int64), tails.shape) for column in made))
                )
        return arcs

    def _arcs(self) -> _Arcs:
        """Return all arcs, sorted by tail."""
        base, visits, parts = self.timed.graph.graph, self._visits(), list[_Arcs]()
        tails, heads, every = self.timed.arcs.tails, base.heads.astype(np.int64), np.arange(base.arcs)
        none, zero = np.full(base.arcs, NONE), np.zeros(base.arcs, np.int64)
        for layer in range(self.last + 1):
            moves = _Arcs(tails + layer * self.count, heads + layer * self.count, every, none, zero)
            arcs = _Arcs.joined([moves, *visits.get(layer, [])])
            parts.append(arcs)
            for to, weights in self._at_once(layer).items():
                more = weights[arcs.heads - layer * self.count]
                own = np.flatnonzero(more < NEVER)
                copies = arcs.take(own)
                parts.append(
                    copies._replace(heads=copies.heads + (to - layer) * self.count, missed=copies.missed + more[own])
                )
        arcs = _Arcs.joined(parts)
        arcs = _Arcs.joined([arcs, *self._from_start(arcs)])
        return arcs.take(np.argsort(arcs.tails, kind="stable"))

    def _from_start(self, arcs: _Arcs) -> Iterator[_Arcs]:
        """Yield arcs for paths that visit stops in no time at their first node, before they leave it.

        Each is a copy of an arc that leaves this node in the layer after the visits; the copy begins in the layer
        before them. Paths begin at the start; in a drive, at any node, in any layer. If the start is a goal, a tour may
        consist of such visits alone: then an arc that lasts a tick is added for it.
        """
        start, layers, nodes = self.timed.start, arcs.tails // self.count, arcs.tails % self.count
        for layer in range(self.last) if self.anywhere else (0,):
            for to, weights in self._at_once(layer).items():
                begins = (layers == to) & (weights[nodes] < NEVER) & (self.anywhere | (nodes == start))
                copies = arcs.take(np.flatnonzero(begins))
                missed = copies.missed + weights[copies.tails % self.count]
                yield copies._replace(tails=copies.tails + (layer - to) * self.count, missed=missed)
                if to == self.last and self._is_goal[start] and layer == 0 and weights[start] < NEVER:
                    head = to * self.count + int(self.timed.arcs.states_of[start])
                    yield _Arcs(*(np.array([value]) for value in (start, head, NONE, NONE, int(weights[start]))))

    def layered(self) -> TimedTour:
        """Build the graph."""
        base, spending = self.timed.graph, self.tour_graph.spending
        k, layers = base.graph.criteria, self.last + 1
        doing = f"the {layers} layers of the tour ({layers * self.count:,} nodes) were built"
        size = layers * (base.graph.arcs * (8 * k + ARC) + 8 * self.count)
        spending.check(doing, size + SCRATCH * layers * base.graph.arcs)
        spending.hold(size, doing)
        arcs = self._arcs()
        origins, is_move = np.maximum(arcs.origins, 0), arcs.origins != NONE
        stops = np.flatnonzero(arcs.stops != NONE)
        ticks, places = self._ticks[arcs.stops[stops]], base.place[arcs.tails[stops] % self.count]
        durations, costs = np.where(is_move, base.durations[origins], 1), base.graph.costs[origins]
        durations[stops] = ticks
        costs[~is_move] = 0
        for j, aggregate in enumerate(base.graph.aggregates):
            if j not in base.standing:  # else the search adds the costs of standing
                rate = base.rate[places, j]
                costs[stops, j] = rate if aggregate == "max" else rate * ticks >> RATE_BITS
        if self._missed is not None:
            costs[:, self._missed] += arcs.missed
        targets = np.array(self.goals, np.int64) + self.last * self.count
        rows = table_rows(self.timed, origins, np.isin(arcs.heads, targets))
        rows[~is_move] = NONE
        stays = is_move & base.stays[origins]
        stays[stops] = True
        indptr = np.searchsorted(arcs.tails, np.arange(layers * self.count + 1))
        heads = arcs.heads.astype(np.int32)
        timed = np.flatnonzero(rows != NONE)
        for array in (indptr, heads, costs):
            array.setflags(write=False)
        graph = TimedGraph(
            Graph.from_csr(indptr, heads, costs, aggregates=base.graph.aggregates),
            durations.astype(np.int32),
            base.horizon,
            timed=timed.astype(np.int32),
            rows=rows[timed].astype(np.int32),
            costs=base.costs,
            blocked=base.blocked,
            place=np.tile(base.place, layers),
            stays=stays,
            standing=base.standing,
            rate=base.rate,
            cut=base.cut,
            hold=base.hold,
            arrive_by=base.arrive_by,
        )
        of_arcs, of_stops = arcs.origins.astype(np.int32), arcs.stops.astype(np.int32)
        return TimedTour(self.timed, self.tour_graph, graph, targets.tolist(), of_arcs, of_stops, self.needed)


def table_rows(timed: GraphOnClock, origins: IntArray, ends: BoolArray) -> IntArray:
    """Return the row of each arc (c,) in the tables, given its arc in one layer; NONE for an arc without a row.

    ends  (c,)  whether paths end with the arc
    """
    base = timed.graph
    rows = np.full(base.graph.arcs, NONE)
    rows[base.timed] = base.rows
    last = rows.copy()
    last[list(timed.last_rows)] = list(timed.last_rows.values())
    return np.where(ends, last[origins], rows[origins])
