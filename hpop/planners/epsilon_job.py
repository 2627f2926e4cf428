"""One bound of the epsilon-constraint method: solve, repair what is not trusted, tidy; here or in a worker."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import FloatArray
from hpop.planners.epsilon_grid import LOOSE, Cell, Found, Known, Roles
from hpop.planners.polyline import PolylineProgram, Solution
from hpop.planners.trust import judge
from hpop.planners.vertices import PIECE, Structure

if TYPE_CHECKING:
    from hpop.problem import Problem

QUADRATURE = 5e-3  # relative: a program's sums over pieces of 0.6 m against sums over field cells
REPAIRS = 3  # solves with corrected bounds after a solution that collides or exceeds its bounds
GAIN = 1e-3  # relative: a round that gains less is the last
LEAST_TURN = math.radians(1.0)  # a vertex that turns by less is left out, and with it the stop for the turn
KEPT = 250  # programs that a process keeps, of some 4 MB each
NUDGE = 0.05  # m: a warm start that did not converge is displaced by about this
INFEASIBLE = "Infeasible_Problem_Detected"

Task = tuple[Cell, Known]  # bounds, and the trajectory to start from


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one bound.

    found    the candidate, or None
    reason   why there is none, else ""
    counts   how often something happened on the way
    seconds  of building programs and of solving them
    """

    found: Found | None
    reason: str
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PolylineJob:
    """What all bounds share. Pickled without its programs: each process builds those it needs, once a structure.

    problem
    roles
    rounds   programs a bound, each from the last solution
    """

    problem: Problem
    roles: Roles
    rounds: int
    programs: dict[Structure, PolylineProgram] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "programs": {}}

    def solve(self, task: Task) -> Outcome:
        """What comes of a bound; depends on the task alone."""
        attempt, began = _Attempt(self, *task), time.perf_counter()
        result = attempt.run()
        attempt.seconds["solve"] = time.perf_counter() - began - attempt.seconds["build"]
        found, reason = (None, result) if isinstance(result, str) else (result, "")
        return Outcome(found, reason, attempt.counts, attempt.seconds)

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
    counts: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0})

    def run(self) -> Found | str:
        """Solve from the warm start, again from the solution while that gains something: a candidate, or why none."""
        minimise = self.job.roles.minimise
        known, best = self.start, self._solve(self.start, 0)
        for number in range(1, self.job.rounds):
            if isinstance(best, str) or self._gain(known, best) <= GAIN * abs(known.costs[minimise]):
                break
            known, again = best.known, self._solve(best.known, number)
            if isinstance(again, str) or self._gain(known, again) <= 0:
                break
            best = again
        return best if isinstance(best, str) else self._tidied(best)

    def _gain(self, known: Known, found: Found) -> float:
        """How much less than known a candidate costs in what is minimised."""
        minimise = self.job.roles.minimise
        return float(known.costs[minimise] - found.known.costs[minimise])

    def _solve(self, known: Known, number: int) -> Found | str:
        """One program from one warm start: a candidate that is trusted, or why there is none."""
        roles, problem, cell = self.job.roles, self.job.problem, self.cell
        smooth, program, warm = list(roles.smooth), self._program(known.polyline.structure), known.polyline
        epsilon, costs = cell.epsilon[smooth], known.costs[smooth]
        # What the program's coarser sum is off at the warm start is added to the bounds.
        drift = np.nan_to_num(program.costs(warm) - costs)
        quanta = np.array([roles.criteria[j].quantum for j in smooth])
        aim = epsilon + np.maximum(LOOSE * np.abs(epsilon), 0.2 * quanta) + drift
        bounds = program.bounds(warm)
        scale = np.where(costs > 1e-6, costs, 1.0)
        solution = program.solve(warm, aim, scale=scale, bounds=bounds)
        perturbed = not solution.converged
        if perturbed:
            self.counts["perturbed"] += 1
            again = program.solve(warm.moved(np.random.default_rng(cell.of), NUDGE), aim, scale=scale, bounds=bounds)
            solution = again if again.converged else solution
            self.counts["saved by perturbation"] += again.converged
        repairs, reason = 0, ""
        while solution.converged:
            trajectory = solution.polyline.trajectory(problem.model)
            judged = judge(problem, roles.criteria, [trajectory], epsilon=cell.epsilon[None])
            reason, costs = judged.reasons[0], judged.costs[0]
            if not reason:
                told = {"round": number, "perturbed": perturbed, "repairs": repairs}
                return self._candidate(Known(solution.polyline, costs), solution, told)
            if repairs == REPAIRS or not program.freedom:
                return reason
            repairs += 1
            self.counts["repairs"] += 1
            if reason == "collides":
                bounds = program.raised(bounds, solution.polyline)
            aim = aim - 1.2 * np.nan_to_num(np.maximum(costs - cell.epsilon, 0.0)[smooth])
            solution = program.solve(solution.polyline, aim, scale=scale, bounds=bounds)
        word = "infeasible" if solution.status == INFEASIBLE and not reason else "not converged"
        return f"{word} ({f'{reason}; ' * bool(reason)}{solution.status})"

    def _candidate(self, known: Known, solution: Solution, told: dict[str, Any]) -> Found:
        """A solution with where it comes from; what no program adds up is planned as it is."""
        cell, roles, planned = self.cell, self.job.roles, known.costs.copy()
        if np.isfinite(solution.costs).all():
            planned[list(roles.smooth)] = solution.costs
        bounded = zip(roles.criteria, cell.epsilon.tolist(), strict=True)
        provenance = {
            "planner": "epsilon-constraint",
            "minimise": roles.criteria[roles.minimise].name,
            "epsilon": {c.name: bound for c, bound in bounded if math.isfinite(bound)},
            "warm_start": cell.of,
            "level": cell.level,
            "segments": len(known.polyline.lengths),
            "status": solution.status,
            "iterations": solution.iterations,
            **told,
        }
        return Found(cell, known, planned, provenance)

    def _tidied(self, found: Found) -> Found:
        """Without stops for turns that are none; where pieces have grown too long, added up again in finer ones."""
        job, known = self.job, found.known
        polyline = known.polyline.simplified(LEAST_TURN)
        if len(polyline.vertices) < len(known.polyline.vertices):
            trajectory = polyline.trajectory(job.problem.model)
            judged = judge(job.problem, job.roles.criteria, [trajectory], epsilon=self.cell.epsilon[None])
            if not judged.reasons[0] and (judged.costs[0] <= known.costs * (1 + LOOSE)).all():
                self.counts["simplified"] += 1
                simpler = Known(polyline, judged.costs[0])
                told = {**found.provenance, "segments": len(polyline.lengths)}
                return Found(self.cell, simpler, self._planned(simpler, 1), told)
        if (np.abs(found.planned - known.costs) > job.tolerance(found.planned)).any():
            self.counts["recounted"] += 1
            return dataclasses.replace(found, planned=self._planned(known, 4))
        return found

    def _planned(self, known: Known, finer: int) -> FloatArray:
        """Costs (k,) as the program of a polyline adds them up, in pieces so many times finer."""
        structure, planned, smooth = known.polyline.structure, known.costs.copy(), list(self.job.roles.smooth)
        pieces = tuple(finer * count for count in structure.pieces)
        costs = self._program(dataclasses.replace(structure, pieces=pieces)).costs(known.polyline)
        planned[smooth] = np.where(np.isfinite(costs), costs, planned[smooth])
        return planned

    def _program(self, structure: Structure) -> PolylineProgram:
        """The program of a structure, built when it is first needed in this process."""
        programs, roles = self.job.programs, self.job.roles
        if structure not in programs:
            if len(programs) >= KEPT:  # the one built first goes
                del programs[next(iter(programs))]
            began = time.perf_counter()
            smooth = tuple(roles.criteria[j] for j in roles.smooth)
            program = PolylineProgram(self.job.problem, smooth, roles.smooth.index(roles.minimise), structure)
            programs[structure] = program.build()
            self.counts["programs"] += 1
            self.seconds["build"] += time.perf_counter() - began
        return programs[structure]
