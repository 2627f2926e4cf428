"""Claims: groups are found where turns allow two in a row to be left out, and only there; renumbering loses nothing."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, Groups, NoRoom


def groups_of(graph: Graph) -> Groups | None:
    return Groups.of_turns(graph, 1, Clock(Budget(), None))


def shuffled(graph: Graph, seed: int) -> tuple[Graph, np.ndarray]:
    """Return the graph with its nodes renumbered, and the new number of each node."""
    name = np.random.default_rng(seed).permutation(graph.nodes)
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    return Graph.from_arcs(graph.nodes, name[tails], name[graph.heads], graph.costs), name


def test_the_headings_of_a_cell_are_a_group(lattice):
    graph = lattice(0, 4)
    groups = groups_of(graph)
    assert groups is not None
    assert groups.rows[:, SIZE].tolist() == [4] * 16
    assert groups.nodes.tolist() == list(range(64))
    assert groups.step == 1
    assert (groups.dearest[:, 1] == 1).all()
    assert not groups.dearest[:, 2].any()


def test_groups_are_ranges_of_the_new_numbers(lattice):
    graph, name = shuffled(lattice(0, 4), 1)
    groups = groups_of(graph)
    assert groups is not None
    assert (groups.nodes[groups.new_number] == np.arange(graph.nodes)).all()
    cells = {frozenset(name[4 * cell : 4 * cell + 4].tolist()) for cell in range(16)}
    ranges = zip(groups.rows[:, OFFSET], groups.rows[:, SIZE], strict=True)
    assert {frozenset(groups.nodes[begin : begin + size].tolist()) for begin, size in ranges} == cells


def test_every_plain_arc_is_kept_and_no_turn(lattice):
    graph, _ = shuffled(lattice(3, 4), 2)
    groups = groups_of(graph)
    assert groups is not None
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    new_tails = np.repeat(np.arange(graph.nodes), np.diff(groups.start))
    assert sorted(groups.origin.tolist()) == np.flatnonzero(graph.costs[:, 1] == 0).tolist()
    assert (groups.nodes[new_tails] == tails[groups.origin]).all()
    assert (groups.nodes[groups.heads] == graph.heads[groups.origin]).all()


CLIQUE = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)]


def clique(extra: list[tuple[int, int]], costs: dict[tuple[int, int], int], how: str = "sum", turn: int = 1) -> Graph:
    arcs = CLIQUE + extra
    table = [[costs.get(arc, 1), turn if arc == (0, 1) else 1, 0] for arc in arcs]
    return Graph.from_arcs(4, [t for t, _ in arcs], [h for _, h in arcs], table, aggregates=[how, "sum", "sum"])


@pytest.mark.parametrize(
    ("extra", "costs", "how", "turn", "found"),
    [
        ([], {}, "sum", 1, True),
        ([], {(0, 1): 2}, "sum", 1, True),
        ([], {(0, 1): 3}, "sum", 1, False),  # dearer than two turns
        ([], {(0, 1): 2}, "max", 1, False),
        ([], {}, "sum", 2, False),  # counts more than the others
        ([(0, 1)], {}, "sum", 1, False),  # parallel turns
        ([(2, 3)], {}, "sum", 1, True),  # a plain arc: nothing leads on from its end
        ([(3, 2)], {}, "sum", 1, True),  # likewise: nothing leads to its begin
        ([(2, 3), (3, 2)], {}, "sum", 1, False),  # not every pair
    ],
)
def test_groups_are_checked_arc_by_arc(extra, costs, how, turn, found):
    assert (groups_of(clique(extra, costs, how, turn)) is not None) == found


def test_turns_that_differ_are_told_pair_by_pair():
    groups = groups_of(clique([], {(0, 1): 2}))
    assert groups is not None
    assert groups.alike.tolist() == [False, True, True]
    assert groups.turns[0, :9].reshape(3, 3).tolist() == [[0, 2, 1], [1, 0, 1], [1, 1, 0]]
    assert groups.dearest[0].tolist() == [2, 1, 0]


def test_groups_that_do_not_fit_the_memory_are_refused_before_it_is_taken():
    graph = Graph.from_arcs(50_000, np.arange(49_999), np.arange(1, 50_000), np.ones((49_999, 2), int))
    tight = Clock(Budget(max_memory=100_000), None)
    tracemalloc.start()
    with pytest.raises(NoRoom):
        Groups.single_nodes(graph, tight)
    h, samples, status = lower_bounds(graph, 0, np.array([49_999]), tight)
    assert (h.size, samples.size) == (0, 0)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert status is Status.MEMORY_LIMIT
    assert taken < 50_000 * 40  # what numbers the groups; bounds would take 80 bytes a node more


def cliques(kinds: np.ndarray, size: int) -> Graph:
    """Return groups of nodes in a chain; the turns of a group cost 1 to 2 by its kind."""
    random = np.random.default_rng(0).integers(1_000, 2_000, (int(kinds.max()) + 1, size, size))
    a, b = (axis.ravel() for axis in np.nonzero(~np.eye(size, dtype=bool)))
    first = size * np.arange(len(kinds))[:, None]
    chain = np.arange(0, size * (len(kinds) - 1), size)
    tails, heads = np.append((first + a).ravel(), chain), np.append((first + b).ravel(), chain + size)
    turns = np.stack([random[kinds][:, a, b].ravel(), np.ones(a.size * len(kinds), int)], axis=1)
    return Graph.from_arcs(size * len(kinds), tails, heads, np.concatenate([turns, np.tile([5, 0], (len(chain), 1))]))


def test_groups_of_a_graph_with_ends_are_refused_before_costs_of_arcs_are_copied():
    base = cliques(np.zeros(20_000, int), 2)
    graph = base.extended(base.nodes + 1, np.array([base.nodes]), np.array([0]), np.array([[1, 0]]), is_reused=True)
    before = Groups.of_turns(graph, 1, Clock(Budget(), None)).nbytes
    base.cache.pop(("plain arcs", 1))
    tight = Clock(Budget(max_memory=before - 1), None)
    tracemalloc.start()
    with pytest.raises(NoRoom):
        Groups.of_turns(graph, 1, tight)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert taken < 100_000  # the costs of the plain arcs take 320,000 bytes


@pytest.mark.parametrize(("kinds", "number"), [(3, 400), (700, 700), (1_100, 1_100)], ids=["few", "many", "all"])
def test_groups_with_equal_turns_share_their_costs(kinds, number):
    """1,100 groups of 8 nodes need a larger table than the first one."""
    kind = np.random.default_rng(1).permutation(np.arange(number) % kinds)
    graph = cliques(kind, 8)
    groups = groups_of(graph)
    assert groups is not None
    own = groups.unshared()
    assert own.turns.shape == (2, number * 64 + 1)
    assert kinds <= np.unique(groups.rows[:, 2]).size <= number
    assert groups.turns.shape[1] == 64 * np.unique(groups.rows[:, 2]).size + 1
    table = np.zeros((graph.nodes, 8), int)
    turning = graph.costs[:, 1] > 0
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    table[tails[turning], graph.heads[turning] % 8] = graph.costs[turning, 0]
    for each in (groups, own):
        for (first, size, begin), expected in zip(each.rows, table.reshape(-1, 64), strict=True):
            assert each.turns[0, begin : begin + size**2].tolist() == expected.tolist(), first
    if kinds == 3:
        assert np.unique(groups.rows[:, 2]).size == 3
