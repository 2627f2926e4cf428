"""Claims: every exact vector is covered within what was asked for, or within the gap that a stopped search proves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import OptionError
from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, ParetoPaths, pareto_paths
from hpop.search.machinery import proven_gap
from hpop.search.machinery.kernels import least_covered


def covered(exact: np.ndarray, found: np.ndarray, eps: float, tolerance: np.ndarray) -> bool:
    most = exact + np.floor(eps * exact + 1e-9) + tolerance
    return all((found <= row).all(axis=1).any() for row in most)


def attained(graph: Graph, paths: ParetoPaths) -> bool:
    """Check that each path has the claimed costs by its own arcs."""
    original = np.empty_like(graph.costs)
    original[graph.arc] = graph.costs
    how = {"sum": np.sum, "max": np.max}
    return all(
        [int(how[a](original[paths.arcs(i), j])) if len(paths.arcs(i)) else 0 for j, a in enumerate(graph.aggregates)]
        == paths.costs[i].tolist()
        for i in range(len(paths))
    )


def random_graph(seed: int, criteria: int) -> Graph:
    rng = np.random.default_rng(seed)
    n, m = 40, 160
    how = [("sum", "max")[i] for i in rng.integers(0, 2, criteria - 1)]
    costs = rng.integers(0, 60, (m, criteria))
    return Graph.from_arcs(n, *rng.integers(0, n, (2, m)), costs, aggregates=["sum", *how])


CASES = [(0.0, 0), (0.05, 0), (0.5, 0), (0.0, 7), (0.1, 3)]


@pytest.mark.cases(
    but=("1-0.05-0", "1-0.0-7", "2-0.0-0", "2-0.5-0", "3-0.0-0", "3-0.05-0", "3-0.0-7", "4-0.0-0", "4-0.5-0", "4-0.1-3")
)
@pytest.mark.parametrize(("eps", "slack"), CASES)
@pytest.mark.parametrize("criteria", [1, 2, 3, 4])
def test_every_exact_vector_is_covered_on_any_graph(criteria, eps, slack):
    tolerance = np.arange(criteria) * slack
    for seed in range(10):
        graph = random_graph(seed, criteria)
        exact = pareto_paths(graph, 0, 39)
        paths = pareto_paths(graph, 0, 39, eps=eps, tolerance=tolerance.tolist())
        assert covered(exact.costs, paths.costs, eps, tolerance)
        assert attained(graph, paths)
        assert paths.status is exact.status
        assert paths.gap == eps


@pytest.mark.parametrize(("eps", "slack"), CASES)
@pytest.mark.parametrize("method", ["staircase", "general"])
def test_every_exact_vector_is_covered_on_a_lattice(lattice, method, eps, slack):
    tolerance = np.array([slack, slack // 3, 2 * slack])
    fewer = 0
    for seed in range(6):
        graph = lattice(seed, 7)
        exact = pareto_paths(graph, 0, graph.nodes - 1, method=method)
        paths = pareto_paths(
            graph, 0, graph.nodes - 1, method=method, eps=eps, tolerance=tuple(int(t) for t in tolerance)
        )
        assert covered(exact.costs, paths.costs, eps, tolerance)
        assert attained(graph, paths)
        fewer += len(exact) - len(paths)
    assert (fewer > 0) == (eps > 0.1 or slack > 0) or eps == 0.05


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_what_a_stopped_search_misses_is_within_its_gap(lattice, method):
    gaps = []
    for seed in range(4):
        graph = lattice(seed, 9)
        exact = pareto_paths(graph, 0, graph.nodes - 1, method=method)
        for labels in range(100, exact.stats.labels_generated, max(1, exact.stats.labels_generated // 12)):
            paths = pareto_paths(graph, 0, graph.nodes - 1, method=method, budget=Budget(max_labels=labels))
            assert paths.status is Status.LABEL_LIMIT
            gaps.append(paths.gap)
            if np.isfinite(paths.gap):
                best = (exact.costs[:, None, :] * (1 + paths.gap) + 1e-6 >= paths.costs[None]).all(axis=2)
                assert best.any(axis=1).all()
            else:
                assert not len(paths) or not exact.costs.all()
    assert any(0 < gap < 1 for gap in gaps)


@given(st.integers(0, 2**45), st.sampled_from([0.0, 1e-6, 0.01, 0.1, 1.0, 3.0]), st.integers(0, 1000))
def test_the_least_covered_estimate_is_covered_and_the_one_below_is_not(cost, eps, tolerance):
    f = least_covered(cost, eps, tolerance)
    assert f + int(f * eps) + tolerance >= cost
    assert f == 0 or (f - 1) + int((f - 1) * eps) + tolerance < cost


def test_the_gap_by_hand():
    front = np.array([[10, 20], [20, 10]])
    assert proven_gap(front, np.array([[10, 16], [30, 30]])) == pytest.approx(0.25)  # 20 / 16; the other is dominated
    assert proven_gap(front, np.array([[0, 1]])) == np.inf
    assert proven_gap(front, np.zeros((0, 2), int)) == 0.0
    assert proven_gap(np.zeros((0, 2), int), np.array([[1, 1]])) == np.inf


@pytest.mark.parametrize("eps", [-0.1, float("nan"), float("inf"), "0.1", True])
def test_eps_that_is_no_precision_is_refused(eps):
    with pytest.raises(OptionError, match="eps must be a number, such as"):
        pareto_paths(random_graph(0, 2), 0, 39, eps=eps)


@pytest.mark.parametrize("tolerance", [(1,), (1, -1), (1, 0.5)])
def test_tolerances_that_are_none_are_refused(tolerance):
    with pytest.raises(OptionError, match="tolerance"):
        pareto_paths(random_graph(0, 2), 0, 39, tolerance=tolerance)
