"""Graphs that repeat a base in layers, as tours need them: against graphs with copies of all arcs."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, pareto_paths, supported_paths
from hpop.search.general.search import General
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds
from hpop.search.machinery.plain_bounds import plain_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from tests.search.namoa_star import ideal_cost_to_go
from tests.search.test_extended import turning, with_ends

LAYERS = 4


def streets(rng: np.random.Generator, criteria: int) -> Graph:
    """Return a strongly connected random graph without turns; the last cost is the worst of a path."""
    n = 60
    ring = np.arange(n), (np.arange(n) + 1) % n
    tails, heads = (np.append(own, rng.integers(0, n, 150)) for own in ring)
    costs = rng.integers(1, 40, (tails.size, criteria))
    return Graph.from_arcs(n, tails, heads, costs, aggregates=["sum"] * (criteria - 1) + ["max"])


def in_layers(base: Graph, rng: np.random.Generator, *, is_reused: bool, climbing: int = 0) -> Graph:
    """Return a graph with LAYERS copies of a base, arcs that lead to later copies, and two more nodes.

    climbing  largest cost of the arcs between copies
    """
    n, more = base.nodes, 2
    tails = np.sort(rng.integers(0, (LAYERS - 1) * n, 12 * LAYERS))
    heads = tails % n + rng.integers(tails // n + 1, LAYERS) * n
    last = np.sort(rng.integers((LAYERS - 1) * n, LAYERS * n, 4))
    tails, heads = np.append(tails, last), np.append(heads, LAYERS * n + np.arange(4) % more)
    costs = rng.integers(0, climbing + 1, (tails.size, base.criteria))
    return base.extended(LAYERS * n + more, tails, heads, costs, is_reused=is_reused, layers=LAYERS)


def made(kind: str, seed: int, *, is_reused: bool) -> Graph:
    rng = np.random.default_rng(seed)
    match kind:
        case "turns":
            return in_layers(turning(rng, alike=seed % 2 == 0), rng, is_reused=is_reused)
        case "turns with ends":
            base = with_ends(turning(rng, alike=seed % 2 == 0), rng, is_reused=True)
            return in_layers(base, rng, is_reused=is_reused)
        case "climbs that turn":
            return in_layers(turning(rng, alike=True), rng, is_reused=is_reused, climbing=1)
        case "three costs":
            return in_layers(streets(rng, 3), rng, is_reused=is_reused, climbing=9)
        case _:
            return in_layers(streets(rng, 4), rng, is_reused=is_reused, climbing=9)


KINDS = ["turns", "turns with ends", "climbs that turn", "three costs", "four costs"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_arcs_of_layers_are_those_of_copies(kind, seed):
    layered, copied = (made(kind, seed, is_reused=is_reused) for is_reused in (True, False))
    arcs = np.random.default_rng(seed).permutation(copied.arcs)
    heads, costs = layered.ends_and_costs(arcs)
    assert not {"heads", "costs"} & vars(layered).keys()
    assert (heads == copied.heads[arcs]).all()
    assert (costs == copied.costs[arcs]).all()
    assert {tuple(cost) for cost in layered.distinct_costs.tolist()} == {tuple(cost) for cost in copied.costs.tolist()}
    for name in ("nodes", "indptr", "heads", "costs", "arc", "largest"):
        assert np.array_equal(getattr(layered, name), getattr(copied, name)), name


@pytest.mark.parametrize("kind", KINDS[:3])
@pytest.mark.parametrize("seed", range(3))
def test_bounds_of_layers_are_the_scalar_optima(kind, seed):
    graph = made(kind, seed, is_reused=True)
    for _ in range(2):  # the second time, arcs sorted for the first are at hand
        h, _, _ = lower_bounds(graph, seed, np.array([graph.nodes - 1]), Clock(Budget(), None))
        for j in range(graph.criteria):
            expected = ideal_cost_to_go(graph, {graph.nodes - 1}, j)
            assert h[j].tolist() == [expected.get(v, int(UNREACHABLE)) for v in range(graph.nodes)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("options", [{}, {"eps": 0.1}, {"method": "general"}], ids=str)
@pytest.mark.seeds(1, of=4)
def test_fronts_of_layers_are_those_of_copies(kind, options, seed):
    layered, copied = (made(kind, seed, is_reused=is_reused) for is_reused in (True, False))
    source, targets = seed, [copied.nodes - 1, copied.nodes - 2]
    shared, whole = (pareto_paths(graph, source, targets, **options) for graph in (layered, copied))
    assert shared.costs.tolist() == whole.costs.tolist()
    assert shared.stats.method == whole.stats.method
    assert shared.stats.labels_generated == whole.stats.labels_generated
    assert len(whole)
    for i, path in enumerate(shared.places):
        assert path.tolist() == whole.places[i].tolist()
        assert shared.nodes(i).tolist() == whole.nodes(i).tolist()


@pytest.mark.parametrize("kind", KINDS)
def test_other_searches_and_bounds_on_costs_give_the_fronts_of_copies(kind):
    layered, copied = (made(kind, 1, is_reused=is_reused) for is_reused in (True, False))
    ends = 1, [copied.nodes - 1, copied.nodes - 2]
    whole = pareto_paths(copied, *ends)
    middle = np.median(whole.costs, axis=0).astype(int).tolist()
    for bounds in ([middle[0], *[None] * (len(middle) - 1)], [*[None] * (len(middle) - 1), middle[-1]]):
        fronts = [pareto_paths(graph, *ends, at_most=bounds).costs.tolist() for graph in (layered, copied)]
        assert fronts[0] == fronts[1]
    left_out = np.random.default_rng(1).random(copied.arcs) < 0.1
    fronts = [pareto_paths(graph.without(left_out), *ends).costs.tolist() for graph in (layered, copied)]
    assert fronts[0] == fronts[1]
    if "max" not in copied.aggregates:
        fronts = [supported_paths(graph, *ends).costs.tolist() for graph in (layered, copied)]
        assert fronts[0] == fronts[1]


@pytest.mark.cases(but=("auto-turns", "auto-four costs"))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", ["auto", "general"])
def test_a_stopped_search_in_layers_resumes_from_its_checkpoint(kind, method, tmp_path):
    layered = made(kind, 2, is_reused=True)
    ends, file = (2, [layered.nodes - 1, layered.nodes - 2]), tmp_path / "search"
    whole = pareto_paths(layered, *ends, method=method)
    half = Budget(max_labels=whole.stats.labels_generated // 2)
    stopped = pareto_paths(layered, *ends, method=method, budget=half, checkpoint=file)
    assert stopped.status is Status.LABEL_LIMIT
    again = made(kind, 2, is_reused=True)
    resumed = pareto_paths(again, *ends, method=method, checkpoint=file)
    assert resumed.costs.tolist() == whole.costs.tolist()
    assert "costs" not in vars(again) or kind in ("turns with ends", "climbs that turn")


def nbytes(degree: int, layers: int) -> int:
    """Return the size of the arrays of a graph in layers and of a general search on it, with groups and bounds."""
    rng, n = np.random.default_rng(0), 50
    tails, heads = np.repeat(np.arange(n), degree), rng.integers(0, n, n * degree)
    base = Graph.from_arcs(n, tails, heads, rng.integers(1, 9, (n * degree, 4)))
    climbs = np.arange(layers - 1) * n
    graph = base.extended(
        layers * n, climbs, climbs + n, np.ones((layers - 1, 4), np.int64), is_reused=True, layers=layers
    )
    clock, target = Clock(Budget(), None), np.array([graph.nodes - 1])
    groups = Groups.of(graph, clock, has_arcs=False)
    h, _, _ = plain_bounds(graph, 0, target, clock, groups)
    search = General(graph, 0, target, h, (0, 1, 2, 3), groups, clock)
    arrays = [*vars(graph).values(), *graph.added, *search.arrays()]
    return groups.nbytes + h.nbytes + sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


def test_memory_of_more_layers_depends_on_their_nodes_and_not_on_their_arcs():
    more = [nbytes(degree, 64) - nbytes(degree, 32) for degree in (4, 40)]
    assert abs(more[1] - more[0]) < 32 * 50 * 2, "less than 2 bytes for each node, with 36 more arcs"
    assert more[0] < 32 * 50 * 400
