"""How far away somebody must be whose place is uncertain: too near with no more than 5 % at any moment."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.special import ndtri
from scipy.stats import ncx2

from hpop.base.arrays import FloatArray

RISK = 0.05  # of a prediction at a moment
SIGMAS = float(-ndtri(RISK))
HALVINGS = 30
TABLE = 257  # deviations for which a distance is found
SMALLEST = 0.02  # of them, a share of the disc; below, the half-plane is as good


def clear_distance(deviation: FloatArray, disc: float) -> FloatArray:
    """How far (T,), m, the middle of a person must be from that of a disc to be in it with no more than the risk.

    Of an uncertain one the larger of what the nearest deviations in a table need.
    """
    deviations, needed = _table(float(disc))
    after = np.clip(np.searchsorted(deviations, deviation), 1, deviations.size - 1)
    unsure = np.maximum(needed[after - 1], needed[after])
    unsure = np.where(deviation > deviations[-1], 0.0, unsure)  # not even in its middle
    return np.where(deviation < deviations[0], disc + SIGMAS * deviation, unsure)


@lru_cache(maxsize=256)
def _table(disc: float) -> tuple[FloatArray, FloatArray]:
    """Deviations, m, up to the largest that matters, and the distances that they need."""
    largest = disc / math.sqrt(-2.0 * math.log1p(-RISK))
    deviations = np.geomspace(SMALLEST * disc, largest, TABLE)
    size = (disc / deviations) ** 2
    low, high = np.zeros(TABLE), disc + 5.0 * deviations
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        inside = ncx2.cdf(size, 2, (middle / deviations) ** 2) > RISK
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return deviations, high
