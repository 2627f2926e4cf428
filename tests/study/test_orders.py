"""Orders are balanced: counted, for every number of stimuli from 2 to 8."""

from __future__ import annotations

from itertools import pairwise, permutations, product

import numpy as np
import pytest

from hpop.errors import StudyError
from hpop.study.participants import neighbours, places, sequences

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
