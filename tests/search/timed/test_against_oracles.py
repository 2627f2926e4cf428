"""Claims: the timed search finds the front of all walks, by two oracles that share nothing with it, and real walks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hpop.runtime.limits import Status
from hpop.search import Graph
from hpop.search.timed import bounds, timed_paths
from hpop.search.timed.graph import TimedGraph
from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.expanded import front_by_expansion
from tests.search.timed.instances import TimedQuery, timed_lattice, timed_query
from tests.search.timed.semantics import Vector, check_timed_walks

TOGETHER = 10  # questions a test


def agrees(query: TimedQuery, expected: list[Vector]) -> None:
    """Check that the search finds these vectors, and a walk for each."""
    paths = timed_paths(*query)
    assert [tuple(row) for row in paths.costs.tolist()] == expected
    assert paths.status is (Status.COMPLETE if expected else Status.NO_PATH)
    assert paths.gap == 0
    check_timed_walks(*query[:1], paths, *query[1:])


@pytest.mark.seeds(1, of=150)
def test_it_finds_the_front_of_all_walks(seed):
    for one in range(TOGETHER * seed, TOGETHER * (seed + 1)):
        query = timed_query(one)
        agrees(query, front_by_enumeration(query))


@pytest.mark.seeds(1, of=150)
def test_it_finds_the_front_of_the_expanded_graph(seed):
    for one in range(10_000 + TOGETHER * seed, 10_000 + TOGETHER * (seed + 1)):
        query = timed_query(one)
        agrees(query, front_by_expansion(query))


@pytest.mark.seeds(1, of=100)
def test_it_finds_it_where_first_solutions_are_looked_for_next_to_best_ways(monkeypatch, seed):
    """As in large graphs; nodes on no path are then omitted. A slice of the sweeps is a few states."""
    monkeypatch.setattr(bounds, "MANY", -1)
    monkeypatch.setattr(bounds, "STEPS", 3)
    for one in range(30_000 + TOGETHER * seed, 30_000 + TOGETHER * (seed + 1)):
        query = timed_query(one)
        agrees(query, front_by_enumeration(query))


@pytest.mark.seeds(1, of=60)
def test_arcs_that_share_rows_of_tables_are_as_if_each_had_its_own(seed):
    for one in range(40_000 + TOGETHER * seed, 40_000 + TOGETHER * (seed + 1)):
        query = timed_query(one)
        graph, rng = query.graph, np.random.default_rng(one)
        count = len(graph.timed)
        rows = rng.integers(0, 1 + count // 2, count) if count else np.zeros(0, np.int64)
        own = {j: table[rows] for j, table in graph.costs.items()}
        shared = replace(graph, rows=rows)
        agrees(query._replace(graph=shared), front_by_enumeration(query._replace(graph=shared)))
        apart = replace(graph, costs=own, blocked=graph.blocked[rows])
        agrees(query._replace(graph=apart), front_by_enumeration(query._replace(graph=shared)))


@pytest.mark.parametrize("options", [{}, {"worst": True}, {"duration": True}], ids=["sums", "worst", "duration"])
@pytest.mark.seeds(1, of=30)
def test_it_finds_that_of_expanded_lattices(seed, options):
    query = timed_lattice(seed, 4 + seed % 5, **options)
    for hold in (query.graph.hold, None, 1):
        asked = query._replace(graph=replace(query.graph, hold=hold))
        agrees(asked, front_by_expansion(asked))


def two_nodes(static: list[int], **options: Any) -> TimedGraph:
    """Return an arc of three ticks, and a horizon of four."""
    return TimedGraph(Graph.from_arcs(2, [0], [1], [static]), np.array([3], np.int32), 4, **options)


@pytest.mark.parametrize(("arrive_by", "expected"), [(None, [[2]]), (6, [[2]]), (5, [[5]]), (3, [[5]]), (2, [])])
def test_who_must_arrive_soon_pays_for_it(arrive_by, expected):
    """Left for at tick 0 the arc costs 5; at tick 3, after a hold of 3 ticks, nothing, and the hold costs 2."""
    graph = two_nodes(
        [9],
        timed=[0],
        costs={0: [[5, 5, 5, 0, 0]]},
        standing={0: [[0, 1, 1, 2, 2], [0, 7, 8, 9, 9]]},
        hold=3,
        arrive_by=arrive_by,
    )
    assert timed_paths(graph, 0, 1).costs.tolist() == expected


def test_who_is_there_already_has_nothing_to_pay():
    paths = timed_paths(two_nodes([4, 4], hold=1, arrive_by=0, rate=[[1 << 20] * 2] * 2), 0, [0, 1])
    assert paths.costs.tolist() == [[0, 0]]
    assert [column.tolist() for column in paths.steps(0)] == [[0], [], [0]]


def test_steps_by_hand():
    """A hold at the source from 0 to 2, then the arc: arrival at tick 5."""
    graph = two_nodes([1], timed=[0], blocked=[[True, True, False, False, False]], hold=2, rate=[[3 << 20], [0]])
    paths = timed_paths(graph, 0, 1)
    assert paths.costs.tolist() == [[7]]
    assert [column.tolist() for column in paths.steps(0)] == [[0, 0, 1], [-1, 0], [0, 2, 5]]
