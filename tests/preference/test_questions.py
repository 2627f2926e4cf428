"""The choice of pairs, the end of asking, and the message to a person who answers at random."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import StudyError
from hpop.frontier import ItemFront
from hpop.preference import Preference, Prior
from hpop.preference.posterior import NOTICEABLE, expected_information, least_cost_row, row_probability_and_regret
from tests import preferring as people

THREE: ItemFront[int] = ItemFront.of(
    [[0.0, 1.0], [0.3, 0.3], [1.0, 0.0]], names=["turns", "length"], quanta=[1e-6, 1e-6]
)


def test_of_three_rows_each_pair_is_asked_in_both_orders_and_then_none() -> None:
    person, shown = Preference.fit(THREE), []
    while pair := person.next_pair():
        shown.append(pair)
        person = person.told(*pair, pair[0])
    assert sorted(shown) == [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)]
    assert {frozenset(pair) for pair in shown[:3]} == {frozenset(pair) for pair in shown[3:]}  # new pairs first


def test_what_nobody_can_tell_apart_is_never_asked() -> None:
    front = people.front(158)
    person = Preference.fit(front)
    span = np.ptp(front.costs, axis=0)
    for _ in range(6):
        a, b = person.next_pair() or pytest.fail("a pair")
        assert (np.abs(front.costs[a] - front.costs[b]) / span).max() >= NOTICEABLE
        person = person.told(a, b, a)
    alike: ItemFront[int] = ItemFront.of(
        [[0.0, 1.0], [0.01, 0.99], [1.0, 0.0]], names=["turns", "length"], quanta=[1e-6, 1e-6]
    )
    assert {frozenset(pair) for pair in pairs_of(Preference.fit(alike))} == {frozenset((0, 2)), frozenset((1, 2))}


def pairs_of(person: Preference) -> set[tuple[int, int]]:
    shown = set()
    while pair := person.next_pair():
        shown.add(pair)
        person = person.told(*pair, min(pair))
    return shown


def test_left_and_right_are_drawn() -> None:
    turned = sum(
        a < b for a, b in filter(None, (Preference.fit(THREE, seed=i, count=1_000).next_pair() for i in range(80)))
    )
    assert 20 <= turned <= 60


def test_information_is_nothing_where_all_agree_and_a_bit_where_half_are_sure() -> None:
    sure = np.array([[30.0, 30.0], [30.0, -30.0], [0.0, 0.0]])  # (pairs, draws)
    told = expected_information(sure, None) / np.log(2)
    np.testing.assert_allclose(told[[0, 2]], 0.0, atol=1e-12)
    assert 0.9 < told[1] < 1.0  # but for lapses


def test_asking_stops_when_the_best_is_known_and_after_twelve_at_the_latest() -> None:
    front = people.front()
    person = Preference.fit(front)
    assert person.why_stop() == ""
    weights = 40.0 * np.array([1.0, 0.0, 0.0])
    rng, rows, n = np.random.default_rng(2), person.scale.rows_on(front), 0
    while not person.why_stop():
        pair = person.next_pair() or pytest.fail("a pair")
        person, n = person.told(*pair, people.answered(rng, *pair, rows, weights)), n + 1
    assert n < 12
    assert rows[person.best().row, 0] < 0.05
    assert person.why_stop(most=3) == "3 questions asked"


@pytest.mark.parametrize(("n", "count"), [(1, 2_000), pytest.param(50, 5_000, marks=pytest.mark.proof)])
def test_who_answers_at_random_is_told_that_no_preference_can_be_seen(n: int, count: int) -> None:
    """After 25 questions, except for the few people whose random answers look like a preference."""
    told, front = 0, people.front(158, 4)
    for i in range(n):
        start = Preference.fit(front, seed=i, count=count)
        person = people.asked(start, 25, np.zeros(4), np.random.default_rng([i, 6]))
        best = person.best()
        told += not person.can_be_seen
        assert person.can_be_seen or best.probability[best.row] < 0.3
    assert told >= 0.75 * n


def test_who_has_a_preference_is_not_told_so() -> None:
    weights = 15.0 * np.array([0.6, 0.3, 0.1])
    those = [
        people.asked(Preference.fit(people.front(), seed=i, count=2_000), 12, weights, np.random.default_rng(i))
        for i in range(1, 4)
    ]
    assert all(person.can_be_seen for person in those)
    assert np.median([person.random for person in those]) < 0.1
    assert not Preference.fit(people.front()).can_be_seen  # of nobody yet


@pytest.mark.parametrize("n", [4, pytest.param(8, marks=pytest.mark.proof)])
def test_telling_questions_find_the_best_sooner_than_random_ones(n: int) -> None:
    regrets: dict[bool, list[float]] = {True: [], False: []}
    front = people.front(158)
    for i in range(n):
        shares, sharpness, _ = people.drawn(Prior(random=0.0), 3, i)
        for telling, found in regrets.items():
            start = Preference.fit(front, seed=i, count=2_000)
            person = people.asked(start, 8, sharpness * shares, np.random.default_rng([i, 3]), telling=telling)
            costs = person.scale.rows_on(front) @ shares
            found.append((costs[person.row(front)] - costs.min()) / np.ptp(costs))
    assert np.mean(regrets[True]) < np.mean(regrets[False])


@given(st.lists(st.tuples(*[st.integers(0, 4)] * 3), min_size=2, max_size=20),
       st.tuples(*[st.integers(0, 3)] * 3).filter(any))  # fmt: skip
def test_a_dominated_row_is_never_best(rows: list[tuple[int, ...]], weights: tuple[int, ...]) -> None:
    table = np.array(rows, dtype=np.float64)
    best = table[least_cost_row(table, np.array(weights) / sum(weights))]
    assert not ((table <= best).all(axis=1) & (table < best).any(axis=1)).any()


def test_the_best_row_is_where_the_expected_cost_is_least() -> None:
    front = people.front()
    person = people.asked(Preference.fit(front), 5, 15.0 * np.array([0.2, 0.5, 0.3]), np.random.default_rng(0))
    best, rows = person.best(), person.scale.rows_on(front)
    assert best.row == front.select(preference=person).index == front.select(weights=person.weights).index
    assert best.point.costs == front[best.row].costs
    assert best.probability.sum() == pytest.approx(1.0)
    draws = person.draws
    costs = draws.shares @ rows.T
    regrets = (costs - costs.min(axis=1, keepdims=True)) / np.ptp(costs, axis=1, keepdims=True)
    np.testing.assert_allclose(best.regrets, draws.probability() @ regrets, atol=0.02)
    probability, regret = row_probability_and_regret(rows, person.equal_draws(2_000), best.row)
    assert (probability, regret) == pytest.approx((best.probability[best.row], best.regret), abs=1e-12)
    assert set(best.near) == set(np.flatnonzero(best.regrets <= best.regret + 0.02).tolist())
    assert best.near[0] == best.row


def test_ratings_count_as_pairs_in_the_person_however_they_are_scaled() -> None:
    front = people.front()
    here = Preference.fit(front, ratings={3: 7, 12: 2.5, 30: 5, 44: 5})
    there = Preference.fit(front, ratings={3: 700, 12: -1, 30: 4, 44: 4})
    assert here.weights == there.weights
    said = {(a.first, a.second): a.chosen for a in here.answers}
    assert said == {(3, 12): 3, (3, 30): 3, (3, 44): 3, (12, 30): 30, (12, 44): 44, (30, 44): None}
    assert sum(a.weight for a in here.answers) == pytest.approx(3.0)  # of four ratings
    with pytest.raises(StudyError, match="at least two"):
        Preference.fit(front, ratings={3: 1})


def test_a_threshold_finds_who_minds_turns_only_above_some() -> None:
    front = people.front(158)
    bound = float(np.median(front.costs[:, 1]))
    person = Preference.fit(front, features={"turns": bound}, count=2_000)
    assert person.scale.columns == ("length", "turns", "exposure", f"turns above {bound:g}")
    person = people.asked(person, 25, 25.0 * np.array([0.2, 0.0, 0.0, 0.8]), np.random.default_rng(5))
    shares = person.weights
    assert shares[f"turns above {bound:g}"] == max(shares.values())


def test_a_logarithmic_cost_counts_more_near_the_ideal_and_stays_monotone() -> None:
    front = people.front(158)
    scale = Preference.fit(front, features={"length": "log"}).scale
    low, span = scale.ideal[0], scale.span[0]
    costs = np.tile(front.costs[0], (7, 1))
    costs[:, 0] = low + span * np.array([-0.5, 0.0, 0.1, 0.5, 0.9, 1.0, 1.5])
    bent = scale.scaled(costs)[:, 0]
    assert (np.diff(bent) > 0).all()
    np.testing.assert_allclose(bent[[1, 5]], [0.0, 1.0], atol=1e-12)
    assert bent[2] > 0.1 > 1.0 - bent[4]


@pytest.mark.parametrize(
    ("features", "said"),
    [
        ({"turn": 6}, "Did you mean 'turns'"),
        ({"turns": "square"}, "'log' or a number"),
        ({"turns": 1e5}, "between its least and greatest value"),
    ],
)
def test_what_is_no_feature_is_refused(features: dict[str, object], said: str) -> None:
    with pytest.raises(StudyError, match=said):
        Preference.fit(people.front(), features=features)  # type: ignore[arg-type]
