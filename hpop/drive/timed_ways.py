"""The graph of a drive while people move: on a clock, and kept with all that is known of it while they do as predicted.

What takes most of the time of a question among people, the tables of what they make of costs and the bounds of the rest
of the way, does not depend on where the robot is: a later question begins at a later tick of the same clock. When other
people come, only what they change is made anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.costs import trajectory_costs
from hpop.drive.closings import Closing
from hpop.drive.options import Commit
from hpop.drive.plan import SAME, closed_ways, joined, part
from hpop.drive.surroundings import Surroundings
from hpop.drive.ways import Ways
from hpop.motions import States
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble, at_memory_limit, claimed_with_known, search_stats
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.planners.graphs.timed.notice import Company
from hpop.planners.graphs.timed.plans import LaidOut, Timed
from hpop.planners.graphs.timed.safety import LEAVING, Safety, Start
from hpop.planners.graphs.timed.timing import Timing, on_clock
from hpop.planners.objectives import Objectives
from hpop.runtime.status import Status
from hpop.search.timed import TimedPaths
from hpop.search.timed.prepared import PreparedTimed, Walk
from hpop.trajectories.contacts import first_contact
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.joined_ends import JoinedEnds
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.problems.problem import Problem

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
    base        the ways of the graph alone, where a state beside the graph is joined to them; else the same
    start       node from which it was laid out, and `begin` the tick from which on it may be asked about
    state       (1,) of the robot there
    places      nodes of the commit and of those soon after it
    near        nodes at which the robot is within somebody's margin, and when, s on the clock: there it may leave, also
                where it would not be so near else; none where nobody is near it
    instead_of  surroundings in which no path leads from there, as people walk against the robot
    stopping    the same with people who stop before it, for which this graph is made if anybody still moves in them
    """

    ways: Ways
    timed: Timed
    objectives: Objectives
    options: TimeOptions
    people: tuple[Any, ...]
    since: float
    base: Ways
    start: int
    state: States
    begin: int
    places: frozenset[int]
    near: tuple[tuple[int, float], ...]
    instead_of: Surroundings | None = None
    stopping: Surroundings | None = None

    @classmethod
    def laid_out(
        cls,
        ways: Ways,
        base: Ways,
        node: int,
        commit: Commit,
        now: Surroundings,
        objectives: Objectives,
        options: TimeOptions,
        before: TimedWays | None,
        *,
        is_far: bool = False,
    ) -> TimedWays:
        """The ways from a node, that of a commit.

        before  the same of other people, or of other closings; None if there are none
        is_far  whether they are for later places alone, where nobody is near
        """
        space = cast("StateGraph | JoinedEnds", ways.query.space.costed_in(now.problem.world))
        arcs = before.timed.arcs if before is not None and before.ways.query.space is ways.query.space else None
        at = commit.time - now.since
        begin = max(0, math.floor((at - EARLIER) / options.tick))
        clear = Safety.of(Company.of(space.world), space.model, options, 0, (), space.spending)
        near = tuple[tuple[int, float], ...]()
        if not is_far and clear.near(_start(commit.state, at)):
            # The places that come next belong to the same question: there the robot may go on leaving.
            nodes, times = ways.nodes(commit.later.states).tolist(), (commit.later.times - now.since).tolist()
            each = enumerate(zip(nodes, times, strict=True))
            there = (clear.near(_start(commit.later.states.take([i]), time)) for i, (_, time) in each)
            later = zip(nodes, times, there, strict=True)
            near = ((node, at), *((other, time) for other, time, who in later if other >= 0 and who))
        laid = LaidOut(ways.graph, ways.closed, begin, near, arcs)
        timed = timed_graph(space, objectives.optimised, node, ways.query.goals, options, now.problem.quanta, laid)
        places = frozenset({node, *ways.nodes(commit.later.states).tolist()} - {-1})
        return cls(
            ways, timed, objectives, options, now.people, now.since, base, node, commit.state, begin, places, near
        )

    def refuses(self, now: Surroundings, commit: Commit, ways: Ways) -> bool:
        """Whether no path leads from a commit in some surroundings, as people walk against the robot."""
        return self.instead_of is now and self.base is ways and self.node(commit.state) in self.places

    def serves(self, now: Surroundings, commit: Commit, ways: Ways) -> bool:
        """Whether a question from a commit has its answer here."""
        node = self.node(commit.state)
        if self.base is not ways or self.people != now.people or self.since != now.since or node < 0:
            return False
        if self.tick(commit.time) < self.prepared.earliest[node]:
            return False
        at = commit.time - self.since
        about = self.timed.safety.near(_start(commit.state, at))
        if not about or not self.near:
            return not about and not self.near
        is_there = node in [other for other, _ in self.near] and at <= self.near[0][1] + LEAVING
        return is_there and {*about} <= {*self.timed.safety.about_start}

    def is_other_part_of(self, made: TimedWays) -> bool:
        """Whether it is of the same people and closings as another, one of them for a robot near to somebody."""
        return self.base is made.base and self.people == made.people and bool(self.near) != bool(made.near)

    def node(self, state: States) -> int:
        """The node at which a state (1,) is, -1 where there is none."""
        space = self.ways.inner.model.space
        if all(abs(off[0]) <= SAME for off in space.differences(state, self.state).values()):
            return self.start
        return int(self.ways.nodes(state)[0])

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
        """Return paths from a commit as candidates of the planner that laid out the graph, with their claim."""
        # A robot that moves on from rest is behind by half of what stopping and starting take.
        ramps, rests = self.timed.ramps, commit.place == 0 or commit.stands > 0.0
        late = ramps.half if ramps is not None and rests else 0.0
        people = problem.world.content.people
        timing = Timing(self.timed, node, self.options, people, commit.time - self.since, late)
        goals, seconds = [*self.ways.query.goals], self.timed.seconds
        query = on_clock(timing, self.objectives, node, goals, build_seconds=seconds, closed=self.ways.closed)
        claim, stats = claimed_with_known(paths, query.where, query.rounded), search_stats(paths, paths.gap)
        return assemble(name, query, paths, claim, notes=at_memory_limit(paths), stats=stats)


def _start(state: States, time: float) -> Start:
    """A state (1,) as a place where plans begin, at a time on the clock, s."""
    return Start(float(state.x[0]), float(state.y[0]), time)


CLAIM = (
    "incomplete: known ways, looked at again among people and closings as they are told to be now; points need not be "
    "optimal, others are missing, and nothing is proven of these before the graph on the clock is made anew: ask again"
)


def rests_from(ways: Iterable[Trajectory], state: States) -> Iterator[Trajectory]:
    """What is still to go of ways, from where each is in a state (1,) for the last time."""
    for way in ways:
        there = np.ones(len(way) + 1, dtype=np.bool_)
        space = way.model.space
        for off in space.differences(state.take(np.zeros(len(way) + 1, np.int64)), way.states).values():
            there &= np.abs(off) <= SAME
        last = np.flatnonzero(there)
        if last.size and last[-1] < len(way):
            yield part(way, int(last[-1]), len(way))


def clear_ways(
    ways: Iterable[Trajectory],
    problem: Problem,
    before: Trajectory,
    closings: Sequence[Closing],
    margin: float,
    latest: float | None,
    enough: Callable[[], bool],
) -> Iterator[Trajectory]:
    """Those of some ways that nothing and nobody is in the way of, as plans and as they are executed.

    problem  asked from where and when they begin
    before   what is driven until then: a robot that comes along is not at rest there
    margin   m, to people who move
    latest   s, from then on, by which they arrive; None for whenever
    enough   whether no more of them are looked at
    """
    parts, people = problem.model.platform, problem.world.content.people
    for way in ways:
        if enough():
            return
        if (latest is not None and way.duration > latest) or closed_ways([way], closings).any():
            continue
        whole = joined(before, way)
        each = product((whole, whole.execution()), {0.0, margin})
        if not any(first_contact(parts, people, one, least, begin=before.duration) for one, least in each):
            yield way


def rechecked(name: str, problem: Problem, objectives: Objectives, ways: Sequence[Trajectory]) -> Candidates:
    """Ways that are open and clear as candidates of the planner ``name``, of which nothing is claimed but that."""
    criteria = objectives.optimised
    costs = trajectory_costs(criteria, ways, problem.world) if ways else np.zeros((0, len(criteria)))
    origin: dict[str, Any] = {"planner": name, "known": True}
    return Candidates(
        objectives=criteria,
        trajectories=tuple(ways),
        planned=costs,
        tolerance=np.zeros(costs.shape),
        status=Status.TIME_LIMIT,
        certificate=f"{name}: {CLAIM}{objectives.certificate}",
        provenance=(origin,) * len(ways),
        notes=objectives.notes,
        filters=objectives.filters,
        stats={"planner": name, "labels_generated": 0, "gap": None},
    )
