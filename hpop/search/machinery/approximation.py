"""Approximation with a certificate: coverage within a precision, and the gap of a search that was stopped.

A vector r covers a vector p if r <= (1 + eps) p + tolerance in every cost. A label with an estimate f that a solution
covers need not be followed: f is a lower bound of all its completions, so the solution covers these too. To use this
with the tests of the exact search, the front holds, for each solution, the least estimate that it covers. Source:
Warburton, "Approximation of Pareto optima in multiple-objective, shortest-path problems", 1987.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import MOST, MOST_COUNTED, set_reals, whole
from hpop.frontier import is_nondominated

ANYTHING = MOST_COUNTED  # bound that no cost of a path exceeds: no bound
CHUNK = 1024  # open labels compared with the front at once


@dataclass(frozen=True)
class Precision:
    """Precision of a front: every non-dominated vector p is covered by a returned r <= (1 + eps) p + tolerance.

    eps        relative error, the same for all costs
    tolerance  (k,) absolute error of each cost, in counts; () means 0 for all costs

    Raises OptionError for values that are negative or no numbers.
    """

    eps: float = 0.0
    tolerance: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        set_reals(self, "eps", least=0, most=MOST, kind="a number, such as 0.01 for one percent,")
        counts = tuple(whole("a tolerance", count, 0, ANYTHING) for count in self.tolerance)
        object.__setattr__(self, "tolerance", counts)

    @property
    def is_exact(self) -> bool:
        """True if the precision is 0, so that every non-dominated vector is returned."""
        return self.eps == 0 and not any(self.tolerance)

    def of(self, columns: Sequence[int]) -> IntArray:
        """Return the tolerances (j,) of some columns (j,); column -1, a cost that is always 0, has the tolerance 0."""
        return np.array([self.tolerance[j] if self.tolerance and j >= 0 else 0 for j in columns], np.int64)


EXACT = Precision()


def thin_front(costs: IntArray, chosen: IntArray, eps: float, tolerance: IntArray) -> IntArray:
    """Return indices of rows that, together with the ``chosen`` vectors (m, k), cover all rows of ``costs``.

    ``costs`` (n, k) is in lexicographic order. Greedy rule: take the last row that covers the first uncovered row;
    repeat until all rows are covered.
    """
    most = costs + np.floor(np.minimum(eps * costs, ANYTHING)).astype(np.int64) + tolerance
    left = np.ones(len(costs), np.bool_)
    for row in chosen:
        left &= (row > most).any(axis=1)
    rows = []
    while left.any():
        best = np.flatnonzero((costs <= most[left.argmax()]).all(axis=1))[-1]
        rows.append(best)
        left &= (costs[best] > most).any(axis=1)
    return np.array(rows, np.int64)


def proven_gap(front: IntArray, estimates: IntArray) -> float:
    """Return the least gap such that each estimate has a vector of the front of at most (1 + gap) times the estimate.

    front      (n, k)  vectors found so far; without vectors the gap is infinite
    estimates  (m, k)  lower bounds of all missing vectors; without estimates the gap is 0
    """
    if not len(estimates):
        return 0.0
    if not len(front):
        return math.inf
    least = estimates[is_nondominated(estimates.astype(np.float64))].astype(np.float64)
    worst = 0.0
    for begin in range(0, len(least), CHUNK):
        worst = max(worst, float(_excess(front.astype(np.float64), least[begin : begin + CHUNK]).max()))
    return worst


def _excess(front: FloatArray, estimates: FloatArray) -> FloatArray:
    """Return the relative excess (m,) of the nearest vector of the front over each estimate."""
    best = np.full(len(estimates), math.inf)
    positive = estimates > 0
    divisor = np.where(positive, estimates, 1.0)
    for vector in front:
        ratio = np.where(positive, vector / divisor - 1.0, np.where(vector > 0, math.inf, 0.0))
        best = np.minimum(best, np.maximum(ratio.max(axis=1), 0.0))
    return best
