"""Claim: a lazy search finds the front of the arcs that are free, asks about each arc once, and few of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, ParetoPaths, pareto_paths
from hpop.search import lazy_paths as module
from hpop.search.machinery.checkpoint import CheckpointError, Saved


class Doors:
    """Free arcs, and the arcs that were queried."""

    def __init__(self, is_free: BoolArray) -> None:
        self.is_free, self.asked = is_free, list[int]()

    def __call__(self, arcs: IntArray) -> BoolArray:
        self.asked += arcs.tolist()
        return self.is_free[arcs]


def blocked_by_chance(seed: int, nodes: int = 40, arcs: int = 400) -> tuple[Graph, Doors]:
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 30, (arcs, 2 + seed % 3))
    aggregates = ["sum"] * (costs.shape[1] - 1) + [("sum", "max")[seed % 2]]
    tails, heads = rng.integers(0, nodes, (2, arcs))
    return Graph.from_arcs(nodes, tails, heads, costs, aggregates=aggregates), Doors(rng.random(arcs) < 0.7)


def eager(graph: Graph, doors: Doors, **options: object) -> ParetoPaths:
    return pareto_paths(graph.without(~doors.is_free), 0, graph.nodes - 1, **options)


def lazy(graph: Graph, doors: Doors, **options: object) -> ParetoPaths:
    return pareto_paths(graph, 0, graph.nodes - 1, free=doors, **options)


def added_up(graph: Graph, paths: ParetoPaths) -> list[list[int]]:
    """Costs of the paths, arc by arc."""
    worst = np.array([aggregate == "max" for aggregate in graph.aggregates])
    rows = [graph.costs[paths.all_arcs[end - size : end]] for size, end in ends(paths)]
    return [np.where(worst, row.max(axis=0, initial=0), row.sum(axis=0)).tolist() for row in rows]


def ends(paths: ParetoPaths) -> list[tuple[int, int]]:
    return list(zip(paths.lengths.tolist(), np.cumsum(paths.lengths).tolist(), strict=True))


@pytest.mark.seeds(3, of=100)
def test_the_front_is_that_of_the_free_arcs_vector_for_vector(seed: int) -> None:
    graph, doors = blocked_by_chance(seed)
    found = lazy(graph, doors)
    assert found.costs.tolist() == eager(graph, doors).costs.tolist()
    assert found.status is (Status.COMPLETE if len(found) else Status.NO_PATH)
    assert added_up(graph, found) == found.costs.tolist()
    assert doors.is_free[found.all_arcs].all()


@pytest.mark.seeds(2, of=40)
def test_each_arc_is_asked_about_once_and_the_counts_are_true(seed: int) -> None:
    graph, doors = blocked_by_chance(seed)
    stats = lazy(graph, doors).stats
    assert len(doors.asked) == len(set(doors.asked)) == stats.arcs_checked < graph.arcs / 2
    assert stats.arcs_blocked == np.count_nonzero(~doors.is_free[doors.asked])
    assert (stats.rounds > 1) == (stats.arcs_blocked > 0)


@pytest.mark.seeds(3, of=40)
def test_what_covers_and_what_bounds_holds_of_the_free_arcs(seed: int) -> None:
    graph, doors = blocked_by_chance(seed)
    bounds = {"at_most": [60] * graph.criteria}
    assert lazy(graph, doors, **bounds).costs.tolist() == eager(graph, doors, **bounds).costs.tolist()
    near = lazy(graph, doors, eps=0.2, tolerance=[1] * graph.criteria).costs
    for vector in eager(graph, doors).costs:
        assert (near <= 1.2 * vector + 1).all(axis=1).any()


# Limits


def covered(vectors: IntArray, by: ParetoPaths) -> bool:
    return all((by.costs <= (1 + by.gap) * vector + 1e-9).all(axis=1).any() for vector in vectors)


@pytest.mark.seeds(2, of=30)
def test_what_a_limit_leaves_is_free_and_optimal_and_its_gap_is_true(seed: int) -> None:
    graph, doors = blocked_by_chance(seed, nodes=60, arcs=600)
    exact = eager(graph, doors).costs
    whole = lazy(graph, doors).stats.labels_generated
    for limit in np.linspace(1, whole - 1, 12).astype(int).tolist():
        part = lazy(graph, doors, budget=Budget(max_labels=limit))
        assert part.status is Status.LABEL_LIMIT
        assert {*map(tuple, part.costs.tolist())} <= {*map(tuple, exact.tolist())}
        assert doors.is_free[part.all_arcs].all()
        assert not np.isfinite(part.gap) or covered(exact, part)


def test_limits_of_time_and_memory_are_told() -> None:
    graph, doors = blocked_by_chance(3)
    assert lazy(graph, doors, budget=Budget(time_limit=1e-9)).status is Status.TIME_LIMIT
    assert lazy(graph, doors, budget=Budget(max_memory=10)).status is Status.MEMORY_LIMIT


def test_ctrl_c_while_arcs_are_looked_at_leaves_what_is_known_to_be_free(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, doors = blocked_by_chance(17)
    exact = eager(graph, doors).costs
    monkeypatch.setattr(module, "AT_ONCE", 1)
    for after in (0, 5, 20, 60):
        left = after

        def stop(progress: Progress) -> None:
            nonlocal left
            left -= progress.stage == "checking"
            if left < 0:
                raise KeyboardInterrupt

        part = lazy(graph, doors, progress=stop)
        assert part.status in (Status.INTERRUPTED, Status.COMPLETE)
        assert {*map(tuple, part.costs.tolist())} <= {*map(tuple, exact.tolist())}
        assert not np.isfinite(part.gap) or covered(exact, part)


# Checkpoints


@pytest.mark.seeds(1, of=30)
def test_a_search_in_pieces_ends_as_one_in_one_go_and_asks_nothing_twice(seed: int, tmp_path: Path) -> None:
    graph, doors = blocked_by_chance(seed, nodes=60, arcs=600)
    file = tmp_path / "search.ckpt"
    whole = lazy(graph, doors)
    doors.asked.clear()
    limits = np.linspace(1, whole.stats.labels_generated, 9).astype(int).tolist()
    for limit in limits[:-1]:
        lazy(graph, doors, checkpoint=file, budget=Budget(max_labels=limit))
    found = lazy(graph, doors, checkpoint=file)
    assert found.costs.tolist() == whole.costs.tolist()
    assert found.status is Status.COMPLETE
    assert len(doors.asked) == len(set(doors.asked)) == found.stats.arcs_checked


@pytest.fixture
def stopped(tmp_path: Path) -> tuple[Graph, Doors, Path]:
    """Return a search that has checked some of its arcs, and its file."""
    graph, doors = blocked_by_chance(17)
    whole = lazy(graph, doors).stats.labels_generated
    lazy(graph, doors, checkpoint=tmp_path / "search.ckpt", budget=Budget(max_labels=whole - 1))
    return graph, doors, tmp_path / "search.ckpt"


def test_a_file_of_a_search_that_knew_all_arcs_to_be_free_is_of_another_problem(stopped) -> None:
    graph, _, file = stopped
    with pytest.raises(CheckpointError, match="is of another problem"):
        pareto_paths(graph, 0, graph.nodes - 1, checkpoint=file)


WRITTEN = (*module.SAVED, "known")
FORGERIES: dict[str, Callable[[IntArray], IntArray]] = {
    "longer": lambda array: np.append(array, 1),
    "shorter": lambda array: array[:-1],
    "other": lambda array: array + 1,
    "beyond": lambda array: array + 10**6,
    "below": lambda array: array - 10**6,
}


@pytest.mark.cases(*("-".join(pair) for pair in zip(FORGERIES, WRITTEN, strict=True)))
@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("kind", FORGERIES)
def test_a_file_that_knows_other_things_of_its_arcs_is_refused(stopped, name: str, kind: str) -> None:
    graph, doors, file = stopped
    saved = Saved.read(file)
    assert len(saved.arrays[name]), "nothing to forge"
    replace(saved, arrays={**saved.arrays, name: FORGERIES[kind](saved.arrays[name])}).write(file)
    with pytest.raises(CheckpointError, match="does not fit this search"):
        lazy(graph, doors, checkpoint=file)


def test_a_file_without_what_is_known_of_its_arcs_is_refused(stopped) -> None:
    graph, doors, file = stopped
    saved = Saved.read(file)
    for name in (*module.SAVED, "known"):
        replace(saved, arrays={key: array for key, array in saved.arrays.items() if key != name}).write(file)
        with pytest.raises(CheckpointError, match="it lacks the states of the arcs"):
            lazy(graph, doors, checkpoint=file)


def test_arcs_that_are_sealed_as_free_and_blocked_are_refused(stopped) -> None:
    graph, doors, file = stopped
    saved = Saved.read(file)
    arrays = saved.arrays | {"arcs_free": saved.arrays["arcs_blocked"]}
    for arcs in (arrays["arcs_free"], np.array([-1]), np.array([graph.arcs]), np.array([2, 1])):
        arrays["arcs_free"] = arcs
        arrays["known"] = module._checksum([arrays[name] for name in module.SAVED])
        replace(saved, arrays=arrays).write(file)
        with pytest.raises(CheckpointError, match="does not fit this search"):
            lazy(graph, doors, checkpoint=file)
