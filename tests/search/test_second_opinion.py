"""A second opinion that is not ours: fronts of two costs from the shortest paths of networkx.

Nodes are made anew for each amount of the second cost that a path may have spent; a shortest path by the first cost to
each of them is then all there is to know. Nothing is shared with the searches, nor with the other oracles.
"""

from __future__ import annotations

from collections.abc import Callable

import networkx as nx
import numpy as np
import pytest

from hpop.search import Graph, pareto_paths

BIG = 10**6  # more than any path costs


def arcs_of(graph: Graph) -> list[tuple[int, int, int, int]]:
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    return [(t, h, *c) for t, h, c in zip(tails.tolist(), graph.heads.tolist(), graph.costs.tolist(), strict=True)]


def shortest(arcs: list[tuple[object, object, int]], source: object) -> dict[object, int]:
    """Least cost from a node to each that can be reached; of parallel arcs the cheapest counts."""
    graph = nx.DiGraph()
    graph.add_node(source)
    for tail, head, cost in sorted(arcs, key=lambda arc: -arc[2]):
        graph.add_edge(tail, head, weight=cost)
    return dict(nx.single_source_dijkstra_path_length(graph, source))


def front_of_two(graph: Graph, source: int, target: int) -> list[tuple[int, int]]:
    """All non-dominated pairs of costs of walks between two nodes."""
    arcs = arcs_of(graph)
    first = shortest([(tail, head, a * BIG + b) for tail, head, a, b in arcs], source).get(target)
    if first is None:
        return []
    most = first % BIG  # of the second cost: the least first cost needs no more
    spent = [((t, s), (h, s + b), a) for t, h, a, b in arcs for s in range(most + 1 - b)]
    least = shortest(spent, (source, 0))
    pairs = [(least[target, s], s) for s in range(most + 1) if (target, s) in least]
    return sorted(p for p in pairs if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in pairs))


@pytest.mark.cases(but=("0-any costs",))
@pytest.mark.parametrize("columns", [[0, 1], [2, 1], None], ids=["rest and turns", "length and turns", "any costs"])
@pytest.mark.seeds(2, of=30)
def test_fronts_of_two_costs_are_those_of_networkx(
    lattice: Callable[[int, int, int], Graph], seed: int, columns: list[int] | None
) -> None:
    full = lattice(seed, 7, seed % 3)
    costs = full.costs[:, columns] if columns else np.random.default_rng(seed).integers(0, 9, (full.arcs, 2))
    graph = Graph.from_csr(full.indptr, full.heads, costs)
    source, target = 1, graph.nodes - 3
    expected = front_of_two(graph, source, target)
    for method in ("staircase", "general"):
        assert [tuple(row) for row in pareto_paths(graph, source, target, method=method).costs.tolist()] == expected
