"""One job of the spline planner: lower the costs of one path by steps, each proved free, until they gain little.

A piece is the part of a spline between two knots. The merit, which steps lower, is the weighted sum of scaled costs,
plus penalties for exceeded bounds.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.goals.approach import split
from hpop.motions import JointCollision, States
from hpop.planners.programs import ONE_PROGRAM, Deadline, ImprovedTrajectory, Outcome
from hpop.planners.programs.spline.knots import LAW, Knots, PieceCosts, SplineLaw
from hpop.planners.programs.spline.step import Aim, Step, StepProgram, StepPrograms
from hpop.runtime.limits import one_numpy_thread
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

FRACTIONS = np.linspace(0.125, 1.0, 8)  # of each piece, at which the distance between bodies is bounded
APART = 0.15  # m: bodies that are farther apart do not limit a step
MARGIN = 0.004  # m: least distance between bodies in a step; the proof of being free needs 1 mm
FIRST, LAST, MOST = 0.2, 2e-5, 0.6  # rad or m: size of the trust region: at first, least and largest
SHRINKS, GROWS = 0.35, 1.7  # factors on the trust region after a failed step and after a good one
ROUND, LEAST_ROUND = 0.3, 1e-4  # share of the trust region, and rad or m, over which a kink of a cost is rounded
STEPS, RECENT = 60, 6  # largest number of steps; the search ends if RECENT steps together gain little
SLOWEST = 2.0  # times the duration of the path: largest duration of a spline
REST = 2e-4  # share of the merit: a smaller predicted gain ends the search, and so does a smaller gain of RECENT steps
ENOUGH = 0.05  # share of its predicted gain that a step must achieve
SETTLED = 1e-3  # share of the merit: a spline is settled if one more step is predicted to gain less
INSIDE = 1e-5  # rad or m: distance that joints keep from their limits, for the error of the solver
WIDE = FIRST * SHRINKS  # rad or m: least size of the trust region for the prediction that settles a spline
QUADRATURE = 0.01  # relative: difference of planned and reported costs
CUT_SHORT = "cut short"  # name under which paths are counted that the deadline ended
NOTHING_LESS = "no step costs less than its path"
SPREAD = 1e-2  # weight of the costs that are not minimised


@dataclass(eq=False)
class _PathRun:
    """Work on one path: its finished splines, and the steps towards the next one.

    counts   number of events of each name, such as "steps"
    longest  s  duration of the path
    settled  whether one more step is predicted to gain almost nothing
    splines  finished splines
    steps    spline at the beginning of the current search, then after each step, all of them proved free
    approach  straight approach at the end of the path, which stays as it is; None if there is none
    """

    counts: Counter[str]
    longest: float = 0.0
    settled: bool = False
    splines: list[ImprovedTrajectory] = field(default_factory=list)
    steps: list[Knots] = field(default_factory=list)
    approach: Trajectory | None = None


@dataclass(frozen=True, eq=False)
class SplineJob:
    """Search for splines, path by path: the data that all paths share, and the cost functions of this process.

    problem      problem to plan
    criteria     k criteria
    smooth       indices of the criteria with gradients; the others are not optimised
    minimise     index of the criterion with most weight; None: equal weights, and then each criterion by itself
    pieces       approximate number of pieces of a spline
    deadline     time after which no step begins
    built        the cost functions under the key "pieces", once they are built; not pickled
    interrupted  path that Ctrl-C interrupted, with its splines so far
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    smooth: tuple[int, ...]
    minimise: int | None
    pieces: int
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)
    built: dict[str, PieceCosts] = field(default_factory=dict)
    interrupted: list[tuple[Trajectory, Outcome[tuple[ImprovedTrajectory, ...]]]] = field(default_factory=list)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "built": {}, "interrupted": []}

    def solve(self, trajectory: Trajectory) -> Outcome[tuple[ImprovedTrajectory, ...]]:
        """Return the splines of one path, or the reason why there are none.

        The result depends on the path alone, unless the deadline passes. After Ctrl-C the splines found so far are
        stored in ``interrupted``, and KeyboardInterrupt is raised.
        """
        seconds, counts = {"build": 0.0, "solve": 0.0}, Counter[str]()
        run = _PathRun(counts)
        with ONE_PROGRAM, one_numpy_thread():
            began = time.perf_counter()
            try:
                if not self.built:
                    smooth = [self.criteria[j] for j in self.smooth]
                    self.built["pieces"] = PieceCosts(self.problem.world, self.problem.model, smooth)
                self.built["pieces"].build()
                seconds["build"] = time.perf_counter() - began
                result = self._splined(trajectory, self.built["pieces"], run)
            except KeyboardInterrupt:
                if run.splines:
                    self.interrupted.append((trajectory, Outcome.of(tuple(run.splines), counts, seconds)))
                raise
            seconds["solve"] = time.perf_counter() - began - seconds["build"]
        return Outcome.of(result, counts, seconds)

    def compile_kernels(self, trajectory: Trajectory) -> None:
        """Compile the collision kernels that steps use, or load them from the cache, by checking one trajectory."""
        self._collision.separations(trajectory.states.take([0]), APART)
        for _, m in trajectory.batches(self.problem.world):
            self._collision.motions_free(m)

    def _splined(self, path: Trajectory, pieces: PieceCosts, run: _PathRun) -> tuple[ImprovedTrajectory, ...] | str:
        if not path.duration:
            return "the start is the goal"
        kept = split(self.problem.target, path, self.problem.world)
        if not kept:
            return "it consists of its straight approach"
        if kept < len(path):
            path, run.approach = path.part(0, kept), path.part(kept, len(path))
        run.longest = path.duration
        (bounds,) = trajectory_costs(self.criteria, [path], self.problem.world)[:, list(self.smooth)]
        reason = ""
        for evenly in (False, True):  # from the path itself, else from a slower spline
            knots = Knots.along(path, pieces.law, self.pieces, evenly=evenly)
            if not self._is_free(knots):
                reason = "the first spline through its states cannot be proved free of collisions"
            elif not (reason := self._from(knots, pieces, bounds, run)):
                break
        return tuple(run.splines) or reason

    def _from(self, knots: Knots, pieces: PieceCosts, bounds: FloatArray, run: _PathRun) -> str:
        """Search for a spline for each weight vector, and record it; return the reason if there is none, else "".

        knots   spline at the beginning
        bounds  (k,)  costs of the path, which splines must not exceed
        """
        scale, reason = np.where(bounds > 1e-3, bounds, 1.0), ""
        for weights in self._weights():
            if self._is_late(run.counts):
                return "" if run.splines else reason or "no time was left"
            # Each search starts from the last result; the first one, of equal weights, is near to all others.
            run.steps, run.settled = [knots], False
            try:
                for better in self._improved(knots, pieces, Aim(weights, bounds, scale), run):
                    run.steps.append(better)
            finally:  # also after Ctrl-C, as all steps are certified
                knots, worse = self._record(run, pieces, bounds)
            reason = reason or worse
        return "" if run.splines else reason

    def _record(self, run: _PathRun, pieces: PieceCosts, bounds: FloatArray) -> tuple[Knots, str]:
        """Record the last step of a search or, if it is no candidate, the last one before it within ``bounds``.

        Returns the last step, and the reason why neither is recorded, or "" if one is. ``bounds`` (k,) are the costs of
        the path.
        """
        last = run.steps[-1]
        if len(run.steps) == 1:  # the start is the path, or was recorded already
            return last, NOTHING_LESS
        spline, reason = self._candidate(last, pieces, bounds, run, run.settled)
        within = [knots for knots in run.steps[1:-1] if (pieces.costs(knots) <= bounds).all()] if reason else []
        if within:
            spline, reason = self._candidate(within[-1], pieces, bounds, run, False)
        if not reason:
            run.splines.append(spline)
        return last, reason

    def _candidate(
        self, knots: Knots, pieces: PieceCosts, bounds: FloatArray, run: _PathRun, settled: bool
    ) -> tuple[ImprovedTrajectory, str]:
        """Make a candidate of a spline, and compare its costs with those of the path from which it was made.

        Returns the candidate, and a text that names the costs in which the spline is worse than the path. The text is
        "" if there are none. Only costs with gradients are compared. If the path ends with a straight approach, as some
        goals require, the candidate stops at the end of the spline and then makes this approach.

        bounds   (k,)  costs of the path that have gradients, without its straight approach
        run      record of the work on the path
        settled  whether one more step is predicted to gain almost nothing; stored in the candidate's provenance
        """
        trajectory = knots.trajectory(self.problem.model, pieces.law)
        (costs,) = trajectory_costs(self.criteria, [trajectory], self.problem.world)
        quanta = np.array([criterion.quantum for criterion in self.criteria])
        worse = costs[list(self.smooth)] > bounds + 0.5 * quanta[list(self.smooth)]
        names = [self.criteria[j].name for j, more in zip(self.smooth, worse, strict=True) if more]
        planned = costs.copy()
        planned[list(self.smooth)] = pieces.costs(knots)
        if run.approach is not None:
            trajectory = trajectory.then(run.approach)
            costs, after = trajectory_costs(self.criteria, [trajectory, run.approach], self.problem.world)
            worst = np.array([criterion.aggregate == "max" for criterion in self.criteria])
            planned = np.where(worst, np.maximum(planned, after), planned + after)
        provenance = {"pieces": knots.shares.size, "settled": settled}
        spline = ImprovedTrajectory(trajectory, planned, QUADRATURE * np.abs(costs) + quanta, provenance)
        return spline, f"no better than its path in {', '.join(names)}" if names else ""

    def _weights(self) -> list[FloatArray]:
        """Return vectors of weights (k,) of the smooth costs; with each vector, one spline is searched per path."""
        count = len(self.smooth)
        alone = [np.where(np.arange(count) == j, 1.0, SPREAD) for j in range(count)]
        if self.minimise is not None:
            return [alone[self.smooth.index(self.minimise)]]
        return [np.full(count, 1.0 / count), *(alone if count > 1 else [])]

    def _improved(self, knots: Knots, pieces: PieceCosts, aim: Aim, run: _PathRun) -> Iterator[Knots]:
        """Yield the spline after each step, free of collisions and with lower merit (the sum that steps minimise).

        knots   spline at the beginning
        pieces  cost functions
        aim     weights and bounds of the costs, which define the merit
        run     record of the work, in which steps are counted

        The search ends when steps gain almost nothing, after STEPS steps, or at the deadline.
        """
        counts, longest = run.counts, max(SLOWEST * run.longest, knots.duration)
        space = self.problem.model.space
        turning = np.array([name in space.turning for name in pieces.law.names])
        low, high = np.where(turning, -np.inf, space.low), np.where(turning, np.inf, space.high)
        steps = StepPrograms(knots.shares, pieces.law, low + INSIDE, high - INSIDE)
        costs, distance, multipliers = pieces.costs(knots), FIRST, np.zeros(aim.weights.size)
        merits = [merit := aim.merit(costs)]
        for _ in range(STEPS):
            counts["steps"] += 1
            apart = self._collision.separations(self._states(knots, pieces.law), APART)
            bends = pieces.curvature(knots, (aim.weights + multipliers) / aim.scale, max(LEAST_ROUND, ROUND * distance))
            program = steps.of(knots, aim, pieces.slopes(knots), bends, apart, MARGIN, FRACTIONS)
            if len(merits) > RECENT and merits[-1 - RECENT] - merit < REST * merit:
                run.settled = self._rests(program, longest, merit)
                return
            while True:
                if self._is_late(counts):
                    return
                counts["programs"] += 1
                step = program.within(distance, longest)
                if step is not None:
                    if step.gain <= REST * merit and distance >= WIDE:
                        run.settled = True
                        return
                    moved, costs = self._taken(step, knots, pieces, aim)
                    if (costs > aim.bounds).any():
                        moved, costs = self._corrected(program, distance, longest, costs - step.costs, (moved, costs))
                    lower = aim.merit(costs)
                    if lower <= merit - ENOUGH * step.gain and step.gain > 0 and self._is_free(moved):
                        break
                distance *= SHRINKS
                if distance < LAST:
                    run.settled = self._rests(program, longest, merit)
                    return
            good = merit - lower > 0.5 * step.gain
            knots, merit, multipliers = moved, lower, step.multipliers
            merits.append(merit)
            yield knots
            distance = min(MOST, distance * (GROWS if good else 1.0))

    def _rests(self, program: StepProgram, longest: float, merit: float) -> bool:
        """Return whether the spline is settled: a step in a wide trust region is predicted to gain almost nothing.

        That is at most SETTLED of the merit. False if the prediction fails.

        program  quadratic program for steps from the spline
        longest  s, upper bound of the total time
        merit    merit of the spline: the sum that steps lower
        """
        step = program.within(WIDE, longest)
        return step is not None and step.gain <= SETTLED * merit

    def _corrected(
        self, program: StepProgram, distance: float, longest: float, drift: FloatArray, first: tuple[Knots, FloatArray]
    ) -> tuple[Knots, FloatArray]:
        """Try a second step after a first one broke bounds; return the spline with the lower merit, and its costs.

        This is a second-order correction. ``drift`` (k,) holds the costs after the first step minus their linear
        prediction; the second step adds it to its own prediction. ``first`` is the spline after the first step, with
        its costs; the other arguments are those with which that step was computed.
        """
        step = program.within(distance, longest, drift)
        if step is None:
            return first
        second = self._taken(step, program.knots, self.built["pieces"], program.aim)
        return min(first, second, key=lambda result: program.aim.merit(result[1]))

    def _taken(self, step: Step, knots: Knots, pieces: PieceCosts, aim: Aim) -> tuple[Knots, FloatArray]:
        """Return the spline after a step, and its costs (k,).

        Its duration is the one that the step chose, or the least possible if the merit (the sum that steps lower) is
        then lower.
        """
        quickest = knots.moved(step.values, step.slopes, pieces.law)
        slower = quickest.lasting(max(quickest.duration, knots.duration + step.duration))
        tried = [(moved, pieces.costs(moved)) for moved in (quickest, slower)]
        return min(tried, key=lambda result: aim.merit(result[1]))

    def _is_late(self, counts: Counter[str]) -> bool:
        """Return whether the deadline has passed; if so, count the path as cut short."""
        late = self.deadline.is_past
        if late:
            counts[CUT_SHORT] = 1
        return late

    @property
    def _collision(self) -> JointCollision:
        return cast(JointCollision, self.problem.model.collision(self.problem.world))

    def _states(self, knots: Knots, law: SplineLaw) -> States:
        """Return the joint values of the spline at FRACTIONS of each piece, all pieces at the first fraction first.

        ``law`` names the joints.
        """
        rows = np.concatenate([knots.at(fraction) for fraction in FRACTIONS.tolist()])
        return States(**dict(zip(law.names, rows.T, strict=True)))

    def _is_free(self, knots: Knots) -> bool:
        """Return whether the collision model proves that the spline is free throughout."""
        model = self.problem.model
        trajectory = knots.trajectory(model, cast(SplineLaw, model.laws[LAW]))
        return all(bool(self._collision.motions_free(m).all()) for _, m in trajectory.batches(self.problem.world))
