"""One bound of the epsilon-constraint method: solve, repair what is not trusted, tidy; here or in a worker."""

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
from hpop.planners.programs.epsilon_constraint.descent import Descent, Pieces
from hpop.planners.programs.epsilon_constraint.grid import LOOSE, Cell, Found, Known, Roles
from hpop.planners.programs.epsilon_constraint.program import REGION, PolylineProgram, Solution
from hpop.planners.programs.outcome import CUT_SHORT, ONE_PROGRAM, Deadline, Outcome
from hpop.planners.programs.polyline import PIECE, Polyline, PolylineStructure
from hpop.runtime.limits import LimitPassed, within

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

QUADRATURE = 1e-3  # relative: sums over pieces against sums over whole motions
REPAIRS = 3  # solves with corrected bounds after a solution that collides or exceeds its bounds
GAIN = 1e-3  # relative: a round that gains less is the last
AT_BORDER = 0.95  # share of the region of a program: a round that moves all vertices by less is the last
SHARE = 0.7  # of what a bound may be exceeded by, up to which steps of the corners may do so
KEPT = 250  # programs that a process keeps, of some 4 MB each
NUDGE = 0.05  # m: a warm start that did not converge is displaced by about this
INFEASIBLE = "Infeasible_Problem_Detected"

Task = tuple[Cell, Known]  # bounds, and the trajectory to start from


@dataclass(frozen=True, eq=False)
class PolylineJob:
    """What all bounds share. Pickled without its programs: each process builds those it needs, once a structure.

    problem
    roles
    rounds   programs a bound, each from the last solution
    deadline
    """

    problem: Problem
    roles: Roles
    rounds: int
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)
    programs: dict[PolylineStructure, PolylineProgram] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "programs": {}}

    def solve(self, task: Task) -> Outcome[Found]:
        """What comes of a bound; depends on the task alone."""
        attempt = _Attempt(self, *task)
        with ONE_PROGRAM:
            began = time.perf_counter()
            result = attempt.run()
            attempt.seconds["solve"] = time.perf_counter() - began - attempt.seconds["build"]
        return Outcome.of(result, attempt.counts, attempt.seconds)

    def tolerance(self, planned: FloatArray) -> FloatArray:
        """How far planned costs (., k) may be off.

        Sums by QUADRATURE; maxima by what one unit a metre changes between samples and in the field.
        """
        between = self.problem.world.cell + PIECE / 4
        worst = np.array([c.aggregate == "max" for c in self.roles.criteria])
        quanta = np.array([c.quantum for c in self.roles.criteria])
        tolerance: FloatArray = np.where(worst, between, QUADRATURE * np.abs(planned)) + quanta
        return tolerance


@dataclass(eq=False)
class _Attempt:
    """One bound at work."""

    job: PolylineJob
    cell: Cell
    start: Known
    best: Found | None = None
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0})

    def run(self) -> Found | str:
        """A candidate, or why there is none; where time is over, the best until then."""
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
        """Solve from the warm start, again from the solution while that gains something; settle the corners.

        Keeps the best candidate as it goes; returns why there is none.
        """
        minimise = self.job.roles.minimise
        known, reason = self.start, ""
        for number in range(self.job.rounds):
            try:
                again = self._solve(known, number)
            except LimitPassed:
                if self.is_late():
                    raise
                self.counts[CUT_SHORT] = 1  # too large a program for the time that is left: corners move without it
                break
            if isinstance(again, str):
                reason = again
                break
            if self.best is not None and self._gain(known, again) <= 0:
                break
            gain, moved = self._gain(known, again), again.known.polyline.farthest(known.polyline)
            known, self.best = again.known, again
            if gain <= GAIN * abs(known.costs[minimise]) or moved < AT_BORDER * REGION:
                break
        if self.best is None and not self.job.deadline.is_past:
            if exceeds(self.start.costs, self.cell.epsilon, self.job.roles.criteria).any():
                return reason
            settled = self._settled(self._candidate(self.start, None, {"round": 0, "status": reason}))
            if self._gain(self.start, settled) > 0:
                self.best = settled
                self.counts["without a program"] += 1
        elif self.best is not None:
            self.best = self._settled(self.best)
        return reason

    def _gain(self, known: Known, found: Found) -> float:
        """How much less than known a candidate costs in what is minimised."""
        minimise = self.job.roles.minimise
        return float(known.costs[minimise] - found.known.costs[minimise])

    def _solve(self, known: Known, number: int) -> Found | str:
        """One program from one warm start: a candidate that is trusted, or why there is none."""
        roles, cell, warm = self.job.roles, self.cell, known.polyline
        smooth = list(roles.smooth)
        program = self._program(warm.structure)
        scale = self._scale(known)
        bounds, at, reason = program.bounds(warm), known, ""
        provenance: dict[str, Any] = {"round": number, "perturbed": False, "repairs": 0}
        while True:
            # What the program is off where it begins is added to the bounds, motion by motion in worst moments.
            corrections = program.corrections(at.polyline)
            drift = np.nan_to_num(program.costs(at.polyline, corrections) - at.costs[smooth])
            given: dict[str, Any] = {"scale": scale, "bounds": bounds, "corrections": corrections}
            solution = program.solve(at.polyline, self._aim + drift, **given)
            if not solution.converged and at is known and not self.is_late():
                provenance["perturbed"] = True
                self.counts["perturbed"] += 1
                nudged = warm.moved(np.random.default_rng(cell.of), NUDGE)
                again = program.solve(nudged, self._aim + drift, **given)
                solution = again if again.converged else solution
                self.counts["saved by perturbation"] += again.converged
            if not solution.converged:
                word = "infeasible" if solution.status == INFEASIBLE and not reason else "not converged"
                return f"{word} ({f'{reason}; ' if reason else ''}{solution.status})"
            reason, costs = self._judged(solution.polyline)
            at = Known(solution.polyline, costs)
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
        """Whether time is over; if so it is counted."""
        late = self.job.deadline.is_past
        if late:
            self.counts[CUT_SHORT] = 1
        return late

    @property
    def _aim(self) -> FloatArray:
        """Bounds of the smooth costs, loosened so that a solver can move."""
        roles, epsilon = self.job.roles, self.cell.epsilon[list(self.job.roles.smooth)]
        quanta = np.array([roles.criteria[j].quantum for j in roles.smooth])
        return np.asarray(epsilon + np.maximum(LOOSE * np.abs(epsilon), 0.2 * quanta))

    def _scale(self, known: Known) -> FloatArray:
        costs = known.costs[list(self.job.roles.smooth)]
        return np.where(costs > 1e-6, costs, 1.0)

    def _judged(self, polyline: Polyline) -> tuple[str, FloatArray]:
        """What is wrong with a polyline, "" for nothing, and its costs (k,)."""
        job = self.job
        trajectory = polyline.trajectory(job.problem.model)
        judged = judge(job.problem, job.roles.criteria, [trajectory], epsilon=self.cell.epsilon[None])
        return judged.reasons[0], judged.costs[0]

    def _candidate(self, known: Known, solution: Solution | None, provenance: dict[str, Any]) -> Found:
        """A polyline with where it comes from."""
        cell, roles = self.cell, self.job.roles
        bounded = zip(roles.criteria, cell.epsilon.tolist(), strict=True)
        provenance = {
            "planner": "epsilon-constraint",
            "minimise": roles.criteria[roles.minimise].name,
            "epsilon": {c.name: bound for c, bound in bounded if math.isfinite(bound)},
            "warm_start": cell.of,
            "level": cell.level,
            "segments": len(known.polyline.lengths),
            **({} if solution is None else {"status": solution.status, "iterations": solution.iterations}),
            **provenance,
        }
        return Found(cell, known, self._planned(known), provenance)

    def _settled(self, found: Found) -> Found:
        """The candidate after its corners came to rest by exact costs."""
        roles, smooth = self.job.roles, list(self.job.roles.smooth)
        descent = Descent(
            self.job.problem,
            [roles.criteria[j] for j in smooth],
            smooth.index(roles.minimise),
            self._aim,
            SHARE * accepted(self.cell.epsilon, roles.criteria)[smooth] + (1 - SHARE) * self.cell.epsilon[smooth],
            self._scale(found.known),
            self._costs_if_trusted,
            self._costs_on_map,
            self._free,
            self.is_late,
        )
        rest = descent.run(found.known.polyline, found.known.costs[smooth])
        self.counts["steps"] += rest.steps
        _, costs = self._judged(rest.polyline)
        settled = Known(rest.polyline, costs)
        provenance = {**found.provenance, "segments": len(rest.polyline.lengths), "steps": rest.steps}
        if math.isfinite(rest.left):
            provenance["left"] = rest.left
        return Found(self.cell, settled, self._planned(settled), provenance)

    def _costs_if_trusted(self, polyline: Polyline) -> FloatArray | None:
        """Costs (k,) of the smooth criteria; None where it collides or exceeds a bound. Ends stay where they are."""
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
        """Costs (m, k) of the smooth criteria, NaN of polylines that leave the map."""
        problem, roles = self.job.problem, self.job.roles
        trajectories = [polyline.trajectory(problem.model) for polyline in polylines]
        inside = np.array([on_map(problem, trajectory.states).all() for trajectory in trajectories], dtype=bool)
        costs = np.full((len(polylines), len(roles.smooth)), np.nan)
        on = [trajectory for trajectory, is_on in zip(trajectories, inside, strict=True) if is_on]
        costs[inside] = trajectory_costs([roles.criteria[j] for j in roles.smooth], on, problem.world)
        return costs

    def _planned(self, known: Known) -> FloatArray:
        """Costs (k,) as they add up piece by piece."""
        batches = Pieces(known.polyline.structure).numbers(self.job.problem, known.polyline)
        planned = known.costs.copy()
        for j in self.job.roles.smooth if known.polyline.structure.segments else ():
            criterion = self.job.roles.criteria[j]
            values = np.concatenate([motion_costs(criterion, batch) for batch in batches])
            planned[j] = values.max() if criterion.aggregate == "max" else values.sum()
        return planned

    def _program(self, structure: PolylineStructure) -> PolylineProgram:
        """The program of a structure, built when it is first needed in this process."""
        programs, roles = self.job.programs, self.job.roles
        if structure not in programs:
            if len(programs) >= KEPT:  # the one built first goes
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
