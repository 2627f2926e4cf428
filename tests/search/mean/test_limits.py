"""Claims: bounds on other sums bound the duration, and the front of a mean within them equals brute force."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import GraphError, OptionError
from hpop.runtime.limits import Status
from hpop.search import Graph, MeanPaths, capped_mean_paths, pareto_paths

S, T = 0, 1  # columns of the integral and the duration in all graphs here
Bounds = list[int | None]
Vector = tuple[Fraction | int, ...]


def front(walks: set[tuple[int, tuple[int, ...]]], targets: set[int]) -> list[Vector]:
    """Return the non-dominated (S/T, other costs), sorted."""
    kept: list[Vector] = []
    for v in sorted({(Fraction(g[S], max(1, g[T])), *g[2:]) for node, g in walks if node in targets}):
        if not any(all(a <= b for a, b in zip(w, v, strict=True)) for w in kept):
            kept.append(v)  # what dominates came first
    return kept


def vectors(paths: MeanPaths) -> list[Vector]:
    return sorted((paths.mean(i), *map(int, paths.costs[i, 2:])) for i in range(len(paths)))


def search(graph: Graph, source: int, targets: set[int], at_most: Bounds, cap: int | None = None) -> MeanPaths:
    return capped_mean_paths(graph, source, sorted(targets), integral=S, duration=T, cap=cap, at_most=at_most)


@st.composite
def queries(draw):
    """Small graphs, bounds on some costs, and no loop that raises no bounded sum; time may pass on any arc."""
    n, k = draw(st.integers(1, 4)), draw(st.integers(3, 5))
    how = ["sum", "sum", "sum", *draw(st.lists(st.sampled_from(["sum", "max"]), min_size=k - 3, max_size=k - 3))]
    bound = st.one_of(st.none(), st.integers(0, 5))
    at_most = [None, None, draw(st.integers(0, 5)), *draw(st.lists(bound, min_size=k - 3, max_size=k - 3))]
    node = st.integers(0, n - 1)
    rows = draw(st.lists(st.tuples(node, node, *[st.integers(0, 3)] * k), max_size=8))
    table = np.array(rows, np.int64).reshape(len(rows), 2 + k)
    paying = [2 + j for j in range(2, k) if at_most[j] is not None and how[j] == "sum"]
    nothing = (table[:, paying] == 0).all(axis=1)
    table[nothing & ((table[:, 1] <= table[:, 0]) | (table[:, 2 + T] > 0)), 4] = 1
    table[table[:, 2 + T] == 0, 2 + S] = 0
    graph = Graph.from_arcs(n, table[:, 0], table[:, 1], table[:, 2:], aggregates=how)
    return graph, draw(node), draw(st.sets(node, min_size=1, max_size=2)), at_most


@given(queries())
def test_the_front_equals_brute_force_over_all_walks_within_the_bounds(walks_within, query):
    graph, source, targets, at_most = query
    walks = walks_within(graph, source, at_most)
    paths = search(graph, source, targets, at_most)
    expected = front(walks, targets)
    assert vectors(paths) == expected
    assert paths.status is (Status.COMPLETE if expected else Status.NO_PATH)
    assert max(g[T] for _, g in walks) <= paths.cap
    bounds = np.array([np.inf if b is None else b for b in at_most])
    assert (paths.costs <= bounds).all()


@given(queries(), st.integers(0, 9))
def test_a_cap_and_bounds_hold_together(walks_within, query, cap):
    graph, source, targets, at_most = query
    expected = front(walks_within(graph, source, [None, cap, *at_most[2:]]), targets)
    paths = search(graph, source, targets, at_most, cap)
    assert vectors(paths) == expected
    assert paths.cap == cap


@pytest.mark.parametrize(("length", "turns"), [(1.0, 5), (1.2, 4), (1.4, 3), (1.3, 5)])
@pytest.mark.seeds(2, of=4)
def test_lattices_equal_brute_force(lattice, walks_within, seed, length, turns):
    full = lattice(seed, 3)
    tails = np.repeat(np.arange(full.nodes), np.diff(full.indptr))
    rate, turned, far = full.costs.T
    angle = np.abs(tails - full.heads) % 4
    time = np.where(turned > 0, np.where(angle == 2, 4, 3), 2 * far)
    graph = Graph.from_csr(full.indptr, full.heads, np.stack([rate * time, time, turned, far], axis=1))
    targets = {graph.nodes - 1, graph.nodes - 4}
    least = pareto_paths(graph, 0, sorted(targets)).costs[:, 3].min()
    at_most = [None, None, turns, int(length * least)]
    paths = search(graph, 0, targets, at_most)
    assert vectors(paths) == front(walks_within(graph, 0, at_most), targets)
    assert paths.cap == 4 * turns + 2 * int(length * least)


def test_spinning_is_worth_while_as_often_as_turns_allow():
    """A way of 6 s at a rate of 1/2; where it begins turning there and back takes 2 s and adds nothing."""
    turns = [[0, 1, 1, 0], [0, 1, 1, 0]]
    graph = Graph.from_arcs(3, [0, 1, 0], [1, 0, 2], [*turns, [3, 6, 0, 5]])
    for most in range(7):
        paths = search(graph, 0, {2}, [None, None, most, 5])
        assert vectors(paths) == sorted((Fraction(3, 6 + n), n, 5) for n in range(0, most + 1, 2))
        assert paths.cap == 6 + most


def test_the_first_bounded_sum_that_an_arc_raises_pays_for_it():
    arcs = [[0, 5, 1, 0], [0, 4, 0, 2], [0, 6, 2, 9], [0, 1, 0, 1]]
    graph = Graph.from_arcs(2, [0] * 4, [1] * 4, arcs)
    assert search(graph, 0, {1}, [None, None, 3, 7]).cap == 5 * 3 + 2 * 7
    assert search(graph, 0, {1}, [None, None, 3, 7], cap=8).cap == 8


@pytest.mark.parametrize("at_most", [(), [None, None, 3, None], [None, None, None, 7]])
def test_bounds_that_leave_time_without_end_are_refused(at_most):
    graph = Graph.from_arcs(2, [1, 0, 0], [1, 0, 1], [[0, 0, 0, 0], [0, 1, 1, 0], [1, 2, 0, 3]])
    with pytest.raises(GraphError, match=r"arc [12] takes time and raises no sum that at_most bounds.*give cap, or"):
        search(graph, 0, {1}, at_most)


def test_a_worst_arc_pays_for_nothing():
    graph = Graph.from_arcs(2, [0], [1], [[1, 2, 3]], aggregates=["sum", "sum", "max"])
    with pytest.raises(GraphError, match="arc 0 takes time and raises no sum"):
        search(graph, 0, {1}, [None, None, 5])


@pytest.mark.parametrize("at_most", [[3], [None, None, -1], [None, None, 1.5], [None, None, True], [2, None, 3]])
def test_bounds_that_make_no_sense_are_refused(at_most):
    graph = Graph.from_arcs(2, [0], [1], [[1, 1, 1]])
    with pytest.raises(
        OptionError,
        match=r"at_most must be a whole number (or None for each of 3 costs|of at least 0)",
    ):
        search(graph, 0, {1}, at_most)
