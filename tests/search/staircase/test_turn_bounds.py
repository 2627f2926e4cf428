"""Claim: the bounds by turns are the least rest with at most so many turns, told by relaxing until nothing changes."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.runtime.limits import Budget
from hpop.search import Graph, pareto_paths
from hpop.search.machinery import slices
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from hpop.search.staircase import search as staircase
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import LAYERS


def least_rest(graph: Graph, target: int, most: int) -> np.ndarray:
    """Least sum of cost 0 (n, most + 1) with at most m of cost 1: relax all arcs of all layers to the end."""
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    rest = np.full((graph.nodes, most + 1), np.inf)
    rest[target] = 0.0
    changed = True
    while changed:
        before = rest.copy()
        for tail, head, (cost, turn, _) in zip(tails.tolist(), graph.heads.tolist(), graph.costs.tolist(), strict=True):
            if turn <= most:
                rest[tail, turn:] = np.minimum(rest[tail, turn:], cost + rest[head, : most + 1 - turn])
        rest = np.minimum.accumulate(rest, axis=1)
        changed = not np.array_equal(before, rest)
    return rest


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_bounds_by_turns_are_exact(lattice, seed, uneven):
    graph = lattice(seed, 5)
    if uneven:  # turns of different costs, none dearer than two
        costs = graph.costs.copy()
        turn = costs[:, 1] > 0
        costs[turn, 0] = np.random.default_rng(seed).integers(3, 6, turn.sum())
        graph = Graph.from_csr(graph.indptr, graph.heads, costs)
    clock, target = Clock(Budget(), None), np.array([graph.nodes - 1])
    groups = Groups.of_turns(graph, 1, clock)
    assert groups is not None
    h, _, _ = lower_bounds(graph, 0, target, clock, groups)
    search = Staircase(graph, 0, target, h, (2, 1, 0), groups, clock)
    search._add_bounds(clock)
    assert search.layers.shape == (graph.nodes, LAYERS)
    told = search.layers[groups.new_number].astype(float)
    told[told == np.iinfo(search.dtype).max] = np.inf
    expected = least_rest(graph, int(target[0]), LAYERS - 2)
    reached = h[0] < 2**62
    np.testing.assert_array_equal(told[reached, :-1], expected[reached])
    np.testing.assert_array_equal(told[reached, -1], h[0, reached])


@pytest.mark.parametrize("seed", range(4))
def test_bounds_by_turns_are_exact_at_all_nodes_but_the_start_where_ends_are_beside_the_lattice(beside, seed):
    graph, start, goal = beside(seed, 5)
    clock, target = Clock(Budget(), None), np.array([goal])
    groups = Groups.of_turns(graph, 1, clock)
    assert groups is not None
    h, _, _ = lower_bounds(graph, start, target, clock, groups)
    search = Staircase(graph, start, target, h, (2, 1, 0), groups, clock)
    search._add_bounds(clock)
    told = search.layers[groups.new_number].astype(float)
    told[told == np.iinfo(search.dtype).max] = np.inf
    expected = least_rest(graph, goal, LAYERS - 2)
    inner = h[0, :start] < 2**62
    np.testing.assert_array_equal(told[:start][inner, :-1], expected[:start][inner])
    assert (told[start, :-1] <= expected[start]).all()


@pytest.mark.seeds(3, of=12)
def test_a_search_that_looks_ahead_finds_the_same_front(lattice, seed, monkeypatch):
    """On small graphs no search is long: let it look ahead at once, and return to Python often."""
    monkeypatch.setattr(staircase, "LONG", 0)
    monkeypatch.setattr(slices, "WORK", 200)
    looked = []
    look_ahead = Staircase._add_bounds
    monkeypatch.setattr(
        Staircase, "_add_bounds", lambda self, clock: (look_ahead(self, clock), looked.append(self.layers.size))
    )
    graph = lattice(seed, 10)
    paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase")
    assert paths.costs.tolist() == pareto_paths(graph, 0, graph.nodes - 1, method="general").costs.tolist()
    assert any(looked) or len(paths) == 0


def test_a_search_that_looks_ahead_expands_fewer_labels(lattice, monkeypatch):
    monkeypatch.setattr(slices, "WORK", 200)  # it is asked often whether it is long
    expanded = []
    for long in (0, staircase.LONG):
        monkeypatch.setattr(staircase, "LONG", long)
        graphs = [lattice(seed, 10) for seed in range(12)]
        paths = [pareto_paths(graph, 0, graph.nodes - 1, method="staircase") for graph in graphs]
        expanded.append([found.stats.labels_expanded for found in paths])
    assert all(ahead <= not_ahead for ahead, not_ahead in zip(*expanded, strict=True))
    assert sum(expanded[0]) < sum(expanded[1])
