"""The graph of a drive while people move: on a clock, and kept with all that is known of it while they do as predicted.

What takes most of the time of a question among people, the tables of what they make of costs and the bounds of the rest
of the way, does not depend on where the robot is: a later question begins at a later tick of the same clock. When other
people come, only what they change is made anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.drive.options import Commit
from hpop.drive.surroundings import Surroundings
from hpop.drive.ways import Ways
from hpop.planners.base import Candidates
from hpop.planners.graphs.claims import how_far
from hpop.planners.graphs.joined_ends import JoinedEnds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.objectives import Objectives
from hpop.planners.timed.assembly import LaidOut, Timed, timed_graph
from hpop.planners.timed.clock import TimeOptions
from hpop.planners.timed.query import TimedQuery
from hpop.search.timed import TimedPaths
from hpop.search.timed.prepared import PreparedTimed, Walk
from hpop.status import Status
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problem import Problem

EARLIER = 0.5  # s by which a robot may come to a place before its plan says so, and the graph need not be made anew


class TimedPlan(NamedTuple):
    """A way that is known: its arcs (s,), and when they are left for (s,), s of the drive."""

    arcs: IntArray
    times: FloatArray


@dataclass(frozen=True, eq=False)
class TimedWays:
    """The ways of a drive on a clock, among people as they are predicted.

    ways        with those costs that do not read the time, and what is closed
    timed       the graph on the clock; its tick 0 is `since`, s of the drive
    objectives, options
    people      as they are predicted from then on
    start       node from which it was laid out, and `begin` the tick
    alone       whether it serves questions from there alone: somebody is near the robot
    """

    ways: Ways
    timed: Timed
    objectives: Objectives
    options: TimeOptions
    people: tuple[Any, ...]
    since: float
    start: int
    begin: int
    alone: bool

    @classmethod
    def laid_out(
        cls,
        ways: Ways,
        node: int,
        at: float,
        now: Surroundings,
        problem: Problem,
        objectives: Objectives,
        options: TimeOptions,
        before: TimedWays | None,
    ) -> TimedWays:
        """The ways from a node, reached at a time of the drive, s.

        problem  asked from there and then
        before   the same of other people, or of other closings; None if there are none
        """
        space = ways.query.space
        assert isinstance(space, StateGraph | JoinedEnds)
        space = space.costed_in(now.problem.world)
        arcs = before.timed.arcs if before is not None and before.ways.query.space is ways.query.space else None
        tick = options.tick
        begin = max(0, math.floor((at - EARLIER - now.since) / tick))
        laid = LaidOut(ways.graph, ways.closed, begin, arcs)
        timed = timed_graph(space, objectives.optimised, node, options, now.problem.quanta, laid)
        made = cls(ways, timed, objectives, options, now.people, now.since, node, begin, alone=False)
        if not made.is_near(problem):
            return made
        # Somebody is near: the robot may leave, which is a question of its own.
        space, begin = space.costed_in(problem.world), 0
        laid = LaidOut(ways.graph, ways.closed, None, timed.arcs)
        timed = timed_graph(space, objectives.optimised, node, options, now.problem.quanta, laid)
        return replace(made, timed=timed, since=at, begin=0, alone=True)

    def is_near(self, problem: Problem) -> bool:
        """Whether somebody is within the margin of the start of a problem; QueryError where there is contact."""
        x, y = problem.start[:2]
        people = problem.world.content.people
        movers = tuple(each for person in people if person.moves for _, each in person.hypotheses)
        return bool(replace(self.timed.safety, people=movers, start=(float(x), float(y))).about_start)

    def serves(self, now: Surroundings, node: int, at: float, ways: Ways) -> bool:
        """Whether a question from a node at a time, s of the drive, has its answer here."""
        if self.ways is not ways or self.people != now.people or node < 0:
            return False
        if self.alone:
            return node == self.start and self.since == at
        return self.since == now.since and self.tick(at) >= self.prepared.earliest[node]

    def tick(self, at: float) -> int:
        """The tick next to a time, s of the drive."""
        return max(0, round((at - self.since) / self.options.tick))

    @cached_property
    def prepared(self) -> PreparedTimed:
        """The graph that is searched."""
        return PreparedTimed(self.timed.graph, self.start, self.ways.query.goals, begin=self.begin)

    def plans(self, trajectories: Sequence[Trajectory], at: float) -> list[TimedPlan]:
        """The last part of each trajectory that goes along the graph; they begin at a time of the drive, s."""
        found = self.ways.ways_with_places(trajectories)
        plans = [
            TimedPlan(arcs, at + way.times[leaving]) for (arcs, leaving), way in zip(found, trajectories, strict=True)
        ]
        return [plan for plan in plans if plan.arcs.size]

    def walks(self, node: int, at: float, plans: Iterable[TimedPlan]) -> list[Walk]:
        """What of some ways is still to go from a node at a time, s of the drive, on the clock: with their holds."""
        begin, graph, found = self.tick(at), self.timed.graph, list[Walk]()
        least = graph.hold or 0
        waits = 0.5 * max(1, least) * self.options.tick  # s: who stands for less has not held
        for arcs, times in plans:
            for i in np.flatnonzero(self.ways.tails[arcs] == node)[-1:].tolist():
                ready, when, leaves = begin, at, list[int]()
                for arc, leave in zip(arcs[i:].tolist(), times[i:].tolist(), strict=True):
                    if leave - when > waits:
                        ready = max(ready + least, self.tick(leave))
                    leaves.append(ready)
                    ready += int(graph.durations[arc])
                    when = leave + float(self.timed.arcs.durations[arc])
                found.append(Walk(arcs[i:], np.array(leaves, np.int64)))
        return found

    def rests(self, node: int, at: float, known: Iterable[TimedPlan], deadline: float | None) -> TimedPaths:
        """All non-dominated ways from a node at a time, s of the drive, or what is found of them until a deadline.

        known     ways that are known already, whoever they lead from
        deadline  s of this thread's processor time, None for none
        """
        return self.prepared.paths(node, self.tick(at), deadline=deadline, known=self.walks(node, at, known))

    def found(self, paths: TimedPaths) -> list[TimedPlan]:
        """Ways that were found, for later questions."""
        tick = self.options.tick
        return [TimedPlan(arcs, np.asarray(self.since + leaves * tick, np.float64)) for arcs, leaves in paths.places]

    def described(self, paths: TimedPaths) -> dict[str, Any]:
        """What was found, as JSON."""
        gap = paths.gap if math.isfinite(paths.gap) else None
        walks = [[arcs.tolist(), leaves.tolist()] for arcs, leaves in paths.places]
        return {"status": str(paths.status), "gap": gap, "labels": paths.stats.labels_generated, "walks": walks}

    def told(self, node: int, at: float, answer: Mapping[str, Any]) -> TimedPaths:
        """What was found before, from how it was described."""
        walks = [Walk(np.array(arcs, np.int64), np.array(leaves, np.int64)) for arcs, leaves in answer["walks"]]
        paths = self.prepared.paths(node, self.tick(at), deadline=0.0, known=walks)
        stats = replace(paths.stats, labels_generated=answer["labels"])
        gap = math.inf if answer["gap"] is None else answer["gap"]
        return replace(paths, status=Status(answer["status"]), gap=gap, stats=stats)

    def candidates(self, name: str, problem: Problem, commit: Commit, node: int, paths: TimedPaths) -> Candidates:
        """Ways from a commit as candidates of the planner that laid out the graph, and what is claimed of them."""
        # A robot that moves on from rest is behind by half of what stopping and starting take.
        ramps, rests = self.timed.ramps, commit.place == 0 or commit.stands > 0.0
        query = TimedQuery(
            problem, self.objectives, self.timed, self.options, node, [*self.ways.query.goals],
            self.timed.seconds, begins=commit.time - self.since, closed=self.ways.closed,
            late_start=ramps.half if ramps is not None and rests else 0.0,
        )  # fmt: skip
        shut = int(self.ways.closed.sum())
        where = query.where + f", {shut:,} of its edges closed" * bool(shut)
        if paths.status.is_final:
            claim = f"exact on {where}, {query.rounded}"
        else:
            claim = (
                f"incomplete ({paths.status}): known ways and what was found on {where}, points need not be optimal, "
                f"others are missing{how_far(paths.gap, {})}"
            )
        return query.candidates(name, paths, claim, {})
