"""Making splines of one path, step by step, each proved free, until none gains much; here or in a worker."""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.motions import JointCollision, States
from hpop.planners.programs.outcome import ONE_PROGRAM, Improved, Outcome
from hpop.planners.programs.spline.knots import LAW, Knots, Pieces, SplineLaw
from hpop.planners.programs.spline.step import Aim, Steps
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

FRACTIONS = np.linspace(0.125, 1.0, 8)  # of each piece, where it is kept apart from obstacles
APART = 0.15  # m: bodies that are farther apart are left out of a step
MARGIN = 0.004  # m: how far they are kept apart; what is free by certificate comes no nearer than 1 mm
FIRST, LAST, MOST = 0.2, 0.0005, 0.6  # rad or m: how far a step is believed, at first, at least and at most
SHRINKS, GROWS = 0.35, 1.7  # where a step was too far, and where it was not
STEPS = 60
GAIN = 2e-3  # relative: of a step that is not worth another
QUADRATURE = 0.01  # relative: costs on the nodes of a piece against those that are reported
CUT_SHORT = "cut short"  # paths during which time was over
NOTHING_LESS = "no step costs less than its path"
SPREAD = 1e-2  # weight of the costs that are not minimised


@dataclass(eq=False)
class _Run:
    """One path at work: the splines found, and the steps towards the next, all of them free."""

    counts: Counter[str]
    found: list[Improved] = field(default_factory=list)
    steps: list[Knots] = field(default_factory=list)


@dataclass(frozen=True)
class Deadline:
    """A moment at which work ends, also in the processes of other machines.

    until    s  on the monotonic clock, which the processes of one machine share and nobody sets back
    wall     s  on the clock of :func:`time.time`, for other machines
    machine  where ``until`` holds
    """

    until: float
    wall: float
    machine: str

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the moment some seconds from now."""
        return cls(time.monotonic() + seconds, time.time() + seconds, platform.node())

    @property
    def is_past(self) -> bool:
        """Whether the moment is over."""
        if platform.node() == self.machine:
            return time.monotonic() > self.until
        return time.time() > self.wall


@dataclass(frozen=True, eq=False)
class SplineJob:
    """What all paths share. Pickled without what is built: each process builds it once.

    problem
    criteria  k
    smooth    places of those that have gradients; the others come as they come
    minimise  place of the one that counts most; None: all alike, and from there on each by itself
    pieces    count of each spline, about
    deadline  no step begins later; None without a time limit
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    smooth: tuple[int, ...]
    minimise: int | None
    pieces: int
    deadline: Deadline | None = None
    built: dict[str, Pieces] = field(default_factory=dict)
    interrupted: list[tuple[Trajectory, Outcome[tuple[Improved, ...]]]] = field(default_factory=list)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "built": {}, "interrupted": []}

    def solve(self, trajectory: Trajectory) -> Outcome[tuple[Improved, ...]]:
        """The splines of one path; they depend on it alone, but where time ends.

        Ctrl-C leaves those of the steps until then as ``interrupted``, and is raised.
        """
        seconds, counts = {"build": 0.0, "solve": 0.0}, Counter[str]()
        run = _Run(counts)
        with ONE_PROGRAM:
            began = time.perf_counter()
            try:
                if not self.built:
                    smooth = [self.criteria[j] for j in self.smooth]
                    self.built["pieces"] = Pieces(self.problem.world, self.problem.model, smooth)
                self.built["pieces"].build()
                seconds["build"] = time.perf_counter() - began
                result = self._splined(trajectory, self.built["pieces"], run)
            except KeyboardInterrupt:
                if run.found:
                    self.interrupted.append((trajectory, Outcome.of(tuple(run.found), counts, seconds)))
                raise
            seconds["solve"] = time.perf_counter() - began - seconds["build"]
        return Outcome.of(result, counts, seconds)

    def compile_kernels(self, trajectory: Trajectory) -> None:
        """Compile what a step takes, or load it."""
        self._collision.separations(trajectory.states.take([0]), APART)
        for _, m in trajectory.batches(self.problem.world):
            self._collision.motions_free(m)

    def _splined(self, path: Trajectory, pieces: Pieces, run: _Run) -> tuple[Improved, ...] | str:
        if not path.duration:
            return "goes nowhere"
        (bounds,) = trajectory_costs(self.criteria, [path], self.problem.world)[:, list(self.smooth)]
        reason = ""
        for evenly in (False, True):  # from the path itself; else from a slower spline, which has more room to move
            knots = Knots.along(path, pieces.law, self.pieces, evenly=evenly)
            if not self._is_free(knots):
                reason = "the spline through its knots cannot be proved to be free"
            elif not (reason := self._from(knots, pieces, bounds, run)):
                break
        return tuple(run.found) or reason

    def _from(self, knots: Knots, pieces: Pieces, bounds: FloatArray, run: _Run) -> str:
        """Find a spline for each set of weights; why there is none, if there is none."""
        scale, reason = np.where(bounds > 1e-3, bounds, 1.0), ""
        for weights in self._weights():
            if self._is_late(run.counts):
                return "" if run.found else reason or "no time was left"
            # Each goes on from the one before it: from all alike, mostly, which is near to any other.
            run.steps = [knots]
            try:
                for better in self._improved(knots, pieces, Aim(weights, bounds, scale), run.counts):
                    run.steps.append(better)
            finally:  # after Ctrl-C too: what is certified is kept
                knots, worse = self._kept(run, pieces, bounds)
            reason = reason or worse
        return "" if run.found else reason

    def _kept(self, run: _Run, pieces: Pieces, bounds: FloatArray) -> tuple[Knots, str]:
        """Keep the last of the steps, or the last that is no worse than the path; the last, and why it is not kept."""
        last = run.steps[-1]
        if len(run.steps) == 1:  # what it began with is the path, or was looked at when it was found
            return last, NOTHING_LESS
        spline, reason = self._candidate(last, pieces, bounds)
        within = [knots for knots in run.steps[1:-1] if (pieces.costs(knots) <= bounds).all()] if reason else []
        if within:
            spline, reason = self._candidate(within[-1], pieces, bounds)
        if not reason:
            run.found.append(spline)
        return last, reason

    def _candidate(self, knots: Knots, pieces: Pieces, bounds: FloatArray) -> tuple[Improved, str]:
        """What a spline is planned to cost, and where it is worse than its path, in words."""
        goes = knots.trajectory(self.problem.model, pieces.law)
        (costs,) = trajectory_costs(self.criteria, [goes], self.problem.world)
        quanta = np.array([criterion.quantum for criterion in self.criteria])
        worse = costs[list(self.smooth)] > bounds + 0.5 * quanta[list(self.smooth)]
        names = [self.criteria[j].name for j, more in zip(self.smooth, worse, strict=True) if more]
        planned = costs.copy()
        planned[list(self.smooth)] = pieces.costs(knots)
        spline = Improved(goes, planned, QUADRATURE * np.abs(costs) + quanta, {"pieces": knots.shares.size})
        return spline, f"no better than its path in {', '.join(names)}" if names else ""

    def _weights(self) -> list[FloatArray]:
        """Weights (k,) of the costs, one set for each spline of a path."""
        count = len(self.smooth)
        alone = [np.where(np.arange(count) == j, 1.0, SPREAD) for j in range(count)]
        if self.minimise is not None:
            return [alone[self.smooth.index(self.minimise)]]
        return [np.full(count, 1.0 / count), *(alone if count > 1 else [])]

    def _improved(self, knots: Knots, pieces: Pieces, aim: Aim, counts: Counter[str]) -> Iterator[Knots]:
        """Steps that each lower the merit and are free, until none gains much or time is over."""
        space = self.problem.model.space
        turning = np.array([name in space.turning for name in pieces.law.names])
        low, high = np.where(turning, -np.inf, space.low), np.where(turning, np.inf, space.high)
        steps = Steps(knots.shares, pieces.law, low, high)
        merit, distance = aim.merit(pieces.costs(knots)), FIRST
        for _ in range(STEPS):
            counts["steps"] += 1
            apart = self._collision.separations(self._states(knots, pieces.law), APART)
            program = steps.of(knots, aim, pieces.slopes(knots), apart, MARGIN, FRACTIONS)
            while True:
                if self._is_late(counts):
                    return
                counts["programs"] += 1
                further = self._moved(knots, program.within(distance), pieces.law)
                if further is not None:
                    costs = pieces.costs(further)
                    lower = aim.merit(costs)
                    if lower < merit and self._is_free(further):
                        break
                distance *= SHRINKS
                if distance < LAST:
                    return
            gain, knots, merit = merit - lower, further, lower
            yield knots
            if gain < GAIN * merit and distance >= FIRST * SHRINKS and (costs <= aim.bounds).all():
                return
            distance = min(MOST, distance * GROWS)

    def _is_late(self, counts: Counter[str]) -> bool:
        """Whether time is over; if so the path is counted."""
        late = self.deadline is not None and self.deadline.is_past
        if late:
            counts[CUT_SHORT] = 1
        return late

    def _moved(self, knots: Knots, move: tuple[FloatArray, FloatArray] | None, law: SplineLaw) -> Knots | None:
        return None if move is None else knots.moved(*move, law)

    @property
    def _collision(self) -> JointCollision:
        return cast(JointCollision, self.problem.model.collision(self.problem.world))

    def _states(self, knots: Knots, law: SplineLaw) -> States:
        """Joints at the fractions of all pieces, those of the first fraction first."""
        rows = np.concatenate([knots.at(fraction) for fraction in FRACTIONS.tolist()])
        return States(**dict(zip(law.names, rows.T, strict=True)))

    def _is_free(self, knots: Knots) -> bool:
        """Whether a certificate holds all along."""
        model = self.problem.model
        goes = knots.trajectory(model, cast(SplineLaw, model.laws[LAW]))
        return all(bool(self._collision.motions_free(m).all()) for _, m in goes.batches(self.problem.world))
