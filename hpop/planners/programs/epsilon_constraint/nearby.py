"""Local model of costs and clearances near a given polyline, from which :mod:`.descent` computes its steps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.math import wrap
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import Motions, States
from hpop.planners.needs import in_plane, reaches
from hpop.planners.programs.polyline import Polyline, PolylineStructure, SegmentParts, parts_of
from hpop.world.ground import Heights

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

PENALTY = 100.0  # penalty on the excess of a scaled cost over its bound
PIECE = 0.1  # m: length of the parts of segments in which maxima are first searched
SAMPLE = 0.04  # m: first spacing of the samples of the distance to obstacles
FINER = 7  # factor by which both are refined near extrema
APART = 3e-5  # m: additional clearance, for the error between two samples
REACH = 0.6  # m: obstacles that are farther away bound no step
KEEP = 0.5  # share of its length that a segment keeps in one step
PROBE = 1e-5  # m: step of first differences
BENT = 5e-3  # m: step of second differences
CURVATURE = 1e-7  # least eigenvalue of the Hessian, so that a program has one solution


class StepLimits(NamedTuple):
    """Linear limits of a step (d,) in r rows.

    A row for the distance to an obstacle requires ``slopes @ step <= room``. A row for a sample of a maximum requires
    that ``slopes @ step - room``, the predicted value of the sample, is at most the maximum.

    slopes, room  (r, d), (r,)
    maximum       (r,)  index of the criterion that is a maximum; -1 for a distance to obstacles
    """

    slopes: FloatArray
    room: FloatArray
    maximum: IntArray

    def within(self, distance: float) -> StepLimits:
        """Return only the limits that can matter for steps whose coordinates are at most ``distance``, m."""
        near = (self.maximum >= 0) | (self.room <= distance * np.abs(self.slopes).sum(axis=1))
        return StepLimits(self.slopes[near], self.room[near], self.maximum[near])


class LocalModel:
    """Model of how costs and clearances change when the corners of a polyline move by a small step (d,).

    If the robot may not turn at the start or goal, the corner next to it moves only along the heading there. Costs that
    are sums are modelled to second order. Costs that are maxima are modelled to first order at each local maximum along
    the path. So is the distance to obstacles at samples, which do not move when a corner slides along its segment.

    problem   problem to plan
    criteria  k smooth criteria
    polyline  polyline whose corners move
    costs     (k,) exact costs of the polyline
    bounds    (k,) upper bounds of the costs; inf for none
    weights   (k,) weights of the costs in the merit, which a step lowers
    scale     (k,) positive: each cost is divided by its scale
    """

    def __init__(
        self,
        problem: Problem,
        criteria: Sequence[Criterion],
        polyline: Polyline,
        costs: FloatArray,
        bounds: FloatArray,
        weights: FloatArray,
        scale: FloatArray,
    ) -> None:
        self.problem, self.criteria, self.polyline = problem, criteria, polyline
        self.costs, self.bounds, self.weights, self.scale = costs, bounds, weights, scale
        self.structure = polyline.structure
        self.maxima = [j for j, c in enumerate(criteria) if c.aggregate == "max"]
        self.sums = [j for j in range(len(criteria)) if j not in self.maxima]
        self.multipliers = weights
        self._more: list[StepLimits] = []
        self._excess = np.zeros(len(criteria))
        self._curvature = np.zeros((self.freedom, self.freedom))

    # Corners

    @cached_property
    def basis(self) -> FloatArray:
        """Derivatives (n+1, 2, d) of the vertices' coordinates by the d coordinates of a step."""
        polyline, n = self.polyline, len(self.polyline.vertices) - 1
        directions: list[list[float]] = [[] for _ in range(n + 1)]
        if not self.structure.first_turn:
            directions[1].append(polyline.start_yaw)
        if polyline.goal_yaw is not None and not self.structure.last_turn:
            directions[n - 1].append(polyline.goal_yaw)
        columns = []
        for i in range(1, n):
            fixed = [(np.cos(yaw), np.sin(yaw)) for yaw in directions[i]]
            for direction in ([(1.0, 0.0), (0.0, 1.0)], fixed, [])[len(fixed)]:
                column = np.zeros((n + 1, 2))
                column[i] = direction
                columns.append(column)
        return np.stack(columns, axis=2) if columns else np.zeros((n + 1, 2, 0))

    @property
    def freedom(self) -> int:
        """Number d of coordinates of a step: two for each inner corner, fewer if a fixed heading limits it."""
        return int(self.basis.shape[2])

    def moved(self, step: FloatArray) -> Polyline:
        """Return the polyline with its corners moved by a step (d,)."""
        return Polyline(self._vertices(step[None])[0], self.polyline.start_yaw, self.polyline.goal_yaw)

    def _vertices(self, steps: FloatArray) -> FloatArray:
        """Return the vertices (b, n+1, 2) after each of b steps (b, d)."""
        vertices: FloatArray = self.polyline.vertices + np.einsum("vad,bd->bva", self.basis, steps)
        return vertices

    # Costs

    @cached_property
    def slopes(self) -> FloatArray:
        """Gradients (k, d) of the costs that are sums, by central differences; 0 for maxima."""
        probe = PROBE * np.eye(self.freedom)
        values = self._sums(np.concatenate([probe, -probe]))
        return (values[:, : self.freedom] - values[:, self.freedom :]) / (2 * PROBE)

    def bend(self, multipliers: FloatArray) -> None:
        """Compute and store the Hessian of the costs that are sums, weighted by multipliers (k,) and made convex."""
        d = self.freedom
        first, second = np.triu_indices(d)
        probe = BENT * np.eye(d)
        steps = np.concatenate([np.zeros((1, d)), probe, -probe, probe[first] + probe[second]])
        values = multipliers @ self._sums(steps)
        middle, ahead, back, corner = values[0], values[1 : d + 1], values[d + 1 : 2 * d + 1], values[2 * d + 1 :]
        entries = corner - ahead[first] - ahead[second] + middle
        entries[first == second] = ahead + back - 2 * middle
        hessian = np.zeros((d, d))
        hessian[first, second] = hessian[second, first] = entries / BENT**2
        value, vector = np.linalg.eigh(hessian)
        self._curvature = (vector * np.maximum(value, CURVATURE)) @ vector.T

    def _sums(self, steps: FloatArray) -> FloatArray:
        """Return the exact costs (k, b) after each of b steps (b, d), for costs that are sums; 0 for maxima."""
        vertices = self._vertices(steps)
        segments = parts_of(np.ones(vertices.shape[1] - 1, dtype=np.int64))
        batches = [self._moves(vertices, segments), *turns_of(self.structure, vertices, self.polyline, self.problem)]
        values = np.zeros((len(self.criteria), len(steps)))
        for j in self.sums:
            for batch in batches:
                values[j] += motion_costs(self.criteria[j], batch).reshape(len(steps), -1).sum(axis=1)
        return values

    def _tops(self, vertices: FloatArray) -> SegmentParts:
        """Return parts of segments, at most PIECE / FINER m long where criteria that are maxima have local maxima."""
        parts = _parts(vertices, PIECE)
        tops: list[SegmentParts] = []
        for j in self.maxima:
            worst = motion_costs(self.criteria[j], self._moves(vertices[None], parts))
            top = _is_local_maximum(worst, parts.segment)
            finer = parts.at(np.repeat(np.flatnonzero(top), FINER))
            at = np.tile(np.arange(FINER) / FINER, int(top.sum()))
            length = finer.end - finer.begin
            finer = SegmentParts(finer.segment, finer.begin + at * length, finer.begin + (at + 1 / FINER) * length)
            worst = motion_costs(self.criteria[j], self._moves(vertices[None], finer)).reshape(-1, FINER)
            tops.append(finer.at(np.arange(len(worst)) * FINER + worst.argmax(axis=1)))
        segment, begin, end = zip(*tops, strict=True)
        return SegmentParts(np.concatenate(segment), np.concatenate(begin), np.concatenate(end))

    def _maximum_rows(self, at: FloatArray) -> list[StepLimits]:
        """Return linear limits that bound the criteria that are maxima from below, linearised at a step (d,)."""
        if not self.maxima:
            return []
        tops, probe = self._tops(self._vertices(at[None])[0]), PROBE * np.eye(self.freedom)
        vertices = self._vertices(np.concatenate([at[None], at + probe, at - probe]))
        batches = [self._moves(vertices, tops), *turns_of(self.structure, vertices, self.polyline, self.problem)]
        rows = []
        for j in self.maxima:
            values = np.concatenate(
                [motion_costs(self.criteria[j], batch).reshape(len(vertices), -1) for batch in batches], axis=1
            )
            slopes = (values[1 : self.freedom + 1] - values[self.freedom + 1 :]).T / (2 * PROBE)
            rows.append(StepLimits(slopes, slopes @ at - values[0], np.full(values.shape[1], j)))
        return rows

    def _moves(self, vertices: FloatArray, parts: SegmentParts) -> Motions:
        """Return the moves along the given parts of segments, for each of several polylines (b, n+1, 2) in turn."""
        begin, ahead = vertices[:, parts.segment], np.diff(vertices, axis=1)[:, parts.segment]
        yaw = np.arctan2(ahead[..., 1], ahead[..., 0]).ravel()
        first, last = ((begin + share[:, None] * ahead).reshape(-1, 2).T for share in (parts.begin, parts.end))
        model = self.problem.model
        start, end = (States(x=x, y=y, yaw=yaw) for x, y in (first, last))
        return Motions(self.problem.world, model, model.laws["move"], start, end)

    # Distances

    @cached_property
    def _floors(self) -> list[tuple[Heights, float]]:
        """Height ranges, each with the least allowed distance of the robot's axis from obstacles, m.

        It is the robot's reach and a small margin, or the present distance of the polyline if that is less.
        """
        vertices = self.polyline.vertices
        return [
            (z, min(reach + APART, float(self._near(vertices, z)[1].min(initial=np.inf))))
            for z, reach in reaches(in_plane(self.problem.model), self.problem.world)
        ]

    def _near(self, vertices: FloatArray, z: Heights) -> tuple[SegmentParts, FloatArray]:
        """Return samples along a polyline, denser where it is nearest to an obstacle, and their distances (S,), m."""
        parts = _parts(vertices, SAMPLE)
        last = np.append(np.diff(parts.segment) > 0, True)
        segment = np.concatenate([parts.segment, parts.segment[last]])
        share = np.concatenate([parts.begin, np.ones(int(last.sum()))])
        order = np.lexsort((share, segment))
        segment, share = segment[order], share[order]
        distance = self._distances(vertices, segment, share, z)
        passed = _is_local_maximum(-distance, segment) & (distance < REACH)
        width = (parts.end - parts.begin)[np.searchsorted(parts.segment, segment[passed])]
        offsets = np.concatenate([np.arange(-FINER + 1, 0), np.arange(1, FINER)]) / FINER
        finer = np.repeat(segment[passed], len(offsets))
        within = np.clip((share[passed][:, None] + width[:, None] * offsets).ravel(), 0.0, 1.0)
        segment, share = np.concatenate([segment, finer]), np.concatenate([share, within])
        distance = np.concatenate([distance, self._distances(vertices, finer, within, z)])
        return SegmentParts(segment, share, share), distance

    def _distances(self, vertices: FloatArray, segment: IntArray, share: FloatArray, z: Heights) -> FloatArray:
        """Return the signed distances (S,) to obstacles, m, at samples given by segment and share of its length."""
        x, y = (vertices[segment] + share[:, None] * np.diff(vertices, axis=0)[segment]).T
        return self.problem.world.free_space(z).signed_clearance(x, y)

    def _distance_rows(self, at: FloatArray) -> list[StepLimits]:
        """Return linear limits of steps that keep the polyline off obstacles, linearised at a step (d,)."""
        vertices = self._vertices(at[None])[0]
        ahead = np.diff(vertices, axis=0)
        rows = []
        for z, floor in self._floors:
            samples, distance = self._near(vertices, z)
            near = distance < floor + REACH
            segment, share, distance = samples.segment[near], samples.begin[near], distance[near]
            x, y = (vertices[segment] + share[:, None] * ahead[segment]).T
            space = self.problem.world.free_space(z)
            shifts = ((PROBE, 0.0), (-PROBE, 0.0), (0.0, PROBE), (0.0, -PROBE))
            east, west, north, south = (space.signed_clearance(x + dx, y + dy) for dx, dy in shifts)
            gradient = np.stack([east - west, north - south], axis=1) / (2 * PROBE)
            moves = (1 - share)[:, None, None] * self.basis[segment] + share[:, None, None] * self.basis[segment + 1]
            # A sample between two corners that moves along its segment stays on it, so only motion across it counts.
            tangent = ahead[segment] / np.hypot(*ahead[segment].T)[:, None]
            inner = (share > 0) & (share < 1)
            across = gradient - np.where(inner, (gradient * tangent).sum(axis=1), 0.0)[:, None] * tangent
            slopes = -np.einsum("sa,sad->sd", across, moves)
            rows.append(StepLimits(slopes, distance - floor + slopes @ at, np.full(len(distance), -1)))
        return rows

    # Steps

    @cached_property
    def _rows(self) -> list[StepLimits]:
        """Linear limits of steps, for distances to obstacles and for maxima, linearised at the polyline itself."""
        return self._limits_at(np.zeros(self.freedom))

    def _limits_at(self, step: FloatArray) -> list[StepLimits]:
        """Return linear limits of steps, for distances to obstacles and for maxima, linearised at a step (d,)."""
        return [*self._distance_rows(step), *self._maximum_rows(step)]

    def forget(self) -> None:
        """Drop all corrections that :meth:`learn` added to the model."""
        self._more, self._excess = [], np.zeros(len(self.criteria))

    def learn(self, step: FloatArray) -> bool:
        """Correct the model with exact costs and distances at a step that failed; return whether the model changed."""
        costs = self._sums(step[None])[:, 0]
        foreseen = self.costs + self.slopes @ step
        excess = np.zeros(len(self.criteria))
        excess[self.sums] = np.maximum(costs[self.sums] - foreseen[self.sums], 0.0)
        more = self._limits_at(step)
        news = bool(self.maxima) or bool(
            np.any(excess - self._excess > 1e-3 * np.maximum(1e-3, np.abs(self.bounds - self.costs)))
        )
        news |= any(bool((row.slopes @ step - row.room > 1e-9)[row.maximum < 0].any()) for row in more)
        self._more += more
        self._excess = excess
        return news

    def gain(self, step: FloatArray) -> float:
        """Return by how much the merit (weighted sum of costs) falls after a step (d,), as the model predicts."""
        rows = _joined([*self._rows, *self._more], self.freedom)
        after = self.costs + self.slopes @ step
        for j in self.maxima:
            mine = rows.maximum == j
            after[j] = (rows.slopes[mine] @ step - rows.room[mine]).max(initial=0.0)
        return float(self.weights @ (self.costs - after)) - 0.5 * float(step @ self._curvature @ step)

    def step(self, distance: float) -> FloatArray | None:
        """Return the best step (d,) by the model, with coordinates of at most ``distance``, m; None if solving fails.

        This is a quadratic program. Its variables are the step, divided by the distance, the value of each maximum, and
        the excess of each cost over its bound, both divided by the cost's scale. Sets ``multipliers``, of the costs.
        """
        d, k = self.freedom, len(self.criteria)
        rows = _joined([*self._rows, *self._more], d).within(distance)
        bounded = [j for j in range(k) if np.isfinite(self.bounds[j])]
        tops, beyond = np.arange(d, d + k), np.arange(d + k, d + 2 * k)
        objective, curvature = np.zeros(d + 2 * k), np.zeros((d + 2 * k, d + 2 * k))
        objective[:d] = distance * (self.weights @ self.slopes)
        objective[tops[self.maxima]] = (self.weights * self.scale)[self.maxima]
        objective[beyond] = PENALTY
        curvature[:d, :d] = distance**2 * self._curvature

        limits, room = np.zeros((len(bounded), d + 2 * k)), self.bounds[bounded]
        for i, j in enumerate(bounded):
            limits[i, beyond[j]] = -self.scale[j]
            if j in self.maxima:
                limits[i, tops[j]] = self.scale[j]
            else:
                limits[i, :d] = distance * self.slopes[j]
                room[i] -= self.costs[j] + self._excess[j]
        near = np.zeros((len(rows.room), d + 2 * k))
        near[:, :d] = distance * rows.slopes
        of_maxima = np.flatnonzero(rows.maximum >= 0)
        near[of_maxima, tops[rows.maximum[of_maxima]]] = -self.scale[rows.maximum[of_maxima]]
        lengths, within, positive = self.polyline.lengths, np.eye(d, d + 2 * k), -np.eye(d + 2 * k)[beyond]
        ahead = np.diff(self.polyline.vertices, axis=0) / lengths[:, None]
        keep = np.zeros((len(lengths), d + 2 * k))
        keep[:, :d] = -distance * np.einsum("va,vad->vd", ahead, np.diff(self.basis, axis=0))
        unused = -np.eye(d + 2 * k)[np.delete(tops, self.maxima)]  # of sums, which nothing else bounds
        matrix = np.concatenate([limits, near, keep, within, -within, positive, unused])
        below = [room, rows.room, (1 - KEEP) * lengths, np.ones(2 * d), np.zeros(k), np.zeros(len(unused))]
        solution = _solved(curvature, objective, matrix, np.concatenate(below))
        if solution is None:
            return None
        x, multipliers = solution
        self.multipliers = self.weights.copy()
        for j, multiplier in zip(bounded, multipliers[: len(bounded)].tolist(), strict=True):
            if j in self.sums:
                self.multipliers[j] += max(0.0, multiplier)
        return distance * x[:d]


def _solved(
    curvature: FloatArray, objective: FloatArray, matrix: FloatArray, room: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Minimise ``½ x·curvature·x + objective·x`` with ``matrix x <= room``; return x and multipliers, or None."""
    import clarabel
    from scipy import sparse

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.NonnegativeConeT(len(room))]
    result = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(curvature)), objective, sparse.csc_matrix(matrix), room, cones, settings
    ).solve()
    if str(result.status) not in ("Solved", "AlmostSolved"):
        return None
    return np.array(result.x), np.array(result.z)


def _parts(vertices: FloatArray, length: float) -> SegmentParts:
    """Cut the segments of a polyline into equal parts, at most ``length`` metres long, and return the parts."""
    return parts_of(np.maximum(1, np.ceil(np.hypot(*np.diff(vertices, axis=0).T) / length)).astype(np.int64))


def turns_of(structure: PolylineStructure, vertices: FloatArray, polyline: Polyline, problem: Problem) -> list[Motions]:
    """Return one batch with the turns in place of b polylines (b, n+1, 2); no batch if there are no turns.

    The polylines have the given structure, and the headings of ``polyline`` at start and goal.
    """
    at, model = structure.turning, problem.model
    if not at:
        return []
    ahead = np.diff(vertices, axis=1)
    yaws = np.pad(np.arctan2(ahead[..., 1], ahead[..., 0]), ((0, 0), (1, 1)))
    yaws[:, 0], yaws[:, -1] = polyline.start_yaw, 0.0 if polyline.goal_yaw is None else polyline.goal_yaw
    before, after = yaws[:, at].ravel(), yaws[:, np.array(at) + 1].ravel()
    x, y = vertices[:, at].reshape(-1, 2).T
    start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
    return [Motions(problem.world, model, model.laws["turn"], start, end)]


def _is_local_maximum(values: FloatArray, segment: IntArray) -> BoolArray:
    """Return a mask (n,) of local maxima: values that are no lower than their neighbours on the same segment.

    segment  (n,)  index of the segment to which each value belongs, ascending
    """
    new = np.diff(segment, prepend=-1) > 0
    last = np.append(new[1:], True)
    return (new | (values >= np.roll(values, 1))) & (last | (values >= np.roll(values, -1)))


def _joined(rows: Sequence[StepLimits], d: int) -> StepLimits:
    """Join several blocks of step limits into one, for steps of d coordinates; the result may be empty."""
    if not rows:
        return StepLimits(np.zeros((0, d)), np.zeros(0), np.zeros(0, dtype=np.int64))
    return StepLimits(*(np.concatenate(part) for part in zip(*rows, strict=True)))
