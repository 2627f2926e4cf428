"""The graph of a drive on a clock, among moving people; it is reused as long as they move as predicted.

On a clock, time is discrete: it is counted in ticks. Most of the time of a query goes into tables of costs near people,
and into bounds on the remaining cost. Neither depends on the position of the robot, and a later query begins at a later
tick of the same clock. A query starts at a commit, the next place where the plan of the drive may change. When people
change, only tables that depend on them are computed again. Times of the drive are on the clock of the caller, s.

Graphs are built by a worker thread that keeps only its newest waiting task.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.drive.drive_graph import DriveGraph
from hpop.drive.options import Commit
from hpop.drive.plan import SAME, speed_of
from hpop.drive.surroundings import DriveSurroundings
from hpop.drive.tour import TourDriveGraph
from hpop.motions import States
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble, claim_with_known_paths, memory_limit_notes, search_stats
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.timed import Timing
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.planners.graphs.timed.notice import MovingPeople
from hpop.planners.graphs.timed.plans import GraphOnClock, GraphParts
from hpop.planners.graphs.timed.safety import LEAVING, Safety, Start
from hpop.planners.graphs.timed.tour_layers import TimedTour, timed_tour
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.graphs.tour_stops import tour_members
from hpop.planners.objectives import Objectives
from hpop.runtime.limits import Status
from hpop.search.timed import TimedGraph, TimedPaths
from hpop.search.timed.prepared import PreparedTimed, TimedPath
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.joined_ends import JoinedEnds
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.problems.problem import Problem

EARLIER = 0.5  # s by which a robot may be ahead of its plan before the graph must be built again


class ScheduledPath(NamedTuple):
    """A known path: its arcs (n,), and the time of departure (n,) on each arc, s of the drive."""

    arcs: IntArray
    times: FloatArray


@dataclass(frozen=True, eq=False)
class TimedDriveGraph:
    """The graph of a drive on a clock, among people as predicted.

    untimed     the graph with only the costs that do not depend on time, and with its closed arcs
    timed       the graph on the clock; tick 0 is at `since`, s of the drive
    objectives  the criteria of the search
    options     the planner's options of time, such as the tick
    people      people as predicted from `since` on
    tour        in a tour, the graph on the clock with a layer for each set of stops that are done; else None
    base        the untimed graph, without a joined start
    start       node for which the graph was built; `begin` is the earliest tick of a query from it
    state       (1,) state of the robot at the start
    places      nodes at which the plan may change next: that of the `Commit`, and those reached soon after it
    near        nodes within the margin of a person, with times, s on the clock: the robot may begin there, although it
                must not come so near elsewhere; empty if no person is near
    instead_of  surroundings in which no path leads on, because people walk towards the robot; else None
    stopping    `instead_of` with people who stop before the robot, for which this graph was built; else None
    """

    untimed: DriveGraph
    timed: GraphOnClock
    objectives: Objectives
    options: TimeOptions
    people: tuple[Any, ...]
    since: float
    base: DriveGraph
    start: int
    state: States
    begin: int
    places: frozenset[int]
    near: tuple[tuple[int, float], ...]
    tour: TimedTour | None = None
    instead_of: DriveSurroundings | None = None
    stopping: DriveSurroundings | None = None

    @classmethod
    def laid_out(
        cls,
        untimed: DriveGraph,
        base: DriveGraph,
        node: int,
        commit: Commit,
        now: DriveSurroundings,
        objectives: Objectives,
        options: TimeOptions,
        before: TimedDriveGraph | None,
        *,
        is_far: bool = False,
    ) -> TimedDriveGraph:
        """Build the graph on a clock that begins at the node of a commit, where the plan may change next.

        before  graph on a clock for other people or closed areas, of which parts are reused; None for none
        is_far  whether the graph is only for later places, where no person is near
        """
        space = cast("StateGraph | JoinedEnds", untimed.query.space.costed_in(now.problem.world))
        arcs = before.timed.arcs if before is not None and before.untimed.query.space is untimed.query.space else None
        at = commit.time - now.since
        begin = max(0, math.floor((at - EARLIER) / options.tick))
        clear = Safety.of(MovingPeople.of(space.world), space.model, options, (), space.spending)
        near = tuple[tuple[int, float], ...]()
        if not is_far and clear.near(_start(commit.state, at)):
            # Places soon after the commit belong to the same query: the robot may still be leaving there.
            states, times = commit.later.states, (commit.later.times - now.since).tolist()
            is_near = [bool(clear.near(_start(states.take([i]), time))) for i, time in enumerate(times)]
            later = [*zip(untimed.nodes(states).tolist(), times, is_near, strict=True)]
            later += zip(untimed.nodes(states, at_rest=True).tolist(), times, is_near, strict=True)
            stands = int(untimed.nodes(commit.state, at_rest=True)[0])  # with several speeds, the robot may stop there
            later = [(stands, at, True), *later]
            near = tuple(dict.fromkeys([(node, at), *(each[:2] for each in later if each[0] >= 0 and each[2])]))
        laid = GraphParts(untimed.graph, untimed.closed, begin, near, arcs)
        ends = tuple(dict.fromkeys(untimed.query.goals))
        query = space, objectives.optimised, node, ends, options, now.problem.quanta, laid
        timed, tour = timed_graph(*query, passes_goals=commit.tour is not None), None
        if commit.tour is not None:
            members = tour_members(untimed.query.space, commit.tour, space.world)
            layers = TourGraph(space.model, space.world, space, commit.tour, members, ends, spending=space.spending)
            tour = timed_tour(timed, layers, ends, objectives.optimised, anywhere=True)
        places = frozenset({node, *untimed.nodes(commit.later.states).tolist()} - {-1})
        return cls(
            untimed,
            timed,
            objectives,
            options,
            now.people,
            now.since,
            base,
            node,
            commit.state,
            begin,
            places,
            near,
            tour,
        )

    @property
    def searched(self) -> TimedGraph:
        """The graph on the clock, in a tour with its layers."""
        return self.timed.graph if self.tour is None else self.tour.graph

    @property
    def numbers(self) -> tuple[Any, ...]:
        """Key that is equal for two graphs if both number their arcs alike."""
        return self.untimed.query.space, None if self.tour is None else self.tour.tour.tour

    @property
    def goals(self) -> list[int]:
        """Nodes at which paths end."""
        return [*self.untimed.query.goals] if self.tour is None else self.tour.goals

    def begins(self, commit: Commit) -> int:
        """Return the node at a commit, in a tour in the layer of the stops that are done there."""
        node = self.node(commit.state)
        node = self.start if node < 0 else node
        if self.tour is None or commit.tour is None:
            return node
        return self.tour.tour.tour.layers.index(commit.tour.layers[0]) * self.timed.graph.graph.nodes + node

    def is_shut(self, commit: Commit, deadline: float) -> bool:
        """Return whether a search shows within a deadline, s, that no path leads on from a commit."""
        return (
            self.prepared.paths(self.begins(commit), self.tick(commit.time), deadline=deadline).status is Status.NO_PATH
        )

    def refuses(self, now: DriveSurroundings, commit: Commit, untimed: DriveGraph) -> bool:
        """Return whether an earlier query showed that no path leads on from the commit, as people walk towards it.

        The commit is the next place where the plan may change.
        """
        return self.instead_of is now and self.base is untimed and self.node(commit.state) in self.places

    def serves(self, now: DriveSurroundings, commit: Commit, untimed: DriveGraph) -> bool:
        """Return whether this graph can answer a query at the commit, where the plan may change next.

        It needs the same people and closed areas, a node that it covers at that time and, in a tour, a layer for the
        stops done there. People near the robot there must be among those who were near it when the graph was built;
        if no person is near there, none may have been near then.
        """
        node = self.node(commit.state)
        if self.base is not untimed or self.people != now.people or self.since != now.since or node < 0:
            return False
        if (
            self.tour is not None
            and commit.tour is not None
            and commit.tour.layers[0] not in self.tour.tour.tour.layers
        ):
            return False
        if self.tick(commit.time) < self.prepared.earliest[self.begins(commit)]:
            return False
        at = commit.time - self.since
        about = self.timed.safety.near(_start(commit.state, at))
        if not about or not self.near:
            return not about and not self.near
        is_there = node in [near_node for near_node, _ in self.near] and at <= self.near[0][1] + LEAVING
        return is_there and {*about} <= {*self.timed.safety.about_start}

    def is_other_part_of(self, made: TimedDriveGraph) -> bool:
        """Return whether another graph has equal people and closed areas, but only one of the two has `near` nodes."""
        return self.base is made.base and self.people == made.people and bool(self.near) != bool(made.near)

    def node(self, state: States) -> int:
        """Return the node at a state (1,); -1 if there is none."""
        space = self.untimed.inner.model.space
        off = [*space.differences(state, self.state).values(), speed_of(state) - speed_of(self.state)]
        if all(abs(each[0]) <= SAME for each in off):
            return self.start
        return int(self.untimed.nodes(state)[0])

    def tick(self, at: float) -> int:
        """Return the tick nearest to a time, s of the drive, counted from 0 at `since`; 0 for earlier times."""
        return max(0, round((at - self.since) / self.options.tick))

    @cached_property
    def prepared(self) -> PreparedTimed:
        """The graph on the clock, prepared for searches."""
        return PreparedTimed(self.searched, self.start, self.goals, begin=self.begin)

    @cached_property
    def _arcs(self) -> tuple[IntArray, FloatArray]:
        """Tail (m,) of each arc that is searched, and its duration (m,), s."""
        if self.tour is None:
            return self.untimed.tails, self.timed.arcs.durations
        graph, origins = self.tour.graph.graph, self.tour.origins
        dwells = np.where(self.tour.stops >= 0, self.tour.needed[self.tour.stops], 0.0)
        seconds = np.where(origins >= 0, self.timed.arcs.durations[np.maximum(origins, 0)], dwells)
        return np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)), seconds

    def scheduled(self, trajectories: Sequence[Trajectory], at: float) -> list[ScheduledPath]:
        """Return the last part of each trajectory, from where it follows the graph, as a path with departures.

        Trajectories that do not end on the graph are left out. In a tour the list is empty, because visits would have
        to be found on the clock. All trajectories begin at time ``at`` of the drive, s.
        """
        if self.tour is not None:
            return []
        parts = self.untimed.arcs_and_places(trajectories)
        paths = [
            ScheduledPath(arcs, at + trajectory.times[leaving])
            for (arcs, leaving), trajectory in zip(parts, trajectories, strict=True)
        ]
        return [path for path in paths if path.arcs.size]

    def on_clock(self, node: int, at: float, paths: Iterable[ScheduledPath]) -> list[TimedPath]:
        """Return the remaining parts of known paths from a node, as paths in ticks with holds.

        The robot is at the node at time ``at``, s of the drive.
        """
        begin, graph, remaining, (tails, seconds) = self.tick(at), self.searched, list[TimedPath](), self._arcs
        least = graph.hold or 0
        waits = 0.5 * max(1, least) * self.options.tick  # s: a shorter stop is no hold
        for arcs, times in paths:
            for i in np.flatnonzero(tails[arcs] == node)[-1:].tolist():
                ready, when, leaves = begin, at, list[int]()
                for arc, leave in zip(arcs[i:].tolist(), times[i:].tolist(), strict=True):
                    if leave - when > waits:
                        ready = max(ready + least, self.tick(leave))
                    leaves.append(ready)
                    ready += int(graph.durations[arc])
                    when = leave + float(seconds[arc])
                remaining.append(TimedPath(arcs[i:], np.array(leaves, np.int64)))
        return remaining

    def remaining_paths(
        self, node: int, at: float, known: Iterable[ScheduledPath], deadline: float | None
    ) -> TimedPaths:
        """Return all non-dominated paths from a node at time ``at`` of the drive, s, or those found until the deadline.

        known     known paths from any node
        deadline  s of processor time of this thread, None for no deadline
        """
        return self.prepared.paths(node, self.tick(at), deadline=deadline, known=self.on_clock(node, at, known))

    def in_seconds(self, paths: TimedPaths) -> list[ScheduledPath]:
        """Convert paths in ticks to paths with departures in seconds of the drive, for later queries."""
        tick = self.options.tick
        return [
            ScheduledPath(arcs, np.asarray(self.since + leaves * tick, np.float64)) for arcs, leaves in paths.places
        ]

    def described(self, paths: TimedPaths) -> dict[str, Any]:
        """Return the result of a search as JSON, for the event log."""
        gap = paths.gap if math.isfinite(paths.gap) else None
        timed_paths = [[arcs.tolist(), leaves.tolist()] for arcs, leaves in paths.places]
        return {"status": str(paths.status), "gap": gap, "labels": paths.stats.labels_generated, "walks": timed_paths}

    def restored(self, node: int, at: float, answer: Mapping[str, Any]) -> TimedPaths:
        """Rebuild the result of a search that its deadline ended, from its entry ``answer`` in the event log.

        node, at  where the search began, and when, s of the drive
        """
        logged = [TimedPath(np.array(arcs, np.int64), np.array(leaves, np.int64)) for arcs, leaves in answer["walks"]]
        paths = self.prepared.paths(node, self.tick(at), deadline=0.0, known=logged)
        stats = replace(paths.stats, labels_generated=answer["labels"])
        gap = math.inf if answer["gap"] is None else answer["gap"]
        return replace(paths, status=Status(answer["status"]), gap=gap, stats=stats)

    def candidates(self, name: str, problem: Problem, commit: Commit, node: int, paths: TimedPaths) -> Candidates:
        """Return paths from a commit as trajectories of the planner ``name``, with a claim of optimality.

        commit  where the plan may change next
        node    its node in this graph
        """
        # A robot that starts from rest is late by half of the time that stopping and starting take.
        ramps, rests = self.timed.ramps, commit.place == 0 or commit.stands > 0.0
        late = ramps.half if ramps is not None and rests else 0.0
        people = problem.world.content.people
        timing = Timing(self.timed, node, self.options, people, commit.time - self.since, late, self.tour)
        query = Query(
            self.timed.arcs.space if self.tour is None else self.tour.tour,
            self.objectives,
            self.searched.graph,
            node,
            self.goals,
            build_seconds=self.timed.seconds,
            closed=self.untimed.closed if self.tour is None else self.tour.closed(self.untimed.closed),
            timing=timing,
        )
        claim, stats = claim_with_known_paths(paths, query.where, query.rounded), search_stats(paths, paths.gap)
        reason = ""
        if paths.status is Status.NO_PATH and not timing.is_open_alone(query):
            reason = self.alone(commit).closed_in(node)
        return assemble(name, query, paths, claim, reason=reason, notes=memory_limit_notes(paths), stats=stats)

    def alone(self, commit: Commit) -> DriveGraph:
        """Return the graph without moving people; in a tour, its first layer is that of the stops done at a commit."""
        return self.untimed if commit.tour is None else TourDriveGraph.over(self.untimed, commit.tour)


def _start(state: States, time: float) -> Start:
    """Return a state (1,) as the start of plans at a time on the clock, s."""
    return Start(float(state.x[0]), float(state.y[0]), float(state.yaw[0]), time)


T = TypeVar("T")


class LatestOnlyWorker:
    """A worker thread that keeps only the newest waiting task; an older waiting task is cancelled.

    The thread ends after its last task, or when the process ends.
    """

    def __init__(self) -> None:
        """Make a worker without tasks."""
        self._lock, self._busy = Lock(), False
        self._next: tuple[Future[Any], Callable[[], Any]] | None = None

    def begin(self, task: Callable[[], T]) -> Future[T]:
        """Submit a task, to be run when the present one is done."""
        future: Future[T] = Future()
        with self._lock:
            if self._next is not None:
                self._next[0].cancel()
            self._next = future, task
            if not self._busy:
                self._busy = True
                Thread(target=self._work, name="hpop drive", daemon=True).start()
        return future

    def _work(self) -> None:
        while True:
            with self._lock:
                if self._next is None:
                    self._busy = False
                    return
                future, task = self._next
                self._next = None
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(task())
                except BaseException as error:  # raised again by future.result()
                    future.set_exception(error)
