"""Answers have the probabilities that the model says, whatever the order of a pair."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.preference.answers import LAPSE, answer_probabilities, log_answer_probability

GAINS = st.floats(-40, 40)
NUS = st.floats(0.001, 20)


@given(GAINS, NUS)
def test_probabilities_of_all_answers_add_up_to_one(gain: float, nu: float) -> None:
    for ties in (None, np.array(nu)):
        assert sum(answer_probabilities(np.array(gain), ties)) == pytest.approx(1.0, abs=1e-12)


@given(GAINS, NUS)
def test_an_answer_is_as_probable_shown_first_or_second(gain: float, nu: float) -> None:
    here, there = (answer_probabilities(np.array(sign * gain), np.array(nu)) for sign in (1, -1))
    assert (here[0], here[1], here[2]) == (there[1], there[0], there[2])


@given(GAINS, NUS, st.booleans())
def test_what_is_asked_and_what_is_answered_have_one_probability(gain: float, nu: float, offered: bool) -> None:
    first, second, *neither = answer_probabilities(np.array(gain), np.array(nu) if offered else None)
    said = [log_answer_probability(np.array(g), np.array(tied), np.array(offered), np.array(nu))
            for g, tied in ((gain, False), (-gain, False), (gain, True))]  # fmt: skip
    np.testing.assert_allclose(np.exp(said[: 2 + offered]), [first, second, *neither], rtol=1e-12)


def test_a_difference_of_log_three_is_chosen_three_times_of_four_but_for_lapses() -> None:
    first, second = answer_probabilities(np.log([3.0]), None)
    assert first[0] == pytest.approx((1 - LAPSE) * 0.75 + LAPSE / 2)
    assert second[0] == pytest.approx((1 - LAPSE) * 0.25 + LAPSE / 2)


def test_davidsons_ties_of_equals_are_nu_to_two() -> None:
    chances = [c[0] for c in answer_probabilities(np.zeros(1), np.ones(1))]
    assert chances == pytest.approx([1 / 3] * 3)


def test_huge_differences_neither_overflow_nor_become_certain() -> None:
    with np.errstate(all="raise", under="ignore"):
        first, second = answer_probabilities(np.array([-1e6, 1e6]), None)
    np.testing.assert_allclose(first, [LAPSE / 2, 1 - LAPSE / 2])
    np.testing.assert_allclose(second, [1 - LAPSE / 2, LAPSE / 2])
