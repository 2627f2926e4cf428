"""Claims: non-dominated sets and hypervolumes are those of moocore and pymoo; a search misses no path's vector."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path

import numpy as np
import pytest

from hpop import frontier

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("optimisers")


@pytest.fixture
def pymoo():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own imports
        pytest.importorskip("pymoo")
        yield


def drawn(seed, *, ties):
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 80)), int(rng.integers(2, 6))
    return rng.integers(0, 5, (n, k)).astype(float) if ties else rng.random((n, k))


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.seeds(4, of=50)
def test_moocore_keeps_the_same_vectors_and_measures_the_same(seed, ties):
    import moocore

    Y = drawn(seed, ties=ties)
    kept, reference = frontier.filter(Y), frontier.default_reference(Y)
    assert sorted(kept.tolist()) == sorted(moocore.filter_dominated(Y).tolist())
    assert frontier.hypervolume(Y) == pytest.approx(moocore.hypervolume(Y, ref=reference), rel=1e-9)


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.seeds(4, of=50)
def test_pymoo_keeps_the_same_vectors_and_measures_the_same(seed, ties, bench, pymoo):
    Y = drawn(seed, ties=ties)
    assert bench.same_rows(frontier.filter(Y), bench.pymoo_filter(Y))
    reference = frontier.default_reference(Y)
    assert frontier.hypervolume(Y) == pytest.approx(bench.pymoo_hypervolume(Y, reference), rel=1e-9)


def test_the_benchmark_finds_all_three_agree(bench, pymoo):
    row = bench.compared("in a cube", 300, 3)
    assert row["same"]
    assert len(set(row["nondominated"].values())) == 1
    volumes = list(row["hypervolume"].values())
    assert volumes == pytest.approx([volumes[0]] * 3, rel=1e-9)


def test_no_path_that_evolution_finds_is_better_than_the_front(bench, pymoo):
    g = bench.streets(4)
    from hpop.search import pareto_paths

    exact = pareto_paths(g, (0, 0), (3, 3), costs=bench.COSTS).values
    found = bench.evolved(g, (0, 0), (3, 3), population=10, generations=5, seed=0)
    assert all((exact <= row + 1e-9).all(axis=1).any() for row in found)
