"""Claims: a graph prepared on a clock finds, from any node and tick, the front of all walks that come there by then."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hpop.errors import GraphError, QueryError
from hpop.runtime.limits import Budget, Status
from hpop.search import Graph
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.timed.prepared import PreparedTimed, TimedPath
from tests.search.timed.enumeration import TooMany, front_by_enumeration
from tests.search.timed.expanded import front_by_expansion
from tests.search.timed.instances import TimedQuery, timed_lattice, timed_query
from tests.search.timed.semantics import check_timed_walks

TOGETHER = 4  # questions a test
MOST = 100_000  # vectors of a question that are enumerated: a second or so


def from_there(query: TimedQuery, node: int, tick: int) -> TimedQuery:
    """Return the query from another node and tick: one arc of that duration leads there from a start without holds."""
    graph, h = query.graph, query.graph.horizon
    if tick == 0:
        return query._replace(source=node)
    static, places = graph.graph, graph.places
    longer = Graph.from_csr(
        np.append(static.indptr, static.arcs + 1),
        np.append(static.heads, node),
        np.concatenate([static.costs, np.zeros((1, static.criteria), np.int64)]),
        aggregates=static.aggregates,
    )
    rates = np.concatenate([graph.rate, np.zeros((1, static.criteria), np.int64)])
    standing = {j: np.concatenate([table, np.zeros((1, h + 1), np.int64)]) for j, table in graph.standing.items()}
    return TimedQuery(
        replace(
            graph,
            graph=longer,
            durations=np.append(graph.durations, np.int32(tick)),
            place=np.append(graph.place, np.int32(places)),
            stays=np.append(graph.stays, False),
            standing=standing,
            rate=rates,
            cut=np.concatenate([graph.cut, np.ones((1, h + 1), bool)]),
        ),
        static.nodes,
        query.targets,
    )


def front_of_all_walks(query: TimedQuery) -> list[tuple[int, ...]]:
    """By enumeration; of the twenty-fifth or so of the questions that have too many walks, on the expanded graph."""
    try:
        return front_by_enumeration(query, MOST)
    except TooMany:
        return front_by_expansion(query)


@pytest.mark.seeds(1, of=250)
def test_it_finds_the_front_of_all_walks_from_any_node_and_tick(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for one in range(20_000 + TOGETHER * seed, 20_000 + TOGETHER * (seed + 1)):
        query = timed_query(one)
        prepared = PreparedTimed(*query, begin=int(rng.integers(0, 3)))
        for node in np.flatnonzero(prepared.earliest < UNREACHABLE).tolist():
            tick = int(prepared.earliest[node] + rng.integers(0, 4))
            expected = front_of_all_walks(from_there(query, node, tick))
            paths = prepared.paths(node, tick)
            assert [tuple(row) for row in paths.costs.tolist()] == expected
            assert paths.status is (Status.COMPLETE if expected else Status.NO_PATH)
            # What is found is known later: it is there at once, and the front stays what it is.
            walks = [TimedPath(*found) for found in paths.places]
            at_once = prepared.paths(node, tick, deadline=0.0, known=walks)
            assert at_once.costs.tolist() == paths.costs.tolist()
            assert prepared.paths(node, tick, known=walks[::2]).costs.tolist() == paths.costs.tolist()


@pytest.mark.seeds(1, of=30)
def test_what_is_stopped_claims_no_less_than_is_missing(seed: int) -> None:
    query = timed_lattice(seed, 5 + seed % 4)
    prepared = PreparedTimed(*query)
    exact = prepared.paths(query.source, 0)
    assert exact.status is Status.COMPLETE
    check_timed_walks(query.graph, exact, query.source, query.targets)
    for labels in (1, 5, 50, 500):
        some = prepared.paths(query.source, 0, budget=Budget(max_labels=labels))
        check_timed_walks(query.graph, some, query.source, query.targets)
        if some.status.is_final:
            assert some.costs.tolist() == exact.costs.tolist()
        elif math.isfinite(some.gap):
            bound = (1 + some.gap) * exact.costs[:, None] + 1e-9
            assert (some.costs[None] <= bound).all(axis=2).any(axis=1).all()


def test_what_cannot_be_is_told() -> None:
    query = timed_query(3)
    prepared = PreparedTimed(*query, begin=2)
    with pytest.raises(QueryError, match="cannot be reached by tick 1"):
        prepared.paths(query.source, 1)
    with pytest.raises(QueryError, match="tick must be"):
        prepared.paths(query.source, -1)
    with pytest.raises(GraphError, match="TimedGraph"):
        PreparedTimed(query.graph.graph, 0, 1)  # type: ignore[arg-type]
    # Walks that the graph does not allow are left out.
    paths = prepared.paths(query.source, 2, deadline=0.0, known=[TimedPath(np.array([999]), np.array([2]))])
    assert not len(paths)
