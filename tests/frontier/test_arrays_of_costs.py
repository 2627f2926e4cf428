"""Claims: plain arrays of costs can be filtered, measured and chosen from, and become a front without further words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import hpop
from hpop import frontier
from hpop.frontier import FrontError, ItemFront

costs = st.tuples(st.integers(1, 8), st.integers(1, 4)).flatmap(
    lambda shape: hnp.arrays(np.int64, shape, elements=st.integers(0, 5))
)


@given(costs)
def test_what_is_filtered_out_is_covered_and_what_stays_is_not(Y):
    kept = frontier.filter(Y)
    assert all((kept <= row).all(axis=1).any() for row in Y)
    assert not any(frontier.dominates(a, b) for a in kept for b in kept)
    assert len(np.unique(kept, axis=0)) == len(kept)


@given(costs, st.integers(-3, 3))
def test_a_knee_is_a_row_of_the_front_whatever_else_is_there(Y, shift):
    row = frontier.knee(Y)
    assert Y[row].tolist() in frontier.filter(Y).tolist()
    worse = np.vstack([Y + 7, Y])  # nothing of the first half is on the front
    assert worse[frontier.knee(worse)].tolist() == Y[row].tolist()
    assert frontier.knee(Y * 2.5 + shift) == row


@given(costs)
def test_a_knee_of_an_array_is_that_of_its_front(Y):
    front = ItemFront.of(Y)
    assert Y[frontier.knee(Y)].tolist() == list(front.knee().costs.values())


@given(costs)
@example(np.array([[4, 4, 4, 4], [0, 4, 4, 4], [4, 3, 4, 4]]))  # the first row changed the last digit
def test_without_a_reference_all_of_the_front_counts_and_nothing_else(Y):
    volume = frontier.hypervolume(Y)
    kept = frontier.filter(Y)
    assert volume == frontier.hypervolume(Y, frontier.default_reference(Y)) == frontier.hypervolume(kept)
    for row in range(len(kept)):  # each point has a part of its own
        rest = np.delete(kept, row, axis=0)
        assert frontier.hypervolume(rest, frontier.default_reference(Y)) < volume


def test_the_default_reference_is_a_tenth_of_the_range_beyond_the_nadir_of_the_front():
    assert frontier.default_reference([[0, 30], [20, 10], [90, 90]]).tolist() == [22.0, 32.0]
    assert frontier.default_reference([[4, 7], [4, 7]]).tolist() == [5.0, 8.0]
    assert frontier.hypervolume([[4, 7]]) == 1.0
    assert frontier.hypervolume(np.zeros((0, 3))) == 0.0


@pytest.mark.parametrize("ask", [frontier.knee, frontier.hypervolume, frontier.filter, ItemFront.of])
def test_what_is_no_table_of_costs_is_refused(ask):
    with pytest.raises(ValueError, match=r"shape \(n, k\)"):
        ask([1.0, 2.0])
    with pytest.raises(ValueError, match="NaN in row 1, column 0"):
        ask([[1.0, 2.0], [np.nan, 1.0]])
    with pytest.raises(ValueError, match="costs must be real"):
        ask([["a", "b"]])


def test_a_knee_needs_a_row_of_finite_costs():
    with pytest.raises(FrontError, match="must have at least one row"):
        frontier.knee(np.zeros((0, 2)))
    with pytest.raises(ValueError, match="finite, got inf in row 0, column 1"):
        frontier.knee([[1.0, np.inf]])


def test_a_front_of_an_array_alone():
    front = ItemFront.of([[3.0, 0.5], [1.0, 0.75], [4.0, 0.5]])
    assert (front.names, front.units, front.items) == (("f1", "f2"), ("1", "1"), (1, 0))
    assert (front.status, front.certificate) == ("complete", "the non-dominated ones of 3 candidates")
    assert front.quanta.tolist() == [1.0, 1e-10]
    assert front.best("f2").item == 0
    assert len(ItemFront.of(np.zeros((0, 2)))) == 0


def test_a_front_takes_names_units_and_labels():
    front = ItemFront.of([[3.0, 0.5], [1.0, 0.75]], ["left", "right"], names=["length", "risk"], units=["m", "1"])
    assert repr(front).startswith("<Front: 2 points of length [m], risk [1]; complete")
    assert front.where(length="<2")[0].item == "right"


@pytest.mark.parametrize("maximise", [["gain"], [False, True], np.array([False, True]), "gain"])
def test_what_is_maximised_is_kept_with_a_minus(maximise):
    X = np.array([[3.0, 0.5], [1.0, 0.25], [4.0, 0.125]])
    front = ItemFront.of(X, names=["cost", "gain"], maximise=maximise)
    assert front.names == ("cost", "-gain")
    assert front.costs.tolist() == [[1.0, -0.25], [3.0, -0.5]]


@pytest.mark.parametrize(
    ("maximise", "message"),
    [
        (["gian"], "must be names of costs, or a bool for each of cost, gain"),
        ([True], "got 1 bools"),
        (True, "bool for each"),
    ],
)
def test_a_column_to_maximise_that_is_not_there_is_refused(maximise, message):
    with pytest.raises(FrontError, match=message):
        ItemFront.of([[1.0, 2.0]], names=["cost", "gain"], maximise=maximise)


def test_a_table_of_pandas_brings_its_names():
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"length": [3.0, 1.0], "risk": [0.5, 0.75]})
    front = ItemFront.of(table)
    assert front.names == ("length", "risk")
    assert ItemFront.of(front.to_dataframe()).costs.tolist() == front.costs.tolist()


def test_values_that_differ_by_the_order_of_a_sum_are_one_value():
    assert len(ItemFront.of([[0.1 + 0.2, 1.0], [0.3, 1.0]])) == 1
    assert len(ItemFront.of([[0.3 + 1e-6, 1.0], [0.3, 1.5]])) == 2


def test_a_front_of_trajectories_has_no_numbers_in_their_place():
    with pytest.raises(FrontError, match=r"hpop\.frontier\.ItemFront\.of"):
        hpop.Front.of([[1.0, 2.0]])
