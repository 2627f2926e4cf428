"""Claims of the questions which arcs are free: they settle every path, none is asked twice, few are asked in vain."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.base.arrays import BoolArray, IntArray
from hpop.search import Graph
from hpop.search.lazy_paths import BLOCKED, FREE, UNKNOWN, ArcStates


class Doors:
    """Free arcs, and the arcs that were queried, call by call."""

    def __init__(self, is_free: BoolArray) -> None:
        self.is_free, self.calls = is_free, list[list[int]]()

    def __call__(self, arcs: IntArray) -> BoolArray:
        self.calls.append(arcs.tolist())
        return self.is_free[arcs]


def line(arcs: int) -> Graph:
    """Nodes in a row, each with an arc to the next."""
    return Graph.from_arcs(arcs + 1, range(arcs), range(1, arcs + 1), np.ones((arcs, 1), int))


def never() -> bool:
    return False


@pytest.mark.seeds(8, of=200)
def test_each_path_is_then_free_all_along_or_known_to_be_blocked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    graph = Graph.from_arcs(12, *rng.integers(0, 12, (2, 60)), np.ones((60, 1), int))
    doors = Doors(rng.random(60) < 0.6)
    paths = [rng.permutation(60)[:size] for size in rng.integers(0, 9, 15)]
    asked = ArcStates(graph, doors)
    lengths = np.array([path.size for path in paths])
    assert asked.settle(np.concatenate(paths), lengths, never)
    known = asked.state != UNKNOWN
    assert ((asked.state == FREE) == (doors.is_free & known)).all()
    assert ((asked.state == BLOCKED) == (~doors.is_free & known)).all()
    for path, free in zip(paths, asked.are_free(np.concatenate(paths), lengths).tolist(), strict=True):
        assert free == doors.is_free[path].all()
        assert free == known[path].all() or (asked.state[path] == BLOCKED).any()
    questions = [arc for call in doors.calls for arc in call]
    assert len(questions) == len(set(questions)) == np.count_nonzero(known)


def test_of_a_blocked_path_nothing_is_asked_once_that_is_known() -> None:
    doors = Doors(np.zeros(5, np.bool_))
    ArcStates(line(5), doors).settle(np.arange(5), np.array([5]), never)
    assert doors.calls == [[0]]


def test_the_arc_at_whose_ends_most_arcs_were_blocked_is_asked_about_first() -> None:
    tails, heads = [0, 1, 2, 3, 5, 6], [1, 2, 3, 4, 3, 3]
    graph = Graph.from_arcs(7, tails, heads, np.ones((6, 1), int))
    doors = Doors(np.array([True, True, True, False, True, True]))
    asked = ArcStates(graph, doors)
    asked.record(np.array([4, 5]), np.array([False, False]))  # both lead to node 3
    asked.settle(np.arange(4), np.array([4]), never)
    assert doors.calls == [[2], [3]]  # 2 -> 3 is free, 3 -> 4 is blocked, and tells all


def test_an_arc_that_paths_share_is_asked_about_once_and_blocks_them_all() -> None:
    doors = Doors(np.array([False, True, True, True]))
    asked = ArcStates(line(4), doors)
    asked.settle(np.array([0, 1, 0, 2, 3, 0]), np.array([2, 4]), never)
    assert doors.calls == [[0]]
    assert asked.blocked.tolist() == [True, False, False, False]


def test_what_is_late_has_asked_about_so_many_and_says_that_there_are_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hpop.search.lazy_paths.AT_ONCE", 2)
    doors = Doors(np.ones(5, np.bool_))
    asked = ArcStates(line(5), doors)
    several = np.arange(5), np.ones(5, np.int64)
    assert not asked.settle(*several, lambda: True)
    assert doors.calls == [[0, 1]]
    assert asked.settle(*several, never)
    assert doors.calls == [[0, 1], [2, 3], [4]]
