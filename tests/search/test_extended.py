"""Graphs with a few nodes and arcs beside a base: against graphs of all arcs, and without a copy of the base."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.search import Graph, pareto_paths

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
