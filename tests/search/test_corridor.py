"""A large graph is searched in a corridor: it holds each path that no known path covers."""

import sys

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, pareto_paths
from hpop.search.corridor import LargeQuery, search_in_corridor
from hpop.search.machinery import Precision
from hpop.search.machinery.slices import Clock

HEADINGS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def floor(side, seed):
    """Grid of free cells with four headings: length, turns, and a risk drawn for each cell, which turns cost as well.

    The start faces right in one corner, the goal is the opposite corner with any heading.
    """
    rng = np.random.default_rng(seed)
    free = rng.random((side, side)) < 0.85
    free[:2, :2] = free[-2:, -2:] = free[1] = free[:, -2] = True
    number = np.full((side, side), -1)
    number[free] = np.arange(free.sum())
    risk = rng.integers(1, 60, (side, side))
    tails, heads, costs = [], [], []
    for y, x in np.argwhere(free).tolist():
        v = 4 * number[y, x]
        for a, (dx, dy) in enumerate(HEADINGS):
            for b in range(4):
                if a != b:
                    tails.append(v + a)
                    heads.append(v + b)
                    costs.append((0, 1, risk[y, x] * min((a - b) % 4, (b - a) % 4)))
            if 0 <= x + dx < side and 0 <= y + dy < side and free[y + dy, x + dx]:
                tails.append(v + a)
                heads.append(4 * number[y + dy, x + dx] + a)
                costs.append((10, 0, risk[y, x] + risk[y + dy, x + dx]))
    graph = Graph.from_arcs(4 * int(free.sum()), tails, heads, costs)
    return graph, 0, graph.nodes - 4 + np.arange(4)


def with_exact_ends(graph, goals):
    """Add a start with arcs to two states and a goal that is reached from two, with turns; return it with both ends."""
    n, rng = graph.nodes, np.random.default_rng(0)
    tails, heads = [int(goals[0]), int(goals[1]), n, n], [n + 1, n + 1, 0, 3]
    costs = np.c_[rng.integers(1, 9, 4), [0, 2, 1, 2], rng.integers(1, 9, 4)]
    return graph.extended(n + 2, np.array(tails), np.array(heads), costs, is_reused=True), n, np.array([n + 1])


def covers(costs, vectors, eps):
    return [bool((costs <= vector * (1 + eps)).all(axis=1).any()) for vector in vectors]


def corridor_query(graph, source, targets):
    query = LargeQuery.of(graph, source, targets, Clock(Budget(), None))
    assert query is not None
    return query


def test_every_state_of_a_path_that_no_known_path_covers_is_in_the_corridor():
    graph, source, targets = floor(5, 1)
    precision = Precision(0.02)
    known = pareto_paths(graph, source, targets).costs[::2]
    query = corridor_query(graph, source, targets)
    corridor = query.corridor(query.sweep(precision.eps), known, precision)
    before = [pareto_paths(graph, source, v, method="general").costs for v in range(graph.nodes)]
    after = [pareto_paths(graph, v, targets, method="general").costs for v in range(graph.nodes)]
    needed = [
        v
        for v in range(graph.nodes)
        if not all(covers(known, (before[v][:, None] + after[v]).reshape(-1, 3), precision.eps))
    ]
    assert len(needed) > 0
    assert set(needed) <= set(corridor.tolist())
    assert len(corridor) < graph.nodes


@pytest.mark.parametrize("has_exact_ends", [False, True])
def test_the_front_of_a_large_graph_covers_the_exact_front_with_real_paths(has_exact_ends, monkeypatch):
    for seed in range(4):
        graph, source, targets = floor(14, seed)
        if has_exact_ends:
            graph, source, targets = with_exact_ends(graph, targets)
        exact = pareto_paths(graph, source, targets)
        monkeypatch.setattr(sys.modules[pareto_paths.__module__], "LARGE", 0)
        near = pareto_paths(graph, source, targets, eps=0.03)
        monkeypatch.undo()
        assert near.status is Status.COMPLETE
        assert near.gap == 0.03
        assert all(covers(near.costs, exact.costs, 0.03))
        for i in range(len(near)):
            assert near.nodes(i)[0] == source
            assert near.nodes(i)[-1] in targets
            assert graph.ends_and_costs(near.arcs(i))[1].sum(axis=0).tolist() == near.costs[i].tolist()


def test_the_gap_at_the_source_holds_for_the_exact_front():
    graph, source, targets = floor(14, 1)
    exact = pareto_paths(graph, source, targets).costs
    query = corridor_query(graph, source, targets)
    sweep = query.sweep(0.01)
    for known in (exact[:1], exact[::5], exact[-3:]):
        gap = query.gap(sweep, known, Precision(0.01))
        assert all(covers(known, exact, gap))
    assert query.gap(sweep, exact, Precision(0.01)) < query.gap(sweep, exact[:1], Precision(0.01))


def test_a_graph_whose_arcs_are_not_turns_and_straight_runs_has_no_corridor():
    def query(tails, heads, costs, aggregates=None):
        graph = Graph.from_arcs(4, tails, heads, costs, aggregates=aggregates)
        return LargeQuery.of(graph, 0, np.array([3]), Clock(Budget(), None))

    assert query([0, 1, 2], [1, 2, 3], [[5, 0, 1], [0, 1, 4], [5, 0, 1]]) is not None
    assert query([0, 0, 2], [1, 2, 3], [[5, 0, 1], [5, 0, 4], [5, 1, 1]]) is None  # two moves from one state
    assert query([0, 2, 1], [2, 1, 3], [[5, 0, 1], [5, 0, 4], [5, 1, 1]]) is None  # a run that rises and falls
    assert query([0, 1, 2], [1, 2, 3], [[5, 0, 1], [0, 1, 4], [5, 0, 1]], ["sum", "sum", "max"]) is None


def test_a_limit_that_passes_in_the_sweep_is_a_result():
    graph, source, targets = floor(14, 0)
    clock = Clock(Budget(time_limit=1e-9), None)
    found = search_in_corridor(graph, source, targets, Precision(0.01), None, clock)
    assert (found.status, len(found), found.gap) == (Status.TIME_LIMIT, 0, np.inf)


def three_runs():
    """Three runs from node 0 to node 1: cheap in the first cost, in the last one, and between, far above both."""
    tails, heads, costs = [], [], []
    for begin, first, rest in ((2, 20, 2000), (60, 2000, 20), (120, 180, 180)):
        run = [0, *range(begin, begin + 51), 1]
        tails += run[:-1]
        heads += run[1:]
        costs += [(0, 1, 0), *[(first, 0, rest)] * 50, (0, 1, 0)]
    return Graph.from_arcs(180, tails, heads, costs)


def test_a_path_of_costs_far_above_those_of_the_best_paths_is_found(monkeypatch):
    graph = three_runs()
    exact = pareto_paths(graph, 0, 1).costs
    monkeypatch.setattr(sys.modules[pareto_paths.__module__], "LARGE", 0)
    assert pareto_paths(graph, 0, 1, eps=0.01).costs.tolist() == exact.tolist()


def test_bounds_of_zero_are_bounds(monkeypatch):
    monkeypatch.setattr(sys.modules[pareto_paths.__module__], "LARGE", 0)
    assert pareto_paths(three_runs(), 0, 1, eps=0.1, at_most=[0, 0, 0]).status is Status.NO_PATH


def test_a_gap_counts_paths_behind_a_start_of_several_turns():
    runs = [*range(10), 20], [0, *range(11, 21)]  # ten arcs of first cost 20 each, or a turn and ten arcs of 5
    tails, heads = runs[0][:-1] + runs[1][:-1], runs[0][1:] + runs[1][1:]
    costs = [(20, 0, 2)] * 10 + [(5, 1, 2)] + [(5, 0, 2)] * 9
    base = Graph.from_arcs(21, tails, heads, costs)
    graph = base.extended(22, np.array([21]), np.array([0]), np.array([[0, 2, 0]]), is_reused=True)
    exact = pareto_paths(graph, 21, 20).costs
    assert exact.tolist() == [[50, 3, 20], [200, 2, 20]]
    query = corridor_query(graph, 21, np.array([20]))
    gap = query.gap(query.sweep(0.01), exact[1:], Precision(0.01))
    assert gap >= 3.0
    assert covers(exact[1:], exact, gap) == [True, True]
