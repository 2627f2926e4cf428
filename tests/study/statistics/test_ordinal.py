"""The ordinal mixed model: published fits, brute-force integration, and simulated studies with known effects."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expit
from scipy.stats import norm

from hpop.errors import StudyError
from hpop.study.statistics import crossover, factorial, ordinal_mixed
from hpop.study.statistics.ordinal import log_likelihood, thresholds_of

# Randall 1989, bitterness of wine: 8 bottles (cold without contact twice, with contact twice, then warm), 9 judges.
WINE = np.array(
    [
        [2, 1, 2, 3, 2, 3, 1, 2, 1],
        [3, 2, 3, 2, 3, 2, 1, 2, 2],
        [3, 1, 3, 3, 4, 3, 2, 2, 3],
        [4, 3, 2, 2, 3, 2, 2, 3, 2],
        [4, 2, 5, 3, 3, 2, 2, 3, 3],
        [4, 3, 5, 2, 3, 4, 3, 3, 2],
        [5, 5, 4, 5, 3, 5, 2, 3, 4],
        [5, 4, 4, 3, 3, 4, 3, 4, 4],
    ],
    dtype=float,
)
WARM, CONTACT = np.repeat([0.0, 1.0], 4), np.tile(np.repeat([0.0, 1.0], 2), 2)


def wine():
    effects = np.tile(np.column_stack([WARM, CONTACT]), (9, 1))
    return ordinal_mixed(WINE.T.ravel(), np.repeat(np.arange(9), 8), effects, ("warm", "contact"))


def test_the_wine_of_the_tutorial_of_rs_package_ordinal():
    """Christensen, A tutorial on fitting cumulative link mixed models: Laplace's log likelihood is -81.565."""
    fit = wine()
    printed = np.concatenate(
        [[-1.6237], np.log(np.diff([-1.6237, 1.5134, 4.2285, 6.0888])), [3.0630, 1.8349], [np.log(1.1311)]]
    )
    assert log_likelihood(printed, fit.data, nodes=1) == pytest.approx(-81.56541, abs=1e-4)
    assert fit.effects == pytest.approx([3.0630, 1.8349], abs=0.005)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx([0.5954, 0.5125], abs=0.002)
    assert fit.thresholds == pytest.approx([-1.6237, 1.5134, 4.2285, 6.0888], abs=0.005)
    assert fit.deviation == pytest.approx(1.1311, abs=0.005)


def test_the_likelihood_is_that_of_integration():
    fit = wine()
    parameters = fit.parameters + 0.2
    ends = np.concatenate([[-np.inf], thresholds_of(parameters, 5), [np.inf]])
    shift, deviation = parameters[4] * WARM + parameters[5] * CONTACT, np.exp(parameters[6])

    def density(person: float, scores: np.ndarray) -> float:
        levels = scores.astype(int)
        at = shift + deviation * person
        return float(norm.pdf(person) * (expit(ends[levels] - at) - expit(ends[levels - 1] - at)).prod())

    whole = sum(np.log(quad(density, -9, 9, args=(scores,), epsabs=1e-14)[0]) for scores in WINE.T)
    assert log_likelihood(parameters, fit.data) == pytest.approx(whole, abs=1e-6)


def rated(rng, people, stimuli, carried, deviation=1.0):
    """Return scores (people, k) on nine levels, and places, in random orders, with known effects."""
    k = len(stimuli)
    order = np.array([rng.permutation(k) for _ in range(people)])
    places = np.argsort(order, axis=1) + 1
    before = np.concatenate([np.zeros((people, 1)), np.asarray(carried)[order[:, :-1]]], axis=1)
    feel = (
        np.asarray(stimuli)[order]
        + before
        + deviation * rng.standard_normal((people, 1))
        + rng.logistic(size=order.shape)
    )
    scores = np.searchsorted(np.linspace(-3, 3, 8), feel).astype(float)
    return np.take_along_axis(scores, places - 1, axis=1), places


def test_effects_of_stimuli_and_of_the_stimulus_before_are_found():
    values, places = rated(np.random.default_rng(2), 150, (0.0, 0.5, 1.0), (0.8, 0.0, -0.8))
    values[:20, 1] = np.nan
    found = crossover(values, places, before=True)
    assert found.fit.effects[:2] == pytest.approx([0.5, 1.0], abs=0.45)
    assert found.fit.effects[4:] == pytest.approx([0.8, 0.0], abs=0.45)
    assert found.fit.deviation == pytest.approx(1.0, abs=0.45)
    assert found.without["stimulus"].p < 1e-3
    assert found.without["before"].p < 1e-3
    assert found.without["place"].p > 0.01


def test_a_factor_that_matters_is_told_from_one_that_does_not():
    """Four conditions: two trajectories, of equal worth, with and without latency."""
    values, places = rated(np.random.default_rng(4), 60, (0.0, 1.0, 0.0, 1.0), np.zeros(4))
    found = factorial(values, places, {"trajectory": list("aabb"), "latency": ["0", "0.5"] * 2})
    assert found.without["latency"].p < 1e-3
    assert found.without["trajectory"].p > 0.01
    assert found.fit.effects[:2] == pytest.approx([0.0, 1.0], abs=0.5)


def test_what_cannot_be_fitted_is_refused():
    values, places = np.arange(12.0).reshape(4, 3), np.tile([1, 2, 3], (4, 1))
    with pytest.raises(StudyError, match="cannot be told apart in these orders"):
        crossover(values, places)
    with pytest.raises(StudyError, match="needs two people and two different scores or more, got 4 and 1"):
        crossover(np.ones((4, 3)), places)
    apart = np.array([[0.0, 1.0]] * 6)
    with pytest.raises(StudyError, match="the effect of stimulus 1 has no finite estimate"):
        crossover(apart, np.array([[1, 2], [2, 1]] * 3))


@pytest.mark.proof
def test_intervals_hold_and_tests_find_nothing_where_there_is_nothing():
    """Simulate 100 studies with 36 people; bounds leave room for chance."""
    inside, alarms = 0, np.zeros(3)
    for seed in range(100):
        values, places = rated(np.random.default_rng(seed), 36, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), deviation=1.5)
        found = crossover(values, places, before=True)
        effect, error = found.contrast(np.eye(6)[0])
        inside += abs(effect) < 1.96 * error
        alarms += [found.without[name].p < 0.05 for name in ("stimulus", "place", "before")]
    assert inside >= 88
    assert (alarms <= 14).all()


def test_a_factor_of_one_level_has_no_row():
    values, places = rated(np.random.default_rng(4), 60, (0.0, 0.5, 1.0), np.zeros(3))
    found = factorial(values, places, {"trajectory": ["knee"] * 3, "latency": ["0", "0.2", "0.5"]})
    assert set(found.without) == {"latency", "place"}
