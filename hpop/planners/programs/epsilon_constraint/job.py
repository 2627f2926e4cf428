"""One job of the epsilon-constraint method: minimise a cost within one set of bounds, from one warm start.

It solves a nonlinear program, repairs solutions that collide, and ends with a descent on exact costs.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.criteria.costs import motion_costs, trajectory_costs
from hpop.planners.judgement import accepted, are_free, exceeds, is_free, judge, on_map
from hpop.planners.programs import CUT_SHORT, ONE_PROGRAM, Deadline, Outcome
from hpop.planners.programs.epsilon_constraint.descent import Descent, PolylineMotions
from hpop.planners.programs.epsilon_constraint.grid import LOOSE, Cell, CellCandidate, FreePolyline, Roles
from hpop.planners.programs.epsilon_constraint.program import REGION, PolylineProgram, Solution
from hpop.planners.programs.polyline import PIECE, Polyline, PolylineStructure
from hpop.runtime.limits import LimitPassed, within

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

QUADRATURE = 1e-3  # relative: difference between sums over pieces and over whole motions
REPAIRS = 3  # solves with corrected bounds after a solution that collides or exceeds its bounds
GAIN = 1e-3  # relative: a round that lowers the cost by less is the last one
AT_BORDER = 0.95  # share of a program's region: a round that moves all vertices by less is the last one
SHARE = 0.7  # share of a bound's tolerance by which the descent may exceed the bound
CACHED = 250  # programs in the cache of a process, of some 4 MB each
NUDGE = 0.05  # m: typical displacement of a warm start from which the solver did not converge
INFEASIBLE = "Infeasible_Problem_Detected"

Task = tuple[Cell, FreePolyline]  # bounds, and the polyline to start from


@dataclass(frozen=True, eq=False)
class PolylineJob:
    """Solver of single cells (sets of bounds) of the grid: the data that they share, and a cache of programs.

    problem   problem to be planned
    roles     which criterion is minimised, and which are bounded
    rounds    number of programs for each cell; each starts from the last solution
    deadline  time at which solving ends
    programs  cache of this process by structure; it is not pickled
    """

    problem: Problem
    roles: Roles
    rounds: int
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)
    programs: dict[PolylineStructure, PolylineProgram] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "programs": {}}

    def solve(self, task: Task) -> Outcome[CellCandidate]:
        """Solve one cell; return its candidate, or the reason why there is none.

        The result depends on the task alone, unless the deadline passes.
        """
        attempt = _Attempt(self, *task)
        with ONE_PROGRAM:
            began = time.perf_counter()
            result = attempt.run()
            attempt.seconds["solve"] = time.perf_counter() - began - attempt.seconds["build"]
        return Outcome.of(result, attempt.counts, attempt.seconds)

    def tolerance(self, planned: FloatArray) -> FloatArray:
        """Return the largest error (., k) of planned costs (., k).

        For a sum, this is the share QUADRATURE of the cost. A maximum is computed at samples of the curve and at cells
        of the world's grid, so it may be missed in between. It is assumed to change by at most one unit per metre, so
        the difference is at most the cell size plus the distance between samples. One quantum (the smallest difference
        of a cost that counts) is added to each.
        """
        spacing = self.problem.world.cell + PIECE / 4
        worst = np.array([c.aggregate == "max" for c in self.roles.criteria])
        quanta = np.array([c.quantum for c in self.roles.criteria])
        tolerance: FloatArray = np.where(worst, spacing, QUADRATURE * np.abs(planned)) + quanta
        return tolerance


@dataclass(eq=False)
class _Attempt:
    """Search for the candidate of one cell (set of bounds), in progress.

    start    polyline from which the search starts
    best     best candidate so far
    counts   number of events of each name, such as "repairs"
    seconds  spent, by kind of work
    """

    job: PolylineJob
    cell: Cell
    start: FreePolyline
    best: CellCandidate | None = None
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0})

    def run(self) -> CellCandidate | str:
        """Search until the deadline at most; return the best candidate, or the reason why there is none."""
        reason = CUT_SHORT
        try:
            with within(self.job.deadline):
                reason = self._search()
        except LimitPassed:
            self.counts[CUT_SHORT] = 1
        if self.best is None:
            return CUT_SHORT if self.counts[CUT_SHORT] else reason
        return self.best

    def _search(self) -> str:
        """Solve a program from the start, solve again from each solution while that helps, then descend.

        The best candidate is stored in ``best``; the result is the reason of the last failure, or "".
        """
        minimise = self.job.roles.minimise
        start, reason = self.start, ""
        for number in range(self.job.rounds):
            try:
                candidate = self._solve(start, number)
            except LimitPassed:
                if self.is_late():
                    raise
                self.counts[CUT_SHORT] = 1  # no time to build this program: descend without it
                break
            if isinstance(candidate, str):
                reason = candidate
                break
            if self.best is not None and self._gain(start, candidate) <= 0:
                break
            gain, moved = self._gain(start, candidate), candidate.solved.polyline.farthest(start.polyline)
            start, self.best = candidate.solved, candidate
            if gain <= GAIN * abs(start.costs[minimise]) or moved < AT_BORDER * REGION:
                break
        if self.best is None and not self.job.deadline.is_past:
            if exceeds(self.start.costs, self.cell.epsilon, self.job.roles.criteria).any():
                return reason
            settled = self._descended(self._candidate(self.start, None, {"round": 0, "status": reason}))
            if self._gain(self.start, settled) > 0:
                self.best = settled
                self.counts["without a program"] += 1
        elif self.best is not None:
            self.best = self._descended(self.best)
        return reason

    def _gain(self, start: FreePolyline, candidate: CellCandidate) -> float:
        """Return by how much the minimised cost, in its unit, is lower for a candidate than for a start."""
        minimise = self.job.roles.minimise
        return float(start.costs[minimise] - candidate.solved.costs[minimise])

    def _solve(self, start: FreePolyline, number: int) -> CellCandidate | str:
        """Solve the program, and again with corrected bounds while the solution collides or exceeds its bounds.

        start   polyline from which the solver starts
        number  number of the round

        Returns a candidate that passes all checks, or the reason why there is none.
        """
        roles, cell, warm = self.job.roles, self.cell, start.polyline
        smooth = list(roles.smooth)
        program = self._program(warm.structure)
        scale = self._scale(start)
        bounds, at, reason = program.bounds(warm), start, ""
        provenance: dict[str, Any] = {"round": number, "perturbed": False, "repairs": 0}
        while True:
            # The program's error in its costs at the start is added to the bounds; for maxima, motion by motion.
            corrections = program.corrections(at.polyline)
            drift = np.nan_to_num(program.costs(at.polyline, corrections) - at.costs[smooth])
            options: dict[str, Any] = {"scale": scale, "bounds": bounds, "corrections": corrections}
            solution = program.solve(at.polyline, self._aim + drift, **options)
            if not solution.converged and at is start and not self.is_late():
                provenance["perturbed"] = True
                self.counts["perturbed"] += 1
                nudged = warm.moved(np.random.default_rng(cell.of), NUDGE)
                retry = program.solve(nudged, self._aim + drift, **options)
                solution = retry if retry.converged else solution
                self.counts["saved by perturbation"] += retry.converged
            if not solution.converged:
                failure = "infeasible" if solution.status == INFEASIBLE and not reason else "not converged"
                return f"{failure} ({f'{reason}; ' if reason else ''}{solution.status})"
            reason, costs = self._judged(solution.polyline)
            at = FreePolyline(solution.polyline, costs)
            if not reason:
                return self._candidate(at, solution, provenance)
            if provenance["repairs"] == REPAIRS or not program.freedom or self.is_late():
                return reason
            provenance["repairs"] += 1
            self.counts["repairs"] += 1
            grown = program.structure.grown(solution.polyline.structure)
            if grown != program.structure:
                program = self._program(grown)
                bounds = program.bounds(warm)
            if reason == "collides":
                bounds = program.raised(bounds, solution.polyline)

    def is_late(self) -> bool:
        """Return whether the deadline has passed; if so, count this job as cut short."""
        late = self.job.deadline.is_past
        if late:
            self.counts[CUT_SHORT] = 1
        return late

    @property
    def _aim(self) -> FloatArray:
        """Bounds (k,) of the smooth costs, slightly loosened, since solvers work better with some room."""
        roles, epsilon = self.job.roles, self.cell.epsilon[list(self.job.roles.smooth)]
        quanta = np.array([roles.criteria[j].quantum for j in roles.smooth])
        return np.asarray(epsilon + np.maximum(LOOSE * np.abs(epsilon), 0.2 * quanta))

    def _scale(self, start: FreePolyline) -> FloatArray:
        costs = start.costs[list(self.job.roles.smooth)]
        return np.where(costs > 1e-6, costs, 1.0)

    def _judged(self, polyline: Polyline) -> tuple[str, FloatArray]:
        """Return why a polyline is refused (it collides or exceeds a bound), or "", and its exact costs (k,)."""
        job = self.job
        trajectory = polyline.trajectory(job.problem.model)
        judged = judge(job.problem, job.roles.criteria, [trajectory], epsilon=self.cell.epsilon[None])
        return judged.reasons[0], judged.costs[0]

    def _candidate(
        self, polyline: FreePolyline, solution: Solution | None, provenance: dict[str, Any]
    ) -> CellCandidate:
        """Return a polyline that is free of collisions as a candidate of this cell of the grid, with its planned costs.

        solution    result of the nonlinear program that found it, for the provenance; None if no program was solved
        provenance  further entries for the provenance of the candidate
        """
        cell, roles = self.cell, self.job.roles
        bounded = zip(roles.criteria, cell.epsilon.tolist(), strict=True)
        provenance = {
            "planner": "epsilon-constraint",
            "minimise": roles.criteria[roles.minimise].name,
            "epsilon": {c.name: bound for c, bound in bounded if math.isfinite(bound)},
            "warm_start": cell.of,
            "level": cell.level,
            "segments": len(polyline.polyline.lengths),
            **({} if solution is None else {"status": solution.status, "iterations": solution.iterations}),
            **provenance,
        }
        return CellCandidate(cell, polyline, self._planned(polyline), provenance)

    def _descended(self, candidate: CellCandidate) -> CellCandidate:
        """Move the corners of a candidate by a descent with exact costs, and return the result as a candidate."""
        roles, smooth = self.job.roles, list(self.job.roles.smooth)
        descent = Descent(
            self.job.problem,
            [roles.criteria[j] for j in smooth],
            smooth.index(roles.minimise),
            self._aim,
            SHARE * accepted(self.cell.epsilon, roles.criteria)[smooth] + (1 - SHARE) * self.cell.epsilon[smooth],
            self._scale(candidate.solved),
            self._costs_if_trusted,
            self._costs_on_map,
            self._free,
            self.is_late,
        )
        result = descent.run(candidate.solved.polyline, candidate.solved.costs[smooth])
        self.counts["steps"] += result.steps
        _, costs = self._judged(result.polyline)
        settled = FreePolyline(result.polyline, costs)
        provenance = {**candidate.provenance, "segments": len(result.polyline.lengths), "steps": result.steps}
        if math.isfinite(result.left):
            provenance["left"] = result.left
        return CellCandidate(self.cell, settled, self._planned(settled), provenance)

    def _costs_if_trusted(self, polyline: Polyline) -> FloatArray | None:
        """Return the exact costs (k,) of the smooth criteria; None if a polyline collides or breaks a bound.

        It is also None if the polyline leaves the map.
        """
        problem, roles = self.job.problem, self.job.roles
        trajectory = polyline.trajectory(problem.model)
        if not on_map(problem, trajectory.states).all() or not is_free(problem, trajectory):
            return None
        costs = trajectory_costs(roles.criteria, [trajectory], problem.world)[0]
        return None if exceeds(costs, self.cell.epsilon, roles.criteria).any() else costs[list(roles.smooth)]

    def _free(self, polylines: Sequence[Polyline]) -> BoolArray:
        problem = self.job.problem
        return are_free(problem, [polyline.trajectory(problem.model) for polyline in polylines])

    def _costs_on_map(self, polylines: Sequence[Polyline]) -> FloatArray:
        """Return the exact costs (m, k) of the smooth criteria for m polylines, NaN for those that leave the map."""
        problem, roles = self.job.problem, self.job.roles
        trajectories = [polyline.trajectory(problem.model) for polyline in polylines]
        inside = np.array([on_map(problem, trajectory.states).all() for trajectory in trajectories], dtype=bool)
        costs = np.full((len(polylines), len(roles.smooth)), np.nan)
        on = [trajectory for trajectory, is_on in zip(trajectories, inside, strict=True) if is_on]
        costs[inside] = trajectory_costs([roles.criteria[j] for j in roles.smooth], on, problem.world)
        return costs

    def _planned(self, solved: FreePolyline) -> FloatArray:
        """Return the costs (k,) of a polyline: smooth ones over the pieces of segments and turns, others exactly."""
        batches = PolylineMotions(solved.polyline.structure).of(self.job.problem, solved.polyline)
        planned = solved.costs.copy()
        for j in self.job.roles.smooth if solved.polyline.structure.segments else ():
            criterion = self.job.roles.criteria[j]
            values = np.concatenate([motion_costs(criterion, batch) for batch in batches])
            planned[j] = values.max() if criterion.aggregate == "max" else values.sum()
        return planned

    def _program(self, structure: PolylineStructure) -> PolylineProgram:
        """Return the program for polylines of a structure, from the cache or built now."""
        programs, roles = self.job.programs, self.job.roles
        if structure not in programs:
            if len(programs) >= CACHED:  # the oldest is dropped
                del programs[next(iter(programs))]
            began = time.perf_counter()
            smooth = tuple(roles.criteria[j] for j in roles.smooth)
            program = PolylineProgram(
                self.job.problem, smooth, roles.smooth.index(roles.minimise), structure, self.job.deadline
            )
            programs[structure] = program.build()
            self.counts["programs"] += 1
            self.seconds["build"] += time.perf_counter() - began
        return programs[structure]
