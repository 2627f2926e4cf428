"""Counts of choices: shares with intervals, and whether all stimuli are chosen alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy import special, stats

from hpop.base.arguments import checked_arguments
from hpop.base.options import whole
from hpop.errors import StudyError

MOST_OUTCOMES = 200_000
"""Of a multinomial test that are counted out."""
MOST_PEOPLE = 1_000_000


@dataclass(frozen=True)
class Share:
    """So many of all.

    share  count / total
    low    lower end of the interval of shares that the exact test does not reject
    high   upper end
    p      two-sided, exact, that the share is one half: below 1 - level where the interval does not hold it
    """

    count: int
    total: int
    share: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class Multinomial:
    """Whether people choose one of k alike.

    p      chance of counts that are as unlikely as these, or more, where all k are chosen alike
    exact  whether all counts were gone through; else p is of the chi-square test
    """

    p: float
    exact: bool


@checked_arguments
def share(count: int, total: int, level: float = 0.95) -> Share:
    """Return a share with the interval of Clopper and Pearson (1934, Biometrika 26, 404-413).

    It inverts the exact binomial test that gives p. Wilson's interval does not: of 5 out of 5 it leaves out one half,
    which that test does not reject (p = .0625).

    >>> one = share(15, 148)
    >>> round(one.low, 4), round(one.high, 4)
    (0.0578, 0.1617)
    """
    total = whole("total", total, 1, MOST_PEOPLE, error=StudyError)
    count = whole("count", count, 0, total, error=StudyError)
    test = stats.binomtest(count, total)
    interval = test.proportion_ci(level, method="exact")
    return Share(count, total, count / total, float(interval.low), float(interval.high), float(test.pvalue))


@checked_arguments
def multinomial(counts: Sequence[int]) -> Multinomial:
    """Test whether all of k stimuli are chosen alike, by how many people chose each as the one.

    Exact where there are at most 200,000 outcomes (36 people and three stimuli have 703), else by chi-square.
    Raises StudyError for fewer than two stimuli, or nobody.

    >>> round(multinomial([5, 1, 0]).p, 4)
    0.0535
    """
    seen = np.array([whole("count", count, 0, MOST_PEOPLE, error=StudyError) for count in counts])
    people, stimuli = int(seen.sum()), len(seen)
    if stimuli < 2 or people < 1:
        raise StudyError(f"expected choices among two stimuli or more, got {people} among {stimuli}")
    if comb(people + stimuli - 1, stimuli - 1) > MOST_OUTCOMES:
        return Multinomial(float(stats.chisquare(seen).pvalue), exact=False)
    bars = np.array(list(combinations(range(people + stimuli - 1), stimuli - 1)))  # between the people of each
    ends = np.full((len(bars), 1), people + stimuli - 1)
    outcomes = np.diff(np.hstack([np.full_like(ends, -1), bars, ends]), axis=1) - 1  # (outcomes, k)
    weights = -special.gammaln(outcomes + 1).sum(axis=1)
    least = -special.gammaln(seen + 1).sum()
    chances = np.exp(weights + special.gammaln(people + 1) - people * np.log(stimuli))
    return Multinomial(min(1.0, float(chances[weights <= least + 1e-9].sum())), exact=True)
