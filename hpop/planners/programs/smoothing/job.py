"""Smoothing of one polyline: solve a program, repair collisions, refine, and check the result."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray
from hpop.criteria.base import Criterion
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.criteria.costs import trajectory_costs
from hpop.models.driven import driven
from hpop.planners.judgement import judge
from hpop.planners.needs import on_wheels
from hpop.planners.programs import CUT_SHORT, ONE_PROGRAM, SOLVING, Deadline, ImprovedTrajectory, Outcome
from hpop.planners.programs.polyline import Polyline, homotopic, path_points
from hpop.planners.programs.smoothing.phases import (
    CostTargets,
    Guess,
    Phases,
    ProgramSolution,
    first_guess,
    phase_legs,
    structure_of,
)
from hpop.planners.programs.smoothing.program import DrivenProgram
from hpop.runtime.limits import LimitPassed, within
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

# The first solution keeps a margin from obstacles, has weights of time and effort, and reads distances from a sampled
# field. So it only lies near a local optimum. From there the program is solved again, almost without these weights. The
# error of its field and its samples at the solution is added to its bounds: a first-order correction, as in
# trust-region methods with approximate models (Alexandrov, Dennis, Lewis and Torczon 1998, doi 10.1007/BF01197433). A
# solution is accepted if its exact costs are lower and it is free on the exact geometry.
#
# "Clearance bounds" below are the least values that the field of distances to obstacles may have at the S samples of a
# program: a list of arrays (S,), one for each height range.

MARGIN = 0.04  # m: clearance beyond the robot's reach, for the error between two samples
SLACK = 1e-3  # m: by which the polyline itself keeps its bounds
ALONG = 0.1  # m between the samples of a polyline's clearance
DENSE = 0.03  # m between the points at which a solution's clearance is checked


def along_polyline(program: DrivenProgram, polyline: Polyline) -> list[FloatArray]:
    """Return the clearance bounds of the first program: a list of arrays (S,), m, one for each height range.

    Each bound is the robot's reach and a margin. In a narrow passage, where the polyline itself comes nearer, it is a
    bit less than the least field value along the polyline in this phase and its two neighbours, so that the polyline
    stays feasible.
    """
    legs, _ = phase_legs(polyline)
    world, phase = program.problem.world, program.structure.phase[program.samples[0]]
    bounds = []
    for z, reach in program.spaces:
        field = world.clearance_field(z=z)
        least = []
        for leg in legs:
            line = shapely.LineString(leg)
            stations = np.linspace(0.0, line.length, int(np.ceil(line.length / ALONG)) + 1)
            least.append(float(field(*shapely.get_coordinates(shapely.line_interpolate_point(line, stations)).T).min()))
        near = np.minimum.reduce([least, [*least[1:], np.inf], [np.inf, *least[:-1]]])
        bounds.append(np.minimum(reach + MARGIN, near - SLACK)[phase])
    return bounds


def exact(program: DrivenProgram, trajectory: Trajectory, spare: float) -> list[FloatArray]:
    """Return clearance bounds that leave exactly ``spare`` metres between robot and obstacles near a solution.

    At each sample, the difference between the field and the exact distance at the solution corrects the bound. The
    result is a list of arrays (S,), m, one for each height range.
    """
    states, world, bounds = trajectory.at(_times(program, trajectory)), program.problem.world, []
    for z, reach in program.spaces:
        distance = world.free_space(z).signed_clearance(states.x, states.y)
        bounds.append(world.clearance_field(z=z)(states.x, states.y) - (distance - reach) + spare)
    return bounds


def raised(
    program: DrivenProgram, bounds: Sequence[FloatArray], trajectory: Trajectory, spare: float
) -> list[FloatArray]:
    """Raise clearance bounds where a solution comes too near to an obstacle, and return them.

    Exact distances are computed at points along the solution. A point is too near if less than ``spare`` metres remain.
    At the two samples next to it, the new bound is at least the clearance there, plus what is missing, plus ``spare``.
    """
    sampled, world = _times(program, trajectory), program.problem.world
    count = int(np.ceil(trajectory.duration * on_wheels(program.problem.model).speed / DENSE)) + 2
    times = np.linspace(0.0, trajectory.duration, count)
    at, at_samples = trajectory.at(times), trajectory.at(sampled)
    nearest = np.clip(np.searchsorted(sampled, times), 1, len(sampled) - 1)
    raised_bounds = []
    for (z, reach), bound in zip(program.spaces, bounds, strict=True):
        lacking = reach - world.free_space(z).signed_clearance(at.x, at.y)
        more = np.zeros(len(bound))
        for side in (nearest - 1, nearest):
            np.maximum.at(more, side, np.where(lacking > -spare, lacking + spare, 0.0))
        field = world.clearance_field(z=z)(at_samples.x, at_samples.y)
        raised_bounds.append(np.where(more > 0, np.maximum(bound, field + more), bound))
    return raised_bounds


def _times(program: DrivenProgram, trajectory: Trajectory) -> FloatArray:
    """Return the time (S,), s, at which a trajectory passes each sample of the program."""
    owner, share = program.samples
    return np.asarray(trajectory.times[owner] + share * trajectory.durations[owner])


LAST_REPAIRS = 4  # solves with corrected bounds after a solution that fails the exact checks
LAST_SPARE = 2.2e-3  # m of clearance, as the exact check of a curve enlarges robots by 2 mm
RAISED = 1.1 * LAST_SPARE  # m of clearance, where a solution came too near between two samples


class Judged(NamedTuple):
    """Solution with its exact costs (k,), their weighted sum ``merit``, and its candidate, None if a check failed."""

    solution: ProgramSolution
    costs: FloatArray
    merit: float
    candidate: ImprovedTrajectory | None


def refined(
    begin: Judged,
    program: DrivenProgram,
    guess: Guess,
    targets: Callable[[Judged], CostTargets],
    judge: Callable[[ProgramSolution], Judged],
) -> Judged | None:
    """Solve the program again from a first solution, with corrected bounds, to reach the local optimum nearby.

    Returns the refined solution, or the first one if that has the lower merit. Returns None if a solve does not
    converge, or if no solution passes the exact checks.

    Parameters
    ----------
    guess : initial values from which the first solution was found, with the signs of its turns
    targets : returns the weights, bounds and scales of the costs for a program that starts at a solution
    judge : returns the exact costs of a solution, and its candidate
    """
    goals, clearances = targets(begin), exact(program, begin.solution.curve, LAST_SPARE)
    for _ in range(1 + LAST_REPAIRS):
        solution = program.refined(begin.solution, guess, goals, clearances)
        if solution.trajectory is None:
            return None
        judged = judge(solution)
        if judged.candidate is not None:
            return judged if judged.merit < begin.merit else begin
        goals, clearances = targets(judged), raised(program, clearances, solution.curve, RAISED)
        begin = begin._replace(solution=solution)
    return None


LOOSE = 0.02  # relative: by how much bounds exceed the costs of the polyline
QUADRATURE = 0.01  # relative: difference of sums over intervals and over field cells
REPAIRS = 5  # solves with higher clearances after a solution that collides
SPREAD = 1e-2  # weight of the costs that are not minimised
OVERSHOOT = 1.2  # times its excess: by how much the bound of a maximum is lowered inside the program
LEAST_LEFT = 0.4  # of its value: a lowered bound is not less
SPARE = 5e-3  # m: by which a clearance bound is raised beyond the missing clearance
LATE = "not settled"  # counted by jobs that the deadline ended while they refined


class _Solved(NamedTuple):
    """Solution that passes the exact checks, with the program, initial guess and cost targets that gave it."""

    solution: ProgramSolution
    program: DrivenProgram
    guess: Guess
    targets: CostTargets


@dataclass(frozen=True, eq=False)
class SmoothingJob:
    """Smoothing of polylines one by one: the data that they share, and a cache of programs.

    problem    problem to plan
    criteria   k criteria
    minimise   index of the criterion with most weight; None for equal weights
    intervals  least number of intervals of a program
    deadline   time at which solving ends
    programs   cache of this process by phases; it is not pickled
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    minimise: int | None
    intervals: int
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)
    programs: dict[Phases, DrivenProgram] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "programs": {}}

    @property
    def smooth(self) -> list[int]:
        """Indices of the criteria that the program has: those with a gradient, and a dose that is minimised.

        The others only count moves and turns.
        """
        return [j for j, criterion in enumerate(self.criteria) if criterion.smooth or criterion.dose is not None]

    @property
    def _worst(self) -> BoolArray:
        """Mask over the smooth criteria, True for those that are a maximum over the trajectory."""
        return np.array([self.criteria[j].aggregate == "max" for j in self.smooth])

    def solve(self, trajectory: Trajectory) -> Outcome[ImprovedTrajectory]:
        """Smooth one polyline; return its candidate, or the reason why there is none; other polylines do not matter."""
        seconds, counts = {"build": 0.0, "solve": 0.0}, Counter[str]()
        with ONE_PROGRAM:
            began = time.perf_counter()
            try:
                with within(self.deadline):
                    result = self._smoothed(trajectory, counts, seconds)
            except LimitPassed:
                counts[CUT_SHORT] = 1
                result = CUT_SHORT
            seconds["solve"] = time.perf_counter() - began - seconds["build"]
        return Outcome.of(result, counts, seconds)

    def _smoothed(
        self, trajectory: Trajectory, counts: Counter[str], seconds: dict[str, float]
    ) -> ImprovedTrajectory | str:
        """Solve, check and refine; return the candidate of one polyline, or the reason why there is none."""
        original = Polyline.of(trajectory, self.problem)
        polyline = original.simplified(LEAST_TURN)
        if not len(polyline.lengths):
            return "the start is the goal position"
        reference = polyline.trajectory(self.problem.model)
        measured = trajectory_costs(self.criteria, [reference, reference.execution()], self.problem.world)
        epsilon = measured.max(axis=0) * (1 + LOOSE) + [criterion.quantum for criterion in self.criteria]
        structure = structure_of(polyline, self.intervals)
        if not structure.turns and not any(criterion.dose for criterion in self.criteria):
            return self._straight(reference, epsilon)
        program = self._program(structure, seconds)
        solved = self._solve(program, polyline, epsilon, counts)
        if isinstance(solved, str):
            return solved
        first, costs = self._checked(solved.solution, structure, original, epsilon, counts)
        if isinstance(first, str):
            return first

        turns, weights = first.provenance["turns"], solved.targets.weights / solved.targets.scale

        def judged(solution: ProgramSolution) -> Judged:
            better, costs = self._checked(solution, structure, original, epsilon, counts)
            candidate = None if isinstance(better, str) or better.provenance["turns"] > turns else better
            return Judged(solution, costs[self.smooth], float(weights @ costs[self.smooth]), candidate)

        def targets(at: Judged) -> CostTargets:
            # The program evaluates maxima at samples and on fields: this error is added to their bounds.
            drift = np.where(self._worst, at.solution.costs - at.costs, 0.0)
            return replace(solved.targets, epsilon=epsilon[self.smooth] + drift)

        begin = Judged(solved.solution, costs[self.smooth], float(weights @ costs[self.smooth]), first)
        try:
            settled = refined(begin, program, solved.guess, targets, judged)
        except LimitPassed:
            settled = None
            counts[LATE] = 1
        if settled is None:
            return replace(first, provenance={**first.provenance, "settled": False})
        assert settled.candidate is not None  # `refined` returns accepted solutions only
        return settled.candidate

    def _straight(self, reference: Trajectory, epsilon: FloatArray) -> ImprovedTrajectory | str:
        """Return the candidate for a polyline without turns: the fastest straight drive, or why it is refused.

        reference  the polyline as a trajectory
        epsilon    (k,)  upper bounds of the costs
        """
        model = on_wheels(self.problem.model)
        length = float(np.hypot(*(np.ptp(c) for c in (reference.states.x, reference.states.y))))
        ramp = min(model.speed / model.acceleration, math.sqrt(length / model.acceleration))
        cruise = max(0.0, length / (model.acceleration * ramp) - ramp)
        pose = [float(column[0]) for column in (reference.states.x, reference.states.y, reference.states.yaw)]
        controls = [(model.acceleration, 0.0, ramp), (0.0, 0.0, cruise), (-model.acceleration, 0.0, ramp)]
        curve = driven(model, pose, controls)
        judged = judge(self.problem, self.criteria, [curve], epsilon=epsilon[None])
        provenance, tolerance = self._provenance("nothing is free", 0, 0, 0), self._tolerance(judged.costs[0], curve)
        return judged.reasons[0] or ImprovedTrajectory(curve, judged.costs[0], tolerance, provenance)

    def _program(self, structure: Phases, seconds: dict[str, float]) -> DrivenProgram:
        if structure not in self.programs:
            began = time.perf_counter()
            smooth = tuple(self.criteria[j] for j in self.smooth)
            self.programs[structure] = DrivenProgram(self.problem, smooth, structure, self.deadline).build()
            seconds["build"] = time.perf_counter() - began
        return self.programs[structure]

    def _solve(
        self, program: DrivenProgram, polyline: Polyline, epsilon: FloatArray, counts: Counter[str]
    ) -> _Solved | str:
        """Solve the first program, with tighter bounds after each collision or excess of a bound by exact geometry.

        Returns the solution that passes, or the reason of the failure. ``epsilon`` (k,) are bounds of the exact costs.
        """
        smooth, worst, model = self.smooth, self._worst, on_wheels(self.problem.model)
        weights = np.where(worst, SPREAD, 1.0) / len(smooth)
        if self.minimise is not None:
            weights = np.where(np.array(smooth) == self.minimise, 1.0, SPREAD)
        bounds, aim = along_polyline(program, polyline), epsilon[smooth]
        targets = CostTargets(weights, aim, np.where(aim > 1e-3, aim, 1.0))
        guess = first_guess(polyline, program.structure, model)

        def solve() -> ProgramSolution:
            self.deadline.check(SOLVING)
            for exact in (True, False) if not counts["saved by quasi-Newton"] else (False,):
                counts["programs"] += 1
                attempt = program.solve(guess, targets, bounds, exact=exact)
                if attempt.trajectory is not None:
                    counts["saved by quasi-Newton"] += not exact
                    break
            return attempt

        solution, repaired = solve(), ""
        while solution.trajectory is not None:
            judged = judge(self.problem, self.criteria, [solution.trajectory], epsilon=epsilon[None])
            excess = np.where(worst, judged.costs[0][smooth] - epsilon[smooth], 0.0)
            reason = judged.reasons[0]
            if not reason or (reason != "collides" and not (excess > 0).any()):
                return _Solved(solution, program, guess, targets)
            if counts["repairs"] == REPAIRS:
                return reason
            repaired = f"{reason}; "
            counts["repairs"] += 1
            if reason == "collides":
                bounds = raised(program, bounds, solution.trajectory, SPARE)
            lower = np.maximum(solution.costs - OVERSHOOT * excess, LEAST_LEFT * solution.costs)
            targets = replace(targets, epsilon=np.where(excess > 0, lower, targets.epsilon))
            guess = program.guess_at(guess, solution.trajectory)
            solution = solve()
        return f"{repaired}not converged ({solution.status})"

    def _checked(
        self,
        solution: ProgramSolution,
        structure: Phases,
        polyline: Polyline,
        epsilon: FloatArray,
        counts: Counter[str],
    ) -> tuple[ImprovedTrajectory | str, FloatArray]:
        """Return the candidate of a solution, or the reason why it fails an exact check, and its exact costs (k,).

        The checks are collisions, bounds (``epsilon``), turns, homotopy class, and planned against exact costs.
        """
        curve = solution.curve
        judged = judge(self.problem, self.criteria, [curve], epsilon=epsilon[None])
        costs = judged.costs[0]
        if judged.reasons[0]:
            return judged.reasons[0], costs
        turns = sum(int((np.abs(angles) > LEAST_TURN).sum()) for angles in curve.turns)
        if turns < structure.turns:
            return "has fewer turns than its polyline", costs
        path = path_points(curve)
        free = (self.problem.world.free_space((part.z_min, part.z_max)) for part in self.problem.model.platform)
        spaces = {id(space): space for space in free}.values()
        if not all(homotopic(path, polyline.vertices, space) for space in spaces):
            return "passes an obstacle on another side than its polyline", costs
        planned = costs.copy()
        planned[self.smooth] = solution.costs
        tolerance = self._tolerance(planned, curve)
        if (np.abs(costs - planned) > tolerance).any():
            return "has planned costs that are off by more than the tolerance", costs
        provenance = self._provenance(solution.status, solution.iterations, turns, counts["repairs"])
        return ImprovedTrajectory(curve, planned, tolerance, provenance), costs

    def _provenance(self, status: str, iterations: int, turns: int, repairs: int) -> dict[str, Any]:
        minimise = None if self.minimise is None else self.criteria[self.minimise].name
        return {
            "planner": "smoothing",
            "minimise": minimise,
            "turns": turns,
            "status": status,
            "iterations": iterations,
            "repairs": repairs,
            "settled": True,
        }

    def _tolerance(self, planned: FloatArray, curve: Trajectory) -> FloatArray:
        """Return the largest error (k,) of planned costs.

        For a sum, this is the share QUADRATURE of the cost. A maximum is computed at samples of the curve and at cells
        of the world's grid, so it may be missed in between. It is assumed to change by at most one unit per metre, so
        the difference is at most the cell size plus the distance between samples. One quantum (the smallest difference
        of a cost that counts) is added to each.
        """
        longest = float(np.hypot(np.diff(curve.states.x), np.diff(curve.states.y)).max())
        worst = np.array([criterion.aggregate == "max" for criterion in self.criteria])
        quanta = np.array([criterion.quantum for criterion in self.criteria])
        spacing = self.problem.world.cell + longest / 4
        return np.asarray(np.where(worst, spacing, QUADRATURE * np.abs(planned)) + quanta)
