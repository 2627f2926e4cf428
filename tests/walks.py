"""Claims that all searches make about the paths that they return."""

from __future__ import annotations

from collections.abc import Set
from typing import Protocol

import numpy as np

from hpop.base.arrays import IntArray
from hpop.search import Graph


class Walks(Protocol):
    """Costs (n, k), and the nodes and arcs of each path."""

    @property
    def costs(self) -> IntArray: ...
    def nodes(self, i: int) -> IntArray: ...
    def arcs(self, i: int) -> IntArray: ...


def check_walks(graph: Graph, walks: Walks, source: int, targets: Set[int]) -> None:
    """Each runs along arcs of the graph, from source to a target, and costs what is claimed."""
    tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
    place = np.argsort(graph.arc)
    for i, claimed in enumerate(walks.costs.tolist()):
        nodes, at = walks.nodes(i), place[walks.arcs(i)]
        assert nodes[0] == source
        assert nodes[-1] in targets
        assert (tails[at] == nodes[:-1]).all()
        assert (graph.heads[at] == nodes[1:]).all()
        columns = zip(graph.costs[at].T, graph.aggregates, strict=True)
        assert [c.max(initial=0) if how == "max" else c.sum() for c, how in columns] == claimed
