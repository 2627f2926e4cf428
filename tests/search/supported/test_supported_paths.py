"""Supported paths against the exact front and linear programs in fractions."""

from __future__ import annotations

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import GraphError, OptionError
from hpop.runtime.limits import Budget, Progress, Status
from hpop.runtime.sweep import _load_mapped
from hpop.search import Graph, SupportedPaths, pareto_paths, supported_paths
from hpop.search.supported import integer_weights, simplex_lattice
from hpop.search.supported.weighted_path import encoded, weighted_path

DRAWS = ((0, 9), (1, 9), (2, 3), (2, 4), (3, 2), (7, 3))  # seed, largest cost: small ones put points inside faces


def random_graph(seed: int, k: int, size: int = 12, largest: int = 9) -> Graph:
    """Self-loops, parallel arcs, arcs of no cost; layers that follow each other, so that there are many paths."""
    rng = np.random.default_rng(seed)
    tails = rng.integers(0, size, 5 * size)
    heads = np.minimum(tails + rng.integers(-1, 4, 5 * size), size - 1)
    costs = rng.integers(0, largest + 1, (5 * size, k)) * (rng.random((5 * size, k)) < 0.8)
    return Graph.from_arcs(size, tails, np.maximum(heads, 0), costs)


def parallel(vectors: list[list[int]]) -> Graph:
    """Two nodes, and an arc of each cost between them."""
    return Graph.from_arcs(2, [0] * len(vectors), [1] * len(vectors), vectors)


def vectors(paths: Any) -> list[tuple[int, ...]]:
    return [tuple(row) for row in paths.costs.tolist()]


def check(graph: Graph, found: SupportedPaths, exact: list[tuple[int, ...]]) -> None:
    """Paths cost what they claim; the weights that each carries are minimised by it over the exact front."""
    ranges = np.maximum(found.nadir - found.ideal, 1)
    front = (np.array(exact) - found.ideal) / ranges
    inverse = np.empty(graph.arcs, np.int64)
    inverse[graph.arc] = np.arange(graph.arcs)
    for i, costs in enumerate(found.costs):
        arcs, nodes = found.arcs(i), found.nodes(i)
        assert (graph.costs[inverse[arcs]].sum(axis=0) == costs).all()
        assert (graph.heads[inverse[arcs]] == nodes[1:]).all()
        assert found.weights[i].min() >= 0
        assert found.weights[i].sum(axis=1) == pytest.approx(1)
        sums = found.weights[i] @ front.T  # (m, n)
        assert found.weights[i] @ ((costs - found.ideal) / ranges) == pytest.approx(sums.min(axis=1), abs=1e-12)
    assert sum(map(len, found.weights)) == found.solved


@pytest.mark.cases("0-9-1", "0-9-3", "1-9-2", "2-3-3", "2-3-4", "2-4-1", "3-2-4", "7-3-2")
@pytest.mark.parametrize("k", [1, 2, 3, 4])
@pytest.mark.parametrize(("seed", "largest"), DRAWS)
def test_every_extreme_supported_vector_is_found_and_nothing_unsupported(
    hull: Any, k: int, seed: int, largest: int
) -> None:
    graph = random_graph(seed, k, largest=largest)
    exact = pareto_paths(graph, 0, [10, 11])
    found = supported_paths(graph, 0, [10, 11])
    assert found.status is exact.status is Status.COMPLETE
    front = vectors(exact)
    assert hull.extreme(front) <= set(vectors(found)) <= set(front)
    assert all(hull.supported(y, front) for y in vectors(found))
    assert (found.ideal == exact.costs.min(axis=0)).all()
    if k == 2:
        assert (found.nadir == exact.costs.max(axis=0)).all()
    check(graph, found, front)


@pytest.mark.parametrize(("outside", "inside"), [(5, 2), pytest.param(20, 10, marks=pytest.mark.proof)])
def test_the_fronts_compared_have_unsupported_vectors_and_vectors_inside_faces(
    hull: Any, outside: int, inside: int
) -> None:
    unsupported = between = 0
    for k, (seed, largest) in itertools.product((2, 3, 4), DRAWS):
        front = vectors(pareto_paths(random_graph(seed, k, largest=largest), 0, [10, 11]))
        supported = {y for y in front if hull.supported(y, front)}
        unsupported += len(front) - len(supported)
        between += len(supported - hull.extreme(front))
        if unsupported >= outside and between >= inside:
            return
    pytest.fail(f"only {unsupported} vectors are unsupported, and {between} are inside faces")


@pytest.mark.parametrize("seed", range(3))
def test_it_is_so_on_lattices_too(lattice: Any, hull: Any, seed: int) -> None:
    graph = lattice(seed)
    exact = pareto_paths(graph, 0, graph.nodes - 1)
    found = supported_paths(graph, 0, graph.nodes - 1)
    front = vectors(exact)
    assert found.status == exact.status
    if front:
        assert hull.extreme(front) <= set(vectors(found)) <= {y for y in front if hull.supported(y, front)}
        check(graph, found, front)


@pytest.mark.parametrize("k", [2, 3, 4])
def test_sums_far_beyond_64_bits_are_exact(hull: Any, k: int) -> None:
    """Costs of 2^40 that differ in their last bits: facets have normals of up to 120 bits."""
    rng = np.random.default_rng(k)
    base = rng.integers(0, 6, (14, k)) * 2**40 + rng.integers(0, 3, (14, k))
    front = vectors(pareto_paths(parallel(base.tolist()), 0, 1))
    found = supported_paths(parallel(base.tolist()), 0, 1)
    assert hull.extreme(front) <= set(vectors(found))
    assert all(hull.supported(y, front) for y in vectors(found))


@given(st.data())
def test_the_path_kernel_minimises_sums_of_any_size(data: st.DataObject) -> None:
    """Against Python's integers, over parallel arcs."""
    k = data.draw(st.integers(1, 3))
    costs = data.draw(st.lists(st.lists(st.integers(0, 2**58), min_size=k, max_size=k), min_size=1, max_size=5))
    weights = data.draw(st.lists(st.integers(1, 2**90), min_size=k, max_size=k))
    sums = [sum(w * c for w, c in zip(weights, row, strict=True)) for row in costs]
    limit = min(sums) + data.draw(st.integers(-1, 1) | st.just(2**100))
    if limit < 0:
        return
    limbs, words = encoded(weights, limit, [max(column) for column in zip(*costs, strict=True)])
    heads = np.ones(len(costs), np.int32)
    is_target = np.array([0, 1], np.uint8)
    arcs = weighted_path(
        np.array([0, len(costs), len(costs)]), heads, np.array(costs, np.int64), 0, is_target, limbs, words
    )
    assert arcs.tolist() == ([sums.index(min(sums))] if min(sums) <= limit else [-1])


def test_a_dent_of_the_front_is_missed() -> None:
    """(3, 3) is non-dominated, but lies above the line from (0, 5) to (5, 0); (2, 2) lies below it."""
    assert vectors(supported_paths(parallel([[0, 5], [3, 3], [5, 0]]), 0, 1)) == [(0, 5), (5, 0)]
    assert vectors(supported_paths(parallel([[0, 5], [2, 2], [5, 0]]), 0, 1)) == [(0, 5), (2, 2), (5, 0)]


@pytest.mark.parametrize("k", [2, 3, 4])
@pytest.mark.parametrize("seed", range(3))
def test_zero_weights_give_efficient_points_by_lexicographic_order(k: int, seed: int) -> None:
    graph = random_graph(seed, k, largest=2)
    front = vectors(pareto_paths(graph, 0, 11))
    found = supported_paths(graph, 0, 11, weights=[[1] + [0] * (k - 1), [0] * (k - 1) + [2]])
    assert min(front) in vectors(found)  # least first cost, then second, ...
    assert min(front, key=lambda y: (y[-1], *y[:-1])) in vectors(found)
    assert set(vectors(found)) <= set(front)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_divisions_solve_the_simplex_lattice(hull: Any, k: int) -> None:
    graph = random_graph(1, k, largest=30)
    front = vectors(pareto_paths(graph, 0, 11))
    found = supported_paths(graph, 0, 11, divisions=4)
    assert found.solved == math.comb(4 + k - 1, k - 1)
    assert all(hull.supported(y, front) for y in vectors(found))
    check(graph, found, front)
    carried = np.rint(4 * np.concatenate(found.weights)).astype(int).tolist()
    ranges = found.nadir - found.ideal
    if ranges.min() > 0:
        assert sorted(map(tuple, carried)) == sorted(simplex_lattice(4, k))


def test_given_weights_are_those_of_normalised_costs() -> None:
    """Ideal (0, 0), nadir (10, 1000): equal weights prefer (2, 300) of sum .5 to (6, 10), of sum .61."""
    graph = parallel([[0, 1000], [10, 0], [2, 300], [6, 10]])
    found = supported_paths(graph, 0, 1, weights=[[0.5, 0.5]])
    assert vectors(found) == [(0, 1000), (2, 300), (10, 0)]
    assert found.weights[1].tolist() == [[0.5, 0.5]]
    assert (found.ideal.tolist(), found.nadir.tolist()) == ([0, 0], [10, 1000])


def test_costs_that_are_constant_decide_nothing() -> None:
    found = supported_paths(parallel([[0, 7, 4], [4, 7, 0], [1, 7, 1]]), 0, 1)
    assert vectors(found) == [(0, 7, 4), (1, 7, 1), (4, 7, 0)]
    assert found.ideal[1] == found.nadir[1] == 7


def test_no_path_and_no_way_to_go() -> None:
    graph = Graph.from_arcs(3, [0], [1], [[1, 1]])
    assert supported_paths(graph, 0, 2).status is Status.NO_PATH
    assert len(supported_paths(graph, 0, 2)) == 0
    stay = supported_paths(graph, 0, 0)
    assert (stay.status, vectors(stay), stay.nodes(0).tolist()) == (Status.COMPLETE, [(0, 0)], [0])


def test_a_worst_arc_is_refused() -> None:
    graph = Graph.from_arcs(2, [0], [1], [[1, 2]], aggregates=["sum", "max"])
    with pytest.raises(GraphError, match=r"cost 1 is a 'max'; use pareto_paths"):
        supported_paths(graph, 0, 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weights": [[0, 0]]}, "at least one number above 0"),
        ({"weights": [[1, -1]]}, "a weight must be a number of at least 0, got -1"),
        ({"weights": [[1, math.nan]]}, "a weight must be a number of at least 0, got nan"),
        ({"weights": [[1, 2, 3]]}, "one number for each of 2 costs, got 3"),
        ({"weights": [7]}, "lists of numbers"),
        ({"weights": [["a", "b"]]}, "a weight must be a number"),
        ({"divisions": 0}, "whole number"),
        ({"divisions": 2.5}, "whole number"),
        ({"divisions": True}, "whole number"),
        ({"divisions": 200_000}, "give 200,001"),
        ({"divisions": 2, "weights": [[1, 1]]}, "got both"),
    ],
)
def test_weights_that_make_no_sense_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        supported_paths(parallel([[1, 2]]), 0, 1, **options)


@given(st.lists(st.integers(0, 60), min_size=1, max_size=5).filter(any), st.floats(1e-300, 1e300))
def test_weights_keep_their_proportions(counts: list[int], scale: float) -> None:
    divisor = math.gcd(*counts)
    assert integer_weights([c / 64 * scale for c in counts]) == tuple(c // divisor for c in counts)


MANY = parallel([[i * i, (20 - i) ** 2, 7 * i % 13] for i in range(21)])


def test_the_time_limit_and_ctrl_c_keep_what_is_finished() -> None:
    everything = supported_paths(MANY, 0, 1)
    assert everything.solved > 20
    assert supported_paths(MANY, 0, 1, budget=Budget(time_limit=1e-9)).status is Status.TIME_LIMIT

    def interrupt(progress: Progress) -> None:
        if progress.stage == "weights" and progress.labels >= 10:
            raise KeyboardInterrupt

    part = supported_paths(MANY, 0, 1, progress=interrupt)
    assert (part.status, part.solved) == (Status.INTERRUPTED, 10)
    assert set(vectors(part)) < set(vectors(everything))
    assert sum(map(len, part.weights)) == 10


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("options", [{}, {"divisions": 9}])
def test_results_do_not_depend_on_the_executor(workers: int, options: dict[str, Any]) -> None:
    serial = supported_paths(MANY, 0, 1, **options)
    with ThreadPoolExecutor(workers) as executor:
        there = supported_paths(MANY, 0, 1, executor=executor, **options)
    assert len(serial) > 5
    assert vectors(there) == vectors(serial)
    assert there.notes == ()
    for i in range(len(serial)):
        assert there.arcs(i).tolist() == serial.arcs(i).tolist()
        assert sorted(there.weights[i].tolist()) == sorted(serial.weights[i].tolist())


def test_workers_are_sent_32_bits_a_cost_where_reduced_ones_fit_though_paths_cost_more() -> None:
    sent = []

    class Seen(ThreadPoolExecutor):
        def submit(self, fn: Any, key: str, file: str, *rest: Any) -> Any:  # type: ignore[override]
            sent.append(_load_mapped(Path(file)).costs)
            return super().submit(fn, key, file, *rest)

    tails = np.arange(6).repeat(3)
    for most, width in ((2**30, np.int32), (2**40, np.int64)):
        costs = np.tile([[2**30, 2**30 + most], [2**30 + 1, 2**30 + 1], [2**30 + most, 2**30]], (6, 1))
        with Seen(1) as executor:
            found = supported_paths(Graph.from_arcs(7, tails, tails + 1, costs), 0, 6, executor=executor)
        assert vectors(found) == [(6 * 2**30, 6 * (2**30 + most)), (6 * (2**30 + 1),) * 2, vectors(found)[0][::-1]]
        assert sent[-1].dtype == width
        assert sent[-1].max() == most
