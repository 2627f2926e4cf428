"""Modules that all searches share: labels, time slices, lower bounds, groups of turns, checkpoints, approximation.

Here is the approximation of fronts with a guarantee: the precision of a front, and the gap of a stopped search. A
vector r covers a vector p if r <= (1 + eps) p + tolerance in every cost. A label (partial path) has an estimate f, a
lower bound of the costs of all paths that begin with it. If a solution covers f, it covers all these paths, so the
label need not be extended. To use the dominance tests of the exact search for this, the front stores for each solution
the least estimate that the solution covers. Source: Warburton, "Approximation of Pareto optima in multiple-objective,
shortest-path problems", 1987.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.lazy import homes_of, on_first_use
from hpop.base.options import MOST, MOST_COUNTED, set_reals, whole
from hpop.frontier import is_nondominated

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.machinery import bounds as bounds
    from hpop.search.machinery import changed_turns as changed_turns
    from hpop.search.machinery import kernels as kernels
    from hpop.search.machinery import labels as labels
    from hpop.search.machinery import plain_bounds as plain_bounds
    from hpop.search.machinery import slices as slices
    from hpop.search.machinery import turns as turns


ANYTHING = MOST_COUNTED  # bound that no path exceeds: it means that there is no bound
CHUNK = 1024  # number of open labels that are compared with the front at once


@dataclass(frozen=True)
class Precision:
    """Precision of a front: for every non-dominated vector p there is a returned r <= (1 + eps) p + tolerance.

    eps        relative error, the same for all costs
    tolerance  (k,) absolute error of each cost, in whole quanta; () means 0 for all costs

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
        """True if no error is allowed, so that every non-dominated vector is returned."""
        return self.eps == 0 and not any(self.tolerance)

    def of(self, columns: Sequence[int]) -> IntArray:
        """Return the tolerances (j,) of the costs in the given columns (j,).

        The column -1 stands for a cost that is always 0, and has the tolerance 0.
        """
        return np.array([self.tolerance[j] if self.tolerance and j >= 0 else 0 for j in columns], np.int64)


EXACT = Precision()


def thin_front(costs: IntArray, chosen: IntArray, eps: float, tolerance: IntArray) -> IntArray:
    """Select rows of a front that cover all of its rows within a precision, together with vectors chosen before.

    Returns the indices of the selected rows. The rule is greedy: take the last row that covers the first uncovered row,
    and repeat until all are covered.

    costs      (n, k)  the front, in lexicographic order
    chosen     (m, k)  vectors that are returned to the user anyway
    eps        relative error
    tolerance  (k,)  absolute errors, see :class:`Precision`
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
    """Return how much better than a front missing vectors may be: the relative gap.

    It is the least gap such that for each estimate p the front has a vector r <= (1 + gap) p.

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
    """Return for each estimate (m,) the smallest relative excess of a vector of the front over it.

    The excess of a vector is the largest over all costs, at least 0.
    """
    best = np.full(len(estimates), math.inf)
    positive = estimates > 0
    divisor = np.where(positive, estimates, 1.0)
    for vector in front:
        ratio = np.where(positive, vector / divisor - 1.0, np.where(vector > 0, math.inf, 0.0))
        best = np.minimum(best, np.maximum(ratio.max(axis=1), 0.0))
    return best


__getattr__ = on_first_use(__name__, homes_of(__name__))
