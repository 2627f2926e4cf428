"""Among paths with equal costs, the search returns one that does not stop twice where once would do."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from hpop.search import Graph
from hpop.search.timed import timed_paths
from hpop.search.timed.graph import RATE, TimedGraph
from tests.search.timed.semantics import HOLD, Semantics, Vector, check_timed_walks


def cost_of(of: Semantics, source: int, arcs: list[int], leaves: list[int]) -> Vector | None:
    """Return the costs of arcs left at some ticks, with holds between them; None where that is impossible."""
    v, ready, costs = source, 0, (0,) * len(of.aggregates)
    for arc, t in zip(arcs, leaves, strict=True):
        if t != ready:
            if of.hold is None or t - ready < of.hold or not of.may_stand(of.place[v], ready, t):
                return None
            costs = of.add(costs, of.hold_costs(of.place[v], ready, t))
        if not of.may_leave(arc, v, t):
            return None
        costs = of.add(costs, of.arc_costs(arc, v, t))
        v, ready = of.heads[arc], t + of.durations[arc]
    return costs


def test_a_robot_that_lets_somebody_pass_stops_once() -> None:
    """Ten steps in a row, of which the last is blocked for a while; waiting costs a count a tick, wherever it is."""
    graph = Graph.from_arcs(11, range(10), range(1, 11), [[1, 0]] * 10)
    blocked = np.zeros((1, 41), np.bool_)
    blocked[0, :40] = True
    timed = TimedGraph(graph, [1] * 10, 40, timed=[9], blocked=blocked, rate=[[RATE, 0]] * 11, hold=3)
    paths = timed_paths(timed, 0, 10)
    assert paths.costs.tolist() == [[41, 0]]
    assert (paths.steps(0).arcs == HOLD).sum() == 1
    check_timed_walks(timed, paths, 0, [10])


def gated(seed: int) -> TimedGraph:
    """Return a row of nodes with a path beside it; arcs are blocked at times, and waiting costs nearly nothing more."""
    rng = np.random.default_rng(seed)
    n, horizon = 7, 30
    tails, heads = [*range(n - 1), *range(n - 1)], [*range(1, n), *range(1, n)]
    graph = Graph.from_arcs(n, tails, heads, rng.integers(0, 2, (len(tails), 2)))
    blocked = np.repeat(rng.random((graph.arcs, 8)) < 0.7, 4, axis=1)[:, : horizon + 1]
    blocked[:, horizon] = False
    rate = np.where(rng.random((n, 2)) < 0.2, 2 * RATE, RATE) * [1, 0]
    every = np.arange(graph.arcs)
    return TimedGraph(graph, rng.integers(1, 3, graph.arcs), horizon, timed=every, blocked=blocked, rate=rate, hold=1)


@pytest.mark.seeds(4, of=30)
def test_no_two_holds_of_a_path_could_be_one_at_the_same_cost(seed: int) -> None:
    graph = gated(seed)
    paths = timed_paths(graph, 0, 6)
    of, place_of = Semantics(graph), {int(arc): place for place, arc in enumerate(graph.graph.arc)}
    check_timed_walks(graph, paths, 0, [6])
    assert len(paths)
    for i in range(len(paths)):
        steps, costs = paths.steps(i), tuple(paths.costs[i].tolist())
        moves = steps.arcs != HOLD
        arcs = [place_of[int(arc)] for arc in steps.arcs[moves]]
        leaves = steps.departures[:-1][moves].tolist()
        ready = [0, *(t + of.durations[arc] for arc, t in zip(arcs, leaves, strict=True))][: len(arcs)]
        waits = [t - r for t, r in zip(leaves, ready, strict=True)]
        assert cost_of(of, 0, arcs, leaves) == costs
        for a, b in combinations([k for k, wait in enumerate(waits) if wait], 2):
            for later in (waits[b], -waits[a]):
                moved = [t + later * (a <= k < b) for k, t in enumerate(leaves)]
                assert cost_of(of, 0, arcs, moved) != costs
