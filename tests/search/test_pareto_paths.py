"""Claims: every method returns the exact front, with paths that cost that; limits leave a subset of it."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import OptionError, QueryError
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, ParetoPaths, pareto_paths
from hpop.search.staircase import search as staircase
from tests.search.namoa_star import namoa_star
from tests.walks import check_walks


@st.composite
def graphs(draw, criteria=(1, 6), most=3):
    """Small graphs, costs 0 .. most, so that ties, zero-cost cycles, self-loops and parallel arcs abound."""
    n = draw(st.integers(1, 6))
    k = draw(st.integers(*criteria))
    node = st.integers(0, n - 1)
    arcs = draw(st.lists(st.tuples(node, node, *[st.integers(0, most)] * k), max_size=18))
    table = np.array(arcs, np.int64).reshape(len(arcs), 2 + k)
    how = draw(st.lists(st.sampled_from(["sum", "sum", "max"]), min_size=k, max_size=k))
    return Graph.from_arcs(n, table[:, 0], table[:, 1], table[:, 2:], aggregates=how)


@st.composite
def queries(draw, **options):
    graph = draw(graphs(**options))
    node = st.integers(0, graph.nodes - 1)
    return graph, draw(node), draw(st.sets(node, min_size=1, max_size=2))


def front(paths: ParetoPaths) -> list[tuple[int, ...]]:
    return [tuple(row) for row in paths.costs.tolist()]


@given(queries())
def test_general_finds_the_front_of_the_closure(closure, query):
    graph, source, targets = query
    paths = pareto_paths(graph, source, sorted(targets), method="general")
    expected = closure(graph, source, targets)
    assert front(paths) == expected
    assert paths.status is (Status.COMPLETE if expected else Status.NO_PATH)
    check_walks(graph, paths, source, targets)


@given(queries())
def test_namoa_star_finds_the_front_of_the_closure(closure, query):
    graph, source, targets = query
    assert [g for g, _ in namoa_star(graph, source, targets)] == closure(graph, source, targets)


@given(queries(criteria=(2, 3)))
def test_staircase_finds_the_front_of_the_closure(closure, query):
    graph, source, targets = query
    if "sum" not in graph.aggregates:
        with pytest.raises(OptionError, match="small integer"):
            pareto_paths(graph, source, sorted(targets), method="staircase")
        return
    paths = pareto_paths(graph, source, sorted(targets), method="staircase")
    assert front(paths) == closure(graph, source, targets)
    check_walks(graph, paths, source, targets)


@pytest.mark.parametrize("turn_rest", [0, 1, 3])
@pytest.mark.parametrize("seed", range(6))
def test_methods_agree_on_lattices_with_turns(closure, lattice, seed, turn_rest):
    graph = lattice(seed, 4, turn_rest)
    source, targets = 1, {graph.nodes - 1, graph.nodes - 6}
    expected = closure(graph, source, targets)
    for method in ("staircase", "general"):
        paths = pareto_paths(graph, source, sorted(targets), method=method)
        assert front(paths) == expected
        check_walks(graph, paths, source, targets)


TURNS = ("uniform", "free", "dear", "uneven", "broken")


@pytest.mark.cases(*(f"{seed}-{TURNS[(seed + 1) % 5]}" for seed in range(20)))
@pytest.mark.parametrize("turns", TURNS)
@pytest.mark.parametrize("seed", range(20))
def test_staircase_and_general_agree_whatever_turns_cost(lattice, seed, turns):
    rng = np.random.default_rng(seed)
    full = lattice(seed, int(rng.integers(2, 8)), int(rng.integers(0, 3)))
    costs = full.costs.copy()
    turn = costs[:, 1] > 0
    if turns == "free":
        costs[turn, 0] = 0
    elif turns == "dear":
        costs[:, 1] *= 3
        costs[turn, 2] = 2
    elif turns == "uneven":
        costs[turn, 1] += rng.integers(0, 2, turn.sum())
    elif turns == "broken":
        costs[turn, 0] += rng.integers(0, 3, turn.sum())
    how = [("sum", "max")[rng.integers(0, 2)], "sum", ("sum", "max")[rng.integers(0, 2)]]
    graph = Graph.from_csr(full.indptr, full.heads, costs, aggregates=how)
    source, targets = int(rng.integers(graph.nodes)), set(rng.integers(0, graph.nodes, 3).tolist())
    paths = pareto_paths(graph, source, sorted(targets), method="staircase")
    assert front(paths) == front(pareto_paths(graph, source, sorted(targets), method="general"))
    check_walks(graph, paths, source, targets)


@pytest.mark.parametrize("columns", [(0, 1), (1, 2), (2, 1, 0), (1, 0, 2)])
@pytest.mark.parametrize("how", [("sum", "sum", "max"), ("max", "sum", "sum"), ("max", "sum", "max")])
def test_turns_and_maxima_in_any_column(closure, lattice, columns, how):
    full = lattice(7, 4)
    graph = Graph.from_csr(full.indptr, full.heads, full.costs[:, columns], aggregates=[how[j] for j in columns])
    for target in (5, graph.nodes - 2):
        paths = pareto_paths(graph, 0, target, method="staircase")
        assert front(paths) == closure(graph, 0, {target})
        check_walks(graph, paths, 0, {target})


@pytest.mark.parametrize("seed", range(4))
def test_turns_that_break_the_triangle_are_taken_twice(closure, lattice, seed):
    """The staircase must not skip a second turn where one turn may cost more than two."""
    full = lattice(seed, 4)
    costs = full.costs.copy()
    turns = costs[:, 1] > 0
    costs[turns, 0] += np.random.default_rng(seed).integers(0, 6, turns.sum())
    graph = Graph.from_csr(full.indptr, full.heads, costs)
    paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase")
    assert front(paths) == closure(graph, 0, {graph.nodes - 1})
    check_walks(graph, paths, 0, {graph.nodes - 1})


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_source_equal_target_costs_nothing(method):
    graph = Graph.from_arcs(2, [0, 1, 0], [1, 0, 0], [[1, 2, 3]] * 3, aggregates=["sum", "max", "sum"])
    paths = pareto_paths(graph, 0, 0, method=method)
    assert paths.costs.tolist() == [[0, 0, 0]]
    assert paths.nodes(0).tolist() == [0]
    assert paths.arcs(0).tolist() == []
    assert paths.status is Status.COMPLETE


def test_a_graph_without_arcs_has_no_path():
    paths = pareto_paths(Graph.from_arcs(2, [], [], np.zeros((0, 2), np.int64)), 0, 1)
    assert paths.status is Status.NO_PATH
    assert paths.costs.shape == (0, 2)


def test_equal_vectors_have_one_representative():
    graph = Graph.from_arcs(4, [0, 0, 1, 2, 0], [1, 2, 3, 3, 3], [[1, 2], [1, 2], [1, 1], [1, 1], [2, 3]])
    assert pareto_paths(graph, 0, 3).costs.tolist() == [[2, 3]]


def staircase_graph(steps: int, index: int = 1, rest: int = 1) -> Graph:
    """Return a chain of `steps` choices between (0, index, 0) and (1, 0, rest): steps + 1 vectors."""
    tails = np.repeat(np.arange(steps), 2)
    costs = np.tile([[0, index, 0], [1, 0, rest]], (steps, 1))
    return Graph.from_arcs(steps + 1, tails, tails + 1, costs)


@pytest.mark.parametrize("index", [1, 7])
def test_the_staircase_grows_wider_than_it_begins(index):
    paths = pareto_paths(staircase_graph(60, index, 5), 0, 60, method="staircase")
    assert paths.costs.tolist() == [[i, index * (60 - i), 5 * i] for i in range(61)]


@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize("scale", [10**6, 10**9, 10**12, 10**15])
def test_costs_too_large_for_one_key_word(closure, lattice, method, scale):
    full = lattice(3, 4)
    costs = full.costs * np.array([scale, 1, scale]) + np.array([1, 0, 7]) * (full.costs > 0)
    graph = Graph.from_csr(full.indptr, full.heads, costs)
    paths = pareto_paths(graph, 0, graph.nodes - 1, method=method)
    assert front(paths) == closure(graph, 0, {graph.nodes - 1})
    check_walks(graph, paths, 0, {graph.nodes - 1})


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_keys_and_numbers_widen_while_the_search_runs(method):
    """Bounds from the source are small, the paths of the front are not: the first cost avoids a dear way."""
    steps, dear = 40, 2**27
    tails = np.repeat(np.arange(steps), 2)
    costs = np.tile([[1, 1, 0], [0, 0, dear]], (steps, 1))
    graph = Graph.from_arcs(steps + 1, tails, tails + 1, costs)
    paths = pareto_paths(graph, 0, steps, method=method)
    assert paths.costs.tolist() == [[i, i, dear * (steps - i)] for i in range(steps + 1)]


@pytest.mark.parametrize("method", ["staircase", "general"])
@pytest.mark.parametrize("bound", [None, 2**30, 2**31 - 2, 2**31, 3 * 10**9])
def test_a_rest_cost_that_outgrows_32_bits_stays_within_its_bound(method, bound):
    """The search begins in 32 bits, since no arc and no bound from the source is large."""
    steps, dear = 80, 2**26
    tails = np.repeat(np.arange(steps), 2)
    graph = Graph.from_arcs(steps + 1, tails, tails + 1, np.tile([[0, 1, dear], [1, 0, 0]], (steps, 1)))
    paths = pareto_paths(graph, 0, steps, method=method, at_most=(None, None, bound))
    most = steps if bound is None else bound // dear
    assert paths.costs.tolist() == [[steps - i, i, dear * i] for i in range(most, -1, -1)]


def hard(steps: int = 400) -> Graph:
    """Enough work to be stopped: random costs along a chain of choices, three of them."""
    rng = np.random.default_rng(5)
    tails = np.repeat(np.arange(steps), 3)
    return Graph.from_arcs(steps + 1, tails, tails + 1, rng.integers(0, [9, 3, 9], (3 * steps, 3)))


@pytest.fixture(scope="module")
def small_hard() -> tuple[Graph, set[tuple[int, ...]]]:
    graph = hard(40)
    return graph, set(front(pareto_paths(graph, 0, 40, method="general")))


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_a_label_limit_leaves_a_subset_of_the_front(small_hard, method):
    graph, exact = small_hard
    total = pareto_paths(graph, 0, 40, method=method).stats.labels_generated
    found = set()
    for limit in (1, total // 2, total - 1):
        paths = pareto_paths(graph, 0, 40, method=method, budget=Budget(max_labels=limit))
        assert paths.status is Status.LABEL_LIMIT
        assert limit <= paths.stats.labels_generated < limit + 64
        found = set(front(paths))
        assert found < exact
        check_walks(graph, paths, 0, {40})
    assert found


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_a_time_limit_is_kept(method):
    """Counted in work: when time is up, no more than a slice of the search is done."""
    paths = pareto_paths(hard(), 0, 400, method=method, budget=Budget(time_limit=1e-9))
    assert paths.status is Status.TIME_LIMIT
    assert paths.stats.labels_generated < 100_000


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_a_memory_limit_is_kept(method):
    paths = pareto_paths(hard(), 0, 400, method=method, budget=Budget(max_memory=3_000_000))
    assert paths.status is Status.MEMORY_LIMIT


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_ctrl_c_leaves_the_front_so_far(method):
    seen: list[Progress] = []

    def interrupt(progress: Progress) -> None:
        seen.append(progress)
        if progress.stage == "search" and progress.labels > 0:
            raise KeyboardInterrupt

    paths = pareto_paths(hard(), 0, 400, method=method, progress=interrupt)
    assert paths.status is Status.INTERRUPTED
    assert paths.stats.labels_generated > 0
    assert next(p.stage for p in seen if p.stage != "compiling") == "bounds"


@pytest.mark.parametrize("method", ["staircase", "general"])
def test_ctrl_c_while_the_gap_is_proven_keeps_what_was_found(method, monkeypatch):
    """With millions of open labels that takes seconds, in which a user who waits asks again."""
    graph = hard(60)
    asked = {"method": method, "budget": Budget(max_labels=50_000)}
    whole = pareto_paths(graph, 0, 60, **asked)
    assert whole.status is Status.LABEL_LIMIT

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules[pareto_paths.__module__], "proven_gap", interrupted)
    kept = pareto_paths(graph, 0, 60, **asked)
    assert len(kept) > 0
    assert kept.costs.tolist() == whole.costs.tolist()
    assert (kept.status, kept.gap) == (Status.INTERRUPTED, np.inf)
    check_walks(graph, kept, 0, {60})


def test_after_ctrl_c_nobody_waits_for_the_gap_of_very_many_open_labels(monkeypatch):
    module, proven = sys.modules[pareto_paths.__module__], []
    gap = module.proven_gap
    monkeypatch.setattr(module, "proven_gap", lambda *arrays: proven.append(len(arrays[1])) or gap(*arrays))

    def interrupt(progress: Progress) -> None:
        if progress.labels > 50_000:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "MOST_COMPARED", 1000)
    many = pareto_paths(hard(60), 0, 60, progress=interrupt)
    assert (many.status, many.gap, proven) == (Status.INTERRUPTED, np.inf, [])
    assert many.stats.labels_open * many.costs.shape[1] > 1000
    limited = pareto_paths(hard(60), 0, 60, budget=Budget(max_labels=50_000))
    assert limited.stats.labels_open == proven.pop()  # a limit that was set is no one who waits
    monkeypatch.setattr(module, "MOST_COMPARED", 10**9)
    pareto_paths(hard(60), 0, 60, progress=interrupt)
    assert len(proven) == 1


def test_progress_tells_open_labels_and_memory():
    seen: list[Progress] = []
    graph = hard()
    pareto_paths(graph, 0, 400, progress=seen.append, budget=Budget(max_labels=300_000))
    last = seen[-1]
    assert last.stage == "search"
    assert last.labels >= last.open > 0
    assert last.memory > 0
    assert last.seconds > 0


def test_a_name_that_is_no_method_is_refused():
    with pytest.raises(OptionError, match="auto, staircase, general"):
        pareto_paths(hard(2), 0, 1, method="fast")


def test_staircase_refuses_costs_that_are_not_small():
    graph = Graph.from_arcs(2, [0], [1], [[5000, 70000]])
    with pytest.raises(OptionError, match="use method 'general'"):
        pareto_paths(graph, 0, 1, method="staircase")
    with pytest.raises(OptionError, match="2 or 3 costs"):
        pareto_paths(Graph.from_arcs(2, [0], [1], [[1]]), 0, 1, method="staircase")


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        (-1, 0, "source must be a node from 0 to 2, got -1"),
        (3, 0, "source must be a node"),
        (0, 3, "target must be a node from 0 to 2, got 3"),
        (0, [1, 7], "target must be a node"),
        (0, [], "at least one node"),
        ("hall", 0, "source must be a node from 0 to 2, got 'hall'; only a graph from networkx has names"),
        (0, "hall", "target must be a node"),
        (0, 1.5, "target must be a node or several"),
        (True, 0, "source must be a node"),
    ],
)
def test_bad_queries_say_what_was_expected(source, target, message):
    with pytest.raises(QueryError, match=message):
        pareto_paths(hard(2), source, target)


def test_the_method_follows_groups_of_turns_and_the_size_of_staircases(lattice):
    """Turns that form groups: staircase. Else staircase if nodes times values of the index are few, or general."""
    grouped = lattice(3, 6)
    assert pareto_paths(grouped, 0, grouped.nodes - 1).stats.method == "staircase"
    chain = np.arange(99)
    costs = np.c_[np.full(99, 5000), 100 + chain % 3 * 2000, np.full(99, 10)]
    for nodes, method in ((100, "staircase"), (6_000, "staircase"), (6_100, "general")):  # 991 values
        paths = pareto_paths(Graph.from_arcs(nodes, chain, chain + 1, costs), 0, 99)
        assert (paths.stats.method, len(paths)) == (method, 1)


def test_a_way_that_dawdles_through_free_turns_does_not_keep_the_staircase_away():
    """The best way in a cost may take any number of turns that cost nothing in it (found on a lattice of 300 x 300)."""
    n = 1200  # cells with two headings; each move leaves in the heading in which the move before did not arrive
    cell = np.arange(n)
    leave, arrive = 2 * cell[:-1] + cell[:-1] % 2, 2 * cell[1:] + cell[:-1] % 2
    tails = np.concatenate([leave, 2 * cell, 2 * cell + 1, [0]])
    heads = np.concatenate([arrive, 2 * cell + 1, 2 * cell, [2 * n - 2]])
    costs = np.vstack([np.tile([0, 0, 1], (n - 1, 1)), np.tile([0, 1, 1], (2 * n, 1)), [[7, 0, 5]]])
    paths = pareto_paths(Graph.from_arcs(2 * n, tails, heads, costs), 0, 2 * n - 2)
    assert paths.stats.method == "staircase"
    assert front(paths) == [(0, n - 2, 2 * n - 3), (7, 0, 5)]


def test_staircases_larger_than_kernels_can_index_are_left_for_the_general_search(lattice, monkeypatch):
    monkeypatch.setattr(staircase, "BELOW", 63)
    graph = lattice(3, 24)
    paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase")
    assert paths.stats.method == "general"
    assert paths.costs.tolist() == pareto_paths(graph, 0, graph.nodes - 1, method="general").costs.tolist()
