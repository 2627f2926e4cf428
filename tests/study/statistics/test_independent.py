"""Kruskal and Wallis, and Dunn: against printed values, and by the identities that tie them together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from hpop.errors import StudyError
from hpop.study.statistics import adjusted, dunn, kruskal
from tests.study.statistics.printed import MUCOCILIARY, PULSE

equal_groups = st.integers(2, 5).flatmap(
    lambda count: st.integers(2, 6).flatmap(
        lambda size: st.lists(st.lists(st.integers(0, 5), min_size=size, max_size=size), min_size=count, max_size=count)
    )
)


def test_kruskal_and_wallis_of_hollander_and_wolfe():
    test = kruskal(MUCOCILIARY)
    assert (round(test.statistic, 4), test.freedom, round(test.p, 4)) == (0.7714, 2, 0.68)
    assert test.sizes == (5, 4, 5)


def test_dunns_z_of_hollander_and_wolfe():
    """R's dunn.test prints z, and one-sided p: .2606, .4103, .1962."""
    found = dunn(MUCOCILIARY)
    assert [(one.first, one.second) for one in found] == [(0, 1), (0, 2), (1, 2)]
    assert [round(one.z, 6) for one in found] == [0.641427, -0.226779, -0.855236]
    assert [round(one.p, 4) for one in found] == [0.5212, 0.8206, 0.3924]
    assert [round(one.p / 2, 4) for one in found] == [0.2606, 0.4103, 0.1962]


def test_dunn_with_ties_of_the_exercise_data():
    """The tests of scikit-posthocs hold these, by Holm: .0439 rest - walking, 9.57e-9 rest - running, 1.87e-4."""
    found = dunn(list(PULSE.values()))
    p = adjusted([one.p for one in found])
    assert p == pytest.approx([9.570998e-09, 4.390066e-02, 1.873208e-04], rel=1e-6)


def test_what_the_paper_prints_of_its_three_groups_of_36_belongs_together():
    """Becerra et al. 2020: chi2(2) = 9.035, p .011, Dunn by Bonferroni .008, .566, .277."""
    statistic, people, groups = 9.035, 108, 3
    assert round(float(stats.chi2.sf(statistic, 2)), 4) == 0.0109
    assert round(statistic / (people - 1), 3) == 0.084
    assert round((statistic - groups + 1) / (people - groups), 3) == 0.067
    z = stats.norm.isf(np.array([0.008, 0.566, 0.277]) / 3 / 2)
    assert z.round(3).tolist() == [3.004, 1.315, 1.683]
    assert abs(z[1] + z[2] - z[0]) < 0.01
    low, high = (
        2 / 3 * (stats.norm.isf(np.array([a, b, c]) / 6) ** 2).sum()
        for a, b, c in ((0.0085, 0.5665, 0.2775), (0.0075, 0.5655, 0.2765))
    )
    assert low < statistic < high  # the printed p are rounded


@given(equal_groups)
def test_of_equal_groups_h_is_two_kths_of_the_sum_of_all_z_squared_and_z_add_up(groups):
    test, found = kruskal(groups), {(one.first, one.second): one.z for one in dunn(groups)}
    assert test.statistic == pytest.approx(2 / len(groups) * sum(z**2 for z in found.values()), abs=1e-9)
    for first, last in found:
        for between in range(first + 1, last):
            assert found[first, last] == pytest.approx(found[first, between] + found[between, last], abs=1e-9)


@given(st.lists(st.lists(st.integers(0, 5), min_size=1, max_size=6), min_size=2, max_size=4))
def test_dunn_of_two_groups_is_their_kruskal_and_wallis(groups):
    groups = groups[:2]
    assume(sum(map(len, groups)) > 2)
    (one,), test = dunn(groups), kruskal(groups)
    assert one.z**2 == pytest.approx(test.statistic, abs=1e-9)
    assert one.p == pytest.approx(test.p)


def test_missing_scores_are_left_out_and_equal_ones_differ_in_nothing():
    assert kruskal([[1.0, np.nan, 2.0], [3.0, 4.0]]) == kruskal([[1, 2], [3, 4]])
    test = kruskal([[1, 1], [1, 1]])
    assert (test.statistic, test.p, test.epsilon2) == (0, 1, 0)
    assert [one.p for one in dunn([[1, 1], [1, 1]])] == [1]


@pytest.mark.parametrize("groups", [[[1, 2]], [[1, 2], [np.nan]], [[1], [2]]])
def test_groups_that_cannot_be_compared_are_refused(groups):
    with pytest.raises(StudyError, match="expected two groups or more with scores in each"):
        kruskal(groups)
