"""The smoothing planner: polylines become curves that a differential drive can follow, without stops at corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.base.options import set_wholes
from hpop.base.text import counted, set_python_values
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import trusted
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs import CUT_SHORT, Deadline, ImprovedTrajectory, Outcome, Tally
from hpop.planners.programs.nlp import minimised, require_ipopt, smooth_indices
from hpop.planners.programs.smoothing.job import LATE, SmoothingJob
from hpop.planners.programs.smoothing.phases import FLAT
from hpop.planners.programs.tour_legs import improved_tours
from hpop.planners.programs.warm_starts import WarmStart, check_warm_start, warm_starts
from hpop.runtime.limits import Budget, ProgressCallback, Status, Watch
from hpop.runtime.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "smoothing"
COUNTED = ("programs", "repairs", "saved by quasi-Newton")
MOST_INTERVALS = 2000  # largest program that a solver can take
RAMPS = (
    "smoothing: its trajectories begin and end at rest, so their durations include speeding up at the start and "
    "braking at the goal (v/a in all); durations of planned polylines do not"
)


@planner(NAME)
@dataclass(frozen=True)
class Smoothing:
    """Planner that smooths polylines into trajectories for a differential drive, controlled by wheel accelerations.

    step        m  distance between positions of the lattice that gives the polylines
    headings    number of headings of that lattice: 4, 8 or 16
    minimise    name of the cost to minimise, also a dose: felt_msdv or msdv. None: all costs together, each relative to
                the polyline's cost; costs that are the worst moment get a hundredth of the weight, since they are
                bounded anyway
    intervals   number of intervals of constant wheel acceleration; more are used if the turns need them
    warm_start  source of the polylines: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s  for everything, warm starts included

    Accepts smooth criteria that add up or take the worst moment, and counts of moves and turns; others are refused by
    name. Guarantees that every candidate is free of collisions on the exact geometry, and keeps the model's limits of
    wheel speeds and accelerations. It has no fewer turns than its polyline, and can be deformed into it without
    crossing an obstacle. In each smooth criterion it costs at most 2 % more than the polyline, planned or executed,
    whichever is more. Each is a local optimum for its sequence of turns, or the solver stopped where the objective no
    longer fell; the certificate counts these.

    Two programs are solved for each polyline. The second corrects the errors of distance fields and samples in the
    first, with much smaller weights of time and effort. If it does not converge, the first solution is the result,
    ``settled`` in the provenance is false, and a note counts such candidates. The peak of the optic flow has many
    kinks, so its programs may not converge; a note counts such polylines.

    A dose is the root of the integral of a squared, filtered acceleration. If it is minimised, the states of the filter
    are variables of the program. Otherwise, as all criteria with memory, it is evaluated on the trajectories found. On
    a tour, each leg has the least dose for a robot that has stood before it.

    A tour is smoothed leg by leg, with the states at its stops fixed; the robot comes to rest at each of them.

    Cost: a program is built once for each sequence of straight and turning phases, in 80 to 200 ms. Solving it takes 50
    to 200 ms, for energy, optic flow and doses one or two seconds; the second program takes as long. One in two to
    eight polylines is solved again, because the first solution collides between two samples.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid", "wheels"})
    tours: ClassVar[bool] = True

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
        """Plan polylines, then smooth each of them; each polyline is one job for the executor.

        Raises UnsupportedCriterion for a criterion that nonlinear programs do not accept, OptionError if the cost to
        minimise is not among the criteria or IPOPT is missing, and the errors of the planner of the polylines.
        """
        require_ipopt(NAME)
        if problem.tour is not None:
            return improved_tours(NAME, self, problem, progress, executor)
        watch = Watch(NAME, self.time_limit, progress)
        dose = [c for c in problem.criteria if c.name == self.minimise and c.dose is not None]
        objectives = edge_objectives([c for c in problem.criteria if c not in dose] or dose, NAME)
        smooth_indices(objectives.optimised, problem, NAME)
        criteria = (*objectives.optimised, *dose)
        index = None if self.minimise is None else len(criteria) - 1 if dose else minimised(self.minimise, criteria)
        warm = warm_starts(self, problem, progress, executor, watch.left)
        if warm.interrupted is not None:
            return warm.interrupted
        count = len(warm.trajectories)
        job = SmoothingJob(problem, criteria, index, self.intervals, Deadline.after(watch.left))

        def report(done: Mapping[int, Outcome[ImprovedTrajectory]]) -> None:
            watch.report(len(done), count - len(done), sum(outcome.candidate is not None for outcome in done.values()))

        with Sweep(SmoothingJob.solve, job, executor) as sweep:
            outcomes, status = sweep.until(warm.trajectories, watch.is_late, report)
        cut_short = any(CUT_SHORT in outcome.counts or LATE in outcome.counts for outcome in outcomes.values())
        if status is Status.COMPLETE and cut_short:
            status = Status.TIME_LIMIT
        missing = count - sum(CUT_SHORT not in outcome.counts for outcome in outcomes.values())
        left = [f"{status}: {counted(missing, 'polyline')} not smoothed"] if missing else []
        notes = (*objectives.notes, *warm.notes, *sweep.notes, *left)
        candidates = _candidates(job, objectives, outcomes, warm.ended(status), notes)
        stats = {"planner": NAME, "warm_starts": count, **candidates.stats, "seconds": watch.seconds}
        smoothed = [i for i, outcome in outcomes.items() if outcome.candidate is not None]
        return warm.with_unimproved(replace(candidates, stats=stats), smoothed)


def _candidates(
    job: SmoothingJob,
    objectives: Objectives,
    outcomes: Mapping[int, Outcome[ImprovedTrajectory]],
    status: Status,
    notes: Sequence[str],
) -> Candidates:
    """Return the smoothed trajectories that pass the final check, with notes on all polylines that failed."""
    tally, criteria = Tally.of(outcomes.values()), job.criteria
    improved = {index: outcome.candidate for index, outcome in outcomes.items() if outcome.candidate is not None}
    rows = (len(improved), len(criteria))
    accepted = trusted(
        Candidates(
            objectives=criteria,
            trajectories=tuple(curve.trajectory for curve in improved.values()),
            planned=np.array([curve.planned for curve in improved.values()]).reshape(rows),
            tolerance=np.array([curve.tolerance for curve in improved.values()]).reshape(rows),
            status=status,
            certificate="",
            provenance=tuple({**curve.provenance, "warm_start": index} for index, curve in improved.items()),
            notes=(*notes, *tally.notes("polyline")),
            filters=objectives.filters,
            stats={name: tally.counts[name] for name in COUNTED} | tally.stats,
        ),
        job.problem,
        NAME,
    )
    count = len(accepted.trajectories)
    flat = sum(origin["status"] == FLAT for origin in accepted.provenance)
    nearly = f", {flat} of {count} only nearly: the objective fell no more" if flat else ""
    names = ", ".join(criteria[j].name for j in job.smooth)
    unsettled = sum(not origin["settled"] for origin in accepted.provenance)
    why = "the time limit stopped the second program" if tally.counts[LATE] else "the second program did not converge"
    return replace(
        accepted,
        certificate=(
            f"smoothing: local optima in ({names}) for the turns and the homotopy class of their polylines"
            f"{nearly}{objectives.certificate}"
        ),
        notes=(
            *accepted.notes,
            *([f"smoothing: {counted(unsettled, 'trajectory')} may be no local optimum: {why}"] if unsettled else []),
            *([RAMPS] if count else []),
        ),
    )
