"""Solutions kept in a file: a search that was stopped begins with them, and what is no solution is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hpop.runtime.limits import Budget, Status
from hpop.search.machinery.checkpoint import CheckpointError, Saved
from hpop.search.timed import TimedGraph, timed_paths
from hpop.search.timed.solutions import ARCS, LEAVES
from tests.search.timed.instances import TimedQuery, timed_lattice
from tests.search.timed.semantics import check_timed_walks


@pytest.fixture(scope="module")
def query() -> TimedQuery:
    return timed_lattice(3, 6)


@pytest.fixture
def file(query: TimedQuery, tmp_path: Path) -> Path:
    """Return the checkpoint of a search that is stopped at once."""
    path = tmp_path / "solutions.ckpt"
    paths = timed_paths(*query, budget=Budget(max_labels=1), checkpoint=path)
    assert paths.status is Status.LABEL_LIMIT
    assert len(paths) > 0
    return path


def test_a_search_ends_with_the_same_front_whatever_it_begins_with(query: TimedQuery, file: Path) -> None:
    paths = timed_paths(*query, checkpoint=file)
    assert paths.status is Status.COMPLETE
    assert paths.costs.tolist() == timed_paths(*query).costs.tolist()
    check_timed_walks(query.graph, paths, query.source, query.targets)


def test_solutions_of_another_question_are_refused(query: TimedQuery, file: Path) -> None:
    blocked = query.graph.blocked.copy()
    blocked[0, 0] ^= True
    for other in (
        replace(query.graph, blocked=blocked),
        replace(query.graph, hold=5),
        replace(query.graph, arrive_by=None),
    ):
        with pytest.raises(CheckpointError, match="another problem"):
            timed_paths(other, query.source, query.targets, checkpoint=file)


@pytest.mark.parametrize("name", [ARCS, LEAVES])
@pytest.mark.parametrize("number", [-1, 1, 2**40, -(2**62)])
def test_what_is_no_path_on_the_clock_is_refused(query: TimedQuery, file: Path, name: str, number: int) -> None:
    saved = Saved.read(file)
    saved.arrays[name][len(saved.arrays[name]) // 2] += number
    saved.write(file)
    try:
        paths = timed_paths(*query, checkpoint=file)
    except CheckpointError:
        return
    check_timed_walks(query.graph, paths, query.source, query.targets)  # it happened to be another path
    assert paths.costs.tolist() == timed_paths(*query).costs.tolist()


def test_costs_are_not_taken_from_a_file(query: TimedQuery, file: Path) -> None:
    assert sorted(Saved.read(file).arrays) == ["arcs", "leaves", "sizes"]


def test_a_graph_of_a_source_that_is_a_target_needs_no_file(query: TimedQuery, tmp_path: Path) -> None:
    graph: TimedGraph = query.graph
    paths = timed_paths(graph, 0, 0, checkpoint=tmp_path / "none.ckpt")
    assert (paths.costs == np.zeros((1, graph.graph.criteria))).all()
