"""Claims: bounds are the exact scalar optimum a cost, for sums and bottlenecks, parallel arcs included."""

import tracemalloc

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds
from hpop.search.machinery.group_bounds import can_be_packed
from hpop.search.machinery.plain_bounds import plain_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from tests.search.namoa_star import ideal_cost_to_go


@pytest.mark.parametrize("seed", range(8))
def test_bounds_are_the_scalar_optima(seed):
    rng = np.random.default_rng(seed)
    n, m = 40, 120
    graph = Graph.from_arcs(
        n,
        rng.integers(0, n, m),
        rng.integers(0, n, m),
        rng.integers(0, [2, 9, 10**12], (m, 3)),
        aggregates=["sum", "max", "sum"],
    )
    targets = np.unique(rng.integers(0, n, 2))
    h, samples, status = lower_bounds(graph, 3, targets, Clock(Budget(), None))
    assert status is None
    for j in range(3):
        expected = ideal_cost_to_go(graph, set(targets.tolist()), j)
        assert h[j].tolist() == [expected.get(v, int(UNREACHABLE)) for v in range(n)]
        if len(samples):
            assert samples[j, j] == h[j, 3]
            assert (samples[:, j] >= h[j, 3]).all()


@pytest.mark.parametrize(("cells", "size"), [(12, 5), (2, 65)], ids=["by groups", "by nodes, as groups are too large"])
@pytest.mark.parametrize("how", ["sum", "max"])
@pytest.mark.seeds(3, of=8)
def test_bounds_are_the_scalar_optima_where_turns_make_groups(seed, how, cells, size):
    """Turns of unlike prices (metric, as groups ask), and plain arcs inside groups as well as between them."""
    rng = np.random.default_rng(seed)
    plain = 90
    tails, heads = rng.integers(0, cells * size, (2, plain))
    heads[::3] = tails[::3] // size * size + rng.integers(0, size, len(tails[::3]))
    moves = np.c_[rng.integers(0, 40, plain), np.zeros(plain, int), rng.integers(0, 3, plain)]
    place, other = np.nonzero(~np.eye(size, dtype=bool))
    corner = np.arange(cells).repeat(len(place)) * size
    place, other = corner + np.tile(place, cells), corner + np.tile(other, cells)
    price = rng.integers(5, 11, len(corner)) if how == "sum" else np.full(len(corner), 7)
    turns = np.c_[price, np.ones(len(corner), int), np.full(len(corner), 2)]
    arcs = (np.r_[tails, place], np.r_[heads, other], np.r_[moves, turns])
    graph = Graph.from_arcs(cells * size, *arcs, aggregates=[how, "sum", "sum"])
    groups = Groups.of_turns(graph, 1, Clock(Budget(), None))
    assert groups is not None
    assert can_be_packed(graph, groups) == (size == 5)
    h, _, _ = lower_bounds(graph, 0, np.array([7, 8]), Clock(Budget(), None), groups)
    for j in range(3):
        expected = ideal_cost_to_go(graph, {7, 8}, j)
        assert h[j].tolist() == [expected.get(v, int(UNREACHABLE)) for v in range(graph.nodes)]


@pytest.mark.parametrize("seed", range(8))
def test_bounds_that_stop_early_are_exact_near_the_source_and_consistent_everywhere(seed):
    rng = np.random.default_rng(seed)
    n, m = 60, [60, 150][seed % 2]
    how = ["sum", "max", "sum"]
    graph = Graph.from_arcs(
        n, rng.integers(0, n, m), rng.integers(0, n, m), rng.integers(0, [3, 9, 10**6], (m, 3)), aggregates=how
    )
    targets, clock = np.unique(rng.integers(0, n, 2)), Clock(Budget(), None)
    check_early_bounds(graph, targets, Groups.single_nodes(graph, clock))


def check_early_bounds(graph: Graph, targets: np.ndarray, groups: Groups) -> None:
    clock, n, how = Clock(Budget(), None), graph.nodes, graph.aggregates
    full, expected, _ = lower_bounds(graph, 3, targets, clock, groups)
    for _ in range(2):  # the second query takes the reversed arcs from the cache
        h, samples, status = plain_bounds(graph, 3, targets, clock, groups)
        assert status is None
        assert np.diagonal(samples).tolist() == np.diagonal(expected).tolist()
        if not len(samples):
            continue
        tails = np.repeat(np.arange(n), np.diff(graph.indptr))
        for j in range(3):
            assert (h[j] <= full[j]).all()
            near = full[j] <= samples[:, j].max()
            assert (h[j, near] == full[j, near]).all()
            assert (h[j, ~near] > samples[:, j].max()).all()
            cost, onward = graph.costs[:, j], h[j, graph.heads]
            reached = onward < UNREACHABLE
            along = np.maximum(cost, onward) if how[j] == "max" else cost + onward
            assert (h[j, tails] <= along)[reached].all()


@pytest.mark.parametrize("seed", range(6))
def test_bounds_with_groups_that_stop_early_are_exact_near_the_source_and_consistent_everywhere(seed):
    rng = np.random.default_rng(seed)
    cells, size = 300, 4
    first = size * np.arange(cells)[:, None]
    a, b = (axis.ravel() for axis in np.nonzero(~np.eye(size, dtype=bool)))
    tails, heads = rng.integers(0, cells * size, (2, 5 * cells))
    turn = rng.integers(10, 20, (1 if seed % 2 else cells, a.size))
    turns = np.stack([np.broadcast_to(turn, (cells, a.size)).ravel(), np.ones(cells * a.size, int)], axis=1)
    moves = np.stack([rng.integers(1, [3, 100][seed % 2], tails.size), np.zeros(tails.size, int)], axis=1)
    costs = np.concatenate([turns, moves])
    costs = np.stack([costs[:, 0], costs[:, 1], rng.integers(0, 50, len(costs)) * (costs[:, 1] == 0)], axis=1)
    names = rng.permutation(cells * size) if seed % 3 else np.arange(cells * size)
    graph = Graph.from_arcs(
        cells * size,
        names[np.append((first + a).ravel(), tails)],
        names[np.append((first + b).ravel(), heads)],
        costs,
        aggregates=["sum", "sum", ["sum", "max"][seed // 3]],
    )
    groups = Groups.of_turns(graph, 1, Clock(Budget(), None))
    assert groups is not None
    check_early_bounds(graph, names[rng.integers(0, cells * size, 1)], groups)


def test_parallel_arcs_do_not_add_up():
    graph = Graph.from_arcs(2, [0, 0], [1, 1], [[3], [5]])
    h, _, _ = lower_bounds(graph, 0, np.array([1]), Clock(Budget(), None))
    assert h.tolist() == [[3, 0]]


def test_a_hub_with_more_arcs_than_the_heap_has_room():
    n = 5000
    spokes = np.arange(1, n)
    graph = Graph.from_arcs(n, spokes, np.zeros(n - 1, int), (spokes % 7)[:, None])
    h, _, _ = lower_bounds(graph, 1, np.array([0]), Clock(Budget(), None))
    np.testing.assert_array_equal(h[0, 1:], spokes % 7)
    everywhere, _, _ = lower_bounds(graph, 1, np.arange(n), Clock(Budget(), None))
    assert not everywhere.any()


def test_memory_is_counted_before_it_is_taken_scratch_included():
    """The measured allocation of the bounds is at most the memory that they count beforehand."""
    rng = np.random.default_rng(3)
    graph = Graph.from_arcs(20_000, *rng.integers(0, 20_000, (2, 80_000)), rng.integers(0, 9, (80_000, 3)))
    clock = Clock(Budget(), None)
    groups = Groups.single_nodes(graph, clock)
    lower_bounds(graph, 0, np.array([1]), clock, groups)
    bounded = Clock(Budget(max_memory=clock.peak - 1), None)
    assert lower_bounds(graph, 0, np.array([1]), bounded, groups)[2] is Status.MEMORY_LIMIT
    graph = Graph.from_csr(graph.indptr, graph.heads, graph.costs)  # with nothing cached
    tracemalloc.start()
    lower_bounds(graph, 0, np.array([1]), clock)
    arrays = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.8 * clock.peak <= arrays <= clock.peak + 20_000  # the objects of a pool of threads


def test_a_limit_stops_between_costs():
    graph = Graph.from_arcs(2, [0], [1], [[1, 1]])
    assert lower_bounds(graph, 0, np.array([1]), Clock(Budget(max_memory=1), None))[2] is Status.MEMORY_LIMIT
