from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.frontier import dominates, is_nondominated, quantised


def matrices(low=0, high=4, max_rows=25):
    shapes = st.tuples(st.integers(0, max_rows), st.integers(1, 6))
    return shapes.flatmap(lambda shape: hnp.arrays(np.int64, shape, elements=st.integers(low, high)))


def by_definition(Y):
    """Return the mask straight from the definition, pair by pair."""
    keep = []
    for i, row in enumerate(Y):
        dominated = any((other <= row).all() and (other < row).any() for other in Y)
        repeated = any((other == row).all() for other in Y[:i])
        keep.append(not dominated and not repeated)
    return np.array(keep, dtype=bool)


@given(matrices())
def test_mask_is_the_definition(Y):
    assert is_nondominated(Y).tolist() == by_definition(Y).tolist()


@given(matrices())
def test_every_dropped_point_is_covered_by_a_kept_one(Y):
    mask = is_nondominated(Y)
    for row in Y[~mask]:
        assert (Y[mask] <= row).all(axis=1).any()


@given(matrices())
def test_kept_points_do_not_dominate_each_other(Y):
    kept = Y[is_nondominated(Y)]
    assert not any(dominates(a, b) for a in kept for b in kept)
    assert len(np.unique(kept, axis=0)) == len(kept)


@given(matrices())
def test_filtering_a_front_keeps_all_of_it(Y):
    assert is_nondominated(Y[is_nondominated(Y)]).all()


@given(matrices(max_rows=12), st.data())
def test_infinite_costs_are_ordered_like_any_other(Y, data):
    special = data.draw(hnp.arrays(np.int64, Y.shape, elements=st.integers(0, 5)))
    floats = np.where(special == 4, np.inf, np.where(special == 5, -np.inf, Y))
    assert is_nondominated(floats).tolist() == by_definition(floats).tolist()


@given(matrices(max_rows=12))
def test_increasing_maps_of_a_cost_do_not_change_the_front(Y):
    assert is_nondominated(np.exp(3.0 * Y) - 7).tolist() == is_nondominated(Y).tolist()


@pytest.mark.cases("2", "5")
@pytest.mark.parametrize("k", [2, 3, 4, 5])
def test_mask_is_the_definition_on_larger_sets(k):
    Y = np.random.default_rng(k).integers(0, 30, (300, k))
    assert is_nondominated(Y).tolist() == by_definition(Y).tolist()


def test_integers_that_float64_cannot_tell_apart_are_told_apart():
    big = 2**60
    assert is_nondominated(np.array([[big + 1, 0], [big, 0]])).tolist() == [False, True]


def test_negative_zero_equals_zero():
    assert is_nondominated([[0.0, 1.0], [-0.0, 1.0]]).tolist() == [True, False]


def test_a_not_a_number_is_refused_by_place():
    with pytest.raises(ValueError, match="NaN in row 1, column 0"):
        is_nondominated([[1.0, 2.0], [np.nan, 0.0]])
    with np.errstate(invalid="ignore"), pytest.raises(ValueError, match="NaN"):
        is_nondominated([[np.float64(np.inf) - np.inf, 1.0]])
    with pytest.raises(ValueError, match="NaN"):
        dominates([np.nan, 1.0], [2.0, 2.0])


@pytest.mark.parametrize("Y", [[1.0, 2.0], np.zeros((3, 0)), [["a"]], [[1j]], [[True]], [[[1.0]]]])
def test_what_is_not_a_cost_matrix_is_refused(Y):
    with pytest.raises(ValueError, match="costs must be"):
        is_nondominated(Y)


def test_dominance_needs_vectors_of_equal_length():
    with pytest.raises(ValueError, match="equal length"):
        dominates([1, 2], [1, 2, 3])


def test_sums_in_another_order_are_equal_in_quanta():
    assert 0.1 + 0.2 != 0.3
    assert quantised([[0.1 + 0.2]], [1e-9]).tolist() == quantised([[0.3]], [1e-9]).tolist() == [[300000000]]


def test_halves_are_rounded_to_even():
    assert quantised([[0.5], [1.5], [2.5], [-0.5], [-1.5]], [1.0]).ravel().tolist() == [0, 2, 2, 0, -2]


@given(hnp.arrays(np.int64, (5, 3), elements=st.integers(-(2**40), 2**40)), st.integers(-10, 10))
def test_whole_quanta_are_recovered(Z, exponent):
    quanta = np.array([1.0, 0.001, 3.0]) * 2.0**exponent
    assert (quantised(Z * quanta, quanta) == Z).all()


def test_a_quantum_finer_than_float64_resolves_is_refused():
    assert quantised([[2.0**53]], [1.0]).tolist() == [[2**53]]
    with pytest.raises(ValueError, match=r"at most 2\*\*53 quanta.*row 1, column 0.*quantum above 2"):
        quantised([[1.0], [2.0**54]], [1.0])
    with pytest.raises(ValueError, match="must be at most"):
        quantised([[1e300]], [1e-300])


@pytest.mark.parametrize("quanta", [[0.0, 1.0], [-1.0, 1.0], [np.nan, 1.0], [np.inf, 1.0], [1.0], 1.0])
def test_quanta_are_positive_and_one_a_column(quanta):
    with pytest.raises(ValueError, match="quant"):
        quantised([[1.0, 2.0]], quanta)


@pytest.mark.parametrize("cost", [np.inf, -np.inf, np.nan])
def test_only_finite_costs_are_quantised(cost):
    with pytest.raises(ValueError, match="row 0, column 1"):
        quantised([[1.0, cost]], [1.0, 1.0])


@pytest.mark.parametrize("name", ["UKP/2KP50-11", "UKP/2KP50-50", "UKP/2KP50-92", "UKP/2KP100-50"])
def test_a_published_front_among_points_it_dominates_is_found_again(shared_data, name):
    folder = shared_data("voptlib_known_fronts")
    front = -np.loadtxt(folder / f"{name}.min", ndmin=2)  # profits, maximised
    info = (folder / f"{name}.info").read_text().splitlines()
    size = next(line for line in info if line.startswith("size of Pareto front"))
    assert len(front) == int(size.split(":")[1])
    rng = np.random.default_rng(5)
    worse = np.repeat(front, 3, axis=0) + rng.integers(0, 50, (3 * len(front), 2))
    mixed = rng.permutation(np.vstack([front, worse]))
    found = mixed[is_nondominated(mixed)]
    assert {tuple(row) for row in found} == {tuple(row) for row in front}
    assert len(found) == len(front)
