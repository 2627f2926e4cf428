"""Pooling: what earlier people tell of the next one, with and without profiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hpop.errors import StudyError
from hpop.frontier import ItemFront
from hpop.preference import People, Preference, Prior
from tests import preferring as people

FRONT = people.front(60)


def those(n: int, toward: float = 0.0, *, questions: int = 12) -> tuple[list[Preference], list[dict[str, float]]]:
    """People with Dirichlet shares; with ``toward`` the higher their "mssq" the more turns count."""
    found, profiles = [], []
    for i in range(n):
        rng = np.random.default_rng([i, 8])
        mssq = float(rng.normal(10, 4))
        concentration = np.array([2.0, 6.0 * np.exp(toward * (mssq - 10) / 4), 2.0])
        weights = 20.0 * rng.dirichlet(concentration)
        choices = []
        rows = (FRONT.costs - FRONT.costs.min(axis=0)) / np.ptp(FRONT.costs, axis=0)
        for _ in range(questions):
            a, b = rng.choice(len(rows), 2, replace=False).tolist()
            chosen = people.answered(rng, a, b, rows, weights)
            choices.append((chosen, b if chosen == a else a))
        found.append(Preference.fit(FRONT, choices, seed=i, count=2_000))
        profiles.append({"mssq": mssq})
    return found, profiles


@pytest.fixture(scope="module")
def forty() -> People:
    return People(*those(40, 0.8))


def test_many_people_who_mind_turns_make_it_likely_of_the_next(forty: People) -> None:
    expected = Preference.fit(FRONT, prior=forty.prior({"mssq": 10.0})).weights
    assert expected["turns"] > 0.45 > 1 / 3 > max(expected["length"], expected["exposure"])


def test_a_profile_tells_what_to_expect_of_enough_people(forty: People) -> None:
    assert forty.uses_profile
    low, middle, high = (Preference.fit(FRONT, prior=forty.prior({"mssq": m})).weights["turns"] for m in (2, 10, 18))
    assert low + 0.1 < middle < high
    unsaid = forty.prior()
    assert unsaid.concentration == pytest.approx(
        forty.prior({"mssq": float(np.mean([p["mssq"] for p in forty.profiles]))}).concentration
    )
    found = {a.cost: a.correlation for a in forty.associations()}
    assert found["turns"] > 0.3


def test_of_few_people_the_profile_is_reported_and_not_used(forty: People) -> None:
    few = People(forty.preferences[:19], forty.profiles[:19])
    assert not few.uses_profile
    assert few.prior({"mssq": 2.0}) == few.prior({"mssq": 18.0})
    assert {(a.profile, a.cost, a.people) for a in few.associations()} == {("mssq", cost, 19) for cost in FRONT.names}


def test_one_person_changes_little() -> None:
    (one,), _ = those(1)
    concentration = np.array(People([one]).prior().concentration)
    assert (np.abs(np.log(concentration)) < 0.7).all()


def test_a_prior_of_people_needs_fewer_answers_to_be_right(forty: People) -> None:
    pooled = forty.prior({"mssq": 10.0})
    errors: dict[str, list[float]] = {"pooled": [], "alone": []}
    rows = (FRONT.costs - FRONT.costs.min(axis=0)) / np.ptp(FRONT.costs, axis=0)
    for i in range(30):
        rng = np.random.default_rng([i, 99])
        shares = rng.dirichlet([2.0, 6.0, 2.0])
        choices = []
        for _ in range(3):
            a, b = rng.choice(len(rows), 2, replace=False).tolist()
            chosen = people.answered(rng, a, b, rows, 20 * shares)
            choices.append((chosen, b if chosen == a else a))
        for name, prior in (("pooled", pooled), ("alone", Prior())):
            person = Preference.fit(FRONT, choices, prior=prior, seed=i, count=2_000)
            errors[name].append(float(np.abs(np.array(list(person.weights.values())) - shares).sum()))
    assert np.mean(errors["pooled"]) < 0.8 * np.mean(errors["alone"])


def test_comfort_and_preference_are_not_pooled() -> None:
    asked = [Preference.fit(FRONT, question=question) for question in ("prefer", "comfort")]
    with pytest.raises(StudyError, match="people with equal questions and equal costs"):
        People(asked)
    with pytest.raises(StudyError, match="one for each person, got 1"):
        People(asked[:1] * 2, [{"mssq": 1.0}])
    with pytest.raises(StudyError, match="no earlier participant has 'age' in the profile; their profiles have: mssq"):
        People(asked[:1], [{"mssq": 1.0}]).prior({"age": 3})
    with pytest.raises(StudyError, match="at least one person"):
        People([])


def test_a_profile_beyond_those_of_all_earlier_people_counts_as_the_nearest(forty: People) -> None:
    """Profiles are not extrapolated beyond those seen, however far: concentrations would pass all bounds."""
    known = [profile["mssq"] for profile in forty.profiles]
    assert forty.prior({"mssq": 1e5}) == forty.prior({"mssq": max(known)})
    assert forty.prior({"mssq": -1e5}) == forty.prior({"mssq": min(known)})


def stretched(factors: list[float]) -> ItemFront[int]:
    """Return the front with other ranges of length, turns and exposure."""
    return ItemFront.of(FRONT.costs * factors, names=FRONT.names, units=FRONT.units, quanta=[1e-6] * 3)


def test_a_prior_is_rescaled_by_units_on_a_front_of_other_ranges() -> None:
    """The worth of a metre beside a turn stays, draw by draw; later answers are weighed as if nothing had changed."""
    prior = People([Preference.fit(FRONT, [(3, 9), (4, 20)], count=1_000)]).prior()
    here, there = (Preference.fit(front, prior=prior, count=1_000) for front in (FRONT, stretched([3.0, 1.0, 0.5])))
    weights = there.draws.weights / [3.0, 1.0, 0.5]
    np.testing.assert_allclose(weights, here.draws.weights, rtol=1e-9)
    density, other = (one.prior.log_density(one.draws.shares[500:], one.draws.sharpness[500:], one.draws.ties[500:])
                      for one in (here, there))  # fmt: skip
    np.testing.assert_allclose(other, density, rtol=1e-9)
    assert there.weights["length"] > here.weights["length"] + 0.1


def test_people_asked_about_fronts_of_other_ranges_are_pooled_by_units() -> None:
    """Half of them saw three times the metres, each of which counts as much: the next one is expected to be alike."""
    shares, found = np.array([0.3, 0.6, 0.1]), []
    for i in range(12):
        factors = [3.0, 1.0, 1.0] if i % 2 else [1.0, 1.0, 1.0]
        start = Preference.fit(stretched(factors), seed=i, count=1_000)
        found.append(people.asked(start, 10, 20.0 * shares * factors, np.random.default_rng([i, 5]), telling=False))
    for factors, expected in (([1.0, 1.0, 1.0], shares), ([3.0, 1.0, 1.0], np.array([0.9, 0.6, 0.1]) / 1.6)):
        next_one = Preference.fit(stretched(factors), prior=People(found).prior(), count=2_000)
        np.testing.assert_allclose(list(next_one.weights.values()), expected, atol=0.12)


def test_a_prior_of_other_costs_or_units_or_bends_is_refused(tmp_path: Path) -> None:
    prior = People([Preference.fit(FRONT, count=1_000)]).prior()
    with pytest.raises(StudyError, match="asked about length, turns, exposure, but here the costs are length, turns"):
        Preference.fit(people.front(k=2), prior=prior)
    units: ItemFront[int] = ItemFront.of(FRONT.costs, names=FRONT.names, units=["mm", "1", "s"], quanta=[1e-6] * 3)
    with pytest.raises(StudyError, match="about 'length' in 'm', but here it is in 'mm'"):
        Preference.fit(units, prior=prior)
    bent = [Preference.fit(stretched([f, 1, 1]), features={"length": "log"}, count=1_000) for f in (1.0, 1.05, 3.0)]
    assert len(People(bent[:2])) == 2
    with pytest.raises(StudyError, match="so their shares say nothing here"):
        People(bent[1:])
    with pytest.raises(StudyError, match="in 'log m', but here it is in 'm'"):
        People([bent[0], Preference.fit(FRONT, count=1_000)])
    person = Preference.fit(stretched([3, 1, 1]), [(3, 9)], prior=prior, count=1_000)
    person.save(tmp_path / "p.json")
    assert Preference.load(tmp_path / "p.json").prior == person.prior
