"""Claims: a search on a clock that is stopped anywhere has real walks; what is missing is within its gap."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Progress, Status
from hpop.search.machinery import slices
from hpop.search.timed import TimedPaths, bounds, search, timed_paths
from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.expanded import front_by_expansion
from tests.search.timed.instances import TimedQuery, timed_lattice, timed_query
from tests.search.timed.semantics import Vector, check_timed_walks
from tests.search.timed.test_precision import uncovered

stages = import_module("hpop.search.timed.timed_paths")


def is_honest(query: TimedQuery, paths: TimedPaths, exact: list[Vector]) -> None:
    """All that it says of itself is so."""
    check_timed_walks(query.graph, paths, query.source, query.targets)
    if paths.status.is_final:
        assert [tuple(row) for row in paths.costs.tolist()] == exact
        assert paths.gap == 0
    elif np.isfinite(paths.gap):
        assert uncovered(exact, paths.costs.tolist(), paths.gap, [0] * query.graph.graph.criteria) == []


@pytest.mark.seeds(1, of=100)
def test_after_any_number_of_labels(seed):
    for one in range(5 * seed, 5 * (seed + 1)):
        query = timed_query(one)
        exact = front_by_enumeration(query)
        for labels in (1, 2, 4, 8, 16, 64):
            is_honest(query, timed_paths(*query, budget=Budget(max_labels=labels)), exact)


@pytest.mark.seeds(1, of=40)
def test_after_any_number_of_labels_on_a_lattice(seed):
    query = timed_lattice(seed, 5 + seed % 4, duration=True)
    exact, labels, stopped = front_by_expansion(query), 1, 0
    while (paths := timed_paths(*query, budget=Budget(max_labels=labels))).status is Status.LABEL_LIMIT:
        is_honest(query, paths, exact)
        assert paths.stats.labels_generated >= labels
        labels, stopped = 2 * labels, stopped + 1
    is_honest(query, paths, exact)
    assert paths.status.is_final
    assert stopped > 3 or timed_paths(*query).stats.labels_generated < 16  # bounds alone tell all of some questions


def test_the_gap_is_the_same_in_blocks_of_any_size(monkeypatch):
    """Open labels are examined in blocks: all at once would take more memory than the search."""
    query = timed_lattice(2, 8, duration=True)
    for labels in (20, 200):
        gaps = set()
        for block in (1, 3, 1 << 16):
            monkeypatch.setattr(search, "BLOCK", block)
            gaps.add(timed_paths(*query, budget=Budget(max_labels=labels)).gap)
        assert len(gaps) == 1
        assert gaps != {0.0}


@pytest.mark.seeds(1, of=20)
def test_after_ctrl_c_at_any_report(monkeypatch, seed):
    monkeypatch.setattr(slices, "WORK", 500)
    monkeypatch.setattr(bounds, "MANY", -1)
    monkeypatch.setattr(bounds, "STEPS", 1000)
    query = timed_lattice(seed, 6, duration=True)
    exact, left, reports = front_by_expansion(query), 0, 0

    def stop(progress: Progress) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise KeyboardInterrupt

    paths = None
    while paths is None or not paths.status.is_final:
        reports += 1
        left = reports
        paths = timed_paths(*query, progress=stop)
        is_honest(query, paths, exact)
        assert paths.status is Status.INTERRUPTED or paths.status.is_final
    assert reports > 3


@pytest.mark.parametrize("budget", [Budget(max_memory=1), Budget(time_limit=1e-9)], ids=["memory", "time"])
def test_with_nothing_to_spend_it_says_so(budget):
    query = timed_lattice(0, 5)
    paths = timed_paths(*query, budget=budget)
    assert paths.status is (Status.MEMORY_LIMIT if budget.max_memory else Status.TIME_LIMIT)
    is_honest(query, paths, front_by_expansion(query))


@pytest.mark.seeds(1, of=30)
def test_from_its_file_it_comes_to_the_same_front(monkeypatch, tmp_path, seed):
    monkeypatch.setattr(slices, "WORK", 500)
    query, options = timed_lattice(seed, 6, duration=True), {"eps": 0.1} if seed % 3 == 2 else {}
    left = 0

    def stop(progress: Progress) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise KeyboardInterrupt

    whole, pieces, paths = timed_paths(*query, **options), 0, None
    while paths is None or not paths.status.is_final:
        pieces += 1
        left = 4 + 3 * pieces
        paths = timed_paths(*query, **options, progress=stop, checkpoint=tmp_path / "search.ckpt")
        check_timed_walks(query.graph, paths, query.source, query.targets)
    assert pieces > 1
    if options:  # who begins with solutions may be covered by others of them
        assert uncovered([tuple(row) for row in front_by_expansion(query)], paths.costs.tolist(), 0.1, [0] * 4) == []
    else:
        assert paths.costs.tolist() == whole.costs.tolist()
    assert (paths.status, paths.gap) == (whole.status, whole.gap)


@pytest.mark.seeds(1, of=40)
def test_what_one_search_has_found_the_next_and_coarser_one_does_not_lose(monkeypatch, seed):
    """Without looks ahead from where a slice ends, a search with more labels goes on from one with fewer."""
    monkeypatch.setattr(stages, "SOON", 60)
    monkeypatch.setattr(search, "FOLLOWED", 0)
    query = timed_lattice(seed, 5 + seed % 4, duration=True)
    exact, labels = front_by_expansion(query), 40
    sooner: list[Vector] = []
    while (paths := timed_paths(*query, budget=Budget(max_labels=labels))).status is Status.LABEL_LIMIT:
        is_honest(query, paths, exact)
        found = [tuple(row) for row in paths.costs.tolist()]
        assert uncovered(sooner, found, 0.0, [0] * len(exact[0])) == []
        labels, sooner = labels + labels // 4, found
    is_honest(query, paths, exact)
