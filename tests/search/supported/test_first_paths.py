"""A first answer without kernels: real paths, the least in each cost among them, nothing dominated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph
from hpop.search.supported.first_paths import first_paths


def drawn(seed: int) -> tuple[Graph, list[int]]:
    """Return a random graph with parallel arcs, loops, arcs that cost nothing, and two targets."""
    rng = np.random.default_rng(seed)
    n, m, k = int(rng.integers(2, 7)), int(rng.integers(1, 16)), int(rng.integers(1, 4))
    tails, heads = rng.integers(0, n, (2, m))
    aggregates = rng.choice(["sum", "sum", "max"], k).tolist()
    return Graph.from_arcs(n, tails, heads, rng.integers(0, 5, (m, k)), aggregates=aggregates), [n - 1, int(n // 2)]


@pytest.mark.seeds(8, of=30)
def test_paths_are_real_and_none_dominates_another(seed: int, closure: Callable[..., Any]) -> None:
    graph, targets = drawn(seed)
    front = closure(graph, 0, set(targets))
    found = first_paths(graph, 0, targets, Budget())
    assert (found.status is Status.NO_PATH) == (not front)
    assert found.costs.tolist() == sorted(found.costs.tolist())
    for i, costs in enumerate(found.costs.tolist()):
        nodes, along = found.nodes(i).tolist(), graph.costs[np.isin(graph.arc, found.arcs(i))]
        assert nodes[0] == 0
        assert nodes[-1] in targets
        assert len(along) == len(nodes) - 1
        assert costs == [
            c.max(initial=0) if a == "max" else c.sum() for c, a in zip(along.T, graph.aggregates, strict=True)
        ]
        assert any(all(p <= c for p, c in zip(best, costs, strict=True)) for best in front)
        assert not any(
            all(a <= b for a, b in zip(other, costs, strict=True)) for other in found.costs.tolist() if other != costs
        )
    for j, how in enumerate(graph.aggregates):
        if how == "sum" and front:
            assert found.costs[:, j].min() == min(best[j] for best in front)


def test_a_limit_of_time_leaves_the_paths_that_are_least_in_a_cost() -> None:
    graph = Graph.from_arcs(2, [0, 0, 0], [1, 1, 1], [[0, 4], [1, 1], [4, 0]])
    found = first_paths(graph, 0, [1], Budget(time_limit=1e-9))
    assert found.costs.tolist() == [[0, 4], [4, 0]]
    assert found.status is Status.TIME_LIMIT


def test_ctrl_c_keeps_what_was_found() -> None:
    graph = Graph.from_arcs(2, [0, 0], [1, 1], [[0, 4], [4, 0]])

    def stop(progress: object) -> None:
        raise KeyboardInterrupt

    found = first_paths(graph, 0, [1], Budget(), stop)
    assert found.costs.tolist() == [[0, 4]]
    assert found.status is Status.INTERRUPTED
