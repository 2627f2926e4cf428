"""Warm starts: known trajectories that a planner improves, from another planner, a front or a list."""

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
from hpop.frontier import ItemFront
from hpop.motions import HOLD
from hpop.planners.base import Candidates, Planner, joined, make_planner, motions_key, stages_of
from hpop.planners.judgement import judge
from hpop.planners.needs import check_goal, refuse_moving, refuse_unsupported
from hpop.planners.programs.polyline import Polyline, straightened
from hpop.planners.spending import LEAST
from hpop.runtime.limits import ProgressCallback, Status, Watch
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

WarmStart = str | Mapping[str, Mapping[str, Any]] | ItemFront[Trajectory] | Sequence[Trajectory]
SHARED = ("step", "headings")  # options that a planner passes on to the planner of its warm starts
SHARE = 0.5  # share of the time limit that the planner of the warm starts may take
FORMS = "the name of a planner, {name: options}, a front, or a list of trajectories"


class Starting(Protocol):
    """Interface of a planner that improves known paths (warm starts): the options that this module reads.

    It may also have the options named in SHARED. If ``warm_start`` is the name of a planner without options, that
    planner gets their values.
    """

    @property
    def warm_start(self) -> WarmStart: ...
    @property
    def time_limit(self) -> float | None: ...


class WarmStarts(NamedTuple):
    """Trajectories from start to goal that a planner will improve.

    status       status of the planner that found them
    notes        lines for the user, such as how many curves were replaced
    interrupted  candidates of the planner that found them, if Ctrl-C interrupted it; they are then the final result
    candidates   candidates of the planner that found them; None if it found none, if it was interrupted, or if the user
                 passed the trajectories
    """

    trajectories: Sequence[Trajectory]
    status: Status
    notes: tuple[str, ...]
    interrupted: Candidates | None = None
    candidates: Candidates | None = None

    def with_unimproved(self, after: Candidates, improved: Iterable[int]) -> Candidates:
        """Return the candidates of a planner, with the warm starts not yet improved if it was stopped.

        They are added after Ctrl-C, a time limit or a memory limit. Warm starts that the user passed are not added.

        Parameters
        ----------
        after : candidates of the planner that started from these warm starts
        improved : indices of the warm starts from which a candidate came
        """
        stopped = after.status in (Status.TIME_LIMIT, Status.MEMORY_LIMIT, Status.INTERRUPTED)
        if not stopped or self.candidates is None:
            return after
        name = after.stats.get("planner", "it")
        if not after.trajectories:
            note = f"{after.status}: {name} had found no path by then; its warm starts are returned unchanged"
            return replace(
                self.candidates,
                status=after.status,
                certificate=f"{name}: incomplete ({after.status}), its warm starts; {self.candidates.certificate}",
                notes=(note, *after.notes),
                stats={**self.candidates.stats, **after.stats},
            )
        improved_keys = {motions_key(self.trajectories[i]) for i in improved}
        indices = [
            i
            for i, trajectory in enumerate(self.candidates.trajectories)
            if motions_key(trajectory) not in improved_keys
        ]
        if not indices or self.candidates.objectives != after.objectives:
            return after
        unimproved = self.candidates.subset(indices)
        return replace(
            joined(unimproved, after),
            certificate=f"{after.certificate}; warm starts that were not improved: {unimproved.certificate}",
            notes=(
                f"{after.status}: {counted(len(indices), 'warm start')} that were not improved by then "
                f"{'are' if len(indices) > 1 else 'is'} returned unchanged",
                *after.notes,
            ),
        )

    def polylines(
        self, problem: Problem, criteria: Sequence[Criterion]
    ) -> tuple[WarmStarts, list[Polyline], FloatArray, tuple[str, ...]]:
        """Drop the warm starts that collide, and return the n others, also as polylines.

        The result has these n warm starts, their polylines from exact start to exact goal, the costs (n, k) of the
        polylines, and notes on the warm starts that were dropped.
        """
        polylines = [Polyline.of(trajectory, problem) for trajectory in self.trajectories]
        judged = judge(problem, criteria, [polyline.trajectory(problem.model) for polyline in polylines])
        rows = judged.accepted_rows
        free = self._replace(trajectories=[self.trajectories[i] for i in rows])
        return free, [polylines[i] for i in rows], judged.costs[rows], judged.notes("warm starts")

    def ended(self, status: Status) -> Status:
        """Return the status of a planner that ended with ``status``: COMPLETE only if its warm starts are complete too.

        If the planner completed its own work, the status is that of the warm starts.
        """
        return self.status if status is Status.COMPLETE else status


def check_warm_start(starting: Starting) -> None:
    """Raise OptionError if the option ``warm_start`` is not one of FORMS, or has an unknown planner or option."""
    spec = starting.warm_start
    if isinstance(spec, str | Mapping):
        warm_planner(starting)
    elif not isinstance(spec, ItemFront) and not _are_trajectories(spec):
        raise OptionError(f"warm_start must be {FORMS}, got {shown(spec)}")
    elif not len(spec):
        raise OptionError("warm_start needs at least one trajectory, got none; pass some, or the name of a planner")


def warm_starts(
    starting: Starting,
    problem: Problem,
    progress: ProgressCallback | None,
    executor: Executor | None,
    left: float | None = None,
) -> WarmStarts:
    """Return the trajectories that a planner starts from, with curves replaced by polylines and holds removed.

    If ``warm_start`` names a planner, that planner runs now, and the trajectories of its front are used. It may spend
    SHARE of the remaining seconds ``left``; if it finds no path in this time, it is run again with all of them. An
    executor is passed on to it.

    Raises OptionError for trajectories of another model than the problem's, and the errors of the named planner.
    """
    watch, planner = Watch("warm starts", left), _planner_of(starting, problem, left)
    if planner is None:
        starts = _passed_in(starting, problem)
    else:
        refuse_moving(problem, f"warm start by {planner.name}")
        starts = _last(known_trajectories(starting, problem, progress, executor, left))
        if starts.status is Status.TIME_LIMIT and not starts.trajectories and left is not None and not watch.is_late():
            starts = _last(known_trajectories(starting, problem, progress, executor, (left - watch.seconds) / SHARE))
    straight, curves = straightened(starts.trajectories, problem)
    return starts._replace(trajectories=straight, notes=(*starts.notes, *curves, *_contact(problem)))


def known_tours(
    starting: Starting,
    problem: Problem,
    progress: ProgressCallback | None,
    executor: Executor | None,
    left: float | None = None,
) -> WarmStarts:
    """Return the tours that a planner starts from, with their holds; see :func:`warm_starts`."""
    planner = _planner_of(starting, problem, left)
    if planner is not None:
        check_goal(problem, planner)
    return _last(known_trajectories(starting, problem, progress, executor, left, holding=True))


def _contact(problem: Problem) -> list[str]:
    """Return one note if the robot starts in contact with people, else [].

    Nonlinear programs ignore these people, but the final check drops trajectories that touch them again.
    """
    content = problem.world.content
    names = ", ".join(content.people[i].name or f"number {i}" for i in content.left)
    note = (
        f"nonlinear programs ignore {names}, because the robot touches them at its start; trajectories that touch them "
        "again later are dropped"
    )
    return [note] if names else []


def _last(stages: Generator[Candidates, None, WarmStarts]) -> WarmStarts:
    """Run all stages of :func:`known_trajectories`, drop their candidates, and return the warm starts at the end."""
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
    *,
    holding: bool = False,
) -> Generator[Candidates, None, WarmStarts]:
    """Run the planner that ``warm_start`` names: yield the candidates of its early stages, then return the warm starts.

    Curves are kept; holds are removed unless ``holding``. If the user passed trajectories, nothing is yielded.
    ``starting`` is the planner with the option ``warm_start``, and ``left`` its remaining seconds.
    """
    planner = _planner_of(starting, problem, left)
    if planner is None:
        return _passed_in(starting, problem, holding=holding)
    candidates: Candidates | None = None
    for now in stages_of(planner, problem, progress, executor):
        if now.status is Status.UNFINISHED:
            yield now
        candidates = now if now.status.is_final else joined(candidates, now)
    assert candidates is not None  # a planner has at least one stage
    return _planned(candidates, problem, holding=holding)


def _planner_of(starting: Starting, problem: Problem, left: float | None) -> Planner | None:
    """Return the planner that ``warm_start`` names, with a time limit of SHARE of the remaining seconds ``left``.

    The result is None if the user passed trajectories instead.
    """
    if not isinstance(starting.warm_start, str | Mapping):
        return None
    planner = warm_planner(starting, time_limit=None if left is None else max(LEAST, SHARE * left))
    refuse_unsupported(planner, problem.model)
    return planner


def _passed_in(starting: Starting, problem: Problem, *, holding: bool = False) -> WarmStarts:
    """Return the trajectories that the user passed as ``warm_start``, without holds unless ``holding``.

    Raises OptionError if their model is not that of the problem.
    """
    spec = starting.warm_start
    trajectories = spec.items if isinstance(spec, ItemFront) else cast(Sequence[Trajectory], spec)
    if any(trajectory.model != problem.model for trajectory in trajectories):
        raise OptionError(
            "warm_start must have trajectories of the problem's model, got some of another model; plan them with the "
            "problem's model first"
        )
    return WarmStarts(trajectories, Status.COMPLETE, ()) if holding else _moving(trajectories, Status.COMPLETE, ())


def _planned(candidates: Candidates, problem: Problem, *, holding: bool = False) -> WarmStarts:
    """Return the front of a planner's candidates as warm starts, without holds unless ``holding``.

    If Ctrl-C interrupted the planner or the evaluation of the front, there are none to improve (:func:`_interrupted`).
    """
    status = candidates.status
    if status is Status.INTERRUPTED:
        return _interrupted(candidates)
    try:
        trajectories: Sequence[Trajectory] = problem.front(candidates).trajectories if candidates.trajectories else ()
    except KeyboardInterrupt:
        return _interrupted(candidates)
    if not trajectories:
        return WarmStarts((), status, (f"no warm start: {status}", *candidates.notes))
    notes = () if status.is_final else (f"the warm starts are incomplete: {status}",)
    found = WarmStarts(trajectories, status, notes) if holding else _moving(trajectories, status, notes)
    return found._replace(candidates=candidates)


def _interrupted(candidates: Candidates) -> WarmStarts:
    """Return empty warm starts that carry the candidates of an interrupted planner, which are then the result."""
    status, number = Status.INTERRUPTED, counted(len(candidates.trajectories), "warm start")
    note = f"{status}: the result has the warm starts found by then ({number}), none of them improved"
    return WarmStarts((), status, (), replace(candidates, status=status, notes=(note, *candidates.notes)))


def _moving(trajectories: Sequence[Trajectory], status: Status, notes: tuple[str, ...]) -> WarmStarts:
    """Return trajectories as warm starts, without their holds (pauses in place), with a note if there were any."""
    if holds := sum(HOLD.kind in trajectory.kinds for trajectory in trajectories):
        note = f"{holds} of the warm starts pause on their way; the pauses were removed, as this planner plans none"
        return WarmStarts([trajectory.without_holds() for trajectory in trajectories], status, (*notes, note))
    return WarmStarts(trajectories, status, notes)


def warm_planner(starting: Starting, *, time_limit: float | None = None) -> Planner:
    """Return the planner that the option ``warm_start`` names.

    Given by name alone, it gets ``time_limit`` and those of the SHARED options of ``starting`` that it has. Given as
    ``{name: {option: value}}``, it gets these options, and ``time_limit`` unless they set one.

    Raises OptionError for an unknown planner and for unknown options.
    """
    spec = starting.warm_start
    if isinstance(spec, Mapping):
        if len(spec) != 1:
            raise OptionError(f"warm_start must be one planner with its options, {{name: options}}, got {shown(spec)}")
        ((name, options),) = spec.items()
        if not isinstance(options, Mapping | None):
            raise OptionError(
                f"warm_start must give the options of {shown(name)} as {{option: value}}, got {shown(options)}"
            )
        shared: dict[str, Any] = {} if time_limit is None else {"time_limit": time_limit}
    else:
        name, options = str(spec), {}
        shared = {name: getattr(starting, name) for name in SHARED if hasattr(starting, name)}
        shared["time_limit"] = time_limit
    accepted = {option.name for option in dataclasses.fields(planners[name])}
    return make_planner(name, {option: v for option, v in shared.items() if option in accepted} | dict(options or {}))


def _are_trajectories(spec: Any) -> bool:
    return isinstance(spec, Sequence) and all(isinstance(item, Trajectory) for item in spec)
