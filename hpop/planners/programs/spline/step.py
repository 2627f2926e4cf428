"""One step of sequential linear programming, which moves the knots of a spline to lower its costs.

Costs and distances of bodies are replaced by their tangents, so a step is limited to a trust region (Fletcher and Sainz
de la Maza 1989, doi 10.1007/BF01582292). Any step keeps the limits of speeds and accelerations, since they are linear
in knots and slopes or lie above their tangents (:mod:`.knots`).
"""

from __future__ import annotations

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
LIKELY = 0.05  # share of the trust region: rows that a step of this size can violate are added at once
BROKEN = 1e-7  # m or the row's unit: largest accepted violation of a row
SOLVER = {"output_flag": False, "solver": "simplex", "presolve": "off", "parallel": "off"}


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
    """Linear constraints of a program, A x <= b: a sparse matrix and bounds."""

    matrix: Any
    bounds: FloatArray


class StepPrograms:
    """Linear programs of splines with given shares of the time.

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
        self, knots: Knots, aim: Aim, slopes: Slopes, apart: Separations, margin: float, fractions: FloatArray
    ) -> StepProgram:
        """Return the programs at one spline.

        Parameters
        ----------
        apart : separations at fractions of the pieces, fraction by fraction
        margin : m, least distance of bodies, or their present distance if that is less
        """
        rows = [*self._limits(knots), self._apart(apart, margin, fractions)]
        from scipy import sparse  # on first use

        gradients = np.zeros((slopes.costs.size, self.size))
        for j in range(slopes.costs.size):
            moves = self.indices >= 0
            np.add.at(gradients[j], self.indices[moves], slopes.gradients[j][moves])
        matrix = sparse.vstack([row.matrix for row in rows]).tocsr()
        return StepProgram(
            self, knots, aim, slopes.costs, gradients, matrix, np.concatenate([row.bounds for row in rows])
        )

    def _limits(self, knots: Knots) -> list[Constraints]:
        """Return the limits of speeds, accelerations and joints at the control points, which contain each piece."""
        count, n, duration = self.shares.size, self.joints, knots.duration
        width = self.shares[:, None]
        ones, zero = np.ones((count, 1)), np.zeros((count, 1))
        begin, end = knots.bends
        control = 3.0 * knots.secants - knots.slopes[:-1] - knots.slopes[1:]
        reach = width / 3.0
        first, last = knots.values[:-1] + reach * knots.slopes[:-1], knots.values[1:] - reach * knots.slopes[1:]
        fast, quick = self.speeds * duration, self.accelerations * duration**2
        speeds, accelerations = (self.speeds, fast), (2.0 * self.accelerations * duration, quick)
        rates = [
            ((zero, zero, zero, ones), knots.slopes[1:], speeds),
            ((-3.0 / width, -ones, 3.0 / width, -ones), control, speeds),
            ((-6.0 / width**2, -4.0 / width, 6.0 / width**2, -2.0 / width), begin, accelerations),
            ((6.0 / width**2, 2.0 / width, -6.0 / width**2, 4.0 / width), end, accelerations),
        ]
        rows = list[Constraints]()
        for weights, values, (growth, limit) in rates:
            for sign in (1.0, -1.0):
                room = np.maximum(0.0, limit - sign * values)
                rows.append(self._rows([sign * weight for weight in weights], -growth, room))
        for weights, values in (((ones, reach, zero, zero), first), ((zero, zero, ones, -reach), last)):
            rows.append(self._rows(weights, np.zeros(n), np.maximum(0.0, self.high - values)))
            rows.append(self._rows([-weight for weight in weights], np.zeros(n), np.maximum(0.0, values - self.low)))
        return rows

    def _rows(self, weights: Any, growth: FloatArray, room: FloatArray) -> Constraints:
        """Return a row per piece and joint: weights (N, 1) of its four columns in a piece, and growth (n,) with T."""
        count, n = room.shape
        entries = np.zeros((count, n, 4 * n + 1))
        each = np.arange(n)
        for part, weight in enumerate(weights):
            entries[:, each, part * n + each] = weight
        entries[:, each, 4 * n] = growth
        indices = np.broadcast_to(self.indices[:, None], entries.shape)
        return Constraints(self._sparse(entries.reshape(count * n, -1), indices.reshape(count * n, -1)), room.ravel())

    def _apart(self, apart: Separations, margin: float, fractions: FloatArray) -> Constraints:
        """Return a row per pair of bodies near each other, which keeps their distance above the margin."""
        count = self.shares.size
        piece, fraction = apart.owner % count, fractions[apart.owner // count]
        weights = hermite(fraction[:, None], self.shares[piece, None])
        entries = np.concatenate([-weight * apart.gradient for weight in weights], axis=1)
        indices = self.indices[piece, :-1]
        room = apart.distance - np.minimum(margin, apart.distance)
        return Constraints(self._sparse(entries, indices), room)

    def _sparse(self, entries: FloatArray, indices: IntArray) -> Any:
        from scipy import sparse

        row, column = np.nonzero((indices >= 0) & (entries != 0.0))
        return sparse.csr_array((entries[row, column], (row, indices[row, column])), shape=(len(entries), self.size))


@dataclass(frozen=True, eq=False)
class StepProgram:
    """Linear programs at one spline, for trust regions of any size.

    costs      (k,)
    gradients  (k, V)  by the variables
    matrix     (R, V)  of the constraints
    bounds     (R,)    of the constraints, none negative, so that a step of 0 is feasible

    Few constraints bind. So a program begins with those that a step is likely to violate, and adds those that its
    solution violates until there are none. The solver continues from its last basis, also for a smaller trust region.
    """

    steps: StepPrograms
    knots: Knots
    aim: Aim
    costs: FloatArray
    gradients: FloatArray
    matrix: Any
    bounds: FloatArray

    @cached_property
    def _sizes(self) -> Any:
        return abs(self.matrix)

    @cached_property
    def _solver(self) -> Any:
        """Program with the constraints of the costs alone."""
        highspy: Any = import_module("highspy")  # on first use
        solver = highspy.Highs()
        for option, value in SOLVER.items():
            solver.setOptionValue(option, value)
        aim, count = self.aim, len(self.gradients)
        for weight in (aim.weights / aim.scale) @ self.gradients:
            solver.addCol(weight, 0.0, 0.0, 0, [], [])
        for _ in range(count):
            solver.addCol(PENALTY, 0.0, np.inf, 0, [], [])
        _add(solver, np.hstack([self.gradients, -np.diag(aim.scale)]), aim.bounds - self.costs)
        return solver

    @cached_property
    def _added(self) -> BoolArray:
        """True for each constraint (R,) that the solver has."""
        return np.zeros(self.bounds.size, dtype=bool)

    def within(self, distance: float) -> tuple[FloatArray, FloatArray] | None:
        """Return the best step of knots and slopes, (N - 1, n) each; joints move by a distance at most, rad or m.

        The result is None where the solver fails.
        """
        steps, knots, solver, added = self.steps, self.knots, self._solver, self._added
        inner, n = knots.shares.size - 1, steps.joints
        sloped = FASTER * distance * steps.speeds * knots.duration
        reach = np.append(np.tile(np.concatenate([np.full(n, distance), sloped]), inner), distance * knots.duration)
        solver.changeColsBounds(reach.size, np.arange(reach.size, dtype=np.int32), -reach, reach)
        more = ~added & (self._sizes @ reach * LIKELY > self.bounds)
        while True:
            if more.any():
                _add(solver, self.matrix[more], self.bounds[more])
                added |= more
            solver.run()
            if solver.modelStatusToString(solver.getModelStatus()) != "Optimal":
                return None
            solution = np.array(solver.getSolution().col_value)[: reach.size]
            more = ~added & (self.matrix @ solution > self.bounds + BROKEN)
            if not more.any():
                break
        moved = solution[:-1].reshape(inner, 2 * n)
        return moved[:, :n], moved[:, n:]


def _add(solver: Any, matrix: Any, bounds: FloatArray) -> None:
    """Add constraints, matrix x <= bounds, to a program."""
    from scipy import sparse  # on first use

    rows = sparse.csr_array(matrix)
    first, columns = rows.indptr[:-1].astype(np.int32), rows.indices.astype(np.int32)
    solver.addRows(bounds.size, np.full(bounds.size, -np.inf), bounds, rows.nnz, first, columns, rows.data)
