"""Claims: rules of dominance that are easily believed lose vectors; which ones, on instances one can check by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hpop.search import Graph
from hpop.search.timed import timed_paths
from hpop.search.timed.graph import TimedGraph
from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.instances import TimedQuery, timed_query
from tests.search.timed.label_setting import (
    across_cuts,
    by_waiting,
    equal_ticks,
    front_by_labels,
    short_holds,
    time_as_a_cost,
)


def on_a_line(costs: list[Any], tables: dict[int, Any], **options: Any) -> TimedQuery:
    """Three places in a row, 0, 1 and 2, with two arcs from 0 to 1, of 1 and of more ticks, and a timed one to 2.

    costs    (3, k)    of the three arcs
    tables   (1, H+1)  by cost, of the last arc
    """
    later = options.pop("later", 2)
    horizon = len(next(iter(tables.values()))[0]) - 1
    given = {
        "cut": np.zeros((3, horizon + 1), bool),
        "rate": np.zeros((3, len(costs[0])), np.int64),
        "standing": {},
        "hold": None,
        "arrive_by": None,
    } | options
    graph = TimedGraph(
        graph=Graph.from_arcs(3, [0, 0, 1], [1, 1, 2], costs),
        durations=np.array([1, later, 1], np.int32),
        horizon=horizon,
        timed=np.array([2], np.int32),
        costs={j: np.array(table) for j, table in tables.items()},
        blocked=np.zeros((1, horizon + 1), bool),
        place=np.arange(3, dtype=np.int32),
        stays=np.zeros(3, bool),
        **given,
    )
    return TimedQuery(graph, 0, (2,))


def found(query: TimedQuery) -> list[tuple[int, ...]]:
    """Return the front of the search."""
    return [tuple(row) for row in timed_paths(*query).costs.tolist()]


def test_the_arrival_as_one_more_cost_loses_the_only_optimum():
    """To the middle by tick 1 for 0, by tick 2 for 1; from there to the goal for 9 at tick 1 and for 0 from tick 2."""
    query = on_a_line([[0], [1], [0]], {0: [[9, 9, 0]]})
    assert found(query) == front_by_enumeration(query) == front_by_labels(query, equal_ticks) == [(1,)]
    assert front_by_labels(query, time_as_a_cost) == [(9,)]


def test_to_leave_at_once_loses_the_way_of_who_waits():
    """A person stands beside the passage until tick 5: intrusion is 3 at once, 0 after a hold; a tick costs 1."""
    query = on_a_line([[0, 1], [0, 9], [0, 1]], {0: [[3, 3, 3, 3, 3, 0]]}, hold=2, rate=np.array([[0, 1 << 20]] * 3))
    assert found(query) == front_by_enumeration(query) == front_by_labels(query, by_waiting) == [(0, 6), (3, 2)]
    assert front_by_labels(query, by_waiting, at_once=True) == [(3, 2)]


def test_to_compare_across_a_cut_loses_who_comes_after_it():
    """Waiting in the middle is free but forbidden at tick 2; a path that comes at tick 4 leaves at a lower cost."""
    cut = np.zeros((3, 6), bool)
    cut[1, 2] = cut[0] = True
    query = on_a_line([[0], [1], [0]], {0: [[9, 9, 9, 9, 0, 0]]}, hold=1, cut=cut, later=4)
    assert found(query) == front_by_enumeration(query) == front_by_labels(query, by_waiting) == [(1,)]
    assert front_by_labels(query, across_cuts) == [(9,)]


def test_to_wait_for_less_than_a_hold_loses_who_comes_just_in_time():
    """A hold lasts 3 ticks at least; who came at tick 1 may not leave at tick 2, the only one at which it is cheap."""
    cut = np.array([[True] * 5, [False] * 5, [False] * 5])
    query = on_a_line([[0], [1], [0]], {0: [[9, 9, 0, 9, 9]]}, hold=3, cut=cut)
    assert found(query) == front_by_enumeration(query) == front_by_labels(query, by_waiting) == [(1,)]
    assert front_by_labels(query, short_holds) == [(9,)]


@pytest.mark.seeds(1, of=50)
def test_sound_rules_lose_nothing(seed):
    for one in range(10 * seed, 10 * (seed + 1)):
        query = timed_query(one)
        exact = front_by_enumeration(query)
        assert front_by_labels(query, equal_ticks) == exact
        assert front_by_labels(query, by_waiting) == exact


def test_unsound_rules_lose_vectors_of_random_questions_too():
    lost = {"time as a cost": 0, "at once": 0}
    for query in map(timed_query, range(25)):
        exact = front_by_enumeration(query)
        lost["time as a cost"] += front_by_labels(query, time_as_a_cost) != exact
        lost["at once"] += front_by_labels(query, by_waiting, at_once=True) != exact
    assert min(lost.values()) > 0, lost
