"""How a person who weighs costs answers: which of two trajectories is preferred, with what probability.

A trajectory costs ``w . z``, with z the costs as shares of the front's range and weights w >= 0: all costs are
minimised, so what costs more of everything is never preferred for it. Of two the cheaper one is chosen as a
Bradley-Terry model says, and now and then, by a lapse of attention, just any::

    P(a over b) = lapse / 2 + (1 - lapse) logistic(w . (z_b - z_a)),    w = sharpness x shares,   shares add up to 1

Where a person may also say that there is no difference, ties are Davidson's (1970, "On extending the Bradley-Terry
model to accommodate ties in paired comparison experiments"), with the symmetric form ``nu`` of their weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray

LAPSE = 0.02
"""Share of answers that say nothing."""
BLOCK = 2**14
"""Probabilities that are worked out at once: they stay in the processor's cache, which is three times as fast."""
MOST_GAIN = 700.0
"""Beyond which an answer is as improbable as a lapse: exponentials of more would overflow."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What was answered, as the model needs it: the order in which two were shown is in none of it.

    gains    (n, f)  what the one that was not chosen costs more, each cost as a share of its range; of a tie either way
    tied     (n,)    whether there was no difference
    offered  (n,)    whether that could be said
    weight   (n,)    as how many answers each counts
    """

    gains: FloatArray
    tied: BoolArray
    offered: BoolArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.gains)

    def log_probability(self, weights: FloatArray, ties: FloatArray) -> FloatArray:
        """Logarithm (N,) of the probability of all answers, for weights (N, f) and ties (N,)."""
        logs = np.empty(len(weights))
        size = max(1, BLOCK // max(1, len(self)))
        for begin in range(0, len(weights), size):
            part = slice(begin, begin + size)
            gains = weights[part] @ self.gains.T  # (draws, n)
            logs[part] = log_answers(gains, self.tied, self.offered, ties[part, None]) @ self.weight
        return logs

    def __getitem__(self, which: slice) -> Evidence:
        return Evidence(self.gains[which], self.tied[which], self.offered[which], self.weight[which])


def log_answers(gain: FloatArray, tied: BoolArray, offered: BoolArray, ties: FloatArray) -> FloatArray:
    """Logarithm of the probability of answers, arrays that broadcast.

    gain     what the one that was not chosen costs more, w . (z_other - z_chosen)
    tied     whether the answer was that there is no difference
    offered  whether that could be answered
    ties     Davidson's nu
    """
    gain = np.where(tied, np.abs(gain), np.maximum(gain, -MOST_GAIN))  # of ties the order changes not even a digit
    half = np.exp(-0.5 * gain)  # root of the odds against what was chosen
    nu = np.where(offered, ties, 0.0)
    share = np.where(tied, nu * half, 1.0) / (1.0 + half * (half + nu))
    lapse = np.where(offered, LAPSE / 3, LAPSE / 2)
    return np.asarray(np.log(lapse + (1.0 - LAPSE) * share))


def probabilities(gain: FloatArray, ties: FloatArray | None) -> tuple[FloatArray, ...]:
    """Probabilities that the first, the second, and, where that may be said, neither of two is chosen.

    gain  what the second costs more than the first
    ties  Davidson's nu, None where there is no such answer
    """
    size = np.exp(-np.abs(gain))
    nu = 0.0 if ties is None else ties * np.sqrt(size)
    total = 1.0 + size + nu
    ahead = (1.0 - LAPSE) / total
    behind = ahead * size
    lapse = LAPSE / 2 if ties is None else LAPSE / 3
    first = lapse + np.where(gain < 0, behind, ahead)
    second = lapse + np.where(gain < 0, ahead, behind)
    return (first, second) if ties is None else (first, second, lapse + nu * ahead)
