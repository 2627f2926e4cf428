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
from hpop.criteria.comfort.turns import LEAST_TURN
from hpop.planners.epsilon_constraint.grid import LOOSE, Cell, Found, Known, Roles
from hpop.planners.epsilon_constraint.program import PolylineProgram, Solution
from hpop.planners.judgement import exceeds, judge
from hpop.planners.polylines.polyline import PIECE, Polyline, PolylineStructure
from hpop.planners.programs.outcome import ONE_PROGRAM, Outcome

if TYPE_CHECKING:
    from hpop.problem import Problem

QUADRATURE = 5e-3  # relative: a program's sums over pieces of 0.6 m against sums over field cells
REPAIRS = 3  # solves with corrected bounds after a solution that collides or exceeds its bounds
GAIN = 1e-3  # relative: a round that gains less is the last
FINER = (4, 16)  # panels a phase of programs that are solved again because their sum was too coarse
KEPT = 250  # programs that a process keeps, of some 4 MB each
HALVINGS = 5  # of the way from a warm start to a solution that is not trusted
NUDGE = 0.05  # m: a warm start that did not converge is displaced by about this
INFEASIBLE = "Infeasible_Problem_Detected"

Task = tuple[Cell, Known]  # bounds, and the trajectory to start from


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
        return best if isinstance(best, str) else self._refined(self._tidied(best))

    def _gain(self, known: Known, found: Found) -> float:
        """How much less than known a candidate costs in what is minimised."""
        minimise = self.job.roles.minimise
        return float(known.costs[minimise] - found.known.costs[minimise])

    def _solve(self, known: Known, number: int, panels: int = 1) -> Found | str:
        """One program from one warm start: a candidate that is trusted, or why there is none."""
        roles, cell, warm = self.job.roles, self.cell, known.polyline
        smooth, structure = list(roles.smooth), dataclasses.replace(warm.structure, panels=panels)
        program = self._program(structure)
        epsilon, scale = cell.epsilon[smooth], np.where(known.costs[smooth] > 1e-6, known.costs[smooth], 1.0)
        quanta = np.array([roles.criteria[j].quantum for j in smooth])
        aim = epsilon + np.maximum(LOOSE * np.abs(epsilon), 0.2 * quanta)
        bounds, at, reason, last = program.bounds(warm), known, "", None
        provenance: dict[str, Any] = {"round": number, "panels": panels, "perturbed": False, "repairs": 0}
        while True:
            # What the program is off where it begins is added to the bounds, motion by motion in worst moments.
            corrections = program.corrections(at.polyline)
            drift = np.nan_to_num(program.costs(at.polyline, corrections) - at.costs[smooth])
            given: dict[str, Any] = {"scale": scale, "bounds": bounds, "corrections": corrections}
            solution = program.solve(at.polyline, aim + drift, **given)
            if not solution.converged and at is known:
                provenance["perturbed"] = True
                self.counts["perturbed"] += 1
                nudged = warm.moved(np.random.default_rng(cell.of), NUDGE)
                again = program.solve(nudged, aim + drift, **given)
                solution = again if again.converged else solution
                self.counts["saved by perturbation"] += again.converged
            if not solution.converged:
                break
            reason, costs = self._judged(solution.polyline)
            at, last = Known(solution.polyline, costs), solution
            if not reason:
                return self._candidate(at, solution, provenance)
            if provenance["repairs"] == REPAIRS or not program.freedom:
                break
            provenance["repairs"] += 1
            self.counts["repairs"] += 1
            grown = program.structure.grown(solution.polyline.structure)
            if grown != program.structure:
                program = self._program(grown)
                bounds = program.bounds(warm)
            if reason == "collides":
                bounds = program.raised(bounds, solution.polyline)
        between = None if last is None else self._between(known, last, provenance)
        if between is not None:
            return between
        if solution.converged:
            return reason
        word = "infeasible" if solution.status == INFEASIBLE and not reason else "not converged"
        return f"{word} ({f'{reason}; ' * bool(reason)}{solution.status})"

    def _judged(self, polyline: Polyline) -> tuple[str, FloatArray]:
        """What is wrong with a polyline, "" for nothing, and its costs (k,)."""
        job = self.job
        trajectory = polyline.trajectory(job.problem.model)
        judged = judge(job.problem, job.roles.criteria, [trajectory], epsilon=self.cell.epsilon[None])
        return judged.reasons[0], judged.costs[0]

    def _between(self, known: Known, solution: Solution, provenance: dict[str, Any]) -> Found | None:
        """Some of the way to a solution that is not trusted, from a warm start that keeps its bounds, if that gains."""
        if exceeds(known.costs, self.cell.epsilon, self.job.roles.criteria).any():
            return None
        for halvings in range(1, HALVINGS + 1):
            polyline = known.polyline.towards(solution.polyline, 0.5**halvings)
            reason, costs = self._judged(polyline)
            if reason:
                continue
            between = Known(polyline, costs)
            planned = self._planned(between, provenance["panels"])[list(self.job.roles.smooth)]
            found = self._candidate(
                between, dataclasses.replace(solution, costs=planned), {**provenance, "halvings": halvings}
            )
            if self._gain(known, found) <= 0:
                return None
            self.counts["shortened"] += 1
            return found
        return None

    def _candidate(self, known: Known, solution: Solution, provenance: dict[str, Any]) -> Found:
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
            **provenance,
        }
        return Found(cell, known, planned, provenance)

    def _tidied(self, found: Found) -> Found:
        """Without stops for turns that are none."""
        known = found.known
        polyline = known.polyline.simplified(LEAST_TURN)
        if len(polyline.vertices) == len(known.polyline.vertices):
            return found
        reason, costs = self._judged(polyline)
        if reason or (costs > known.costs * (1 + LOOSE)).any():
            return found
        self.counts["simplified"] += 1
        simpler = Known(polyline, costs)
        provenance = {**found.provenance, "segments": len(polyline.lengths)}
        return Found(self.cell, simpler, self._planned(simpler, 1), provenance)

    def _refined(self, found: Found) -> Found:
        """Solved again with a finer sum, as long as the sum is off by more than may be: it misled the solver."""
        for panels in FINER:
            if (np.abs(found.planned - found.known.costs) <= self.job.tolerance(found.planned)).all():
                return found
            self.counts["refined"] += 1
            again = self._solve(found.known, found.provenance["round"] + 1, panels)
            if isinstance(again, str) or self._gain(found.known, again) < 0:
                planned = self._planned(found.known, panels)
                found = dataclasses.replace(found, planned=planned, provenance={**found.provenance, "panels": panels})
            else:
                found = again
        return found

    def _planned(self, known: Known, panels: int) -> FloatArray:
        """Costs (k,) as the program of a polyline adds them up, with so many panels a phase."""
        structure, planned, smooth = known.polyline.structure, known.costs.copy(), list(self.job.roles.smooth)
        program = self._program(dataclasses.replace(structure, panels=panels))
        costs = program.costs(known.polyline, program.corrections(known.polyline))
        planned[smooth] = np.where(np.isfinite(costs), costs, planned[smooth])
        return planned

    def _program(self, structure: PolylineStructure) -> PolylineProgram:
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
