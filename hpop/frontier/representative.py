"""A few rows that represent a front: those with a large joint hypervolume."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arguments import checked_arguments
from hpop.base.text import is_whole, python_value, shown
from hpop.frontier.dominance import FloatArray, IntArray, finite_costs, is_nondominated
from hpop.frontier.points import FrontError

BOX = 1.1  # reference point of scaled costs, so that the best of each criterion counts as well
SHARE = "63 %"  # 1 - 1/e, rounded down


@checked_arguments
def representative(Y: ArrayLike, count: int) -> IntArray:
    """Return the rows of up to ``count`` cost vectors with a large joint hypervolume, in ascending order.

    Costs are scaled to 0 ... 1 over the non-dominated rows, with reference point 1.1. Rows are added one by one, each
    time the row that adds most hypervolume. Since hypervolume is submodular, the result has at least 1 - 1/e (63 %) of
    the hypervolume of the best ``count`` rows (Nemhauser, Wolsey and Fisher 1978, doi 10.1007/BF01588971; Guerreiro,
    Fonseca and Paquete 2016, doi 10.1162/EVCO_a_00188).

    Of equal rows only the first is returned, and dominated rows never are, so the result may be shorter than ``count``.

    Raises FrontError for a count below 1.

    >>> representative([[0, 10], [1, 9], [5, 5], [9, 1], [10, 0], [6, 6]], 3).tolist()
    [1, 2, 3]
    """
    if not is_whole(count) or python_value(count) < 1:
        raise FrontError(f"count must be a whole number of points, at least 1, got {shown(count)}")
    number = int(python_value(count))
    costs = finite_costs(Y).astype(np.float64)
    rows = np.flatnonzero(is_nondominated(costs))
    if len(rows) <= number:
        return rows
    costs = costs[rows]
    span = np.ptp(costs, axis=0)
    scaled = (costs - costs.min(axis=0))[:, span > 0] / span[span > 0]
    return rows[_greedy(scaled, number)]


def _greedy(scaled: FloatArray, count: int) -> IntArray:
    """Return the rows, in ascending order, that add most hypervolume, one after the other.

    Gains only shrink as rows are added. So an old gain is an upper bound, and only the largest is computed anew.
    """
    import moocore  # slow to import

    def volume(rows: list[int]) -> float:
        return float(moocore.hypervolume(scaled[rows], ref=np.full(scaled.shape[1], BOX)))

    bounds = [(-gain, row) for row, gain in enumerate(np.prod(BOX - scaled, axis=1).tolist())]
    heapq.heapify(bounds)
    chosen: list[int] = []
    reached, fresh = 0.0, -1
    while len(chosen) < count:
        _, row = heapq.heappop(bounds)
        if row == fresh:
            chosen.append(row)
            reached, fresh = volume(chosen), -1
            continue
        gain = volume([*chosen, row]) - reached
        heapq.heappush(bounds, (-gain, row))
        fresh = bounds[0][1] if bounds[0] == (-gain, row) else -1
    return np.sort(np.array(chosen, np.int64))
