"""Claims: a stopped search never proves less than the true gap; with bounds by turns or joint ones hardly more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import hpop
from hpop.base.arrays import IntArray
from hpop.planners.graph_planners import Lattice
from hpop.runtime.limits import Budget
from hpop.search import Graph, pareto_paths
from hpop.search.prepared import Prepared

Maker = Callable[..., Graph]
Closure = Callable[..., list[tuple[int, ...]]]


def true_gap(found: IntArray, exact: IntArray) -> float:
    """Return the least gap such that each exact vector has a found one within (1 + gap) times it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = found[:, None] / exact[None]  # (f, n, k)
    ratio[(found[:, None] == 0) & (exact[None] == 0)] = 1.0
    return float(ratio.max(axis=2).min(axis=0).max()) - 1.0


def lattice_of_kind(lattice: Maker, seed: int, width: int, aggregates: list[str]) -> Graph:
    """Return a lattice with larger costs (rest, turns, length) of moves, and with equal or unequal turns."""
    graph, rng = lattice(seed, width), np.random.default_rng(seed)
    costs = graph.costs.copy()
    turn = costs[:, 1] > 0
    costs[~turn] += rng.integers(0, (40, 1, 20), ((~turn).sum(), 3))
    costs[turn, 0] = 9 if seed % 2 else rng.integers(7, 12, turn.sum())  # none dearer than two
    return Graph.from_csr(graph.indptr, graph.heads, costs, aggregates=aggregates)


KINDS = [["sum", "sum", "sum"], ["sum", "sum", "max"], ["max", "sum", "sum"]]


@pytest.mark.seeds(2, of=[5, *range(5), *range(6, 40)])
@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_no_stop_on_a_lattice_proves_less_than_the_true_gap(
    seed: int, kind: list[str], lattice: Maker, closure: Closure
) -> None:
    graph = lattice_of_kind(lattice, seed, 4, kind)
    target = graph.nodes - 1 - seed % 4
    exact = np.array(closure(graph, 0, {target})).reshape(-1, 3)
    total = pareto_paths(graph, 0, target, method="staircase").stats.labels_generated
    for eps in (0.0, 0.05):
        for limit in np.linspace(1, max(1, total - 1), 8).astype(int).tolist():
            paths = pareto_paths(graph, 0, target, method="staircase", eps=eps, budget=Budget(max_labels=limit))
            if not paths.status.is_final and len(paths):
                assert paths.gap >= true_gap(paths.costs, exact) - 1e-12
                assert paths.gap >= eps


@pytest.mark.proof
def test_a_late_stop_within_a_precision_proves_nearly_the_true_gap_on_lattices(lattice: Maker) -> None:
    ratios = []
    for seed in range(12):
        graph = lattice_of_kind(lattice, seed, 8, KINDS[0])
        target = graph.nodes - 1 - seed % 4
        exact = pareto_paths(graph, 0, target, method="staircase").costs
        total = pareto_paths(graph, 0, target, method="staircase", eps=0.01).stats.labels_generated
        for limit in np.linspace(1 + 0.6 * total, 1 + total, 8)[:-1].astype(int).tolist():
            paths = pareto_paths(graph, 0, target, method="staircase", eps=0.01, budget=Budget(max_labels=limit))
            if not paths.status.is_final and len(paths):
                true = max(0.01, true_gap(paths.costs, exact))
                assert paths.gap >= true - 1e-12
                ratios.append(paths.gap / true)
    assert len(ratios) > 10
    assert np.median(ratios) <= 1.01
    assert np.mean(ratios) <= 1.1


@pytest.mark.seeds(2, of=40)
def test_no_stop_beside_a_lattice_proves_less_than_the_true_gap(
    seed: int, beside: Callable[..., tuple[Graph, int, int]], closure: Closure
) -> None:
    """Start and goal are joined to the lattice by arcs that turn up to twice."""
    graph, start, goal = beside(seed, 4)
    exact = np.array(closure(graph, start, {goal})).reshape(-1, 3)
    most = int(exact[:, 1].max())
    for bound, eps in ((None, 0.0), (most - 1, 0.0), (None, 0.03), (most - 1, 0.03)):
        allowed = exact if bound is None else exact[exact[:, 1] <= bound]
        for limit in range(1, 400, 57):
            paths = pareto_paths(
                graph,
                start,
                goal,
                method="staircase",
                eps=eps,
                at_most=(None, bound, None),
                budget=Budget(max_labels=limit),
            )
            if not paths.status.is_final and len(paths):
                assert paths.gap >= true_gap(paths.costs, allowed) - 1e-12


@pytest.mark.seeds(2, of=40)
@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize(
    "kind", [["sum", "sum"], ["max", "sum"], ["sum", "sum", "sum"], ["max", "sum", "max"]], ids="-".join
)
def test_no_stop_on_any_graph_proves_less_than_the_true_gap(
    seed: int, kind: list[str], method: str, closure: Closure
) -> None:
    rng = np.random.default_rng(seed)
    tails, heads = rng.integers(0, 20, (2, 90))
    costs = rng.integers(0, (60, 4, 60)[: len(kind)], (90, len(kind)))
    graph = Graph.from_arcs(20, tails, heads, costs, aggregates=kind)
    exact = np.array(closure(graph, 0, {19})).reshape(-1, len(kind))
    for limit in range(1, 120, 17):
        paths = pareto_paths(graph, 0, 19, method=method, budget=Budget(max_labels=limit))
        if not paths.status.is_final and len(paths):
            assert paths.gap >= true_gap(paths.costs, exact) - 1e-12


def test_a_search_that_is_stopped_in_the_museum_proves_nearly_the_true_gap() -> None:
    """Single estimates prove about 1: they have the fewest turns and the least exposure at once, as no path has."""
    query = Lattice(step=0.5).query(hpop.examples.museum())
    exact = pareto_paths(query.graph, query.start, query.goals)
    for share in (0.3, 0.6, 0.9):
        budget = Budget(max_labels=int(share * exact.stats.labels_generated))
        paths = pareto_paths(query.graph, query.start, query.goals, budget=budget)
        assert paths.stats.method == "staircase"
        true = true_gap(paths.costs, exact.costs)
        assert 0 < true <= paths.gap + 1e-12 <= 1.05 * true


def test_a_search_within_a_precision_that_is_stopped_in_the_museum_proves_nearly_the_true_gap() -> None:
    """Bounds of single costs prove 0.165 and 0.099 here."""
    query = Lattice(step=0.25).query(hpop.examples.museum())
    exact = pareto_paths(query.graph, query.start, query.goals)
    complete = pareto_paths(query.graph, query.start, query.goals, eps=0.01)
    for share in (0.5, 0.9):
        budget = Budget(max_labels=int(share * complete.stats.labels_generated))
        paths = pareto_paths(query.graph, query.start, query.goals, eps=0.01, budget=budget)
        true = true_gap(paths.costs, exact.costs)
        assert 0.02 < true <= paths.gap <= true + 0.015


@pytest.mark.proof
def test_a_stopped_query_of_a_prepared_museum_proves_nearly_the_true_gap() -> None:
    """So few labels are too few for the approximate search, which would prove a tenth."""
    query = Lattice(step=0.5).query(hpop.examples.museum())
    prepared = Prepared(query.graph, query.goals)
    exact = prepared.paths(query.start)
    for share in (0.05, 0.1, 0.2):
        budget = Budget(max_labels=int(share * exact.stats.labels_generated))
        paths = prepared.paths(query.start, budget=budget)
        true = true_gap(paths.costs, exact.costs)
        assert 0.1 < true <= paths.gap + 1e-12 <= 1.05 * true
