"""Build the graph for a search in time steps, from a graph of states and the predictions of moving people.

A tick is the unit of time of the search. A place is a position of the graph, or a single state if costs of standing
depend on the heading. A person is noticed at a place if the cost of some criterion there differs because of this
person.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import DEFAULT_QUANTUM, Criterion, index_of_role, make_criterion
from hpop.errors import OptionError
from hpop.models.execution import Ramps, clearance_radius
from hpop.motions import States
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.clock import SLACK, TickClock, TimeOptions
from hpop.planners.graphs.timed.legs import TimedArcs, arrivals
from hpop.planners.graphs.timed.notice import Attention, CriterionProbe, MovingPeople
from hpop.planners.graphs.timed.plans import GraphOnClock, GraphParts
from hpop.planners.graphs.timed.presence import (
    Presence,
    alike_at_places,
    reading_time,
    standing_rates,
    turn_as_they_stand,
)
from hpop.planners.graphs.timed.safety import Safety, Start
from hpop.planners.graphs.timed.tables import TimedCosts
from hpop.planners.graphs.trajectory_graph import aggregates
from hpop.planners.objectives import WHOLE
from hpop.search import Graph
from hpop.search.timed.graph import MAX_TICKS, RATE, TimedGraph
from hpop.world.content.predictions import yielding

NEVER = 2**31 - 1  # tick of a node that cannot be reached
ON_CLOCK = "costs and blocked edges were computed for each time step"
MOTION = 110  # bytes of memory for a motion of an arc, with its place, duration and costs


def timed_graph(
    space: StateGraph | JoinedEnds,
    criteria: Sequence[Criterion],
    start: int,
    goals: Sequence[int],
    options: TimeOptions,
    quanta: Collection[str] = (),
    laid: GraphParts | None = None,
    attention: Attention | None = None,
    *,
    people_stop: bool = False,
    passes_goals: bool = False,
) -> GraphOnClock:
    """Convert a graph of states to a graph for a search in time steps, with costs and blocked arcs for each tick.

    Raises Exhausted if a limit is passed, QueryError if the robot would start in contact with a moving person, and
    OptionError if people move for more ticks than a search can count.

    Parameters
    ----------
    quanta : names of the criteria for which the problem sets a quantum
    laid : parts of an earlier graph that can be used again, if any
    attention : distances within which criteria notice people, if they were measured for the same problem before
    people_stop : whether people who would walk into the robot at its start are predicted to stop before it; costs near
        them are computed as if they did not stop
    passes_goals : whether paths may also pass a goal without ending there, as in a tour. Arcs to a goal then have a
        second row in the tables, for paths that end with them (:attr:`.GraphOnClock.last_rows`)
    """
    began = time.perf_counter()
    query = space, tuple(criteria), start, tuple(goals), options, frozenset(quanta)
    return _Assembly(*query, laid, attention, people_stop, passes_goals).assembled(began)


@dataclass(frozen=True, eq=False)
class _Assembly:
    """Intermediate results of :func:`timed_graph`, each computed when it is first used.

    The fields are the arguments of that function.
    """

    space: StateGraph | JoinedEnds
    criteria: tuple[Criterion, ...]
    start: int
    goals: tuple[int, ...]
    options: TimeOptions
    quanta: frozenset[str]
    laid: GraphParts | None
    known_attention: Attention | None
    people_stop: bool = False
    passes_goals: bool = False

    @cached_property
    def clock(self) -> TickClock:
        return TickClock(self.options.tick)

    @cached_property
    def arcs(self) -> TimedArcs:
        if self.laid is not None and self.laid.arcs is not None:
            return self.laid.arcs.costed_on(self.space)
        return TimedArcs.of(self.space, self.clock, self.start, 0.0 if self.laid is not None else self.ramps.half)

    @cached_property
    def moving_people(self) -> MovingPeople:
        return MovingPeople.of(self.space.world)

    @cached_property
    def horizon(self) -> int:
        """Tick after which no cost and no blocked arc changes any more; at most the tick after ``arrive_by``."""
        settled, arrive_by = self.safety.settled(self.moving_people.settled), self.options.arrive_by
        last = settled + SLACK  # until then a person may be in the way of a plan that deviates from the clock
        last = last if arrive_by is None else min(last, arrive_by)
        if not last / self.clock.tick + 2 < MAX_TICKS:
            raise OptionError(
                f"people must move for less than {MAX_TICKS:,} time steps of {self.clock.tick:g} s, got {settled:,.0f} "
                "s; set horizon of the problem, until= of the people, or arrive_by or a larger clock of the planner"
            )
        return self.clock.up_to(last) + 1

    @cached_property
    def ramps(self) -> Ramps:
        """Deviations of the robot from its plans, since it speeds up and slows down; 0 if the model states none.

        Then each execution is checked later.
        """
        return Ramps.of(self.space.model) or Ramps(0.0, 0.0)

    @property
    def begin(self) -> int:
        """Node at which plans begin."""
        return self.arcs.begin if self.arcs.copied.size else self.start

    @property
    def hold(self) -> float | None:
        """Shortest duration of a wait, s: the option ``hold``, but at least the time to stop and start again.

        None if the robot never waits.
        """
        return None if self.options.hold is None else max(self.options.hold, 2.0 * self.ramps.half)

    @cached_property
    def timed(self) -> list[int]:
        """Indices of the criteria that depend on time."""
        return reading_time(self.criteria, self.space)

    @cached_property
    def static(self) -> list[int]:
        """Indices of the criteria that do not depend on time."""
        return [j for j in range(len(self.criteria)) if j not in self.timed]

    @cached_property
    def attention(self) -> Attention:
        known, timed = self.known_attention, self.criteria_of(self.timed)
        if known is not None and [probe.criterion for probe in known.probes] == timed:
            return known
        model = self.arcs.inner.model
        return Attention.of(
            self.moving_people,
            [CriterionProbe(self.criteria[j], self.moving_people, model, self._is_set(j)) for j in self.timed],
        )

    def _is_set(self, j: int) -> bool:
        """Return whether the problem or the criterion itself has set the quantum of criterion j."""
        return self.criteria[j].name in self.quanta or self.criteria[j].quantum != DEFAULT_QUANTUM

    @cached_property
    def cost_quanta(self) -> FloatArray:
        """Quanta (k,) of the costs in this search, in the criteria's units; that of the duration is a tick, in s."""
        quanta = np.array([criterion.quantum for criterion in self.criteria])
        quanta[self.timed] = [probe.quantum for probe in self.attention.probes]
        if self.duration_column is not None:
            quanta[self.duration_column] = self.clock.tick
        return quanta

    @cached_property
    def duration_column(self) -> int | None:
        """Index of the criterion that is the duration; None if it is not among the criteria."""
        return index_of_role("duration", self.criteria)

    def criteria_of(self, columns: Sequence[int]) -> list[Criterion]:
        return [self.criteria[j] for j in columns]

    @cached_property
    def plain(self) -> Graph:
        """Search graph with the costs that do not depend on time; if there are none, with the duration."""
        if self.laid is not None:
            return self.laid.plain
        return self.arcs.with_copies(self.space.graph(self.criteria_of(self.static) or [make_criterion("duration")]))

    @cached_property
    def closed(self) -> BoolArray:
        """Mask (m,) of the arcs that may not be used."""
        return np.zeros(self.plain.arcs, dtype=bool) if self.laid is None else self.laid.closed

    @cached_property
    def safety(self) -> Safety:
        model, spending = self.arcs.inner.model, self.space.spending
        people = self.moving_people.people
        if self.people_stop:
            (start, *_), reach = self.starts, clearance_radius(model, self.options.margin)
            people = tuple(yielding(person, (start.x, start.y), reach, start.time) for person in people)
        return Safety.of(self.moving_people, model, self.options, self.starts, spending, people, self.arcs.inner.bends)

    @cached_property
    def starts(self) -> tuple[Start, ...]:
        """Positions and times at which plans may begin, even if a person is near; the robot may then leave."""
        begins = ((self.begin, 0.0),) if self.laid is None else self.laid.near
        at = self.arcs.space.states(self.arcs.states_of[[node for node, _ in begins]])
        times = [time for _, time in begins]
        return tuple(map(Start, at.x.tolist(), at.y.tolist(), np.nan_to_num(at.yaw).tolist(), times))

    @cached_property
    def presence(self) -> Presence:
        """Places and ticks at which people are noticed, so that costs depend on time."""
        states = self.arcs.states
        return Presence(self.moving_people, self.attention.notices, self.clock, self.horizon, states.x, states.y)

    @cached_property
    def rates(self) -> FloatArray:
        """Costs of standing for a tick in each state: n rows, and a column for each criterion of ``static``."""
        return standing_rates(self.criteria_of(self.static), self.space, self.clock.tick)

    @cached_property
    def headed(self) -> bool:
        """True if costs of standing depend on the heading, so that each state is treated as a place of its own."""
        if not alike_at_places(self.rates, self.arcs.place[: self.space.size]).all():
            return True
        return not turn_as_they_stand(self.criteria_of(self.timed), self.arcs, self.presence).all()

    @cached_property
    def place(self) -> IntArray:
        """Number (n,) of the place of each node."""
        return self.arcs.states_of if self.headed else self.arcs.place

    @cached_property
    def states(self) -> States:
        """A state for each place (P,), in which costs of standing are evaluated."""
        if not self.headed:
            return self.arcs.states
        states = self.space.states(np.arange(self.space.size))
        return States(**{name: np.nan_to_num(column) for name, column in states.__dict__.items()})

    @cached_property
    def stays(self) -> BoolArray:
        """Mask (m,) of the turns that people affect as they affect standing at the place.

        Their time-dependent costs are those of standing, and they are blocked at ticks at which the robot must not
        stand there.
        """
        stays = self.arcs.stays & ~self.closed
        if self.headed:
            stays[:] = False
        elif self.safety.about_start:  # the robot may turn there to leave
            nodes = [self.begin] if self.laid is None else [node for node, _ in self.laid.near]
            stays[np.isin(self.arcs.place[self.arcs.tails], self.arcs.place[nodes])] = False
        return stays

    @cached_property
    def earliest(self) -> IntArray:
        """Earliest tick (n,) at which the robot can be at each node."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import dijkstra

        plain, ticks = self.plain, self.arcs.ticks.astype(np.float64)
        network: Any = csr_array((ticks, plain.heads, plain.indptr), shape=(plain.nodes,) * 2)
        ticks_to = dijkstra(network, indices=np.array([self.begin]))[0]
        begin = 0 if self.laid is None else self.laid.begin
        return np.where(np.isfinite(ticks_to), ticks_to + begin, NEVER).astype(np.int64)

    def assembled(self, began: float) -> GraphOnClock:
        """Build the graph; ``began`` is the value of :func:`time.perf_counter` at the beginning, for statistics."""
        if self.laid is None:
            self.safety.refuse_contact()
        arcs, place, states, options = self.arcs, self.place, self.states, self.options
        rows = np.flatnonzero(~self.stays)
        motions = rows.size * MOTION
        self.space.spending.hold(motions, "the motions of its edges were listed")
        legs, tails = arcs.legs(rows), arcs.tails[rows]
        first = int(np.searchsorted(rows, arcs.tails.size - arcs.copied.size))
        ends = np.isin(self.plain.heads[rows], self.goals)
        ending = arrivals(legs, ends, arcs.durations[rows], self.ramps.half)
        blocked = self.safety.blocked(legs if self.passes_goals else [*legs, *ending], first, self.horizon)
        blocked_at_goals = self.safety.blocked(ending if self.passes_goals else [], first, self.horizon)
        wanted = self.closed[rows]
        wanted[blocked.rows] = wanted[blocked_at_goals.rows] = True
        presence = replace(self.presence, x=states.x, y=states.y) if self.headed else self.presence
        tables = TimedCosts(
            arcs.inner, presence, self.criteria_of(self.timed), self.cost_quanta[self.timed], self.space.spending
        )
        made = tables.arcs(legs, place[tails], arcs.durations[rows], self.earliest[tails], wanted)
        flags = (made.rows.size + states.size) * (self.horizon + 1)  # blocked arcs, and cut places
        self.space.spending.hold(flags + self.plain.arcs * 8 * len(self.criteria), ON_CLOCK)
        closed = np.zeros((made.rows.size, self.horizon + 1), dtype=bool)
        closed[np.searchsorted(made.rows, blocked.rows)] = blocked.table
        closed[self.closed[rows[made.rows]]] = True
        last = np.searchsorted(made.rows, blocked_at_goals.rows)  # rows that are repeated for paths that end there
        tables_of_arcs = {j: _with_rows(made.costs, at, last) for at, j in enumerate(self.timed)}
        if last.size:
            closed = np.concatenate([closed, closed[last] | blocked_at_goals.table])
        soonest = np.full(states.size, NEVER)
        np.minimum.at(soonest, place, self.earliest)
        stood = tables.standing(states, soonest)

        costs = np.zeros((self.plain.arcs, len(self.criteria)), np.int64)
        rate = np.zeros((states.size, len(self.criteria)))
        node = np.unique(place, return_index=True)[1]
        for column, j in enumerate(self.static):
            costs[:, j] = self.plain.costs[:, column]
            rate[:, j] = self.rates[node, column] / self.cost_quanta[j]
            self._stand(costs[:, j], rate[place[self.begin], j], self.criteria[j].aggregate == "max")
        if self.duration_column is not None:  # the arrival on the clock; deviations are part of the tolerance
            costs[:, self.duration_column], rate[:, self.duration_column] = arcs.ticks, 1.0
        for column, j in enumerate(self.timed):
            costs[rows, j] = made.static[:, column]
            rate[:, j] = stood.rates[:, column]
        worst = np.array([criterion.aggregate == "max" for criterion in self.criteria])
        graph = TimedGraph(
            Graph.from_csr(self.plain.indptr, self.plain.heads, _frozen(costs), aggregates=aggregates(self.criteria)),
            arcs.ticks.astype(np.int32),
            self.horizon,
            timed=rows[made.rows].astype(np.int32),
            rows=np.arange(made.rows.size, dtype=np.int32),
            costs=tables_of_arcs,
            blocked=_frozen(closed),
            place=place.astype(np.int32),
            stays=_frozen(self.stays),
            standing={j: _frozen(table) for j, table in zip(self.timed, stood.tables, strict=True)},
            rate=np.where(worst, np.ceil(rate - WHOLE), np.rint(rate * RATE)).astype(np.int64),
            cut=_frozen(self._cut(states)),
            hold=None if self.hold is None else max(1, self.clock.up_to(self.hold)),
            arrive_by=None if options.arrive_by is None else self.clock.within(options.arrive_by),
        )
        self.space.spending.release(motions)
        overlooked = np.zeros(len(self.criteria))
        overlooked[self.timed] = self.attention.notices.overlooked
        pairs, seconds = made.pairs + stood.pairs, time.perf_counter() - began
        return GraphOnClock(
            graph,
            self.cost_quanta,
            self.duration_column,
            self.begin,
            arcs,
            self.clock,
            self.moving_people,
            Ramps.of(arcs.inner.model),
            self.hold,
            overlooked,
            pairs,
            seconds,
            self.safety,
            self.attention,
            self.earliest,
            self.people_stop,
            dict(zip(rows[blocked_at_goals.rows].tolist(), range(made.rows.size, len(closed)), strict=True)),
        )

    def _cut(self, states: States) -> BoolArray:
        """Return at which ticks the robot must not stand at places, as a mask (P, H + 1).

        It must not stand near people, and never at a place whose nodes have a speed, where it can only drive on.
        """
        cut = self.safety.cut(states.x, states.y, self.horizon, None if self.arcs.inner.turns_in_place else states.yaw)
        driving = ~self.space.at_rest(np.arange(self.space.size))
        cut[self.place[: self.space.size][driving]] = True
        return cut

    def _stand(self, costs: IntArray, rate: float, worst: bool) -> None:
        """Add the cost of standing before the first move to the costs (m,) of those arcs that include it.

        costs  (m,)  in quanta; changed in place
        rate   cost of standing at the start, per tick
        worst  whether the criterion takes the worst moment
        """
        stands = self.arcs.stands
        if worst:
            costs[stands] = np.maximum(costs[stands], math.ceil(rate - WHOLE))
        else:
            costs[stands] += round(rate * self.arcs.half / self.clock.tick)


def _with_rows(tables: list[Any], at: int, rows: IntArray) -> Any:
    """Return a table, read-only, with copies of some rows appended; it is taken from the list, to free its memory."""
    table, tables[at] = tables[at], None
    return _frozen(np.concatenate([table, table[rows]]) if rows.size else table)


def _frozen(array: Any) -> Any:
    array.setflags(write=False)
    return array
