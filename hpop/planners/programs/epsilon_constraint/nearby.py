"""What one polyline knows of those near it: costs and distances to second and first order, and the best small step."""

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
from hpop.planners.programs.nlp import reaches
from hpop.planners.programs.polyline import Polyline
from hpop.world.ground import Heights

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

PENALTY = 100.0  # of a cost beyond its bound, in shares of its scale
PIECE = 0.1  # m: of a segment in which the worst moment is looked for, at first
SAMPLE = 0.04  # m: between places at which the distance to obstacles is read, at first
FINER = 7  # parts into which that is cut where something is passed
APART = 3e-5  # m: kept beside the robot's reach, for what lies between two places
REACH = 0.6  # m: obstacles that are farther away bound no step
KEEP = 0.5  # share of its length that a segment keeps in one step
PROBE = 1e-5  # m: of first differences
BENT = 5e-3  # m: of second differences
CURVATURE = 1e-7  # least of a program, so that it has one solution


class Rows(NamedTuple):
    """Linear limits of a step: slopes @ step - room <= 0, or <= the top of a maximum.

    slopes   (r, d)
    room     (r,)
    maximum  (r,)  place of its criterion; -1 where it is a distance to obstacles
    """

    slopes: FloatArray
    room: FloatArray
    maximum: IntArray

    def within(self, distance: float) -> Rows:
        """Return the rows that a step may reach whose coordinates are no larger than a distance, m."""
        near = (self.maximum >= 0) | (self.room <= distance * np.abs(self.slopes).sum(axis=1))
        return Rows(self.slopes[near], self.room[near], self.maximum[near])


class Places(NamedTuple):
    """Parts of a polyline's segments: segment (n,), and the shares (n,) of it at which each begins and ends."""

    segment: IntArray
    begin: FloatArray
    end: FloatArray

    def at(self, places: IntArray) -> Places:
        """Some of them."""
        return Places(self.segment[places], self.begin[places], self.end[places])


class Nearby:
    """The polylines that differ from one in its free corners.

    A corner next to an end at which nothing turns stays in the direction of that end. Sums are known to second order. A
    maximum is known at each of its local maxima along the way, and the distance to obstacles at places that stay where
    they are when a corner slides along its segment.

    problem, criteria  k smooth ones
    polyline
    costs    (k,) of the polyline, exact
    bounds   (k,) inf bounds nothing
    weights  (k,) of the costs in what a step lowers
    scale    (k,) positive: differences of costs that matter alike
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
        self._more: list[Rows] = []
        self._excess = np.zeros(len(criteria))
        self._curvature = np.zeros((self.freedom, self.freedom))

    # Corners

    @cached_property
    def basis(self) -> FloatArray:
        """By how much each vertex moves with each free coordinate, (n+1, 2, d)."""
        polyline, n = self.polyline, len(self.polyline.vertices) - 1
        directions: list[list[float]] = [[] for _ in range(n + 1)]
        if not self.structure.first_turn:
            directions[1].append(polyline.start_yaw)
        if polyline.goal_yaw is not None and not self.structure.last_turn:
            directions[n - 1].append(polyline.goal_yaw)
        columns = []
        for i in range(1, n):
            kept = [(np.cos(yaw), np.sin(yaw)) for yaw in directions[i]]
            for direction in ([(1.0, 0.0), (0.0, 1.0)], kept, [])[len(kept)]:
                column = np.zeros((n + 1, 2))
                column[i] = direction
                columns.append(column)
        return np.stack(columns, axis=2) if columns else np.zeros((n + 1, 2, 0))

    @property
    def freedom(self) -> int:
        """Number of free coordinates d."""
        return int(self.basis.shape[2])

    def moved(self, step: FloatArray) -> Polyline:
        """The polyline after a step (d,)."""
        return Polyline(self._vertices(step[None])[0], self.polyline.start_yaw, self.polyline.goal_yaw)

    def _vertices(self, steps: FloatArray) -> FloatArray:
        """Vertices (b, n+1, 2) after steps (b, d)."""
        vertices: FloatArray = self.polyline.vertices + np.einsum("vad,bd->bva", self.basis, steps)
        return vertices

    # Costs

    @cached_property
    def slopes(self) -> FloatArray:
        """Slopes (k, d) of sums; 0 of maxima."""
        probe = PROBE * np.eye(self.freedom)
        values = self._sums(np.concatenate([probe, -probe]))
        return (values[:, : self.freedom] - values[:, self.freedom :]) / (2 * PROBE)

    def bend(self, multipliers: FloatArray) -> None:
        """Learn how sums bend, each as it counts (k,) in the Lagrangian; made convex."""
        d = self.freedom
        first, second = np.triu_indices(d)
        one = BENT * np.eye(d)
        values = multipliers @ self._sums(np.concatenate([np.zeros((1, d)), one, -one, one[first] + one[second]]))
        here, ahead, back, both = values[0], values[1 : d + 1], values[d + 1 : 2 * d + 1], values[2 * d + 1 :]
        entries = both - ahead[first] - ahead[second] + here
        entries[first == second] = ahead + back - 2 * here
        hessian = np.zeros((d, d))
        hessian[first, second] = hessian[second, first] = entries / BENT**2
        value, vector = np.linalg.eigh(hessian)
        self._curvature = (vector * np.maximum(value, CURVATURE)) @ vector.T

    def _sums(self, steps: FloatArray) -> FloatArray:
        """Costs (k, b) of the criteria that add up, after steps (b, d); 0 of maxima."""
        vertices = self._vertices(steps)
        n = vertices.shape[1] - 1
        whole = Places(np.arange(n), np.zeros(n), np.ones(n))
        batches = [self._moves(vertices, whole), *self._turns(vertices)]
        values = np.zeros((len(self.criteria), len(steps)))
        for j in self.sums:
            for batch in batches:
                values[j] += motion_costs(self.criteria[j], batch).reshape(len(steps), -1).sum(axis=1)
        return values

    @cached_property
    def _tops(self) -> Places:
        """Parts of the segments in which some maximum has a local maximum along the way."""
        return self._tops_of(self.polyline.vertices)

    def _tops_of(self, vertices: FloatArray) -> Places:
        """Those of a polyline near this one: short parts first, then the worst of each one's parts."""
        parts = _parts(vertices, PIECE)
        found: list[Places] = []
        for j in self.maxima:
            worst = motion_costs(self.criteria[j], self._moves(vertices[None], parts))
            top = _no_lower(worst, parts.segment)
            finer = parts.at(np.repeat(np.flatnonzero(top), FINER))
            at = np.tile(np.arange(FINER) / FINER, int(top.sum()))
            length = finer.end - finer.begin
            finer = Places(finer.segment, finer.begin + at * length, finer.begin + (at + 1 / FINER) * length)
            worst = motion_costs(self.criteria[j], self._moves(vertices[None], finer)).reshape(-1, FINER)
            found.append(finer.at(np.arange(len(worst)) * FINER + worst.argmax(axis=1)))
        segment, begin, end = zip(*found, strict=True)
        return Places(np.concatenate(segment), np.concatenate(begin), np.concatenate(end))

    def _maximum_rows(self, at: FloatArray, tops: Places) -> list[Rows]:
        """Rows of maxima near a step (d,)."""
        probe = PROBE * np.eye(self.freedom)
        vertices = self._vertices(np.concatenate([at[None], at + probe, at - probe]))
        batches = [self._moves(vertices, tops), *self._turns(vertices)]
        rows = []
        for j in self.maxima:
            values = np.concatenate(
                [motion_costs(self.criteria[j], batch).reshape(len(vertices), -1) for batch in batches], axis=1
            )
            slopes = (values[1 : self.freedom + 1] - values[self.freedom + 1 :]).T / (2 * PROBE)
            rows.append(Rows(slopes, slopes @ at - values[0], np.full(values.shape[1], j)))
        return rows

    def _moves(self, vertices: FloatArray, parts: Places) -> Motions:
        """Moves along parts of the segments of several polylines (b, n+1, 2), those of the first polyline first."""
        begin, ahead = vertices[:, parts.segment], np.diff(vertices, axis=1)[:, parts.segment]
        yaw = np.arctan2(ahead[..., 1], ahead[..., 0]).ravel()
        first, last = ((begin + share[:, None] * ahead).reshape(-1, 2).T for share in (parts.begin, parts.end))
        model = self.problem.model
        start, end = (States(x=x, y=y, yaw=yaw) for x, y in (first, last))
        return Motions(self.problem.world, model, model.laws["move"], start, end)

    def _turns(self, vertices: FloatArray) -> list[Motions]:
        """The turns of several polylines, one batch; none where nothing turns."""
        structure, model = self.structure, self.problem.model
        at = list(range(int(not structure.first_turn), structure.segments + structure.last_turn))
        if not at:
            return []
        ahead = np.diff(vertices, axis=1)
        goal = 0.0 if self.polyline.goal_yaw is None else self.polyline.goal_yaw
        yaws = np.pad(np.arctan2(ahead[..., 1], ahead[..., 0]), ((0, 0), (1, 1)))
        yaws[:, 0], yaws[:, -1] = self.polyline.start_yaw, goal
        before, after = yaws[:, at].ravel(), yaws[:, np.array(at) + 1].ravel()
        x, y = vertices[:, at].reshape(-1, 2).T
        start, end = States(x=x, y=y, yaw=before), States(x=x, y=y, yaw=before + wrap(after - before))
        return [Motions(self.problem.world, model, model.laws["turn"], start, end)]

    # Distances

    @cached_property
    def _floors(self) -> list[tuple[Heights, float]]:
        """Height ranges, and how near an obstacle may come in each: to the robot's reach, or as near as it is now."""
        vertices = self.polyline.vertices
        return [
            (z, min(reach + APART, float(self._near(vertices, z)[1].min(initial=np.inf))))
            for z, reach in reaches(self.problem)
        ]

    def _near(self, vertices: FloatArray, z: Heights) -> tuple[Places, FloatArray]:
        """Places along a polyline, denser where it passes an obstacle, and their distances (S,)."""
        parts = _parts(vertices, SAMPLE)
        last = np.append(np.diff(parts.segment) > 0, True)
        segment = np.concatenate([parts.segment, parts.segment[last]])
        share = np.concatenate([parts.begin, np.ones(int(last.sum()))])
        order = np.lexsort((share, segment))
        segment, share = segment[order], share[order]
        here = self._distances(vertices, segment, share, z)
        passed = _no_lower(-here, segment) & (here < REACH)
        width = (parts.end - parts.begin)[np.searchsorted(parts.segment, segment[passed])]
        offsets = np.concatenate([np.arange(-FINER + 1, 0), np.arange(1, FINER)]) / FINER
        finer = np.repeat(segment[passed], len(offsets))
        within = np.clip((share[passed][:, None] + width[:, None] * offsets).ravel(), 0.0, 1.0)
        segment, share = np.concatenate([segment, finer]), np.concatenate([share, within])
        return Places(segment, share, share), np.concatenate([here, self._distances(vertices, finer, within, z)])

    def _distances(self, vertices: FloatArray, segment: IntArray, share: FloatArray, z: Heights) -> FloatArray:
        """Signed distances (S,), m, at shares of segments."""
        x, y = (vertices[segment] + share[:, None] * np.diff(vertices, axis=0)[segment]).T
        return self.problem.world.free_space(z).signed_clearance(x, y)

    def _distance_rows(self, at: FloatArray) -> list[Rows]:
        """Rows of the distance to obstacles near a step (d,)."""
        vertices = self._vertices(at[None])[0]
        ahead = np.diff(vertices, axis=0)
        rows = []
        for z, floor in self._floors:
            places, here = self._near(vertices, z)
            near = here < floor + REACH
            segment, share, here = places.segment[near], places.begin[near], here[near]
            x, y = (vertices[segment] + share[:, None] * ahead[segment]).T
            space = self.problem.world.free_space(z)
            shifts = ((PROBE, 0.0), (-PROBE, 0.0), (0.0, PROBE), (0.0, -PROBE))
            east, west, north, south = (space.signed_clearance(x + dx, y + dy) for dx, dy in shifts)
            gradient = np.stack([east - west, north - south], axis=1) / (2 * PROBE)
            moves = (1 - share)[:, None, None] * self.basis[segment] + share[:, None, None] * self.basis[segment + 1]
            # Between two corners, a place that moves along its segment becomes another place of the segment.
            along = ahead[segment] / np.hypot(*ahead[segment].T)[:, None]
            inner = (share > 0) & (share < 1)
            across = gradient - np.where(inner, (gradient * along).sum(axis=1), 0.0)[:, None] * along
            slopes = -np.einsum("sa,sad->sd", across, moves)
            rows.append(Rows(slopes, here - floor + slopes @ at, np.full(len(here), -1)))
        return rows

    # Steps

    @cached_property
    def _rows(self) -> list[Rows]:
        """What is known of the polyline itself."""
        here = np.zeros(self.freedom)
        rows = self._distance_rows(here)
        return [*rows, *self._maximum_rows(here, self._tops)] if self.maxima else rows

    def forget(self) -> None:
        """Forget what steps met."""
        self._more, self._excess = [], np.zeros(len(self.criteria))

    def learn(self, step: FloatArray) -> bool:
        """Learn what a step met; whether that is anything that was not known."""
        there = self._sums(step[None])[:, 0]
        foreseen = self.costs + self.slopes @ step
        excess = np.zeros(len(self.criteria))
        excess[self.sums] = np.maximum(there[self.sums] - foreseen[self.sums], 0.0)
        more = self._distance_rows(step)
        if self.maxima:
            more += self._maximum_rows(step, self._tops_of(self._vertices(step[None])[0]))
        news = bool(np.any(excess - self._excess > 1e-3 * np.maximum(1e-3, np.abs(self.bounds - self.costs))))
        news |= any(bool((row.slopes @ step - row.room > 1e-9)[row.maximum < 0].any()) for row in more)
        news |= bool(self.maxima)
        self._more += more
        self._excess = excess
        return news

    def gain(self, step: FloatArray) -> float:
        """How much a step promises to lower the weighted costs."""
        rows = _joined([*self._rows, *self._more], self.freedom)
        after = self.costs + self.slopes @ step
        for j in self.maxima:
            mine = rows.maximum == j
            after[j] = (rows.slopes[mine] @ step - rows.room[mine]).max(initial=0.0)
        return float(self.weights @ (self.costs - after)) - 0.5 * float(step @ self._curvature @ step)

    def step(self, distance: float) -> FloatArray | None:
        """The best step (d,) within a distance, m, for all that is known; None where the solver fails.

        Variables are the step, in shares of the distance, and, in shares of its scale, the top of each maximum and what
        each cost is beyond its bound.
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
        unused = -np.eye(d + 2 * k)[np.delete(tops, self.maxima)]  # whose tops nothing else bounds
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
    """The x of least ½ x·curvature·x + objective·x with matrix x <= room, and multipliers; None where none is found."""
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


def _parts(vertices: FloatArray, length: float) -> Places:
    """Segments cut into parts of about a length."""
    count = np.maximum(1, np.ceil(np.hypot(*np.diff(vertices, axis=0).T) / length)).astype(np.int64)
    segment = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    return Places(segment, place / count[segment], (place + 1) / count[segment])


def _no_lower(values: FloatArray, segment: IntArray) -> BoolArray:
    """Whether values (n,) are no lower than those beside them on their segment."""
    new = np.diff(segment, prepend=-1) > 0
    last = np.append(new[1:], True)
    return (new | (values >= np.roll(values, 1))) & (last | (values >= np.roll(values, -1)))


def _joined(rows: Sequence[Rows], d: int) -> Rows:
    """All rows as one."""
    if not rows:
        return Rows(np.zeros((0, d)), np.zeros(0), np.zeros(0, dtype=np.int64))
    return Rows(*(np.concatenate(part) for part in zip(*rows, strict=True)))
