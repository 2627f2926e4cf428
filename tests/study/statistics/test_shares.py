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


@pytest.mark.parametrize(("count", "total"), [(81, 263), (15, 148), (1, 29), (28, 29)])
def test_at_the_ends_of_an_interval_one_in_forty_has_as_many_or_as_few(count, total):
    """Clopper and Pearson 1934: 2.5 % on each side, by the binomial distribution."""
    one = share(count, total)
    chances = [
        [comb(total, i) * end**i * (1 - end) ** (total - i) for i in range(total + 1)] for end in (one.low, one.high)
    ]
    assert sum(chances[0][count:]) == pytest.approx(0.025)
    assert sum(chances[1][: count + 1]) == pytest.approx(0.025)


def test_of_nobody_and_of_all_one_end_is_known():
    nobody, everybody = share(0, 20), share(20, 20)
    assert (nobody.low, everybody.high) == (0, 1)
    assert nobody.high == pytest.approx(1 - 0.025 ** (1 / 20))
    assert everybody.low == pytest.approx(0.025 ** (1 / 20))


@given(st.integers(1, 30), st.data())
def test_the_chance_of_a_share_is_that_of_coins(total, data):
    count = data.draw(st.integers(0, total))
    coins = [comb(total, i) for i in range(total + 1)]
    assert share(count, total).p == pytest.approx(sum(c for c in coins if c <= coins[count]) / 2**total)


@given(st.integers(1, 200), st.sampled_from([0.8, 0.95, 0.99]), st.data())
def test_the_interval_holds_one_half_where_the_test_does_not_reject_it(total, level, data):
    one = share(data.draw(st.integers(0, total)), total, level)
    assert (one.low <= 0.5 <= one.high) == (one.p > 1 - level)


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
