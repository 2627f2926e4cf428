"""Claims: a way that is best for a weight comes to its end, also where motions in place cost nothing."""

import numpy as np

from hpop.search import Graph
from hpop.search.machinery.slices import Clock
from hpop.search.queries import UNLIMITED
from hpop.search.timed.bounds import TimedJointBounds
from hpop.search.timed.calm import path_bounds
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.tables import TimedTables

ARCS = [(0, 1, 0, 1), (0, 2, 0, 1), (1, 0, 0, 1), (1, 2, 0, 1), (1, 3, 5, 1), (2, 0, 0, 1), (2, 1, 0, 1), (2, 3, 1, 10)]


def test_it_does_not_turn_in_circles_where_the_soonest_way_is_dear():
    """Three headings of a place between which turns are free; who turns to the soonest way on must turn again."""
    tails, heads, costs, ticks = np.array(ARCS).T
    stays = heads < 3
    graph = TimedGraph(
        Graph.from_arcs(4, tails, heads, costs[:, None]), ticks, 2, place=[0, 0, 0, 1], stays=stays, rate=[[0], [0]]
    )
    tables, targets, clock = TimedTables.of(graph), np.array([3]), Clock(UNLIMITED, None)
    ways, _ = path_bounds(graph, tables, 0, targets, clock)
    bounds = TimedJointBounds(graph, tables, ways, 0, targets)
    bounds.make(clock)
    assert [seed.costs.tolist() for seed in bounds.seeds[:1]] == [[1]]
