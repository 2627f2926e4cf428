"""Tests of scores as if each were another person's: Kruskal and Wallis, and Dunn's comparisons after it.

On scores of the same people they are what the paper took (Becerra et al. 2020) and lose power: how high each person
answers in general stays in as noise, which :func:`hpop.study.statistics.friedman` takes out. They fit where people do
differ, as at the first place of each, or where groups are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.errors import StudyError
from hpop.study.statistics.related import checked


@dataclass(frozen=True)
class Independent:
    """Kruskal and Wallis' test of k groups.

    statistic  H, corrected for ties, with ``freedom`` degrees of freedom
    p          by the chi-square approximation
    epsilon2   effect size H / (N - 1): 0 to 1
    eta2       effect size (H - k + 1) / (N - k), below 0 where H is less than by chance
    sizes      of the groups, without who gave no score
    """

    statistic: float
    freedom: int
    p: float
    epsilon2: float
    eta2: float
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class Comparison:
    """Dunn's comparison of two groups.

    first, second  their numbers
    z              mean rank of the second less that of the first, by its standard deviation
    p              two-sided, for this comparison alone
    """

    first: int
    second: int
    z: float
    p: float


@checked_arguments
def kruskal(groups: Sequence[Any]) -> Independent:
    """Kruskal and Wallis' test of scores by group, NaN where there is none, with ties.

    Kruskal and Wallis 1952, Journal of the American Statistical Association 47, 583-621; effect sizes: Tomczak and
    Tomczak 2014, Trends in Sport Sciences 1(21), 19-25. Raises StudyError for fewer than two groups, an empty one, or
    as many groups as scores.
    """
    kept = _kept(groups)
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
    """Dunn's comparisons of every two groups by their mean ranks among all, with ties.

    Dunn 1964, Technometrics 6, 241-252. Own code: the libraries give p and no z. For groups of equal size H is 2 / k
    times the sum of all z squared, and the z add up: z(1, 3) = z(1, 2) + z(2, 3). Raises StudyError as ``kruskal``.
    """
    kept = _kept(groups)
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


def _kept(groups: Sequence[Any]) -> list[FloatArray]:
    """Scores by group, without missing ones."""
    kept = [(values := checked(group, 1))[~np.isnan(values)] for group in groups]
    if len(kept) < 2 or not all(map(len, kept)) or sum(map(len, kept)) <= len(kept):
        sizes = ", ".join(str(len(group)) for group in kept) or "none"
        raise StudyError(f"expected two groups or more with scores in each, several in one, got groups of {sizes}")
    return kept
