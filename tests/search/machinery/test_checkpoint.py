"""Claim: a search that is stopped anywhere goes on as if it had not been."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, ParetoPaths, capped_mean_paths, pareto_paths
from hpop.search.machinery import slices as in_slices
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import LAYERS


def widening(steps: int = 60, dear: int = 2**26) -> Graph:
    """Return a graph whose first cost avoids a dear path, so that numbers outgrow 32 bits and dearer ones a key."""
    tails = np.repeat(np.arange(steps), 2)
    return Graph.from_arcs(steps + 1, tails, tails + 1, np.tile([[0, 1, dear], [1, 0, 0]], (steps, 1)))


def same(a: ParetoPaths, b: ParetoPaths) -> None:
    """Vectors, paths and counts are the same."""
    assert a.costs.tolist() == b.costs.tolist()
    assert [a.arcs(i).tolist() for i in range(len(a))] == [b.arcs(i).tolist() for i in range(len(b))]
    counts = ("method", "order", "labels_generated", "labels_expanded")
    assert [getattr(a.stats, name) for name in counts] == [getattr(b.stats, name) for name in counts]
    assert (a.status, a.gap) == (b.status, b.gap)


def piecewise(search: Callable[..., ParetoPaths], file: Path, pieces: int) -> None:
    """Search in one go, and in pieces that Ctrl-C stops, each from the file of the one before: the result is one."""
    seen: list[Progress] = []
    exact = search(progress=seen.append)
    slices = max(2, sum(p.stage == "search" for p in seen) // pieces)
    times, paths = 0, replace(exact, status=Status.INTERRUPTED)
    while paths.status is Status.INTERRUPTED:
        times, left = times + 1, slices

        def stop(progress: Progress) -> None:
            nonlocal left
            left -= progress.stage == "search"
            if progress.stage == "search" and left < 0:
                raise KeyboardInterrupt

        paths = search(checkpoint=file, progress=stop)
    assert times > 2
    assert paths.status is Status.COMPLETE
    same(paths, exact)


@pytest.fixture
def short_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slices of a few labels, and no wait for the disk."""
    monkeypatch.setattr(in_slices, "WORK", 200)
    monkeypatch.setattr(os, "fsync", lambda file: None)


@pytest.mark.cases(
    but=("two-auto-12", "a maximum-auto-12", "wider numbers-auto-12", "wider keys-auto-12", "wider numbers-general-12")
)
@pytest.mark.usefixtures("short_slices")
@pytest.mark.parametrize("pieces", [pytest.param(3, marks=pytest.mark.proof), 12])
@pytest.mark.parametrize("method", ["auto", "staircase", "general"])
@pytest.mark.parametrize(
    "make",
    [
        lambda chain: chain(20),
        lambda chain: chain(60, (9, 3)),
        lambda chain: chain(22, (30, 4, 30), ["max", "sum", "sum"]),
        lambda chain: widening(),
        lambda chain: widening(dear=2**50),
    ],
    ids=["three costs", "two", "a maximum", "wider numbers", "wider keys"],
)
def test_stopped_again_and_again_it_ends_as_if_never_stopped(tmp_path, chain, make, method, pieces):
    graph = make(chain)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 0, graph.nodes - 1, method=method, **options)

    piecewise(search, tmp_path / "search.ckpt", pieces)


@pytest.mark.usefixtures("short_slices")
def test_so_does_a_search_with_four_costs_that_takes_turns_at_once(tmp_path, lattice):
    full = lattice(1, 12)
    worst = np.random.default_rng(2).integers(0, 9, full.arcs)
    costs, hows = np.column_stack([full.costs, worst]), ["sum", "sum", "sum", "max"]
    graph = Graph.from_csr(full.indptr, full.heads, costs, aggregates=hows)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 1, graph.nodes - 2, **options)

    assert search().stats.method == "general"
    piecewise(search, tmp_path / "search.ckpt", 5)


@pytest.mark.usefixtures("short_slices")
def test_so_does_a_search_that_looks_ahead(tmp_path, lattice, monkeypatch):
    monkeypatch.setattr("hpop.search.staircase.search.LONG", 0.05)
    looked = []
    look = Staircase._add_bounds

    def count(self: Staircase, clock: in_slices.Clock) -> None:
        look(self, clock)
        looked.append(self.layers.shape)

    monkeypatch.setattr(Staircase, "_add_bounds", count)
    graph = lattice(1, 12)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 0, graph.nodes - 1, method="staircase", **options)

    piecewise(search, tmp_path / "search.ckpt", 5)
    assert set(looked) == {(graph.nodes, LAYERS)}  # in one go, and once in each of the pieces that come to it


@pytest.mark.usefixtures("short_slices")
@pytest.mark.parametrize("method", ["staircase", "general"])
def test_so_does_an_approximate_one(tmp_path, method, chain):
    graph = chain(30)

    def search(**options: Any) -> ParetoPaths:
        return pareto_paths(graph, 0, 30, method=method, eps=0.05, tolerance=[1, 0, 2], **options)

    piecewise(search, tmp_path / "search.ckpt", 5)


@pytest.mark.usefixtures("short_slices")
def test_so_does_a_search_under_a_cap(tmp_path):
    rng = np.random.default_rng(2)
    tails, heads = rng.integers(0, 12, (2, 50))
    graph = Graph.from_arcs(12, tails, heads, rng.integers(1, 9, (50, 4)))

    def search(**options: Any) -> ParetoPaths:
        return capped_mean_paths(graph, 0, 11, integral=0, duration=1, cap=60, **options)

    piecewise(search, tmp_path / "search.ckpt", 5)


@pytest.mark.cases("budget0-general", "budget1-staircase", "budget2-staircase")
@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize("budget", [Budget(max_labels=3000), Budget(max_memory=600_000), Budget(time_limit=1e-4)])
def test_higher_limits_let_a_stopped_search_go_on(tmp_path, method, budget, chain):
    graph, file = chain(70), tmp_path / "search.ckpt"
    exact = pareto_paths(graph, 0, 70, method=method)
    part = pareto_paths(graph, 0, 70, method=method, checkpoint=file, budget=budget)
    assert not part.status.is_final
    same(pareto_paths(graph, 0, 70, method=method, checkpoint=file), exact)


def test_a_label_limit_counts_what_was_done_before(interrupted):
    graph, file = interrupted
    again = pareto_paths(graph, 0, 60, checkpoint=file, budget=Budget(max_labels=2500))
    assert again.status is Status.LABEL_LIMIT
    assert 2500 <= again.stats.labels_generated < 2600


def test_ctrl_c_while_arrays_grow_waits_until_they_fit_each_other(tmp_path, monkeypatch, chain):
    graph, file = chain(70), tmp_path / "search.ckpt"
    exact = pareto_paths(graph, 0, 70, method="general")
    grow = in_slices.Search._grow_front

    def interrupt(self: in_slices.Search) -> None:
        signal.raise_signal(signal.SIGINT)
        grow(self)

    monkeypatch.setattr(in_slices.Search, "_grow_front", interrupt)
    assert pareto_paths(graph, 0, 70, method="general", checkpoint=file).status is Status.INTERRUPTED
    monkeypatch.undo()
    same(pareto_paths(graph, 0, 70, method="general", checkpoint=file), exact)


def test_one_in_which_keys_become_too_narrow_goes_on_in_the_general_search(tmp_path, monkeypatch, chain):
    graph, file = chain(40), tmp_path / "search.ckpt"
    monkeypatch.setattr(in_slices, "WORK", 3000)
    from hpop.search.staircase.tables import TooWide

    class Narrow(Staircase):
        def advance(self, clock: in_slices.Clock, work: int) -> int:
            if self.counters[in_slices.N_EXPANDED] > 200:
                raise TooWide
            return super().advance(clock, work)

    monkeypatch.setattr("hpop.search.staircase.search.Staircase", Narrow)
    exact = pareto_paths(graph, 0, 40, method="staircase")
    assert exact.stats.method == "general"
    seen: list[Progress] = []

    def stop(progress: Progress) -> None:
        seen.append(progress)
        began_anew = any(later.labels < earlier.labels for earlier, later in pairwise(seen))
        if began_anew and progress.labels > 1000:
            raise KeyboardInterrupt

    part = pareto_paths(graph, 0, 40, method="staircase", checkpoint=file, progress=stop)
    assert (part.status, part.stats.method) == (Status.INTERRUPTED, "general")
    same(pareto_paths(graph, 0, 40, method="staircase", checkpoint=file), exact)


KILLED = """
import sys
import numpy as np
from hpop.search import Graph, pareto_paths
from hpop.search.machinery.checkpoint import Checkpoint
rng = np.random.default_rng(5)
steps = 100
tails = np.repeat(np.arange(steps), 3)
graph = Graph.from_arcs(steps + 1, tails, tails + 1, rng.integers(0, (9, 3, 9), (3 * steps, 3)))
paths = pareto_paths(graph, 0, steps, method="general", checkpoint=Checkpoint(sys.argv[1], every=0.01))
"""


@pytest.mark.proof  # tests/cli/test_checkpoint.py kills the command while it writes
@pytest.mark.parametrize("runs", [1, 2], ids=["alone", "beside another run with the same file"])
def test_it_survives_kill_9(tmp_path, chain, runs):
    graph, file = chain(100), tmp_path / "search.ckpt"
    exact = pareto_paths(graph, 0, 100, method="general")
    processes = [subprocess.Popen([sys.executable, "-c", KILLED, file]) for _ in range(runs)]
    while not file.exists():
        assert processes[0].poll() is None, "it was complete before it could be killed"
        time.sleep(0.001)
    for process in processes:
        process.kill()
        assert process.wait() == -signal.SIGKILL
    seen: list[Progress] = []
    paths = pareto_paths(graph, 0, 100, method="general", checkpoint=file, progress=seen.append)
    assert next(p.labels for p in seen if p.stage == "search") > 0
    same(paths, exact)
    assert os.listdir(tmp_path) == ["search.ckpt"]  # what it was writing is gone
