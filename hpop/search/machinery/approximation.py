"""Approximation with a certificate: what covers what, and how large the gap of a search is that was stopped.

A vector r covers a vector p if r <= (1 + eps) p + tolerance in every cost. A label whose estimate f is covered by a
solution need not be followed: f is a lower bound of whatever comes of it, so the solution covers all of that. So it is
enough to put into the front, in the place of a solution, the least estimate that it covers: the tests stay what they
are. Warburton, "Approximation of Pareto optima in multiple-objective, shortest-path problems", 1987, has the notion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import MOST, MOST_COUNTED, set_reals, whole
from hpop.frontier import is_nondominated

ANYTHING = MOST_COUNTED  # no cost of a path is larger
CHUNK = 1024  # open labels that are compared with the front at once


@dataclass(frozen=True)
class Precision:
    """How near to every non-dominated vector a returned one must be.

    eps        relative, one for all costs
    tolerance  (k,) counts added to that; none is 0 everywhere

    Raises OptionError for what is negative or no number.
    """

    eps: float = 0.0
    tolerance: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        set_reals(self, "eps", least=0, most=MOST, kind="a number, such as 0.01 for one percent,")
        counts = tuple(whole("a tolerance", count, 0, ANYTHING) for count in self.tolerance)
        object.__setattr__(self, "tolerance", counts)

    @property
    def is_exact(self) -> bool:
        """Whether nothing may be missing."""
        return self.eps == 0 and not any(self.tolerance)

    def of(self, columns: Sequence[int]) -> IntArray:
        """The tolerance of some columns; -1 is a cost that is always 0."""
        return np.array([self.tolerance[j] if self.tolerance and j >= 0 else 0 for j in columns], np.int64)


EXACT = Precision()


def thinned(costs: IntArray, kept: IntArray, eps: float, tolerance: IntArray) -> IntArray:
    """Choose rows of costs (n, k), in lexicographic order, that with those kept (m, k) already cover all of them.

    The first that is uncovered is covered by the last one that can, and so on.
    """
    most = costs + np.floor(np.minimum(eps * costs, ANYTHING)).astype(np.int64) + tolerance
    left = np.ones(len(costs), np.bool_)
    for row in kept:
        left &= (row > most).any(axis=1)
    rows = []
    while left.any():
        best = np.flatnonzero((costs <= most[left.argmax()]).all(axis=1))[-1]
        rows.append(best)
        left &= (costs[best] > most).any(axis=1)
    return np.array(rows, np.int64)


def proven_gap(front: IntArray, estimates: IntArray) -> float:
    """How much better a missing vector may be: some vector of the front is below (1 + gap) times any estimate.

    front      (n, k)  found so far
    estimates  (m, k)  lower bounds of whatever is missing; none is no gap
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
    """By how much (m,) the nearest vector of the front exceeds each estimate, relative to it."""
    best = np.full(len(estimates), math.inf)
    positive = estimates > 0
    divisor = np.where(positive, estimates, 1.0)
    for vector in front:
        ratio = np.where(positive, vector / divisor - 1.0, np.where(vector > 0, math.inf, 0.0))
        best = np.minimum(best, np.maximum(ratio.max(axis=1), 0.0))
    return best
