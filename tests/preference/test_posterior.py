"""The posterior is what Bayes' rule says, told by numerical integration, by ranks, and by Bradley and Terry."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chisquare

from hpop.base.arrays import FloatArray
from hpop.errors import StudyError
from hpop.frontier import ItemFront
from hpop.preference import Preference, Prior
from tests import preferring as people

TRIANGLE: ItemFront[int] = ItemFront.of(
    [[0.0, 1.0], [1.0, 0.0], [0.4, 0.4]], names=["turns", "length"], quanta=[1e-6, 1e-6]
)


def integrated(gains: FloatArray, prior: Prior) -> tuple[float, float]:
    """Return the expected share of the first of two costs, and the probability of random answers, on a fine grid.

    Its ends are the people who care for one cost only, half of the selective people each.
    """
    share = np.concatenate([[0.0], (np.arange(400) + 0.5) / 400, [1.0]])
    density = np.concatenate([[prior.selective / 2], np.full(400, (1 - prior.selective) / 400), [prior.selective / 2]])
    log_sharpness = np.linspace(-4, 4, 161) * prior.spread + np.log(prior.sharpness)
    weight = np.exp(-0.5 * ((log_sharpness - np.log(prior.sharpness)) / prior.spread) ** 2)
    weight /= weight.sum()
    worth = np.einsum("nf,fs->ns", gains, np.stack([share, 1 - share]))  # (n, shares)
    w = np.exp(log_sharpness)[:, None, None] * worth  # (sharpness, n, shares)
    answers = (0.01 + 0.98 / (1 + np.exp(-w))).prod(axis=1)  # (sharpness, shares)
    marginal = (weight @ answers) * density  # (shares,)
    sharp, chance = (1 - prior.random) * marginal.sum(), prior.random * 0.5 ** len(gains)
    mean = (marginal * share).sum() / marginal.sum()  # of those who have a preference
    return float(mean), float(chance / (sharp + chance))


@pytest.mark.parametrize("count", [3, 25])
def test_the_posterior_of_two_costs_is_the_integral(count: int) -> None:
    rng = np.random.default_rng(3)
    rows = TRIANGLE.costs
    pairs = [(0, 1), (1, 2), (2, 0), (2, 1), (0, 2)]
    chosen = [(a, b) if rng.random() < 1 / (1 + np.exp(-6 * np.dot([0.7, 0.3], rows[b] - rows[a]))) else (b, a)
              for a, b in (pairs * 8)[:count]]  # fmt: skip
    person = Preference.fit(TRIANGLE, chosen, count=10_000)
    gains = np.array([rows[other] - rows[one] for one, other in chosen])
    mean, random = integrated(gains, Prior())
    assert person.weights["turns"] == pytest.approx(mean, abs=0.012)
    assert person.random == pytest.approx(random, abs=0.012)


def test_many_answers_come_to_what_bradley_and_terry_say() -> None:
    counts = {(0, 2): 39, (2, 0): 21, (0, 1): 18, (1, 0): 42, (2, 1): 13, (1, 2): 47}
    choices = [pair for pair, times in counts.items() for _ in range(times)]
    person = Preference.fit(TRIANGLE, choices, prior=Prior(spread=3.0), count=4_000)

    def loss(worth: FloatArray) -> float:  # of rows 0 and 2 beside row 1
        of = np.array([worth[0], 0.0, worth[1]])
        return float(sum(times * np.log1p(np.exp(of[b] - of[a])) for (a, b), times in counts.items()))

    oracle = minimize(loss, np.zeros(2)).x
    mean = person.draws.probability() @ person.draws.weights
    utility = -(TRIANGLE.costs @ mean)
    # A standard error is some .25; lapses, which Bradley and Terry do not know, are 2 %.
    np.testing.assert_allclose(utility[[0, 2]] - utility[1], oracle, atol=0.1)


@pytest.mark.parametrize("n", [50, pytest.param(200, marks=pytest.mark.proof)])
def test_ranks_of_true_shares_are_uniform(n: int) -> None:
    """Simulation-based calibration (Talts et al. 2018): a prior's people, each beside their own posterior."""
    front, ranks = people.front(40), []
    for i in range(n):
        shares, sharpness, nu = people.drawn(Prior(), 3, i)
        rng, may_tie = np.random.default_rng([i, 1]), i % 2 == 0
        person = Preference.fit(front, ties=may_tie, seed=i, count=1_000)
        rows = person.scale.rows_on(front)
        for _ in range(5):
            a, b = rng.choice(len(rows), 2, replace=False).tolist()
            person = person.told(a, b, people.answered(rng, a, b, rows, sharpness * shares, nu if may_tie else None))
        probability = person.draws.probability()
        below, alike = probability @ (person.draws.shares < shares), probability @ (person.draws.shares == shares)
        ranks.append(below + rng.random(3) * alike)  # a share of 0 or 1 has a rank anywhere among its like
    for column in np.array(ranks).T:
        assert chisquare(np.histogram(column, 10, (0, 1))[0]).pvalue > 0.001


@pytest.mark.proof
@pytest.mark.parametrize("telling", [False, True])
def test_intervals_hold_as_often_as_they_say(telling: bool) -> None:
    """Intervals cover shares within (0, 1); shares of 0 and 1 are interval ends, which cover more than they claim."""
    front, held = people.front(158), []
    for i in range(500):
        shares, sharpness, _ = people.drawn(Prior(selective=0.0), 3, i)
        start = Preference.fit(front, seed=i, prior=Prior(selective=0.0))
        person = people.asked(start, 10, sharpness * shares, np.random.default_rng([i, 2]), telling=telling)
        held.append(people.held(person, shares))
    assert 0.88 <= np.mean(held) <= 0.92


@pytest.mark.parametrize(
    ("n", "least"), [(6, 0.69), pytest.param(60, 0.83, marks=pytest.mark.proof)]
)  # of 18 shares and of 180: three standard errors below .9
@pytest.mark.parametrize("cared_for", [1, 2, 3])
def test_intervals_hold_for_people_who_care_for_one_cost_for_two_and_for_all(
    cared_for: int, n: int, least: float
) -> None:
    front, held = people.front(158), []
    for i in range(n):
        rng = np.random.default_rng([i, 5])
        shares = np.zeros(3)
        shares[rng.choice(3, cared_for, replace=False)] = rng.dirichlet(np.ones(cared_for))
        weights = 15.0 * np.exp(0.7 * rng.standard_normal()) * shares
        start = Preference.fit(front, seed=i, count=5_000)
        person = people.asked(start, 12, weights, rng, telling=n > 6)  # the choice of questions is most of the work
        held.append(people.held(person, shares))
    assert np.mean(held) >= least


def test_an_interval_reaches_one_of_a_person_who_cares_for_one_cost() -> None:
    front = people.front(158)
    person = people.asked(Preference.fit(front), 12, np.array([0.0, 20.0, 0.0]), np.random.default_rng(1))
    intervals = person.interval(0.9)
    assert intervals["turns"][1] == 1.0
    assert intervals["length"][0] == intervals["exposure"][0] == 0.0


def test_the_order_of_a_pair_changes_nothing() -> None:
    front = people.front()
    here, there = Preference.fit(front, ties=True), Preference.fit(front, ties=True)
    for a, b, chosen in [(3, 9, 3), (4, 8, 8), (1, 5, None), (20, 2, 2)] * 3:
        here, there = here.told(a, b, chosen), there.told(b, a, chosen)
    assert here.weights == there.weights
    assert here.best().row == there.best().row


def test_a_change_of_units_changes_nothing() -> None:
    front = people.front()
    factors = np.array([1000.0, 60.0, 1 / 3600])
    other: ItemFront[int] = ItemFront.of(
        front.costs * factors, names=front.names, units=["mm", "1", "h"], quanta=factors * 1e-6
    )
    choices = [(3, 9), (8, 4), (1, 5), (2, 20), (40, 30)]
    here, there = Preference.fit(front, choices), Preference.fit(other, choices)
    assert here.weights == pytest.approx(there.weights, abs=1e-9)
    assert here.best().row == there.best().row
    assert here.next_pair() == there.next_pair()


def test_the_same_answers_give_the_same_preference_and_another_seed_nearly_the_same() -> None:
    front, choices = people.front(), [(3, 9), (8, 4), (1, 5), (2, 20), (40, 30)] * 4
    first, again, other = (Preference.fit(front, choices, seed=seed) for seed in (1, 1, 2))
    assert first.weights == again.weights != other.weights
    assert first.weights == pytest.approx(other.weights, abs=0.03)


def test_a_cost_that_is_the_same_everywhere_keeps_its_prior() -> None:
    costs = np.column_stack([people.front(k=2).costs, np.full(60, 4.0)])
    front: ItemFront[int] = ItemFront.of(costs, names=["length", "turns", "height"], quanta=[1e-6] * 3)
    person = Preference.fit(front, [(3, 9), (4, 20)])
    assert person.weights["height"] == pytest.approx(1 / 3, abs=0.05)


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ([(3, 3)], "between two different rows, got 3 twice"),
        ([(3, 60)], "the second must be a row of the front from 0 to 59, got 60"),
        ([(True, 2)], "a row of the front"),
        (["ab"], "the chosen row and the other one"),
        ([(1, 2, 3)], "the chosen row and the other one"),
    ],
)
def test_what_is_no_choice_is_refused(choices: list[object], said: str) -> None:
    with pytest.raises(StudyError, match=said):
        Preference.fit(people.front(), choices)


@pytest.mark.parametrize("name", ["spread", "ties_spread"])
def test_a_prior_under_which_numbers_overflow_is_refused(name: str) -> None:
    with pytest.raises(StudyError, match=f"{name} of the prior"):
        Prior(**{name: 1000.0})
    person = Preference.fit(TRIANGLE, [(0, 1)], ties=True, prior=Prior(**{name: 10.0}))
    assert np.isfinite(list(person.told(1, 2, None).weights.values())).all()


def test_no_difference_must_have_been_an_answer() -> None:
    with pytest.raises(StudyError, match="ties=True from the first question on"):
        Preference.fit(people.front()).told(1, 2, None)
    with pytest.raises(StudyError, match="must be row 1 or 2, or None"):
        Preference.fit(people.front()).told(1, 2, 7)


def test_a_front_without_a_choice_is_refused() -> None:
    with pytest.raises(StudyError, match="a front of at least two points, got 1 point"):
        Preference.fit(TRIANGLE[:1])
    with pytest.raises(StudyError, match="needs a front"):
        Preference.fit([[1.0, 2.0]])  # type: ignore[arg-type]
