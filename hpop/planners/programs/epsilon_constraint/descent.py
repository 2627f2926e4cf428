"""Local search that moves the corners of a polyline, on exact costs and exact geometry, until no small move helps.

The program of :mod:`.program` uses sampled fields, few samples and a penalty on lengths, so its solutions only lie near
a local optimum. From there the corners move by sequential quadratic programming within a trust region, with
second-order corrections (Fletcher 1982, doi 10.1007/BFb0120945). Gradients mislead where costs have kinks. So when
steps no longer help, a pattern search displaces each corner along and across its segments (Kolda, Lewis and Torczon
2003, doi 10.1137/S003614450242889); if that improves the polyline, steps continue. Every step is checked as candidates
are: by the costs that fronts report, and on the exact geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.math import wrap
from hpop.criteria.base import Criterion
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.models.rigid import PlanarLaw
from hpop.motions import Motions, States
from hpop.motions.symbolic import lift
from hpop.planners.programs.epsilon_constraint.nearby import LocalModel, turns_of
from hpop.planners.programs.nlp import SmoothedTurn
from hpop.planners.programs.polyline import Polyline, PolylineStructure, SegmentParts, parts_of
from hpop.runtime.limits import LimitPassed
from hpop.world import World

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

FIRST, LAST, MOST = 0.1, 5e-4, 0.4  # m: size of the trust region: at first, least and largest
SHRINKS, GROWS = 0.3, 2.0  # factors on the trust region after a failed step and after a good one
STEPS = 60  # largest number of steps
GAIN = 2e-5  # share of the minimised cost: a smaller predicted gain ends the descent
WORTH = 0.1  # share of the predicted gain that a step must achieve
CORRECTIONS = 3  # second-order corrections before the trust region shrinks
ROOM = (0.0, 1e-3, -1e-3, 4e-3, -4e-3)  # m: displacements of the neighbours of a removed corner, tried in turn
POLLED = (0.1, 0.03, 0.01, 0.003)  # m: displacements of a corner in the pattern search
SPREAD = 1e-3  # weight of the bounded costs, so that no weakly efficient point is returned


class DescentResult(NamedTuple):
    """Result of a descent.

    costs  (k,) exact costs of the polyline
    steps  number of steps
    left   predicted gain of one more step, as a share of the minimised cost; 0 if negligible, NaN if not computed
    """

    polyline: Polyline
    costs: FloatArray
    steps: int
    left: float


@dataclass(frozen=True, eq=False)
class Descent:
    """Local search that lowers one cost by moving corners, while the other costs keep their bounds.

    problem   problem to plan
    criteria  k smooth criteria: sums, or maxima over motions
    minimise  index of the minimised criterion
    aim       (k,) bounds for the local model from which steps are computed
    most      (k,) bounds of exact costs; they may exceed ``aim`` by the error of the model
    scale     (k,) positive: each cost is divided by its scale
    judge     returns the exact costs (k,) of a polyline, or None if it breaks a bound, collides or leaves the map
    evaluate  returns the exact costs (m, k) of m polylines, NaN off the map; collisions are not checked
    free      returns for each of m polylines whether it is free of collisions (m,)
    is_late   returns whether the time limit has passed
    """

    problem: Problem
    criteria: Sequence[Criterion]
    minimise: int
    aim: FloatArray
    most: FloatArray
    scale: FloatArray
    judge: Callable[[Polyline], FloatArray | None]
    evaluate: Callable[[Sequence[Polyline]], FloatArray]
    free: Callable[[Sequence[Polyline]], BoolArray]
    is_late: Callable[[], bool]

    @cached_property
    def weights(self) -> FloatArray:
        """Weights (k,) of the costs in the merit: the weighted sum of costs that each step must lower.

        The minimised cost has nearly all the weight. The others have so little (SPREAD) that they only break ties. Each
        weight is divided by the scale of its cost.
        """
        weights = np.full(len(self.criteria), SPREAD)
        weights[self.minimise] += 1.0
        return weights / self.scale

    def run(self, polyline: Polyline, costs: FloatArray) -> DescentResult:
        """Return the best polyline found by moving corners, with its costs; ``costs`` (k,) are those of ``polyline``.

        All costs are exact. The descent ends when no step lowers the merit (the weighted sum of the costs) within
        the bounds, or when the time limit passes.
        """
        result = DescentResult(polyline, costs, 0, np.nan)
        with suppress(LimitPassed):
            for result in self._better(polyline, costs):  # noqa: B007  (the last one counts)
                pass
        return result

    def _better(self, polyline: Polyline, costs: FloatArray) -> Iterator[DescentResult]:
        """Run the descent; yield the result so far before each step, and finally the last one."""
        distance, left, multipliers = FIRST, np.nan, self.weights
        polyline, costs = self._shortened(polyline, costs)
        if len(polyline.vertices) < 3:
            yield DescentResult(polyline, costs, 0, 0.0)
            return
        for steps in range(STEPS):
            yield DescentResult(polyline, costs, steps, np.nan)
            bounds = np.minimum(np.maximum(self.aim, costs), self.most)
            bounds[self.minimise] = np.inf
            local = LocalModel(self.problem, self.criteria, polyline, costs, bounds, self.weights, self.scale)
            if not local.freedom:
                yield DescentResult(polyline, costs, steps, 0.0)
                return
            local.bend(multipliers)
            while True:
                if self.is_late():
                    return
                better, left = self._step(local, polyline, costs, distance)
                if better is not None or left <= GAIN:
                    break
                distance *= SHRINKS
                if distance < LAST:
                    break
            if better is None:
                polled = self._polled(local, polyline, costs, bounds)
                if polled is None:
                    yield DescentResult(polyline, costs, steps, left if left > GAIN else 0.0)
                    return
                better, distance = polled
                polyline, costs = self._tidied(*better)
                continue
            gain = self._merit(costs) - self._merit(better[1])
            multipliers = local.multipliers
            polyline, costs = self._tidied(*better)
            distance = min(MOST, distance * (GROWS if gain > 0.5 * left else 1.0))
        yield DescentResult(polyline, costs, STEPS, left)

    def _step(
        self, local: LocalModel, polyline: Polyline, costs: FloatArray, distance: float
    ) -> tuple[tuple[Polyline, FloatArray] | None, float]:
        """Try the best step within ``distance`` metres; return the new polyline and costs, or None if it fails.

        It fails if it is refused or gains much less than predicted; the model ``local`` then learns from it, and some
        more steps are tried. The second value is the gain predicted for the first step.
        """
        promised = 0.0
        local.forget()
        for correction in range(CORRECTIONS):
            step = local.step(distance)
            if step is None:
                break
            gain = local.gain(step)
            promised = promised if correction else gain
            if gain <= GAIN:
                break
            trial = local.moved(step)
            judged = self.judge(trial)
            if judged is not None and self._merit(judged) < self._merit(costs) - WORTH * gain:
                return (trial, judged), promised
            if not local.learn(step):
                break
        return None, promised

    def _polled(
        self, local: LocalModel, polyline: Polyline, costs: FloatArray, bounds: FloatArray
    ) -> tuple[tuple[Polyline, FloatArray], float] | None:
        """Search for a displacement of one corner that lowers the merit (weighted sum of costs) and keeps all bounds.

        ``costs`` (k,) are those of the polyline, ``bounds`` (k,) those that the costs must keep. This is a pattern
        search: sizes, m, are tried in turn, the largest first, up to the first at which a polyline is better. Returns
        that polyline (of several, the best) with its costs, and the size; None if there is none.
        Displacements are projected so that segments with a fixed heading keep it, as the robot would else have to turn
        once more.
        """
        vertices = polyline.vertices
        ahead = np.diff(vertices, axis=0)
        ahead /= np.maximum(np.hypot(*ahead.T), LAST)[:, None]
        across = ahead[:, ::-1] * [-1.0, 1.0]
        free = np.linalg.pinv(local.basis.reshape(-1, local.freedom)).reshape(local.freedom, -1, 2)
        sides = [
            free[:, corner] @ (sign * side)
            for corner in range(1, len(vertices) - 1)
            for sign in (1.0, -1.0)
            for i in (corner - 1, corner)
            for side in (ahead[i], across[i])
        ]
        for size in POLLED:
            if self.is_late():
                return None
            trials = [local.moved(size * side) for side in sides]
            costs_of_trials = self.evaluate(trials)  # at once: a call takes longer than a trial
            gains = (costs_of_trials <= bounds).all(axis=1) & (
                costs_of_trials @ self.weights < self._merit(costs) - GAIN
            )
            improving = np.flatnonzero(gains)
            improving = improving[self.free([trials[index] for index in improving])]
            for index in improving[np.argsort(costs_of_trials[improving] @ self.weights, kind="stable")]:
                if (judged := self.judge(trials[index])) is not None:
                    return (trials[index], judged), size
        return None

    def _merit(self, costs: FloatArray) -> float:
        return float(self.weights @ costs)

    def _shortened(self, polyline: Polyline, costs: FloatArray) -> tuple[Polyline, FloatArray]:
        """Remove corners one by one as long as the merit (weighted sum of costs) does not rise.

        Returns the polyline and its costs (k,).
        """
        while len(polyline.vertices) > 2 and not self.is_late():
            inner = range(1, len(polyline.vertices) - 1)
            fewer = [polyline.without(corner) for corner in inner]
            for shorter in (fewer[index] for index in np.flatnonzero(self.free(fewer))):
                judged = self.judge(shorter)
                if judged is not None and self._merit(judged) <= self._merit(costs):
                    polyline, costs = shorter, judged
                    break
            else:
                break
        return polyline, costs

    def _tidied(self, polyline: Polyline, costs: FloatArray) -> tuple[Polyline, FloatArray]:
        """Remove the first corner whose turn is negligible, if the merit (weighted sum of costs) hardly rises.

        Returns the polyline and its costs (k,).

        The duration of a turn has no gradient at zero, so steps cannot remove the turn. If the path would touch an
        obstacle without the corner, its neighbours move by some millimetres.
        """
        slight = np.flatnonzero(np.abs(wrap(np.diff(polyline.headings))) < LEAST_TURN)
        for corner in slight[:1] + 1:
            fewer = np.delete(polyline.vertices, corner, axis=0)
            ahead = fewer[corner] - fewer[corner - 1]
            across = np.array([-ahead[1], ahead[0]]) / max(float(np.hypot(*ahead)), LAST)
            neighbours = [i for i in (corner - 1, corner) if 0 < i < len(fewer) - 1]
            for room in ROOM:
                moved = fewer.copy()
                moved[neighbours] += room * across
                simpler = Polyline(moved, polyline.start_yaw, polyline.goal_yaw)
                judged = self.judge(simpler)
                if judged is not None and self._merit(judged) <= self._merit(costs) + GAIN:
                    return simpler, judged
        return polyline, costs


@dataclass(frozen=True)
class PolylineMotions:
    """Motions along polylines of one structure, on numbers or on symbols.

    They are moves along the K pieces of the segments, and turns in place.
    """

    structure: PolylineStructure

    @cached_property
    def pieces(self) -> SegmentParts:
        """The K pieces into which the segments are cut."""
        return parts_of(np.array(self.structure.pieces, dtype=np.int64))

    @cached_property
    def shares(self) -> tuple[FloatArray, FloatArray]:
        """Matrices (K, n+1) that give, multiplied by the vertices, the beginnings and the ends of the pieces."""
        segment, rows = self.pieces.segment, np.arange(len(self.pieces.segment))
        matrices = []
        for share in (self.pieces.begin, self.pieces.end):
            matrix = np.zeros((len(rows), self.structure.segments + 1))
            matrix[rows, segment] = 1.0 - share
            matrix[rows, segment + 1] += share
            matrices.append(matrix)
        return matrices[0], matrices[1]

    @cached_property
    def sampled(self) -> FloatArray:
        """Matrix (S, n+1) that gives, multiplied by the vertices, the S points at which the clearance is bounded."""
        begin, end = self.shares
        return np.concatenate([begin[1:], (2 * begin + end) / 3, (begin + 2 * end) / 3])

    def symbols(self, problem: Problem, world: World, x: Any, y: Any, yaws: Any) -> list[Motions]:
        """Return the moves along the pieces, and the turns if there are any, as motions of CasADi symbols.

        Parameters
        ----------
        x, y : (n+1,) coordinates of the vertices
        yaws : (2,) headings at start and goal
        """
        import casadi

        model, owner, n = problem.model, self.pieces.segment, self.structure.segments
        dx, dy = lift(x[1:] - x[:-1], n), lift(y[1:] - y[:-1], n)
        moves_at_all = dx * dx + dy * dy > 0
        yaw = casadi.MX(np.arctan2(np.where(moves_at_all, dy, 0.0), np.where(moves_at_all, dx, 1.0)))
        heading = lift(yaw[owner.tolist()], len(owner))
        corners = [lift(casadi.DM(m) @ c, len(owner)) for m in map(sparse, self.shares) for c in (x, y)]
        start = States(x=corners[0], y=corners[1], yaw=heading)
        end = States(x=corners[2], y=corners[3], yaw=heading)
        moves = Motions(world, model, model.laws["move"], start, end, panels=1)
        at = self.structure.turning
        if not at:
            return [moves]
        before, after = (
            lift(column[at], len(at)) for column in (casadi.vertcat(yaws[0], yaw), casadi.vertcat(yaw, yaws[1]))
        )
        x, y = lift(x[at], len(at)), lift(y[at], len(at))
        start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
        return [moves, Motions(world, model, SmoothedTurn(cast(PlanarLaw, model.laws["turn"])), start, end, panels=1)]

    def of(self, problem: Problem, polyline: Polyline) -> list[Motions]:
        """Return the moves along the pieces of a given polyline, and its turns if there are any, with exact laws."""
        vertices, world, model = polyline.vertices[None], problem.world, problem.model
        heading = polyline.headings[self.pieces.segment]
        start, end = (
            States(x=(vertices[..., 0] @ share.T).ravel(), y=(vertices[..., 1] @ share.T).ravel(), yaw=heading)
            for share in self.shares
        )
        moves = Motions(world, model, model.laws["move"], start, end)
        return [moves, *turns_of(self.structure, vertices, polyline, problem)]


def sparse(matrix: FloatArray) -> Any:
    """Return a matrix as a sparse CasADi matrix."""
    import casadi

    return casadi.sparsify(casadi.DM(matrix))
