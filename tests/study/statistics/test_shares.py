from __future__ import annotations

from collections import Counter
from itertools import product
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from hpop.errors import StudyError
from hpop.study.statistics import multinomial, share


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilsons_intervals_as_newcombe_prints_them(count, total, low, high):
    """Newcombe 1998, Statistics in Medicine 17, 857-872, table I, method 3."""
    one = share(count, total)
    assert (round(one.low, 4), round(one.high, 4)) == (low, high)


@given(st.integers(1, 30), st.data())
def test_the_chance_of_a_share_is_that_of_coins(total, data):
    count = data.draw(st.integers(0, total))
    coins = [comb(total, i) for i in range(total + 1)]
    assert share(count, total).p == pytest.approx(sum(c for c in coins if c <= coins[count]) / 2**total)


@given(st.lists(st.integers(0, 3), min_size=2, max_size=4).filter(lambda counts: 0 < sum(counts) < 7))
def test_the_multinomial_test_counts_all_that_people_may_choose(counts):
    people, k = sum(counts), len(counts)
    seen = Counter(tuple(sorted(Counter(one).items())) for one in product(range(k), repeat=people))
    this = seen[tuple((i, count) for i, count in enumerate(counts) if count)]
    expected = sum(times for times in seen.values() if times <= this) / k**people
    test = multinomial(counts)
    assert test.exact
    assert test.p == pytest.approx(expected)


def test_of_too_many_outcomes_the_chi_square_test_is_taken():
    counts = [30, 40, 50, 60, 70, 80]
    test = multinomial(counts)
    assert not test.exact
    assert test.p == pytest.approx(float(stats.chisquare(counts).pvalue))


@pytest.mark.parametrize(("count", "total"), [(3, 2), (-1, 2), (0, 0)])
def test_shares_of_nothing_and_more_than_all_are_refused(count, total):
    with pytest.raises(StudyError, match="must be a whole number"):
        share(count, total)


def test_choices_of_nobody_are_refused():
    with pytest.raises(StudyError, match="expected choices among two stimuli or more, got 0 among 3"):
        multinomial([0, 0, 0])
