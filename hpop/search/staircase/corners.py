"""Corners of what solutions leave uncovered, and whether a label can still get into one.

Take the solutions with at most N turns, each by the least estimate that it covers (:mod:`.covered`): x in the first
cost, y in the rest cost. Sorted, with x rising and y falling, they leave a staircase uncovered, and every vector of at
least N turns that none of them covers is nowhere larger than one of its corners (x_i - 1, y_{i-1} - 1), where x or y is
infinite at its ends.

Let a label with n turns and costs g have a completion with m turns and costs c, and the sum not be covered. Then w.g +
w.c, so w.g + H_m, is at most w.corner for one corner of N = n + m and all weights w >= 0. Where no m and corner pass
that for the weights of :mod:`.turn_hull`, everything that becomes of the label is covered, and it need not be followed.
H_m is kept as what it exceeds w.h by, h being the least rests; w.g + w.h is w.f, f the label's estimate. Labels are
weighed rounded down and corners rounded up, so rounding never prunes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.slices import Clock
from hpop.search.staircase.turn_hull import DOWN, FAR, LANES, STEP_BITS, UP, IntLanes, Steps

NEVER = 2**31 - 1  # more than any bound: no label is above it


@dataclass(frozen=True, eq=False)
class Corners:
    """What is left uncovered.

    values  (N + 1, p + 1, LANES)  weighted corners with at most 0, 1, ... N or more turns; first costs rise
    last    (N + 1,)               the last corner of each
    """

    values: IntLanes
    last: IntArray

    @classmethod
    def of(cls, covered: IntArray, weights: FloatArray, clock: Clock) -> Corners:
        """The corners that solutions leave, told by the least estimates (p, 3) they cover: first, turns, rest."""
        order = np.lexsort((covered[:, 2], covered[:, 0]))
        most = int(covered[:, 1].max(initial=0))
        values = np.empty((most + 1, len(covered) + 1, LANES), np.int32)
        last = np.empty(most + 1, np.int64)
        clock.call(fill_corners, covered[order], weights, values, last)
        return cls(values, last)


@kernel
def fill_corners(covered: IntArray, weights: FloatArray, values: IntLanes, last: IntArray) -> None:
    """Weigh the corners (N + 1, p + 1, LANES) of estimates (p, 3) sorted by the first cost, then the rest cost."""
    infinite = float(NEVER)
    for n in range(len(last)):
        corner = 0
        above = np.int64(0)  # the rest cost of the solution before; none yet
        for i in range(len(covered) + 1):
            end = i == len(covered)
            if not end and (covered[i, 1] > n or (corner > 0 and covered[i, 2] >= above)):
                continue
            for k in range(LANES):
                first, rest = weights[k, 0], weights[k, 1]
                one = (infinite if end else first * (covered[i, 0] - 1)) if first > 0 else 0.0
                two = (infinite if corner == 0 else rest * (above - 1)) if rest > 0 else 0.0
                values[n, corner, k] = np.int32(min(infinite, max(0.0, one + two) * UP + 1))
            last[n] = corner
            corner += 1
            if not end:
                above = covered[i, 2]


@lean
def may_improve(
    v: int,
    n: int,
    first: int,
    rest: int,
    fewest: int,
    layers: Steps,
    weights: FloatArray,
    values: IntLanes,
    last: IntArray,
    scratch: IntLanes,
) -> bool:
    """Tell whether a label at v, with n turns and these estimates, may become what no solution covers.

    It needs at least `fewest` turns more, which may be more than there are layers; `scratch` is (2, LANES).
    """
    label, bound = scratch[0], scratch[1]
    node = np.uint64(v)
    for k in range(LANES):
        label[k] = np.int32(min(float(FAR), (weights[k, 0] * first + weights[k, 1] * rest) * DOWN))
    for m in range(min(fewest, len(layers) - 1), len(layers)):
        if m > fewest:
            same = True
            for k in range(LANES):
                same &= layers[m, node, k] == layers[m - 1, node, k]
            if same:  # no better than with a turn less, and no fewer solutions are known
                continue
        for k in range(LANES):
            bound[k] = label[k] + (np.int32(layers[m, node, k]) << STEP_BITS)
        most = np.uint64(min(n + max(m, fewest), len(last) - 1))
        low, high = np.int64(0), last[most]
        while low < high:
            middle = (low + high) >> 1
            if values[most, np.uint64(middle), 0] < bound[0]:
                low = middle + 1
            else:
                high = middle
        for i in range(np.uint64(low), np.uint64(last[most] + 1)):
            if values[most, i, 1] < bound[1]:
                break
            inside = True
            for k in range(LANES):
                inside &= values[most, i, k] >= bound[k]
            if inside:
                return True
    return False
