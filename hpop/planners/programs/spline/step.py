"""One step of sequential quadratic programming, which moves the knots of a spline to lower its costs.

A spline (:mod:`.knots`) has N pieces for n joints. The variables of a program are values and slopes of its inner knots,
and the total time. Distances between bodies and limits of speeds are linearised. Costs are replaced by their tangents
and the convex part of their curvature. These approximations hold only nearby, so a step is limited to a trust region
(Nocedal and Wright, Numerical Optimization, 2006, chapter 18). A step lowers the merit: the weighted sum of the costs,
plus penalties for exceeded bounds.
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
LIKELY = 0.2  # share of the trust region: constraints that a step of this size can violate are added at the beginning
BROKEN = 1e-6  # m or the unit of the constraint: largest accepted violation
SOLVED = ("Solved", "AlmostSolved")  # Clarabel's statuses of a usable solution


class Aim(NamedTuple):
    """Weights, bounds and scales of the k costs of a spline.

    weights  (k,)  weights of the costs, after division by their scales
    bounds   (k,)  values that the costs should not exceed
    scale    (k,)  positive
    """

    weights: FloatArray
    bounds: FloatArray
    scale: FloatArray

    def merit(self, costs: FloatArray) -> float:
        """Return the merit, which steps lower: the weighted sum of scaled costs, plus penalties for exceeded bounds."""
        beyond = np.maximum(0.0, (costs - self.bounds) / self.scale)
        return float((self.weights * costs / self.scale).sum() + PENALTY * beyond.sum())


class Constraints(NamedTuple):
    """R linear constraints A x <= b, stored sparsely with m entries in each row of A.

    entries  (R, m)  the m stored entries of each row of A
    indices  (R, m)  index of the variable to which each entry belongs; -1 for an unused entry
    bounds   (R,)    b
    """

    entries: FloatArray
    indices: IntArray
    bounds: FloatArray

    def times(self, values: FloatArray) -> FloatArray:
        """Return A x (R,) for the variables (V,)."""
        return np.asarray(np.einsum("rm,rm->r", self.entries, np.append(values, 0.0)[self.indices]))

    @property
    def sizes(self) -> Constraints:
        """The constraints with the absolute values of all entries."""
        return self._replace(entries=np.abs(self.entries))

    def some(self, rows: BoolArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the entries of the rows that a mask (R,) selects, as three arrays: row, column and value.

        The selected rows are numbered from 0.
        """
        entries, indices = self.entries[rows], self.indices[rows]
        row, place = np.nonzero((indices >= 0) & (entries != 0.0))
        return row, indices[row, place], entries[row, place]


class Step(NamedTuple):
    """Step that a quadratic program proposes for a spline.

    values       (N - 1, n)  change of the inner knots, rad or m
    slopes       (N - 1, n)  change of their slopes
    duration     s           change of the total time
    gain         predicted reduction of the merit (:meth:`Aim.merit`), the sum that steps lower
    multipliers  (k,)        multipliers of the bounds of the costs
    costs        (k,)        costs after the step, predicted by their tangents
    """

    values: FloatArray
    slopes: FloatArray
    duration: float
    gain: float
    multipliers: FloatArray
    costs: FloatArray


class StepPrograms:
    """Factory of the quadratic programs for all splines with given shares of the time.

    Their variables are the values and slopes of the knots between start and goal, and the total time. ``low`` and
    ``high`` (n,) are the limits of the joints.
    """

    def __init__(self, shares: FloatArray, law: SplineLaw, low: FloatArray, high: FloatArray) -> None:
        self.shares, self.low, self.high = shares, low, high
        self.speeds, self.accelerations = np.array(law.speeds), np.array(law.accelerations)
        self.joints, self.size = low.size, (shares.size - 1) * 2 * low.size + 1

    @cached_property
    def indices(self) -> IntArray:
        """Index (N, 4 n + 1), among the variables of the program, of each variable of each of the N pieces.

        A piece has 4 n + 1 variables for n joints: values and slopes at its start, values and slopes at its end, and
        the total time (:meth:`.knots.Knots.columns`). Values and slopes at start and goal are fixed: their index is -1.
        """
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
        """Return the quadratic program for steps from one spline.

        Parameters
        ----------
        knots : the spline
        aim : weights and bounds of the costs
        slopes : costs of the spline and their gradients
        bends : (N, 4 n + 1, 4 n + 1) curvature of the merit by the variables of each piece
        apart : distances between bodies, with gradients, at the fractions of the pieces, fraction by fraction
        margin : m, least distance between bodies; if they are nearer already, their present distance
        fractions : fractions (0 to 1) of each piece to which ``apart`` refers
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
        """Index (N, n, 5) of the variables on which the motion of each joint in each piece depends.

        They are value and slope at the start, value and slope at the end, and the total time.
        """
        n = self.joints
        columns = np.append(np.arange(4 * n).reshape(4, n).T, np.full((n, 1), 4 * n), axis=1)
        return self.indices[:, columns]

    def _limits(self, knots: Knots) -> Constraints:
        """Return the limits of joint values, speeds and accelerations as linear constraints.

        They are imposed at control points, in whose hull each piece lies. For speeds, a piece is split where its speed
        is extreme, so that a control point has exactly the extreme speed.
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
        """Return a linear constraint for each pair of near bodies, which keeps their distance at the margin or more.

        A pair that is nearer than the margin may come no nearer than it is.

        apart, margin, fractions  arguments of :meth:`of`
        """
        count = self.shares.size
        piece, fraction = apart.owner % count, fractions[apart.owner // count]
        weights = hermite(fraction[:, None], self.shares[piece, None])
        entries = np.concatenate([-weight * apart.gradient for weight in weights], axis=1)
        return Constraints(entries, self.indices[piece, :-1], apart.distance - np.minimum(margin, apart.distance))


@dataclass(frozen=True, eq=False)
class StepProgram:
    """Quadratic program for steps from one spline, for trust regions of any size.

    knots        the spline from which steps go
    aim          weights, bounds and scales of the costs
    costs        (k,)    costs of the spline
    gradients    (k, V)  their derivatives by the V variables of the program
    curvature    (V, V)  Hessian of the merit (:meth:`Aim.merit`), positive semidefinite; its upper triangle, sparse by
                         columns
    constraints  limits of joints, and distances between bodies; no bound is negative, so a step of 0 is feasible

    Few constraints are active. So the program is solved with only those that a step is likely to violate. Then the
    constraints that its solution violates are added, and it is solved again, until there are none.
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
        """Rows and columns of the non-zero entries of the curvature matrix."""
        curvature = self.curvature
        return curvature.indices, np.repeat(np.arange(curvature.shape[1]), np.diff(curvature.indptr))

    def within(self, distance: float, longest: float, drift: FloatArray | float = 0.0) -> Step | None:
        """Return the best step within a trust region, or None if the solver fails.

        Parameters
        ----------
        distance : rad or m, largest change of a joint at a knot
        longest : s, upper bound of the total time
        drift : (k,) correction of the costs: by how much an earlier step missed its linear prediction
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
        """Solve the program with some of its constraints; return the step (V,) and the multipliers (k,) of the bounds.

        The result is None if the solver fails. The solver's variables are the step, divided by its largest size
        ``reach``, and the excess of each cost over its bound, divided by the scale. ``added`` selects constraints.

        later  largest increase of the total time, divided by its ``reach``
        drift  (k,)  correction of the costs, see :meth:`within`
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
