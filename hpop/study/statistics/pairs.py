"""Comparison of two scores of the same people: Wilcoxon's signed-rank test, effect sizes, and their shift."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import one_of
from hpop.errors import StudyError
from hpop.study.statistics.scores import checked

Zeros = Literal["pratt", "wilcox"]
STEP = 1e-9
"""Step to which scores are rounded, so that differences by mere rounding errors are ties."""
MOST_EXACT = 200
"""Largest number of people for which p is exact; with more, the normal approximation is as good."""


@dataclass(frozen=True)
class Pair:
    """Comparison of two scores of the same people. Effects are positive if the second score is greater.

    people    number of people with both scores
    zeros     number of people with two equal scores
    rank_sum  of the differences above zero, ranked by size
    z         normal approximation, with ties, without continuity correction: above 0 where the second is greater
    p         two-sided
    exact     whether p enumerates all signs; else it is from z
    biserial  matched-pairs rank-biserial correlation: share of the rank sum above zero less that below, -1 to 1
    r         |z| / sqrt(people), as the paper and many others report it
    shift     Hodges and Lehmann's estimate: the median of all means of two differences
    low       lower end of the interval of shifts that this test accepts; -inf if there are too few people,
              NaN if the test rejects every shift, as may happen if most differences are equal
    high      upper end
    level     confidence level of the interval, which contains 0 if p is above 1 - level
    """

    people: int
    zeros: int
    rank_sum: float
    z: float
    p: float
    exact: bool
    biserial: float
    r: float
    shift: float
    low: float
    high: float
    level: float


@checked_arguments
def wilcoxon(first: Any, second: Any, *, zeros: Zeros = "pratt", exact: bool = True, level: float = 0.95) -> Pair:
    """Compare two scores (n,) of the same people by Wilcoxon's signed-rank test; a person with a NaN is left out.

    Differences of zero are ranked and then left out (``pratt``: Pratt 1959, Journal of the American Statistical
    Association 54, 655-667), or left out before ranking (``wilcox``, as in SPSS). z is the sum of the signed ranks
    divided by the root of the sum of their squares, which is the usual formula with its correction for ties. With
    ``exact``, p for up to 200 people is computed from all assignments of signs to these ranks, with ties and zeros.

    Effect size: Kerby 2014, Comprehensive Psychology 3. Shift and interval: Hodges and Lehmann 1963, Annals of
    Mathematical Statistics 34, 598-611. The interval inverts this very test, ties and zeros included (Bauer 1972,
    Journal of the American Statistical Association 67, 687-690): a shift is in it if and only if the test accepts the
    differences minus that shift. An end that the test itself rejects, such as 0 among SSQ scores, is moved 1e-9 inside,
    the step to which scores are rounded. With ``wilcox`` the accepted shifts may have gaps, because the people without
    a zero change with the shift; the interval spans the gaps.

    Raises StudyError for scores of different lengths, or without people.

    >>> pair = wilcoxon([1, 2, 3, 4, 5, 6], [2, 4, 6, 8, 10, 12])
    >>> pair.rank_sum, pair.p, pair.biserial, pair.shift
    (21.0, 0.03125, 1.0, 3.5)
    """
    one_of("zeros", zeros, ("pratt", "wilcox"), error=StudyError)
    before, after = checked(first, 1), checked(second, 1)
    if before.shape != after.shape:
        raise StudyError(f"expected two scores of each person, got {len(before)} and {len(after)}")
    differences = after - before
    differences = np.round(differences[~np.isnan(differences)], 9)  # 3 * 3.74 - 3.74 and 2 * 3.74 are equal
    if not len(differences):
        raise StudyError("expected people who gave both scores, got none")
    ranks = signed_ranks(differences, zeros)
    above, below = float(ranks[ranks > 0].sum()), float(-ranks[ranks < 0].sum())
    z = (above - below) / size if (size := float(np.sqrt((ranks**2).sum()))) else 0.0
    counted = exact and len(differences) <= MOST_EXACT
    low, high = _interval(differences, zeros, counted, level)
    return Pair(
        people=len(differences),
        zeros=int((differences == 0).sum()),
        rank_sum=above,
        z=z,
        p=min(1.0, 2 * min(_tails(ranks, counted))),
        exact=counted,
        biserial=(above - below) / (above + below) if above + below else 0.0,
        r=abs(z) / np.sqrt(len(differences)),
        shift=float(np.median(_walsh_averages(differences))),
        low=low,
        high=high,
        level=level,
    )


def signed_ranks(differences: FloatArray, zeros: Zeros = "pratt") -> FloatArray:
    """Return the ranks of the absolute differences, without zeros, each with the sign of its difference.

    With "pratt", zeros are ranked too, and their ranks then left out, so the other ranks are larger. Otherwise zeros
    are left out before ranking.
    """
    kept = differences if zeros == "pratt" else differences[differences != 0]
    ranks = np.asarray(stats.rankdata(np.abs(kept))) * np.sign(kept)
    signed: FloatArray = ranks[ranks != 0]
    return signed


def exact_p(ranks: FloatArray) -> float:
    """Return the exact two-sided p of signed ranks: the share of sign assignments with a sum at least as extreme."""
    return min(1.0, 2 * min(_tails(ranks, counted=True)))


def _tails(ranks: FloatArray, counted: bool) -> tuple[float, float]:
    """Return two one-sided p values: the probabilities of a sum of positive ranks at least, and at most, as large.

    If ``counted``, they are exact; otherwise they come from the normal approximation.
    """
    if not counted:
        size = float(np.sqrt((ranks**2).sum()))
        z = float(ranks.sum()) / size if size else 0.0
        return float(stats.norm.sf(z)), float(stats.norm.cdf(z))
    steps = np.rint(2 * np.abs(ranks)).astype(int)  # ranks of ties end in .5
    total, above = int(steps.sum()), int(steps[ranks > 0].sum())
    chance = rank_sum_chances(steps)
    return float(chance[: total - above + 1].sum()), float(chance[: above + 1].sum())  # the chances are symmetric


def rank_sum_chances(steps: Any) -> FloatArray:
    """Return the probabilities of the sums 0, 1, ..., sum(steps), if each step is added with probability one half."""
    chance = np.zeros(int(np.sum(steps)) + 1)
    chance[0] = 1.0
    reached = 0
    for step in map(int, steps):
        chance[step : reached + step + 1] += chance[: reached + 1].copy()
        reached += step
        chance[: reached + 1] /= 2
    return chance


def _walsh_averages(differences: FloatArray) -> FloatArray:
    """Return the means (n (n + 1) / 2,) of all pairs of differences, each paired with itself too."""
    i, j = np.triu_indices(len(differences))
    averages: FloatArray = (differences[i] + differences[j]) / 2
    return averages


def _interval(differences: FloatArray, zeros: Zeros, counted: bool, level: float) -> tuple[float, float]:
    """Return the ends of the interval of shifts that the test accepts.

    Signed ranks change only at Walsh averages (means of two differences), so one shift represents each gap between two
    averages. The upper tail probability rises with the shift, the lower one falls. ``counted`` as for `_tails`.
    """
    units = np.rint(differences / STEP) * 2  # whole, and so are the averages: ties are exact
    averages = np.unique(_walsh_averages(units))
    gaps = np.concatenate([averages[:1] - 1, (averages[1:] + averages[:-1]) / 2, averages[-1:] + 1])
    tail = (1 - level) / 2

    def tails(shift: float) -> tuple[float, float]:
        return _tails(signed_ranks(units - shift, zeros), counted)

    first = bisect_left(gaps, True, key=lambda shift: tails(shift)[0] > tail)
    after = bisect_left(gaps, True, key=lambda shift: tails(shift)[1] <= tail)
    low, high = -float("inf"), float("inf")
    if first > 0:
        end = float(averages[first - 1])
        low = end if tails(end)[0] > tail else end + 2
    if after < len(gaps):
        end = float(averages[after - 1])
        high = end if tails(end)[1] > tail else end - 2
    if zeros == "wilcox":  # a person with a difference equal to the shift does not count
        outside = [one for one in np.unique(units).tolist() if not low <= one <= high and min(tails(one)) > tail]
        low, high = min([low, *outside]), max([high, *outside])
    return (round(low * STEP / 2, 10), round(high * STEP / 2, 10)) if low <= high else (np.nan, np.nan)
