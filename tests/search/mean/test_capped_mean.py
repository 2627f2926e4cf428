"""Claims: the front of a mean under a cap equals brute force over all walks; limits leave walks that are attainable."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import GraphError, OptionError
from hpop.runtime.limits import Budget, Progress, Status
from hpop.search import Graph, MeanPaths, capped_mean_paths, pareto_paths
from tests.walks import check_walks

S, T = 0, 1  # columns of the integral and the duration in all graphs here
Vector = tuple[Fraction | int, ...]


def means(walks_within, graph: Graph, source: int, targets: set[int], cap: int) -> set[Vector]:
    """(S/T, other costs) of every walk with T <= cap, by brute force; loops take time here, so it ends."""
    seen = walks_within(graph, source, [cap if j == T else None for j in range(graph.criteria)])
    return {(Fraction(g[S], max(1, g[T])), *g[2:]) for node, g in seen if node in targets}


def nondominated(vectors: set[Vector]) -> set[Vector]:
    kept: list[Vector] = []
    for v in sorted(vectors):  # what dominates comes first
        if not any(all(a <= b for a, b in zip(w, v, strict=True)) for w in kept):
            kept.append(v)
    return set(kept)


def vectors(paths: MeanPaths) -> list[Vector]:
    return [(paths.mean(i), *map(int, paths.costs[i, 2:])) for i in range(len(paths))]


def check(graph: Graph, paths: MeanPaths, source: int, targets: set[int], cap: int) -> None:
    """Each walk is one, costs what is claimed and keeps the cap."""
    check_walks(graph, paths, source, targets)
    assert paths.costs[:, T].max(initial=0) <= cap
    assert list(paths.means) == pytest.approx([float(v[0]) for v in vectors(paths)])


def search(graph: Graph, source: int, targets: set[int], cap: int, **options: object) -> MeanPaths:
    return capped_mean_paths(graph, source, sorted(targets), integral=S, duration=T, cap=cap, **options)


@st.composite
def queries(draw, instant=False):
    """Small graphs with small costs, so that ties, self-loops and parallel arcs abound; loops take time."""
    n, k = draw(st.integers(1, 4)), draw(st.integers(2, 5))
    node = st.integers(0, n - 1)
    rows = draw(st.lists(st.tuples(node, node, *[st.integers(0, 3)] * k), max_size=8))
    table = np.array(rows, np.int64).reshape(len(rows), 2 + k)
    slow = table[:, 1] <= table[:, 0] if instant else np.ones(len(rows), bool)
    table[slow, 2 + T] = np.maximum(1, table[slow, 2 + T])
    table[table[:, 2 + T] == 0, 2 + S] = 0
    how = ["sum", "sum", *draw(st.lists(st.sampled_from(["sum", "max"]), min_size=k - 2, max_size=k - 2))]
    graph = Graph.from_arcs(n, table[:, 0], table[:, 1], table[:, 2:], aggregates=how)
    return graph, draw(node), draw(st.sets(node, min_size=1, max_size=2)), draw(st.integers(0, 9))


@given(queries())
def test_the_front_equals_brute_force_over_all_walks_under_the_cap(walks_within, query):
    graph, source, targets, cap = query
    paths = search(graph, source, targets, cap)
    expected = nondominated(means(walks_within, graph, source, targets, cap))
    assert sorted(vectors(paths)) == sorted(expected)
    assert paths.status is (Status.COMPLETE if expected else Status.NO_PATH)
    check(graph, paths, source, targets, cap)


@given(queries(instant=True))
def test_arcs_that_take_no_time_are_taken(walks_within, query):
    graph, source, targets, cap = query
    paths = search(graph, source, targets, cap)
    assert sorted(vectors(paths)) == sorted(nondominated(means(walks_within, graph, source, targets, cap)))
    check(graph, paths, source, targets, cap)


def dense(seed: int, others: int) -> tuple[Graph, int]:
    """Return a graph of five nodes with many walks from 0 to 4, and a cap somewhat above the least duration."""
    rng = np.random.default_rng([seed, others])
    tails, heads = rng.integers(0, 5, (2, 11))
    tails, heads = [0, 1, *tails], [1, 4, *heads]
    costs = rng.integers(0, [5, 4, *[3] * others], (13, 2 + others)) + np.array([0, 1, *[0] * others])
    graph = Graph.from_arcs(5, tails, heads, costs)
    least = pareto_paths(graph, 0, 4).costs[:, T].min()
    return graph, int(least + rng.integers(2, 8))


@pytest.mark.cases(2)
@pytest.mark.parametrize("seeds", [range(20), pytest.param(range(20, 85), marks=pytest.mark.proof)])
@pytest.mark.parametrize("others", [0, 1, 2])
def test_dense_graphs_equal_brute_force(walks_within, others, seeds):
    for seed in seeds:
        graph, cap = dense(seed, others)
        paths = search(graph, 0, {4}, cap)
        assert sorted(vectors(paths)) == sorted(nondominated(means(walks_within, graph, 0, {4}, cap)))
        check(graph, paths, 0, {4}, cap)


def with_times(full: Graph, step: int = 2) -> Graph:
    """Columns S, T, turns, length of a lattice with four headings; S is the rate where an arc ends times T."""
    tails = np.repeat(np.arange(full.nodes), np.diff(full.indptr))
    rate, turns, length = full.costs.T
    angle = np.abs(tails - full.heads) % 4
    time = np.where(turns > 0, np.where(angle == 2, 4, 3), step * length)
    return Graph.from_csr(full.indptr, full.heads, np.stack([rate * time, time, turns, length], axis=1))


@pytest.mark.parametrize("columns", [(0, 1), (0, 1, 2), (0, 1, 3), (0, 1, 2, 3)])
@pytest.mark.seeds(1, of=4)
def test_lattices_equal_brute_force(walks_within, lattice, seed, columns):
    full = with_times(lattice(seed, 3))
    graph = Graph.from_csr(full.indptr, full.heads, full.costs[:, columns])
    source, targets = 0, {graph.nodes - 1, graph.nodes - 4}
    durations = pareto_paths(graph, source, sorted(targets)).costs[:, T]
    assert durations.size
    cap = int(1.4 * durations.min())
    paths = search(graph, source, targets, cap)
    assert sorted(vectors(paths)) == sorted(nondominated(means(walks_within, graph, source, targets, cap)))
    check(graph, paths, source, targets, cap)


def test_the_compared_fronts_are_neither_trivial_nor_those_of_the_integral(lattice):
    sizes, new = [], 0
    for seed in range(4):
        graph = with_times(lattice(seed, 3))
        target = graph.nodes - 1
        additive = pareto_paths(graph, 0, target).costs
        cap = int(1.4 * additive[:, T].min())
        found = vectors(search(graph, 0, {target}, cap))
        sizes.append(len(found))
        walks = {(Fraction(int(c[S]), int(c[T])), int(c[2]), int(c[3])) for c in additive if c[T] <= cap}
        new += len(set(found) - walks)
    assert max(sizes) >= 4
    assert new >= 4


@pytest.mark.parametrize("first", [0, 1])
def test_what_is_better_now_may_be_worse_in_the_end(first):
    """FACTS: prefix a (S 0, T 1), b (1, 10), common suffix (9, 9): pruning by the mean, or by S, would lose b."""
    prefixes = [[0, 1], [1, 10]]
    arcs = [prefixes[first], prefixes[1 - first], [9, 9]]
    graph = Graph.from_arcs(3, [0, 0, 1], [1, 1, 2], arcs)
    paths = search(graph, 0, {2}, 19)
    assert vectors(paths) == [(Fraction(10, 19),)]
    assert paths.nodes(0).tolist() == [0, 1, 2]
    assert vectors(search(graph, 0, {2}, 18)) == [(Fraction(9, 10),)]  # the cap leaves a only


@pytest.mark.parametrize("suffix", [[0, 1], [1, 1], [9, 9], [0, 8]])
def test_both_of_two_prefixes_are_kept_where_the_suffix_decides(suffix):
    """At one node, by one suffix each: which of (2, 4) and (3, 8) is the better depends on what follows."""
    graph = Graph.from_arcs(3, [0, 0, 1], [1, 1, 2], [[2, 4], [3, 8], suffix])
    expected = min(Fraction(2 + suffix[S], 4 + suffix[T]), Fraction(3 + suffix[S], 8 + suffix[T]))
    assert vectors(search(graph, 0, {2}, 17)) == [(expected,)]


def test_a_walk_may_pass_the_target_and_come_back_for_a_smaller_mean():
    graph = Graph.from_arcs(3, [0, 1, 2], [1, 2, 1], [[4, 2], [0, 1], [0, 1]])
    assert [vectors(search(graph, 0, {1}, cap)) for cap in (2, 3, 4, 7)] == [
        [(Fraction(2),)],
        [(Fraction(2),)],
        [(Fraction(1),)],
        [(Fraction(2, 3),)],
    ]


def test_loops_that_take_no_time_end():
    graph = Graph.from_arcs(2, [0, 0, 0], [0, 0, 1], [[0, 0, 0], [0, 0, 1], [3, 2, 1]])
    assert vectors(search(graph, 0, {1}, 10)) == [(Fraction(3, 2), 1)]


def test_the_duration_is_minimised_as_well_where_it_is_given_twice():
    rows = [[4, 4, 4], [1, 2, 2], [0, 2, 2]]
    graph = Graph.from_arcs(2, [0, 0, 0], [1, 1, 0], rows)
    assert vectors(search(graph, 0, {1}, 6)) == [(Fraction(1, 6), 6), (Fraction(1, 4), 4), (Fraction(1, 2), 2)]


@pytest.mark.parametrize(("integral", "duration"), [(0, 1), (1, 0), (2, 0), (1, 3)])
def test_the_mean_may_be_of_any_columns(lattice, integral, duration):
    full = with_times(lattice(1, 3))
    cap = int(1.3 * pareto_paths(full, 0, full.nodes - 1).costs[:, T].min())
    others = [j for j in range(4) if j not in (integral, duration)]
    place = {integral: S, duration: T, others[0]: 2, others[1]: 3}
    graph = Graph.from_csr(full.indptr, full.heads, full.costs[:, [place[j] for j in range(4)]])
    paths = capped_mean_paths(graph, 0, full.nodes - 1, integral=integral, duration=duration, cap=cap)
    expected = search(full, 0, {full.nodes - 1}, cap)
    assert [(paths.mean(i), *map(int, paths.costs[i, others])) for i in range(len(paths))] == vectors(expected)


def test_a_cap_at_the_least_duration_leaves_the_shortest_walks(lattice):
    graph = with_times(lattice(2, 4))
    least = int(pareto_paths(graph, 0, graph.nodes - 1).costs[:, T].min())
    paths = search(graph, 0, {graph.nodes - 1}, least)
    assert paths.status is Status.COMPLETE
    assert set(paths.costs[:, T].tolist()) == {least}
    below = search(graph, 0, {graph.nodes - 1}, least - 1)
    assert below.status is Status.NO_PATH
    assert below.notes == (f"cap must be at least {least}, the shortest duration, got {least - 1}; raise it",)
    assert len(below) == 0


def test_where_no_way_leads_the_cap_is_not_to_blame():
    paths = search(Graph.from_arcs(2, [1], [0], [[1, 1]]), 0, {1}, 5)
    assert paths.status is Status.NO_PATH
    assert paths.notes == ()


def test_start_is_target():
    paths = search(Graph.from_arcs(2, [0, 1], [1, 0], [[1, 2, 3]] * 2), 0, {0}, 9)
    assert vectors(paths) == [(Fraction(0), 0)]
    assert paths.arcs(0).tolist() == []


@pytest.mark.parametrize("scale", [1, 10**6, 10**12])
def test_other_costs_too_large_for_one_key_word(lattice, scale):
    small = with_times(lattice(3, 3))
    graph = Graph.from_csr(small.indptr, small.heads, small.costs * np.array([1, 1, scale, scale]))
    cap = int(1.4 * pareto_paths(graph, 0, graph.nodes - 1).costs[:, T].min())
    found = vectors(search(graph, 0, {graph.nodes - 1}, cap))
    assert found == [(m, n * scale, d * scale) for m, n, d in vectors(search(small, 0, {graph.nodes - 1}, cap))]


# Limits.


@pytest.fixture(scope="module")
def large(lattice) -> tuple[Graph, int, MeanPaths]:
    """Return a lattice with enough work to be stopped in the second search, its cap and its front."""
    graph = with_times(lattice(5, 8))
    cap = int(1.5 * pareto_paths(graph, 0, graph.nodes - 1).costs[:, T].min())
    return graph, cap, search(graph, 0, {graph.nodes - 1}, cap)


def check_partial(graph: Graph, cap: int, paths: MeanPaths, exact: MeanPaths) -> None:
    """Check the result of a stopped search: walks under the cap, non-dominated, none better than the exact front."""
    target = graph.nodes - 1
    check(graph, paths, 0, {target}, cap)
    found = vectors(paths)
    assert set(found) == nondominated(set(found))
    for v in found:
        assert any(all(a <= b for a, b in zip(w, v, strict=True)) for w in vectors(exact))


def test_a_label_limit_leaves_walks_under_the_cap(large):
    graph, cap, exact = large
    total = exact.stats.labels_generated
    for limit in (1, total // 50, total // 2, total - 1):  # the first search, or both, are stopped by the first two
        paths = search(graph, 0, {graph.nodes - 1}, cap, budget=Budget(max_labels=limit))
        assert paths.status is Status.LABEL_LIMIT
        assert limit <= paths.stats.labels_generated < limit + 64
        check_partial(graph, cap, paths, exact)
    assert len(paths)


def test_a_memory_limit_leaves_walks_under_the_cap(large):
    graph, cap, exact = large
    limit = exact.stats.peak_memory - 1
    paths = search(graph, 0, {graph.nodes - 1}, cap, budget=Budget(max_memory=limit))
    assert paths.status is Status.MEMORY_LIMIT
    assert len(paths)
    check_partial(graph, cap, paths, exact)


def test_a_time_limit_and_ctrl_c_leave_walks_under_the_cap(large):
    graph, cap, exact = large

    def stop(progress: Progress) -> None:
        if progress.stage == "search" and progress.labels > exact.stats.labels_generated // 2:
            raise KeyboardInterrupt

    late = search(graph, 0, {graph.nodes - 1}, cap, budget=Budget(time_limit=1e-9))
    assert late.status is Status.TIME_LIMIT
    check_partial(graph, cap, late, exact)
    stopped = search(graph, 0, {graph.nodes - 1}, cap, progress=stop)
    assert stopped.status is Status.INTERRUPTED
    assert len(stopped)
    check_partial(graph, cap, stopped, exact)


# Misuse.


def test_what_could_overflow_is_refused_by_name():
    graph = Graph.from_arcs(2, [0, 0], [1, 1], [[10**9, 10**10, 1], [5, 10**10, 1]])
    with pytest.raises(
        GraphError, match=r"means are compared, must stay below.*coarser quantum of cost 1 or 0, or smaller limits"
    ):
        search(graph, 0, {1}, 10**10)
    with pytest.raises(GraphError, match="means are compared, must stay below"):
        search(graph, 0, {1}, 10**18)
    graph = Graph.from_arcs(2, [0, 0], [1, 0], [[1, 1, 10**15], [1, 1, 10**15]])
    with pytest.raises(GraphError, match=r"cost 2 of a walk must stay below .* could reach 1001"):
        search(graph, 0, {1}, 1000)


def test_the_largest_products_that_are_let_through_are_right():
    """Walks of 2^31 quanta, nearly, that differ in one: single precision would not tell their means apart."""
    n = 2_130_000_000
    graph = Graph.from_arcs(3, [0, 0, 1], [1, 2, 2], [[n // 2, n - 1], [n // 2, n], [0, 1]])
    paths = search(graph, 0, {2}, n)
    assert vectors(paths) == [(Fraction(n // 2, n),)]
    graph = Graph.from_arcs(2, [0, 0], [1, 1], [[n // 3, n], [n // 3, n - 1]])
    assert vectors(search(graph, 0, {1}, n)) == [(Fraction(n // 3, n),)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"integral": 2}, "integral must be a column from 0 to 1, got 2"),
        ({"duration": True}, "duration must be a column from 0 to 1, got True"),
        ({"duration": 0}, "two columns, got 0 for both"),
        ({"cap": -1}, "cap must be a whole number of the duration's quanta, of at least 0, got -1"),
        ({"cap": 1.5}, "cap must be a whole number"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    graph = Graph.from_arcs(2, [0], [1], [[1, 1]])
    with pytest.raises(OptionError, match=message):
        capped_mean_paths(graph, 0, 1, **{"integral": 0, "duration": 1, "cap": 3, **options})


def test_graphs_that_have_no_mean_are_refused():
    with pytest.raises(GraphError, match="arc 1 takes no time but adds 3 to the integral"):
        search(Graph.from_arcs(3, [1, 0], [2, 1], [[1, 1], [3, 0]]), 0, {2}, 5)
    with pytest.raises(GraphError, match="integral must be the column of a cost that is a sum, but cost 0 is a 'max'"):
        search(Graph.from_arcs(2, [0], [1], [[1, 1]], aggregates=["max", "sum"]), 0, {1}, 5)
