"""Claims: a user waits for the kernels of the search on a clock once, whatever depends on the tick."""

from __future__ import annotations

import numpy as np

from hpop.runtime.compiled import numba
from hpop.search.graph import Graph
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.tables import TimedTables


def test_tables_have_one_type_however_many_costs_depend_on_the_tick() -> None:
    graph = Graph.from_arcs(2, [0], [1], [[3, 1]])
    long, first = np.array([4], np.int32), np.array([0], np.int32)
    passing, stood = np.array([[9, 9, 0]]), np.zeros((2, 3), np.int64)
    types = {
        numba.typeof(TimedTables.of(TimedGraph(graph, long, 2, timed=first, costs=costs, standing=standing)))  # type: ignore[no-untyped-call]
        for costs in ({}, {1: passing}, {0: passing, 1: passing})
        for standing in ({}, {0: stood}, {0: stood, 1: stood})
    }
    assert len(types) == 1
