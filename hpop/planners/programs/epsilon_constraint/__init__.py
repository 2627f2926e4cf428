"""The epsilon-constraint planner: any-angle polylines that minimise one cost while the others are bounded."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import MOST_COUNTED, amounts, set_wholes
from hpop.base.text import counted, set_python_values
from hpop.criteria.costs import trajectory_costs
from hpop.errors import HpopWarning
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import exceeds, trusted
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs import CUT_SHORT, Deadline, Outcome, Tally
from hpop.planners.programs.epsilon_constraint.grid import Cell, CellCandidate, FreePolyline, Grid, Roles
from hpop.planners.programs.epsilon_constraint.job import PolylineJob, Task
from hpop.planners.programs.nlp import require_ipopt
from hpop.planners.programs.tour_legs import improved_tours, refuse_bounds
from hpop.planners.programs.warm_starts import WarmStart, check_warm_start, warm_starts
from hpop.runtime.limits import Budget, ProgressCallback, Status, Watch
from hpop.runtime.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "epsilon-constraint"
MOST_DIVISIONS = 1000  # divisions or rounds: each division adds a cell for each cost of each warm start
COUNTED = (
    "tried",
    "skipped",
    "programs",
    "perturbed",
    "saved by perturbation",
    "repairs",
    "steps",
    "without a program",
)
NOTED = 1e-3  # share of the cost: if one more step is predicted to gain more, a note says so


@planner(NAME)
@dataclass(frozen=True)
class EpsilonConstraint:
    """Planner of polylines with any angles that minimise one cost, while the costs of a warm start bound the others.

    step        m  distance between positions of the lattice that gives the warm starts
    headings    number of headings of that lattice: 4, 8 or 16
    minimise    name of the cost to minimise; None: the length, or else the first smooth cost
    divisions   number of evenly spaced values to which one bound at a time is tightened, between the cost of a warm
                start and the next better cost of another one; 0: all bounds are costs of warm starts
    rounds      number of programs for each set of bounds; each begins at the last solution and moves corners by at most
                1 m. A round is skipped if no corner moved that far in the round before
    epsilon     bounds that hold for all results, by the name of a cost
    warm_start  source of the warm starts: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    max_points  largest number of sets of bounds that are tried
    time_limit  s  for everything, warm starts included

    Accepts smooth criteria that add up or take the worst moment, and counts of moves and turns; others are refused by
    name. Guarantees that every candidate keeps its bounds within 1e-3, and is free of collisions on the exact geometry.
    Each is a local optimum for its number of turns, near its warm start. A descent with exact costs moves its corners
    until no small step gains more than 2e-5 of the minimised cost. If the descent is cut short, ``left`` in the
    provenance is the predicted gain of the next step, and a note counts such candidates. Warm starts are among the
    candidates only after Ctrl-C or a time limit: those that keep ``epsilon`` and were not improved by then.

    A tour is improved leg by leg, with the states at its stops fixed; ``epsilon``, ``divisions`` and ``max_points`` are
    then refused.

    The sets of bounds form the grid of AUGMECON (Mavrotas 2009; Mavrotas and Florios 2013), restricted to the costs of
    the warm starts. A set is skipped if the candidate of a looser one keeps it, or if a looser one was infeasible. Sets
    are tried in waves, so results depend neither on the executor nor on its number of workers. Cost: a program is built
    once for each number of segments and pieces and each process, in 30 to 200 ms, and solved in 20 to 100 ms; the
    descent takes 50 to 500 ms.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid"})
    tours: ClassVar[bool] = True

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
        set_python_values(self)
        set_wholes(self, "divisions", least=0, most=MOST_DIVISIONS)
        set_wholes(self, "rounds", least=1, most=MOST_DIVISIONS)
        set_wholes(self, "max_points", least=1, optional=True)
        if self.epsilon is not None:
            object.__setattr__(self, "epsilon", amounts("epsilon", self.epsilon, MOST_COUNTED, "bounds"))
        Budget(self.time_limit)
        check_warm_start(self)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan warm starts, then minimise from each of them; each set of bounds is one job for the executor.

        Raises UnsupportedCriterion for a criterion that nonlinear programs do not accept, OptionError if ``minimise``
        or ``epsilon`` names no criterion, if no trajectory can keep a bound and if IPOPT is missing, and the errors of
        the planner of the warm starts.
        """
        require_ipopt(NAME)
        if problem.tour is not None:
            refuse_bounds(NAME, {"epsilon": self.epsilon, "divisions": self.divisions, "max_points": self.max_points})
            return improved_tours(NAME, self, problem, progress, executor)
        watch = Watch(NAME, self.time_limit, progress)
        objectives = edge_objectives(problem.criteria, NAME)
        roles = Roles.of(objectives.optimised, self.minimise, problem)
        limits = roles.limits(self.epsilon or {}, problem)
        warm = warm_starts(self, problem, progress, executor, watch.left)
        if warm.interrupted is not None:
            return self._within(warm.interrupted, limits, roles, problem)
        warm, polylines, costs, dropped = warm.polylines(problem, roles.criteria)
        starts = [FreePolyline(polyline, row) for polyline, row in zip(polylines, costs, strict=True)]
        job = PolylineJob(problem, roles, self.rounds, Deadline.after(watch.left))
        run = _GridRun(self, job, Grid(roles, starts, limits, self.divisions), watch)
        run.warn_of_tight_bounds()
        status = warm.ended(run.go(executor))
        candidates = run.candidates(status, objectives, (*objectives.notes, *warm.notes, *dropped))
        completed = warm.with_unimproved(candidates, {candidate.cell.of for candidate in run.grid.candidates})
        return candidates if completed is candidates else self._within(completed, limits, roles, problem)

    def _within(self, candidates: Candidates, limits: FloatArray, roles: Roles, problem: Problem) -> Candidates:
        """Return the candidates whose exact costs keep the bounds (k,) of the option ``epsilon``."""
        if not self.epsilon:
            return candidates
        costs = trajectory_costs(roles.criteria, candidates.trajectories, problem.world)
        return candidates.subset(np.flatnonzero([not exceeds(row, limits, roles.criteria).any() for row in costs]))


@dataclass(eq=False)
class _GridRun:
    """One run of the planner, which solves all sets of bounds (cells of the grid) level by level, in waves.

    watch    time limit and progress
    tally    sums over the outcomes so far
    notes    lines for the user
    waiting  number of cells still to be solved
    """

    options: EpsilonConstraint
    job: PolylineJob
    grid: Grid
    watch: Watch
    tally: Tally = field(default_factory=Tally)
    notes: Sequence[str] = ()
    waiting: int = 0

    def go(self, executor: Executor | None) -> Status:
        """Solve all cells (sets of bounds), and return the status; candidates are in ``grid``, also after Ctrl-C."""
        if not self.grid.warm:
            return Status.COMPLETE
        cap, tried = self.options.max_points, self.tally.counts
        try:
            self.waiting = sum(map(len, self.grid.levels))
            with Sweep(PolylineJob.solve, self.job, executor) as sweep:
                self.notes = sweep.notes
                for cells in self.grid.levels:
                    left = self._unanswered(cells)
                    while left:
                        if tried["tried"] == cap:
                            return Status.POINT_LIMIT
                        wave = self.grid.wave(left)[: None if cap is None else cap - tried["tried"]]
                        status = self._try(wave, sweep)
                        if status is not Status.COMPLETE:
                            return status
                        left = self._unanswered([cell for cell in left if cell not in wave])
        except KeyboardInterrupt:
            return Status.INTERRUPTED
        return Status.TIME_LIMIT if self.tally.counts[CUT_SHORT] else Status.COMPLETE

    def warn_of_tight_bounds(self) -> None:
        """Warn of bounds in ``epsilon`` that no warm start keeps, before any program runs: they may be infeasible."""
        if not self.grid.warm:
            return
        ideal, limits, criteria = self.grid.costs.min(axis=0), self.grid.limits, self.job.roles.criteria
        for j in np.flatnonzero(exceeds(ideal, limits, criteria)):
            warnings.warn(
                f"epsilon bounds {criteria[j].name} by {limits[j]:g}, but the best warm start has {ideal[j]:.4g} "
                f"{criteria[j].unit}; the planner looks for less and may find no path. Ctrl-C stops it; a bound of at "
                "least that value can be kept",
                HpopWarning,
                stacklevel=3,
            )

    def _unanswered(self, cells: Sequence[Cell]) -> list[Cell]:
        """Return the cells (sets of bounds) that must be solved, and count the others as skipped."""
        left = self.grid.unanswered(cells)
        self.tally.counts["skipped"] += len(cells) - len(left)
        self.waiting -= len(cells) - len(left)
        return left

    def _try(self, wave: Sequence[Cell], sweep: Sweep[PolylineJob, Task, Outcome[CellCandidate]]) -> Status:
        """Solve the cells (sets of bounds) of a wave on the executor, and record their outcomes; return the status.

        Cells whose polylines have most segments take longest, so they begin first.
        """
        tasks: list[Task] = []
        for cell in wave:
            start = self.grid.start(cell)
            if start is None:
                counts = ", ".join(self.job.roles.criteria[j].name for j in self.job.roles.counted)
                self._keep(cell, Outcome(None, f"infeasible: no warm start or candidate has so few {counts}"))
            else:
                tasks.append((cell, start))
        tasks.sort(key=lambda task: -len(task[1].polyline.lengths))
        results, status = sweep.until(tasks, self.watch.is_late, self._report)
        for index, outcome in results.items():
            self._keep(tasks[index][0], outcome)
        return status

    def _keep(self, cell: Cell, outcome: Outcome[CellCandidate]) -> None:
        """Record the outcome of a cell (set of bounds): its candidate, or that it is infeasible or was cut short."""
        self.tally.add(outcome)
        self.tally.counts["tried"] += 1
        self.waiting -= 1
        if outcome.candidate is not None:
            self.grid.candidates.append(outcome.candidate)
        elif outcome.reason == CUT_SHORT:
            self.waiting += 1
        elif outcome.reason.startswith("infeasible"):
            self.grid.infeasible.append(cell)

    def _report(self, finished: Mapping[int, Outcome[CellCandidate]]) -> None:
        found = len(self.grid.candidates) + sum(outcome.candidate is not None for outcome in finished.values())
        self.watch.report(self.tally.counts["tried"] + len(finished), self.waiting - len(finished), found)

    def candidates(self, status: Status, objectives: Objectives, notes: Sequence[str]) -> Candidates:
        """Return the candidates that :func:`hpop.planners.judgement.judge` accepts, with notes on all failures."""
        candidates, job, criteria = self.grid.candidates, self.job, self.job.roles.criteria
        rows = (len(candidates), len(criteria))
        planned = np.array([candidate.planned for candidate in candidates]).reshape(rows)
        limit = "max_points" if status is Status.POINT_LIMIT else status
        left = [f"{limit}: {self.waiting} bounds were not tried"] if self.waiting else []
        names = ", ".join(criteria[j].name for j in job.roles.smooth)
        accepted = trusted(
            Candidates(
                objectives=criteria,
                trajectories=tuple(candidate.solved.polyline.trajectory(job.problem.model) for candidate in candidates),
                planned=planned,
                tolerance=job.tolerance(planned),
                status=status,
                certificate=(
                    f"epsilon-constraint: local optima for their number of turns in ({names}), near their warm starts"
                    f"{objectives.certificate}"
                ),
                provenance=tuple(candidate.provenance for candidate in candidates),
                notes=(*notes, *self.notes, *left, *self.tally.notes("bound")),
                filters=objectives.filters,
                stats={
                    "planner": NAME,
                    "warm_starts": len(self.grid.warm),
                    **{name: self.tally.counts[name] for name in COUNTED},
                    **self.tally.stats,
                },
            ),
            job.problem,
            NAME,
            epsilon=np.array([candidate.cell.epsilon for candidate in candidates]).reshape(rows),
        )
        return replace(
            accepted,
            notes=(*accepted.notes, *self._shortcomings(accepted)),
            stats={**accepted.stats, "seconds": self.watch.seconds},
        )

    def _shortcomings(self, accepted: Candidates) -> list[str]:
        """Return notes on bounds without candidates, and on candidates that may be no local optimum."""
        notes = []
        if self.options.epsilon and self.tally.failures and not accepted.trajectories:
            notes.append(f"no polyline was found within epsilon {dict(self.options.epsilon)}: {self._ideal()}")
        left = [float(origin.get("left", np.inf)) for origin in accepted.provenance]
        open_ = sum(not math.isfinite(share) for share in left)
        more = [share for share in left if math.isfinite(share) and share > NOTED]
        if more:
            names = self.job.roles.criteria[self.job.roles.minimise].name
            notes.append(
                f"{counted(len(more), 'candidate')} may be no local optimum: one more step is predicted to save up to "
                f"{100 * max(more):.2g} % of its {names} ('left' in the provenance)"
            )
        if open_:
            notes.append(f"{counted(open_, 'candidate')} may be no local optimum: the time limit stopped the descent")
        return notes

    def _ideal(self) -> str:
        """Return a text: for each cost that ``epsilon`` bounds, the smallest value that a warm start has."""
        ideal = self.grid.costs.min(axis=0)
        return "the least costs of the warm starts are " + ", ".join(
            f"{c.name} {value:.4g} {c.unit}"
            for c, value, limit in zip(self.job.roles.criteria, ideal, self.grid.limits, strict=True)
            if math.isfinite(limit)
        )
