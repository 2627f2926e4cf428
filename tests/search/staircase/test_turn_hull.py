"""Claims: joint bounds by turns bound from below and nearly touch; what they and corners prune was covered."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, ParetoPaths, pareto_paths
from hpop.search.machinery import Precision, slices, thin_front
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from hpop.search.staircase import search as staircase
from hpop.search.staircase.labels import UncoveredCorners, may_improve
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import H_FIRST, H_REST
from hpop.search.staircase.turn_hull import LANES, STEP_BITS, TurnHull, directions, turn_hull


def rich(lattice, seed: int, width: int, uneven: bool = False) -> Graph:
    """Return a lattice whose moves cost up to a thousand, so that the front has many trade-offs."""
    graph = lattice(seed, width)
    rng = np.random.default_rng(seed)
    costs = graph.costs.copy()
    turn = costs[:, 1] > 0
    costs[~turn, 0] = rng.integers(1, 1000, (~turn).sum())
    costs[~turn, 2] = rng.integers(100, 300, (~turn).sum())
    costs[turn, 0] = rng.integers(40, 70, turn.sum()) if uneven else 50  # none dearer than two
    return Graph.from_csr(graph.indptr, graph.heads, costs)


def hull_of(graph: Graph) -> tuple[Staircase, TurnHull]:
    clock, target = Clock(Budget(), None), np.array([graph.nodes - 1])
    groups = Groups.of_turns(graph, 1, clock)
    assert groups is not None
    h, _, _ = lower_bounds(graph, 0, target, clock, groups)
    search = Staircase(graph, 0, target, h, (2, 1, 0), groups, clock, Precision(0.01))
    weights = directions((int(search.nodes[:, H_FIRST].max()), int(search.nodes[:, H_REST].max())))
    tables = (search.nodes, search.start, search.arcs, search.is_target)
    hull = turn_hull(groups, (2, 0), weights, *tables, lambda _: False, 2**30, clock)
    assert hull is not None
    return search, hull


def least_rest(graph: Graph, weights: np.ndarray, most: int) -> np.ndarray:
    """Least weighted rest (n, most + 1) with at most m turns: relax all arcs of all layers to the end."""
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    cost = graph.costs[:, 2] * weights[0] + graph.costs[:, 0] * weights[1]
    rest = np.full((graph.nodes, most + 1), np.inf)
    rest[-1] = 0.0
    changed = True
    while changed:
        before = rest.copy()
        for m in range(most + 1):
            for turn in range(min(m, 1) + 1):
                use = graph.costs[:, 1] == turn
                np.minimum.at(rest[:, m], tails[use], cost[use] + rest[graph.heads[use], m - turn])
        rest = np.minimum.accumulate(rest, axis=1)
        changed = not np.array_equal(before, rest)
    return rest


@pytest.mark.cases("3-True", "4-False")
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("seed", [3, 4, 7])  # the source reaches the target
def test_joint_bounds_are_below_the_truth_by_rounding_only(lattice, seed, uneven):
    graph = rich(lattice, seed, 6, uneven)
    search, hull = hull_of(graph)
    least = search.nodes[:, [H_FIRST, H_REST]].astype(float)
    nodes = search.groups.nodes
    last = len(hull.layers) - 1
    far = 2**16 - 1
    for k in range(LANES):
        truth = least_rest(graph, hull.weights[k], 80)[nodes]
        reached = np.isfinite(truth[:, 80])
        for m in range(last + 1):
            steps = hull.layers[m, :, k].astype(float)
            told = least @ hull.weights[k] + steps * 2**STEP_BITS
            true = truth[:, m if m < last else 80]
            assert (told <= true * (1 + 1e-12))[reached].all()  # floats are added here
            rounding = 2**STEP_BITS + graph.nodes + 2
            assert (true - told <= rounding)[reached & (steps < far) & np.isfinite(true)].all()
            assert (steps == far)[reached & ~np.isfinite(true)].all()


Vectors = st.lists(st.tuples(st.integers(1, 60), st.integers(0, 3), st.integers(1, 60)), max_size=8)


@given(Vectors, st.integers(0, 2))
def test_a_label_is_followed_exactly_where_no_solution_covers_it(solutions, fewest):
    """Nothing but turns is left to come, more of them than there are layers; small costs are weighed to the unit."""
    weights = directions((100, 100))
    table = np.array(solutions, np.int64).reshape(-1, 3)
    corners = UncoveredCorners.of(table, weights, Clock(Budget(), None))
    layers, scratch = np.zeros((1, 1, LANES), np.uint16), np.zeros((2, LANES), np.int32)
    for label in [(0, 0, 0), *solutions, *[(a - 1, n, b) for a, n, _ in solutions for _, _, b in solutions]]:
        label = (max(label[0], 0), *label[1:])
        first, n, rest = label
        covered = any(all(a <= b for a, b in zip(s, (first, n + fewest, rest), strict=True)) for s in solutions)
        followed = may_improve(0, n, first, rest, fewest, layers, weights, corners.values, corners.last, scratch)
        assert followed == (not covered)


@given(Vectors, Vectors, st.sampled_from([0.0, 0.1, 0.5]), st.integers(0, 3))
def test_a_thinned_set_covers_all_with_what_is_kept(vectors, kept, eps, slack):
    costs = np.array(sorted(vectors), np.int64).reshape(-1, 3)
    have = np.array(kept, np.int64).reshape(-1, 3)
    tolerance = np.full(3, slack)
    rows = thin_front(costs, have, eps, tolerance)
    chosen = np.concatenate([costs[rows], have])
    assert all((chosen <= np.floor(row * (1 + eps) + 1e-9) + tolerance).all(axis=1).any() for row in costs)
    assert len(set(rows.tolist())) == len(rows)


def covered(exact: np.ndarray, found: np.ndarray, eps: float, tolerance: np.ndarray) -> bool:
    most = exact + np.floor(eps * exact + 1e-9) + tolerance
    return all((found <= row).all(axis=1).any() for row in most)


def told_by_their_arcs(graph: Graph, paths: ParetoPaths, target: int) -> bool:
    original = np.empty_like(graph.costs)
    original[graph.arc] = graph.costs
    sums = [original[paths.arcs(i)].sum(axis=0).tolist() == paths.costs[i].tolist() for i in range(len(paths))]
    ends = [(paths.nodes(i)[0], paths.nodes(i)[-1]) == (0, target) for i in range(len(paths))]
    return all(sums) and all(ends)


@pytest.fixture
def soon(monkeypatch):
    """Joint bounds at once, and a return to Python often; how many searches took them, and solutions with them."""
    monkeypatch.setattr(staircase, "SOON", 0)
    monkeypatch.setattr(slices, "WORK", 30)
    taken: list[int] = []
    look = Staircase._compute_joint_bounds

    def watched(self, clock):
        done = look(self, clock)
        if done:
            taken.append(len(self.hull_paths))
            assert self.hull.last.size  # corners, be there a solution or not: the kernel reads the last of them
        return done

    monkeypatch.setattr(Staircase, "_compute_joint_bounds", watched)
    return taken


CASES = [(0.02, 0), (0.1, 0), (0.5, 0), (0.0, 40), (0.03, 15)]


@pytest.mark.cases("0.02-0-True-few", "0.1-0-False-few", "0.5-0-True-few", "0.0-40-False-few", "0.03-15-True-few")
@pytest.mark.parametrize("seeds", [range(3), range(3, 8)], ids=["few", "more"])
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize(("eps", "slack"), CASES)
def test_every_exact_vector_is_covered(lattice, soon, eps, slack, uneven, seeds):
    tolerance = np.array([2 * slack, slack // 20, slack])
    for seed in seeds:
        graph = rich(lattice, seed, 9, uneven)
        target = graph.nodes - 1
        exact = pareto_paths(graph, 0, target, method="general")
        paths = pareto_paths(graph, 0, target, method="staircase", eps=eps, tolerance=tolerance.tolist())
        assert paths.status is exact.status
        assert covered(exact.costs, paths.costs, eps, tolerance)
        assert told_by_their_arcs(graph, paths, target)
        assert len(np.unique(paths.costs, axis=0)) == len(paths)
    assert any(soon)


@pytest.mark.parametrize("column", [0, 1, 2])
def test_every_exact_vector_within_bounds_is_covered(lattice, soon, column):
    for seed in range(6):
        graph = rich(lattice, seed, 9)
        exact = pareto_paths(graph, 0, graph.nodes - 1, method="general")
        if not len(exact):
            continue
        most: list[int | None] = [None, None, None]
        most[column] = int(np.median(exact.costs[:, column]))
        inside = exact.costs[exact.costs[:, column] <= most[column]]
        paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase", eps=0.05, at_most=most)
        assert (paths.costs[:, column] <= most[column]).all()
        assert covered(inside, paths.costs, 0.05, np.zeros(3))
    assert any(soon)


def test_bounds_that_no_path_keeps_together_leave_nothing(lattice, soon):
    for seed in range(8):
        graph = rich(lattice, seed, 9)
        exact = pareto_paths(graph, 0, graph.nodes - 1, method="general").costs  # cost 0 rises
        best = [row for i, row in enumerate(exact) if (row[2] < exact[:i, 2]).all()]
        for one, other in pairwise(best):
            most = [int(other[0]) - 1, None, int(one[2]) - 1]
            paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase", eps=0.05, at_most=most)
            assert (len(paths), paths.status) == (0, Status.NO_PATH)
    assert 0 in soon


@pytest.mark.parametrize("seed", [2, 3])
def test_a_larger_lattice_takes_far_fewer_labels(lattice, seed):
    graph = rich(lattice, seed, 28)
    target = graph.nodes - 1
    exact = pareto_paths(graph, 0, target)
    paths = pareto_paths(graph, 0, target, eps=0.02)
    assert covered(exact.costs, paths.costs, 0.02, np.zeros(3))
    assert told_by_their_arcs(graph, paths, target)
    assert 0 < len(paths) < len(exact) / 2
    assert paths.stats.labels_expanded < exact.stats.labels_expanded / 2


def test_the_front_to_begin_with_takes_labels_of_the_same_limit(lattice, soon, monkeypatch):
    monkeypatch.setattr(staircase, "SOON", 0.1)  # a good part of the limit is gone by then
    graph = rich(lattice, 2, 28)
    paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase", eps=0.002, budget=Budget(max_labels=2000))
    assert soon
    assert paths.status is Status.LABEL_LIMIT
    assert 2000 <= paths.stats.labels_generated < 2064


def test_without_room_for_them_the_search_does_without(lattice, soon):
    graph = rich(lattice, 2, 9)
    exact = pareto_paths(graph, 0, graph.nodes - 1, method="general")
    enough = pareto_paths(graph, 0, graph.nodes - 1, method="staircase").stats.peak_memory + 2**14
    paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase", eps=0.05, budget=Budget(max_memory=enough))
    assert paths.status is Status.COMPLETE
    assert not soon
    assert covered(exact.costs, paths.costs, 0.05, np.zeros(3))


def test_with_a_checkpoint_the_search_does_without(lattice, soon, tmp_path):
    graph = rich(lattice, 2, 9)
    paths = pareto_paths(graph, 0, graph.nodes - 1, method="staircase", eps=0.05, checkpoint=tmp_path / "kept")
    assert paths.status is Status.COMPLETE
    assert not soon
