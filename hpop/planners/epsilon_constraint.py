"""The epsilon-constraint planner: any-angle polylines, one cost minimised, the others bounded by what is known."""

from __future__ import annotations

import math
import time
import warnings
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.errors import HpopWarning, OptionError
from hpop.options import MOST_COUNTED, real, set_wholes
from hpop.planners.base import Candidates, Objectives, edge_objectives, planner
from hpop.planners.epsilon_grid import Cell, Found, Grid, Known, Roles
from hpop.planners.epsilon_job import PolylineJob, Task
from hpop.planners.nlp import require_ipopt
from hpop.planners.outcome import Outcome
from hpop.planners.straightened import straightened
from hpop.planners.trust import exceeds, judge
from hpop.planners.vertices import Polyline
from hpop.planners.warm_starts import WarmStart, plan_warm_starts, status_after, warm_planner_of
from hpop.status import Budget, Progress, ProgressCallback, Status
from hpop.sweep import Sweep
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.problem import Problem

MOST_DIVISIONS = 1000  # divisions or rounds: each division is a bound more of each cost of each warm start
COUNTED = (
    "tried",
    "skipped",
    "programs",
    "perturbed",
    "saved by perturbation",
    "repairs",
    "shortened",
    "simplified",
    "refined",
)


@planner("epsilon-constraint")
@dataclass(frozen=True)
class EpsilonConstraint:
    """Polylines of any angles that minimise one cost while the others are bounded, from each known trade-off.

    step        m      of the lattice whose paths are the warm starts
    headings    4, 8 or 16 of that lattice
    minimise    name of the cost that is minimised; None takes the length, or the first smooth one
    divisions   count  of further bounds between a known cost and the next better one
    rounds      count  of programs a bound, each from the last solution: every one moves vertices by at most 1 m
    epsilon     bounds that hold throughout, by the name of a cost
    warm_start  planner that gives the warm starts: a name, or ``{name: {option: value}}``
    max_points  count  of bounds that are tried
    time_limit  s      warm starts included

    Accepts smooth criteria that add up or take the worst moment, and counts that the number of moves and turns settles;
    others are refused by name. Guarantees that every candidate keeps its bounds within 1e-3 and is free of collisions
    on the exact geometry; each is a local optimum for its number of turns, near its warm start, or as near to one as
    the exact costs let it come, which a note counts. The warm starts themselves are not among the candidates. The grid
    of bounds is AUGMECON's (Mavrotas 2009; Mavrotas and Florios 2013), but spans only what the warm starts know: a
    bound is skipped if a looser one was answered within it, and tighter ones than one that was infeasible are left out.
    Bounds are tried in waves, so results depend neither on the executor nor on its number of workers. Cost: a program
    is built once a structure and process, in 30 to 200 ms, and solved in 20 to 100 ms.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid"})

    step: float = 0.25
    headings: int = 8
    minimise: str | None = None
    divisions: int = 0
    rounds: int = 2
    epsilon: Mapping[str, float] | None = None
    warm_start: WarmStart = "lattice"
    max_points: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_wholes(self, "divisions", least=0, most=MOST_DIVISIONS)
        set_wholes(self, "rounds", least=1, most=MOST_DIVISIONS)
        if self.max_points is not None:
            set_wholes(self, "max_points", least=1)
        if self.epsilon is not None:
            if not isinstance(self.epsilon, Mapping):
                raise OptionError(
                    "epsilon gives bounds by the name of a cost, such as {'length': 30}, none of them below 0, got "
                    f"{shown(self.epsilon)}"
                )
            for name, bound in self.epsilon.items():
                real(f"epsilon, the bound on {name},", bound, 0, MOST_COUNTED)
        Budget(self.time_limit)
        warm_planner_of(self)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan warm starts, then minimise from each of them; a job of the executor is one bound.

        Raises UnsupportedCriterion for a criterion that no nonlinear program can treat, OptionError for a cost to
        minimise or to bound that is not among the objectives, a bound that no trajectory keeps and a solver that is
        missing, and what the planner of the warm starts raises.
        """
        require_ipopt("epsilon-constraint")
        began = time.perf_counter()
        objectives = edge_objectives(problem.criteria, "epsilon-constraint")
        roles = Roles.of(objectives.optimised, self.minimise, problem)
        limits = roles.limits(self.epsilon or {}, problem)
        first = plan_warm_starts(self, problem, progress, executor)
        warm, notes = _warm_starts(problem, roles, first)
        run = _Run(self, PolylineJob(problem, roles, self.rounds), Grid(roles, warm, limits, self.divisions), began)
        run.warn_of_tight_bounds()
        status = first.status
        if warm and status is not Status.INTERRUPTED:
            status = status_after(status, lambda: run.go(progress, executor))
        return run.candidates(status, objectives, notes)


def _warm_starts(problem: Problem, roles: Roles, first: Candidates) -> tuple[list[Known], list[str]]:
    """The front of another planner, ends put on start and goal, without those that are not free; and notes on it."""
    if not first.trajectories:
        return [], [f"no warm start: {first.status}", *first.notes]
    trajectories, notes = straightened(problem.front(first).trajectories, problem)
    polylines = [Polyline.of(trajectory, problem) for trajectory in trajectories]
    judged = judge(problem, roles.criteria, [p.trajectory(problem.model) for p in polylines])
    stopped = [] if first.status.is_final else [f"the warm starts are not all there are: {first.status}"]
    return (
        [Known(polylines[i], judged.costs[i]) for i in judged.kept],
        [*stopped, *notes, *judged.notes("epsilon-constraint, warm starts")],
    )


@dataclass(eq=False)
class _Run:
    """One run of the planner: the grid level by level, wave by wave, and what went wrong."""

    options: EpsilonConstraint
    job: PolylineJob
    grid: Grid
    began: float
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0})
    failures: Counter[str] = field(default_factory=Counter)
    notes: tuple[str, ...] = ()
    waiting: int = 0

    def go(self, progress: ProgressCallback | None, executor: Executor | None) -> Status:
        """Try all bounds; the status says whether any were left."""
        cap = self.options.max_points
        self.waiting = sum(map(len, self.grid.levels))
        self._report(progress)
        with Sweep(PolylineJob.solve, self.job, executor) as sweep:
            for cells in self.grid.levels:
                left = self._unanswered(cells)
                while left:
                    if self.counts["tried"] == cap:
                        return Status.POINT_LIMIT
                    wave = self.grid.wave(left)[: None if cap is None else cap - self.counts["tried"]]
                    status = self._try(wave, sweep, progress)
                    self.notes = tuple(sweep.notes)
                    if status is not Status.COMPLETE:
                        return status
                    left = self._unanswered([cell for cell in left if cell not in wave])
        return Status.COMPLETE

    def warn_of_tight_bounds(self) -> None:
        """Say before any program runs which bounds no warm start keeps: nobody knows yet whether anything does."""
        if not self.grid.warm:
            return
        ideal, limits, criteria = self.grid.costs.min(axis=0), self.grid.limits, self.job.roles.criteria
        for j in np.flatnonzero(exceeds(ideal, limits, criteria)):
            warnings.warn(
                f"epsilon bounds {criteria[j].name} by {limits[j]:g}, but the least of the warm starts is "
                f"{ideal[j]:.4g} {criteria[j].unit}: programs will look for less, and may find nothing. Ctrl-C stops "
                "them; a looser bound is sure to be kept",
                HpopWarning,
                stacklevel=3,
            )

    def _unanswered(self, cells: Sequence[Cell]) -> list[Cell]:
        """Cells that are still to be tried."""
        left = self.grid.unanswered(cells)
        self.counts["skipped"] += len(cells) - len(left)
        self.waiting -= len(cells) - len(left)
        return left

    def _try(
        self, wave: Sequence[Cell], sweep: Sweep[PolylineJob, Task, Outcome[Found]], progress: ProgressCallback | None
    ) -> Status:
        """Solve for each cell of a wave, the longest first; what is finished is kept whatever comes."""
        tasks: list[Task] = []
        for cell in wave:
            start = self.grid.start(cell)
            if start is None:
                counts = ", ".join(self.job.roles.criteria[j].name for j in self.job.roles.counted)
                self._keep(cell, Outcome(None, f"infeasible: no known trajectory has so few {counts}"))
            else:
                tasks.append((cell, start))
        tasks.sort(key=lambda task: -len(task[1].polyline.lengths))
        results: dict[int, Outcome[Found]] = {}
        try:
            for i, outcome in sweep.run(tasks, self._late):
                results[i] = outcome
                self._report(progress, results.values())
        finally:
            for i in sorted(results):
                self._keep(tasks[i][0], results[i])
        return Status.COMPLETE if len(results) == len(tasks) else Status.TIME_LIMIT

    def _keep(self, cell: Cell, outcome: Outcome[Found]) -> None:
        """File what came of a bound."""
        self.counts["tried"] += 1
        self.waiting -= 1
        self.counts.update(outcome.counts)
        for part, seconds in outcome.seconds.items():
            self.seconds[part] += seconds
        if outcome.found is not None:
            self.grid.found.append(outcome.found)
            return
        self.failures[outcome.reason] += 1
        if outcome.reason.startswith("infeasible"):
            self.grid.infeasible.append(cell)

    def _late(self) -> bool:
        limit = self.options.time_limit
        return limit is not None and time.perf_counter() - self.began > limit

    def _report(self, progress: ProgressCallback | None, finished: Collection[Outcome[Found]] = ()) -> None:
        if progress is not None:
            found = len(self.grid.found) + sum(outcome.found is not None for outcome in finished)
            tried = self.counts["tried"] + len(finished)
            seconds = time.perf_counter() - self.began
            progress(Progress("epsilon-constraint", tried, self.waiting - len(finished), found, seconds=seconds))

    def candidates(self, status: Status, objectives: Objectives, notes: Sequence[str]) -> Candidates:
        """What was found, judged once more, with everything that went wrong."""
        found, job, criteria = self.grid.found, self.job, self.job.roles.criteria
        trajectories = [one.known.polyline.trajectory(job.problem.model) for one in found]
        size = (len(trajectories), len(criteria))
        planned = np.array([one.planned for one in found]).reshape(size)
        tolerance = job.tolerance(planned)
        epsilon = np.array([one.cell.epsilon for one in found]).reshape(size)
        judged = judge(job.problem, criteria, trajectories, epsilon=epsilon, planned=planned, tolerance=tolerance)
        told = [*objectives.notes, *notes, *self.notes]
        if status in (Status.TIME_LIMIT, Status.POINT_LIMIT) and self.waiting:
            limit = "time limit" if status is Status.TIME_LIMIT else "max_points"
            told.append(f"{limit}: {self.waiting} bounds were not tried")
        told += [f"{count} bounds without a candidate: {why}" for why, count in sorted(self.failures.items())]
        if self.options.epsilon and self.failures and not judged.kept.size:
            told.append(f"no polyline was found within epsilon {dict(self.options.epsilon)}: {self._ideal()}")
        short = sum("halvings" in found[i].provenance for i in judged.kept)
        if short:
            told.append(
                f"{short} candidates are no local optima: the exact costs bind before the program's, so these stop on "
                "the way to its solution"
            )
        kept, names = judged.kept, ", ".join(criteria[j].name for j in job.roles.smooth)
        return Candidates(
            objectives=criteria,
            trajectories=tuple(trajectories[i] for i in kept),
            planned=planned[kept],
            tolerance=tolerance[kept],
            status=status,
            certificate=(
                f"epsilon-constraint: local optima for their number of turns in ({names}), near their warm starts"
                f"{objectives.certificate}"
            ),
            provenance=tuple(found[i].provenance for i in kept),
            notes=(*told, *judged.notes("epsilon-constraint")),
            filters=objectives.filters,
            stats={
                "planner": "epsilon-constraint",
                "warm_starts": len(self.grid.warm),
                **{name: self.counts[name] for name in COUNTED},
                "failed": dict(self.failures),
                "dropped": judged.dropped,
                "build_seconds": self.seconds["build"],
                "solve_seconds": self.seconds["solve"],
                "seconds": time.perf_counter() - self.began,
            },
        )

    def _ideal(self) -> str:
        """The ideal of what is bounded, as far as it is known."""
        ideal = self.grid.costs.min(axis=0)
        return "the ideal of the warm starts is " + ", ".join(
            f"{c.name} {value:.4g} {c.unit}"
            for c, value, limit in zip(self.job.roles.criteria, ideal, self.grid.limits, strict=True)
            if math.isfinite(limit)
        )
