"""Claims: turns taken at once lose no vector, whatever else they cost, and save labels; limits stop this search too."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.base.arrays import IntArray
from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, pareto_paths
from hpop.search.general.search import General
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from tests.walks import check_walks

FREE = 2  # column of the lattice's length, which turns do not raise
TURNS = 1
DEAR = 4  # what a turn costs in every column where none is free


def dearer(full: Graph, seed: int, free: bool) -> Graph:
    """Add up to three costs in any order: a turn's angle, random sums, the worst of either kind."""
    rng = np.random.default_rng(seed)
    tails = np.repeat(np.arange(full.nodes), np.diff(full.indptr))
    turn = full.costs[:, TURNS] > 0
    angle = np.minimum((tails - full.heads) % 4, (full.heads - tails) % 4) * turn
    place = rng.integers(0, 6, full.nodes // 4)[full.heads // 4]
    more = [angle, place * angle + rng.integers(0, 10, full.arcs) * ~turn, rng.integers(0, 9, full.arcs) * ~turn, place]
    hows = ["sum", "sum", "max", "max"]
    taken = rng.permutation(4)[: rng.integers(1, 4)]
    costs = np.column_stack([full.costs, *(more[i] for i in taken)])
    if not free:
        costs[turn] += DEAR * (np.arange(costs.shape[1]) != TURNS)
    how = ["sum"] * 3 + [hows[i] for i in taken]
    order = rng.permutation(costs.shape[1])
    return Graph.from_csr(full.indptr, full.heads, costs[:, order], aggregates=[how[j] for j in order])


@pytest.mark.cases("1-True", "2-False", "3-False", "4-True")
@pytest.mark.parametrize("free", [True, False])
@pytest.mark.seeds(3, of=range(1, 20))
def test_fronts_of_lattices_with_four_to_six_costs_are_those_of_the_closure(closure, lattice, seed, free):
    graph = dearer(lattice(seed, 6, seed % 3), seed, free)
    source, targets = seed % 4, [graph.nodes - 1 - seed % 4, graph.nodes - 29]
    paths = pareto_paths(graph, source, targets)
    assert [tuple(row) for row in paths.costs.tolist()] == closure(graph, source, set(targets))
    check_walks(graph, paths, source, set(targets))


def searched(graph: Graph, targets: IntArray, groups: Groups, clock: Clock) -> tuple[IntArray, int]:
    """Return the front and the number of labels."""
    h, _, _ = lower_bounds(graph, 1, targets, clock, groups)
    search = General(graph, 1, targets, h, (FREE, 0, TURNS), groups, clock)
    search.run(clock)
    costs, _, generated, _, _ = search.results()
    return costs, generated


@pytest.mark.parametrize("seed", range(4))
def test_turns_taken_at_once_halve_the_labels_of_the_same_search(lattice, seed):
    graph, clock = lattice(seed, 10), Clock(Budget(), None)
    targets = np.arange(graph.nodes - 4, graph.nodes)
    front, labels = searched(graph, targets, Groups.of(graph, clock), clock)
    same, more = searched(graph, targets, Groups.single_nodes(graph, clock), clock)
    assert front.tolist() == same.tolist()
    assert 2 * labels < more


def test_the_search_begins_with_the_sum_of_most_values_that_is_free_of_turns(lattice):
    full = lattice(3, 6)
    turn = full.costs[:, TURNS] > 0
    many = np.random.default_rng(0).integers(0, 1000, full.arcs)
    columns = [full.costs, many * ~turn, many // 10 * ~turn, np.where(turn, 500, many)]
    graph = Graph.from_csr(full.indptr, full.heads, np.column_stack(columns), aggregates=[*["sum"] * 4, "max", "sum"])
    assert pareto_paths(graph, 0, graph.nodes - 1).stats.order[:3] == (3, FREE, 4)  # the maximum last of those


def test_a_stopped_search_has_part_of_the_front_and_misses_no_more_than_it_says(lattice):
    graph = dearer(lattice(3, 14), 23, free=True)
    exact = pareto_paths(graph, 0, graph.nodes - 2)
    for share in (4, 2):
        budget = Budget(max_labels=exact.stats.labels_generated // share)
        part = pareto_paths(graph, 0, graph.nodes - 2, budget=budget)
        assert part.status is Status.LABEL_LIMIT
        assert set(map(tuple, part.costs.tolist())) <= set(map(tuple, exact.costs.tolist()))
        assert len(part)
        covered = (part.costs <= (1 + part.gap) * exact.costs[:, None] + 1e-9).all(axis=2).any(axis=1)
        assert covered.all()
