"""Convert paths of a search on a clock to plans: real times of their steps, tolerances of costs, and trajectories.

In the search, motions last whole ticks; in the plan, they have their real durations, so the plan deviates from the
clock. A hold lasts until the tick at which it ends in the search, which removes the deviation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import LEAST
from hpop.models.execution import Ramps
from hpop.planners.graphs.timed.clock import TickClock
from hpop.planners.graphs.timed.legs import TimedArcs
from hpop.planners.graphs.timed.notice import Attention, MovingPeople
from hpop.planners.graphs.timed.safety import Safety
from hpop.search import Graph
from hpop.search.timed.graph import HOLD as HELD
from hpop.search.timed.graph import RATE_BITS, PathSteps, TimedGraph
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.timed.tour_layers import TimedTour, TourSteps


@dataclass(frozen=True, eq=False)
class GraphOnClock:
    """Graph for a search in time steps, with everything that is needed to turn its paths into plans.

    graph            graph that is searched, with integer costs and times in ticks
    quanta           (k,)  value of one unit of each integer cost, in the criterion's unit
    duration_column  column of the cost that is the duration, in ticks; None if the duration is no cost
    start            node at which plans begin
    arcs             motions and durations of the graph's arcs
    clock            clock of the search
    moving_people    the moving people of the world
    ramps            deviations of executions from plans; None if they are unknown
    hold             s  shortest duration of a hold; None: no holds
    overlooked       (k,)  largest cost that is neglected because people are too far away: per second for criteria that
                     add up, at one moment for those that take the worst moment
    pairs            number of costs that were computed, each of one arc or place at one tick
    seconds          s, time to build this graph
    safety           distances that the robot must keep from moving people
    attention        distances within which criteria notice people
    earliest         (n,)  earliest tick at which the robot can be at each node
    people_stop      whether people who would walk into the robot at its start are predicted to stop before it
    last_rows        where paths may pass goals, as in a tour, some arcs to a goal have two rows in the tables: one for
                     paths that go on, and a second for paths that end with the arc. Number of the second row, by arc
    """

    graph: TimedGraph
    quanta: FloatArray
    duration_column: int | None
    start: int
    arcs: TimedArcs
    clock: TickClock
    moving_people: MovingPeople
    ramps: Ramps | None
    hold: float | None
    overlooked: FloatArray
    pairs: int
    seconds: float
    safety: Safety
    attention: Attention
    earliest: IntArray
    people_stop: bool = False
    last_rows: Mapping[int, int] = field(default_factory=dict)

    @property
    def counts(self) -> dict[str, Any]:
        """Numbers and seconds by name, for the statistics of a planner."""
        return {
            "ticks": self.graph.horizon,
            "timed_edges": int(self.graph.timed.size),
            "costs_by_time": self.pairs,
            "table_seconds": self.seconds,
        }


@dataclass(frozen=True, eq=False)
class GraphParts:
    """Parts of a graph that a drive reuses each time that predictions of people change.

    plain   search graph with the costs that do not depend on time (:func:`.presence.reading_time`)
    closed  (m,)  mask of arcs that may not be used
    begin   earliest tick of departure from the start
    near    nodes and times, s, at which a plan may begin although a person is within the margin; the robot may then
            leave
    arcs    motions of the arcs from an earlier call; None if there was none
    """

    plain: Graph
    closed: BoolArray
    begin: int = 0
    near: tuple[tuple[int, float], ...] = ()
    arcs: TimedArcs | None = None


ARC, STOOD = 1, 2  # rounding errors: one for the cost of an arc, two for standing, a difference of two rounded costs

SAME = 1e-6  # in ticks: rounding error of times


class StepTimes(NamedTuple):
    """Real times of a plan with s steps, and its delays.

    times  (s + 1,)  s, at which each step begins, then the arrival
    off    (s + 1,)  s, delay of the plan against the clock of the search; negative if it is early
    late   (s + 1,)  s, largest further delay of the robot that executes the plan
    """

    times: FloatArray
    off: FloatArray
    late: FloatArray


@dataclass(frozen=True, eq=False)
class TimedPlans:
    """Plans for n paths of a search on a clock.

    timed       graph that was searched
    steps       steps of each path: arcs and holds, with departure ticks
    begins      s, time on the clock at which all plans begin
    late_start  s, delay of the robot's execution from the beginning on, since it starts from rest
    tour        graph of the tour whose paths these are; None without a tour
    visits      steps of each path in the tour; () without a tour
    """

    timed: GraphOnClock
    steps: Sequence[PathSteps]
    begins: float = 0.0
    late_start: float = 0.0
    tour: TimedTour | None = None
    visits: Sequence[TourSteps] = ()

    @classmethod
    def of_tour(
        cls, tour: TimedTour, paths: Sequence[PathSteps], begins: float = 0.0, late_start: float = 0.0
    ) -> TimedPlans:
        """Return the plans for paths of a tour; for the parameters see the fields."""
        visits = [tour.steps(path) for path in paths]
        return cls(tour.timed, [visit.steps for visit in visits], begins, late_start, tour, visits)

    def take(self, rows: IntArray) -> TimedPlans:
        """Return the plans with the given indices."""
        steps, visits = ([column[i] for i in rows.tolist()] if column else () for column in (self.steps, self.visits))
        return replace(self, steps=steps, visits=visits)

    @cached_property
    def driven(self) -> tuple[StepTimes, ...]:
        """Real times and delays of the steps of each plan."""
        none = [np.zeros(steps.arcs.size) for steps in self.steps]
        least = [visit.least for visit in self.visits] or none
        return tuple(map(self._driven, self.steps, least))

    def _driven(self, steps: PathSteps, least: FloatArray) -> StepTimes:
        """Return the real times of steps; ``least`` (s,), s, has the shortest durations of visits, 0 for others."""
        tick, durations = self.timed.clock.tick, self.timed.arcs.durations
        half = 0.0 if self.timed.ramps is None else self.timed.ramps.half
        times, late = np.full(steps.arcs.size + 1, self.begins), np.zeros(steps.arcs.size + 1)
        late[0] = self.late_start
        for i, arc in enumerate(steps.arcs.tolist()):
            if arc == HELD:
                times[i + 1] = max(times[i] + least[i], steps.departures[i + 1] * tick)
                # stopping before a hold and starting after it take their halves of it
                late[i + 1] = max(0.0, late[i] + 2.0 * half - (times[i + 1] - times[i]))
            else:
                times[i + 1], late[i + 1] = times[i] + durations[arc], late[i]
        return StepTimes(times, times - steps.departures * tick, late)

    @cached_property
    def drift(self) -> FloatArray:
        """Largest deviation (n,), s, of each plan from the clock of the search, early or late."""
        return np.array([float(np.abs(driven.off).max()) for driven in self.driven])

    @cached_property
    def late(self) -> FloatArray:
        """Largest delay (n,), s, of the robot that executes each plan, against the clock of the search."""
        return np.array([float((driven.off + driven.late).max()) for driven in self.driven])

    @cached_property
    def holds(self) -> IntArray:
        """Number (n,) of holds in each plan."""
        return np.array([int((steps.arcs == HELD).sum()) for steps in self.steps], dtype=np.int64)

    @property
    def lengths(self) -> IntArray:
        """Number (n,) of steps of each plan, including holds."""
        return np.array([steps.arcs.size for steps in self.steps], dtype=np.int64)

    def trajectories(self, rows: IntArray) -> tuple[Trajectory, ...]:
        """Return the trajectories of the plans with the given indices, including their holds."""
        arcs = self.timed.arcs
        if self.tour is not None:
            plain = self.tour.moved([self.visits[i] for i in rows.tolist()])
        else:
            paths = [self.steps[i] for i in rows.tolist()]
            moved = [path.arcs != HELD for path in paths]
            plain = arcs.space.trajectories(
                [
                    arcs.through(arcs.states_of[path.nodes[np.append(True, own)]], path.arcs[own])
                    for path, own in zip(paths, moved, strict=True)
                ]
            )
        return tuple(
            self._held(self.steps[i], self.driven[i], trajectory)
            for i, trajectory in zip(rows.tolist(), plain, strict=True)
        )

    def _held(self, steps: PathSteps, driven: StepTimes, trajectory: Trajectory) -> Trajectory:
        """Return the trajectory of a plan with its holds inserted, from its steps, real times and motions."""
        lasts = np.where(steps.arcs == HELD, np.diff(driven.times), 0.0)
        first = np.flatnonzero(steps.arcs != HELD)[:1]
        if self.timed.arcs.stands[steps.arcs[first]].any():  # two holds at the start are one
            lasts[0] += self.timed.arcs.half
        held, driven_steps = np.flatnonzero(lasts >= LEAST), np.flatnonzero(steps.arcs != HELD)
        motions = np.append(0, np.cumsum(self._motions(steps.arcs)))  # before each step
        own, before, seconds = self.timed.arcs.pauses(steps.arcs[driven_steps])
        places = np.append(motions[held], motions[driven_steps[own]] + before)
        at, which = np.unique(places.astype(np.int64), return_inverse=True)  # a visit and waits about it are one hold
        together = np.bincount(which, np.append(lasts[held], seconds), minlength=at.size).astype(np.float64)
        return trajectory.with_holds(at, together, punctual=True)

    def _motions(self, arcs: IntArray) -> IntArray:
        """Return the number (s,) of motions in each step of a plan; 0 for holds.

        arcs  (s,)  arc of each step, HELD for a hold
        """
        moved = arcs != HELD
        counts = np.zeros(arcs.size, np.int64)
        counts[moved] = self.timed.arcs.motion_counts(arcs[moved])
        return counts

    def tolerance(self, costs: IntArray) -> FloatArray:
        """Return how much the re-evaluated costs of the plans may differ from their costs in the search, (n, k).

        Three errors add up. The cost of each step is rounded. Its real time may differ from its time in the search, so
        the real cost lies between the least and the largest cost at the ticks in between. The costs due to people who
        are too far away to be noticed are neglected.

        costs  (n, k)  costs in the search, in quanta; the result is in the criteria's units
        """
        off = np.zeros(costs.shape)
        for i, (steps, driven) in enumerate(zip(self.steps, self.driven, strict=True)):
            low, high, rounds = _Between(self.timed, steps, driven).bounds()
            if self.timed.duration_column is not None:
                rounds[self.timed.duration_column] = 0.0  # ticks are exact
            off[i] = np.maximum(high - costs[i], costs[i] - low)
            duration = driven.times[-1] - self.begins
            overlooked = np.where(self._worst, 1.0, duration) * self.timed.overlooked
            off[i] = (np.maximum(off[i], 0.0) + rounds) * self.timed.quanta + overlooked
            if self.timed.duration_column is not None:
                off[i, self.timed.duration_column] += abs(driven.off[-1] - driven.off[0])
        return off

    @property
    def _worst(self) -> BoolArray:
        return np.array([aggregate == "max" for aggregate in self.timed.graph.graph.aggregates])


@dataclass(frozen=True, eq=False)
class _Between:
    """Bounds on the costs of a plan whose steps happen between their times in the search and their real times."""

    timed: GraphOnClock
    steps: PathSteps
    driven: StepTimes

    def bounds(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the least costs (k,) and the largest costs (k,) of the plan, in quanta.

        Also returns the largest number (k,) of rounding errors that each cost contains.
        """
        graph = self.timed.graph.graph
        k = graph.criteria
        if not self.steps.arcs.size:
            return np.zeros(k), np.zeros(k), np.zeros(k)
        low, high = (np.zeros((self.steps.arcs.size, k)) for _ in range(2))
        moved = self.steps.arcs != HELD
        low[moved] = high[moved] = graph.costs[self.steps.arcs[moved]]
        for j in range(k):
            for i in np.flatnonzero(moved & ~self._static(j)).tolist():
                low[i, j], high[i, j] = self._of_arc(i, j)
            for i in np.flatnonzero(~moved).tolist():
                low[i, j], high[i, j] = self._of_standing(i, j)
        worst = np.array([aggregate == "max" for aggregate in graph.aggregates])
        stands = ~moved | self.timed.graph.stays[self.steps.arcs]
        by_time = np.isin(np.arange(k), list(self.timed.graph.standing))
        counts = np.where(~moved[:, None] | (stands[:, None] & by_time), STOOD, ARC) * (high > 0)
        rounds = np.where(worst, counts.max(axis=0), counts.sum(axis=0))
        least, most = (np.where(worst, each.max(axis=0), each.sum(axis=0)) for each in (low, high))
        return least, most, rounds

    def _static(self, j: int) -> BoolArray:
        """Return which steps (s,) have a cost in column j that does not depend on time."""
        arcs = np.maximum(self.steps.arcs, 0)
        timed, stays = self.timed.graph.timed, self.timed.graph.stays
        row = np.minimum(np.searchsorted(timed, arcs), max(0, timed.size - 1))
        has_table = (timed[row] == arcs) if timed.size and j in self.timed.graph.costs else np.zeros(arcs.size, bool)
        stands = stays[arcs] & (j in self.timed.graph.standing)
        return ~(has_table | stands)

    def _of_arc(self, i: int, j: int) -> tuple[float, float]:
        """Return the least and the largest cost in column j of step i, which drives along an arc."""
        graph, arc = self.timed.graph, int(self.steps.arcs[i])
        if graph.stays[arc]:
            low, high = self._of_standing(i, j)
            static = float(graph.graph.costs[arc, j])
            if graph.graph.aggregates[j] == "max":
                return max(static, low), max(static, high)
            return static + low, static + high
        row = int(np.searchsorted(graph.timed, arc))
        begin, end = self._ticks(i)
        table = graph.costs[j][row, min(begin, graph.horizon) : min(end, graph.horizon) + 1]
        return float(table.min()), float(table.max())

    def _ticks(self, i: int) -> tuple[int, int]:
        """Return the earlier and the later of two ticks at which step i begins: in the search, and in reality."""
        real = self.driven.times[i] / self.timed.clock.tick
        planned = int(self.steps.departures[i])
        return min(planned, int(np.floor(real + SAME))), max(planned, int(np.ceil(real - SAME)))

    def _of_standing(self, i: int, j: int) -> tuple[float, float]:
        """Return the least and the largest cost in column j of standing at a place during step i.

        The step may begin and end anywhere between its times in the search and its real times.
        """
        place = int(self.timed.graph.place[self.steps.nodes[i]])
        (first, begin), (end, last) = self._ticks(i), self._ticks(i + 1)
        if self.timed.graph.graph.aggregates[j] == "max":
            return self._worst(place, j, begin, end), self._worst(place, j, first, last)
        total = [self._total(place, j, tick) for tick in (first, begin, end, last)]
        return max(0.0, total[2] - total[1]), total[3] - total[0]

    def _worst(self, place: int, j: int, begin: int, end: int) -> float:
        graph = self.timed.graph
        if j not in graph.standing:
            return float(graph.rate[place, j])
        if begin >= end:
            return 0.0
        horizon = graph.horizon
        return float(graph.standing[j][place, min(begin, horizon) : min(end - 1, horizon) + 1].max())

    def _total(self, place: int, j: int, tick: int) -> float:
        """Return the cost in column j of standing at a place from tick 0 until a tick."""
        graph = self.timed.graph
        rate = int(graph.rate[place, j])
        if j not in graph.standing:
            return float(rate * tick >> RATE_BITS)
        table = graph.standing[j][place]
        return float(int(table[min(tick, graph.horizon)]) + (rate * max(0, tick - graph.horizon) >> RATE_BITS))
