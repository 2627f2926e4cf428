"""The spline planner: paths of a robot with joints become splines without stops, each proved free of collisions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import set_wholes
from hpop.base.text import counted, set_python_values
from hpop.criteria.costs import trajectory_costs
from hpop.errors import UnsupportedCriterion
from hpop.motions import collision_of
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import trusted
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs import ONE_PROGRAM, Deadline, ImprovedTrajectory, Outcome, Tally
from hpop.planners.programs.nlp import minimised
from hpop.planners.programs.spline.job import CUT_SHORT, SplineJob
from hpop.planners.programs.spline.knots import PieceCosts
from hpop.planners.programs.tour_legs import improved_tours
from hpop.planners.programs.warm_starts import WarmStart, WarmStarts, check_warm_start, known_trajectories
from hpop.planners.spending import Spending
from hpop.runtime.limits import Budget, Progress, ProgressCallback, Status
from hpop.runtime.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "spline"
COUNTED = ("steps", "programs", CUT_SHORT)
MOST_PIECES = 500
HAND_OVER = 1.0  # s after the time limit in which workers may finish their step


@planner(NAME)
@dataclass(frozen=True)
class Spline:
    """Planner that turns paths of a robot with joints into splines that cost no more; it returns both.

    pieces      approximate number of cubic pieces of a spline; each phase of a motion, such as speeding up, gets at
                least one
    minimise    name of the cost to minimise; None: one spline for all costs with equal weights, relative to the path's
                costs, and then one for each cost if that lowers it
    warm_start  source of the paths: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s  for everything, warm starts and compiling included; checked before each step

    This is sequential quadratic programming. It starts from the path, slowed down where cubics need it. Each step moves
    knots, slopes and the total time. In it, distances between bodies are linearised, and costs are replaced by a convex
    quadratic approximation. A step is accepted only if the evaluated costs are lower, and if the collision model proves
    that the spline is free throughout. So every step is a valid trajectory. A straight approach at the end of a path
    stays as it is. A tour is improved leg by leg, with the states at its stops fixed.

    The first results are the paths, as their planner finds them. After a limit or Ctrl-C, the result has all paths and
    all splines proved so far. Workers return the splines of a path together: at Ctrl-C those of unfinished paths are
    lost, and a time limit waits one second for them.

    Accepts any criteria that add up along edges or take the worst moment, at least one of them with a gradient on
    symbols; the others are not optimised, and a note says so. Guarantees that every spline is proved free, keeps the
    limits of joints, speeds and accelerations, and costs no more than its path in any criterion with a gradient. Every
    path stays among the candidates, as a spline may be worse in the other criteria; paths without a spline are counted.
    A spline takes at most twice as long as its path, or as long as the first cubics through it if these take longer.
    Each is a local improvement: steps end when they gain little. ``settled`` in the provenance is true if the next step
    is predicted to gain at most a thousandth. A note counts the splines for which it is false; often these minimise
    costs with kinks, such as rotations. Cost: 0.2 to 5 s per spline.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"spline"})
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True
    tours: ClassVar[bool] = True

    pieces: int = 12
    minimise: str | None = None
    warm_start: WarmStart = "roadmap"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_python_values(self)
        set_wholes(self, "pieces", least=2, most=MOST_PIECES)
        Budget(self.time_limit)
        check_warm_start(self)

    def budget(self) -> Budget:
        """Return the limits on the work of this planner: its time limit."""
        return Budget(self.time_limit)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan paths, then make splines of each; each path is one job for the executor.

        Raises UnsupportedCriterion if no criterion has a gradient, OptionError if ``minimise`` names a cost without a
        gradient, and the errors of the planner of the paths.
        """
        latest: Candidates | None = None
        try:
            for stage in self.stages(problem, progress, executor):
                latest = stage
        except KeyboardInterrupt:
            if latest is None:
                raise
            latest = replace(latest, status=Status.INTERRUPTED)
        assert latest is not None  # there is at least one stage
        return latest

    def stages(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Iterator[Candidates]:
        """Yield the paths as their planner finds them, then the paths with more and more splines.

        After Ctrl-C or the time limit, the last result has all paths and all splines proved free, also those of the
        path in progress. Raises the errors of :meth:`solve`.
        """
        if problem.tour is not None:
            yield improved_tours(NAME, self, problem, progress, executor, keeps=True)
            return
        spending = Spending(self.budget(), spent=problem.read_seconds)
        objectives = edge_objectives(problem.criteria, NAME)
        criteria = objectives.optimised
        with ONE_PROGRAM:
            pieces, reasons = PieceCosts.with_gradients(problem.world, problem.model, criteria)
        smooth = tuple(j for j, reason in reasons.items() if not reason)
        rough = [
            f"{criteria[j].name} is computed for each spline, but not aimed at ({reason.partition(';')[0]})"
            for j, reason in reasons.items()
            if reason
        ]
        if not smooth:
            raise UnsupportedCriterion(
                f"{NAME} needs a criterion with a gradient, such as 'duration', or take planner 'roadmap': "
                f"{'; '.join(rough)}"
            )
        index = None if self.minimise is None else minimised(self.minimise, [criteria[j] for j in smooth])
        index = index if index is None else smooth[index]
        job = SplineJob(problem, criteria, smooth, index, self.pieces, built={"pieces": pieces})
        warm = yield from known_trajectories(self, problem, progress, executor, spending.until_limit())
        if warm.interrupted is not None:
            yield warm.interrupted
            return
        warm = warm._replace(trajectories=tuple(warm.trajectories))  # one object for each path
        notes = (*objectives.notes, *rough, *warm.notes)
        yield from _SplineRun(job, objectives, warm, notes, spending, progress).stages(executor)


@dataclass(eq=False)
class _SplineRun:
    """One run of the planner: its paths (the warm starts), and the outcome of each path so far.

    notes     lines for the user
    spending  time spent and left
    outcomes  outcomes by the index of the path
    """

    job: SplineJob
    objectives: Objectives
    warm: WarmStarts
    notes: Sequence[str]
    spending: Spending
    progress: ProgressCallback | None
    outcomes: dict[int, Outcome[tuple[ImprovedTrajectory, ...]]] = field(default_factory=dict)

    def stages(self, executor: Executor | None) -> Iterator[Candidates]:
        """Yield the paths without splines, then with the splines of 1, 2, 3, 4, 6, 9, ... paths, finally of all."""
        paths, status, stage = self.warm.trajectories, Status.COMPLETE, 0
        grace = 0.0 if executor is None else HAND_OVER
        with Sweep(SplineJob.solve, self.job, executor) as sweep:
            try:
                done = sweep.run(paths, lambda: self._left() < -grace)
                while len(self.outcomes) < len(paths):
                    if len(self.outcomes) == stage:
                        with self.spending.paused():
                            yield self._candidates(Status.UNFINISHED, ())
                        if not stage:
                            self.job.compile_kernels(paths[0])
                        stage += max(1, stage // 2)
                    self._report()
                    # Renewed each time, as pauses move it. Workers keep the first one, as they also work in pauses.
                    sweep.shared = replace(sweep.shared, deadline=Deadline.after(self._left()))
                    index, outcome = next(done, (None, None))
                    if index is None or outcome is None:
                        status = Status.TIME_LIMIT
                        break
                    self.outcomes[index] = outcome
            except KeyboardInterrupt:
                status = Status.INTERRUPTED
            for path, outcome in sweep.shared.interrupted:
                # A path may be listed twice; an index with an outcome was not interrupted.
                at = next(i for i, candidate in enumerate(paths) if candidate is path and i not in self.outcomes)
                self.outcomes[at] = outcome
        if status is Status.COMPLETE and any(CUT_SHORT in outcome.counts for outcome in self.outcomes.values()):
            status = Status.TIME_LIMIT
        yield self._judged(self.warm.ended(status), sweep.notes)

    def _left(self) -> float:
        """Return the seconds until the time limit; inf if there is none."""
        limit = self.spending.limits.time_limit
        return math.inf if limit is None else limit - self.spending.seconds()

    @property
    def _finished(self) -> dict[int, Outcome[tuple[ImprovedTrajectory, ...]]]:
        """Outcomes by the index of the path, without those of paths for which no time remained."""
        outcomes = sorted(self.outcomes.items())
        return {
            index: outcome
            for index, outcome in outcomes
            if outcome.candidate is not None or CUT_SHORT not in outcome.counts
        }

    @cached_property
    def _costs(self) -> FloatArray:
        """Costs (n, k) of the n paths."""
        criteria = self.job.criteria
        return trajectory_costs(criteria, self.warm.trajectories, self.job.problem.world).reshape(-1, len(criteria))

    def _report(self) -> None:
        if self.progress is not None:
            done, splined = len(self.outcomes), sum(outcome.candidate is not None for outcome in self.outcomes.values())
            left = len(self.warm.trajectories) - done
            self.progress(Progress(NAME, done, left, splined, seconds=self.spending.seconds()))

    def _judged(self, status: Status, notes: Sequence[str]) -> Candidates:
        """Return the last result: all splines and paths that pass the final check, with notes."""
        left = len(self.warm.trajectories) - len(self._finished)
        omissions = [f"{status}: {counted(left, 'path')} not smoothed"] if left else []
        accepted = trusted(self._candidates(status, (*notes, *omissions)), self.job.problem, NAME)
        unsettled = sum(not origin.get("settled", True) for origin in accepted.provenance)
        note = f"spline: {counted(unsettled, 'spline')} may be no local optimum: its improvement stopped early"
        return replace(
            accepted,
            notes=(*accepted.notes, *([note] if unsettled else [])),
            stats={**accepted.stats, "seconds": self.spending.seconds()},
        )

    def _candidates(self, status: Status, notes: Sequence[str]) -> Candidates:
        """Return all splines so far and all paths as candidates, with a note for each kind of failure."""
        job, criteria = self.job, self.job.criteria
        outcomes = self._finished
        tally = Tally.of(outcomes.values())
        splines = [(path, spline) for path, outcome in outcomes.items() for spline in outcome.candidate or ()]
        paths = self.warm.trajectories
        quanta = np.array([criterion.quantum for criterion in criteria])
        names = ", ".join(criteria[j].name for j in job.smooth)
        left, kept = len(paths) - len(outcomes), collision_of(job.problem.model, job.problem.world).constraint
        return Candidates(
            objectives=criteria,
            trajectories=(*(spline.trajectory for _, spline in splines), *paths),
            planned=np.array([*(spline.planned for _, spline in splines), *self._costs]).reshape(-1, len(criteria)),
            tolerance=np.array([*(spline.tolerance for _, spline in splines), *([quanta] * len(paths))]).reshape(
                -1, len(criteria)
            ),
            status=status,
            certificate=(
                f"spline: the best of {counted(len(splines), 'spline')} and {counted(len(paths), 'path')}"
                f"{f', {left} not smoothed yet' if left else ''}; each spline is proved free of collisions and no "
                f"worse than its path in ({names}); these are local improvements, not proved to be optimal"
                f"{self.objectives.certificate}{f'; {kept}' if kept else ''}"
            ),
            provenance=(
                *({"planner": NAME, **spline.provenance, "warm_start": path} for path, spline in splines),
                *({"planner": NAME, "pieces": 0, "warm_start": path} for path in range(len(paths))),
            ),
            notes=(*self.notes, *notes, *(f"{line} (the path stays)" for line in tally.notes("path"))),
            filters=self.objectives.filters,
            stats={"planner": NAME, "warm_starts": len(paths)}
            | {name: tally.counts[name] for name in COUNTED}
            | {"splines": len(splines)}
            | tally.stats,
        )
