"""Claims: the arrays of the search of a mean have room for what its kernel writes."""

from __future__ import annotations

import numpy as np

from hpop.runtime.limits import Budget
from hpop.search import Graph, capped_mean_paths
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.slices import N_OPEN, Clock
from hpop.search.mean import MeanLimits
from hpop.search.mean.search import CappedMean

ARCS = 1025  # one more than a heap has room for at first


def test_all_arcs_of_a_node_enter_the_heap_at_once() -> None:
    """A kernel that writes behind the heap writes anywhere."""
    graph = Graph.from_arcs(2, [0] * ARCS, [1] * ARCS, [[9, 1], *[[1, 2]] * (ARCS - 1)])  # (S, T)
    columns, target, clock = (1, 0), np.array([1]), Clock(Budget(), None)
    bounds, _, _ = lower_bounds(graph, 0, target, clock)
    known = (np.array([[1, 9], [0, 0]]), np.array([-1, 0]), 1)
    search = CappedMean(graph, 0, target, bounds, columns, MeanLimits.of(graph, columns, 2, ()), known)
    search.advance(clock, 1)
    assert search.counters[N_OPEN] == ARCS
    assert len(search.values) >= ARCS
    assert capped_mean_paths(graph, 0, 1, integral=0, duration=1, cap=2).costs.tolist() == [[1, 2]]
