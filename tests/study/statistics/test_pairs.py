"""Wilcoxon's signed-rank test: printed values, all signs by brute force, and what shifts it does not reject."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from hpop.errors import StudyError
from hpop.study.statistics import wilcoxon
from hpop.study.statistics.pairs import exact_p, signed_ranks
from tests.study.statistics.printed import DEPRESSION

differences = st.lists(st.integers(-4, 4), min_size=1, max_size=9).map(lambda values: np.array(values, dtype=float))


def pair_of(values, **options):
    return wilcoxon(np.zeros(len(values)), values, **options)


def test_wilcoxons_of_the_depression_scale():
    """R's wilcox.test: V = 40, one-sided p-value = 0.01953."""
    before, after = DEPRESSION
    pair = wilcoxon(after, before)
    assert pair.rank_sum == 40
    assert pair.exact
    assert round(pair.p / 2, 5) == 0.01953


def test_the_shift_and_interval_of_hollander_and_wolfe():
    """Their examples 3.3 and 3.4: estimate -.46, and (-.786, -.010) with confidence 96.1 %."""
    before, after = DEPRESSION
    pair = wilcoxon(before, after)
    assert (round(pair.shift, 3), round(pair.low, 3), round(pair.high, 3)) == (-0.46, -0.786, -0.01)


def test_what_the_paper_prints_against_the_baseline():
    """Becerra et al. 2020: Z = -.501, -1.931, -3.328 and p = .616, .054, .001 of 36 people."""
    z = np.array([-0.501, -1.931, -3.328])
    assert (2 * stats.norm.sf(-z)).round(4).tolist() == [0.6164, 0.0535, 0.0009]
    assert (-z / np.sqrt(36)).round(2).tolist() == [0.08, 0.32, 0.55]


@given(differences, st.sampled_from(["pratt", "wilcox"]))
def test_the_exact_p_counts_all_signs(values, zeros):
    ranks = signed_ranks(values, zeros)
    sums = [np.dot(signs, np.abs(ranks)) for signs in product([-1, 1], repeat=len(ranks))]
    expected = np.mean([abs(one) >= abs(ranks.sum()) - 1e-9 for one in sums])
    assert pair_of(values, zeros=zeros).p == pytest.approx(expected)


@given(differences, st.sampled_from(["pratt", "wilcox"]))
def test_z_is_that_of_scipy(values, zeros):
    if values.any():
        other = stats.wilcoxon(values, zero_method=zeros, alternative="greater", method="asymptotic")
        assert pair_of(values, zeros=zeros).z == pytest.approx(other.zstatistic, abs=1e-9)
        assert pair_of(values, zeros=zeros, exact=False).p == pytest.approx(2 * min(other.pvalue, 1 - other.pvalue))


@given(st.permutations(range(1, 9)), st.lists(st.booleans(), min_size=8, max_size=8))
def test_without_ties_the_exact_p_is_that_of_scipy(sizes, signs):
    values = np.where(signs, sizes, np.negative(sizes)).astype(float)
    assert pair_of(values).p == pytest.approx(stats.wilcoxon(values, method="exact").pvalue)


@given(differences)
def test_exchanging_the_two_turns_signs_only(values):
    forth, back = pair_of(values), wilcoxon(values, np.zeros(len(values)))
    assert (forth.p, forth.r) == pytest.approx((back.p, back.r))
    assert (forth.z, forth.biserial, forth.shift) == pytest.approx((-back.z, -back.biserial, -back.shift))
    assert (forth.low, forth.high) == pytest.approx((-back.high, -back.low))


def rejected(values, shift, zeros, exact, level):
    """Return True if the test of the differences less a shift rejects."""
    ranks = signed_ranks(values - shift, zeros)
    z = ranks.sum() / np.sqrt((ranks**2).sum() or 1)
    return (exact_p(ranks) if exact else 2 * stats.norm.sf(abs(z))) <= 1 - level + 1e-12


@pytest.mark.parametrize("exact", [True, False])
@given(st.lists(st.integers(-3, 4), min_size=1, max_size=10), st.sampled_from([0.95, 0.8]))
def test_with_ties_and_zeros_the_interval_holds_the_shifts_that_the_test_does_not_reject(exact, values, level):
    differences = np.array(values, dtype=float)
    pair = pair_of(differences, exact=exact, level=level)
    for shift in np.arange(-4, 5.1, 0.25):  # every mean of two differences, and between them
        assert (pair.low <= shift <= pair.high) != rejected(differences, shift, "pratt", exact, level)


@given(st.lists(st.integers(-3, 4), min_size=1, max_size=10))
def test_without_those_of_no_difference_the_interval_spans_the_shifts_that_the_test_does_not_reject(values):
    differences = np.array(values, dtype=float)
    pair = pair_of(differences, zeros="wilcox")
    shifts = np.arange(-4, 5.1, 0.25)
    kept = shifts[[not rejected(differences, shift, "wilcox", True, 0.95) for shift in shifts]]
    inside = shifts[(pair.low <= shifts) & (shifts <= pair.high)]
    assert (inside[0], inside[-1]) == (kept[0], kept[-1])


@pytest.mark.parametrize("options", [{}, {"zeros": "wilcox", "exact": False}])
def test_p_and_interval_of_simulator_sickness_scores_agree(options):
    """Totals are multiples of 3.74: many are equal, and many do not change."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        people = int(rng.integers(8, 37))
        first = np.round(rng.exponential(6, people) / 3.74) * 3.74
        second = np.maximum(0, first * rng.integers(0, 2, people) + rng.exponential(5, people))
        pair = wilcoxon(first, np.round(second / 3.74) * 3.74, **options)
        assert (pair.low <= 0 <= pair.high) == (pair.p > 0.05)


def test_an_end_that_the_test_rejects_is_told_further_in():
    """At 0 the rank sum below it is 2.5, and 3 of 128 signs have no greater one; above 0 it is 4, and 7 of 256 have."""
    pair = pair_of(np.array([-1.0, 0, 1, 2, 3, 3, 3, 3]))
    assert pair.p == 6 / 128
    assert pair.low == 1e-9  # 14 / 256 is above .05


def test_an_interval_may_be_empty():
    """Thirty who feel no difference and six who do: 2 / 64 for no shift, and signs of thirty against any other one."""
    pair = pair_of(np.concatenate([np.zeros(30), np.arange(1.0, 7)]))
    assert pair.p == 2 / 64
    assert np.isnan([pair.low, pair.high]).all()


@given(st.permutations(range(8)), st.lists(st.booleans(), min_size=8, max_size=8))
def test_the_interval_holds_the_shifts_that_the_test_does_not_reject(powers, signs):
    """Differences of which no two means are equal: the interval's ends are where the exact test begins to reject."""
    values = np.where(signs, 1.0, -1.0) * 3.0 ** np.array(powers)
    pair = pair_of(values)
    means = np.unique(np.add.outer(values, values) / 2)
    for shift in np.concatenate([means[:1] - 1, (means[1:] + means[:-1]) / 2, means[-1:] + 1]):
        assert (pair.low < shift < pair.high) == (exact_p(signed_ranks(values - shift)) > 0.05)


def test_too_few_people_have_no_interval():
    pair = pair_of(np.array([1.0, 2, 3, 4, 5]))  # the least p there is: 2 / 32
    assert (pair.low, pair.high) == (-np.inf, np.inf)
    assert pair.p == 0.0625


def test_people_without_a_difference_count_by_pratt_and_not_by_wilcoxon():
    values = np.array([-1.0, -5, 2, 3, 4, 6])
    more = np.concatenate([np.zeros(10), values])
    left_out = pair_of(more, zeros="wilcox")
    assert (left_out.people, left_out.zeros, left_out.rank_sum) == (16, 10, 15)
    assert (left_out.z, left_out.p) == pytest.approx((9 / np.sqrt(91), pair_of(values).p))
    ranked = pair_of(more)  # ranks 11 to 16
    assert ranked.rank_sum == 12 + 13 + 14 + 16
    assert ranked.z == pytest.approx((55 - 26) / np.sqrt(sum(rank**2 for rank in range(11, 17))))


def test_scores_that_are_equal_but_for_rounding_are_equal():
    assert pair_of(np.array([3 * 3.74 - 2 * 3.74 - 3.74, 1.0])).zeros == 1


def test_nobody_differs():
    pair = pair_of(np.zeros(8))
    assert (pair.z, pair.p, pair.biserial, pair.shift) == (0, 1, 0, 0)


def test_many_people_are_tested_by_the_normal_approximation():
    values = np.random.default_rng(1).normal(0.1, 1, 300)
    pair = pair_of(values)
    assert not pair.exact
    assert pair.p == pytest.approx(exact_p(signed_ranks(values)), rel=0.01)
    assert pair.low < pair.shift < pair.high


def test_who_gave_one_score_only_is_left_out():
    assert wilcoxon([1, 2, np.nan, 4], [2, 4, 6, np.nan]).people == 2


def test_scores_that_cannot_be_compared_are_refused():
    with pytest.raises(StudyError, match="expected two scores of each person, got 1 and 2"):
        wilcoxon([1], [1, 2])
    with pytest.raises(StudyError, match="people who gave both scores, got none"):
        wilcoxon([np.nan], [1])
    with pytest.raises(StudyError, match="zeros must be one of pratt, wilcox"):
        wilcoxon([1], [1], zeros="drop")
