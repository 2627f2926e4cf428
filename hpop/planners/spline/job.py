"""Making splines of one path, step by step, each proved free, until none gains much; here or in a worker."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.arrays import FloatArray
from hpop.criteria.base import Criterion, trajectory_costs
from hpop.motions import JointCollision, States
from hpop.planners.programs.outcome import ONE_PROGRAM, Improved, Outcome
from hpop.planners.spline.knots import LAW, Knots, SplineLaw
from hpop.planners.spline.pieces import Pieces
from hpop.planners.spline.step import Aim, Steps
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problem import Problem

FRACTIONS = np.linspace(0.125, 1.0, 8)  # of each piece, where it is kept apart from obstacles
APART = 0.15  # m: bodies that are farther apart are left out of a step
MARGIN = 0.004  # m: how far they are kept apart; what is free by certificate comes no nearer than 1 mm
FIRST, LAST, MOST = 0.2, 0.002, 0.6  # rad or m: how far a step is believed, at first, at least and at most
SHRINKS, GROWS = 0.35, 1.7  # where a step was too far, and where it was not
STEPS = 30
GAIN = 2e-3  # relative: of a step that is not worth another
QUADRATURE = 0.01  # relative: costs on the nodes of a piece against those that are reported
SPREAD = 1e-2  # weight of the costs that are not minimised


@dataclass(frozen=True, eq=False)
class SplineJob:
    """What all paths share. Pickled without what is built: each process builds it once.

    problem
    criteria  k
    smooth    places of those that have gradients; the others come as they come
    minimise  place of the one that counts most; None: all alike, and from there on each by itself
    pieces    count of each spline, about
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    smooth: tuple[int, ...]
    minimise: int | None
    pieces: int
    built: dict[str, Pieces] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "built": {}}

    def solve(self, trajectory: Trajectory) -> Outcome[tuple[Improved, ...]]:
        """The splines of one path; they depend on it alone."""
        seconds, counts = {"build": 0.0, "solve": 0.0}, Counter[str]()
        with ONE_PROGRAM:
            began = time.perf_counter()
            if not self.built:
                smooth = [self.criteria[j] for j in self.smooth]
                self.built["pieces"] = Pieces(self.problem.world, self.problem.model, smooth).build()
            seconds["build"] = time.perf_counter() - began
            result = self._splined(trajectory, self.built["pieces"], counts)
            seconds["solve"] = time.perf_counter() - began - seconds["build"]
        return Outcome.of(result, counts, seconds)

    def _splined(self, path: Trajectory, pieces: Pieces, counts: Counter[str]) -> tuple[Improved, ...] | str:
        if not path.duration:
            return "goes nowhere"
        knots = Knots.along(path, pieces.law, self.pieces)
        if not self._is_free(knots):
            return "the spline through its knots cannot be proved to be free"
        (bounds,) = trajectory_costs(self.criteria, [path], self.problem.world)[:, list(self.smooth)]
        scale, found, reason = np.where(bounds > 1e-3, bounds, 1.0), list[Improved](), ""
        for weights in self._weights():
            # Each goes on from the one before it: from all alike, mostly, which is near to any other.
            knots = self._improved(knots, pieces, Aim(weights, bounds, scale), counts)
            spline, worse = self._candidate(knots, pieces, bounds)
            reason = reason or worse
            found += [] if worse else [spline]
        return tuple(found) or reason

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

    def _improved(self, knots: Knots, pieces: Pieces, aim: Aim, counts: Counter[str]) -> Knots:
        """The last of steps that each lower the merit and are free."""
        space = self.problem.model.space
        turning = np.array([name in space.turning for name in pieces.law.names])
        low, high = np.where(turning, -np.inf, space.low), np.where(turning, np.inf, space.high)
        steps = Steps(knots.shares, pieces.law, low, high)
        merit, distance = aim.merit(pieces.costs(knots)), FIRST
        for _ in range(STEPS):
            counts["steps"] += 1
            apart = self._collision.separations(self._states(knots, pieces.law), APART)
            program = steps.of(knots, pieces.slopes(knots), apart, MARGIN, FRACTIONS)
            while True:
                counts["programs"] += 1
                further = self._moved(knots, program.within(distance, aim), pieces.law)
                lower = np.inf if further is None else aim.merit(pieces.costs(further))
                if further is not None and lower < merit and self._is_free(further):
                    break
                distance *= SHRINKS
                if distance < LAST:
                    return knots
            gain, knots, merit = merit - lower, further, lower
            if gain < GAIN * merit and distance >= FIRST * SHRINKS:
                return knots
            distance = min(MOST, distance * GROWS)
        return knots

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
