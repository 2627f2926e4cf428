"""Replanning during a drive: graphs, and paths found on them, are reused from query to query.

While people move, the search uses a graph on a clock: the graph of states with discrete time. A commit is the next
place where the plan of the drive may change; up to there it is fixed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from hpop.base.arrays import IntArray
from hpop.criteria.base import make_criterion
from hpop.drive.drive_graph import DriveGraph
from hpop.drive.known_paths import (
    RECHECK,
    KnownRoutes,
    ReplanResult,
    clear_remaining,
    described,
    known_result,
    of_remaining,
    rechecked,
)
from hpop.drive.options import Commit
from hpop.drive.surroundings import DriveSurroundings
from hpop.drive.timed_drive_graph import LatestOnlyWorker, ScheduledPath, TimedDriveGraph
from hpop.drive.tour import TourGraphs
from hpop.drive.ways_out import held, led_out
from hpop.errors import DriveError, QueryError
from hpop.planners.base import Planner
from hpop.planners.graphs.run_speeds import run_speed_graph
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.planners.graphs.timed.presence import reading_time
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import CORES, Spending
from hpop.runtime.limits import Status
from hpop.search.prepared import Prepared
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


NO_GRAPH = "a drive needs a lattice, or a roadmap of positions; {!r} has neither for this robot: give planner='lattice'"


class _PendingGraph(NamedTuple):
    """A graph on a clock that another thread is building, for these surroundings and queries that start at `commit`."""

    surroundings: DriveSurroundings
    commit: Commit
    future: Future[TimedDriveGraph]


class Replanner:
    """The planner of a drive, with its graphs and the known paths on them."""

    def __init__(
        self, problem: Problem, planner: Planner, trajectories: Sequence[Trajectory], begin: float = 0.0
    ) -> None:
        """Create a planner for a robot that leaves at time ``begin`` of the drive, s, with known trajectories."""
        if planner.graph_of_drives is None:
            raise DriveError(NO_GRAPH.format(planner.name))
        self.problem, self.planner = problem, planner
        self.objectives = edge_objectives(problem.criteria, planner.name)
        self._trajectories = tuple(trajectories)
        self._graph: DriveGraph | None = None
        self._prepared: Prepared | None = None  # for searches on this graph
        self._arcs: list[IntArray] = []  # of the known trajectories
        self._routes: KnownRoutes | None = None
        self._last_paths: list[IntArray] = []  # of the last search
        self._tours = None if problem.tour is None else TourGraphs(problem.tour, self._trajectories)
        self._began = float(begin)
        self._untimed: DriveGraph | None = None  # while people move: costs that do not depend on time
        self._timed: TimedDriveGraph | None = None
        self._other_timed: TimedDriveGraph | None = None  # for a robot with no person near, or the reverse
        self._last_scheduled: list[ScheduledPath] = []  # paths of the last search on a clock
        self._last_numbers: object = None  # of the graph that numbers their arcs
        self._last_trajectories: Sequence[Trajectory] = ()  # these paths as trajectories
        self._worker = LatestOnlyWorker()
        self._pending: _PendingGraph | None = None
        self._building: Future[DriveGraph] | None = None  # the graph without a clock, in another thread

    def result(
        self,
        now: DriveSurroundings,
        problem: Problem,
        commit: Commit,
        present: Trajectory | None,
        deadline: float | None,
        answer: Mapping[str, Any] | None = None,
    ) -> ReplanResult:
        """Search for remaining plans in the present world, from the next place where the plan may change (`Commit`).

        problem   the problem from there, with the stops of a tour that are done
        present   the present plan from there, None if an area or a person is in its way
        deadline  s of processor time of this thread, None for no deadline
        answer    the logged result of the same search, if its deadline ended it
        """
        if answer is not None and "ways" in answer:
            logged = [Trajectory.from_description(problem.model, trajectory) for trajectory in answer["ways"]]
            found = known_result(self.planner.name, problem, self.objectives, logged)
        else:
            search = self._search_on_clock if now.moving else self._search
            found = search(now, problem, commit, present, deadline, answer)
        is_lost = found.candidates.status is Status.NO_PATH and self._tours is None
        if not is_lost or not now.touched(commit.state, commit.time):
            return found
        if now.moving and self.stopping(now, commit) is not None:  # first, people are taken to stop before the robot
            return found
        out = led_out(self._without_time(now) if now.moving else self.graph(now), problem, now, commit, self.objectives)
        if out is None:
            return found._replace(candidates=held(found.candidates, problem.model, now, commit))
        return ReplanResult(out, math.inf, found.labels, described(out.trajectories) if now.moving else None)

    def _search_on_clock(
        self,
        now: DriveSurroundings,
        problem: Problem,
        commit: Commit,
        present: Trajectory | None,
        deadline: float | None,
        answer: Mapping[str, Any] | None,
    ) -> ReplanResult:
        """Search on the graph on a clock, among moving people, beginning with known paths."""
        began = time.perf_counter()
        graph = self.timed_graph(now, commit, None if deadline is None else 0.0)
        if graph is None:
            assert deadline is not None
            clear = self._clear(now, problem, commit, present, 0.5 * deadline)
            graph = self.timed_graph(now, commit, deadline - RECHECK - (time.perf_counter() - began))
            if graph is None:
                return known_result(self.planner.name, problem, self.objectives, clear)
            deadline = max(0.0, deadline - (time.perf_counter() - began))
        if graph.instead_of is now:
            nothing = replace(rechecked(self.planner.name, problem, self.objectives, []), status=Status.NO_PATH)
            return ReplanResult(nothing, math.inf, 0, None)
        node, numbers = graph.begins(commit), graph.numbers
        if answer is None:
            known = [] if present is None else graph.scheduled([present], commit.time)
            known += graph.scheduled(self._trajectories, self._began)
            known += self._last_scheduled if self._last_numbers == numbers else []  # other ends number arcs differently
            paths = graph.remaining_paths(node, commit.time, known, deadline)
        else:
            paths = graph.restored(node, commit.time, answer)
        self._last_scheduled, self._last_numbers = graph.in_seconds(paths), numbers
        logged_result = None if paths.status.is_final else graph.described(paths)
        candidates = of_remaining(graph.candidates(self.planner.name, problem, commit, node, paths), problem)
        self._last_trajectories = candidates.trajectories
        base_node, is_lost = node % graph.timed.graph.graph.nodes, paths.status is Status.NO_PATH
        lost = graph.alone(commit).unreachable(base_node) if is_lost else ()
        return ReplanResult(candidates, paths.gap, paths.stats.labels_generated, logged_result, lost)

    def _clear(
        self, now: DriveSurroundings, problem: Problem, commit: Commit, present: Trajectory | None, seconds: float
    ) -> list[Trajectory]:
        """Return the known plans' parts after the commit that are clear (:func:`clear_remaining`)."""
        options: TimeOptions = self.planner.time_options
        latest = None if options.arrive_by is None else options.arrive_by - (commit.time - self._began)
        known, checks = (*self._last_trajectories, *self._trajectories), (now.closed, options.margin, latest)
        return [*([] if present is None else [present]), *clear_remaining(known, problem, commit, checks, seconds)]

    # The graph on the clock, built in another thread

    def begin(self, now: DriveSurroundings, commit: Commit) -> None:
        """Begin to build, in another thread, the graph on a clock for queries that start at a commit.

        Do nothing if the graph is built or being built.
        """
        is_pending = self._pending is not None and self._pending.surroundings is now
        if not is_pending and self._serving(now, commit) is None:
            self._pending = _PendingGraph(now, commit, self._worker.begin(partial(self._built, now, commit)))

    def timed_graph(
        self, now: DriveSurroundings, commit: Commit, seconds: float | None = None
    ) -> TimedDriveGraph | None:
        """Return the graph on a clock for queries that start at a commit; None if not built within ``seconds``."""
        until = None if seconds is None else time.perf_counter() + seconds
        while (serving := self._serving(now, commit)) is None:
            self.begin(now, commit)
            pending = self._pending
            assert pending is not None
            try:
                built = pending.future.result(None if until is None else max(0.0, until - time.perf_counter()))
            except TimeoutError:
                return None
            finally:
                if pending.future.done():
                    self._pending = None
            if self._timed is not None and self._timed.is_other_part_of(built):
                self._other_timed = self._timed
            elif self._other_timed is not None and not self._other_timed.is_other_part_of(built):
                self._other_timed = None
            self._timed = built
            if pending.commit.time == commit.time:
                return built
        if serving.instead_of is now:
            return serving
        if serving is self._other_timed:
            self._timed, self._other_timed = serving, self._timed
        if serving.near and self._other_timed is None and self._pending is None:  # for when the robot has left them
            task = partial(self._built, now, commit, is_far=True)
            self._pending = _PendingGraph(now, commit, self._worker.begin(task))
        return serving

    def _serving(self, now: DriveSurroundings, commit: Commit) -> TimedDriveGraph | None:
        """Return a graph on a clock, already built, for queries that start at a commit; None if there is none.

        This may be a graph with people who stop before the robot, built because no other path leads on.
        """
        untimed = self._untimed
        if untimed is None:
            return None
        graphs = [graph for graph in (self._timed, self._other_timed) if graph is not None]
        if refusing := next((graph for graph in graphs if graph.refuses(now, commit, untimed)), None):
            return refusing
        if untimed.world is not now.problem.world:
            return None
        return next((graph for graph in graphs if graph.serves(now, commit, untimed)), None)

    def stopping(self, now: DriveSurroundings, commit: Commit) -> DriveSurroundings | None:
        """Return the surroundings in which people stop who would walk into the robot; None if there are no such people.

        They are used if no path leads on from the commit, the next place where the plan may change.
        """
        if self._timed is not None and self._timed.instead_of is now:
            return self._timed.stopping
        return now.with_people_who_stop(commit.places.states, commit.places.times)

    def ready(self, now: DriveSurroundings, commit: Commit) -> None:
        """Wait until the graph on a clock for queries that start at a commit is built, however long this takes."""
        built = self.timed_graph(now, commit)
        assert built is not None
        if built.instead_of is not now:
            self._timed = self._passable(now, commit, built)

    def _built(
        self, now: DriveSurroundings, commit: Commit, *, is_far: bool = False, beside: bool = False
    ) -> TimedDriveGraph:
        """Build the graph on a clock for queries that start at a commit (where the plan may change next).

        With ``is_far`` it is only for later queries, when no person is near the robot any more. With ``beside`` the
        commit is joined to the graph even if it is one of its nodes.
        """
        base = untimed = self._without_time(now)
        node = int(untimed.nodes(commit.state)[0])
        if node < 0 or beside:
            untimed = untimed.from_beside(now.at(commit.state, commit.time), commit.state, always=beside)
            node = untimed.beginning(commit.state)
        options = self.planner.time_options
        if options.arrive_by is not None:  # counted from when the robot left
            left = options.arrive_by - (now.since - self._began)
            options = replace(options, arrive_by=max(left, options.tick))
        built = TimedDriveGraph.laid_out(
            untimed, base, node, commit, now, self.objectives, options, self._timed, is_far=is_far
        )
        _ = built.prepared  # ahead of the next query
        return built if is_far or beside else self._passable(now, commit, built)

    def _passable(self, now: DriveSurroundings, commit: Commit, built: TimedDriveGraph) -> TimedDriveGraph:
        """Return ``built``; if it has no path, a graph joined at the commit, or a graph with people who stop."""
        if not built.is_shut(commit, RECHECK):
            return built
        if now.touched(commit.state, commit.time):
            with suppress(QueryError):  # no motion leads from there to the graph
                beside = self._built(now, commit, beside=True)
                if not beside.is_shut(commit, RECHECK):
                    return beside
        stopping = now.with_people_who_stop(commit.places.states, commit.places.times)
        if stopping is None:
            return built
        if stopping.moving:
            built = self._built(stopping, commit)
        return replace(built, instead_of=now, stopping=stopping)

    def _without_time(self, now: DriveSurroundings) -> DriveGraph:
        """Return the graph with only the criteria that do not depend on time, among the present people."""
        world = now.problem.world
        if self._untimed is not None and self._untimed.world is world:
            return self._untimed
        if self._untimed is None:  # the other thread leaves a core to the drive
            space = run_speed_graph(replace(self._inner(now), spending=Spending(cores=max(1, CORES - 1))))
        else:
            space = self._untimed.inner
        timed = reading_time(self.objectives.optimised, space.costed_in(world))
        criteria = tuple(c for j, c in enumerate(self.objectives.optimised) if j not in timed)
        objectives = replace(self.objectives, optimised=criteria or (make_criterion("duration"),))
        if self._untimed is None or self._untimed.query.objectives.optimised != objectives.optimised:
            problem = now.problem.at(self.problem.start, 0.0)
            self._untimed = DriveGraph.laid_out(self.planner.name, space, problem, objectives, now.closed)
        else:
            people_change = self._untimed.world.content.people != now.people
            self._untimed = self._untimed.changed(world, now.closed, people=people_change)
        return self._untimed

    def _search(
        self,
        now: DriveSurroundings,
        problem: Problem,
        commit: Commit,
        present: Trajectory | None,
        deadline: float | None,
        answer: Mapping[str, Any] | None,
    ) -> ReplanResult:
        """Search on the graph without a clock, beginning with known paths."""
        began = time.perf_counter()
        if deadline is not None and not self.is_built(now, 0.0):
            clear = self._clear(now, problem, commit, present, 0.5 * deadline)
            if not self.is_built(now, deadline - (time.perf_counter() - began)):
                return known_result(self.planner.name, problem, self.objectives, clear)
            deadline = max(0.0, deadline - (time.perf_counter() - began))
        graph = self.graph(now)
        node = int(graph.nodes(commit.state)[0])
        known, present_arcs, prepared = list[IntArray](), None, self._prepared
        if self._tours is not None and problem.tour is not None:
            layered = self._tours.at(graph, problem.tour)
            if node < 0:
                layered = layered.from_beside(problem)
                node = layered.base.beginning(commit.state)
            graph, node = layered, layered.node(node, problem.tour)
            if answer is None:
                known, prepared = self._tours.known(layered, node), self._tours.prepared(layered)
        elif node < 0:
            graph = graph.from_beside(problem)
            node, prepared = graph.beginning(commit.state), graph.prepared() if answer is None else None
        elif answer is None:
            assert self._routes is not None
            last = graph.known_routes(self._last_paths)
            known = [arcs for routes in (self._routes, last) for arcs in routes.remaining(node)]
            present_arcs = None if present is None else graph.all_arcs(present)
        if answer is None:
            assert prepared is not None
            paths = graph.remaining_paths(prepared, node, known, present_arcs, deadline)
        else:
            paths = graph.restored(node, answer)
        if self._tours is not None:
            self._tours.keep(graph, paths.places)
        elif graph is self._graph:
            self._last_paths = paths.places
        logged_result = None
        if not paths.status.is_final:
            gap = paths.gap if math.isfinite(paths.gap) else None
            arcs = [arcs.tolist() for arcs in paths.places]
            logged_result = {
                "status": str(paths.status),
                "gap": gap,
                "labels": paths.stats.labels_generated,
                "arcs": arcs,
            }
        lost = graph.unreachable(node) if paths.status is Status.NO_PATH else ()
        candidates = of_remaining(graph.candidates(node, paths), problem)
        return ReplanResult(candidates, paths.gap, paths.stats.labels_generated, logged_result, lost)

    def is_built(self, now: DriveSurroundings, seconds: float) -> bool:
        """Return whether the graph without a clock is built, after waiting for ``seconds`` if another thread builds it.

        The first call begins to build it.
        """
        if self._graph is None and self._building is None:
            self._building = LatestOnlyWorker().begin(partial(self._laid_out, now))
        return self._building is None or bool(wait([self._building], max(0.0, seconds)).done)

    def graph(self, now: DriveSurroundings) -> DriveGraph:
        """Return the graph with the present costs and closed areas; it is built at the first call."""
        if self._building is not None:
            building, self._building = self._building, None
            building.result()
        return self._laid_out(now)

    def _laid_out(self, now: DriveSurroundings) -> DriveGraph:
        before = self._graph
        if self._graph is None:
            problem = now.problem.at(self.problem.start, 0.0)
            self._graph = DriveGraph.laid_out(self.planner.name, self._inner(now), problem, self.objectives, now.closed)
            self._arcs = [] if self._tours is not None else self._graph.arcs_of(self._trajectories)
        elif self._graph.world is now.problem.world:
            return self._graph
        else:
            people_change = self._graph.world.content.people != now.people
            self._graph = self._graph.changed(now.problem.world, now.closed, people=people_change)
        if self._tours is not None:
            self._tours.at(self._graph)  # ahead of the next query
            return self._graph
        self._routes = self._graph.known_routes(self._arcs)
        self._prepared = self._graph.prepared(before, self._prepared)  # ahead of the next query
        return self._graph

    def _inner(self, now: DriveSurroundings) -> StateGraph:
        """Return the planner's graph of states in the bare world, without people and named keep-out zones."""
        family = self.planner.graph_of_drives
        states = None if family is None else family.states(self.problem)
        if states is None:
            raise DriveError(NO_GRAPH.format(self.planner.name))
        return states if states.world is now.bare else replace(states, world=now.bare)
