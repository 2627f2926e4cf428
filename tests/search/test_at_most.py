"""Claim: with bounds on the costs a search finds the exact front of the paths within them, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.errors import OptionError
from hpop.runtime.limits import Status
from hpop.search import Graph, pareto_paths


def within(costs: np.ndarray, at_most: tuple[int | None, ...]) -> list[list[int]]:
    """Check the front under bounds: a dominated path within them is dominated by another path within them."""
    bounds = np.array([np.inf if b is None else b for b in at_most])
    return costs[(costs <= bounds).all(axis=1)].tolist()


@pytest.mark.cases(
    "columns0-staircase",
    "columns1-general",
    "columns2-staircase",
    "columns3-general",
    "columns4-staircase",
    "columns5-general",
)
@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize("columns", [(1,), (0,), (2,), (0, 1), (1, 2), (0, 1, 2)])
def test_a_lattice_within_bounds(lattice, method, columns):
    for seed in range(6):
        graph = lattice(seed, 7)
        exact = pareto_paths(graph, 0, graph.nodes - 1, method=method).costs
        for share in (0.0, 0.3, 0.7) if len(exact) else ():
            middle = np.quantile(exact, share, axis=0, method="lower").astype(int)
            at_most = tuple(int(middle[j]) if j in columns else None for j in range(3))
            paths = pareto_paths(graph, 0, graph.nodes - 1, method=method, at_most=at_most)
            expected = within(exact, at_most)
            assert paths.costs.tolist() == expected
            assert paths.status is (Status.COMPLETE if expected else Status.NO_PATH)


@pytest.mark.parametrize("criteria", [1, 2, 4])
def test_any_graph_within_bounds(criteria):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        how = [("sum", "max")[i] for i in rng.integers(0, 2, criteria)]
        graph = Graph.from_arcs(30, *rng.integers(0, 30, (2, 110)), rng.integers(0, 9, (110, criteria)), aggregates=how)
        exact = pareto_paths(graph, 0, 29).costs
        if len(exact):
            at_most = tuple(None if rng.random() < 0.3 else int(b) for b in np.median(exact, axis=0))
            assert pareto_paths(graph, 0, 29, at_most=at_most).costs.tolist() == within(exact, at_most)


def test_a_bound_below_the_least_leaves_no_path(lattice):
    graph = lattice(0, 5)
    least = pareto_paths(graph, 0, graph.nodes - 1).costs.min(axis=0)
    assert least.all()
    for j in range(3):
        at_most = tuple(int(least[i]) - 1 if i == j else None for i in range(3))
        paths = pareto_paths(graph, 0, graph.nodes - 1, at_most=at_most)
        assert paths.status is Status.NO_PATH
        told = ", ".join(f"cost {i} {cost}" for i, cost in enumerate(least))
        assert f"no path of at most cost {j} {at_most[j]}; each path has at least {told}>" in repr(paths)


@pytest.mark.parametrize("at_most", [(1,), (1, -1, None), (1, 0.5, None), (True, None, None)])
def test_bounds_that_are_none_are_refused(lattice, at_most):
    with pytest.raises(OptionError, match="at_most must be a whole number or None for each of 3 costs"):
        pareto_paths(lattice(0, 4), 0, 1, at_most=at_most)
