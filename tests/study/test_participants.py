"""Claims: orders and strata are as equally frequent as can be; ids, strata and successions say nothing of a person."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import StudyError
from hpop.study.participants import checked_id, checked_strata, enrolled, unequal


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
