"""Random tastes that are not weighted sums of the costs: the alternative in the test whether a weighted sum fits.

The loss of a trajectory says how little a person likes it. Losses of five kinds are equally frequent, with random
weights of the costs: costs count only above a threshold; each cost has a value that the person likes most; each cost
counts as a step; costs count as powers; or only the worst weighted cost counts (Chebyshev). Over a front, the losses
of a person have the range 1, times a sharpness as in :class:`Prior`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import log
from typing import Self

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.preference.answers import LAPSE
from hpop.preference.prior import Prior

KINDS = 5
MOST_ROWS = 400
"""Most rows of a front for which losses of all tastes are computed; of a larger front, rows are drawn."""


@dataclass(frozen=True, eq=False)
class Tastes:
    """Random people whose taste is no weighted sum, with their losses on a front.

    kinds      (N,)    kind of the loss, 0 to KINDS - 1
    shares     (N, f)  weights of the costs
    wanted     (N, f)  threshold, most liked value, or place of the step of each cost, on its scale
    shapes     (N, f)  exponent or steepness of each cost
    least      (N,)    least loss on the front, before the range is 1
    span       (N,)    range of the losses on the front
    sharpness  (N,)    factor from losses to the logarithm of the odds of a choice
    """

    kinds: IntArray
    shares: FloatArray
    wanted: FloatArray
    shapes: FloatArray
    least: FloatArray
    span: FloatArray
    sharpness: FloatArray

    @classmethod
    def draw(cls, rows: FloatArray, prior: Prior, count: int, rng: np.random.Generator) -> tuple[Self, FloatArray]:
        """Draw ``count`` people for a front with scaled costs (m, f); return them, and their losses (count, m)."""
        f, each = rows.shape[1], count // KINDS
        wanted = rng.uniform(0.1, 0.9, (KINDS, each, f))
        shapes = np.ones((KINDS, each, f))
        shapes[1] = rng.uniform(1.0, 2.0, (each, 1))
        shapes[2] = rng.uniform(8.0, 30.0, (each, 1))
        shapes[3] = np.exp(rng.uniform(log(0.15), log(6.0), (each, f)))
        shares = rng.dirichlet(np.ones(f), KINDS * each)
        sharpness = np.exp(log(prior.sharpness) + prior.spread * rng.standard_normal(KINDS * each))
        zeros, ones = np.zeros(KINDS * each), np.ones(KINDS * each)
        kinds = np.repeat(np.arange(KINDS), each)
        drawn = cls(kinds, shares, wanted.reshape(-1, f), shapes.reshape(-1, f), zeros, ones, sharpness)
        raw = drawn.losses(rows)
        least, span = raw.min(axis=1), np.maximum(np.ptp(raw, axis=1), 1e-9)
        return replace(drawn, least=least, span=span), (raw - least[:, None]) / span[:, None]

    def subset(self, kept: BoolArray) -> Tastes:
        """Return the people at which ``kept`` (N,) is True."""
        return Tastes(*(getattr(self, one.name)[kept] for one in fields(self)))

    def losses(self, points: FloatArray) -> FloatArray:
        """Return the losses (N, n) of points with scaled costs (n, f): from 0 at the best row to 1 at the worst."""
        found = np.zeros((len(self.shares), len(points)))
        for kind in range(KINDS):
            these = np.flatnonzero(self.kinds == kind)
            total = np.zeros((len(these), len(points)))
            for column, share, wanted, shape in zip(
                points.T, self.shares[these].T, self.wanted[these].T, self.shapes[these].T, strict=True
            ):
                felt = _felt(kind, column, wanted[:, None], shape[:, None]) * share[:, None]
                total = np.maximum(total, felt) if kind == KINDS - 1 else total + felt
            found[these] = total
        return (found - self.least[:, None]) / self.span[:, None]

    def log_probability(self, chosen: FloatArray, other: FloatArray) -> FloatArray:
        """Return the logarithm of the probability (N,) of choices: points (n, f) that were chosen, and the others."""
        from scipy.special import expit  # slow to import

        gains = self.sharpness[:, None] * (self.losses(other) - self.losses(chosen))
        return np.asarray(np.log(LAPSE / 2 + (1.0 - LAPSE) * expit(gains)).sum(axis=1))


def _felt(kind: int, costs: FloatArray, wanted: FloatArray, shape: FloatArray) -> FloatArray:
    """Return what people (n, 1) of a kind feel of a cost (m,), before its weight."""
    from scipy.special import expit  # slow to import

    match kind:
        case 0:
            return np.maximum(costs - wanted, 0.0)
        case 1:
            return np.asarray(np.abs(costs - wanted) ** shape)
        case 2:
            return np.asarray(expit(shape * (costs - wanted)))
        case _:
            return np.asarray(np.maximum(costs, 0.0) ** shape)


def some_rows(count: int, kept: int, rng: np.random.Generator) -> IntArray:
    """Return the numbers of at most :data:`MOST_ROWS` of ``count`` rows, in order, always with the row ``kept``."""
    if count <= MOST_ROWS:
        return np.arange(count)
    others = np.delete(np.arange(count), kept)
    return np.sort(np.append(rng.choice(others, MOST_ROWS - 1, replace=False), kept))
