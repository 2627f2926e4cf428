"""The smoothing planner: polylines become curves that a differential drive really follows, without stops at corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.base.options import set_wholes
from hpop.base.scalars import set_python_values
from hpop.base.text import counted
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import trusted
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs.criteria import minimised, smooth_places
from hpop.planners.programs.nlp import require_ipopt
from hpop.planners.programs.outcome import CUT_SHORT, Deadline, Improved, Outcome, Tally
from hpop.planners.programs.smoothing.job import LATE, SmoothingJob
from hpop.planners.programs.smoothing.phases import FLAT
from hpop.planners.programs.warm_starts import WarmStart, check_warm_start, warm_starts
from hpop.runtime.status import Budget, ProgressCallback, Status, Watch
from hpop.runtime.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "smoothing"
COUNTED = ("programs", "repairs", "saved by quasi-Newton")
MOST_INTERVALS = 2000  # of a program that a solver can still take
RAMPS = (
    "smoothing: driven trajectories begin and end at rest, so their durations include the ramps at start and goal (the "
    "constant v/a), which planned polylines leave out"
)


@planner(NAME)
@dataclass(frozen=True)
class Smoothing:
    """Driven trajectories near known polylines: wheel accelerations as controls, every turn kept, nothing in between.

    step        m      of the lattice whose paths are smoothed
    headings    4, 8 or 16 of that lattice
    minimise    name of the cost that is minimised; None weighs all costs alike, each relative to the polyline's,
                but worst moments a hundredth of that: they are bounded first of all
    intervals   count  of constant wheel accelerations a trajectory; more where its turns need them
    warm_start  what gives the polylines: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s      warm starts included

    Accepts smooth criteria that add up or take the worst moment, and counts that the number of moves and turns settles;
    others are refused by name. Guarantees that every candidate is free of collisions on the exact geometry, within the
    model's wheel speeds and accelerations, has no fewer turns than its polyline, can be deformed into it without
    crossing an obstacle, and costs at most 2 % more in each smooth criterion than the polyline, planned or executed,
    whichever is more. Each is a local optimum for its sequence of turns, or lies where the objective falls no more,
    which is said: a second program corrects what fields and samples of the first are off, and has a hundredth of its
    weights of time and effort. Where that does not converge, the first solution stays, ``settled`` in the provenance is
    false, and a note counts those. The peak
    of the optic flow, whose kinks are everywhere, may not converge, which is counted. Cost: a program is built once a
    structure, in 80 to 200 ms, and solved in 50 to 200 ms, for energy and optic flow in one or two seconds, and so are
    the steps after it; what collides between two samples is solved again, once in two to eight polylines.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid", "wheels"})

    step: float = 0.25
    headings: int = 8
    minimise: str | None = None
    intervals: int = 60
    warm_start: WarmStart = "lattice"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_python_values(self)
        set_wholes(self, "intervals", least=1, most=MOST_INTERVALS)
        Budget(self.time_limit)
        check_warm_start(self)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan polylines, then smooth each of them; a job of the executor is one polyline.

        Raises UnsupportedCriterion for a criterion that no nonlinear program can treat, OptionError for a cost to
        minimise that is not among the objectives and for a solver that is missing, and what the planner of the
        polylines raises.
        """
        require_ipopt(NAME)
        watch = Watch(NAME, self.time_limit, progress)
        objectives = edge_objectives(problem.criteria, NAME)
        criteria = objectives.optimised
        smooth_places(criteria, problem, NAME)
        place = None if self.minimise is None else minimised(self.minimise, criteria)
        warm = warm_starts(self, problem, progress, executor, watch.left)
        if warm.interrupted is not None:
            return warm.interrupted
        count = len(warm.trajectories)
        job = SmoothingJob(problem, criteria, place, self.intervals, Deadline.after(watch.left))

        def report(done: Mapping[int, Outcome[Improved]]) -> None:
            watch.report(len(done), count - len(done), sum(one.found is not None for one in done.values()))

        with Sweep(SmoothingJob.solve, job, executor) as sweep:
            outcomes, ended = sweep.until(warm.trajectories, watch.is_late, report)
        cut_short = any(CUT_SHORT in outcome.counts or LATE in outcome.counts for outcome in outcomes.values())
        if ended is Status.COMPLETE and cut_short:
            ended = Status.TIME_LIMIT
        missing = count - sum(CUT_SHORT not in outcome.counts for outcome in outcomes.values())
        left = [f"{ended}: {counted(missing, 'polyline')} not smoothed"] if missing else []
        notes = (*objectives.notes, *warm.notes, *sweep.notes, *left)
        found = _candidates(job, objectives, outcomes, warm.ended(ended), notes)
        stats = {"planner": NAME, "warm_starts": count, **found.stats, "seconds": watch.seconds}
        smoothed = [place for place, outcome in outcomes.items() if outcome.found is not None]
        return warm.kept(replace(found, stats=stats), smoothed)


def _candidates(
    job: SmoothingJob,
    objectives: Objectives,
    outcomes: Mapping[int, Outcome[Improved]],
    status: Status,
    notes: Sequence[str],
) -> Candidates:
    """What was found, judged once more, with everything that went wrong."""
    tally, criteria = Tally.of(outcomes.values()), job.criteria
    found = {place: outcome.found for place, outcome in outcomes.items() if outcome.found is not None}
    rows = (len(found), len(criteria))
    kept = trusted(
        Candidates(
            objectives=criteria,
            trajectories=tuple(one.trajectory for one in found.values()),
            planned=np.array([one.planned for one in found.values()]).reshape(rows),
            tolerance=np.array([one.tolerance for one in found.values()]).reshape(rows),
            status=status,
            certificate="",
            provenance=tuple({**one.provenance, "warm_start": place} for place, one in found.items()),
            notes=(*notes, *tally.notes("polyline")),
            filters=objectives.filters,
            stats={name: tally.counts[name] for name in COUNTED} | tally.stats,
        ),
        job.problem,
        NAME,
    )
    count = len(kept.trajectories)
    flat = sum(origin["status"] == FLAT for origin in kept.provenance)
    nearly = f", {flat} of {count} only nearly: the objective fell no more" if flat else ""
    names = ", ".join(criteria[j].name for j in job.smooth)
    unsettled = sum(not origin["settled"] for origin in kept.provenance)
    why = "the time was over before" if tally.counts[LATE] else "the last program did not converge"
    return replace(
        kept,
        certificate=(
            f"smoothing: local optima in ({names}) for the turns and the homotopy class of their polylines"
            f"{nearly}{objectives.certificate}"
        ),
        notes=(
            *kept.notes,
            *([f"smoothing: {counted(unsettled, 'trajectory')} may be no local optimum: {why}"] if unsettled else []),
            *([RAMPS] if count else []),
        ),
    )
