"""Which two trajectories to ask about next: those whose answer is expected to tell most of the weights.

Bayesian active learning by disagreement (Houlsby et al. 2011, arXiv 1112.5745): an answer tells most where it is open,
and yet each person with certain weights would be sure of it. Pairs are drawn at random, and those among the present
favourites are looked at as well.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.preference.draws import Draws
from hpop.preference.model import BLOCK, probabilities

PAIRS = 400
"""Pairs that are drawn at random."""
FAVOURITES = 8
"""Rows that are most often the best, of which all pairs are looked at."""
NOTICEABLE = 0.05
"""What two shown together differ by in some cost at least, a share of its range."""


def most_telling(
    rows: FloatArray,
    draws: Draws,
    asked: Collection[tuple[int, int]],
    rng: np.random.Generator,
    *,
    ties: bool,
) -> tuple[int, int] | None:
    """The pair of rows to ask about, the first shown left; None where none is left that differs.

    Parameters
    ----------
    rows : (n, f) array
        Costs as shares of their ranges.
    draws
        Of the weights, of equal weight.
    asked
        Pairs that were asked already, in the order in which they were shown: none comes again so, and the other way
        round only where no new one is left.
    ties
        Whether "no difference" can be answered.
    """
    pairs = _candidates(rows, draws, rng)
    numbers = {a * len(rows) + b for a, b in asked}
    known, turned = (np.isin(pairs @ order, list(numbers)) for order in ([len(rows), 1], [1, len(rows)]))
    fresh = bool((~(known | turned)).any())
    other_way = np.where(known[:, None], pairs[:, ::-1], pairs)[~(known & turned)]
    pairs = pairs[~(known | turned)] if fresh else other_way
    if not len(pairs):
        return None
    gains = (rows[pairs[:, 1]] - rows[pairs[:, 0]]) @ draws.weights.T  # (pairs, draws)
    best = int(np.argmax(information(gains, draws.ties if ties else None)))
    a, b = pairs[best].tolist()
    return (b, a) if fresh and rng.random() < 0.5 else (a, b)


def information(gains: FloatArray, ties: FloatArray | None) -> FloatArray:
    """What an answer is expected to tell of the weights, in nats, for each pair: (pairs, draws) -> (pairs,)."""
    told = np.zeros(len(gains))
    size = max(1, BLOCK // gains.shape[1])
    for begin in range(0, len(gains), size):
        part = slice(begin, begin + size)
        for chances in probabilities(gains[part], ties):
            mean = chances.mean(axis=1)
            told[part] += np.einsum("pd,pd->p", chances, np.log(chances)) / chances.shape[1] - mean * np.log(mean)
    return told


def _candidates(rows: FloatArray, draws: Draws, rng: np.random.Generator) -> IntArray:
    """Pairs of rows (m, 2) that differ noticeably: of few rows all, else some at random and those of the favourites."""
    n = len(rows)
    if n * (n - 1) // 2 <= PAIRS:
        pairs = np.column_stack(np.triu_indices(n, 1))
    else:
        found, counts = np.unique((draws.shares @ rows.T).argmin(axis=1), return_counts=True)
        top = found[np.argsort(-counts, kind="stable")[:FAVOURITES]]
        favourites = top[np.column_stack(np.triu_indices(len(top), 1))]
        pairs = np.concatenate([favourites, rng.integers(n, size=(PAIRS, 2))])
    apart = np.abs(rows[pairs[:, 0]] - rows[pairs[:, 1]]).max(axis=1)
    return np.asarray(pairs[apart >= NOTICEABLE])
