from __future__ import annotations

from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import StudyError
from hpop.study.statistics import adjusted

values = st.lists(st.integers(0, 20).map(lambda i: i / 20), min_size=1, max_size=4)


def test_holms_of_his_textbook_example():
    """R: p.adjust(c(.01, .02, .03, .04, .05), "holm") and "bonferroni"."""
    p = [0.01, 0.02, 0.03, 0.04, 0.05]
    assert adjusted(p).tolist() == pytest.approx([0.05, 0.08, 0.09, 0.09, 0.09])
    assert adjusted(p, "bonferroni").tolist() == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.25])


@given(values, st.integers(0, 19))
def test_holm_rejects_what_closed_testing_with_bonferroni_rejects(p, level):
    """A hypothesis is rejected if every set of hypotheses that holds it is rejected by Bonferroni's test."""
    alpha = level / 20 + 0.001
    for i, value in enumerate(adjusted(p)):
        sets = range(1, 2 ** len(p))
        members = ([p[j] for j in range(len(p)) if one >> j & 1] for one in sets if one >> i & 1)
        assert (value <= alpha) == all(min(some) * len(some) <= alpha for some in members)


@given(values)
def test_holm_is_never_above_bonferroni_and_both_never_below_the_values(p):
    holm, bonferroni = adjusted(p), adjusted(p, "bonferroni")
    assert (holm <= bonferroni + 1e-12).all()
    assert (holm >= np.array(p) - 1e-12).all()
    assert bonferroni.max() <= 1


def test_a_missing_value_stays_one_and_counts_for_none():
    assert adjusted([0.01, nan, 0.02]).tolist() == pytest.approx([0.02, nan, 0.02], nan_ok=True)


def test_a_correction_that_is_not_known_is_refused():
    with pytest.raises(StudyError, match=r"Did you mean 'holm'"):
        adjusted([0.1], "hohm")
