"""Multi-objective A* as published, in plain Python: to read with the literature, and to test against.

Accepts: every :class:`~hpop.search.graph.Graph`; sums and maxima; several targets.

Guarantees: every non-dominated cost vector once, each with one path of this cost.

Sources: Stewart and White, "Multiobjective A*", JACM 38 (1991), MOA*; Mandow and Perez de la Cruz, "A new
approach to multiobjective A* search", IJCAI 2005, and JACM 57 (2010), NAMOA*. Names below are NAMOA*'s: OPEN
holds the partial paths not yet extended; G_op(n), G_cl(n) are the cost vectors of those that reach n and are
open or closed; COSTS are the vectors found at targets. In each round the lexicographically least f in OPEN
is chosen, which is non-dominated, and its path is extended.

Deviations: of several paths with equal vectors at a node, only the first is kept. For a cost that is a maximum, g
becomes max(g, c, h): it already includes the lower bound of the remaining cost, so f = g.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple, cast

from hpop.base.text import is_whole
from hpop.search.graph import Graph

Vector = tuple[int, ...]


class Partial(NamedTuple):
    """Partial path: its cost vector g, its last node, and the partial path that it extends by one arc."""

    g: Vector
    node: int
    parent: Partial | None


def namoa_star(graph: Graph, source: int, targets: int | Iterable[int]) -> list[tuple[Vector, list[int]]]:
    """Return the non-dominated cost vectors from source to targets, in lexicographic order, with one path each.

    A path is a list of nodes.

    >>> graph = Graph.from_arcs(3, [0, 1, 0], [1, 2, 2], [[1, 5], [1, 5], [9, 1]])
    >>> namoa_star(graph, 0, 2)
    [((2, 10), [0, 1, 2]), ((9, 1), [0, 2])]
    """
    target_nodes = cast(Iterable[int], [targets] if is_whole(targets) else targets)
    source, goals = int(source), {int(target) for target in target_nodes}
    h = [ideal_cost_to_go(graph, goals, j) for j in range(graph.criteria)]
    successors = _successors(graph)
    is_max = [aggregate == "max" for aggregate in graph.aggregates]

    def bound(node: int) -> Vector | None:
        """Return the least remaining value of each cost from a node, or None if it reaches no target."""
        return tuple(h_j[node] for h_j in h) if node in h[0] else None

    def estimate(g: Vector, node: int) -> Vector:
        return tuple(a if worst else a + h_j[node] for a, h_j, worst in zip(g, h, is_max, strict=True))

    start = bound(source)
    if start is None:
        return []
    g_start = tuple(b if worst else 0 for b, worst in zip(start, is_max, strict=True))
    open_paths = [(estimate(g_start, source), 0, Partial(g_start, source, None))]
    g_op: dict[int, set[Vector]] = {source: {g_start}}
    g_cl: dict[int, set[Vector]] = {}
    costs: dict[Vector, Partial] = {}
    count = 1
    while open_paths:
        f, _, path = heapq.heappop(open_paths)
        if path.g not in g_op[path.node]:  # pruned after it entered OPEN
            continue
        g_op[path.node].remove(path.g)
        if any(covers(c, f) for c in costs):  # filtered by a solution
            continue
        g_cl.setdefault(path.node, set()).add(path.g)
        if path.node in goals:
            costs[path.g] = path
            continue
        for node, arc in successors[path.node]:
            ahead = bound(node)
            if ahead is None:
                continue
            g = tuple(
                max(a, c, b) if worst else a + c for a, c, b, worst in zip(path.g, arc, ahead, is_max, strict=True)
            )
            waiting, closed = g_op.setdefault(node, set()), g_cl.get(node, set())
            if any(covers(vector, g) for vector in waiting | closed):
                continue
            f = estimate(g, node)
            if any(covers(c, f) for c in costs):
                continue
            waiting -= {vector for vector in waiting if covers(g, vector)}
            waiting.add(g)
            heapq.heappush(open_paths, (f, count, Partial(g, node, path)))
            count += 1
    return [(g, _trace(path)) for g, path in sorted(costs.items())]


def covers(a: Vector, b: Vector) -> bool:
    """Return whether a is nowhere larger than b (weak dominance).

    >>> covers((1, 2), (1, 2)), covers((1, 2), (2, 1))
    (True, False)
    """
    return all(x <= y for x, y in zip(a, b, strict=True))


def ideal_cost_to_go(graph: Graph, targets: set[int], j: int) -> dict[int, int]:
    """Return the least remaining cost j for every node that can reach a target, by backward Dijkstra."""
    predecessors: dict[int, list[tuple[int, int]]] = {}
    for tail, successors in enumerate(_successors(graph)):
        for head, arc in successors:
            predecessors.setdefault(head, []).append((tail, arc[j]))
    done: dict[int, int] = {}
    queue = [(0, t) for t in sorted(targets)]
    while queue:
        cost, node = heapq.heappop(queue)
        if node in done:
            continue
        done[node] = cost
        for tail, c in predecessors.get(node, []):
            heapq.heappush(queue, (max(cost, c) if graph.aggregates[j] == "max" else cost + c, tail))
    return done


def _successors(graph: Graph) -> list[list[tuple[int, Vector]]]:
    heads, costs = graph.heads.tolist(), [tuple(row) for row in graph.costs.tolist()]
    ends = graph.indptr.tolist()
    return [list(zip(heads[a:b], costs[a:b], strict=True)) for a, b in pairwise(ends)]


def _trace(path: Partial) -> list[int]:
    nodes = []
    step: Partial | None = path
    while step is not None:
        nodes.append(step.node)
        step = step.parent
    return nodes[::-1]
