"""How much better a missing vector may be, told quickly where labels are many; see :mod:`.machinery.approximation`."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean


@lean
def excess(one: FloatArray, least: FloatArray) -> float:
    """By how much a vector (k,) exceeds an estimate (k,), relative to it, in the worst cost."""
    worst = 0.0
    for j in range(len(one)):
        if least[j] > 0:
            worst = max(worst, one[j] / least[j] - 1.0)
        elif one[j] > 0:
            return np.inf
    return worst


@lean
def largest_gap(front: FloatArray, estimates: FloatArray, most: float) -> float:
    """Find the gap within which some vector of the front (n, k) covers each estimate (m, k); `most` or more is enough.

    Neighbours in a queue are alike, so the vector that covered one estimate is asked first about the next one.
    """
    gap = 0.0
    last = 0
    for i in range(len(estimates)):
        if excess(front[last], estimates[i]) <= gap:
            continue
        best = np.inf
        for r in range(len(front)):
            far = excess(front[r], estimates[i])
            if far < best:
                best = far
                last = r
                if best <= gap:
                    break
        gap = max(gap, best)
        if gap >= most:
            break
    return gap


def proven_gap(front: IntArray, estimates: IntArray, most: float) -> float:
    """As :func:`hpop.search.machinery.approximation.proven_gap`; where that is `most` or more, some gap of so much."""
    if not len(estimates):
        return 0.0
    if not len(front):
        return float("inf")
    return float(largest_gap(front.astype(np.float64), np.ascontiguousarray(estimates, np.float64), most))
