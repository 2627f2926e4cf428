"""Paths on a clock as plans: real times of their steps, tolerances of their costs, and trajectories.

A plan drives the motions of its path in their real durations, so it deviates from the clock. A hold lasts until the
time at which it ends on the clock, which removes the deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

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


@dataclass(frozen=True, eq=False)
class GraphOnClock:
    """A graph of states on a clock.

    graph            graph that is searched, with integer costs and times in ticks
    quanta           (k,)  smallest step of each cost, in the criterion's unit
    duration_column  column of the cost that is the duration, in ticks; None if the duration is no cost
    start            node at which plans begin
    arcs             motions of the graph's arcs
    clock            ticks and their length
    moving_people    the moving people of the world
    ramps            deviations of executions from plans; None if they are unknown
    hold             s  least duration of a hold; None: no holds
    overlooked       (k,)  largest neglected cost of people beyond the ranges of ``attention``: per second for sums, at
                     the worst moment for maxima
    pairs            number of computed costs, each of one arc or place at one tick
    seconds          s, time to build the graph
    safety           separation constraints for the moving people
    attention        ranges within which criteria notice people
    people_stop      whether people who would walk up to the start are predicted to stop before the robot
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
    people_stop: bool = False

    @property
    def counts(self) -> dict[str, Any]:
        """Sizes by name, for the statistics of a planner."""
        return {
            "ticks": self.graph.horizon,
            "timed_edges": int(self.graph.timed.size),
            "costs_by_time": self.pairs,
            "table_seconds": self.seconds,
        }


@dataclass(frozen=True, eq=False)
class GraphParts:
    """Parts of a graph that are reused each time that it is put on a clock.

    plain   arcs with the costs that do not depend on time (:func:`.presence.reading_time`)
    closed  (m,)  mask of closed arcs
    begin   earliest tick of departure from the start
    near    nodes within a person's margin where plans may begin, with times, s on the clock; the robot may leave there
    arcs    motions of the arcs from an earlier call; None if there was none
    """

    plain: Graph
    closed: BoolArray
    begin: int = 0
    near: tuple[tuple[int, float], ...] = ()
    arcs: TimedArcs | None = None


ARC, STOOD = 1, 2  # roundings: of an arc's cost one; of standing, a difference of two rounded costs, two

SAME = 1e-6  # of a tick


class StepTimes(NamedTuple):
    """Real times of the steps (s,) of a plan.

    times  (s + 1,)  s, beginnings of the steps, then the arrival
    off    (s + 1,)  s, delays against the clock
    late   (s + 1,)  s, largest further delays of an execution of the plan
    """

    times: FloatArray
    off: FloatArray
    late: FloatArray


@dataclass(frozen=True, eq=False)
class TimedPlans:
    """Plans on a graph with a clock.

    timed       the graph
    steps       steps of each plan
    begins      s, on the clock, real beginning of each plan
    late_start  s, delay of executions from the beginning on, for a robot that starts from rest
    """

    timed: GraphOnClock
    steps: Sequence[PathSteps]
    begins: float = 0.0
    late_start: float = 0.0

    @cached_property
    def driven(self) -> tuple[StepTimes, ...]:
        """Real times of the steps of each plan."""
        return tuple(self._driven(steps) for steps in self.steps)

    def _driven(self, steps: PathSteps) -> StepTimes:
        tick, durations = self.timed.clock.tick, self.timed.arcs.durations
        half = 0.0 if self.timed.ramps is None else self.timed.ramps.half
        times, late = np.full(steps.arcs.size + 1, self.begins), np.zeros(steps.arcs.size + 1)
        late[0] = self.late_start
        for i, arc in enumerate(steps.arcs.tolist()):
            if arc == HELD:
                times[i + 1] = max(times[i], steps.departures[i + 1] * tick)
                # stopping before a hold and starting after it take their halves of it
                late[i + 1] = max(0.0, late[i] + 2.0 * half - (times[i + 1] - times[i]))
            else:
                times[i + 1], late[i + 1] = times[i] + durations[arc], late[i]
        return StepTimes(times, times - steps.departures * tick, late)

    @cached_property
    def drift(self) -> FloatArray:
        """Largest deviation (n,), s, of each plan from the clock."""
        return np.array([float(np.abs(driven.off).max()) for driven in self.driven])

    @cached_property
    def late(self) -> FloatArray:
        """Largest delay (n,), s, of the execution of each plan against the clock."""
        return np.array([float((driven.off + driven.late).max()) for driven in self.driven])

    @cached_property
    def holds(self) -> IntArray:
        """Number (n,) of holds in each plan."""
        return np.array([int((steps.arcs == HELD).sum()) for steps in self.steps], dtype=np.int64)

    @property
    def lengths(self) -> IntArray:
        """Number (n,) of steps of each plan."""
        return np.array([steps.arcs.size for steps in self.steps], dtype=np.int64)

    def trajectories(self, rows: IntArray) -> tuple[Trajectory, ...]:
        """Return the trajectories of some plans, with holds among their motions."""
        space, states_of = self.timed.arcs.space, self.timed.arcs.states_of
        moved = [states_of[self.steps[i].nodes[np.append(True, self.steps[i].arcs != HELD)]] for i in rows.tolist()]
        plain = space.trajectories(moved)
        return tuple(
            self._held(self.steps[i], self.driven[i], trajectory)
            for i, trajectory in zip(rows.tolist(), plain, strict=True)
        )

    def _held(self, steps: PathSteps, driven: StepTimes, trajectory: Trajectory) -> Trajectory:
        """Insert the holds of a plan into its trajectory."""
        lasts = np.where(steps.arcs == HELD, np.diff(driven.times), 0.0)
        first = np.flatnonzero(steps.arcs != HELD)[:1]
        if self.timed.arcs.stands[steps.arcs[first]].any():  # two holds at the start are one
            lasts[0] += self.timed.arcs.half
        held = np.flatnonzero(lasts >= LEAST)
        motions = np.append(0, np.cumsum(self._motions(steps.arcs)))  # before each step
        return trajectory.with_holds(motions[held], lasts[held], punctual=True)

    def _motions(self, arcs: IntArray) -> IntArray:
        """Return the number (s,) of motions of each step, without holds."""
        moved = arcs != HELD
        counts = moved.astype(np.int64)
        space = self.timed.arcs.space
        if space.joins is not None:
            number = np.ones(self.timed.arcs.durations.size, np.int64)
            number[self.timed.arcs.joins] = np.sum(space.joins.present, axis=0)
            number[number.size - self.timed.arcs.copied.size :] = number[self.timed.arcs.copied]
            counts[moved] = number[arcs[moved]]
        return np.asarray(counts, dtype=np.int64)

    def tolerance(self, costs: IntArray) -> FloatArray:
        """Return the largest differences (n, k) of re-evaluated costs from costs (n, k) on the clock, in their units.

        The cost of each step is rounded. Its real cost lies between its least and its largest cost at the ticks from
        its planned to its real time. Costs of people too far away to be noticed may add up.
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
    """Least and largest costs of the steps of a plan, in quanta, between their planned and real times."""

    timed: GraphOnClock
    steps: PathSteps
    driven: StepTimes

    def bounds(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the least and the largest costs (k,) of the plan, and the number (k,) of roundings in each cost."""
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
        """Mark the steps (s,) with a cost that does not depend on time."""
        arcs = np.maximum(self.steps.arcs, 0)
        timed, stays = self.timed.graph.timed, self.timed.graph.stays
        row = np.minimum(np.searchsorted(timed, arcs), max(0, timed.size - 1))
        has_table = (timed[row] == arcs) if timed.size and j in self.timed.graph.costs else np.zeros(arcs.size, bool)
        stands = stays[arcs] & (j in self.timed.graph.standing)
        return ~(has_table | stands)

    def _of_arc(self, i: int, j: int) -> tuple[float, float]:
        """Return the least and the largest cost of an arc in one column."""
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
        """Return the first and last tick between the planned and the real beginning of a step."""
        real = self.driven.times[i] / self.timed.clock.tick
        planned = int(self.steps.departures[i])
        return min(planned, int(np.floor(real + SAME))), max(planned, int(np.ceil(real - SAME)))

    def _of_standing(self, i: int, j: int) -> tuple[float, float]:
        """Return the least and the largest cost of standing for a step, in one column."""
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
        """Return the cost of standing from tick 0 on."""
        graph = self.timed.graph
        rate = int(graph.rate[place, j])
        if j not in graph.standing:
            return float(rate * tick >> RATE_BITS)
        table = graph.standing[j][place]
        return float(int(table[min(tick, graph.horizon)]) + (rate * max(0, tick - graph.horizon) >> RATE_BITS))
