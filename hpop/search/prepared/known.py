"""Paths that are known beforehand: the rest of those found from an earlier node, and the least in each cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.errors import QueryError
from hpop.runtime.compiled import lean
from hpop.search.graph import Graph


class KnownPaths(NamedTuple):
    """Costs (n, k) of paths, and the places of their arcs in the graph."""

    costs: IntArray
    paths: tuple[IntArray, ...]


def known_paths(
    graph: Graph, source: int, is_target: BoolArray, paths: Sequence[IntArray], closed: BoolArray
) -> KnownPaths:
    """Paths of which no arc is closed, and what they cost; QueryError for what leads from the source to no target."""
    several = [np.asarray(path) for path in paths]
    listed = [arcs.ndim == 1 and (arcs.dtype.kind in "iu" or not arcs.size) for arcs in several]
    if not all(listed):
        raise QueryError(f"known path {listed.index(False)} must list places of arcs, whole numbers; see suffixes")
    sizes = np.array([path.size for path in several], np.int64)
    ends = np.cumsum(sizes)
    arcs = np.concatenate([np.zeros(0, np.int64), *several]).astype(np.int64)
    row = np.repeat(np.arange(len(several)), sizes)
    strange = row[(arcs < 0) | (arcs >= graph.arcs)]
    if strange.size:
        raise QueryError(f"known path {strange[0]} must list places of arcs, from 0 to {graph.arcs - 1}")
    heads = graph.heads[arcs].astype(np.int64)
    tails = np.append(source, heads)[:-1] if arcs.size else arcs
    tails[(ends - sizes)[sizes > 0]] = source
    leads = (graph.indptr[tails] <= arcs) & (arcs < graph.indptr[tails + 1])
    last = np.full(len(several), source)
    last[sizes > 0] = heads[ends[sizes > 0] - 1]
    wrong = np.concatenate([row[~leads], np.flatnonzero(~is_target[last])])
    if wrong.size:
        raise QueryError(f"known path {wrong.min()} does not lead from node {source} to a target, arc by arc")
    costs = np.zeros((len(several), graph.criteria), np.int64)
    for j, aggregate in enumerate(graph.aggregates):
        if arcs.size:
            add = np.maximum if aggregate == "max" else np.add
            costs[sizes > 0, j] = add.reduceat(graph.costs[arcs, j], (ends - sizes)[sizes > 0])
    free = np.ones(len(several), np.bool_)
    free[row[closed[arcs]]] = False
    parts = np.split(arcs, ends[:-1]) if several else []
    return KnownPaths(costs[free], tuple(part for part, kept in zip(parts, free, strict=True) if kept))


@lean
def least_way(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    column: int,
    closed: BoolArray,
    onward: NDArray[np.int32],
    source: int,
    arcs: IntArray,
) -> int:
    """Follow nodes onward (n,) from the source by the open arcs (n,) that cost least; returns how many these are."""
    size = 0
    u = np.int64(source)
    while onward[u] >= 0:
        best = np.int64(-1)
        for a in range(indptr[u], indptr[u + 1]):
            if heads[a] == onward[u] and not closed[a] and (best < 0 or costs[a, column] < costs[best, column]):
                best = np.int64(a)
        arcs[size] = best
        size += 1
        u = np.int64(onward[u])
    return size
