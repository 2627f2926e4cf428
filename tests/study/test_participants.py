"""Participants of a study, and the orders in which they see stimuli."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import pairwise, permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import StudyError
from hpop.study.participants import checked_id, checked_strata, enrolled, neighbours, places, sequences, unequal


def spread(counts: Iterable[int]) -> int:
    several = list(counts)
    return max(several) - min(several)


@given(st.integers(1, 12), st.lists(st.integers(2, 3), max_size=2), st.integers(1, 60), st.integers(0, 99))
def test_orders_strata_and_strata_within_orders_are_as_frequent_as_any_other_or_once_more(
    several: int, sizes: list[int], count: int, seed: int
) -> None:
    strata = {f"s{i}": [f"l{j}" for j in range(size)] for i, size in enumerate(sizes)}
    cells = list(product(*strata.values()))
    orders = [(f"o{i}",) for i in range(several)]
    if strata and count < 2 * len(cells):
        with pytest.raises(StudyError, match="a person who is alone"):
            enrolled(orders, count, strata, np.random.default_rng(seed))
        return
    people = enrolled(orders, count, strata, np.random.default_rng(seed))
    assert len(people) == len({person.id for person in people}) == count
    by_order = Counter(person.order for person in people)
    by_cell = Counter(tuple(person.strata.values()) for person in people)
    both = Counter((person.order, tuple(person.strata.values())) for person in people)
    assert spread(by_order[order] for order in orders) <= 1
    assert spread(by_cell[cell] for cell in cells) <= 1
    assert spread(both[order, cell] for order in orders for cell in cells) <= 1


def test_a_seed_gives_the_same_people_and_another_others() -> None:
    orders = [("A", "B"), ("B", "A")]
    people = [enrolled(orders, 20, {}, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert people[0] == people[1] != people[2]


@pytest.mark.parametrize(
    "name",
    [
        "Anna",
        "p7",
        "P07",
        "p07 ",
        "p07\n",
        "p07a",
        "",
        "p٠٧",
        "p12345",
        "../p07",
        "anna@example.org",
        7,
        None,
        "p07\x1b[2J",
    ],
)
def test_what_could_be_a_name_is_no_id(name: object) -> None:
    with pytest.raises(StudyError, match="names and initials are refused") as told:
        checked_id(name)
    assert "\x1b" not in str(told.value)


@pytest.mark.parametrize(
    ("strata", "match"),
    [
        ({"sex": ["f"]}, "two or more levels"),
        ({"sex": ["f", "f"]}, "two or more levels"),
        ({"sex": "fm"}, "two or more levels"),
        ({"sex": ["f", "Anna Smith"]}, "words of at most 20"),
        ({"s\x1b[2J": ["f", "m"]}, "words of at most 20"),
        ({"sex": ["f", 3]}, "words of at most 20"),
        ({f"s{i}": ["a", "b"] for i in range(7)}, "at most 64 combinations"),
    ],
)
def test_strata_are_a_few_words(strata: dict[str, list[str]], match: str) -> None:
    with pytest.raises(StudyError, match=match) as told:
        checked_strata(strata)
    assert "\x1b" not in str(told.value)


def test_orders_that_are_short_are_named() -> None:
    orders = [("A", "B"), ("B", "A"), ("A", "B")]
    assert unequal(orders, [("A", "B"), ("B", "A")]) == ("order B A: 1 of 2",)
    assert unequal(orders * 2 + [("B", "A")] * 2, [("A", "B"), ("B", "A")]) == ()


COUNTS = range(2, 9)


def drawn(kind, count, participants=24, seed=0):
    stimuli = [f"s{i}" for i in range(count)]
    return stimuli, sequences(kind, stimuli, participants, np.random.default_rng(seed))


@pytest.mark.parametrize(("kind", "count"), [*product(["williams", "latin", "random"], COUNTS)])
def test_each_stimulus_stands_once_in_each_order(kind, count):
    stimuli, orders = drawn(kind, count)
    assert all(sorted(order) == stimuli for order in orders)


@pytest.mark.parametrize(("kind", "count"), [*product(["williams", "latin"], COUNTS)])
def test_each_stimulus_stands_equally_often_at_each_place(kind, count):
    stimuli, orders = drawn(kind, count)
    assert set(places(orders, stimuli).ravel()) == {len(orders) // count}


@pytest.mark.parametrize("count", COUNTS)
def test_williams_orders_are_few_and_each_pair_of_neighbours_comes_equally_often(count):
    stimuli, orders = drawn("williams", count)
    assert len(set(orders)) == len(orders) == count * (1 + count % 2)
    pairs = [pair for order in orders for pair in pairwise(order)]
    times = {pair: pairs.count(pair) for pair in permutations(stimuli, 2)}
    assert set(times.values()) == {len(orders) // count}
    assert (neighbours(orders, stimuli) == [[times.get((a, b), 0) for b in stimuli] for a in stimuli]).all()


@pytest.mark.parametrize("count", [2, 3, 4])
def test_permutations_are_all_of_them(count):
    stimuli, orders = drawn("permutations", count)
    assert sorted(orders) == sorted(permutations(stimuli))


def test_the_study_of_the_paper_has_six_orders():
    assert len(drawn("permutations", 3, 36)[1]) == 6


def test_random_orders_are_one_a_participant_and_follow_from_the_seed():
    assert len(drawn("random", 5, 7)[1]) == 7
    assert drawn("random", 5, 7, seed=3) == drawn("random", 5, 7, seed=3)
    assert drawn("random", 5, 7, seed=3) != drawn("random", 5, 7, seed=4)


@pytest.mark.parametrize(
    ("kind", "count", "participants", "said"),
    [
        ("permutations", 5, 120, "all orders of 5 stimuli are 120: expected at most 4 stimuli. Take order 'williams'"),
        ("permutations", 3, 20, "needs a multiple of 6 participants, got 20: take 18 or 24"),
        ("permutations", 3, 4, "got 4: take 6, or another order"),
        ("permutation", 3, 6, "Did you mean 'permutations'"),
        ("latin", 1, 6, "an order has 2 to 26 stimuli, got 1"),
    ],
)
def test_orders_that_cannot_be_had_are_refused_with_the_way_out(kind, count, participants, said):
    with pytest.raises(StudyError) as raised:
        drawn(kind, count, participants)
    assert said in str(raised.value)
