"""Claim: whatever numbers a checkpoint holds, with a right checksum, it is refused or the front is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.base.arrays import IntArray
from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, ParetoPaths, capped_mean_paths, pareto_paths
from hpop.search.machinery.checkpoint import CheckpointError, Saved

Search = Callable[..., ParetoPaths]
FORGERIES = pytest.mark.parametrize("forgeries", [40, pytest.param(200, marks=pytest.mark.proof)])


def on_four_costs(lattice: Callable[..., Graph]) -> Search:
    full = lattice(1, 8)
    worst = np.random.default_rng(2).integers(0, 9, full.arcs)
    costs, hows = np.column_stack([full.costs, worst]), ["sum", "sum", "sum", "max"]
    graph = Graph.from_csr(full.indptr, full.heads, costs, aggregates=hows)
    return lambda **options: pareto_paths(graph, 1, graph.nodes - 2, method="general", **options)


def among_turns(lattice: Callable[..., Graph]) -> Search:
    graph = lattice(1, 8)
    return lambda **options: pareto_paths(graph, 0, graph.nodes - 1, method="staircase", **options)


def of_a_mean(lattice: Callable[..., Graph]) -> Search:
    rng = np.random.default_rng(2)
    tails, heads = rng.integers(0, 12, (2, 50))
    graph = Graph.from_arcs(12, tails, heads, rng.integers(1, 9, (50, 4)))
    return lambda **options: capped_mean_paths(graph, 0, 11, integral=0, duration=1, cap=60, **options)


def forged(array: IntArray, other: IntArray, rng: np.random.Generator) -> IntArray:
    """Return an array of labels, changed in one of many ways."""
    new, n = array.copy(), len(array)
    i, j = rng.integers(0, max(n, 1), 2)
    large = rng.integers(-(2**63), 2**63 - 1, size=n, dtype=np.int64)
    if not n:
        return large[:0] if rng.random() < 0.5 else np.array([int(rng.integers(0, 2**36))])
    kind = rng.integers(14)
    if kind == 0:
        new[i] = large[i]
    elif kind == 1:
        new[:] = large
    elif kind == 2:
        new[i] += rng.choice([-1, 1])
    elif kind == 3:
        new[i] += rng.choice([-1, 1]) * 2**32
    elif kind == 4:
        new[[i, j]] = new[[j, i]]
    elif kind == 5:
        new[i] = new[j]
    elif kind == 6:
        new[i] = rng.choice([0, -1, 2**31, 2**32 - 1, 2**62, -(2**63)])
    elif kind == 7:
        new = new[: rng.integers(0, n)]
    elif kind == 8:
        new = np.append(new, new[i])
    elif kind == 9:
        new = np.append(new, new[i] + 1)
    elif kind == 10:
        new = np.delete(new, i)
    elif kind == 11:
        new = rng.permutation(new)
    elif kind == 12:
        new = other.copy()
    else:
        new[i] = (int(new[i]) >> 32 << 32) + rng.integers(1, 300)
    return new


@FORGERIES
@pytest.mark.parametrize("make", [on_four_costs, among_turns, of_a_mean])
def test_a_forged_checkpoint_is_refused_or_its_front_is_right(
    tmp_path: Path, lattice: Any, make: Any, forgeries: int
) -> None:
    search, file = make(lattice), tmp_path / "search.ckpt"
    exact = search()
    most = exact.stats.labels_generated
    refused = 0
    for seed in range(forgeries):
        rng = np.random.default_rng(seed)
        if seed % 20 == 0:  # stopped earlier and later
            file.unlink(missing_ok=True)
            limit = Budget(max_labels=int(rng.integers(most // 3, most - most // 10)))
            assert search(checkpoint=file, budget=limit).status is Status.LABEL_LIMIT
            saved = Saved.read(file)
        names = rng.choice(sorted(saved.arrays), rng.integers(1, 3), replace=False)
        other = saved.arrays[str(rng.choice(sorted(saved.arrays)))]
        changes = {name: forged(saved.arrays[name], other, rng) for name in names}
        replace(saved, arrays=saved.arrays | changes).write(file)
        try:
            paths = search(checkpoint=file)
        except CheckpointError:
            refused += 1
            continue
        assert paths.costs.tolist() == exact.costs.tolist(), (seed, names)
    assert refused > 0.7 * forgeries


def test_what_a_checkpoint_holds_is_enough_however_large_the_numbers_of_the_graph(tmp_path: Path) -> None:
    """Labels made again outgrow 32 bits, as they did in the search."""
    tails = np.repeat(np.arange(60), 2)
    graph = Graph.from_arcs(61, tails, tails + 1, np.tile([[0, 1, 2**45], [1, 0, 0]], (60, 1)))
    for method in ("staircase", "general"):
        file = tmp_path / method
        part = pareto_paths(graph, 0, 60, method=method, checkpoint=file, budget=Budget(max_labels=1500))
        assert part.status is Status.LABEL_LIMIT
        paths = pareto_paths(graph, 0, 60, method=method, checkpoint=file)
        assert paths.costs.tolist() == pareto_paths(graph, 0, 60, method=method).costs.tolist()
