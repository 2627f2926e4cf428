"""Which weights joint bounds are made for."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.search.timed.joint import LANES, UNIT

EVEN = 0.25  # what each cost has at least of a mixed weight, times the share of one among them all


def lone_weights(summed: IntArray, typical: FloatArray) -> tuple[FloatArray, IntArray]:
    """Weights (LANES, k) of each summed cost alone, powers of two, then even mixtures; shifts (k,) of the former.

    summed   columns of costs that add up
    typical  (k,) what a whole way costs, about
    """
    k = len(typical)
    weights, shift = np.zeros((LANES, k)), np.zeros(k, np.int64)
    for lane, j in enumerate(summed):
        shift[j] = max(0, int(np.ceil(np.log2(max(1.0, typical[j] / UNIT)))))
        weights[lane, j] = 2.0 ** -shift[j]
    mixed = mixtures(len(summed), LANES - len(summed))
    weights[len(summed) :, summed] = _whole(mixed * UNIT / np.maximum(1.0, typical[summed]))
    return weights, shift


def mixed_weights(summed: IntArray, ranges: FloatArray, typical: FloatArray) -> FloatArray:
    """Weights (LANES, k) that make ranges (k,) alike; none is larger than what makes a whole way UNIT."""
    weights = np.zeros((LANES, len(ranges)))
    one = mixtures(len(summed), LANES) / np.maximum(1.0, ranges[summed])
    most = (one * np.maximum(1.0, typical[summed])).sum(axis=1)
    weights[:, summed] = _whole(one * UNIT / most[:, None])
    return weights


def _whole(weights: FloatArray) -> FloatArray:
    """Weights rounded to whole numbers where they are at least 1: sums of what they weigh are then exact."""
    return np.asarray(np.where(weights >= 1, np.rint(weights), weights))


def mixtures(k: int, count: int) -> FloatArray:
    """Positive weights (count, k), sums 1: first the even one, then those that favour each cost, then spread ones.

    >>> mixtures(2, 3).round(3).tolist()
    [[0.5, 0.5], [0.875, 0.125], [0.125, 0.875]]
    """
    if k == 1:
        return np.ones((count, 1))
    even = np.full((1, k), 1 / k)
    favour = (1 - EVEN) * np.eye(k) + EVEN / k
    generator = np.random.default_rng(0)  # any spread will do, the same each time
    spread = generator.dirichlet(np.full(k, 0.7), max(0, count - k - 1))
    return np.concatenate([even, favour, (1 - EVEN / 5) * spread + EVEN / 5 / k])[:count]
