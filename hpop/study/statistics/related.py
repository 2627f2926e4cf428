"""Tests of k scores of the same people: whether any stimulus differs from the others.

Scores of questionnaires are ordinal and skewed, with many zeros: these tests ask for ranks only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.errors import StudyError

LEAST_STIMULI = 3
"""Of two, the pair is compared at once (:func:`hpop.study.statistics.wilcoxon`)."""


@dataclass(frozen=True)
class Related:
    """A test of k scores of the same people.

    statistic  chi-square, with ``freedom`` degrees of freedom
    p          by the chi-square approximation
    agreement  Kendall's W: 0 where the people's rankings have nothing in common, 1 where all rank alike
    people     who gave all k scores; the others are left out
    left_out   how many those are
    """

    statistic: float
    freedom: int
    p: float
    agreement: float
    people: int
    left_out: int


@checked_arguments
def friedman(values: Any) -> Related:
    """Friedman's test with ties, and Kendall's W, of scores (n people, k stimuli), NaN where there is none.

    Each person ranks the stimuli by his own scores, so that how high somebody answers in general does not matter.
    Friedman 1937, Journal of the American Statistical Association 32, 675-701. Raises StudyError for fewer than three
    stimuli or two people.
    """
    table = checked(values)
    complete = complete_rows(table)
    people, stimuli = int(complete.sum()), table.shape[1]
    if stimuli < LEAST_STIMULI:
        raise StudyError(f"Friedman's test compares three stimuli or more, got {stimuli}; compare two by Wilcoxon's")
    if people < 2:
        raise StudyError(f"Friedman's test needs the scores of two people or more for all stimuli, got {people}")
    kept = table[complete]
    if (kept == kept[:, :1]).all():  # nobody tells any two apart: nothing to divide by
        statistic, p = 0.0, 1.0
    else:
        statistic, p = map(float, stats.friedmanchisquare(*kept.T))
    agreement = statistic / (people * (stimuli - 1))
    return Related(statistic, stimuli - 1, p, agreement, people, len(table) - people)


@checked_arguments
def cochran(values: Any) -> Related:
    """Cochran's Q of yes or no (n people, k stimuli) as 1 and 0: Friedman's test on them, to which it is equal.

    Cochran 1950, Biometrika 37, 256-266.

    >>> round(cochran([[1, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0]]).statistic, 3)
    4.8
    """
    table = checked(values)
    if not np.isin(table[~np.isnan(table)], (0, 1)).all():
        raise StudyError("Cochran's Q compares answers of yes and no, written as 1 and 0")
    return friedman(table)


def friedman_statistics(values: FloatArray) -> FloatArray:
    """Friedman's statistics (s,) of many studies at once (s, n, k), none of whose scores lacks."""
    _, people, stimuli = values.shape
    ranks = stats.rankdata(values, axis=2)
    between = ((ranks.mean(axis=1) - (stimuli + 1) / 2) ** 2).sum(axis=1)  # (s,)
    within = ((ranks - (stimuli + 1) / 2) ** 2).sum(axis=(1, 2))  # n k (k^2 - 1) / 12 without ties
    statistics: FloatArray = people**2 * (stimuli - 1) * between / np.where(within > 0, within, 1.0)
    return statistics


def complete_rows(values: FloatArray) -> BoolArray:
    """Which people (n,) gave all scores (n, k)."""
    return ~np.asarray(np.isnan(values).any(axis=1))


def checked(values: Any, dimensions: int = 2) -> FloatArray:
    """Scores as an array; StudyError where they are none or infinite."""
    table = np.asarray(values, dtype=float)
    if table.ndim != dimensions or np.isinf(table).any():
        shape = "(people, stimuli)" if dimensions == 2 else "(people,)"
        raise StudyError(f"expected finite scores {shape}, NaN where one is missing, got shape {table.shape}")
    rounded: FloatArray = np.round(table, 9)  # sums that are equal but for rounding are ties
    return rounded
