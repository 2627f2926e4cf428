"""The last step of a bound: corners move by exact costs on exact geometry until no small move gains.

The program of :mod:`.program` knows fields, few samples and a regulariser, so its solutions only lie near a local
optimum. From there the corners move by sequential quadratic programming within a trust region, with second-order
corrections (Fletcher 1982, doi 10.1007/BFb0120945). Slopes mislead where costs have kinks, so each corner is then
polled along and across its segments (Kolda, Lewis and Torczon 2003, doi 10.1137/S003614450242889); a poll that gains
goes on with steps. Every step is judged as candidates are: by the costs that fronts report, and on the exact geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.math import wrap
from hpop.criteria.base import Criterion
from hpop.criteria.comfort.turns import LEAST_TURN
from hpop.models.rigid import PlanarLaw
from hpop.motions import Motions, States
from hpop.motions.symbolic import lift
from hpop.planners.programs.epsilon_constraint.nearby import Nearby
from hpop.planners.programs.nlp import Rounded
from hpop.planners.programs.polyline import Polyline, PolylineStructure
from hpop.runtime.limits import LimitPassed
from hpop.world import World

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

FIRST, LAST, MOST = 0.1, 5e-4, 0.4  # m: how far a step is believed, at first, at least and at most
SHRINKS, GROWS = 0.3, 2.0  # where a step was too far, and where it was not
STEPS = 60
GAIN = 2e-5  # of the cost that is minimised: a step that gains less is the last
WORTH = 0.1  # share of what a step promises that it has to keep
CORRECTIONS = 3  # programs that know what the step before met, before less is believed
ROOM = (0.0, 1e-3, -1e-3, 4e-3, -4e-3)  # m, by which corners make room where one between them goes
POLLED = (0.1, 0.03, 0.01, 0.003)  # m, by which a corner at rest is displaced to see whether that gains
SPREAD = 1e-3  # weight of the bounded costs: no weakly efficient point is returned


class Descended(NamedTuple):
    """Where the corners came to rest.

    costs  (k,)
    steps  count
    left   share of its cost that the next step promised, 0 where that was no gain; NaN where no step was looked at
    """

    polyline: Polyline
    costs: FloatArray
    steps: int
    left: float


@dataclass(frozen=True, eq=False)
class Descent:
    """Steps of the corners that lower one cost while the others keep their bounds.

    problem
    criteria  k smooth ones: sums, or maxima over motions
    minimise  place of the one that is minimised
    aim       (k,) bounds that steps keep as far as they can
    most      (k,) bounds up to which they may be exceeded by what a step bends
    scale     (k,) positive: differences of costs that matter alike
    judge     from a polyline to its exact costs (k,), or None where it is not to be trusted
    evaluate  from m polylines to their exact costs (m, k), NaN off the map; collisions are not looked for
    free      from m polylines to whether each is free of collisions (m,)
    is_late   whether time is over
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
        """Weights (k,) of the costs in what is minimised: one counts, the others break ties."""
        weights = np.full(len(self.criteria), SPREAD)
        weights[self.minimise] += 1.0
        return weights / self.scale

    def run(self, polyline: Polyline, costs: FloatArray) -> Descended:
        """Move the corners of a polyline with costs (k,) until no step gains, or time is over."""
        rest = Descended(polyline, costs, 0, np.nan)
        with suppress(LimitPassed):
            for rest in self._better(polyline, costs):  # noqa: B007  (the last one counts)
                pass
        return rest

    def _better(self, polyline: Polyline, costs: FloatArray) -> Iterator[Descended]:
        """Yield better and better polylines; the last one is where the corners came to rest."""
        distance, left, multipliers = FIRST, np.nan, self.weights
        polyline, costs = self._shortened(polyline, costs)
        if len(polyline.vertices) < 3:
            yield Descended(polyline, costs, 0, 0.0)
            return
        for steps in range(STEPS):
            yield Descended(polyline, costs, steps, np.nan)
            bounds = np.minimum(np.maximum(self.aim, costs), self.most)
            bounds[self.minimise] = np.inf
            nearby = Nearby(self.problem, self.criteria, polyline, costs, bounds, self.weights, self.scale)
            if not nearby.freedom:
                yield Descended(polyline, costs, steps, 0.0)
                return
            nearby.bend(multipliers)
            while True:
                if self.is_late():
                    return
                found, left = self._step(nearby, polyline, costs, distance)
                if found is not None or left <= GAIN:
                    break
                distance *= SHRINKS
                if distance < LAST:
                    break
            if found is None:
                polled = self._polled(nearby, polyline, costs, bounds)
                if polled is None:
                    yield Descended(polyline, costs, steps, left if left > GAIN else 0.0)
                    return
                found, distance = polled
                polyline, costs = self._tidied(*found)
                continue
            gain = self._merit(costs) - self._merit(found[1])
            multipliers = nearby.multipliers
            polyline, costs = self._tidied(*found)
            distance = min(MOST, distance * (GROWS if gain > 0.5 * left else 1.0))
        yield Descended(polyline, costs, STEPS, left)

    def _step(
        self, nearby: Nearby, polyline: Polyline, costs: FloatArray, distance: float
    ) -> tuple[tuple[Polyline, FloatArray] | None, float]:
        """A step that keeps what it promises, if there is one, and what the first promised."""
        promised = 0.0
        nearby.forget()
        for correction in range(CORRECTIONS):
            step = nearby.step(distance)
            if step is None:
                break
            gain = nearby.gain(step)
            promised = promised if correction else gain
            if gain <= GAIN:
                break
            trial = nearby.moved(step)
            judged = self.judge(trial)
            if judged is not None and self._merit(judged) < self._merit(costs) - WORTH * gain:
                return (trial, judged), promised
            if not nearby.learn(step):
                break
        return None, promised

    def _polled(
        self, nearby: Nearby, polyline: Polyline, costs: FloatArray, bounds: FloatArray
    ) -> tuple[tuple[Polyline, FloatArray], float] | None:
        """The displacement of one corner that gains most and keeps the bounds (k,), and its size, m; None without one.

        Sizes are tried in turn, the largest first. What would turn a segment that keeps its heading, and so add a turn,
        is projected away.
        """
        vertices = polyline.vertices
        ahead = np.diff(vertices, axis=0)
        ahead /= np.maximum(np.hypot(*ahead.T), LAST)[:, None]
        across = ahead[:, ::-1] * [-1.0, 1.0]
        free = np.linalg.pinv(nearby.basis.reshape(-1, nearby.freedom)).reshape(nearby.freedom, -1, 2)
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
            trials = [nearby.moved(size * side) for side in sides]
            every = self.evaluate(trials)  # all at once: each call of a criterion costs more than a trial in it
            gains = (every <= bounds).all(axis=1) & (every @ self.weights < self._merit(costs) - GAIN)
            places = np.flatnonzero(gains)
            places = places[self.free([trials[place] for place in places])]
            for place in places[np.argsort(every[places] @ self.weights, kind="stable")]:
                if (judged := self.judge(trials[place])) is not None:
                    return (trials[place], judged), size
        return None

    def _merit(self, costs: FloatArray) -> float:
        return float(self.weights @ costs)

    def _shortened(self, polyline: Polyline, costs: FloatArray) -> tuple[Polyline, FloatArray]:
        """Without the corners that can be left out at no cost."""
        while len(polyline.vertices) > 2 and not self.is_late():
            inner = range(1, len(polyline.vertices) - 1)
            fewer = [polyline.without(corner) for corner in inner]
            for one in (fewer[place] for place in np.flatnonzero(self.free(fewer))):
                judged = self.judge(one)
                if judged is not None and self._merit(judged) <= self._merit(costs):
                    polyline, costs = one, judged
                    break
            else:
                break
        return polyline, costs

    def _tidied(self, polyline: Polyline, costs: FloatArray) -> tuple[Polyline, FloatArray]:
        """Without a stop for a turn that is none, if that costs no more: its time has no slope there.

        Where the way would then touch an obstacle, the corners beside it make room by some millimetres.
        """
        slight = np.flatnonzero(np.abs(wrap(np.diff(polyline.headings))) < LEAST_TURN)
        for corner in slight[:1] + 1:
            fewer = np.delete(polyline.vertices, corner, axis=0)
            ahead = fewer[corner] - fewer[corner - 1]
            across = np.array([-ahead[1], ahead[0]]) / max(float(np.hypot(*ahead)), LAST)
            beside = [i for i in (corner - 1, corner) if 0 < i < len(fewer) - 1]
            for room in ROOM:
                moved = fewer.copy()
                moved[beside] += room * across
                simpler = Polyline(moved, polyline.start_yaw, polyline.goal_yaw)
                judged = self.judge(simpler)
                if judged is not None and self._merit(judged) <= self._merit(costs) + GAIN:
                    return simpler, judged
        return polyline, costs


@dataclass(frozen=True)
class Pieces:
    """Segments cut into pieces, K in all, and the turns between them."""

    structure: PolylineStructure

    @cached_property
    def owner(self) -> IntArray:
        """Segment (K,) of each piece."""
        return np.repeat(np.arange(self.structure.segments), np.array(self.structure.pieces, dtype=np.int64))

    @cached_property
    def shares(self) -> tuple[FloatArray, FloatArray]:
        """Matrices (K, n+1) that take vertices to where each piece begins and where it ends."""
        pieces, owner = np.array(self.structure.pieces, dtype=np.int64), self.owner
        total, count = len(owner), pieces[owner]
        place = np.arange(total) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        matrices = []
        for share in (place / count, (place + 1) / count):
            matrix = np.zeros((total, len(pieces) + 1))
            matrix[np.arange(total), owner] = 1.0 - share
            matrix[np.arange(total), owner + 1] += share
            matrices.append(matrix)
        return matrices[0], matrices[1]

    @cached_property
    def sampled(self) -> FloatArray:
        """Matrix (S, n+1) that takes vertices to where the clearance is bounded: ends and middles of pieces."""
        begin, end = self.shares
        return np.concatenate([begin[1:], (2 * begin + end) / 3, (begin + 2 * end) / 3])

    @property
    def turning(self) -> list[int]:
        """Vertices at which the robot turns."""
        return list(range(int(not self.structure.first_turn), self.structure.segments + self.structure.last_turn))

    def symbols(self, problem: Problem, world: World, x: Any, y: Any, yaws: Any) -> list[Motions]:
        """The pieces as moves and the turns, if there are any, on symbols.

        Parameters
        ----------
        x, y : (n+1,) of the vertices
        yaws : (2,) at start and goal
        """
        import casadi

        model, owner, n = problem.model, self.owner, self.structure.segments
        dx, dy = lift(x[1:] - x[:-1], n), lift(y[1:] - y[:-1], n)
        moves_at_all = dx * dx + dy * dy > 0
        yaw = casadi.MX(np.arctan2(np.where(moves_at_all, dy, 0.0), np.where(moves_at_all, dx, 1.0)))
        heading = lift(yaw[owner.tolist()], len(owner))
        corners = [lift(casadi.DM(m) @ c, len(owner)) for m in map(sparse, self.shares) for c in (x, y)]
        start = States(x=corners[0], y=corners[1], yaw=heading)
        end = States(x=corners[2], y=corners[3], yaw=heading)
        moves = Motions(world, model, model.laws["move"], start, end, panels=1)
        at = self.turning
        if not at:
            return [moves]
        before, after = (
            lift(column[at], len(at)) for column in (casadi.vertcat(yaws[0], yaw), casadi.vertcat(yaw, yaws[1]))
        )
        x, y = lift(x[at], len(at)), lift(y[at], len(at))
        start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
        return [moves, Motions(world, model, Rounded(cast(PlanarLaw, model.laws["turn"])), start, end, panels=1)]

    def numbers(self, problem: Problem, polyline: Polyline) -> list[Motions]:
        """The same motions of one polyline, as criteria see them who report their cost."""
        return self.several(problem, polyline.vertices[None], polyline.start_yaw, polyline.goal_yaw)

    def several(
        self, problem: Problem, vertices: FloatArray, start_yaw: float, goal_yaw: float | None
    ) -> list[Motions]:
        """The motions of several polylines with vertices (b, n+1, 2): the moves of all, then the turns of all."""
        world, model = problem.world, problem.model
        ahead = np.diff(vertices, axis=1)
        headings = np.arctan2(ahead[..., 1], ahead[..., 0])  # (b, n)
        heading = headings[:, self.owner].ravel()
        start, end = (
            States(x=(vertices[..., 0] @ share.T).ravel(), y=(vertices[..., 1] @ share.T).ravel(), yaw=heading)
            for share in self.shares
        )
        moves = Motions(world, model, model.laws["move"], start, end)
        at = self.turning
        if not at:
            return [moves]
        every = np.ones((len(vertices), 1))
        first, last = start_yaw * every, (np.nan if goal_yaw is None else goal_yaw) * every
        before, after = np.hstack([first, headings])[:, at].ravel(), np.hstack([headings, last])[:, at].ravel()
        x, y = vertices[:, at, 0].ravel(), vertices[:, at, 1].ravel()
        start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
        return [moves, Motions(world, model, model.laws["turn"], start, end)]


def sparse(matrix: FloatArray) -> Any:
    """A matrix without its zeros, for CasADi."""
    import casadi

    return casadi.sparsify(casadi.DM(matrix))
