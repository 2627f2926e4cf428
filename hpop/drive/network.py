"""What is asked of the planner of a drive: the graph is laid out once and kept, as is what was found on it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from hpop.base.arrays import IntArray
from hpop.criteria.base import make_criterion
from hpop.drive.options import Commit
from hpop.drive.surroundings import Surroundings
from hpop.drive.timed_ways import TimedPlan, TimedWays, clear_ways, rechecked, rests_from
from hpop.drive.ways import Known, Ways
from hpop.errors import DriveError
from hpop.planners.base import Candidates, Planner
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.timed.clock import GOLDEN, TimeOptions
from hpop.planners.graphs.timed.presence import reading_time
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import CORES, Spending
from hpop.runtime.status import Status
from hpop.search.prepared import Prepared
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

T = TypeVar("T")


class Aside:
    """Tasks in another thread, one after another. What waits is canceled where something later is asked for.

    The thread ends with its last task, and with the process, whatever it does then.
    """

    def __init__(self) -> None:
        """With nothing to do."""
        self._lock, self._busy = Lock(), False
        self._next: tuple[Future[Any], Callable[[], Any]] | None = None

    def begin(self, task: Callable[[], T]) -> Future[T]:
        """Begin a task as soon as the one that is under way is done."""
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
                except BaseException as error:  # whoever asks for the result hears of it
                    future.set_exception(error)


LOOK = (
    0.05  # s of this thread's processor time in which known ways are looked at again, also where a deadline is shorter
)


class Found(NamedTuple):
    """What was found from where a drive may leave its plan.

    gap     every missing vector is covered by one that was found within the factor 1 + gap
    labels  count  partial paths that the search made
    answer  where a deadline cut it short, what was found, as JSON, by which it is repeated; else None
    """

    candidates: Candidates
    gap: float
    labels: int
    answer: dict[str, Any] | None


class _Making(NamedTuple):
    """A graph on a clock that is being made.

    surroundings, commit  for which it is
    """

    surroundings: Surroundings
    commit: Commit
    future: Future[TimedWays]


class Network:
    """The graph of a drive between its changes, and the ways that are known on it."""

    def __init__(self, problem: Problem, planner: Planner, ways: Sequence[Trajectory], begin: float = 0.0) -> None:
        """Of a robot that leaves at a time of the drive, s."""
        self.problem, self.planner = problem, planner
        self.objectives = edge_objectives(problem.criteria, planner.name)
        self._given = tuple(ways)
        self._ways: Ways | None = None
        self._prepared: Prepared | None = None  # for searches on these ways
        self._arcs: list[IntArray] = []  # of the ways that were given
        self._known: Known | None = None
        self._last: list[IntArray] = []  # what was found last
        self._began = float(begin)
        self._without: Ways | None = None  # while people move: without costs that read the time
        self._among: TimedWays | None = None
        self._other: TimedWays | None = None  # where nobody is near the robot, if somebody was, or the other way round
        self._met: list[TimedPlan] = []  # what was found last among them
        self._met_on: object = None  # the graph whose arcs these are
        self._driven: Sequence[Trajectory] = ()  # the same as trajectories
        self._aside = Aside()
        self._making: _Making | None = None

    def found(
        self,
        now: Surroundings,
        commit: Commit,
        kept: Trajectory | None,
        deadline: float | None,
        answer: Mapping[str, Any] | None = None,
    ) -> Found:
        """Ways from a commit on, as the world is now.

        kept      the present plan from there, if it is open
        deadline  s of this thread's processor time, None for none
        answer    what was found when this was asked before, if a deadline cut that short
        """
        problem = now.at(commit.state, commit.time)
        if now.moving:
            return self._in_time(now, problem, commit, kept, deadline, answer)
        return self._on_graph(now, problem, commit, kept, deadline, answer)

    def _in_time(
        self,
        now: Surroundings,
        problem: Problem,
        commit: Commit,
        kept: Trajectory | None,
        deadline: float | None,
        answer: Mapping[str, Any] | None,
    ) -> Found:
        """What a search on a clock finds among people who move, beside what is known."""
        if answer is not None and "ways" in answer:
            ways = [Trajectory.from_description(problem.model, way) for way in answer["ways"]]
            return self._rechecked(problem, ways)
        began = time.perf_counter()
        among = self.among(now, commit, None if deadline is None else 0.0)
        if among is None:
            assert deadline is not None
            known = [] if kept is None else [kept]
            known += self._clear(now, problem, commit, 0.5 * deadline)
            among = self.among(now, commit, deadline - LOOK - (time.perf_counter() - began))
            if among is None:
                return self._rechecked(problem, known)
            deadline = max(0.0, deadline - (time.perf_counter() - began))
        if among.instead_of is now:
            nothing = replace(rechecked(self.planner.name, problem, self.objectives, []), status=Status.NO_PATH)
            return Found(nothing, math.inf, 0, None)
        node = among.node(commit.state)
        node = among.start if node < 0 else node
        if answer is None:
            given = among.plans(self._given, self._began)
            present = [] if kept is None else among.plans([kept], commit.time)
            met = self._met if self._met_on is among.ways.query.space else []  # other ends number arcs differently
            paths = among.rests(node, commit.time, [*present, *given, *met], deadline)
        else:
            paths = among.told(node, commit.time, answer)
        self._met, self._met_on = among.found(paths), among.ways.query.space
        again = None if paths.status.is_final else among.described(paths)
        candidates = among.candidates(self.planner.name, problem, commit, node, paths)
        self._driven = candidates.trajectories
        return Found(candidates, paths.gap, paths.stats.labels_generated, again)

    def _clear(self, now: Surroundings, problem: Problem, commit: Commit, seconds: float) -> list[Trajectory]:
        """Known ways from a commit on that are open and clear of people: those that some seconds let one look at."""
        until, least = time.perf_counter() + seconds, time.thread_time() + LOOK

        def enough() -> bool:
            return time.perf_counter() >= until and time.thread_time() >= least

        options: TimeOptions = self.planner.time_options
        latest = None if options.arrive_by is None else options.arrive_by - (commit.time - self._began)
        known = (*self._driven, *self._given)
        spread = sorted(range(len(known)), key=lambda i: i * GOLDEN % 1.0)  # neighbours in a front are much alike
        ways = rests_from((known[i] for i in spread), commit.state)
        return [*clear_ways(ways, problem, commit.before, now.closed, options.margin, latest, enough)]

    def _rechecked(self, problem: Problem, ways: Sequence[Trajectory]) -> Found:
        """Known ways that are open and clear, while the graph on the clock is being made."""
        answer = {"ways": [way.describe() for way in ways]}
        return Found(rechecked(self.planner.name, problem, self.objectives, ways), math.inf, 0, answer)

    # The graph on the clock is made beside the drive

    def begin(self, now: Surroundings, commit: Commit) -> None:
        """Begin to make the graph on a clock among the people of now, for questions from a commit on."""
        is_made = self._making is not None and self._making.surroundings is now
        if not is_made and self._serving(now, commit) is None:
            self._making = _Making(now, commit, self._aside.begin(partial(self._made, now, commit)))

    def among(self, now: Surroundings, commit: Commit, seconds: float | None = None) -> TimedWays | None:
        """The graph on a clock among the people of now, for questions from a commit on; kept while it serves them.

        None where it is not made within some seconds, by the clock; it is being made then.
        """
        until = None if seconds is None else time.perf_counter() + seconds
        while (serving := self._serving(now, commit)) is None:
            self.begin(now, commit)
            making = self._making
            assert making is not None
            try:
                made = making.future.result(None if until is None else max(0.0, until - time.perf_counter()))
            except TimeoutError:
                return None
            finally:
                if making.future.done():
                    self._making = None
            if self._among is not None and self._among.is_other_part_of(made):
                self._other = self._among
            elif self._other is not None and not self._other.is_other_part_of(made):
                self._other = None
            self._among = made
            if making.commit.time == commit.time:
                return made
        if serving.instead_of is now:
            return serving
        if serving is self._other:
            self._among, self._other = serving, self._among
        if serving.near and self._other is None and self._making is None:  # ahead of when the robot has left them
            self._making = _Making(now, commit, self._aside.begin(partial(self._made, now, commit, is_far=True)))
        return serving

    def _serving(self, now: Surroundings, commit: Commit) -> TimedWays | None:
        """The graph that has the answers to questions from a commit on, if it is there."""
        ways = self._without
        if ways is None:
            return None
        graphs = [made for made in (self._among, self._other) if made is not None]
        if refusing := next((made for made in graphs if made.refuses(now, commit, ways)), None):
            return refusing
        if ways.world is not now.problem.world:
            return None
        return next((made for made in graphs if made.serves(now, commit, ways)), None)

    def stopping(self, now: Surroundings, commit: Commit) -> Surroundings | None:
        """Return the surroundings in which people stop before a robot for which no path leads from a commit.

        None where nobody walks against it.
        """
        if self._among is not None and self._among.instead_of is now:
            return self._among.stopping
        return now.with_people_who_stop(commit.places.states, commit.places.times)

    def ready(self, now: Surroundings, commit: Commit) -> None:
        """Wait until questions from a commit on have their graph, however long that takes."""
        made = self.among(now, commit)
        assert made is not None
        if made.instead_of is not now:
            self._among = self._passable(now, commit, made)

    def _made(self, now: Surroundings, commit: Commit, *, is_far: bool = False) -> TimedWays:
        """The graph on a clock for questions from a commit on, or for later ones with nobody near; ready for them."""
        base = ways = self._plain(now)
        node = int(ways.nodes(commit.state)[0])
        if node < 0:
            ways = ways.from_beside(now.at(commit.state, commit.time))
            node = ways.query.start
        options = self.planner.time_options
        if options.arrive_by is not None:  # since the robot left
            left = options.arrive_by - (now.since - self._began)
            options = replace(options, arrive_by=max(left, options.tick))
        made = TimedWays.laid_out(ways, base, node, commit, now, self.objectives, options, self._among, is_far=is_far)
        _ = made.prepared  # ahead of the next question
        return made if is_far else self._passable(now, commit, made)

    def _passable(self, now: Surroundings, commit: Commit, made: TimedWays) -> TimedWays:
        """The graph, or that among people who stop before a robot for which no path leads from a commit."""
        node = made.node(commit.state)
        node = made.start if node < 0 else node
        if made.prepared.paths(node, made.tick(commit.time), deadline=LOOK).status is not Status.NO_PATH:
            return made
        stopping = now.with_people_who_stop(commit.places.states, commit.places.times)
        if stopping is None:
            return made
        if stopping.moving:
            made = self._made(stopping, commit)
        return replace(made, instead_of=now, stopping=stopping)

    def _plain(self, now: Surroundings) -> Ways:
        """The graph with the costs that read no time, among the people of now."""
        world = now.problem.world
        if self._without is not None and self._without.world is world:
            return self._without
        if self._without is None:  # what is made beside the drive leaves a core to it
            space = replace(self._inner(now), spending=Spending(cores=max(1, CORES - 1)))
        else:
            space = self._without.inner
        timed = reading_time(self.objectives.optimised, space.costed_in(world))
        criteria = tuple(c for j, c in enumerate(self.objectives.optimised) if j not in timed)
        objectives = replace(self.objectives, optimised=criteria or (make_criterion("duration"),))
        if self._without is None or self._without.query.objectives.optimised != objectives.optimised:
            problem = now.problem.at(self.problem.start, 0.0)
            self._without = Ways.laid_out(self.planner.name, space, problem, objectives, now.closed)
        else:
            others = self._without.world.content.people != now.people
            self._without = self._without.changed(world, now.closed, people=others)
        return self._without

    def _on_graph(
        self,
        now: Surroundings,
        problem: Problem,
        commit: Commit,
        kept: Trajectory | None,
        deadline: float | None,
        answer: Mapping[str, Any] | None,
    ) -> Found:
        """What a search on the graph finds, beside what is known."""
        ways = self.ways(now)
        node = int(ways.nodes(commit.state)[0])
        rests, present, prepared = list[IntArray](), None, self._prepared
        if node < 0:
            ways = ways.from_beside(problem)
            node, prepared = ways.query.start, ways.prepared() if answer is None else None
        elif answer is None:
            assert self._known is not None
            rests = [arcs for known in (self._known, ways.known(self._last)) for arcs in known.rests(node)]
            present = None if kept is None else ways.whole_way(kept)
        if answer is None:
            assert prepared is not None
            paths = ways.rests(prepared, node, rests, present, deadline)
        else:
            paths = ways.told(node, answer)
        if ways is self._ways:
            self._last = paths.places
        again = None
        if not paths.status.is_final:
            gap = paths.gap if math.isfinite(paths.gap) else None
            arcs = [arcs.tolist() for arcs in paths.places]
            again = {"status": str(paths.status), "gap": gap, "labels": paths.stats.labels_generated, "arcs": arcs}
        return Found(ways.candidates(node, paths), paths.gap, paths.stats.labels_generated, again)

    def ways(self, now: Surroundings) -> Ways:
        """The graph with the costs and closings of now; laid out when it is first asked for."""
        before = self._ways
        if self._ways is None:
            problem = now.problem.at(self.problem.start, 0.0)
            self._ways = Ways.laid_out(self.planner.name, self._inner(now), problem, self.objectives, now.closed)
            self._arcs = self._ways.ways_of(self._given)
        elif self._ways.world is now.problem.world:
            return self._ways
        else:
            others = self._ways.world.content.people != now.people
            self._ways = self._ways.changed(now.problem.world, now.closed, people=others)
        self._known = self._ways.known(self._arcs)
        self._prepared = self._ways.prepared(before, self._prepared)  # ahead of the next question
        return self._ways

    def _inner(self, now: Surroundings) -> StateGraph:
        """The planner's graph of states, in the bare world."""
        family = self.planner.graph_of_drives
        made = None if family is None else family.states(self.problem)
        if made is None:
            raise DriveError(
                f"a drive is followed on a lattice, or on a roadmap of positions; {self.planner.name!r} has neither "
                "for this robot: give planner='lattice'"
            )
        return made if made.world is now.bare else replace(made, world=now.bare)
