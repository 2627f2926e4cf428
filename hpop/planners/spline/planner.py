"""The spline planner: paths of joints from rest to rest become splines that go on without stops, each proved free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.criteria.base import trajectory_costs
from hpop.errors import UnsupportedCriterion
from hpop.options import set_wholes
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import trusted
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.polylines.warm_starts import WarmStart, WarmStarts, check_warm_start, known_trajectories
from hpop.planners.programs.criteria import minimised
from hpop.planners.programs.outcome import ONE_PROGRAM, Improved, Outcome, Tally
from hpop.planners.spline.job import SplineJob
from hpop.planners.spline.pieces import Pieces
from hpop.status import Budget, ProgressCallback, Status, Watch
from hpop.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problem import Problem

NAME = "spline"
COUNTED = ("steps", "programs")
MOST_PIECES = 500


@planner(NAME)
@dataclass(frozen=True)
class Spline:
    """Splines near known paths of a model with joints, which cost no more; and those paths.

    pieces      count  of cubics in a spline, about; each motion of its path becomes two at least
    minimise    name of the cost that is minimised; None makes a spline for all costs alike, each relative to the
                path's, and from there on one for each cost by itself
    warm_start  what gives the paths: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s      warm starts included; looked at between paths

    Sequential linear programming: from the path itself, which may be a spline already, or else slowed down where cubics
    need it, knots and slopes are moved step by step, distances of bodies and costs replaced by their tangents; a step
    counts only if the costs, evaluated, are lower and the certificate of the collision model says that the spline is
    free all along. So every step is a valid plan. What a limit or Ctrl-C leaves are the splines of the paths that are
    done, and all paths.

    Accepts any criteria that add up along edges or take the worst moment, at least one of them with a gradient on
    symbols; the others come as they come, with a note. Guarantees that every spline is free by certificate, keeps the
    limits of joints, speeds and accelerations, and costs no more than its path in any criterion with a gradient. A path
    that cannot be made a spline stays, and is counted; so does every path, as a spline may be worse in the other
    criteria. Each spline is a local improvement, not proved to be an optimum. Cost: .1 to .5 s a spline of six joints.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"spline"})
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True

    pieces: int = 12
    minimise: str | None = None
    warm_start: WarmStart = "roadmap"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_wholes(self, "pieces", least=2, most=MOST_PIECES)
        Budget(self.time_limit)
        check_warm_start(self)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan paths, then make a spline of each; a job of the executor is one path.

        Raises UnsupportedCriterion where no criterion has a gradient, OptionError for a cost to minimise that is not
        among those that have one, and what the planner of the paths raises.
        """
        watch = Watch(NAME, self.time_limit, progress)
        objectives = edge_objectives(problem.criteria, NAME)
        criteria = objectives.optimised
        with ONE_PROGRAM:
            reasons = Pieces.with_gradients(problem.world, problem.model, criteria)
        smooth = tuple(j for j, reason in reasons.items() if not reason)
        rough = [f"{criteria[j].name} is not improved by splines: {reason}" for j, reason in reasons.items() if reason]
        if not smooth:
            raise UnsupportedCriterion(
                f"{NAME} needs a criterion with a gradient, such as 'duration', or take planner 'roadmap': "
                f"{'; '.join(rough)}"
            )
        place = None if self.minimise is None else minimised(self.minimise, [criteria[j] for j in smooth])
        job = SplineJob(problem, criteria, smooth, place if place is None else smooth[place], self.pieces)
        warm = known_trajectories(self, problem, progress, executor)
        count = len(warm.trajectories)

        def report(done: Mapping[int, Outcome[tuple[Improved, ...]]]) -> None:
            watch.report(len(done), count - len(done), sum(one.found is not None for one in done.values()))

        with Sweep(SplineJob.solve, job, executor) as sweep:
            outcomes, ended = sweep.until(warm.trajectories, watch.is_late, report)
        left = [f"{ended}: {count - len(outcomes)} paths were not made splines"] * (len(outcomes) < count)
        notes = (*objectives.notes, *rough, *warm.notes, *sweep.notes, *left)
        found = _candidates(job, objectives, outcomes, warm, warm.ended(ended), notes)
        stats = {"planner": NAME, "warm_starts": count, **found.stats, "seconds": watch.seconds}
        return replace(found, stats=stats)


def _candidates(
    job: SplineJob,
    objectives: Objectives,
    outcomes: Mapping[int, Outcome[tuple[Improved, ...]]],
    warm: WarmStarts,
    status: Status,
    notes: Sequence[str],
) -> Candidates:
    """Splines and paths, judged once more, with everything that went wrong."""
    tally, criteria = Tally.of(outcomes.values()), job.criteria
    splines = [(place, one) for place, outcome in outcomes.items() for one in outcome.found or ()]
    paths = list(warm.trajectories)
    costs = trajectory_costs(criteria, paths, job.problem.world).reshape(-1, len(criteria))
    quanta = np.array([criterion.quantum for criterion in criteria])
    kept = trusted(
        Candidates(
            objectives=criteria,
            trajectories=(*(one.trajectory for _, one in splines), *paths),
            planned=np.array([*(one.planned for _, one in splines), *costs]).reshape(-1, len(criteria)),
            tolerance=np.array([*(one.tolerance for _, one in splines), *([quanta] * len(paths))]).reshape(
                -1, len(criteria)
            ),
            status=status,
            certificate="",
            provenance=(
                *({"planner": NAME, **one.provenance, "warm_start": place} for place, one in splines),
                *({"planner": NAME, "pieces": 0, "warm_start": place} for place in range(len(paths))),
            ),
            notes=(*notes, *(f"{line} (the path stays)" for line in tally.notes("paths"))),
            filters=objectives.filters,
            stats={name: tally.counts[name] for name in COUNTED} | {"splines": len(splines)} | tally.stats,
        ),
        job.problem,
        NAME,
    )
    names = ", ".join(criteria[j].name for j in job.smooth)
    return replace(
        kept,
        certificate=(
            f"spline: {len(splines)} splines, each proved free of collisions and no worse than its path in ({names}), "
            f"and the {len(paths)} paths; local improvements, not proved to be optimal{objectives.certificate}"
        ),
    )
