"""Solutions of a search on a clock: what they cover, and which of them are left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.covered import least_covered
from hpop.search.machinery.slices import N_FRONT


class Goal(NamedTuple):
    """Solutions, and what counts as one.

    costs, reach  (s, k)  of solutions; the least estimates that they cover
    values        (s,)    as of labels; leaves (s,) the tick at which the last arc is left for
    most          (k,)    what no solution may exceed
    arrive_by     the latest tick of an arrival
    is_target     (n,)
    """

    costs: IntArray
    reach: IntArray
    values: IntArray
    leaves: IntArray
    most: IntArray
    arrive_by: int
    is_target: NDArray[np.uint8]
    eps: float
    tolerance: IntArray


@lean
def is_covered(goal: Goal, count: int, f: IntArray) -> bool:
    """Whether a solution covers an estimate, or it exceeds what it may."""
    k = len(f)
    for j in range(k):
        if f[j] > goal.most[j]:
            return True
    for i in range(count - 1, -1, -1):
        covers = True
        for j in range(k):
            covers &= goal.reach[i, j] <= f[j]
        if covers:
            return True
    return False


@lean
def solve(goal: Goal, counters: IntArray, g: IntArray, value: int, leaves: int) -> None:
    """Enter a solution, and leave out those that it dominates."""
    k = len(g)
    kept = 0
    for i in range(counters[N_FRONT]):
        dominated = True
        for j in range(k):
            dominated &= g[j] <= goal.costs[i, j]
        if dominated:
            continue
        if kept < i:
            for j in range(k):
                goal.costs[kept, j] = goal.costs[i, j]
                goal.reach[kept, j] = goal.reach[i, j]
            goal.values[kept] = goal.values[i]
            goal.leaves[kept] = goal.leaves[i]
        kept += 1
    for j in range(k):
        goal.costs[kept, j] = g[j]
        goal.reach[kept, j] = least_covered(g[j], goal.eps, goal.tolerance[j])
    goal.values[kept] = value
    goal.leaves[kept] = leaves
    counters[N_FRONT] = kept + 1
