"""Planning among moving people: graphs searched in time steps, with costs and blocked arcs that depend on the time.

The query is here: the search in time steps, its plans, and text about time for certificates and notes.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.base.text import some
from hpop.errors import QueryError
from hpop.models.execution import clearance_radius
from hpop.planners.graphs.assemble import ROUNDED, Plans
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import SLACK, TimeOptions
from hpop.planners.graphs.timed.notice import Attention
from hpop.planners.graphs.timed.plans import GraphOnClock, TimedPlans
from hpop.planners.graphs.timed.safety import Start
from hpop.planners.graphs.timed.tour_layers import TimedTour, timed_tour
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Limits
from hpop.runtime.limits import Budget, Status, within
from hpop.search import pareto_paths
from hpop.search.timed.graph import TimedPaths
from hpop.search.timed.timed_paths import timed_paths
from hpop.trajectories.contacts import contact
from hpop.world.content.people import Person
from hpop.world.content.predictions import taken_to_stop, with_stops, yielding

if TYPE_CHECKING:
    from hpop.planners.graphs.family import BuiltGraph
    from hpop.planners.graphs.joined_ends import JoinedEnds
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.problems.problem import Problem

UNREACTING = "people are assumed to do as predicted, whatever the robot does"  # part of each certificate


@dataclass(frozen=True, eq=False)
class Timing:
    """The part of a query that concerns time: graph with a clock, people, and departure.

    timed       graph for the search in time steps
    start       node at which plans begin: the query's start, or an extra node where the robot first stands for a moment
    options     options for planning among moving people
    people      all people, as predicted from the departure on
    begins      s, time of the departure on the clock
    late_start  s, delay of the robot against its plan at the departure
    tour        graph of the tour on the clock, of which ``timed`` is one layer; None without a tour
    """

    timed: GraphOnClock
    start: int
    options: TimeOptions
    people: Sequence[Person]
    begins: float = 0.0
    late_start: float = 0.0
    tour: TimedTour | None = None

    # The search

    def paths(self, query: Query, limits: Limits, eps: float, slack: IntArray) -> TimedPaths:
        """Run the exact search in time steps and return all non-dominated paths, or those found before a limit.

        With ``eps`` or ``slack`` (k,), in quanta of the criteria, fewer paths may be returned. If no limit ends the
        search: for each non-dominated cost vector p, the cost vector of a returned path is at most (1 + eps) p + slack.
        """
        quanta = np.array([criterion.quantum for criterion in query.objectives.optimised])
        counts = np.floor(slack * (quanta / self.timed.quanta) + 1e-9).astype(np.int64)
        return timed_paths(
            self.timed.graph if self.tour is None else self.tour.graph,
            self.start,
            [*query.goals, self.start] if query.start in query.goals else query.goals,
            budget=limits,
            progress=limits.progress,
            eps=eps,
            tolerance=counts.tolist(),
            at_most=query.at_most(),
            checkpoint=limits.checkpoint,
        )

    # In words

    @property
    def words(self) -> str:
        """Description of the clock, the predictions and the options for time, for certificates."""
        parts = [f"on a clock of {self.options.tick:g} s"]
        hold, ramps = self.timed.hold, self.timed.ramps
        if self.tour is not None and ramps is not None and ramps.half > 0.0 and (self.tour.needed > 0.0).any():
            parts.append(f"standing {2.0 * ramps.half:g} s longer than the dwell at each stop, to stop and start")
        parts.append("without holds" if hold is None else f"with holds of at least {hold:g} s")
        moving = self.timed.moving_people
        people = "1 person who moves" if len(moving.people) == 1 else f"{len(moving.people)} people who move"
        parts.append(f"for the predictions of {people}, the last of which ends after {moving.settled:.3g} s")
        if self.options.margin:
            parts.append(f"{self.options.margin:g} m clear of them")
        if self.options.arrive_by is not None:
            parts.append(f"arriving within {self.options.arrive_by:g} s")
        return ", ".join(parts)

    def rounded(self, objectives: Objectives) -> str:
        """Return the part of a certificate that says how costs are rounded."""
        own = zip(objectives.optimised, self.timed.quanta.tolist(), strict=True)
        steps = [f"{c.name} {step:g} {c.unit}".removesuffix(" 1") for c, step in own if step != c.quantum]
        return f"{ROUNDED}, on the clock those of {', '.join(steps)}" if steps else ROUNDED

    @property
    def _executed(self) -> str:
        """Part of a certificate: how far the robot deviates from its plans when it executes them."""
        ramps = self.timed.ramps
        if ramps is None:
            return "and each was checked as the robot executes it"
        return f"and the robot, when it executes them, off its planned positions by at most {ramps.stray:.2g} m"

    # Plans

    def plans(self, paths: TimedPaths, common: Mapping[str, Any]) -> Plans:
        """Convert the paths of a search to trajectories with holds, costs, tolerances and provenance.

        Paths on which the robot, when it executes them, would come too near to people are left out.
        """
        steps = [paths.steps(i) for i in range(len(paths))]
        if self.tour is not None:
            every = TimedPlans.of_tour(self.tour, steps, self.begins, self.late_start)
        else:
            every = TimedPlans(self.timed, steps, self.begins, self.late_start)
        contacts = self._contacts(every)
        kept = np.array([i for i, fault in enumerate(contacts) if not fault], dtype=np.int64)
        plans, costs, claim = every.take(kept), paths.costs[kept], ""
        if kept.size < len(paths):
            claim = f", without {len(paths) - kept.size} on which the robot comes too near to people"
        drift = float(plans.drift.max(initial=0.0))
        if kept.size:
            claim += f"; times of plans are off the clock by at most {drift:.2g} s, {self._executed}; {UNREACTING}"
        shared = {**common, **self.options.described}
        if self.stopping:
            shared["people_who_stop"] = self.stopping
        own = zip(plans.lengths.tolist(), plans.holds.tolist(), plans.drift.tolist(), strict=True)
        return Plans(
            planned=costs * self.timed.quanta,
            tolerance=plans.tolerance(costs),
            trajectories=plans.trajectories,
            provenance=tuple(
                {**shared, "edges": steps - holds, "holds": holds, "drift": round(off, 6)} for steps, holds, off in own
            ),
            claim=claim,
            notes=(*self._touching, *self._stopping, *(self._none_left(contacts) if not kept.size else ())),
            stats=self.timed.counts,
        )

    def _contacts(self, plans: TimedPlans) -> list[str]:
        """Return, as text, how each plan comes too near to people; "" if it does not.

        Only plans are checked for which the search does not guarantee the distance already.
        """
        contacts = [""] * len(plans.steps)
        doubtful: BoolArray = (plans.drift > SLACK) | (plans.late > SLACK)
        if self.timed.ramps is None or self.timed.safety.about_start:
            doubtful[:] = True
        rows = np.flatnonzero(doubtful)
        parts = self.timed.arcs.inner.model.platform
        people = with_stops(self.people, self.stopping, *self._at_start)
        for i, trajectory in zip(rows.tolist(), plans.trajectories(rows), strict=True):
            faults = (contact(parts, people, way, self.options.margin) for way in (trajectory, trajectory.execution()))
            contacts[i] = next(filter(None, faults), "")
        return contacts

    def _none_left(self, contacts: Sequence[str]) -> Iterator[str]:
        """Yield a note if the search found plans, but all of them come too near to people.

        contacts  how each plan does so, as text
        """
        if contacts:
            margin = "give a smaller margin, or " if self.options.margin > 0 else ""
            yield (
                f"{len(contacts)} plans were found, but in each the robot comes too near to people; for example, one "
                f"that {contacts[0]}; {margin}choose another start or goal, or plan again later"
            )

    # The departure

    @property
    def departure(self) -> Start:
        """Position, heading and time at which plans begin."""
        arcs = self.timed.arcs
        at = arcs.space.states(arcs.states_of[[self.start % arcs.states_of.size]])  # in a tour, of any layer
        return Start(float(at.x[0]), float(at.y[0]), float(np.nan_to_num(at.yaw[0])), self.begins)

    @property
    def _at_start(self) -> tuple[tuple[float, float], float]:
        """Position, m, at which plans begin, and the radius, m, of the circle that the robot needs there."""
        model, start = self.timed.arcs.inner.model, self.departure
        return (start.x, start.y), clearance_radius(model, self.options.margin)

    @property
    def _touching(self) -> tuple[str, ...]:
        """Notes that name the people who are in contact with the robot at its start, for the user."""
        touched = self.timed.safety.touched
        each = [[p for p in touched if bool(p.spread or p.growth) is uncertain] for uncertain in (False, True)]
        begins = "the robot starts in contact with", "the robot starts with a chance above 5 % of contact with"
        leaves = "it may only move so that the gap between them does not shrink"
        return tuple(
            f"{begin} {some([*dict.fromkeys(person.name or 'a person' for person in people)])}; {leaves}"
            for begin, people in zip(begins, each, strict=True)
            if people
        )

    @cached_property
    def stopping(self) -> list[int]:
        """Indices of the people who are predicted to stop in front of the robot at its start."""
        if not self.timed.people_stop:
            return []
        place, reach = self._at_start
        moving = self.timed.moving_people.moving
        return [i for i in moving if yielding(self.people[i], place, reach) is not self.people[i]]

    @property
    def _stopping(self) -> tuple[str, ...]:
        """A note, for the user, that names the people who are predicted to stop in front of the robot; () for none."""
        return (taken_to_stop(self.people, self.stopping),) if self.stopping else ()

    def is_open_alone(self, query: Query) -> bool:
        """Return whether a path to a goal would exist without the moving people."""
        graph = query.graph if query.closed is None else query.graph.without(query.closed)
        alone = pareto_paths(graph, self.start, query.goals, budget=Budget(max_labels=10**6), eps=1.0)
        return alone.status is not Status.NO_PATH

    def what_blocks(self, query: Query) -> str:
        """Return the reason, as text for the user, why there is no path: walls, or people and options for time."""
        if not self.is_open_alone(query):
            return query.space.what_separates(query.start, query.goals)
        why, remedies = ["moving people block them, now or later"], list[str]()
        if self.tour is not None and (stops := [*self.tour.blocked_stops()]):
            why.append(f"people are too near to {some(stops)} whenever the robot could stand there")
            remedies.append("another position or a shorter dwell for this stop")
        if near := [*self.timed.safety.coming(self.departure)]:
            names = some([*dict.fromkeys(person.name or "a person" for person, _ in near)])
            when = f"after {first:.2g} s" if (first := min(since for _, since in near)) else "from the beginning"
            why.append(f"{names} may come too near to the start, {when}, so that the robot cannot leave in time")
        if self.options.margin > 0:
            remedies.append("a smaller margin")
        if self.options.hold is None:
            remedies.append("a value for hold, so that the robot may wait")
        if self.options.arrive_by is not None:
            why.append(f"none arrives within {self.options.arrive_by:g} s")
            remedies.append("a later arrive_by")
        if query.max_turns is not None:
            why.append(f"none has at most {query.max_turns} turns")
            remedies.append("a larger max_turns")
        advice = [f"give {remedy}" for remedy in remedies] + ["choose another start or goal", "plan again later"]
        return f"no path: there are paths without people, but {', or '.join(why)}; {', or '.join(advice)}"


def timed_query(
    built: BuiltGraph,
    objectives: Objectives,
    problem: Problem,
    options: TimeOptions,
    max_turns: int | None = None,
    attention: Attention | None = None,
    *,
    people_stop: bool = False,
) -> Query:
    """Return the query for a graph in time steps, among the moving people of a problem.

    Raises Exhausted if a limit is passed, QueryError for a graph that cannot be searched in time steps, and the errors
    of :func:`.assembly.timed_graph`, which explains ``attention`` and ``people_stop``.
    """
    began = time.perf_counter()
    space, start, goals = built.ends
    layers = space.tour_layers
    one_layer, ends = (space, goals) if layers is None else (layers.inner, [*layers.goals])
    if not one_layer.has_clock:
        raise QueryError(
            f"among moving people, a graph needs positions at which the robot can wait, but {space.words} has none; "
            "use the lattice, or give people no velocity"
        )
    tour = None
    with within(space.spending):
        timed = timed_graph(
            cast("StateGraph | JoinedEnds", one_layer),
            objectives.optimised,
            start,
            ends,
            options,
            problem.quanta,
            attention=attention,
            people_stop=people_stop,
            passes_goals=layers is not None,
        )
        if layers is not None:
            tour = timed_tour(timed, layers, ends, objectives.optimised)
    timing = Timing(timed, timed.start, options, problem.world.content.people, tour=tour)
    fields: dict[str, Any] = {"notes": built.notes, "max_turns": max_turns}
    fields["build_seconds"] = time.perf_counter() - began
    if tour is None:
        return on_clock(timing, objectives, start, goals, **fields)
    return Query(space, objectives, tour.graph.graph, start, tour.goals, timing=timing, **fields)


def on_clock(timing: Timing, objectives: Objectives, start: int, goals: list[int], **fields: Any) -> Query:
    """Return the query for a graph in time steps; ``fields`` are values for further fields of :class:`Query`.

    timing        the graph with its clock, the people and the departure
    start, goals  numbers of nodes
    """
    timed = timing.timed
    return Query(timed.arcs.space, objectives, timed.graph.graph, start, goals, timing=timing, **fields)
