"""One step of sequential linear programming: which way a spline may move, and how far, to cost less.

What is not linear is taken as its tangent, so a step is believed within a distance only (a trust region; Fletcher and
Sainz de la Maza 1989, doi 10.1007/BF01582292): costs, and how far bodies are apart. Limits of speeds and accelerations
are kept by any step, since they are linear in knots and slopes or lie above their tangents (:mod:`.knots`).
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

PENALTY = 10.0  # of a cost beyond its bound, in shares of the bound: more than any sum of shares gains
FASTER = 4.0  # by so many times the distance a slope may change, as a share of the greatest
LIKELY = 0.05  # rows that so small a share of all that is believed might break are in a program from the beginning
BROKEN = 1e-7  # m, or what else bounds a row: no more is overlooked
SOLVER = {"output_flag": False, "solver": "simplex", "presolve": "off", "parallel": "off"}


class Aim(NamedTuple):
    """What a spline is to become.

    weights  (k,)  of the costs, each as a share of its scale
    bounds   (k,)  that none should exceed
    scale    (k,)  positive
    """

    weights: FloatArray
    bounds: FloatArray
    scale: FloatArray

    def merit(self, costs: FloatArray) -> float:
        """What a step shall lower: the weighted sum, and a penalty of what is beyond a bound."""
        beyond = np.maximum(0.0, (costs - self.bounds) / self.scale)
        return float((self.weights * costs / self.scale).sum() + PENALTY * beyond.sum())


class Rows(NamedTuple):
    """Rows of a program, A x <= b: entries of a sparse matrix and what bounds each row."""

    matrix: Any
    bounds: FloatArray


class Steps:
    """Linear programs for splines that have the same shares of the time.

    Variables are the knots between start and goal, each with its slopes, and the whole time.
    """

    def __init__(self, shares: FloatArray, law: SplineLaw, low: FloatArray, high: FloatArray) -> None:
        self.shares, self.low, self.high = shares, low, high
        self.speeds, self.accelerations = np.array(law.speeds), np.array(law.accelerations)
        self.joints, self.size = low.size, (shares.size - 1) * 2 * low.size + 1

    @cached_property
    def places(self) -> IntArray:
        """Variable (N, 4 n + 1) of each column of a piece; -1 of those that stay: of start and goal."""
        count, n = self.shares.size, self.joints
        knots = np.full((count + 1, 2 * n), -1)
        knots[1:-1] = np.arange((count - 1) * 2 * n).reshape(count - 1, 2 * n)
        return np.column_stack([knots[:-1], knots[1:], np.full(count, self.size - 1)])

    def of(
        self, knots: Knots, aim: Aim, slopes: Slopes, apart: Separations, margin: float, fractions: FloatArray
    ) -> Step:
        """The programs round one spline.

        Parameters
        ----------
        apart : of the joints at fractions of the pieces, those of all pieces at the first fraction first
        margin : m, how far bodies shall stay apart, or as far as they are
        """
        rows = [*self._limits(knots), self._apart(apart, margin, fractions)]
        from scipy import sparse  # on first use

        gradients = np.zeros((slopes.costs.size, self.size))
        for j in range(slopes.costs.size):
            moves = self.places >= 0
            np.add.at(gradients[j], self.places[moves], slopes.gradients[j][moves])
        matrix = sparse.vstack([row.matrix for row in rows]).tocsr()
        return Step(self, knots, aim, slopes.costs, gradients, matrix, np.concatenate([row.bounds for row in rows]))

    def _limits(self, knots: Knots) -> list[Rows]:
        """Speeds, accelerations and joint limits: of control points, which hold each piece."""
        count, n, duration = self.shares.size, self.joints, knots.duration
        width = self.shares[:, None]
        one, zero = np.ones((count, 1)), np.zeros((count, 1))
        begin, end = knots.bends
        control = 3.0 * knots.secants - knots.slopes[:-1] - knots.slopes[1:]
        reach = width / 3.0
        first, last = knots.values[:-1] + reach * knots.slopes[:-1], knots.values[1:] - reach * knots.slopes[1:]
        fast, quick = self.speeds * duration, self.accelerations * duration**2
        speeds, accelerations = (self.speeds, fast), (2.0 * self.accelerations * duration, quick)
        both = [
            ((zero, zero, zero, one), knots.slopes[1:], speeds),
            ((-3.0 / width, -one, 3.0 / width, -one), control, speeds),
            ((-6.0 / width**2, -4.0 / width, 6.0 / width**2, -2.0 / width), begin, accelerations),
            ((6.0 / width**2, 2.0 / width, -6.0 / width**2, 4.0 / width), end, accelerations),
        ]
        rows = list[Rows]()
        for weights, values, (growth, limit) in both:
            for sign in (1.0, -1.0):
                room = np.maximum(0.0, limit - sign * values)
                rows.append(self._rows([sign * weight for weight in weights], -growth, room))
        for weights, values in (((one, reach, zero, zero), first), ((zero, zero, one, -reach), last)):
            rows.append(self._rows(weights, np.zeros(n), np.maximum(0.0, self.high - values)))
            rows.append(self._rows([-weight for weight in weights], np.zeros(n), np.maximum(0.0, values - self.low)))
        return rows

    def _rows(self, weights: Any, growth: FloatArray, room: FloatArray) -> Rows:
        """A row for each piece and joint: weights (N, 1) of its four columns in a piece, growth (n,) with the time."""
        count, n = room.shape
        entries = np.zeros((count, n, 4 * n + 1))
        each = np.arange(n)
        for part, weight in enumerate(weights):
            entries[:, each, part * n + each] = weight
        entries[:, each, 4 * n] = growth
        places = np.broadcast_to(self.places[:, None], entries.shape)
        return Rows(self._sparse(entries.reshape(count * n, -1), places.reshape(count * n, -1)), room.ravel())

    def _apart(self, apart: Separations, margin: float, fractions: FloatArray) -> Rows:
        """A row for each pair of bodies near each other: their distance stays above the margin."""
        count = self.shares.size
        piece, fraction = apart.owner % count, fractions[apart.owner // count]
        weights = hermite(fraction[:, None], self.shares[piece, None])
        entries = np.concatenate([-weight * apart.gradient for weight in weights], axis=1)
        places = self.places[piece, :-1]
        room = apart.distance - np.minimum(margin, apart.distance)
        return Rows(self._sparse(entries, places), room)

    def _sparse(self, entries: FloatArray, places: IntArray) -> Any:
        from scipy import sparse

        row, column = np.nonzero((places >= 0) & (entries != 0.0))
        return sparse.csr_array((entries[row, column], (row, places[row, column])), shape=(len(entries), self.size))


@dataclass(frozen=True, eq=False)
class Step:
    """The programs round one spline: the same but for how far is believed.

    costs      (k,)
    gradients  (k, V)  by the variables
    matrix     (R, V)  of the rows
    bounds     (R,)    of them, none negative: no step at all keeps them

    Few rows bind. So a program begins with those that are nearest to it, and what its solution breaks is added until
    it breaks nothing; the solver goes on from the basis that it has, also where less is believed.
    """

    steps: Steps
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
        """The program with the rows of the costs alone."""
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
    def _taken(self) -> BoolArray:
        """Rows (R,) that the solver has."""
        return np.zeros(self.bounds.size, dtype=bool)

    def within(self, distance: float) -> tuple[FloatArray, FloatArray] | None:
        """By how much the knots and their slopes move, (N - 1, n) each, joints by a distance at most, rad or m.

        None where the solver fails.
        """
        steps, knots, solver, taken = self.steps, self.knots, self._solver, self._taken
        inner, n = knots.shares.size - 1, steps.joints
        sloped = FASTER * distance * steps.speeds * knots.duration
        reach = np.append(np.tile(np.concatenate([np.full(n, distance), sloped]), inner), distance * knots.duration)
        solver.changeColsBounds(reach.size, np.arange(reach.size, dtype=np.int32), -reach, reach)
        more = ~taken & (self._sizes @ reach * LIKELY > self.bounds)
        while True:
            if more.any():
                _add(solver, self.matrix[more], self.bounds[more])
                taken |= more
            solver.run()
            if solver.modelStatusToString(solver.getModelStatus()) != "Optimal":
                return None
            found = np.array(solver.getSolution().col_value)[: reach.size]
            more = ~taken & (self.matrix @ found > self.bounds + BROKEN)
            if not more.any():
                break
        moved = found[:-1].reshape(inner, 2 * n)
        return moved[:, :n], moved[:, n:]


def _add(solver: Any, matrix: Any, bounds: FloatArray) -> None:
    """Add rows, matrix x <= bounds, to a program."""
    from scipy import sparse  # on first use

    rows = sparse.csr_array(matrix)
    first, columns = rows.indptr[:-1].astype(np.int32), rows.indices.astype(np.int32)
    solver.addRows(bounds.size, np.full(bounds.size, -np.inf), bounds, rows.nnz, first, columns, rows.data)
