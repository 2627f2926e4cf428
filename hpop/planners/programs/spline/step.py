"""One step of sequential quadratic programming, which moves the knots of a spline to lower its costs.

Distances of bodies and limits of speeds are replaced by their tangents, costs by tangents and the convex part of their
curvature. So a step is limited to a trust region (Nocedal and Wright, Numerical Optimization, 2006, chapter 18).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.motions import Separations
from hpop.planners.programs.spline.knots import Knots, Slopes, SplineLaw, hermite

PENALTY = 10.0  # weight of the excess of a cost over its bound, larger than any sum of weights
FASTER = 4.0  # bound on the change of a slope, as a share of the greatest slope, per size of the trust region
LIKELY = 0.2  # share of the trust region: rows that a step of this size can violate are added at once
BROKEN = 1e-6  # m or the row's unit: largest accepted violation of a row
SOLVED = ("Solved", "AlmostSolved")  # Clarabel's statuses of a usable solution


class Aim(NamedTuple):
    """Weights and bounds of the costs of a spline.

    weights  (k,)  of the costs, each as a share of its scale
    bounds   (k,)  that none should exceed
    scale    (k,)  positive
    """

    weights: FloatArray
    bounds: FloatArray
    scale: FloatArray

    def merit(self, costs: FloatArray) -> float:
        """Return the merit, which a step lowers: the weighted sum of costs, and penalties beyond bounds."""
        beyond = np.maximum(0.0, (costs - self.bounds) / self.scale)
        return float((self.weights * costs / self.scale).sum() + PENALTY * beyond.sum())


class Constraints(NamedTuple):
    """Linear constraints of a program, A x <= b, with at most m entries in a row.

    entries  (R, m)
    indices  (R, m)  of the variable of each entry; -1 for none
    bounds   (R,)
    """

    entries: FloatArray
    indices: IntArray
    bounds: FloatArray

    def times(self, values: FloatArray) -> FloatArray:
        """Return A x (R,) for the variables (V,)."""
        return np.asarray(np.einsum("rm,rm->r", self.entries, np.append(values, 0.0)[self.indices]))

    @property
    def sizes(self) -> Constraints:
        """The constraints with absolute entries."""
        return self._replace(entries=np.abs(self.entries))

    def some(self, rows: BoolArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return row, column and value of the entries of some rows (R,), which are counted from 0."""
        entries, indices = self.entries[rows], self.indices[rows]
        row, place = np.nonzero((indices >= 0) & (entries != 0.0))
        return row, indices[row, place], entries[row, place]


class Step(NamedTuple):
    """Step of a program.

    values       (N - 1, n)  change of the inner knots, rad or m
    slopes       (N - 1, n)  change of their slopes
    duration     s           change of the total time
    gain         predicted reduction of the merit
    multipliers  (k,)        of the bounds of the costs
    costs        (k,)        by their tangents
    """

    values: FloatArray
    slopes: FloatArray
    duration: float
    gain: float
    multipliers: FloatArray
    costs: FloatArray


class StepPrograms:
    """Quadratic programs of splines with given shares of the time.

    Variables are the knots between start and goal, each with its slopes, and the total time.
    """

    def __init__(self, shares: FloatArray, law: SplineLaw, low: FloatArray, high: FloatArray) -> None:
        self.shares, self.low, self.high = shares, low, high
        self.speeds, self.accelerations = np.array(law.speeds), np.array(law.accelerations)
        self.joints, self.size = low.size, (shares.size - 1) * 2 * low.size + 1

    @cached_property
    def indices(self) -> IntArray:
        """Index (N, 4 n + 1) of the variable of each column of a piece; -1 for start and goal, which are fixed."""
        count, n = self.shares.size, self.joints
        knots = np.full((count + 1, 2 * n), -1)
        knots[1:-1] = np.arange((count - 1) * 2 * n).reshape(count - 1, 2 * n)
        return np.column_stack([knots[:-1], knots[1:], np.full(count, self.size - 1)])

    def of(
        self,
        knots: Knots,
        aim: Aim,
        slopes: Slopes,
        bends: FloatArray,
        apart: Separations,
        margin: float,
        fractions: FloatArray,
    ) -> StepProgram:
        """Return the programs at one spline.

        Parameters
        ----------
        bends : (N, 4 n + 1, 4 n + 1) curvature of the merit by the variables of each piece
        apart : separations at fractions of the pieces, fraction by fraction
        margin : m, least distance of bodies, or their present distance if that is less
        """
        from scipy import sparse  # on first use

        gradients = np.zeros((slopes.costs.size, self.size))
        for j in range(slopes.costs.size):
            moves = self.indices >= 0
            np.add.at(gradients[j], self.indices[moves], slopes.gradients[j][moves])
        row, column = (np.broadcast_to(side, bends.shape) for side in (self.indices[:, :, None], self.indices[:, None]))
        free = (row >= 0) & (column >= row)
        curvature = sparse.csc_matrix((bends[free], (row[free], column[free])), shape=(self.size, self.size))
        constraints = self._limits(knots), self._apart(apart, margin, fractions)
        return StepProgram(self, knots, aim, slopes.costs, gradients, curvature, constraints)

    @cached_property
    def _limited(self) -> IntArray:
        """Index (N, n, 5) of the variables that limit a joint in a piece: its four columns, and the total time."""
        n = self.joints
        columns = np.append(np.arange(4 * n).reshape(4, n).T, np.full((n, 1), 4 * n), axis=1)
        return self.indices[:, columns]

    def _limits(self, knots: Knots) -> Constraints:
        """Return the limits of speeds, accelerations and joints at control points, which contain each piece.

        For its speeds a piece is split where they are extreme, so that the control points touch them there.
        """
        count, n, duration = self.shares.size, self.joints, knots.duration
        width = self.shares[:, None]
        ones, zero = np.ones((count, 1)), np.zeros((count, 1))
        begin, end = knots.bends
        control = 3.0 * knots.secants - knots.slopes[:-1] - knots.slopes[1:]
        u = knots.peaks[0]
        v = 1.0 - u
        before, after = v * knots.slopes[:-1] + u * control, v * control + u * knots.slopes[1:]
        reach = width / 3.0
        first, last = knots.values[:-1] + reach * knots.slopes[:-1], knots.values[1:] - reach * knots.slopes[1:]
        fast, quick = self.speeds * duration, self.accelerations * duration**2
        speeds, accelerations = (self.speeds, fast), (2.0 * self.accelerations * duration, quick)
        rates = [
            ((zero, zero, zero, ones), knots.slopes[1:], speeds),
            ((-3.0 * u / width, 1.0 - 2.0 * u, 3.0 * u / width, -u), before, speeds),
            ((-3.0 * v / width, -v, 3.0 * v / width, u - v), after, speeds),
            ((-6.0 / width**2, -4.0 / width, 6.0 / width**2, -2.0 / width), begin, accelerations),
            ((6.0 / width**2, 2.0 / width, -6.0 / width**2, 4.0 / width), end, accelerations),
        ]
        entries, bounds = list[FloatArray](), list[FloatArray]()

        def limit(weights: Sequence[FloatArray], sign: float, growth: FloatArray, room: FloatArray) -> None:
            columns = [*(sign * weight for weight in weights), growth]
            entries.append(np.stack([np.broadcast_to(column, (count, n)) for column in columns], axis=2))
            bounds.append(np.maximum(0.0, room))

        for weights, values, (growth, most) in rates:
            limit(weights, 1.0, -growth, most - values)
            limit(weights, -1.0, -growth, most + values)
        for weights, values in (((ones, reach, zero, zero), first), ((zero, zero, ones, -reach), last)):
            limit(weights, 1.0, np.zeros(n), self.high - values)
            limit(weights, -1.0, np.zeros(n), values - self.low)
        indices = np.tile(self._limited.reshape(-1, 5), (len(bounds), 1))
        return Constraints(np.concatenate(entries).reshape(-1, 5), indices, np.concatenate(bounds).ravel())

    def _apart(self, apart: Separations, margin: float, fractions: FloatArray) -> Constraints:
        """Return a row per pair of bodies near each other, which keeps their distance above the margin."""
        count = self.shares.size
        piece, fraction = apart.owner % count, fractions[apart.owner // count]
        weights = hermite(fraction[:, None], self.shares[piece, None])
        entries = np.concatenate([-weight * apart.gradient for weight in weights], axis=1)
        return Constraints(entries, self.indices[piece, :-1], apart.distance - np.minimum(margin, apart.distance))


@dataclass(frozen=True, eq=False)
class StepProgram:
    """Quadratic programs at one spline, for trust regions of any size.

    costs        (k,)
    gradients    (k, V)  by the variables
    curvature    (V, V)  of the merit, positive semidefinite; the upper triangle, sparse by columns
    constraints  of the limits and of the distances; no bound is negative, so that a step of 0 is feasible

    Few constraints bind. So a program begins with those that a step is likely to violate, and adds those that its
    solution violates until there are none.
    """

    steps: StepPrograms
    knots: Knots
    aim: Aim
    costs: FloatArray
    gradients: FloatArray
    curvature: Any
    constraints: tuple[Constraints, ...]

    @cached_property
    def _bends(self) -> tuple[IntArray, IntArray]:
        """Row and column of the entries of the curvature."""
        curvature = self.curvature
        return curvature.indices, np.repeat(np.arange(curvature.shape[1]), np.diff(curvature.indptr))

    def within(self, distance: float, longest: float, drift: FloatArray | float = 0.0) -> Step | None:
        """Return the best step, or None if the solver fails.

        Parameters
        ----------
        distance : rad or m, by which joints move at most
        longest : s, bound on the total time
        drift : (k,) of the costs from their tangents, if an earlier step has shown it
        """
        steps, knots = self.steps, self.knots
        inner, n = knots.shares.size - 1, steps.joints
        sloped = FASTER * distance * steps.speeds * knots.duration
        reach = np.append(np.tile(np.concatenate([np.full(n, distance), sloped]), inner), distance * knots.duration)
        later = min(reach[-1], max(0.0, longest - knots.duration))
        added = [rows.sizes.times(reach) * LIKELY > rows.bounds for rows in self.constraints]
        while True:
            solved = self._solved(reach, later / reach[-1], added, drift)
            if solved is None:
                return None
            move, multipliers = solved
            broken = [rows.times(move) > rows.bounds + BROKEN for rows in self.constraints]
            more = [new & ~old for new, old in zip(broken, added, strict=True)]
            if not any(new.any() for new in more):
                break
            added = [new | old for new, old in zip(more, added, strict=True)]
        costs, (row, column) = self.costs + self.gradients @ move, self._bends
        twice = np.where(row == column, 1.0, 2.0)
        bent = float((twice * self.curvature.data * move[row] * move[column]).sum())
        gain = self.aim.merit(self.costs) - self.aim.merit(costs) - 0.5 * bent
        joints = move[:-1].reshape(inner, 2 * n)
        return Step(joints[:, :n], joints[:, n:], float(move[-1]), gain, multipliers, costs)

    def _solved(
        self, reach: FloatArray, later: float, added: Sequence[BoolArray], drift: FloatArray | float
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the solution (V,) and the multipliers (k,) of the costs' bounds; None if the solver fails.

        The solver's variables are the step as shares of its reach, and the excess of each cost as a share of its scale.
        """
        from scipy import sparse  # on first use

        clarabel: Any = import_module("clarabel")  # on first use
        aim, size, count = self.aim, reach.size, len(self.gradients)
        every, each = np.arange(size), np.arange(count)
        some = list[tuple[IntArray, IntArray, FloatArray]]()
        last = count
        for rows, use in zip(self.constraints, added, strict=True):
            row, column, data = rows.some(use)
            some.append((last + row, column, data * reach[column]))
            last += int(np.count_nonzero(use))
        first = np.cumsum([last, size, size])  # row of each group that follows
        parts = [
            (np.repeat(each, size), np.tile(every, count), (self.gradients / aim.scale[:, None] * reach).ravel()),
            (each, size + each, -np.ones(count)),
            *some,
            (first[0] + every, every, np.ones(size)),
            (first[1] + every, every, -np.ones(size)),
            (first[2] + each, size + each, -np.ones(count)),
        ]
        row, column, data = (np.concatenate(column) for column in zip(*parts, strict=True))
        total = int(first[2]) + count
        matrix = sparse.csc_matrix((data, (row, column)), shape=(total, size + count))
        room = [rows.bounds[use] for rows, use in zip(self.constraints, added, strict=True)]
        above = np.append(np.ones(size - 1), later)
        bounds = [(aim.bounds - drift - self.costs) / aim.scale, *room, above, np.ones(size), 0.0 * each]
        row, column = self._bends
        entries = self.curvature.data * reach[row] * reach[column]
        ends = np.append(self.curvature.indptr, np.full(count, row.size))  # an excess has no curvature
        curvature = sparse.csc_matrix((entries, row, ends), shape=(size + count, size + count))
        slope = np.append((aim.weights / aim.scale) @ self.gradients * reach, np.full(count, PENALTY))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        cones = [clarabel.NonnegativeConeT(total)]
        problem = (curvature, slope, matrix, np.concatenate(bounds), cones, settings)
        solution = clarabel.DefaultSolver(*problem).solve()
        if str(solution.status) not in SOLVED:
            return None
        return np.array(solution.x)[:size] * reach, np.maximum(0.0, np.array(solution.z)[:count])
