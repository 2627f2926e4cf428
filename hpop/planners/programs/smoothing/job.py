"""Smoothing one polyline: solve, repair what collides, refuse what is no longer the same way; here or in a worker."""

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
from hpop.criteria.comfort.turns import LEAST_TURN
from hpop.criteria.costs import trajectory_costs
from hpop.models.driven import driven
from hpop.planners.judgement import judge
from hpop.planners.needs import on_wheels
from hpop.planners.programs.outcome import CUT_SHORT, ONE_PROGRAM, SOLVING, Deadline, Improved, Outcome
from hpop.planners.programs.polyline import Polyline, homotopic
from hpop.planners.programs.smoothing.phases import Guess, Phases, first_guess, legs, structure_of
from hpop.planners.programs.smoothing.program import Asked, Driven, DrivenProgram
from hpop.runtime.limits import LimitPassed, within
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

# The first solution has a margin and weights of time and effort, and reads obstacles from a field, so it only lies near
# a local optimum. From there the program is solved again almost without these weights. What its field and its samples
# are off where the solution lies is added to its bounds: a first-order correction, as in trust-region methods with
# approximate models (Alexandrov, Dennis, Lewis and Torczon 1998, doi 10.1007/BF01197433). A solution counts if its
# reported costs are lower and it is free on the exact geometry.


# Each is a list of least field values (S,) at a program's samples, one array a height range.


MARGIN = 0.04  # m: kept beside the robot's reach, for what lies between two samples
SLACK = 1e-3  # m: by which the polyline itself keeps its bounds
ALONG = 0.1  # m: distance of the places at which the clearance of a polyline is read
DENSE = 0.03  # m: distance of the places at which a solution's clearance is checked


def along_polyline(program: DrivenProgram, polyline: Polyline) -> list[FloatArray]:
    """Return least field values (S,) at the program's samples, one array a height range.

    The robot's reach and a margin, but no more than the polyline has in the same phase and in those beside it: that is
    free, and the way through a narrow passage shall be feasible.
    """
    places, _ = legs(polyline)
    world, phase = program.problem.world, program.structure.phase[program.samples[0]]
    bounds = []
    for z, reach in program.spaces:
        field = world.clearance_field(z=z)
        least = []
        for leg in places:
            line = shapely.LineString(leg)
            stations = np.linspace(0.0, line.length, int(np.ceil(line.length / ALONG)) + 1)
            least.append(float(field(*shapely.get_coordinates(shapely.line_interpolate_point(line, stations)).T).min()))
        near = np.minimum.reduce([least, [*least[1:], np.inf], [np.inf, *least[:-1]]])
        bounds.append(np.minimum(reach + MARGIN, near - SLACK)[phase])
    return bounds


def exact(program: DrivenProgram, trajectory: Trajectory, spare: float) -> list[FloatArray]:
    """Return bounds that leave the robot ``spare`` metres at the samples, by exact distances along a solution."""
    here, world, found = trajectory.at(_times(program, trajectory)), program.problem.world, []
    for z, reach in program.spaces:
        distance = world.free_space(z).signed_clearance(here.x, here.y)
        found.append(world.clearance_field(z=z)(here.x, here.y) - (distance - reach) + spare)
    return found


def raised(
    program: DrivenProgram, bounds: Sequence[FloatArray], trajectory: Trajectory, spare: float
) -> list[FloatArray]:
    """Return bounds that are higher where a solution comes too near to an obstacle, by exact distances all along it.

    They are raised by ``spare`` metres more than what was lacking.
    """
    sampled, world = _times(program, trajectory), program.problem.world
    count = int(np.ceil(trajectory.duration * on_wheels(program.problem.model).speed / DENSE)) + 2
    times = np.linspace(0.0, trajectory.duration, count)
    at, here = trajectory.at(times), trajectory.at(sampled)
    nearest = np.clip(np.searchsorted(sampled, times), 1, len(sampled) - 1)
    found = []
    for (z, reach), bound in zip(program.spaces, bounds, strict=True):
        lacking = reach - world.free_space(z).signed_clearance(at.x, at.y)
        more = np.zeros(len(bound))
        for side in (nearest - 1, nearest):
            np.maximum.at(more, side, np.where(lacking > -spare, lacking + spare, 0.0))
        field = world.clearance_field(z=z)(here.x, here.y)
        found.append(np.where(more > 0, np.maximum(bound, field + more), bound))
    return found


def _times(program: DrivenProgram, trajectory: Trajectory) -> FloatArray:
    """Time (S,), s, of each sample."""
    owner, share = program.samples
    return np.asarray(trajectory.times[owner] + share * trajectory.durations[owner])


LAST_REPAIRS = 4  # solves with corrected bounds after a solution that is not to be trusted
LAST_SPARE = 2.2e-3  # m: kept from obstacles, as the certificate of a curve takes robots to be 2 mm larger
RAISED = 1.1 * LAST_SPARE  # m: kept where a solution came too near between two samples


class Judged(NamedTuple):
    """A solution with its exact costs (k,) and their merit, and the candidate that it is; None if it is not trusted."""

    driven: Driven
    costs: FloatArray
    merit: float
    candidate: Improved | None


def refined(
    begin: Judged,
    program: DrivenProgram,
    guess: Guess,
    asked: Callable[[Judged], Asked],
    judge: Callable[[Driven], Judged],
) -> Judged | None:
    """Return the local optimum near a solution; None where no solve converged to one that is trusted.

    Parameters
    ----------
    guess : that the solution was found from: signs and phases
    asked : from a solution to weights, bounds and scales of the costs
    judge : from a solution to its exact costs, and whether it is trusted on the exact geometry
    """
    bounds, clearances = asked(begin), exact(program, begin.driven.goes, LAST_SPARE)
    for _ in range(1 + LAST_REPAIRS):
        driven = program.refined(begin.driven, guess, bounds, clearances)
        if driven.trajectory is None:
            return None
        found = judge(driven)
        if found.candidate is not None:
            return found if found.merit < begin.merit else begin
        bounds, clearances = asked(found), raised(program, clearances, driven.goes, RAISED)
        begin = begin._replace(driven=driven)
    return None


LOOSE = 0.02  # relative: bounds are looser than what the polyline costs when it is executed
QUADRATURE = 0.01  # relative: a program's sums over its intervals against sums over field cells
REPAIRS = 5  # solves with higher clearances after a solution that collides
SPREAD = 1e-2  # weight of the costs that are not minimised
OVERSHOOT = 1.2  # times its excess: by how much the bound of a worst moment is lowered inside the program
LEAST_LEFT = 0.4  # of what it is there: more may be out of reach
SPARE = 5e-3  # m: by which a bound is raised beyond what was lacking
LATE = "not settled"  # what jobs count where time ended during the last step
POINTS = 20  # of each interval, by which its way is compared with the polyline


class _Solved(NamedTuple):
    """A solution that is trusted, of which program and from where."""

    driven: Driven
    program: DrivenProgram
    guess: Guess
    asked: Asked


@dataclass(frozen=True, eq=False)
class SmoothingJob:
    """What all polylines share. Pickled without its programs: each process builds those it needs, once a structure.

    problem
    criteria   k
    minimise   place of the one that counts most; None weighs all alike
    intervals  count of each program, at least
    deadline
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
        """Places of the criteria that enter the program; its structure settles the others."""
        return [j for j, criterion in enumerate(self.criteria) if criterion.smooth]

    @property
    def _worst(self) -> BoolArray:
        """Whether each of the smooth criteria takes the worst moment."""
        return np.array([self.criteria[j].aggregate == "max" for j in self.smooth])

    def solve(self, trajectory: Trajectory) -> Outcome[Improved]:
        """What comes of one polyline; depends on it alone."""
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

    def _smoothed(self, trajectory: Trajectory, counts: Counter[str], seconds: dict[str, float]) -> Improved | str:
        whole = Polyline.of(trajectory, self.problem)
        polyline = whole.simplified(LEAST_TURN)
        if not len(polyline.lengths):
            return "goes nowhere"
        reference = polyline.trajectory(self.problem.model)
        measured = trajectory_costs(self.criteria, [reference, reference.execution()], self.problem.world)
        epsilon = measured.max(axis=0) * (1 + LOOSE) + [criterion.quantum for criterion in self.criteria]
        structure = structure_of(polyline, self.intervals)
        if not structure.turns:
            return self._straight(reference, epsilon)
        program = self._program(structure, seconds)
        solved = self._solve(program, polyline, epsilon, counts)
        if isinstance(solved, str):
            return solved
        found, costs = self._checked(solved.driven, structure, whole, epsilon, counts)
        if isinstance(found, str):
            return found

        turns, weights = found.provenance["turns"], solved.asked.weights / solved.asked.scale

        def judged(driven: Driven) -> Judged:
            better, every = self._checked(driven, structure, whole, epsilon, counts)
            candidate = None if isinstance(better, str) or better.provenance["turns"] > turns else better
            costs = every[self.smooth]
            return Judged(driven, costs, float(weights @ costs), candidate)

        def asked(one: Judged) -> Asked:
            # The program sees worst moments in samples and fields: what it is off is added to their bounds.
            drift = np.where(self._worst, one.driven.costs - one.costs, 0.0)
            return replace(solved.asked, epsilon=epsilon[self.smooth] + drift)

        costs = costs[self.smooth]
        begin = Judged(solved.driven, costs, float(weights @ costs), found)
        try:
            settled = refined(begin, program, solved.guess, asked, judged)
        except LimitPassed:
            settled = None
            counts[LATE] = 1
        if settled is None:
            return replace(found, provenance={**found.provenance, "settled": False})
        assert settled.candidate is not None  # it is trusted
        return settled.candidate

    def _straight(self, reference: Trajectory, epsilon: FloatArray) -> Improved | str:
        """Without turns nothing is free but the speeds: as fast as they may be."""
        model, length = (
            on_wheels(self.problem.model),
            float(np.hypot(*(np.ptp(c) for c in (reference.states.x, reference.states.y)))),
        )
        ramp = min(model.speed / model.acceleration, math.sqrt(length / model.acceleration))
        cruise = max(0.0, length / (model.acceleration * ramp) - ramp)
        pose = [float(column[0]) for column in (reference.states.x, reference.states.y, reference.states.yaw)]
        controls = [(model.acceleration, 0.0, ramp), (0.0, 0.0, cruise), (-model.acceleration, 0.0, ramp)]
        goes = driven(model, pose, controls)
        judged = judge(self.problem, self.criteria, [goes], epsilon=epsilon[None])
        provenance = self._provenance("nothing is free", 0, 0, 0)
        return judged.reasons[0] or Improved(goes, judged.costs[0], self._tolerance(judged.costs[0], goes), provenance)

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
        """A solution that neither collides nor has too bad a moment on exact geometry, or why there is none."""
        smooth, worst, model = self.smooth, self._worst, on_wheels(self.problem.model)
        weights = np.where(worst, SPREAD, 1.0) / len(smooth)
        if self.minimise is not None:
            weights = np.where(np.array(smooth) == self.minimise, 1.0, SPREAD)
        bounds, aim = along_polyline(program, polyline), epsilon[smooth]
        asked = Asked(weights, aim, np.where(aim > 1e-3, aim, 1.0))
        guess = first_guess(polyline, program.structure, model)

        def solve() -> Driven:
            self.deadline.check(SOLVING)
            for exact in (True, False) if not counts["saved by quasi-Newton"] else (False,):
                counts["programs"] += 1
                found = program.solve(guess, asked, bounds, exact=exact)
                if found.trajectory is not None:
                    counts["saved by quasi-Newton"] += not exact
                    break
            return found

        solution, repaired = solve(), ""
        while solution.trajectory is not None:
            judged = judge(self.problem, self.criteria, [solution.trajectory], epsilon=epsilon[None])
            excess = np.where(worst, judged.costs[0][smooth] - epsilon[smooth], 0.0)
            reason = judged.reasons[0]
            if not reason or (reason != "collides" and not (excess > 0).any()):
                return _Solved(solution, program, guess, asked)
            if counts["repairs"] == REPAIRS:
                return reason
            repaired = f"{reason}; "
            counts["repairs"] += 1
            if reason == "collides":
                bounds = raised(program, bounds, solution.trajectory, SPARE)
            lower = np.maximum(solution.costs - OVERSHOOT * excess, LEAST_LEFT * solution.costs)
            asked = replace(asked, epsilon=np.where(excess > 0, lower, asked.epsilon))
            guess = program.again(guess, solution.trajectory)
            solution = solve()
        return f"{repaired}not converged ({solution.status})"

    def _checked(
        self,
        solution: Driven,
        structure: Phases,
        polyline: Polyline,
        epsilon: FloatArray,
        counts: Counter[str],
    ) -> tuple[Improved | str, FloatArray]:
        """A candidate that keeps its bounds, its turns and its way, or which of these it does not; its costs (k,)."""
        goes = solution.goes
        judged = judge(self.problem, self.criteria, [goes], epsilon=epsilon[None])
        costs = judged.costs[0]
        if judged.reasons[0]:
            return judged.reasons[0], costs
        turns = sum(int((np.abs(ended) > LEAST_TURN).sum()) for ended in goes.turns)
        if turns < structure.turns:
            return "lowers the number of turns", costs
        path = path_points(goes)
        spaces = {id(s): s for s in map(self._space, self.problem.model.platform)}.values()
        if not all(homotopic(path, polyline.vertices, space) for space in spaces):
            return "leaves the homotopy class of its polyline", costs
        planned = costs.copy()
        planned[self.smooth] = solution.costs
        tolerance = self._tolerance(planned, goes)
        if (np.abs(costs - planned) > tolerance).any():
            return "was planned with too coarse a sum", costs
        provenance = self._provenance(solution.status, solution.iterations, turns, counts["repairs"])
        return Improved(goes, planned, tolerance, provenance), costs

    def _space(self, part: Any) -> Any:
        return self.problem.world.free_space((part.z_min, part.z_max))

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

    def _tolerance(self, planned: FloatArray, goes: Trajectory) -> FloatArray:
        """Sums within QUADRATURE; maxima within what one unit a metre changes between samples and in the field."""
        longest = float(np.hypot(np.diff(goes.states.x), np.diff(goes.states.y)).max())
        worst = np.array([criterion.aggregate == "max" for criterion in self.criteria])
        quanta = np.array([criterion.quantum for criterion in self.criteria])
        between = self.problem.world.cell + longest / 4
        return np.asarray(np.where(worst, between, QUADRATURE * np.abs(planned)) + quanta)


def path_points(trajectory: Trajectory) -> FloatArray:
    """Points (N, 2), m, along a driven trajectory."""
    share = np.arange(POINTS) / POINTS
    times = (trajectory.times[:-1, None] + trajectory.durations[:, None] * share).ravel()
    states = trajectory.at(np.append(times, trajectory.duration))
    return np.stack([states.x, states.y], axis=1)
