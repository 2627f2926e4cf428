"""Choose, for each stop of a tour, the few states of a graph at which the robot may visit it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.goals.tour import Tour
from hpop.planners.graphs.query import Query

ENDS = -1  # in place of a stop: the start where a part of a tour begins, the goals where it ends
FAR = 10.0  # a bound that does not exist, because no path does, counts as this multiple of the largest one


class Stage(NamedTuple):
    """Part of a tour from one visit to the next; the first begins at the start, and the last ends at a goal.

    layer    layer of the tour in which the robot drives
    origin   index of the stop that it leaves; ENDS for the start
    stop     index of the stop that it visits next; ENDS for a goal
    after    layer after this visit; the same layer where the tour ends
    skipped  indices of the optional stops that are skipped by this visit, or by this end
    """

    layer: int
    origin: int
    stop: int
    after: int
    skipped: tuple[int, ...]


def stages_of(tour: Tour) -> list[Stage]:
    """Return every part that a tour in an allowed order may have, in the order of the parts' layers."""
    origins: list[dict[int, None]] = [{} for _ in tour.layers]
    origins[0][ENDS] = None
    endings, stages = dict(tour.endings), list[Stage]()
    for layer, steps in enumerate(tour.steps):  # a step leads to a larger set of stops, so to a later layer
        for step in steps:
            stages += [Stage(layer, origin, step.stop, step.layer, step.skipped) for origin in origins[layer]]
            if origins[layer]:
                origins[step.layer][step.stop] = None
        if layer in endings:
            stages += [Stage(layer, origin, ENDS, layer, endings[layer]) for origin in origins[layer]]
    return stages


def chosen_states(
    query: Query, members: Sequence[IntArray], dwells: Sequence[IntArray], pairs: set[tuple[int, int]], number: int
) -> list[IntArray]:
    """Return for each stop the indices, in its ``members``, of at most ``number`` states at which tours may visit it.

    The first state of a stop has the least sum of lower bounds: those of the costs of a path from the start, or from
    any state of each stop that may come just before, to this state; those of a path from it to the goals, or to any
    state of each stop that may come next; and the costs of the dwell. Each cost counts in multiples of its least sum
    over the states of the stop. States that cannot be reached, or from which no goal can be reached, are left out if
    the stop has others. Each further state is the one that lowers most the sum of the least bounds over the chosen
    states; there are fewer states than ``number`` where none lowers it.

    query    the graph without stops, with start and goals
    members  for each stop: nodes (c,) at which it can be visited
    dwells   for each stop: costs (c, k), in quanta, of its dwell in each of these
    pairs    all pairs (i, j) of stops where j may be visited just after i, with ENDS for start and goals
    """
    sets = dict(enumerate(members))
    bounds = _Bounds(query)
    columns: list[list[FloatArray]] = [[dwell.astype(float)] for dwell in dwells]  # for each stop: (c, k) each
    usable = [np.ones(nodes.size, np.bool_) for nodes in members]
    # In each direction: the start or the goals first, whose bounds say which states can be used.
    for forward, ends in ((True, np.array([query.start])), (False, np.array(query.goals))):
        for at, nodes in ({ENDS: ends} | sets).items():
            others = {j for i, j in pairs if i == at} if forward else {i for i, j in pairs if j == at}
            if not others - {ENDS} and at != ENDS:
                continue
            query.space.spending.check("the states of stops were chosen")
            table = bounds.of(nodes, forward=forward)
            for stop, own in sets.items():
                usable[stop] &= np.isfinite(table[own]).all(axis=1) if at == ENDS else True
                if stop in others:
                    columns[stop].append(table[own])
    return [
        _least(np.stack(own, axis=1), np.flatnonzero(mask) if mask.any() else np.arange(mask.size), number)
        for own, mask in zip(columns, usable, strict=True)
    ]


class _Bounds:
    """Least values of each cost over the paths of a graph, from some nodes or to some nodes."""

    def __init__(self, query: Query) -> None:
        from scipy.sparse import csr_array  # on first use: the import takes its time

        graph = query.graph
        summed = [j for j, aggregate in enumerate(graph.aggregates) if aggregate == "sum"]
        weights = [graph.costs[:, j].astype(float) for j in summed] or [np.ones(graph.arcs)]
        self._criteria, self._columns = graph.criteria, summed or [0]
        shape = (graph.nodes, graph.nodes)
        self._onward = [csr_array((weight, graph.heads, graph.indptr), shape=shape) for weight in weights]
        self._back = [matrix.T.tocsr() for matrix in self._onward]

    def of(self, nodes: IntArray, *, forward: bool) -> FloatArray:
        """Return the bounds (n, k) of paths from some nodes to each node if ``forward``, else of paths to some nodes.

        Costs that are maxima have the bound 0; if all are, the number of arcs takes the place of the first.
        """
        from scipy.sparse.csgraph import dijkstra  # on first use: the import takes its time

        matrices = self._onward if forward else self._back
        table = np.zeros((matrices[0].shape[0], self._criteria))
        for column, matrix in zip(self._columns, matrices, strict=True):
            table[:, column] = dijkstra(matrix, indices=nodes, min_only=True)
        return table


def _least(bounds: FloatArray, usable: IntArray, number: int) -> IntArray:
    """Choose at most ``number`` states of a stop by the rule of :func:`chosen_states`; return their indices.

    usable  indices, among the c states of the stop, of those that may be chosen
    bounds  (c, p, k)  lower bounds of each cost in p parts of tours, for each state; infinite where no path exists
    """
    if not usable.size:
        return usable
    finite = np.where(np.isfinite(bounds), bounds, -1.0)
    bounds = np.where(np.isfinite(bounds), bounds, FAR * (1.0 + finite.max(axis=(0, 1))))[usable]
    scale = np.maximum(bounds.sum(axis=1).min(axis=0), 1.0)
    table = (bounds / scale).reshape(usable.size, -1)
    rows, best = list[int](), np.full(table.shape[1], np.inf)
    while len(rows) < min(number, usable.size):
        sums = np.minimum(table, best).sum(axis=1)
        row = int(sums.argmin())
        if rows and sums[row] >= best.sum():
            break
        rows.append(row)
        best = np.minimum(best, table[row])
    return usable[rows]
