"""Claims: a start and a goal beside the groups, joined to them by arcs that turn and move, cost the search nothing."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.runtime.limits import Budget
from hpop.search import Graph, pareto_paths
from hpop.search.machinery import slices
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import SIZE, Groups
from hpop.search.staircase import search as staircase
from hpop.search.staircase.search import Staircase


def test_the_groups_are_those_of_the_lattice_alone(beside):
    graph, _, _ = beside(0, 4)
    groups = Groups.of(graph, Clock(Budget(), None))
    assert groups.step == 1
    assert groups.rows[:, SIZE].tolist() == [4] * 16 + [1, 1]
    assert sorted(groups.origin.tolist()) == sorted(set(range(graph.arcs)) - set(turns(graph)))


def turns(graph: Graph) -> list[int]:
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    return np.flatnonzero((tails // 4 == graph.heads // 4) & (graph.heads < graph.nodes - 2)).tolist()


@pytest.mark.cases("0-general", "1-staircase", "2-general", "3-staircase")
@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize("seed", range(8))
def test_fronts_are_those_of_the_closure(beside, closure, seed, method):
    graph, start, goal = beside(seed, 5)
    paths = pareto_paths(graph, start, goal, method=method)
    assert [tuple(row) for row in paths.costs.tolist()] == closure(graph, start, {goal})
    for i in range(len(paths)):
        assert graph.costs[paths.arcs(i)].sum(axis=0).tolist() == paths.costs[i].tolist()


@pytest.mark.parametrize(("eps", "wait"), [(0.0, "LONG"), (0.1, "SOON")])
def test_bounds_by_turns_are_taken_all_the_same_and_lose_nothing(beside, monkeypatch, eps, wait):
    monkeypatch.setattr(staircase, wait, 0)
    monkeypatch.setattr(slices, "WORK", 50)
    looked = []
    look_ahead = Staircase._add_bounds

    def watched(self, clock):
        look_ahead(self, clock)
        looked.append(self.layers.size > 0 or self.hull is not None)

    monkeypatch.setattr(Staircase, "_add_bounds", watched)
    for seed in range(8):
        graph, start, goal = beside(seed, 9)
        exact = pareto_paths(graph, start, goal, method="general").costs
        paths = pareto_paths(graph, start, goal, method="staircase", eps=eps)
        assert all((paths.costs <= np.floor(row * (1 + eps) + 1e-9)).all(axis=1).any() for row in exact)
        assert eps or paths.costs.tolist() == exact.tolist()
        for i in range(len(paths)):
            assert graph.costs[paths.arcs(i)].sum(axis=0).tolist() == paths.costs[i].tolist()
    assert len(looked) >= 8
    assert all(looked)
