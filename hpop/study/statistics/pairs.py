"""Two scores of the same people: Wilcoxon's signed-rank test, effect sizes, and by how much they differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from hpop.arrays import FloatArray
from hpop.errors import StudyError
from hpop.options import one_of
from hpop.study.statistics.related import checked

Zeros = Literal["pratt", "wilcox"]
MOST_EXACT = 200
"""People up to whom the exact distribution is counted out; beyond, the normal one is as good."""


@dataclass(frozen=True)
class Pair:
    """How much greater the second score of each person is than the first.

    people    who gave both
    zeros     of them, whose scores are equal
    rank_sum  of the differences above zero, ranked by size
    z         normal approximation, with ties, without continuity correction: above 0 where the second is greater
    p         two-sided
    exact     whether p counts all signs out; else it comes from z
    biserial  matched-pairs rank-biserial correlation: share of the rank sum above zero less that below, -1 to 1
    r         |z| / sqrt(people), as the paper and many others report it
    shift     Hodges and Lehmann's estimate: the median of all means of two differences
    low       lower end of its interval, -inf where the people are too few for one
    high      upper end
    level     which the interval has at least, where differences are not tied
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


def wilcoxon(first: Any, second: Any, *, zeros: Zeros = "pratt", exact: bool = True, level: float = 0.95) -> Pair:
    """Wilcoxon's signed-rank test of two scores (n,) of the same people; who gave one only, NaN, is left out.

    Differences of zero are ranked and then left out (``pratt``: Pratt 1959, Journal of the American Statistical
    Association 54, 655-667), or left out before (``wilcox``, as SPSS does), as if nobody had felt no difference. z is
    the sum of the signed ranks by the root of that of their squares: what a coin tossed for each sign gives, which is
    the usual formula with its correction for ties. ``exact`` counts out, for up to 200 people, how many of all signs
    that these very ranks may have are as far from even; ties and zeros are no hindrance.

    Effect size: Kerby 2014, Comprehensive Psychology 3. Shift and interval: Hodges and Lehmann 1963, Annals of
    Mathematical Statistics 34, 598-611; the interval holds the shifts that the test does not reject.

    Raises StudyError for scores of different lengths, or of nobody.

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
    shift, low, high = _shift(differences, level)
    return Pair(
        people=len(differences),
        zeros=int((differences == 0).sum()),
        rank_sum=above,
        z=z,
        p=exact_p(ranks) if counted else float(2 * stats.norm.sf(abs(z))),
        exact=counted,
        biserial=(above - below) / (above + below) if above + below else 0.0,
        r=abs(z) / np.sqrt(len(differences)),
        shift=shift,
        low=low,
        high=high,
        level=level,
    )


def signed_ranks(differences: FloatArray, zeros: Zeros = "pratt") -> FloatArray:
    """Ranks by size with the signs of the differences, those of zero left out."""
    kept = differences if zeros == "pratt" else differences[differences != 0]
    ranks = np.asarray(stats.rankdata(np.abs(kept))) * np.sign(kept)
    signed: FloatArray = ranks[ranks != 0]
    return signed


def exact_p(ranks: FloatArray) -> float:
    """Share of all signs of these ranks whose sum above zero is as far from the middle as this one, or farther."""
    steps = np.rint(2 * np.abs(ranks)).astype(int)  # ranks of ties end in .5
    total, above = int(steps.sum()), int(steps[ranks > 0].sum())
    chance = rank_sum_chances(steps)
    return min(1.0, 2 * float(chance[: min(above, total - above) + 1].sum()))


def rank_sum_chances(steps: Any) -> FloatArray:
    """Chances of the sums 0, 1, ..., sum(steps) where each step is taken or not, by tossing a coin."""
    chance = np.zeros(int(np.sum(steps)) + 1)
    chance[0] = 1.0
    reached = 0
    for step in map(int, steps):
        chance[step : reached + step + 1] += chance[: reached + 1].copy()
        reached += step
        chance[: reached + 1] /= 2
    return chance


def _shift(differences: FloatArray, level: float) -> tuple[float, float, float]:
    """The median of the means of two differences (Walsh averages), and the interval that the test leaves."""
    count = len(differences)
    i, j = np.triu_indices(count)
    averages = np.sort((differences[i] + differences[j]) / 2)
    tail = (1 - level) / 2
    if count <= MOST_EXACT:
        rejected = int(np.searchsorted(np.cumsum(rank_sum_chances(range(1, count + 1))), tail, side="right"))
    else:
        spread = np.sqrt(count * (count + 1) * (2 * count + 1) / 24)
        rejected = int(count * (count + 1) / 4 + stats.norm.ppf(tail) * spread)
    if rejected == 0:
        return float(np.median(averages)), -np.inf, np.inf
    return float(np.median(averages)), float(averages[rejected - 1]), float(averages[-rejected])
