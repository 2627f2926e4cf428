from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hpop.frontier import additive_epsilon, hypervolume

points = st.integers(1, 4).flatmap(
    lambda k: st.tuples(
        hnp.arrays(np.int64, (6, k), elements=st.integers(0, 4)),
        hnp.arrays(np.int64, (4, k), elements=st.integers(0, 4)),
    )
)


def unit_cells_covered(Y, corner):
    """Count the unit cells below the corner that some row covers: the hypervolume of integer points."""
    cells = np.stack(np.meshgrid(*[np.arange(corner)] * Y.shape[1], indexing="ij"), axis=-1)
    return sum((cell >= Y).all(axis=1).any() for cell in cells.reshape(-1, Y.shape[1]))


@given(points)
def test_hypervolume_of_integer_points_counts_unit_cells(pair):
    Y, _ = pair
    assert hypervolume(Y, [5] * Y.shape[1]) == pytest.approx(unit_cells_covered(Y, 5), abs=1e-9)


def test_hypervolume_of_a_staircase_by_hand():
    # Columns of width 1 under the corner (4, 4): heights 4-3, 4-2, 4-1.
    assert hypervolume([[1, 3], [2, 2], [3, 1]], [4, 4]) == 1 + 2 + 3


def test_hypervolume_of_two_boxes_by_inclusion_and_exclusion():
    assert hypervolume([[0, 1, 2], [1, 0, 1]], [2, 3, 3]) == 2 * 2 * 1 + 1 * 3 * 2 - 1 * 2 * 1


def test_points_not_below_the_reference_add_nothing():
    assert hypervolume([[0.0, 0.0], [2.0, -5.0]], [1.0, 1.0]) == 1.0
    assert hypervolume(np.zeros((0, 2)), [1.0, 1.0]) == 0.0


@given(points)
def test_epsilon_is_the_least_shift_that_covers(pair):
    Y, reference = pair
    shift = additive_epsilon(Y, reference)

    def covers(e):
        return all((row + e >= Y).all(axis=1).any() for row in reference)

    assert covers(shift)
    assert not covers(shift - 1)  # integer points: no smaller whole shift


def test_epsilon_of_a_front_against_itself_is_zero():
    Y = [[1.0, 3.0], [2.0, 2.0]]
    assert additive_epsilon(Y, Y) == 0.0


def test_an_empty_front_covers_nothing():
    assert additive_epsilon(np.zeros((0, 2)), [[1.0, 1.0]]) == np.inf
    with pytest.raises(ValueError, match="at least one row"):
        additive_epsilon([[1.0, 1.0]], np.zeros((0, 2)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_only_finite_costs_are_measured(bad):
    for measure in (hypervolume, additive_epsilon):
        with pytest.raises(ValueError, match=r"finite|NaN"):
            measure([[bad, 1.0]], np.array([[1.0, 1.0]]))


def test_fronts_of_different_dimension_are_refused():
    with pytest.raises(ValueError, match="2 and 3"):
        hypervolume([[1.0, 1.0]], [1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="2 and 3"):
        additive_epsilon([[1.0, 1.0]], [[1.0, 1.0, 1.0]])
