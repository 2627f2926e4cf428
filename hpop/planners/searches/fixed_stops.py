"""Search for tours with many stops: each stop is fixed to one state of the graph, or to a few.

Between these states, called sites, the exact search finds the fronts of paths. A tour is a sequence of such paths, and
its costs are those of the paths and dwells together. So all tours are the paths of a small graph, as in the method of
Held and Karp (1962, doi 10.1137/0110015): its nodes are pairs of a set of decided stops and the site that was visited
last, and its arcs are the paths of the fronts. The exact search on this graph finds the front of tours.

The few states of a graph at which the robot may visit a stop are chosen here too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray, copied
from hpop.errors import OptionError
from hpop.frontier import is_nondominated
from hpop.goals.tour import Tour
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.spending import Limits
from hpop.search import Graph, ParetoPaths, pareto_paths

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
    the stop has others. With several chosen states, each bound counts with its least value among them. Each further
    state is the one that lowers the sum of these least values most; if no state lowers it, no more are chosen.

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


MOST_PARTS = 1_000_000  # pairs of sites, for all sets of decided stops
SHOWN = 3  # states of a stop that a certificate lists
Fronts = Mapping[tuple[int, int], ParetoPaths]
"""Paths from one site to another, by the indices of both; ENDS stands for the start, and for the goals."""


@dataclass(frozen=True, eq=False, repr=False)
class TourPaths(ParetoPaths):
    """Tours that were found, as paths of the graph of a tour.

    tours  for each tour: its nodes in the graph of the tour
    """

    tours: tuple[IntArray, ...] = field(default=(), kw_only=True)

    @property
    def lengths(self) -> IntArray:
        """Number (n,) of arcs of each tour."""
        return np.array([nodes.size - 1 for nodes in self.tours], np.int64)

    def through(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Return the nodes (N,) of some tours (r,), tour after tour, and how many nodes each of them has (r,)."""
        tours = [self.tours[row] for row in rows]
        sizes = np.array([nodes.size for nodes in tours], np.int64)
        return np.concatenate([np.zeros(0, np.int64), *tours]), sizes

    def with_tours_of(self, other: TourPaths) -> TourPaths:
        """Return these tours and those of another result, without those that are dominated."""
        costs, tours = np.concatenate([self.costs, other.costs]), (*self.tours, *other.tours)
        order = np.lexsort(costs.T[::-1])
        rows = order[is_nondominated(costs[order])] if order.size else order
        return replace(self, costs=costs[rows], tours=tuple(tours[row] for row in rows))


@dataclass(frozen=True, eq=False)
class FixedStops:
    """Tour whose stops are fixed to sites, on a graph. A site is a state at which a stop may be visited.

    query    the graph without the tour, with start and goals
    layered  the graph of the tour, in which stops can be visited at the sites only; its arcs are never computed
    stages   parts of the tours that the order allows
    """

    query: Query
    layered: TourGraph
    stages: Sequence[Stage]

    @cached_property
    def sites(self) -> list[tuple[int, int]]:
        """Stop and node of each site."""
        return [(stop, node) for stop, nodes in enumerate(self.layered.members) for node in nodes.tolist()]

    @cached_property
    def parts(self) -> IntArray:
        """All parts of tours, as rows (p, 3): the index of a stage, and of the sites where it begins and ends.

        ENDS stands for the start, and for the goals. Raises OptionError if there are more than MOST_PARTS.
        """
        of_stop: dict[int, list[int]] = {ENDS: [ENDS]}
        for site, (stop, _) in enumerate(self.sites):
            of_stop.setdefault(stop, []).append(site)
        count = sum(len(of_stop[stage.origin]) * len(of_stop[stage.stop]) for stage in self.stages)
        if count > MOST_PARTS:
            raise OptionError(
                f"stop_states must be smaller for a tour with {len(self.layered.tour.layers):,} sets of visited stops: "
                f"{len(self.sites)} states of its stops make {count:,} parts of tours, and at most {MOST_PARTS:,} are "
                "searched; give a smaller number, or leave stop_states out"
            )
        listed = [
            (i, origin, target)
            for i, stage in enumerate(self.stages)
            for origin in of_stop[stage.origin]
            for target in of_stop[stage.stop]
        ]
        return np.array(listed, np.int64)

    # Paths between sites

    def pairs(self, parts: IntArray) -> list[tuple[int, int]]:
        """Return the different pairs (begin, end) of sites in some rows (p, 3) of :attr:`parts`."""
        return [(origin, target) for origin, target in np.unique(parts[:, 1:], axis=0).tolist()]

    def front_between(self, origin: int, target: int, limits: Limits, eps: float) -> ParetoPaths:
        """Return the front of the paths from one site (index) to another, within a factor 1 + ``eps``.

        ENDS stands for the start as ``origin``, and for the goals as ``target``.
        """
        start = self.query.start if origin == ENDS else self.sites[origin][1]
        goals = self.query.goals if target == ENDS else [self.sites[target][1]]
        found = copied(self.query, start=start, goals=goals).paths(limits, eps=eps)
        assert isinstance(found, ParetoPaths)
        return found

    def shortest_tour(self) -> IntArray:
        """Return the tour that is least in a sum of all costs and visits all stops, if it can.

        The tour is given by its parts, as rows (q, 3) of :attr:`parts`; none if there is no tour. Each cost counts in
        multiples of its least value from the start to the goals. Optional stops are skipped only if no path leads to
        them.
        """
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import dijkstra

        graph, goals = self.query.graph, self.query.goals
        shape = (graph.nodes, graph.nodes)

        def distances(weights: FloatArray, node: int) -> FloatArray:
            matrix = csr_array((weights, graph.heads, graph.indptr), shape=shape)
            return np.asarray(dijkstra(matrix, indices=np.array([node]), min_only=True))

        weights = np.zeros(graph.arcs)
        for costs in graph.costs.T.astype(float):
            least = distances(costs, self.query.start)[goals].min()
            weights += costs / (least if 0.0 < least < math.inf else max(1.0, costs.max(initial=0.0)))
        ends = np.array([node for _, node in self.sites], np.int64)
        table = np.full((len(self.sites) + 1, len(self.sites) + 1), np.inf)  # the last row and column are for ENDS
        for row, node in enumerate([*ends.tolist(), self.query.start]):
            self.query.space.spending.check("the shortest tour was searched")
            reached = distances(weights, node)
            table[row] = np.append(reached[ends], reached[goals].min())
        skipping = table[np.isfinite(table)].sum() + 1.0
        best: dict[tuple[int, int], tuple[float, int]] = {(0, ENDS): (0.0, ENDS)}  # by layer and site: sum, last part
        final = (math.inf, ENDS)
        for row, (number, origin, target) in enumerate(self.parts.tolist()):  # layers come in ascending order
            stage = self.stages[number]
            before = best.get((stage.layer, origin), (math.inf, ENDS))[0]
            total = before + table[origin, target] + skipping * len(stage.skipped)
            if stage.stop == ENDS:
                final = min(final, (total, row))
            elif total < best.get((stage.after, target), (math.inf, ENDS))[0]:
                best[stage.after, target] = total, row
        rows, last = list[int](), final[1] if final[0] < math.inf else ENDS
        while last != ENDS:
            rows.append(last)
            number, origin, _ = self.parts[last].tolist()
            last = best[self.stages[number].layer, origin][1]
        return self.parts[rows[::-1]]

    # Tours

    def tours(self, fronts: Fronts, parts: IntArray, limits: Limits, eps: float, slack: IntArray) -> TourPaths:
        """Return the front of the tours that consist of some of the parts, given as rows (p, 3) of :attr:`parts`.

        Errors are allowed: ``eps``, relative, and ``slack`` (k,), absolute, in quanta.

        fronts  paths of each pair of sites in the parts; the tours use no other paths
        """
        query, spending = self.query, self.query.space.spending
        sizes = np.array([len(fronts[origin, target]) for _, origin, target in parts.tolist()], np.int64)
        nodes, tails, heads = self._ends_of(parts)
        order = np.argsort(tails, kind="stable")
        order = order[sizes[order] > 0]
        parts, sizes, tails, heads = parts[order], sizes[order], tails[order], heads[order]
        memory = int(sizes.sum()) * (16 * query.graph.criteria + 16)
        spending.hold(memory, "paths between stops were joined")
        worst = np.array(query.graph.aggregates) == "max"
        costs = np.repeat(self._costs_at_ends(parts), sizes, axis=0)
        each = [fronts[origin, target].costs for _, origin, target in parts.tolist()]
        of_paths = np.concatenate([np.zeros((0, worst.size), np.int64), *each])
        for column, of_path, is_worst in zip(costs.T, of_paths.T, worst, strict=True):  # in place, to save memory
            (np.maximum if is_worst else np.add)(column, of_path, out=column)
        del each, of_paths
        leaving = np.bincount(tails, weights=sizes, minlength=nodes).astype(np.int64)
        rows, aggregates = np.append(0, np.cumsum(leaving)), query.graph.aggregates
        graph = Graph.from_csr(rows, np.repeat(heads, sizes), costs, aggregates=aggregates)
        found = pareto_paths(
            graph,
            0,
            nodes - 1,
            budget=limits,
            progress=limits.progress,
            eps=eps,
            tolerance=slack.tolist(),
            at_most=query.at_most(),
            checkpoint=limits.checkpoint,
        )
        spending.release(memory)
        first = np.cumsum(sizes) - sizes
        tours = []
        for arcs in found.places:
            own = np.searchsorted(first, arcs, side="right") - 1
            chosen = zip(parts[own].tolist(), (arcs - first[own]).tolist(), strict=True)
            tours.append(self._nodes([(self.stages[i], fronts[o, t].nodes(row)) for (i, o, t), row in chosen]))
        return TourPaths(found.costs, found.status, found.stats, query.graph, 0, (), gap=found.gap, tours=tuple(tours))

    def _ends_of(self, parts: IntArray) -> tuple[int, IntArray, IntArray]:
        """Return the number of nodes of the small graph, and the tail and head (p,) of each part (p, 3) in it.

        A part is a row of :attr:`parts`: a stage, and the sites where it begins and ends. Node 0 is the start. The last
        node is the end of all tours.
        """
        count, last = len(self.sites), 1 + len(self.layered.tour.layers) * len(self.sites)
        layers = np.array([(stage.layer, stage.after) for stage in self.stages], np.int64)[parts[:, 0]]
        tails = np.where(parts[:, 1] == ENDS, 0, 1 + layers[:, 0] * count + parts[:, 1])
        heads = np.where(parts[:, 2] == ENDS, last, 1 + layers[:, 1] * count + parts[:, 2])
        return last + 1, tails, heads

    def _costs_at_ends(self, parts: IntArray) -> IntArray:
        """Return the costs (p, k) of the dwell that ends each part, and of the stops that it skips.

        parts  (p, 3)  rows of :attr:`parts`
        """
        criteria, stops = self.query.objectives.optimised, range(len(self.layered.members))
        nothing = np.zeros((1, len(criteria)), np.int64)  # for ENDS, which is the last row
        dwells = np.concatenate([*(self.layered.dwell_costs(stop, criteria) for stop in stops), nothing])
        missed = self.layered.missed_costs([stage.skipped for stage in self.stages], criteria)
        return np.asarray(dwells[parts[:, 2]] + missed[parts[:, 0]])

    def _nodes(self, path: Sequence[tuple[Stage, IntArray]]) -> IntArray:
        """Return the nodes of a tour in the graph of the tour, from its stages and the nodes of the path in each."""
        count = self.layered.inner.size
        nodes = [stage.layer * count + driven for stage, driven in path]
        stage, driven = path[-1]
        if stage.skipped:  # it ends in the extra node of its goal
            extra = len(self.layered.tour.layers) * count + self.layered.goals.index(int(driven[-1]))
            nodes.append(np.array([extra]))
        return np.concatenate(nodes)

    @property
    def words(self) -> str:
        """States of the sites in words, for certificates: "east (6, 1, 90 deg), north (1, 5, 0 deg)"."""
        space = self.layered.model.space
        texts = []
        for stop in self.layered.tour.remaining:
            name, nodes = self.layered.tour.names[stop], self.layered.members[stop]
            states = self.layered.inner.states(nodes[:SHOWN])
            columns = [
                (np.degrees if unit == "rad" else np.asarray)(getattr(states, column))
                for column, unit in zip(space.names, space.units, strict=True)
            ]
            rows = zip(*(column.tolist() for column in columns), strict=True)
            each = [
                "(" + ", ".join(_value(v, unit) for v, unit in zip(row, space.units, strict=True)) + ")" for row in rows
            ]
            more = [f"{nodes.size - SHOWN} more"] if nodes.size > SHOWN else []
            texts.append(f"{name} {' or '.join([*each, *more])}")
        return ", ".join(texts)


def _value(value: float, unit: str) -> str:
    """Return a coordinate of a state as text; "any" if it is not determined, that is, NaN.

    If ``unit`` is "rad", the value must be in degrees already: only "deg" is written behind it.
    """
    return "any" if math.isnan(value) else f"{value + 0.0:.4g}{' deg' if unit == 'rad' else ''}"
