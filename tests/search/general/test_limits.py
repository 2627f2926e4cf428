"""Claims: memory stays within its bound and a stop says how far it came; integers do not overflow up to the limit."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.errors import GraphError
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, pareto_paths
from hpop.search.general.search import General
from hpop.search.networks import MAX_SUM


def grid(side: int, criteria: int) -> Graph:
    """Random costs 1 to 10 between neighbours, both ways."""
    rng = np.random.default_rng(criteria)
    node = np.arange(side * side).reshape(side, side)
    first = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    second = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    tails, heads = np.concatenate([first, second]), np.concatenate([second, first])
    return Graph.from_arcs(side * side, tails, heads, rng.integers(1, 11, (len(tails), criteria)))


@pytest.fixture(scope="module")
def large() -> tuple[Graph, set[tuple[int, ...]]]:
    graph = grid(24, 4)
    return graph, set(map(tuple, pareto_paths(graph, 0, 575, method="general").costs.tolist()))


@pytest.mark.parametrize("limit", [300_000, pytest.param(1_000_000, marks=pytest.mark.proof), 2_000_000])
def test_a_memory_limit_bounds_what_is_allocated_and_says_how_far_it_came(large, limit, monkeypatch):
    graph, exact = large
    allocated: list[int] = []
    advance = General.advance

    def watched(search, clock, work):
        allocated.append(sum(a.nbytes for a in vars(search).values() if isinstance(a, np.ndarray)))
        return advance(search, clock, work)

    monkeypatch.setattr(General, "advance", watched)
    told: list[Progress] = []
    paths = pareto_paths(graph, 0, 575, method="general", budget=Budget(max_memory=limit), progress=told.append)
    assert paths.status is Status.MEMORY_LIMIT
    assert limit / 4 < max(allocated) <= 1.01 * limit  # all arrays count but those of the length of a vector
    last = told[-1]
    assert last.memory <= limit
    assert (last.labels, last.front) == (paths.stats.labels_generated, len(paths))
    assert last.labels > last.open > 0
    assert set(map(tuple, paths.costs.tolist())) < exact


def test_more_memory_comes_further(large):
    graph, exact = large
    found = [
        len(pareto_paths(graph, 0, 575, method="general", budget=Budget(max_memory=limit)))
        for limit in (500_000, 1_000_000, 2_000_000)
    ]
    assert found == sorted(found)
    assert found[0] < found[-1] < len(exact)


def test_costs_that_outgrow_32_bits_count_before_they_are_allocated():
    """The tables and the sets double then: a bound just above what was there before stops the search instead."""
    steps, dear = 300, 2**27
    tails = np.repeat(np.arange(steps), 2)
    graph = Graph.from_arcs(steps + 1, tails, tails + 1, np.tile([[1, 1, 0], [0, 0, dear]], (steps, 1)))
    seen: list[Progress] = []
    whole = pareto_paths(graph, 0, steps, method="general", progress=seen.append)
    assert whole.status is Status.COMPLETE
    most = max(p.memory for p in seen)
    for limit in range(most // 4, most, most // 16):
        seen.clear()
        paths = pareto_paths(graph, 0, steps, method="general", progress=seen.append, budget=Budget(max_memory=limit))
        assert paths.status is Status.MEMORY_LIMIT
        assert all(p.memory <= limit for p in seen if p.stage == "search" and p.labels)


@pytest.mark.parametrize("criteria", [1, 2, 3, 4, 5, 6])
def test_sums_are_exact_up_to_the_limit(closure, criteria):
    """Costs as large as any graph of this size may have, compared with unbounded integers."""
    steps = 5
    most = MAX_SUM // (steps + 2)
    rng = np.random.default_rng(criteria)
    tails = np.repeat(np.arange(steps), 3)
    costs = most - rng.integers(0, 4, (3 * steps, criteria))
    costs[::3] = most
    graph = Graph.from_arcs(steps + 1, tails, tails + 1, costs)
    expected = closure(graph, 0, {steps})
    paths = pareto_paths(graph, 0, steps, method="general")
    assert [tuple(row) for row in paths.costs.tolist()] == expected
    assert max(map(max, expected)) > 2**58


def test_a_path_and_two_arcs_more_may_cost_the_limit_and_no_more():
    steps = 5
    most = MAX_SUM // (steps + 2)
    for more in (0, 1):
        costs = np.full((steps, 2), most + more)
        arcs = (steps + 1, range(steps), range(1, steps + 1), costs)
        if more:
            with pytest.raises(GraphError, match=rf"cost 0 of a path must stay below {MAX_SUM}.*quantum"):
                Graph.from_arcs(*arcs)
        else:
            assert pareto_paths(Graph.from_arcs(*arcs), 0, steps).costs.tolist() == [[steps * most] * 2]


def test_a_largest_arc_may_cost_the_limit_and_no_more(closure):
    tails, heads = [0, 0, 1, 2], [1, 2, 3, 3]
    for worst in (MAX_SUM, MAX_SUM + 1):
        costs = np.array([[worst, 1, 2], [3, 2, 1], [1, 1, 2], [worst - 1, 1, 1]])
        how = ["max", "sum", "sum"]
        if worst > MAX_SUM:
            with pytest.raises(GraphError, match="cost 0 of a path must stay below"):
                Graph.from_arcs(4, tails, heads, costs, aggregates=how)
        else:
            graph = Graph.from_arcs(4, tails, heads, costs, aggregates=how)
            found = pareto_paths(graph, 0, 3, method="general").costs.tolist()
            assert [tuple(row) for row in found] == closure(graph, 0, {3})


def test_numbers_beyond_64_bits_are_named():
    with pytest.raises(GraphError, match="64 bits"):
        Graph.from_arcs(2, [0], [1], [[2**70, 1]])
    with pytest.raises(GraphError, match=f"must be from -{MAX_SUM} to {MAX_SUM}"):
        Graph.from_arcs(2, [0], [1], np.array([[2**63 + 5, 1]], np.uint64))
