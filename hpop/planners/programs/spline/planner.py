"""The spline planner: paths of joints from rest to rest become splines that go on without stops, each proved free."""

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
from hpop.base.scalars import set_python_values
from hpop.base.text import counted
from hpop.criteria.costs import trajectory_costs
from hpop.errors import UnsupportedCriterion
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import trusted
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs.criteria import minimised
from hpop.planners.programs.outcome import ONE_PROGRAM, Improved, Outcome, Tally
from hpop.planners.programs.spline.job import CUT_SHORT, Deadline, SplineJob
from hpop.planners.programs.spline.knots import Pieces
from hpop.planners.programs.warm_starts import WarmStart, WarmStarts, check_warm_start, known_trajectories
from hpop.planners.spending import Spending
from hpop.runtime.status import Budget, Progress, ProgressCallback, Status
from hpop.runtime.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "spline"
COUNTED = ("steps", "programs", CUT_SHORT)
MOST_PIECES = 500
HAND_OVER = 1.0  # s that workers have after the limit, for the step that they are at


@planner(NAME)
@dataclass(frozen=True)
class Spline:
    """Splines near known paths of a model with joints, which cost no more; and those paths.

    pieces      count  of cubics in a spline, about; each motion of its path becomes two at least
    minimise    name of the cost that is minimised; None makes a spline for all costs alike, each relative to the
                path's, and from there on one for each cost by itself, where that makes it lower
    warm_start  what gives the paths: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s      warm starts included, kernels compiled; looked at before each step

    Sequential linear programming: from the path itself, which may be a spline already, or else slowed down where cubics
    need it, knots and slopes are moved step by step, distances of bodies and costs replaced by their tangents; a step
    counts only if the costs, evaluated, are lower and the certificate of the collision model says that the spline is
    free all along. So every step is a valid plan. A first answer are the paths, in the stages of their planner; what a
    limit or Ctrl-C leaves at any moment are the splines certified until then, and all paths. (Workers hand over splines
    of whole paths: at Ctrl-C those of the paths that they are at are lost, and a limit waits a second for them.)

    Accepts any criteria that add up along edges or take the worst moment, at least one of them with a gradient on
    symbols; the others come as they come, with a note. Guarantees that every spline is free by certificate, keeps the
    limits of joints, speeds and accelerations, and costs no more than its path in any criterion with a gradient. A path
    that cannot be made a spline stays, and is counted; so does every path, as a spline may be worse in the other
    criteria. Each spline is a local improvement, no local optimum: steps end where they get small, and for costs with
    kinks, as rotations have, some per cent are left. Cost: .2 to 1 s a spline.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"spline"})
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True

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
        """Its limits."""
        return Budget(self.time_limit)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan paths, then make a spline of each; a job of the executor is one path.

        Raises UnsupportedCriterion where no criterion has a gradient, OptionError for a cost to minimise that is not
        among those that have one, and what the planner of the paths raises.
        """
        found: Candidates | None = None
        try:
            for now in self.stages(problem, progress, executor):
                found = now
        except KeyboardInterrupt:
            if found is None:
                raise
            found = replace(found, status=Status.INTERRUPTED)
        assert found is not None  # there is at least one stage
        return found

    def stages(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Iterator[Candidates]:
        """The paths as soon as there are some, in the stages of their planner; then splines more and more.

        Ctrl-C or the time limit keeps the splines that are certified, of the path at work too, and all paths. Raises
        as :meth:`solve` does.
        """
        spending = Spending(self.budget(), spent=problem.read_seconds)
        objectives = edge_objectives(problem.criteria, NAME)
        criteria = objectives.optimised
        with ONE_PROGRAM:
            pieces, reasons = Pieces.with_gradients(problem.world, problem.model, criteria)
        smooth = tuple(j for j, reason in reasons.items() if not reason)
        rough = [f"{criteria[j].name} is not improved by splines: {reason}" for j, reason in reasons.items() if reason]
        if not smooth:
            raise UnsupportedCriterion(
                f"{NAME} needs a criterion with a gradient, such as 'duration', or take planner 'roadmap': "
                f"{'; '.join(rough)}"
            )
        place = None if self.minimise is None else minimised(self.minimise, [criteria[j] for j in smooth])
        place = place if place is None else smooth[place]
        job = SplineJob(problem, criteria, smooth, place, self.pieces, built={"pieces": pieces})
        warm = yield from known_trajectories(self, problem, progress, executor, spending.until_limit())
        if warm.interrupted is not None:
            yield warm.interrupted
            return
        warm = warm._replace(trajectories=tuple(warm.trajectories))  # one object each
        notes = (*objectives.notes, *rough, *warm.notes)
        yield from _SplineRun(job, objectives, warm, notes, spending, progress).stages(executor)


@dataclass(eq=False)
class _SplineRun:
    """One run of the planner: its paths, and what became of some of them."""

    job: SplineJob
    objectives: Objectives
    warm: WarmStarts
    notes: Sequence[str]
    spending: Spending
    progress: ProgressCallback | None
    outcomes: dict[int, Outcome[tuple[Improved, ...]]] = field(default_factory=dict)

    def stages(self, executor: Executor | None) -> Iterator[Candidates]:
        """The paths, then splines of some of them, of half as many more each time; at last of all."""
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
                    # Anew each time, as pauses move it. Workers have that of the first time, and work in pauses too.
                    sweep.shared = replace(sweep.shared, deadline=Deadline.after(self._left()))
                    place, outcome = next(done, (None, None))
                    if place is None or outcome is None:
                        status = Status.TIME_LIMIT
                        break
                    self.outcomes[place] = outcome
            except KeyboardInterrupt:
                status = Status.INTERRUPTED
            for path, outcome in sweep.shared.interrupted:
                # A path that is given twice is two: of one that is done nothing was interrupted.
                at = next(i for i, one in enumerate(paths) if one is path and i not in self.outcomes)
                self.outcomes[at] = outcome
        if status is Status.COMPLETE and any(CUT_SHORT in outcome.counts for outcome in self.outcomes.values()):
            status = Status.TIME_LIMIT
        yield self._judged(self.warm.ended(status), sweep.notes)

    def _left(self) -> float:
        """Seconds that are left."""
        limit = self.spending.limits.time_limit
        return math.inf if limit is None else limit - self.spending.seconds()

    @property
    def _looked_at(self) -> dict[int, Outcome[tuple[Improved, ...]]]:
        """What became of paths, in their order, but of those for which no time was left."""
        outcomes = sorted(self.outcomes.items())
        return {place: one for place, one in outcomes if one.found is not None or CUT_SHORT not in one.counts}

    @cached_property
    def _costs(self) -> FloatArray:
        """Costs (n, k) of the paths."""
        criteria = self.job.criteria
        return trajectory_costs(criteria, self.warm.trajectories, self.job.problem.world).reshape(-1, len(criteria))

    def _report(self) -> None:
        if self.progress is not None:
            done, found = len(self.outcomes), sum(one.found is not None for one in self.outcomes.values())
            left = len(self.warm.trajectories) - done
            self.progress(Progress(NAME, done, left, found, seconds=self.spending.seconds()))

    def _judged(self, status: Status, notes: Sequence[str]) -> Candidates:
        """Splines and paths of the last stage, judged once more."""
        left = len(self.warm.trajectories) - len(self._looked_at)
        said = [f"{status}: {counted(left, 'path')} not smoothed"]
        kept = trusted(self._candidates(status, (*notes, *said * bool(left))), self.job.problem, NAME)
        return replace(kept, stats={**kept.stats, "seconds": self.spending.seconds()})

    def _candidates(self, status: Status, notes: Sequence[str]) -> Candidates:
        """Splines and paths, with everything that went wrong."""
        job, criteria = self.job, self.job.criteria
        outcomes = self._looked_at
        tally = Tally.of(outcomes.values())
        splines = [(place, one) for place, outcome in outcomes.items() for one in outcome.found or ()]
        paths = self.warm.trajectories
        quanta = np.array([criterion.quantum for criterion in criteria])
        names = ", ".join(criteria[j].name for j in job.smooth)
        left = len(paths) - len(outcomes)
        return Candidates(
            objectives=criteria,
            trajectories=(*(one.trajectory for _, one in splines), *paths),
            planned=np.array([*(one.planned for _, one in splines), *self._costs]).reshape(-1, len(criteria)),
            tolerance=np.array([*(one.tolerance for _, one in splines), *([quanta] * len(paths))]).reshape(
                -1, len(criteria)
            ),
            status=status,
            certificate=(
                f"spline: {counted(len(splines), 'spline')}, each proved free of collisions and no worse than its path "
                f"in ({names}), and {counted(len(paths), 'path')}{f', {left} not smoothed yet' if left else ''}; local "
                f"improvements, not proved to be optimal{self.objectives.certificate}"
            ),
            provenance=(
                *({"planner": NAME, **one.provenance, "warm_start": place} for place, one in splines),
                *({"planner": NAME, "pieces": 0, "warm_start": place} for place in range(len(paths))),
            ),
            notes=(*self.notes, *notes, *(f"{line} (the path stays)" for line in tally.notes("path"))),
            filters=self.objectives.filters,
            stats={"planner": NAME, "warm_starts": len(paths)}
            | {name: tally.counts[name] for name in COUNTED}
            | {"splines": len(splines)}
            | tally.stats,
        )
