"""Power by simulation: known figures, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.errors import StudyError
from hpop.study.statistics import friedman, kruskal, power, wilcoxon
from hpop.study.statistics.power import _from_effect, _p_values

# Friedman and Kruskal on the same people, by the correlation of two answers of a person: n = 36, shifts 0, .25, .5, of
# 1,500 simulated studies, whose error is .013.
CORRELATED = {0.0: (0.32, 0.39), 0.3: (0.46, 0.40), 0.6: (0.72, 0.31), 0.8: (0.95, 0.26)}
studies = hnp.arrays(np.int64, st.tuples(st.just(2), st.integers(2, 6), st.integers(2, 4)), elements=st.integers(0, 4))


def test_wilcoxon_needs_35_people_for_an_effect_of_half_a_standard_deviation():
    assert power(0.5, n=35, k=2, seed=1).power == pytest.approx(0.806, abs=0.02)


@pytest.mark.proof
@pytest.mark.parametrize(("people", "expected"), [(34, 0.785), (35, 0.806), (36, 0.814)])
def test_power_of_wilcoxon_about_eighty_per_cent(people, expected):
    """G*Power and others: 35 for .80 of dz = .5, two-sided."""
    found = power(0.5, n=people, k=2, simulations=100_000, seed=people)
    assert found.power == pytest.approx(expected, abs=0.01)
    assert (found.power >= 0.8) == (people >= 35)


@pytest.mark.parametrize(
    "correlation", [0.0, pytest.param(0.3, marks=pytest.mark.proof), 0.6, pytest.param(0.8, marks=pytest.mark.proof)]
)
def test_kruskal_and_wallis_loses_power_on_the_same_people(correlation):
    for test, expected in zip(("friedman", "kruskal"), CORRELATED[correlation], strict=True):
        found = power((0, 0.25, 0.5), n=36, correlation=correlation, test=test, simulations=1500, seed=5)
        assert found.power == pytest.approx(expected, abs=0.045)


@pytest.mark.parametrize(("k", "test", "n"), [(2, "wilcoxon", 8), (2, "wilcoxon", 40), (3, "friedman", 40)])
def test_without_an_effect_the_power_is_a_false_alarm(k, test, n):
    found = power(0.0, n=n, k=k, test=test, simulations=1000, seed=2)
    assert 0.02 < found.power < 0.07


def test_five_people_never_reach_five_per_cent_with_wilcoxon():
    assert power(9.0, n=5, k=2, simulations=100).power == 0
    assert power(9.0, k=2, simulations=100).people == 6


def test_the_least_number_of_people_reaches_the_target_and_one_less_does_not():
    found = power(0.8, k=2, simulations=300, seed=3)
    assert found.power >= 0.8 > power(0.8, n=found.people - 1, k=2, simulations=300, seed=3).power
    assert found.low < found.power < found.high


def test_three_people_are_enough_where_nobody_can_doubt():
    """All three rank three stimuli alike: chi-square 6, p .0498."""
    assert power(50.0, k=3, simulations=100).people == 3


@given(studies)
def test_studies_at_once_are_tested_as_each_is(values):
    k = values.shape[2]
    for one, p in zip(values, _p_values(values.astype(float), "kruskal"), strict=True):
        assert p == pytest.approx(kruskal(list(one.T)).p)
    if k > 2:
        for one, p in zip(values, _p_values(values.astype(float), "friedman"), strict=True):
            assert p == pytest.approx(friedman(one).p)
    for some in (values, values + np.arange(values.size).reshape(values.shape) ** 2 / 97):  # tied, and not
        for one, p in zip(some, _p_values(some[:, :, :2].astype(float), "wilcoxon"), strict=True):
            assert p == pytest.approx(wilcoxon(one[:, 0], one[:, 1]).p)


def test_many_people_are_tested_by_the_normal_approximation():
    values = np.random.default_rng(0).integers(0, 4, (3, 40, 2)).astype(float)
    expected = [wilcoxon(one[:, 0], one[:, 1], exact=False).p for one in values]
    assert _p_values(values, "wilcoxon") == pytest.approx(expected)


def test_the_seed_says_it_all():
    assert power(0.5, n=10, simulations=200, seed=4) == power(0.5, n=10, simulations=200, seed=4)
    assert power(0.5, n=10, simulations=200, seed=4) != power(0.5, n=10, simulations=200, seed=5)


def test_coarse_answers_cost_power():
    fine = power(0.5, n=40, k=2, simulations=2000, seed=1).power
    half = power(0.5, n=40, k=2, simulations=2000, seed=1, like=[0, 1]).power
    assert half < fine - 0.1


def test_coarse_answers_are_the_scores_of_the_pilot_as_often_as_there():
    """Ranks of differences depend on how far scores lie apart, not on their order alone."""
    draw, _ = _from_effect(0.0, 2, 0.5, [0, 0, 0, 0, 0, 3.74, 3.74, 3.74, 120, 120, np.nan])
    scores, counts = np.unique(draw(np.random.default_rng(0), 500, 20), return_counts=True)
    assert scores.tolist() == [0, 3.74, 120]
    assert counts / 20_000 == pytest.approx([0.5, 0.3, 0.2], abs=0.02)


def test_people_of_a_pilot_are_drawn():
    rng = np.random.default_rng(0)
    pilot = rng.integers(0, 4, (12, 3)) + np.array([0, 1, 1])
    assert power(pilot=pilot, n=40, simulations=300).power > power(pilot=pilot, n=8, simulations=300).power
    with_gaps = np.vstack([pilot, [np.nan, 1, 2]])
    assert power(pilot=with_gaps, n=8, simulations=300) == power(pilot=pilot, n=8, simulations=300)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            {"effect": "observed", "n": 20},
            "observed power is not given: the power of a study .* follows from its p alone",
        ),
        ({"pilot": np.eye(12, 3), "n": 12}, "n must differ from the pilot's number of people, 12"),
        ({}, "give the least effect that would matter"),
        ({"effect": 0.5, "test": "mixed"}, 'test="mixed" needs n'),
        (
            {"effect": 0.5, "test": "wilcoxon"},
            "test must be 'friedman', 'kruskal' or 'mixed' for 3 stimuli, got 'wilcoxon'",
        ),
        ({"effect": 0.5, "n": 1}, "n must be a number of people from 2"),
        ({"effect": 0.001, "k": 2, "simulations": 100}, "2,000 people have a power of"),
        ({"effect": 0.001, "simulations": 200_000}, "2,000 people have a power of"),  # after a few studies only
        ({"effect": "big"}, "effect must be a shift"),
        ({"effect": [0.5]}, "two stimuli or more"),
        ({"effect": np.array([0.5])}, "two stimuli or more"),
        ({"effect": 0.5, "like": [1, 1]}, "at least two different scores of a pilot"),
        ({"effect": 0.5, "correlation": 1.0}, "correlation must be"),
    ],
)
def test_what_cannot_be_asked_is_refused(asked, said):
    with pytest.raises(StudyError, match=said):
        power(**asked)


def test_the_figures_are_told():
    assert (
        power(0.5, n=35, k=2, simulations=1000, seed=1)
        .text()
        .startswith("With 35 people the Wilcoxon test finds the difference (p < 0.05) in ")
    )


@pytest.mark.proof
def test_the_mixed_model_finds_as_much_as_friedmans_test_and_nothing_where_there_is_nothing():
    found = power((0, 0.25, 0.5), n=36, correlation=0.6, test="mixed", simulations=150, seed=1)
    assert found.high > power((0, 0.25, 0.5), n=36, correlation=0.6, simulations=1000).power
    assert power((0, 0, 1e-9), n=36, correlation=0.6, test="mixed", simulations=150, seed=1).low < 0.05
