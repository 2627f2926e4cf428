"""Statistics of scores: medians and quartiles, tests of k scores, and correction of p values for several tests.

Scores of questionnaires are ordinal and skewed, with many zeros, so these tests use ranks only. Friedman's and
Cochran's tests are for scores of the same people. The tests of Kruskal and Wallis and of Dunn are for independent
scores. The paper (Becerra et al. 2020) used them on scores of the same people, which loses power, because each person's
general level acts as noise. They suit scores of different people, as at the first place of each session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np
from scipy import stats

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import one_of
from hpop.base.text import shown
from hpop.errors import StudyError

LEAST_STIMULI = 3
"""Least number of stimuli for a test of all; two are compared as a pair (:func:`hpop.study.statistics.wilcoxon`)."""


@dataclass(frozen=True)
class Related:
    """Result of a test of k scores of the same people.

    statistic  chi-square, with ``freedom`` degrees of freedom
    p          by the chi-square approximation
    agreement  Kendall's W: 0 if the people's rankings have nothing in common, 1 if all rankings are equal
    people     number of people with all k scores
    left_out   number of people with missing scores
    """

    statistic: float
    freedom: int
    p: float
    agreement: float
    people: int
    left_out: int


@checked_arguments
def friedman(values: Any) -> Related:
    """Test whether k stimuli differ, by Friedman's test with ties; also compute Kendall's W.

    ``values`` are scores (n people, k stimuli), NaN if missing. Stimuli are ranked within each person, so that the
    general level of a person's answers does not matter. Friedman 1937, Journal of the American Statistical Association
    32, 675-701. Raises StudyError for fewer than three stimuli or two people.
    """
    table = checked(values)
    complete = complete_rows(table)
    people, stimuli = int(complete.sum()), table.shape[1]
    if stimuli < LEAST_STIMULI:
        raise StudyError(f"Friedman's test compares three stimuli or more, got {stimuli}; compare two by Wilcoxon's")
    if people < 2:
        raise StudyError(f"Friedman's test needs the scores of two people or more for all stimuli, got {people}")
    kept = table[complete]
    if (kept == kept[:, :1]).all():  # all ranks are tied: nothing to divide by
        statistic, p = 0.0, 1.0
    else:
        statistic, p = map(float, stats.friedmanchisquare(*kept.T))
    agreement = statistic / (people * (stimuli - 1))
    return Related(statistic, stimuli - 1, p, agreement, people, len(table) - people)


@checked_arguments
def cochran(values: Any) -> Related:
    """Test whether k stimuli differ in yes-or-no answers (n people, k stimuli), given as 1 and 0, by Cochran's Q.

    It equals Friedman's test of these numbers. Cochran 1950, Biometrika 37, 256-266.

    >>> round(cochran([[1, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0]]).statistic, 3)
    4.8
    """
    table = checked(values)
    if not np.isin(table[~np.isnan(table)], (0, 1)).all():
        raise StudyError("values of Cochran's Q must be 1 (yes) and 0 (no), or NaN if missing")
    return friedman(table)


def friedman_statistics(values: FloatArray) -> FloatArray:
    """Return Friedman's statistic (s,) of each of many studies (s, n, k) at once; no score may be missing."""
    _, people, stimuli = values.shape
    ranks = stats.rankdata(values, axis=2)
    between = ((ranks.mean(axis=1) - (stimuli + 1) / 2) ** 2).sum(axis=1)  # (s,)
    within = ((ranks - (stimuli + 1) / 2) ** 2).sum(axis=(1, 2))  # n k (k^2 - 1) / 12 without ties
    statistics: FloatArray = people**2 * (stimuli - 1) * between / np.where(within > 0, within, 1.0)
    return statistics


def complete_rows(values: FloatArray) -> BoolArray:
    """Return a mask (n,) of the people who have all scores (n, k)."""
    return ~np.asarray(np.isnan(values).any(axis=1))


def checked(values: Any, dimensions: int = 2) -> FloatArray:
    """Return scores as an array, rounded to nine decimals; StudyError if they are infinite or have a wrong shape."""
    table = np.asarray(values, dtype=float)
    if table.ndim != dimensions or np.isinf(table).any():
        shape = "(people, stimuli)" if dimensions == 2 else "(people,)"
        raise StudyError(f"expected finite scores {shape}, NaN where one is missing, got shape {table.shape}")
    rounded: FloatArray = np.round(table, 9)  # sums that are equal but for rounding are ties
    return rounded


@dataclass(frozen=True)
class Described:
    """Summary of the scores of some people.

    people    number of people with a score
    missing   number of people without a score
    median    NaN without scores, as are the quartiles
    lower     first quartile, by linear interpolation (type 7 of Hyndman and Fan 1996, as in R and NumPy)
    upper     third quartile
    least     the least score
    greatest  the greatest score
    """

    people: int
    missing: int
    median: float
    lower: float
    upper: float
    least: float
    greatest: float


@checked_arguments
def describe(values: Any) -> Described:
    """Summarise scores (n,), NaN if missing, by median, quartiles and extremes.

    >>> describe([1.0, 2.0, 4.0, float("nan")])
    Described(people=3, missing=1, median=2.0, lower=1.5, upper=3.0, least=1.0, greatest=4.0)
    """
    scores = checked(values, 1)
    given = scores[~np.isnan(scores)]
    five = np.percentile(given, [50, 25, 75, 0, 100]).tolist() if len(given) else [np.nan] * 5
    return Described(len(given), len(scores) - len(given), *five)


@dataclass(frozen=True)
class Independent:
    """Result of Kruskal and Wallis' test of k groups of different people.

    statistic  H, corrected for ties, with ``freedom`` degrees of freedom
    p          by the chi-square approximation
    epsilon2   effect size H / (N - 1): 0 to 1
    eta2       effect size (H - k + 1) / (N - k), below 0 if H is less than expected by chance
    sizes      of the groups, without missing scores
    """

    statistic: float
    freedom: int
    p: float
    epsilon2: float
    eta2: float
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class Comparison:
    """Result of Dunn's comparison of two groups.

    first, second  numbers of the groups
    z              mean rank of the second less that of the first, divided by the standard error of this difference
    p              two-sided, for this comparison alone
    """

    first: int
    second: int
    z: float
    p: float


@checked_arguments
def kruskal(groups: Sequence[Any]) -> Independent:
    """Test whether groups of scores differ, by Kruskal and Wallis' test with ties; NaN means missing.

    Kruskal and Wallis 1952, Journal of the American Statistical Association 47, 583-621; effect sizes: Tomczak and
    Tomczak 2014, Trends in Sport Sciences 1(21), 19-25. Raises StudyError for fewer than two groups, an empty one, or
    as many groups as scores.
    """
    kept = _scores_by_group(groups)
    count, total = len(kept), sum(map(len, kept))
    same = np.ptp(np.concatenate(kept)) == 0  # nothing to divide by
    statistic, p = (0.0, 1.0) if same else map(float, stats.kruskal(*kept))
    return Independent(
        statistic=statistic,
        freedom=count - 1,
        p=p,
        epsilon2=statistic / (total - 1),
        eta2=(statistic - count + 1) / (total - count),
        sizes=tuple(map(len, kept)),
    )


@checked_arguments
def dunn(groups: Sequence[Any]) -> list[Comparison]:
    """Compare every two groups by their mean ranks among all scores (Dunn's test), with ties.

    z is positive if the second group has the larger mean rank. Dunn 1964, Technometrics 6, 241-252. Implemented here
    because libraries return p without z. For k groups of equal size Kruskal and Wallis' H is 2 / k times the sum of all
    z squared, and the z add up: z(1, 3) = z(1, 2) + z(2, 3). Raises StudyError as ``kruskal``.
    """
    kept = _scores_by_group(groups)
    values = np.concatenate(kept)
    total, (_, ties) = len(values), np.unique(values, return_counts=True)
    ranks = np.split(stats.rankdata(values), np.cumsum([len(group) for group in kept])[:-1])
    variance = (total * (total + 1) - (ties**3 - ties).sum() / (total - 1)) / 12
    found = []
    for first, second in combinations(range(len(kept)), 2):
        spread = np.sqrt(variance * (1 / len(kept[first]) + 1 / len(kept[second])))
        z = float((ranks[second].mean() - ranks[first].mean()) / spread) if spread else 0.0
        found.append(Comparison(first, second, z, float(2 * stats.norm.sf(abs(z)))))
    return found


def _scores_by_group(groups: Sequence[Any]) -> list[FloatArray]:
    """Return the scores of each group without missing ones; StudyError if there are too few."""
    kept = [(values := checked(group, 1))[~np.isnan(values)] for group in groups]
    if len(kept) < 2 or not all(map(len, kept)) or sum(map(len, kept)) <= len(kept):
        sizes = ", ".join(str(len(group)) for group in kept) or "none"
        raise StudyError(f"expected two groups or more with scores in each, several in one, got groups of {sizes}")
    return kept


Correction = Literal["holm", "bonferroni", "none"]
CORRECTIONS: tuple[Correction, ...] = ("holm", "bonferroni", "none")


@checked_arguments
def adjusted(p: Any, correction: str = "holm") -> FloatArray:
    """Adjust p values (m,) for multiple tests, in their order; NaN stays NaN and does not count.

    ``bonferroni`` multiplies each by m. ``holm`` (1979, Scandinavian Journal of Statistics 6, 65-70) multiplies the
    least by m, the next by m - 1, and so on, made monotone: it rejects at least what Bonferroni rejects. Results are at
    most 1. ``none`` changes nothing.

    >>> adjusted([0.01, 0.04, 0.03]).round(3).tolist(), adjusted([0.01, 0.04, 0.03], "bonferroni").round(3).tolist()
    ([0.03, 0.06, 0.06], [0.03, 0.12, 0.09])
    """
    one_of("correction", correction, CORRECTIONS, error=StudyError)
    values = np.array(p, dtype=float)
    if values.ndim != 1:
        raise StudyError(f"p must be a list of p values (m,), got {shown(p)}")
    known = np.flatnonzero(~np.isnan(values))
    rising = known[np.argsort(values[known], kind="stable")]
    count = len(rising)
    if correction == "bonferroni":
        values[rising] *= count
    elif correction == "holm":
        values[rising] = np.maximum.accumulate(values[rising] * np.arange(count, 0, -1))
    capped: FloatArray = np.minimum(values, 1.0)
    return capped
