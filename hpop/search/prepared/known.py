"""Paths that are known beforehand: the rest of those found from an earlier node, for one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hpop.arrays import BoolArray, IntArray
from hpop.errors import QueryError
from hpop.search.graph import Graph


class KnownPaths(NamedTuple):
    """Costs (n, k) of paths, and the places of their arcs in the graph."""

    costs: IntArray
    paths: tuple[IntArray, ...]


def known_paths(
    graph: Graph, source: int, is_target: BoolArray, paths: Sequence[IntArray], closed: BoolArray
) -> KnownPaths:
    """Paths of which no arc is closed, and what they cost; QueryError for what leads from the source to no target."""
    costs = np.zeros((len(paths), graph.criteria), np.int64)
    worst = np.array([aggregate == "max" for aggregate in graph.aggregates])
    free = np.ones(len(paths), np.bool_)
    checked = []
    for i, path in enumerate(paths):
        arcs = np.asarray(path)
        whole = arcs.ndim == 1 and (arcs.dtype.kind in "iu" or not arcs.size)
        if not whole or (arcs.size and (arcs.min() < 0 or arcs.max() >= graph.arcs)):
            raise QueryError(f"known path {i} must list places of arcs, from 0 to {graph.arcs - 1}")
        arcs = arcs.astype(np.int64)
        heads = np.append(source, graph.heads[arcs])
        leads = (graph.indptr[heads[:-1]] <= arcs) & (arcs < graph.indptr[heads[:-1] + 1])
        if not leads.all() or not is_target[heads[-1]]:
            raise QueryError(f"known path {i} does not lead from node {source} to a target, arc by arc")
        rows = graph.costs[arcs]
        costs[i] = np.where(worst, rows.max(axis=0, initial=0), rows.sum(axis=0))
        free[i] = not closed[arcs].any()
        checked.append(arcs)
    return KnownPaths(costs[free], tuple(arcs for arcs, kept in zip(checked, free, strict=True) if kept))
