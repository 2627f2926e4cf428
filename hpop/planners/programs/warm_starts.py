"""What planners start from: the trajectories of another planner, of a front, or given as they are."""

from __future__ import annotations

import dataclasses
from collections.abc import Generator, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

from hpop.base.arrays import FloatArray
from hpop.base.registry import planners
from hpop.base.text import counted, shown
from hpop.criteria.base import Criterion
from hpop.errors import OptionError
from hpop.frontier import Front
from hpop.motions import HOLD
from hpop.planners.base import Candidates, Planner, driven, joined, make_planner, stages_of
from hpop.planners.judgement import judge
from hpop.planners.needs import refuse_moving, refuse_unsupported
from hpop.planners.programs.polyline import Polyline, straightened
from hpop.planners.spending import LEAST
from hpop.runtime.status import ProgressCallback, Status, Watch
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

WarmStart = str | Mapping[str, Mapping[str, Any]] | Front[Trajectory] | Sequence[Trajectory]
SHARED = ("step", "headings")
SHARE = 0.5  # of a time limit that the planner of the warm starts may take
FORMS = "the name of a planner, {name: options}, a front, or a list of trajectories"


class Starting(Protocol):
    """A planner that starts from known trajectories, and its options that it shares with another that finds them.

    Those that it may have beside these: SHARED.
    """

    @property
    def warm_start(self) -> WarmStart: ...
    @property
    def time_limit(self) -> float | None: ...


class WarmStarts(NamedTuple):
    """What is known: moves and turns in place from start to goal.

    status       how the planner ended that found them
    notes        what the user should know of them
    interrupted  what an interrupted planner found, of which nothing goes on: it is kept instead
    found        what the planner found that was named
    """

    trajectories: Sequence[Trajectory]
    status: Status
    notes: tuple[str, ...]
    interrupted: Candidates | None = None
    found: Candidates | None = None

    def kept(self, after: Candidates, improved: Iterable[int]) -> Candidates:
        """Return what a plan found; where a limit or Ctrl-C stopped it, also the warm starts that it did not improve.

        Warm starts that were given are known to the user already, and are not returned.

        Parameters
        ----------
        improved : places of the warm starts from which a candidate came
        """
        stopped = after.status in (Status.TIME_LIMIT, Status.MEMORY_LIMIT, Status.INTERRUPTED)
        if not stopped or self.found is None:
            return after
        name = after.stats.get("planner", "it")
        if not after.trajectories:
            note = f"{after.status}: {name} found nothing until then; these are its warm starts as they were found"
            return replace(
                self.found,
                status=after.status,
                certificate=f"{name}: incomplete ({after.status}), its warm starts; {self.found.certificate}",
                notes=(note, *after.notes),
                stats={**self.found.stats, **after.stats},
            )
        gone = {driven(self.trajectories[i]) for i in improved}
        left = [i for i, trajectory in enumerate(self.found.trajectories) if driven(trajectory) not in gone]
        if not left or self.found.objectives != after.objectives:
            return after
        others = self.found.some(left)
        return replace(
            joined(others, after),
            certificate=f"{after.certificate}; warm starts that were not improved: {others.certificate}",
            notes=(
                f"{after.status}: {counted(len(left), 'warm start')} from which nothing better came until then "
                f"{'are' if len(left) > 1 else 'is'} returned as found",
                *after.notes,
            ),
        )

    def polylines(
        self, problem: Problem, criteria: Sequence[Criterion]
    ) -> tuple[WarmStarts, list[Polyline], FloatArray, tuple[str, ...]]:
        """Return those that are free with their ends put on start and goal, their costs (n, k), notes on the others."""
        polylines = [Polyline.of(trajectory, problem) for trajectory in self.trajectories]
        judged = judge(problem, criteria, [polyline.trajectory(problem.model) for polyline in polylines])
        free = self._replace(trajectories=[self.trajectories[i] for i in judged.kept])
        return free, [polylines[i] for i in judged.kept], judged.costs[judged.kept], judged.notes("warm starts")

    def ended(self, status: Status) -> Status:
        """The status of a plan that went on from these, and ended with one."""
        return self.status if status is Status.COMPLETE else status


def check_warm_start(starting: Starting) -> None:
    """Raise OptionError for what is none, names no planner or gives it options that it does not take."""
    spec = starting.warm_start
    if isinstance(spec, str | Mapping):
        warm_planner(starting)
    elif not isinstance(spec, Front) and not _are_trajectories(spec):
        raise OptionError(f"warm_start is {FORMS}, got {shown(spec)}")
    elif not len(spec):
        raise OptionError("warm_start has no trajectory to start from; give some, or the name of a planner")


def warm_starts(
    starting: Starting,
    problem: Problem,
    progress: ProgressCallback | None,
    executor: Executor | None,
    left: float | None = None,
) -> WarmStarts:
    """The trajectories that a planner starts from, curves replaced by polylines.

    Those of a planner are planned now, on the executor if it sweeps; its front counts. Those that are given must be of
    the problem's model. Holds are left out: no planner moves them. SHARE of the seconds that are left, if they are
    limited, may be spent on it; where that was too little to find any, all of them, as some warm starts are worth more
    than none.

    Raises OptionError for trajectories of another model, and what the planner raises.
    """
    watch, planner = Watch("warm starts", left), _planner_of(starting, problem, left)
    if planner is None:
        known = _given(starting, problem)
    else:
        refuse_moving(problem, f"warm start by {planner.name}")
        known = _last(known_trajectories(starting, problem, progress, executor, left))
        if known.status is Status.TIME_LIMIT and not known.trajectories and left is not None and not watch.is_late():
            known = _last(known_trajectories(starting, problem, progress, executor, (left - watch.seconds) / SHARE))
    straight, curves = straightened(known.trajectories, problem)
    return known._replace(trajectories=straight, notes=(*known.notes, *curves, *_contact(problem)))


def _contact(problem: Problem) -> list[str]:
    """A note where the robot starts in contact with people: what is free of them is judged, not programmed."""
    content = problem.world.content
    who = ", ".join(content.people[i].name or f"number {i}" for i in content.left)
    note = f"programs do not see {who}, with whom the robot starts in contact: what would touch them again is dropped"
    return [note] if who else []


def _last(stages: Generator[Candidates, None, WarmStarts]) -> WarmStarts:
    """What comes of the last of some stages."""
    while True:
        try:
            next(stages)
        except StopIteration as end:
            return cast(WarmStarts, end.value)


def known_trajectories(
    starting: Starting,
    problem: Problem,
    progress: ProgressCallback | None,
    executor: Executor | None,
    left: float | None = None,
) -> Generator[Candidates, None, WarmStarts]:
    """The same as they are, curves too, returned after what each stage of their planner but the last finds."""
    planner = _planner_of(starting, problem, left)
    if planner is None:
        return _given(starting, problem)
    found: Candidates | None = None
    for now in stages_of(planner, problem, progress, executor):
        if now.status is Status.UNFINISHED:
            yield now
        found = now if now.status.is_final else joined(found, now)
    assert found is not None  # a planner has at least one stage
    return _planned(found, problem)


def _planner_of(starting: Starting, problem: Problem, left: float | None) -> Planner | None:
    """The planner of the warm starts, if they are not given; it may spend SHARE of the seconds that are left."""
    if not isinstance(starting.warm_start, str | Mapping):
        return None
    planner = warm_planner(starting, time_limit=None if left is None else max(LEAST, SHARE * left))
    refuse_unsupported(planner, problem.model)
    return planner


def _given(starting: Starting, problem: Problem) -> WarmStarts:
    spec = starting.warm_start
    given = spec.items if isinstance(spec, Front) else cast(Sequence[Trajectory], spec)
    if any(trajectory.model != problem.model for trajectory in given):
        raise OptionError("warm_start has trajectories of another model than the problem's; plan with that one")
    return _moving(given, Status.COMPLETE, ())


def _planned(found: Candidates, problem: Problem) -> WarmStarts:
    """What a planner found, to go on from unless it was interrupted, then or while it is re-evaluated."""
    status = found.status
    if status is Status.INTERRUPTED:
        return _interrupted(found)
    try:
        given: Sequence[Trajectory] = problem.front(found).trajectories if found.trajectories else ()
    except KeyboardInterrupt:
        return _interrupted(found)
    if not given:
        return WarmStarts((), status, (f"no warm start: {status}", *found.notes))
    notes = () if status.is_final else (f"the warm starts are not all there are: {status}",)
    return _moving(given, status, notes)._replace(found=found)


def _interrupted(found: Candidates) -> WarmStarts:
    """What a planner found, from which nothing goes on."""
    status, known = Status.INTERRUPTED, counted(len(found.trajectories), "warm start")
    note = f"{status}: kept what was found until then, {known}, from which nothing goes on"
    return WarmStarts((), status, (), replace(found, status=status, notes=(note, *found.notes)))


def _moving(given: Sequence[Trajectory], status: Status, notes: tuple[str, ...]) -> WarmStarts:
    """Trajectories without their holds, which a note tells of."""
    if holds := sum(HOLD.kind in trajectory.kinds for trajectory in given):
        note = f"{holds} of the warm starts hold on their way: nobody stands still in what starts from them"
        return WarmStarts([trajectory.without_holds() for trajectory in given], status, (*notes, note))
    return WarmStarts(given, status, notes)


def warm_planner(starting: Starting, *, time_limit: float | None = None) -> Planner:
    """The planner that is named, with those of the options that it has.

    One that comes with options of its own, ``{name: {option: value}}``, shares the time limit alone, and that only if
    it has none.

    Raises OptionError for what names no planner or gives it options that it does not take.
    """
    spec = starting.warm_start
    if isinstance(spec, Mapping):
        if len(spec) != 1:
            raise OptionError(f"warm_start is one planner with its options, got {shown(spec)}")
        ((name, own),) = spec.items()
        if not isinstance(own, Mapping | None):
            raise OptionError(f"warm_start gives the options of {shown(name)} by their names, got {shown(own)}")
        shared: dict[str, Any] = {} if time_limit is None else {"time_limit": time_limit}
    else:
        name, own = str(spec), {}
        shared = {name: getattr(starting, name) for name in SHARED if hasattr(starting, name)}
        shared["time_limit"] = time_limit
    known = {option.name for option in dataclasses.fields(planners[name])}
    return make_planner(name, {option: v for option, v in shared.items() if option in known} | dict(own or {}))


def _are_trajectories(spec: Any) -> bool:
    return isinstance(spec, Sequence) and all(isinstance(item, Trajectory) for item in spec)
