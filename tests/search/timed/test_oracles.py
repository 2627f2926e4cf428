"""Claims: the two oracles agree, and the questions that are asked of them are of all kinds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.expanded import front_by_expansion
from tests.search.timed.instances import timed_query

TOGETHER = 10  # questions a test


@pytest.mark.seeds(1, of=150)
def test_the_oracles_agree(seed):
    for one in range(TOGETHER * seed, TOGETHER * (seed + 1)):
        query = timed_query(one)
        assert front_by_expansion(query) == front_by_enumeration(query)


@pytest.mark.proof
def test_questions_are_of_all_kinds():
    """Holds are used, waiting is cut short, arcs are blocked, time runs out: each changes some of the first fronts."""
    queries = [timed_query(seed) for seed in range(40)]
    fronts = [front_by_expansion(query) for query in queries]
    changes = {
        "no holds": lambda graph: replace(graph, hold=None),
        "no cuts": lambda graph: replace(graph, cut=np.zeros_like(graph.cut)),
        "nothing blocked": lambda graph: replace(graph, blocked=np.zeros_like(graph.blocked)),
        "no tables": lambda graph: replace(graph, costs={}),
        "standing free": lambda graph: replace(graph, standing={}, rate=np.zeros_like(graph.rate)),
        "nothing stays": lambda graph: replace(graph, stays=np.zeros_like(graph.stays)),
        "later": lambda graph: replace(graph, arrive_by=graph.arrive_by and graph.arrive_by + 3),
    }
    for name, change in changes.items():
        others = [front_by_expansion(query._replace(graph=change(query.graph))) for query in queries]
        assert sum(a != b for a, b in zip(fronts, others, strict=True)) >= 2, name
    assert {query.graph.graph.criteria for query in queries} == {1, 2, 3, 4, 5, 6}
