"""Paths on a clock as plans: when the robot really is where, by how much costs may be off for that, and trajectories.

A plan drives the motions of its path, each for as long as it lasts in truth. So it comes to be off the clock; a hold
lasts until the clock says that it ends, which brings the plan back to it.
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
from hpop.motions import HOLD, States
from hpop.motions.laws import CLOCK
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

    graph       what a search takes
    quanta      (k,)  what one count of each cost is, in the criteria's units
    lasting     the column of the duration, which is counted in ticks; None if it is no cost
    start       node of the start, at which plans begin
    arcs        the same arcs as motions
    clock
    company     who moves
    ramps       by how much executions are off; None where that is not known
    hold        s  that the robot stands at least when it waits, or None
    overlooked  (k,)  by how much costs may differ in what is not noticed: a second, or at the worst moment
    pairs       how many costs of an arc or a place at a tick were reckoned
    seconds     s that making it took
    safety      what keeps the robot clear of people
    attention   what criteria said of them
    people_stop whether people who would walk up to the robot where it starts are taken to stop before it
    """

    graph: TimedGraph
    quanta: FloatArray
    lasting: int | None
    start: int
    arcs: TimedArcs
    clock: TickClock
    company: MovingPeople
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
        """How large it is, for the stats of a planner."""
        return {
            "ticks": self.graph.horizon,
            "timed_edges": int(self.graph.timed.size),
            "costs_by_time": self.pairs,
            "table_seconds": self.seconds,
        }


@dataclass(frozen=True, eq=False)
class GraphParts:
    """What is there of a graph already that is put on a clock again and again, while people change.

    plain   its arcs, and what they cost by those criteria that do not read the time (:func:`.reading.reading_time`)
    closed  (m,)  arcs that nobody takes
    begin   tick from which on the robot may be at the start
    near    nodes where plans may begin within somebody's margin, and when, s on the clock: the robot may leave there
    arcs    as they were timed before; None if never
    """

    plain: Graph
    closed: BoolArray
    begin: int = 0
    near: tuple[tuple[int, float], ...] = ()
    arcs: TimedArcs | None = None


ARC, STOOD = 1, 2  # counts: an arc's cost is rounded, and what it is compared with; standing is a difference of such

SAME = 1e-6  # of a tick


class StepTimes(NamedTuple):
    """When the steps (s,) of a plan really happen.

    times  (s + 1,)  s, at which each begins; the last is the arrival
    off    (s + 1,)  s, by how much that is later than the clock says
    late   (s + 1,)  s, by how much an execution of the plan may be later still
    """

    times: FloatArray
    off: FloatArray
    late: FloatArray


@dataclass(frozen=True, eq=False)
class TimedPlans:
    """Plans of a graph on a clock.

    timed
    steps   of each
    begins  s, on the clock, when they really begin
    late_start  s, by how much executions are later from the beginning on: of a robot that is at rest there
    """

    timed: GraphOnClock
    steps: Sequence[PathSteps]
    begins: float = 0.0
    late_start: float = 0.0

    @cached_property
    def driven(self) -> tuple[StepTimes, ...]:
        """When the steps of each really happen."""
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
        """By how much (n,), s, each plan is off the clock at most."""
        return np.array([float(np.abs(driven.off).max()) for driven in self.driven])

    @cached_property
    def late(self) -> FloatArray:
        """By how much (n,), s, the execution of each plan is later than the clock at most."""
        return np.array([float((driven.off + driven.late).max()) for driven in self.driven])

    @cached_property
    def holds(self) -> IntArray:
        """How often (n,) each plan holds."""
        return np.array([int((steps.arcs == HELD).sum()) for steps in self.steps], dtype=np.int64)

    @property
    def lengths(self) -> IntArray:
        """Steps (n,) of each."""
        return np.array([steps.arcs.size for steps in self.steps], dtype=np.int64)

    def trajectories(self, rows: IntArray) -> tuple[Trajectory, ...]:
        """The trajectories of some plans, holds among their motions."""
        space, states_of = self.timed.arcs.space, self.timed.arcs.states_of
        moved = [states_of[self.steps[i].nodes[np.append(True, self.steps[i].arcs != HELD)]] for i in rows.tolist()]
        plain = space.trajectories(moved)
        return tuple(
            self._held(self.steps[i], self.driven[i], trajectory)
            for i, trajectory in zip(rows.tolist(), plain, strict=True)
        )

    def _held(self, steps: PathSteps, driven: StepTimes, trajectory: Trajectory) -> Trajectory:
        """A trajectory with the holds of its plan."""
        lasts = np.where(steps.arcs == HELD, np.diff(driven.times), 0.0)
        first = np.flatnonzero(steps.arcs != HELD)[:1]
        if self.timed.arcs.stands[steps.arcs[first]].any():  # of two holds at the start it is one
            lasts[0] += self.timed.arcs.half
        held = np.flatnonzero(lasts >= LEAST)
        lasts = lasts[held]
        if not held.size:
            return Trajectory.of_checked(trajectory.model, trajectory.states, trajectory.kinds, punctual=True)
        motions = np.append(0, np.cumsum(self._motions(steps.arcs)))  # before each step
        at = motions[held]  # the states, of the trajectory, at which it holds
        columns = {name: np.insert(column, at + 1, column[at]) for name, column in trajectory.states.__dict__.items()}
        columns[CLOCK] = np.zeros(len(trajectory) + 1 + at.size)
        columns[CLOCK][at + 1 + np.arange(at.size)] = lasts
        columns[CLOCK] = np.cumsum(columns[CLOCK])
        kinds = np.insert(np.array(trajectory.kinds, dtype=object), at, HOLD.kind)
        return Trajectory(trajectory.model, States(**columns), tuple(kinds.tolist()), punctual=True)

    def _motions(self, arcs: IntArray) -> IntArray:
        """Motions (s,) of which steps are made, besides holds."""
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
        """By how much (n, k) re-evaluated costs may differ from costs (n, k) on the clock, in the criteria's units.

        Each step that costs anything is rounded. Besides, what it costs when it really happens lies between the least
        and the largest that it costs at the ticks from when it is planned to then; what is not noticed may add up.
        """
        off = np.zeros(costs.shape)
        for i, (steps, driven) in enumerate(zip(self.steps, self.driven, strict=True)):
            low, high, rounds = _Between(self.timed, steps, driven).bounds()
            if self.timed.lasting is not None:
                rounds[self.timed.lasting] = 0.0  # ticks are what the clock says
            off[i] = np.maximum(high - costs[i], costs[i] - low)
            duration = driven.times[-1] - self.begins
            overlooked = np.where(self._worst, 1.0, duration) * self.timed.overlooked
            off[i] = (np.maximum(off[i], 0.0) + rounds) * self.timed.quanta + overlooked
            if self.timed.lasting is not None:
                off[i, self.timed.lasting] += abs(driven.off[-1] - driven.off[0])
        return off

    @property
    def _worst(self) -> BoolArray:
        return np.array([aggregate == "max" for aggregate in self.timed.graph.graph.aggregates])


@dataclass(frozen=True, eq=False)
class _Between:
    """What the steps of a plan cost at least and at most, in counts, at the ticks about when they really happen."""

    timed: GraphOnClock
    steps: PathSteps
    driven: StepTimes

    def bounds(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the whole (k,), the least and the largest, and how many costs in them are rounded."""
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
        """Which steps (s,) are arcs that cost the same at any time."""
        arcs = np.maximum(self.steps.arcs, 0)
        timed, stays = self.timed.graph.timed, self.timed.graph.stays
        row = np.minimum(np.searchsorted(timed, arcs), max(0, timed.size - 1))
        has_table = (timed[row] == arcs) if timed.size and j in self.timed.graph.costs else np.zeros(arcs.size, bool)
        stands = stays[arcs] & (j in self.timed.graph.standing)
        return ~(has_table | stands)

    def _of_arc(self, i: int, j: int) -> tuple[float, float]:
        """What an arc costs in one column, at least and at most."""
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
        """The first and the last tick of those from when a step is planned to begin to when it really does."""
        real = self.driven.times[i] / self.timed.clock.tick
        planned = int(self.steps.departures[i])
        return min(planned, int(np.floor(real + SAME))), max(planned, int(np.ceil(real - SAME)))

    def _of_standing(self, i: int, j: int) -> tuple[float, float]:
        """What standing for a step costs in one column, at least and at most."""
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
        """What standing from tick 0 on costs."""
        graph = self.timed.graph
        rate = int(graph.rate[place, j])
        if j not in graph.standing:
            return float(rate * tick >> RATE_BITS)
        table = graph.standing[j][place]
        return float(int(table[min(tick, graph.horizon)]) + (rate * max(0, tick - graph.horizon) >> RATE_BITS))
