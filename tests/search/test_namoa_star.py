"""Claims: the published algorithm gives the front and its paths (against the closure: test_pareto_paths)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hpop.search import Graph, pareto_paths
from tests.search.namoa_star import covers, ideal_cost_to_go, namoa_star


def test_paths_have_the_costs_they_claim(lattice):
    graph = lattice(1, 4)
    for cost, nodes in namoa_star(graph, 0, graph.nodes - 1):
        total = np.zeros(3, np.int64)
        for tail, head in pairwise(nodes):
            at = range(graph.indptr[tail], graph.indptr[tail + 1])
            total += graph.costs[next(a for a in at if graph.heads[a] == head)]
        assert tuple(total.tolist()) == cost


def test_it_agrees_with_the_fast_search_on_a_lattice(lattice):
    for seed in range(4):
        graph = lattice(seed, 6)
        expected = pareto_paths(graph, 2, graph.nodes - 3).costs.tolist()
        assert [list(cost) for cost, _ in namoa_star(graph, 2, graph.nodes - 3)] == expected


def test_the_ideal_point_is_consistent(lattice):
    graph = lattice(5, 4)
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    for j in range(3):
        h = ideal_cost_to_go(graph, {7}, j)
        for tail, head, cost in zip(tails.tolist(), graph.heads.tolist(), graph.costs[:, j], strict=True):
            assert head not in h or h[tail] <= cost + h[head]


def test_no_way_is_no_path():
    assert namoa_star(Graph.from_arcs(2, [1], [0], [[1, 1]]), 0, [1]) == []


def test_a_vector_covers_itself():
    assert covers((1, 2, 3), (1, 2, 3))
