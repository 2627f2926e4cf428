"""Claims: groups are found where turns allow two in a row to be left out, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.planners.search import Graph
from hpop.planners.search.bounds import lower_bounds
from hpop.planners.search.slices import Clock
from hpop.planners.search.tables import build
from hpop.planners.search.turns import find_groups, most_successors
from hpop.status import Budget


def groups_of(graph: Graph) -> tuple[np.ndarray, np.ndarray, int]:
    h, _, _ = lower_bounds(graph, 0, np.arange(graph.nodes), Clock(Budget(), None))
    arcs, nodes = np.empty((graph.arcs, 4), np.int64), np.empty((graph.nodes, 3), np.int64)
    origin, group = np.empty(graph.arcs, np.int32), np.empty(graph.nodes, np.int64)
    order = np.arange(3)
    start, split = build(graph.indptr, graph.heads, graph.costs, order, 1, h, arcs, nodes, origin)
    is_max = np.array([how == "max" for how in graph.aggregates])
    dearest = find_groups(start, split, arcs, is_max, group)
    return group, dearest, most_successors(start, split, arcs)


def test_the_headings_of_a_cell_are_a_group(lattice):
    graph = lattice(0, 4)
    group, dearest, fan = groups_of(graph)
    assert group.tolist() == np.repeat(np.arange(16), 4).tolist()
    assert (dearest[:, 1] == 1).all()
    assert not dearest[:, 2].any()
    assert fan <= 3 + 4


CLIQUE = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)]


def clique(extra: list[tuple[int, int]], costs: dict[tuple[int, int], int], how: str = "sum") -> Graph:
    arcs = CLIQUE + extra
    table = [[costs.get(arc, 1), 1, 0] for arc in arcs]
    return Graph.from_arcs(4, [t for t, _ in arcs], [h for _, h in arcs], table, aggregates=[how, "sum", "sum"])


@pytest.mark.parametrize(
    ("extra", "costs", "how", "found"),
    [
        ([], {}, "sum", 1),
        ([], {(0, 1): 2}, "sum", 1),
        ([], {(0, 1): 3}, "sum", 0),  # dearer than two turns
        ([], {(0, 1): 2}, "max", 0),
        ([(0, 1)], {}, "sum", 0),  # parallel turns
        ([(2, 3)], {}, "sum", 0),  # a turn out of the group
        ([(2, 3), (3, 2)], {}, "sum", 0),  # not every pair
    ],
)
def test_groups_are_checked_arc_by_arc(extra, costs, how, found):
    _, dearest, _ = groups_of(clique(extra, costs, how))
    assert len(dearest) == found
