"""A planning problem on a graph of states with a clock: what is searched, and what is said of the result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.base.text import some
from hpop.models.execution import needed_about
from hpop.planners.base import Candidates
from hpop.planners.deferred import Deferred
from hpop.planners.graphs.claims import ROUNDED, at_memory_limit, claimed
from hpop.planners.graphs.query import tolerance_counts
from hpop.planners.graphs.timed.clock import SLACK, TimeOptions
from hpop.planners.graphs.timed.graph import Timed
from hpop.planners.graphs.timed.plans import Plans
from hpop.planners.graphs.timed.safety import Start
from hpop.planners.objectives import Objectives
from hpop.runtime.status import Budget, ProgressCallback, Status
from hpop.search import pareto_paths
from hpop.search.machinery.checkpoint import CheckpointSpec
from hpop.search.timed.paths import TimedPaths
from hpop.search.timed.timed_paths import timed_paths
from hpop.trajectories.contacts import contact
from hpop.world.content.predictions import taken_to_stop, with_stops, yielding

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

UNREACTING = "people are taken to do as predicted, whatever the robot does"


@dataclass(frozen=True, eq=False)
class TimedQuery:
    """A problem on a graph of states with a clock.

    problem
    objectives
    timed          the graph on the clock
    options        of time
    start, goals   state ids
    build_seconds  s
    max_turns      paths with more turns do not count
    begins         s, on the clock, when they really leave the start
    closed         (m,) edges that nobody takes; None for none
    late_start     s, by how much executions are later from the start on, which graph and clock do not allow for
    """

    problem: Problem
    objectives: Objectives
    timed: Timed
    options: TimeOptions
    start: int
    goals: list[int]
    build_seconds: float
    max_turns: int | None = None
    begins: float = 0.0
    closed: BoolArray | None = None
    late_start: float = 0.0

    @property
    def _begin(self) -> int:
        """Node at which plans begin: that of the start, or one beside it."""
        return self.timed.start if self.timed.arcs.copied.size else self.start

    def exact(
        self,
        name: str,
        budget: Budget,
        progress: ProgressCallback | None = None,
        *,
        eps: float = 0.0,
        tolerance: Mapping[str, float] | None = None,
        checkpoint: CheckpointSpec | None = None,
        stage: bool = False,
    ) -> Candidates:
        """All non-dominated paths on the clock as the candidates of the planner ``name``, or some within ``eps``.

        As :meth:`hpop.planners.graphs.query.GraphQuery.exact`. ``stage``: before the last, so that the budget's time is
        a share and not a limit that anybody has set.
        """
        fine = tolerance_counts(self.objectives, tolerance or {})
        quanta = np.array([criterion.quantum for criterion in self.objectives.optimised])
        goals = [*self.goals, self._begin] if self.start in self.goals else self.goals
        counts = np.floor(fine * (quanta / self.timed.quanta) + 1e-9).astype(np.int64)
        paths = timed_paths(
            self.timed.graph,
            self._begin,
            goals,
            budget=budget,
            progress=progress,
            eps=eps,
            tolerance=counts.tolist(),
            at_most=self.objectives.at_most(self.max_turns),
            checkpoint=checkpoint,
        )
        claim = claimed(paths, self.where, self.rounded, eps=eps, tolerance=tolerance, stage=stage)
        return self.candidates(name, paths, claim, {"stage": "first points"} if stage else {})

    @property
    def where(self) -> str:
        """On what something is claimed, in words."""
        where = f"{self.timed.arcs.space.words}, {self._in_time}, for ({self.objectives.names})"
        return where if self.max_turns is None else f"{where} and at most {self.max_turns} turns"

    @property
    def rounded(self) -> str:
        """How costs are rounded, in words."""
        own = zip(self.objectives.optimised, self.timed.quanta.tolist(), strict=True)
        steps = [f"{c.name} {step:g} {c.unit}".removesuffix(" 1") for c, step in own if step != c.quantum]
        return ROUNDED + f", on the clock those of {', '.join(steps)}" * bool(steps)

    @property
    def _in_time(self) -> str:
        """The clock and what is predicted, in words."""
        parts = [f"on a clock of {self.options.tick:g} s"]
        hold = self.timed.hold
        parts.append("without holds" if hold is None else f"with holds of at least {hold:g} s")
        company = self.timed.company
        people = "1 person who moves" if len(company.people) == 1 else f"{len(company.people)} people who move"
        parts.append(f"for the predictions of {people}, the last of which ends after {company.settled:.3g} s")
        if self.options.margin:
            parts.append(f"{self.options.margin:g} m clear of them")
        if self.options.arrive_by is not None:
            parts.append(f"arriving within {self.options.arrive_by:g} s")
        return ", ".join(parts)

    @property
    def _executed(self) -> str:
        """By how much executions are off their plans, in words."""
        ramps = self.timed.ramps
        if ramps is None:
            return "and each was looked at as it is executed"
        return f"and robots, as they are executed, off their plans by at most {ramps.stray:.2g} m"

    def candidates(self, name: str, paths: TimedPaths, claim: str, origin: Mapping[str, Any]) -> Candidates:
        """Paths as the candidates of the planner ``name``, with more of their origin."""
        plans = Plans(self.timed, [paths.steps(i) for i in range(len(paths))], self.begins, self.late_start)
        kept = np.flatnonzero(~self._in_contact(plans))
        if kept.size < len(paths):
            claim += f", without {len(paths) - kept.size} that are in people's way as they are executed"
        return self._candidates(
            name, paths, kept, replace(plans, steps=[plans.steps[i] for i in kept.tolist()]), claim, origin
        )

    def _in_contact(self, plans: Plans) -> BoolArray:
        """Plans (n,) that come too near to people; only those are looked at of which the search does not say it."""
        found = np.zeros(len(plans.steps), dtype=bool)
        doubtful = (plans.drift > SLACK) | (plans.late > SLACK)
        if self.timed.ramps is None or self.timed.safety.about_start:
            doubtful[:] = True
        rows = np.flatnonzero(doubtful)
        parts = self.timed.arcs.inner.model.platform
        people = with_stops(self.problem.world.content.people, self.stopping, *self._at_start)
        for i, trajectory in zip(rows.tolist(), plans.trajectories(rows), strict=True):
            each = (trajectory, trajectory.execution())
            found[i] = any(contact(parts, people, one, self.options.margin) for one in each)
        return found

    def _candidates(
        self, name: str, paths: TimedPaths, kept: IntArray, plans: Plans, claim: str, origin: Mapping[str, Any]
    ) -> Candidates:
        space, costs = self.timed.arcs.space, paths.costs[kept]
        drift = float(plans.drift.max(initial=0.0))
        if kept.size:
            claim += f"; times of plans are off the clock by at most {drift:.2g} s, {self._executed}; {UNREACTING}"
        common: dict[str, Any] = {"planner": name, **space.options, **self.options.described, **origin}
        if self.stopping:
            common["people_who_stop"] = self.stopping
        own = zip(plans.lengths.tolist(), plans.holds.tolist(), plans.drift.tolist(), strict=True)
        gap = paths.gap if math.isfinite(paths.gap) else None
        return Candidates(
            objectives=self.objectives.optimised,
            trajectories=Deferred(kept.size, plans.trajectories) if kept.size else (),
            planned=costs * self.timed.quanta,
            tolerance=plans.tolerance(costs),
            status=paths.status,
            certificate=f"{name}: {claim}{self.objectives.certificate}",
            provenance=tuple(
                {**common, "edges": steps - holds, "holds": holds, "drift": round(off, 6)} for steps, holds, off in own
            ),
            notes=(
                *self.objectives.notes,
                *self._touching,
                *self._stopping,
                *self._what_blocks(paths),
                *at_memory_limit(paths),
            ),
            filters=self.objectives.filters,
            stats={
                "planner": name,
                "states": space.size,
                "edges": int(self.timed.graph.graph.arcs),
                "build_seconds": self.build_seconds,
                **self.timed.counts,
                "method": paths.stats.method,
                "labels_generated": paths.stats.labels_generated,
                "labels_expanded": paths.stats.labels_expanded,
                "labels_open": paths.stats.labels_open,
                "peak_memory": paths.stats.peak_memory,
                "gap": gap,
                "bounds_seconds": paths.stats.seconds_bounds,
                "search_seconds": paths.stats.seconds_search,
            },
        )

    @property
    def _touching(self) -> tuple[str, ...]:
        """With whom the robot starts in contact, in words."""
        who = [person.name or "somebody" for person in self.timed.safety.touched]
        if not who:
            return ()
        return (f"the robot starts in contact with {some(who)}; it may leave, where the gap does not shrink",)

    @cached_property
    def stopping(self) -> list[int]:
        """Numbers of the people who are taken to stop before the robot where it starts."""
        if not self.timed.people_stop:
            return []
        place, reach = self._at_start
        people = self.problem.world.content.people
        moving = self.timed.company.moving
        return [i for i in moving if yielding(people[i], place, reach) is not people[i]]

    @property
    def _at_start(self) -> tuple[tuple[float, float], float]:
        """Where plans begin, m, and what the robot needs there, m."""
        model, start = self.timed.arcs.inner.model, self.begins_at
        return (start.x, start.y), needed_about(model, self.options.margin)

    @property
    def begins_at(self) -> Start:
        """Where and when plans begin."""
        at = self.timed.arcs.states.take(self.timed.arcs.place[[self._begin]])
        return Start(float(at.x[0]), float(at.y[0]), self.begins)

    @property
    def _stopping(self) -> tuple[str, ...]:
        """Who is taken to stop before the robot, in words."""
        return (taken_to_stop(self.problem.world.content.people, self.stopping),) if self.stopping else ()

    def _what_blocks(self, paths: TimedPaths) -> tuple[str, ...]:
        """Why there is no path, in words."""
        if paths.status is not Status.NO_PATH:
            return ()
        graph = self.timed.graph.graph
        if self.closed is not None:
            graph = graph.without(self.closed)
        alone = pareto_paths(graph, self._begin, self.goals, budget=Budget(max_labels=10**6), eps=1.0)
        if alone.status is Status.NO_PATH:
            return (self.timed.arcs.space.what_separates(self.start, self.goals),)
        why, ways_out = ["people who move are in them, now or later"], list[str]()
        if near := [*self.timed.safety.coming(self.begins_at)]:
            who = some([*dict.fromkeys(person.name or "somebody" for person, _ in near)])
            when = f"after {first:.2g} s" if (first := min(since for _, since in near)) else "from the beginning"
            why.append(f"{who} may be too near to the start, {when}, for the robot to be away in time")
        if self.options.margin > 0:
            ways_out.append("a smaller margin")
        if self.options.hold is None:
            ways_out.append("a hold")
        if self.options.arrive_by is not None:
            why.append(f"none arrives within {self.options.arrive_by:g} s")
            ways_out.append("a later arrive_by")
        if self.max_turns is not None:
            why.append(f"none has at most {self.max_turns} turns")
            ways_out.append("more max_turns")
        advice = [f"give {way}" for way in ways_out] + ["ask for another start or goal, or later"]
        return (f"no path: there are ways, but {', or '.join(why)}; {', or '.join(advice)}",)
