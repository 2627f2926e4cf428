"""The smoothing planner: polylines become curves that a differential drive really follows, without stops at corners."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.options import set_wholes
from hpop.planners.base import Candidates, Objectives, edge_objectives, planner
from hpop.planners.driven_program import FLAT
from hpop.planners.nlp import require_ipopt
from hpop.planners.outcome import Outcome
from hpop.planners.smoothing_job import Smoothed, SmoothingJob
from hpop.planners.straightened import straightened
from hpop.planners.treatable import minimised, smooth_places
from hpop.planners.trust import judge
from hpop.planners.warm_starts import WarmStart, plan_warm_starts, status_after, warm_planner_of
from hpop.status import Budget, Progress, ProgressCallback, Status
from hpop.sweep import Sweep
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problem import Problem

MOST_INTERVALS = 2000  # of a program that a solver can still take
RAMPS = (
    "smoothing: driven trajectories begin and end at rest, so their durations include the ramps at start and goal (the "
    "constant v/a), which planned polylines leave out"
)


@planner("smoothing")
@dataclass(frozen=True)
class Smoothing:
    """Driven trajectories near known polylines: wheel accelerations as controls, every turn kept, nothing in between.

    step        m      of the lattice whose paths are smoothed
    headings    4, 8 or 16 of that lattice
    minimise    name of the cost that is minimised; None weighs all costs alike, each relative to the polyline's,
                but worst moments a hundredth of that: they are bounded first of all
    intervals   count  of constant wheel accelerations a trajectory; more where its turns need them
    warm_start  planner that gives the polylines: a name, or ``{name: {option: value}}``
    time_limit  s      warm starts included

    Accepts smooth criteria that add up or take the worst moment, and counts that the number of moves and turns settles;
    others are refused by name. Guarantees that every candidate is free of collisions on the exact geometry, within the
    model's wheel speeds and accelerations, has no fewer turns than its polyline, can be deformed into it without
    crossing an obstacle, and costs at most 2 % more in each smooth criterion than the polyline, planned or executed,
    whichever is more. Each is a local optimum for its sequence of turns, or lies where the objective falls no more,
    which is said. The peak of the optic flow, whose kinks are everywhere, may not converge, which is counted. Cost: a
    program is built once a structure, in 80 to 200 ms, and solved in 50 to 200 ms, for energy and optic flow in one or
    two seconds; what collides between two samples is solved again, once in two to eight polylines.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid", "wheels"})

    step: float = 0.25
    headings: int = 8
    minimise: str | None = None
    intervals: int = 60
    warm_start: WarmStart = "lattice"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_wholes(self, "intervals", least=1, most=MOST_INTERVALS)
        Budget(self.time_limit)
        warm_planner_of(self)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan polylines, then smooth each of them; a job of the executor is one polyline.

        Raises UnsupportedCriterion for a criterion that no nonlinear program can treat, OptionError for a cost to
        minimise that is not among the objectives and for a solver that is missing, and what the planner of the
        polylines raises.
        """
        require_ipopt("smoothing")
        began = time.perf_counter()
        objectives = edge_objectives(problem.criteria, "smoothing")
        criteria = objectives.optimised
        smooth_places(criteria, problem, "smoothing")
        place = None if self.minimise is None else minimised(self.minimise, criteria)
        job = SmoothingJob(problem, criteria, place, self.intervals)
        first = plan_warm_starts(self, problem, progress, executor)
        trajectories, curves = straightened(problem.front(first).trajectories if first.trajectories else (), problem)
        run = _Run(job, trajectories, began, self.time_limit)
        status = first.status
        if trajectories and status is not Status.INTERRUPTED:
            status = status_after(status, lambda: run.go(progress, executor))
        stopped = () if first.status.is_final else (f"the polylines are not all there are: {first.status}",)
        none = () if first.trajectories else (f"nothing to smooth: {first.status}", *first.notes)
        return run.candidates(status, objectives, (*objectives.notes, *stopped, *curves, *none))


@dataclass(eq=False)
class _Run:
    """One run of the planner: what came of each polyline."""

    job: SmoothingJob
    polylines: Sequence[Trajectory]
    began: float
    time_limit: float | None
    outcomes: dict[int, Outcome[Smoothed]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def go(self, progress: ProgressCallback | None, executor: Executor | None) -> Status:
        """Smooth all polylines; the status says whether any were left."""
        self._report(progress)
        with Sweep(SmoothingJob.solve, self.job, executor) as sweep:
            for i, outcome in sweep.run(self.polylines, self._late):
                self.outcomes[i] = outcome
                self._report(progress)
            self.notes = tuple(sweep.notes)
        return Status.COMPLETE if len(self.outcomes) == len(self.polylines) else Status.TIME_LIMIT

    def _late(self) -> bool:
        return self.time_limit is not None and time.perf_counter() - self.began > self.time_limit

    def _report(self, progress: ProgressCallback | None) -> None:
        if progress is not None:
            found = sum(outcome.found is not None for outcome in self.outcomes.values())
            done, seconds = len(self.outcomes), time.perf_counter() - self.began
            progress(Progress("smoothing", done, len(self.polylines) - done, found, seconds=seconds))

    def candidates(self, status: Status, objectives: Objectives, notes: Sequence[str]) -> Candidates:
        """What was found, judged once more, with everything that went wrong."""
        job, criteria = self.job, self.job.criteria
        places = [i for i in sorted(self.outcomes) if self.outcomes[i].found is not None]
        found = [one for i in places if (one := self.outcomes[i].found) is not None]
        trajectories = [one.trajectory for one in found]
        planned, tolerance = (
            np.array(rows).reshape(len(found), len(criteria))
            for rows in ([one.planned for one in found], [one.tolerance for one in found])
        )
        judged = judge(job.problem, criteria, trajectories, planned=planned, tolerance=tolerance)
        failed = Counter(outcome.reason for outcome in self.outcomes.values() if outcome.reason)
        told = [*notes, *self.notes]
        left = len(self.polylines) - len(self.outcomes)
        if status is Status.TIME_LIMIT and left:
            told.append(f"time limit: {left} polylines were not smoothed")
        told += [f"{count} polylines without a candidate: {why}" for why, count in sorted(failed.items())]
        counts = sum((outcome.counts for outcome in self.outcomes.values()), Counter[str]())
        seconds = {
            part: sum(outcome.seconds[part] for outcome in self.outcomes.values()) for part in ("build", "solve")
        }
        kept = judged.kept
        names = ", ".join(criteria[j].name for j in job.smooth)
        flat = sum(found[i].provenance["status"] == FLAT for i in kept)
        nearly = f", {flat} of {kept.size} only nearly: the objective fell no more" if flat else ""
        return Candidates(
            objectives=criteria,
            trajectories=tuple(trajectories[i] for i in kept),
            planned=planned[kept],
            tolerance=tolerance[kept],
            status=status,
            certificate=(
                f"smoothing: local optima in ({names}) for the turns and the homotopy class of their polylines"
                f"{nearly}{objectives.certificate}"
            ),
            provenance=tuple({**found[i].provenance, "warm_start": places[i]} for i in kept),
            notes=(*told, *judged.notes("smoothing"), *((RAMPS,) if kept.size else ())),
            filters=objectives.filters,
            stats={
                "planner": "smoothing",
                "warm_starts": len(self.polylines),
                "programs": counts["programs"],
                "repairs": counts["repairs"],
                "saved by quasi-Newton": counts["saved by quasi-Newton"],
                "failed": dict(failed),
                "dropped": judged.dropped,
                "build_seconds": seconds["build"],
                "solve_seconds": seconds["solve"],
                "seconds": time.perf_counter() - self.began,
            },
        )
