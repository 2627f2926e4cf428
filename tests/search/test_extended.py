"""Graphs without arrays of all arcs and costs: against graphs with these arrays, and without making them."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.search import Graph, pareto_paths
from hpop.search.extended import CompactGraph
from hpop.search.machinery import turn_costs

CELLS, HEADINGS = 40, 4


def turning(rng: np.random.Generator, *, alike: bool) -> Graph:
    """Return a graph with groups of turns: headings of cells that turn into one another, and moves between cells."""
    a, b = (axis.ravel() for axis in np.nonzero(~np.eye(HEADINGS, dtype=bool)))
    first = HEADINGS * np.arange(CELLS)[:, None]
    tails, heads = rng.integers(0, CELLS * HEADINGS, (2, 6 * CELLS))
    price = np.full((CELLS, a.size), 7) if alike else rng.integers(5, 10, (CELLS, a.size))
    turns = np.stack([np.zeros(price.size, int), np.ones(price.size, int), price.ravel()], axis=1)
    moves = rng.integers(1, 30, (tails.size, 3)) * (1, 0, 1)
    ends = np.append((first + a).ravel(), tails), np.append((first + b).ravel(), heads)
    return Graph.from_arcs(CELLS * HEADINGS, *ends, np.concatenate([turns, moves]))


def with_ends(base: Graph, rng: np.random.Generator, *, is_reused: bool) -> Graph:
    """Return the graph with a start and a goal, joined to some states."""
    n = base.nodes
    out, into = (np.unique(rng.integers(0, n, 6)) for _ in range(2))
    tails = np.concatenate([into, np.full(out.size, n)])
    heads = np.concatenate([np.full(into.size, n + 1), out])
    return base.extended(n + 2, tails, heads, rng.integers(0, 9, (tails.size, 3)), is_reused=is_reused)


def both(seed: int) -> tuple[Graph, Graph]:
    """Return one graph with ends as an extension of a base, and as a graph of its own."""
    base = turning(np.random.default_rng(seed), alike=seed % 2 == 0)
    reused, alone = (with_ends(base, np.random.default_rng(seed), is_reused=reused) for reused in (True, False))
    return reused, alone


@pytest.mark.parametrize("seed", range(4))
def test_heads_and_costs_of_arcs_are_those_of_the_whole_arrays(seed):
    reused, alone = both(seed)
    arcs = np.random.default_rng(seed).integers(0, alone.arcs, 500)
    arcs = np.append(arcs, [0, alone.arcs - 1])
    heads, costs = reused.ends_and_costs(arcs)
    assert "costs" not in vars(reused)
    assert (heads == alone.heads[arcs]).all()
    assert (costs == alone.costs[arcs]).all()
    assert (reused.arcs, reused.nodes, reused.criteria) == (alone.arcs, alone.nodes, alone.criteria)
    for name in ("indptr", "heads", "costs", "arc", "largest"):
        assert (getattr(reused, name) == getattr(alone, name)).all(), name
    heads, costs = reused.ends_and_costs(arcs)  # now with arrays of its own
    assert (heads == alone.heads[arcs]).all()
    assert (costs == alone.costs[arcs]).all()


@pytest.mark.parametrize("seed", range(12))
def test_fronts_are_those_of_a_copied_graph_and_nothing_is_copied(seed):
    reused, alone = both(seed)
    source, target = reused.nodes - 2, reused.nodes - 1
    extended, whole = (pareto_paths(graph, source, target) for graph in (reused, alone))
    assert extended.costs.tolist() == whole.costs.tolist()
    assert len(whole) > 1
    assert extended.stats.method == "staircase"
    assert not {"heads", "costs"} & vars(reused).keys()
    for i, path in enumerate(extended.places):
        assert (alone.costs[path].sum(axis=0) == extended.costs[i]).all()
        nodes = extended.nodes(i)
        tails = np.searchsorted(alone.indptr, path, side="right") - 1
        assert (nodes[:-1] == tails).all()
        assert (nodes[1:] == alone.heads[path]).all()
        assert (nodes[0], nodes[-1]) == (source, target)


@pytest.mark.parametrize("method", ["general", "staircase"])
def test_searches_that_read_all_arcs_copy_them(method):
    reused, alone = both(3)
    left_out = np.random.default_rng(3).random(alone.arcs) < 0.1
    fronts = [
        pareto_paths(graph.without(left_out), alone.nodes - 2, alone.nodes - 1, method=method)
        for graph in (reused, alone)
    ]
    assert fronts[0].costs.tolist() == fronts[1].costs.tolist()
    assert len(fronts[1])


def compact(graph: Graph) -> CompactGraph:
    """Return the graph with its costs as columns of 16 bits."""
    return CompactGraph.of(graph.indptr, graph.heads, graph.costs.T.astype(np.uint16).copy(), graph.aggregates)


@pytest.mark.parametrize("seed", range(6))
def test_compact_lattices_have_the_fronts_of_all_walks(lattice, closure, monkeypatch, seed):
    monkeypatch.setattr(turn_costs, "PART", 40)  # the costs of few groups are copied at a time
    whole = lattice(seed, width=4)
    graph, target = compact(whole), whole.nodes - 1
    found = pareto_paths(graph, 0, target, method="staircase")
    assert found.costs.tolist() == [list(vector) for vector in closure(whole, 0, {target})]
    for i, path in enumerate(found.places):
        assert (whole.costs[path].sum(axis=0) == found.costs[i]).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("with_joins", [False, True])
def test_compact_graphs_equal_those_with_arrays_of_all_costs(lattice, monkeypatch, seed, with_joins):
    monkeypatch.setattr(turn_costs, "PART", 100)
    whole = lattice(seed, width=8, turn_rest=seed % 2)
    tails, number = np.repeat(np.arange(whole.nodes), np.diff(whole.indptr)), np.arange(whole.nodes)
    if seed > 1:  # the nodes of a group are not consecutive numbers: anywhere, or among those of a few groups
        block = len(number) if seed < 4 else 11
        for first in range(1, len(number) - 1, block):
            np.random.default_rng(seed).shuffle(number[first : min(first + block, len(number) - 1)])
    costs = whole.costs * (50, 1, 70)  # turns are the smallest cost
    made = Graph.from_arcs(whole.nodes, number[tails], number[whole.heads], costs)
    whole = Graph.from_csr(made.indptr, made.heads, made.costs)
    graphs = [compact(whole), whole]
    if with_joins:
        graphs = [with_ends(graph, np.random.default_rng(seed), is_reused=False) for graph in graphs]
    source, target = graphs[0].nodes - 2 if with_joins else 0, graphs[0].nodes - 1
    for eps in (0.0, 0.1):
        small, large = (pareto_paths(graph, source, target, eps=eps) for graph in graphs)
        assert small.costs.tolist() == large.costs.tolist()
        assert [path.tolist() for path in small.places] == [path.tolist() for path in large.places]
        assert small.stats.labels_generated == large.stats.labels_generated
        assert with_joins or not graphs[0].has_costs
    for name in ("indptr", "heads", "costs", "arc", "largest"):
        assert (getattr(graphs[0], name) == getattr(graphs[1], name)).all(), name
    assert graphs[0].has_costs


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(50))
def test_compact_lattices_of_mid_size_need_as_many_labels_as_with_all_costs(lattice, seed):
    whole = lattice(seed, width=14)
    whole = Graph.from_csr(whole.indptr, whole.heads, whole.costs * (50, 1, 70))
    graph = compact(whole)
    for eps in (0.0, 0.02):
        small, large = (pareto_paths(g, 0, whole.nodes - 1, eps=eps) for g in (graph, whole))
        assert small.costs.tolist() == large.costs.tolist()
        assert (small.stats.labels_generated, small.stats.labels_expanded) == (
            large.stats.labels_generated,
            large.stats.labels_expanded,
        )
    assert not graph.has_costs
