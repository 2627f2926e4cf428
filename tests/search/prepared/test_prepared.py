"""Claims: a prepared graph finds what a fresh one without the closed arcs has, and never promises more than that."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable

import numpy as np
import pytest

from hpop.base.arrays import BoolArray, IntArray
from hpop.errors import GraphError, QueryError
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, ParetoPaths, Prepared, pareto_paths
from hpop.search import prepared as prepared_graph
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds
from hpop.search.machinery.slices import Clock

EVENTS = 10  # of one drive: closings and openings, each followed by a question


def any_graph(seed: int, lattice: Callable[..., Graph]) -> Graph:
    """By turns a lattice whose turns are alike, one whose turns differ, and graphs without turns, of 1 to 5 costs."""
    rng = np.random.default_rng(seed)
    kind = seed % 4
    if kind in (0, 1):
        graph = lattice(seed)
        if kind == 0:
            return graph
        costs = graph.costs.copy()
        turns = costs[:, 1] > 0
        angle = np.abs(np.subtract.outer(np.arange(4), np.arange(4))).ravel()
        tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
        apart = angle[(tails % 4) * 4 + graph.heads % 4]
        costs[turns, 0] += 3 + np.minimum(apart, 4 - apart)[turns]
        return Graph.from_csr(graph.indptr, graph.heads, costs, aggregates=["sum", "sum", "sum"])
    k = 1 + seed // 4 % 5
    tails, heads = rng.integers(0, 25, (2, 150))
    aggregates = [("sum", "max")[int(rng.integers(2))] for _ in range(k)]
    return Graph.from_arcs(25, tails, heads, rng.integers(0, (5, 2000)[kind == 3], (150, k)), aggregates=aggregates)


def an_event(graph: Graph, closed: BoolArray, rng: np.random.Generator, number: int) -> tuple[IntArray, IntArray]:
    """Arcs to close and to open: single ones, all of a place, all turns of places, or what was closed before."""
    tails, shut = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)), np.flatnonzero(closed)
    place, nothing = rng.integers(graph.nodes // 4, size=graph.nodes // 16), shut[:0]
    match number % 5:
        case 0:
            return np.flatnonzero((tails // 4 == place[0]) | (graph.heads // 4 == place[0])), nothing
        case 1:
            return np.flatnonzero((tails // 4 == graph.heads // 4) & np.isin(tails // 4, place)), nothing
        case 2:
            return nothing, shut[rng.random(shut.size) < 0.5]
        case 3:
            return rng.choice(graph.arcs, 4), nothing
        case _:
            return nothing, shut


def costs_along(graph: Graph, paths: ParetoPaths, closed: BoolArray, source: int, targets: set[int]) -> list[list[int]]:
    """Return the summed costs of paths; each path leads from the source to a target by open arcs."""
    worst = np.array([aggregate == "max" for aggregate in graph.aggregates])
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    found = []
    for arcs in np.split(paths.all_arcs, np.cumsum(paths.lengths)[:-1]) if len(paths) else []:
        nodes = [source, *graph.heads[arcs].tolist()]
        assert tails[arcs].tolist() == nodes[:-1]
        assert nodes[-1] in targets
        assert not closed[arcs].any()
        rows = graph.costs[arcs]
        found.append(np.where(worst, rows.max(axis=0, initial=0), rows.sum(axis=0)).tolist())
    return found


@pytest.mark.seeds(2, of=60)
def test_after_every_event_the_front_is_that_of_a_fresh_graph(seed: int, lattice: Callable[..., Graph]) -> None:
    graph, rng = any_graph(seed, lattice), np.random.default_rng(seed)
    targets = {int(node) for node in rng.integers(0, graph.nodes, 2)}
    prepared, closed, known = Prepared(graph, targets), np.zeros(graph.arcs, np.bool_), pareto_paths(graph, 0, targets)
    for number in range(EVENTS):
        shut, opened = an_event(graph, closed, rng, number)
        closed[shut], closed[opened] = True, False
        prepared.close(shut)
        prepared.open(opened)
        assert (prepared.closed == closed).all()
        source = int(rng.integers(graph.nodes))
        if number % 2 and len(known):  # as in a drive: on the way of a plan, whose rest is known
            nodes = known.nodes(int(rng.integers(len(known))))
            source = int(nodes[rng.integers(nodes.size)])
        expected = pareto_paths(graph.without(closed), source, targets)
        found = prepared.paths(source, known=known.suffixes(source))
        assert found.status is expected.status
        assert found.costs.tolist() == expected.costs.tolist() == costs_along(graph, found, closed, source, targets)
        assert found.gap == 0
        known = found


@pytest.mark.seeds(2, of=60)
def test_bounds_are_those_made_anew_after_every_event(seed: int, lattice: Callable[..., Graph]) -> None:
    graph, rng = any_graph(seed, lattice), np.random.default_rng(seed)
    targets = np.array([graph.nodes - 1])
    prepared, closed = Prepared(graph, graph.nodes - 1), np.zeros(graph.arcs, np.bool_)
    tails, worst = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr)), np.array(graph.aggregates) == "max"
    for number in range(EVENTS):
        shut, opened = an_event(graph, closed, rng, number)
        closed[shut], closed[opened] = True, False
        prepared.close(shut)
        prepared.open(opened)
        anew, _, _ = lower_bounds(graph.without(closed), 0, targets, Clock(Budget(), None))
        assert (prepared.bounds == anew).all()
        for j in range(graph.criteria):  # and each node knows the next one on a way of that cost
            for node in np.flatnonzero((anew[j] < UNREACHABLE) & (prepared.onward[j] >= 0)).tolist():
                out = np.flatnonzero((tails == node) & (graph.heads == prepared.onward[j, node]) & ~closed)
                ahead, costs = anew[j, prepared.onward[j, node]], graph.costs[out, j]
                assert anew[j, node] in (np.maximum(costs, ahead) if worst[j] else costs + ahead)


@pytest.mark.seeds(3, of=8)
def test_with_ties_broken_the_path_of_a_cost_that_is_mostly_0_is_non_dominated(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tails, heads = np.divmod(rng.choice(3600, 500, replace=False), 60)  # no parallel arcs
    costs = rng.integers(1, 50, (500, 3))
    costs[:, 0] = rng.random(500) < 0.1
    graph = Graph.from_arcs(60, tails, heads, costs)
    prepared = Prepared(graph, 0)
    for _ in range(3):
        prepared.break_ties(0)
        is_open = np.flatnonzero(~prepared.closed)
        tails = np.repeat(np.arange(60), np.diff(graph.indptr))
        fresh = Graph.from_arcs(60, tails[is_open], graph.heads[is_open], graph.costs[is_open])
        for source in range(1, 60):
            paths = prepared.least_paths(source)
            front = pareto_paths(fresh, source, 0).costs.tolist()
            assert bool(paths) == bool(front)
            assert not front or graph.costs[paths[0]].sum(axis=0).tolist() in front
        prepared.close(rng.choice(is_open, 60))


def covers(front: IntArray, exact: IntArray, gap: float) -> bool:
    """Check that every exact vector has a vector of the front that is at most (1 + gap) times it."""
    return all((front <= exact[i] * (1 + gap) + 1e-9).all(axis=1).any() for i in range(len(exact)))


@pytest.mark.seeds(3, of=40)
@pytest.mark.parametrize("limit", [1, 40, 300])
def test_the_gap_that_is_told_is_true_of_what_was_found_and_known(
    seed: int, limit: int, lattice: Callable[..., Graph]
) -> None:
    graph, rng = lattice(seed, 7), np.random.default_rng(seed)
    costs = graph.costs + (graph.costs > 0) * rng.integers(0, 50, graph.costs.shape) * [1, 0, 1]
    graph = Graph.from_csr(graph.indptr, graph.heads, costs)
    prepared, exact = Prepared(graph, graph.nodes - 1), pareto_paths(graph, 0, graph.nodes - 1)
    some = exact.select(exact.costs, np.arange(0, len(exact), 5)).suffixes(0)
    for known in ([], some):
        found = prepared.paths(0, budget=Budget(max_labels=limit), known=known)
        assert found.status in (Status.LABEL_LIMIT, exact.status)
        if len(found):
            assert found.gap < math.inf
            assert covers(found.costs, exact.costs, found.gap)
        assert len(found) >= len(known)
        assert costs_along(graph, found, prepared.closed, 0, {graph.nodes - 1}) == found.costs.tolist()


def rich(lattice: Callable[..., Graph], seed: int, width: int) -> Graph:
    """Return a lattice whose moves cost up to a thousand, for many trade-offs, with equal or unequal turns."""
    graph, rng = lattice(seed, width), np.random.default_rng(seed)
    costs = graph.costs.copy()
    turn = costs[:, 1] > 0
    costs[~turn, 0] = rng.integers(1, 1000, (~turn).sum())
    costs[~turn, 2] = rng.integers(100, 300, (~turn).sum())
    costs[turn, 0] = 50 if seed % 2 else rng.integers(40, 70, turn.sum())
    return Graph.from_csr(graph.indptr, graph.heads, costs)


@pytest.mark.seeds(2, of=30)
def test_what_a_search_within_a_tenth_proves_among_closed_places_is_true(
    seed: int, lattice: Callable[..., Graph], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prepared_graph, "MANY", 0 if seed % 4 else 10**6)
    width = 12 if seed % 3 else 24
    graph, rng = rich(lattice, seed, width), np.random.default_rng(seed)
    target = graph.nodes - 1
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    prepared, places = Prepared(graph, target), rng.integers(2, graph.nodes // 4 - 2, width // 4)
    prepared.close(np.flatnonzero(np.isin(tails // 4, places) | np.isin(graph.heads // 4, places)))
    exact = prepared.paths(0)
    if exact.status is Status.NO_PATH:
        return
    found = prepared.paths(0, budget=Budget(max_labels=int(0.9 * exact.stats.labels_generated)))
    assert found.status is Status.LABEL_LIMIT
    assert covers(found.costs, exact.costs, found.gap)
    assert costs_along(graph, found, prepared.closed, 0, {target}) == found.costs.tolist()


def test_a_long_search_that_is_stopped_has_proved_a_tenth(lattice: Callable[..., Graph]) -> None:
    graph = rich(lattice, 3, 30)
    prepared = Prepared(graph, graph.nodes - 1)
    exact = prepared.paths(0)
    found = prepared.paths(0, budget=Budget(max_labels=exact.stats.labels_generated // 2))
    assert found.status is Status.LABEL_LIMIT
    assert 0 < found.gap <= 0.1
    assert covers(found.costs, exact.costs, found.gap)


def test_after_a_deadline_of_nothing_there_is_what_was_known_and_its_gap(lattice: Callable[..., Graph]) -> None:
    graph = lattice(3, 7)
    exact, prepared = pareto_paths(graph, 0, graph.nodes - 1), Prepared(graph, graph.nodes - 1)
    found = prepared.paths(0, deadline=0, known=exact.suffixes(0))
    assert found.status is Status.TIME_LIMIT
    assert found.costs.tolist() == exact.costs.tolist()
    least = exact.costs.min(axis=0)  # all that is known without a search
    assert found.gap == pytest.approx((exact.costs / least - 1).max(axis=1).min())
    alone = prepared.paths(0, deadline=0)  # the least ways in each cost, which bounds know
    assert (alone.costs.min(axis=0) == least).all()
    assert covers(alone.costs, exact.costs, alone.gap)
    assert found.gap <= alone.gap < math.inf


def test_known_paths_through_what_was_closed_since_are_left_out(lattice: Callable[..., Graph]) -> None:
    graph = lattice(3, 7)
    exact, prepared = pareto_paths(graph, 0, graph.nodes - 1), Prepared(graph, graph.nodes - 1)
    shut = exact.all_arcs[:1]
    prepared.close(shut)
    found = prepared.paths(0, deadline=0, known=exact.suffixes(0))
    assert 0 < len(found) < len(exact)
    assert not np.isin(found.all_arcs, shut).any()


def test_an_interrupted_search_returns_what_it_has(chain: Callable[..., Graph]) -> None:
    graph = chain(60)

    def interrupt(progress: Progress) -> None:
        if progress.stage == "search" and progress.front:
            signal.raise_signal(signal.SIGINT)

    prepared = Prepared(graph, 60)
    found = prepared.paths(0, progress=interrupt)
    assert found.status is Status.INTERRUPTED
    assert found.gap > 0
    exact = prepared.paths(0)
    assert exact.status is Status.COMPLETE
    assert covers(found.costs, exact.costs, found.gap)


def test_suffixes_are_the_rest_of_the_paths_that_pass_a_node() -> None:
    graph = Graph.from_arcs(4, [0, 1, 1, 2, 0], [1, 2, 3, 3, 3], [[1, 5], [1, 1], [3, 1], [1, 1], [1, 9]])
    paths = pareto_paths(graph, 0, 3)
    assert sorted(rest.tolist() for rest in paths.suffixes(1)) == [[2, 4], [3]]  # indices of arcs, sorted by tail
    assert [rest.size for rest in paths.suffixes(3)] == [0] * len(paths)


@pytest.mark.parametrize(
    ("known", "why"),
    [
        ([2], "arc by arc"),
        ([0], "to a target"),
        ([9], "from 0 to 2"),
        ([-1], "from 0 to 2"),
        ([0.5], "indices of arcs"),
    ],
)
def test_a_known_path_that_is_none_is_refused(known: list[float], why: str) -> None:
    prepared = Prepared(Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1], [1], [9]]), 2)
    with pytest.raises(QueryError, match=why):
        prepared.paths(0, known=[np.array(known)])


@pytest.mark.parametrize("arcs", [[3], [-1], [0.5], [[0]]])
def test_arcs_that_are_none_can_neither_be_closed_nor_opened(arcs: list[int]) -> None:
    prepared = Prepared(Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1], [1], [9]]), 2)
    for change in (prepared.close, prepared.open):
        with pytest.raises(GraphError, match="indices"):
            change(arcs)
    with pytest.raises(QueryError, match="source"):
        prepared.paths(3)
