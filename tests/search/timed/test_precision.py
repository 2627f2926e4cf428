"""Claims: with eps or a tolerance every vector of the enumeration is covered; bounds leave those within them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from hpop.search.timed import timed_paths
from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.expanded import front_by_expansion
from tests.search.timed.instances import timed_lattice, timed_query
from tests.search.timed.semantics import Vector, check_timed_walks

TOGETHER = 10  # questions a test


def uncovered(
    exact: Sequence[Vector], found: Sequence[Sequence[int]], eps: float, tolerance: Sequence[int]
) -> list[Vector]:
    """Return the exact vectors without a near enough vector in the result."""
    return [
        p
        for p in exact
        if not any(
            all(a <= b + int(eps * b + 1e-9) + t for a, b, t in zip(r, p, tolerance, strict=True)) for r in found
        )
    ]


@pytest.mark.seeds(1, of=50)
def test_every_vector_is_covered_within_what_was_asked_for(seed):
    for one in range(TOGETHER * seed, TOGETHER * (seed + 1)):
        query, rng = timed_query(one), np.random.default_rng(one)
        exact, k = front_by_enumeration(query), query.graph.graph.criteria
        eps, tolerance = float(rng.choice([0.0, 0.05, 0.3, 1.0])), rng.integers(0, 4, k).tolist()
        paths = timed_paths(*query, eps=eps, tolerance=tolerance)
        assert uncovered(exact, paths.costs.tolist(), eps, tolerance) == []
        assert (paths.gap, paths.status.is_final) == (eps, True)
        check_timed_walks(query.graph, paths, query.source, query.targets)


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(4), marks=pytest.mark.proof)])
@pytest.mark.parametrize(("eps", "slack"), [(0.2, 0), (0.5, 0), (0.0, 2)])
def test_on_lattices_fewer_vectors_cover_all(eps, slack, seeds):
    fewer = 0
    for seed in seeds:
        query = timed_lattice(seed, 5, duration=True)
        exact = front_by_expansion(query)
        paths = timed_paths(*query, eps=eps, tolerance=[0, slack, slack, slack])
        assert uncovered(exact, paths.costs.tolist(), eps, [0, slack, slack, slack]) == []
        check_timed_walks(query.graph, paths, query.source, query.targets)
        fewer += len(exact) - len(paths)
    assert fewer > 0


@pytest.mark.seeds(1, of=50)
def test_within_bounds_it_finds_what_is_within_them(seed):
    for one in range(TOGETHER * seed, TOGETHER * (seed + 1)):
        query, rng = timed_query(one), np.random.default_rng(one)
        exact = front_by_enumeration(query)
        some = exact[int(rng.integers(len(exact)))] if exact else (3,) * query.graph.graph.criteria
        bounds = [None if rng.random() < 0.4 else b + int(rng.integers(0, 2)) for b in some]
        within = [list(p) for p in exact if all(b is None or a <= b for a, b in zip(p, bounds, strict=True))]
        paths = timed_paths(*query, at_most=bounds)
        assert paths.costs.tolist() == within
        check_timed_walks(query.graph, paths, query.source, query.targets)


@pytest.mark.seeds(1, of=30)
def test_bounds_and_a_precision_go_together(seed):
    for one in range(TOGETHER * seed, TOGETHER * (seed + 1)):
        query, rng = timed_query(one), np.random.default_rng(one)
        exact = front_by_enumeration(query)
        if not exact:
            continue
        bounds = [b + int(rng.integers(0, 3)) for b in exact[int(rng.integers(len(exact)))]]
        paths = timed_paths(*query, at_most=bounds, eps=0.3)
        within = [p for p in exact if all(a <= b for a, b in zip(p, bounds, strict=True))]
        assert uncovered(within, paths.costs.tolist(), 0.3, [0] * len(bounds)) == []
        assert (paths.costs <= bounds).all()
