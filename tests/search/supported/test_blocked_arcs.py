"""Claim: weighted sums on a graph of which arcs may be blocked are those of its free arcs, and few are asked about."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, SupportedPaths, pareto_paths, supported_paths

FEW, MANY = 20, 10**6  # values of a cost: with few of them many paths tie


def by_chance(seed: int, largest: int, share: float = 0.3) -> tuple[Graph, BoolArray]:
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, largest, (400, 2 + seed % 3))
    graph = Graph.from_arcs(40, *rng.integers(0, 40, (2, 400)), costs)
    return graph, rng.random(400) >= share


def eager(graph: Graph, free: BoolArray, **options: Any) -> SupportedPaths:
    return supported_paths(graph.without(~free), 0, graph.nodes - 1, **options)


def lazy(graph: Graph, free: BoolArray, **options: Any) -> SupportedPaths:
    asked = list[int]()

    def look(arcs: IntArray) -> BoolArray:
        asked.extend(arcs.tolist())
        return free[arcs]

    found = supported_paths(graph, 0, graph.nodes - 1, free=look, **options)
    assert len(asked) == len(set(asked)) == found.stats.arcs_checked
    assert found.blocked.tolist() == sorted(arc for arc in asked if not free[arc])
    assert found.stats.arcs_blocked == found.blocked.size
    assert free[found.all_arcs].all()
    return found


def all_of(found: SupportedPaths) -> list[Any]:
    """Return the result without the choice among tied ends of a facet at which its weights are noted."""
    weights = sorted(np.concatenate(found.weights).tolist())
    return [found.status, found.solved, weights, *(row.tolist() for row in (found.costs, found.ideal, found.nadir))]


@pytest.mark.seeds(2, of=100)
def test_it_finds_what_the_free_arcs_have_weight_for_weight(seed: int) -> None:
    graph, free = by_chance(seed, MANY)
    found = lazy(graph, free)
    assert all_of(found) == all_of(eager(graph, free))
    assert found.stats.arcs_checked < graph.arcs / 2


@pytest.mark.seeds(2, of=30)
@pytest.mark.parametrize(
    "options", [{"divisions": 4}, {"weights": [[1, 0, 2, 5], [3, 1, 0, 0]]}], ids=["lattice", "given"]
)
def test_it_is_so_for_weights_that_are_asked_for(seed: int, options: dict[str, Any]) -> None:
    graph, free = by_chance(seed, MANY)
    if "weights" in options:
        options = {"weights": [row[: graph.criteria] for row in options["weights"]]}
    assert all_of(lazy(graph, free, **options)) == all_of(eager(graph, free, **options))


@pytest.mark.seeds(2, of=50)
def test_where_paths_tie_it_has_all_extreme_points_and_nothing_unsupported(hull: Any, seed: int) -> None:
    graph, free = by_chance(seed, FEW)
    exact = pareto_paths(graph.without(~free), 0, graph.nodes - 1).costs.tolist()
    front = [tuple(row) for row in exact]
    found = {tuple(row) for row in lazy(graph, free).costs.tolist()}
    assert hull.extreme(front) <= found <= {y for y in front if hull.supported(y, front)}


def test_it_does_not_depend_on_the_executor() -> None:
    graph, free = by_chance(7, MANY)
    with ThreadPoolExecutor(2) as executor:
        found = lazy(graph, free, executor=executor)
    alone = lazy(graph, free)
    assert all_of(found) == all_of(alone)
    assert found.stats.arcs_checked == alone.stats.arcs_checked


@pytest.mark.seeds(3, of=30)
def test_where_all_ways_are_blocked_it_says_that_there_is_none(seed: int) -> None:
    graph, free = by_chance(seed, MANY)
    free &= graph.heads != graph.nodes - 1
    found = lazy(graph, free)
    assert (found.status, len(found)) == (Status.NO_PATH, 0)
    assert found.ideal.tolist() == found.nadir.tolist() == [0] * graph.criteria


def test_a_limit_of_time_and_ctrl_c_leave_free_points_of_the_whole_answer() -> None:
    graph, free = by_chance(2, MANY)
    whole = {*map(tuple, lazy(graph, free).costs.tolist())}
    assert lazy(graph, free, budget=Budget(time_limit=1e-9)).status is Status.TIME_LIMIT
    kept = set[int]()
    for after in range(6):
        left = after

        def stop(progress: Progress) -> None:
            nonlocal left
            left -= progress.stage == "weights"
            if left < 0:
                raise KeyboardInterrupt

        part = lazy(graph, free, progress=stop)
        assert part.status is Status.INTERRUPTED
        assert {*map(tuple, part.costs.tolist())} <= whole
        kept.add(len(part))
    assert len(whole) > min(kept) > 0
