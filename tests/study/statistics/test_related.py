"""Friedman and Cochran: against printed values."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from hpop.errors import StudyError
from hpop.study.statistics import cochran, friedman
from hpop.study.statistics.scores import friedman_statistics
from tests.study.statistics.printed import ROUNDING

tables = hnp.arrays(np.int64, st.tuples(st.integers(2, 6), st.integers(3, 5)), elements=st.integers(0, 4))


def test_friedmans_of_hollander_and_wolfe():
    test = friedman(ROUNDING)
    assert (round(test.statistic, 4), test.freedom, round(test.p, 6)) == (11.1429, 2, 0.003805)
    assert test.agreement == pytest.approx(11.142857 / 44)


def test_cochrans_q_of_three_classifiers():
    """Example 1 of mlxtend's guide, which prints Q 7.529 and p .023."""
    # The guide's three columns of 100: wrong is 1.
    first = np.array([1] * 16 + [0] * 6 + [0] * 76 + [0] * 2)
    second = np.array([1] * 6 + [0] * 14 + [1] * 2 + [0] * 76 + [0] * 2)
    third = np.array([1] * 3 + [0] * 3 + [1] + [0] * 13 + [1] * 2 + [0] * 76 + [1] * 2)
    test = cochran(1 - np.array([first, second, third]).T)
    assert test.statistic == pytest.approx(7.529411764705882)
    assert test.p == pytest.approx(0.023174427241061245)


@given(hnp.arrays(np.int64, st.tuples(st.integers(2, 8), st.integers(3, 5)), elements=st.integers(0, 1)))
def test_cochrans_q_is_its_published_formula(table):
    columns, rows, k = table.sum(axis=0), table.sum(axis=1), table.shape[1]
    within = (rows * (k - rows)).sum()
    expected = k * (k - 1) * ((columns - columns.mean()) ** 2).sum() / within if within else 0.0
    assert cochran(table).statistic == pytest.approx(expected, abs=1e-9)


@given(tables)
def test_many_studies_at_once_have_the_statistics_of_each(table):
    many = np.array([table, table[::-1], table[:, ::-1] + 1], dtype=float)
    assert friedman_statistics(many).tolist() == pytest.approx([friedman(one).statistic for one in many], abs=1e-9)


@given(tables)
def test_agreement_is_the_mean_rank_correlation_of_two_people(table):
    """Kendall: W = ((n - 1) r + 1) / n, r the mean of Spearman's over all pairs of people; without ties."""
    ranks = np.array([np.argsort(np.argsort(row + np.arange(len(row)) / 10)) for row in table])
    n = len(ranks)
    mean = (np.corrcoef(ranks).sum() - n) / (n * (n - 1))
    assert friedman(ranks).agreement == pytest.approx(((n - 1) * mean + 1) / n, abs=1e-9)


@given(tables, st.integers(-5, 5))
def test_how_high_a_person_answers_in_general_does_not_matter(table, higher):
    other = table + higher * np.arange(len(table))[:, None]
    assert friedman(other) == friedman(table)


def test_who_did_not_answer_all_is_left_out_and_counted():
    table = np.vstack([ROUNDING, [np.nan, 5, 6]])
    test = friedman(table)
    assert (test.people, test.left_out) == (22, 1)
    assert test.statistic == friedman(ROUNDING).statistic


def test_people_who_tell_no_two_apart_differ_in_nothing():
    test = friedman([[1, 1, 1], [2, 2, 2]])
    assert (test.statistic, test.p, test.agreement) == (0, 1, 0)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([[1, 2], [2, 1]], "three stimuli or more, got 2"),
        ([[1, 2, 3]], "two people or more for all stimuli, got 1"),
        ([1, 2, 3], r"expected finite scores \(people, stimuli\)"),
        ([[1, 2, np.inf], [1, 2, 3]], "expected finite scores"),
    ],
)
def test_tables_that_cannot_be_tested_are_refused(values, said):
    with pytest.raises(StudyError, match=said):
        friedman(values)


def test_cochran_takes_yes_and_no_only():
    with pytest.raises(StudyError, match=r"must be 1 \(yes\) and 0 \(no\)"):
        cochran([[0, 1, 2], [0, 0, 1]])


def test_the_papers_p_of_its_chi_square():
    assert round(float(stats.chi2.sf(9.035, 2)), 3) == 0.011
