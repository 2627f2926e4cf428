"""Claims: a graph maps back to the caller's arcs and names, and what makes no sense is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.errors import GraphError
from hpop.search import Graph, pareto_paths


@pytest.mark.parametrize("n", [5, 70_000, 200_000])
def test_arcs_are_sorted_by_tail_and_keep_their_order(n):
    rng = np.random.default_rng(n)
    tails, heads = rng.integers(0, n, (2, 3000))
    costs = rng.integers(0, 100, (3000, 2))
    graph = Graph.from_arcs(n, tails, heads, costs)
    np.testing.assert_array_equal(graph.arc, np.argsort(tails, kind="stable"))
    np.testing.assert_array_equal(graph.heads, heads[graph.arc])
    np.testing.assert_array_equal(graph.costs, costs[graph.arc])
    np.testing.assert_array_equal(np.repeat(np.arange(n), np.diff(graph.indptr)), np.sort(tails))


def test_a_graph_is_frozen_and_owns_its_arrays():
    costs = np.array([[1], [2]])
    graph = Graph.from_arcs(2, [0, 1], [1, 0], costs)
    costs[:] = 9
    assert graph.costs.tolist() == [[1], [2]]
    with pytest.raises(ValueError, match="read-only"):
        graph.costs[0, 0] = 3


def test_unsigned_and_small_integers_are_taken():
    graph = Graph.from_arcs(2, np.array([0], np.uint8), np.array([1], np.uint16), np.array([[7]], np.uint64))
    assert graph.costs.dtype == np.int64


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((2, [0], [1], [[1.5]]), "quantise first"),
        ((2, [0], [1], [[-1, 2]]), "non-negative, got -1 at arc 0, cost 0"),
        ((2, [0], [2], [[1]]), "heads must be nodes from 0 to 1, got 2 at arc 0"),
        ((2, [-1], [0], [[1]]), "tails must be nodes from 0 to 1, got -1"),
        ((2, [0], [1], [[1] * 7]), "1 to 6 columns"),
        ((2, [0], [1], [[]]), "1 to 6 columns"),
        ((2, [0], [1], [1]), "columns"),
        ((2, [0, 1], [1], [[1]]), "one row for each arc"),
        ((0, [], [], np.zeros((0, 1), int)), "1 to"),
        ((2, [0], [1], [["a"]]), "must be integers"),
        ((2, [0], [1], [[2**63]]), "must be from"),
        ((2, [0], [1], [[2**70]]), "fit 64 bits"),
        ((2, [0], [1], [[2**60]]), "coarser quantum"),
    ],
)
def test_bad_graphs_say_what_was_expected(arguments, message):
    with pytest.raises(GraphError, match=message):
        Graph.from_arcs(*arguments)


def test_sums_that_could_overflow_are_refused_but_single_dear_arcs_are_not():
    n = 5000
    tails = np.arange(n - 1)
    costs = np.ones((n - 1, 1), np.int64)
    costs[7] = 2**55
    graph = Graph.from_arcs(n, tails, tails + 1, costs)
    assert pareto_paths(graph, 0, n - 1).costs.tolist() == [[2**55 + n - 2]]
    with pytest.raises(GraphError, match="cost 0 of a path must stay below"):
        Graph.from_arcs(n, tails, tails + 1, np.full((n - 1, 1), 2**55))
    worst = Graph.from_arcs(n, tails, tails + 1, np.full((n - 1, 1), 2**55), aggregates=["max"])
    assert pareto_paths(worst, 0, n - 1).costs.tolist() == [[2**55]]


@pytest.mark.parametrize("aggregates", [["sum"], ["sum", "mean"], ["sum", "sum", "max"], "sum"])
def test_aggregates_name_a_way_for_each_cost(aggregates):
    with pytest.raises(GraphError, match="'sum' or 'max' for each of 2 costs"):
        Graph.from_arcs(2, [0], [1], [[1, 1]], aggregates=aggregates)


@pytest.mark.parametrize("indptr", [[0, 2], [1, 1, 1], [0, 1, 0], [0, 0, 2]])
def test_offsets_must_rise_to_the_number_of_arcs(indptr):
    with pytest.raises(GraphError, match=r"indptr|heads"):
        Graph.from_csr(indptr, [0], [[1]])


def test_rows_given_as_csr_stay_as_they_are():
    graph = Graph.from_csr([0, 2, 2], [1, 0], [[3, 4], [5, 6]])
    assert graph.arc.tolist() == [0, 1]
    assert graph.heads.tolist() == [1, 0]
