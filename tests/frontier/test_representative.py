"""A few points represent a front: greedy hypervolume against all subsets and against volumes counted by cells."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from hpop.frontier import FrontError, ItemFront, is_nondominated, representative

BOX = 1.1


def volume(scaled):
    """Return the hypervolume of scaled rows as a sum over the cells between all their coordinates."""
    axes = [np.unique(np.append(column, BOX)) for column in scaled.T]
    corners = np.array(list(itertools.product(*(axis[:-1] for axis in axes))))
    sizes = np.prod(np.array(list(itertools.product(*map(np.diff, axes)))), axis=1)
    return sizes[(scaled[None] <= corners[:, None]).all(axis=2).any(axis=1)].sum()


def front(seed, k, n=11):
    """Return n non-dominated costs on a curved surface, in units that differ by powers of ten."""
    directions = np.random.default_rng(seed).random((n, k))
    norm = (0.5, 1.0, 2.0)[seed % 3]
    costs = directions / (directions**norm).sum(axis=1, keepdims=True) ** (1 / norm)
    assert is_nondominated(costs).all()
    return costs * 10.0 ** np.arange(k)


def scaled(costs):
    return (costs - costs.min(axis=0)) / np.ptp(costs, axis=0)


@pytest.mark.parametrize("k", [2, 3, 4])
@pytest.mark.seeds(2, of=30)
def test_each_row_adds_most_and_the_whole_has_the_guaranteed_share_of_the_best(k, seed):
    costs = front(seed, k)
    shares = scaled(costs)
    chosen = []
    for _ in range(4):
        gains = [volume(shares[[*chosen, row]]) if row not in chosen else 0.0 for row in range(len(costs))]
        chosen.append(int(np.argmax(gains)))
        assert np.sort(gains)[-2] < max(gains) - 1e-9  # no tie, which either rule could break
    rows = representative(costs, 4)
    assert rows.tolist() == sorted(chosen)
    best = max(volume(shares[list(some)]) for some in itertools.combinations(range(len(costs)), 4))
    assert volume(shares[rows]) >= (1 - 1 / np.e) * best


def test_dominated_and_equal_rows_and_constant_columns_count_for_nothing():
    costs = np.array([[0.0, 5, 10], [5, 5, 5], [5, 5, 5], [6, 5, 6], [10, 5, 0]])
    assert representative(costs, 2).tolist() == representative(costs[:, [0, 2]], 2).tolist()
    assert representative(costs, 9).tolist() == [0, 1, 4]
    assert representative([[3.0, 4.0]], 1).tolist() == [0]
    assert representative(np.zeros((0, 2)), 3).tolist() == []


def test_scales_of_the_costs_decide_nothing():
    costs = front(3, 3, 60)
    rows = representative(costs, 12)
    assert len(rows) == 12
    assert representative(costs * [1024.0, 1.0, 0.125], 12).tolist() == rows.tolist()


@pytest.mark.parametrize("count", [0, -1, 2.5, "many"])
def test_a_count_that_is_no_number_of_points_is_refused(count):
    with pytest.raises(FrontError, match="count must be a whole number of points, at least 1"):
        representative([[1, 2], [2, 1]], count)


def test_the_certificate_says_of_how_many_points_they_are():
    whole = ItemFront.of(front(1, 2), list("abcdefghijk"), certificate="exact")
    few = whole.representative(3)
    assert len(few) == 3
    assert few.certificate.startswith("selected from 11 points by greedy hypervolume (at least 63 % of ")
    assert few.certificate.endswith(": exact")
    assert [point.item for point in few] == [whole[row].item for row in representative(whole.costs, 3).tolist()]
    assert whole.representative(11) is whole
