"""What a column of scores is like: its median and quartiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.study.statistics.related import checked


@dataclass(frozen=True)
class Described:
    """Scores in five numbers.

    people    who gave one
    missing   who did not
    median    NaN where nobody gave one, as are the quartiles
    lower     first quartile, by linear interpolation (type 7 of Hyndman and Fan 1996, as R and NumPy have it)
    upper     third quartile
    least     the least score
    greatest  the greatest
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
    """Median and quartiles of scores (n,), NaN where one is missing.

    >>> describe([1.0, 2.0, 4.0, float("nan")])
    Described(people=3, missing=1, median=2.0, lower=1.5, upper=3.0, least=1.0, greatest=4.0)
    """
    scores = checked(values, 1)
    given = scores[~np.isnan(scores)]
    five = np.percentile(given, [50, 25, 75, 0, 100]).tolist() if len(given) else [np.nan] * 5
    return Described(len(given), len(scores) - len(given), *five)
