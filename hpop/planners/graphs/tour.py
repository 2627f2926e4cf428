"""Graph of a tour: one copy of the inner graph for each set of stops that may have been visited or skipped so far.

These copies are called layers. The stops of a layer's set are decided, the others still open
(:attr:`hpop.goals.Tour.layers`). A node is a state of the inner graph together with a layer.

Motions stay within a layer. Where a state belongs to a stop, an additional arc leads to the same state in a later
layer: it visits the stop, and its cost is the cost of standing there for the dwell time. Paths begin in the first
layer, where no stop is decided. They end in the last layer, or in an extra node that skips the remaining optional
stops. So any search on this graph finds complete tours, and its optimality claims hold for tours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, N, copied, inserted_in_layers
from hpop.criteria.base import Criterion, index_of_role
from hpop.criteria.visits import missed_weights, weight_of
from hpop.goals.tour import Tour
from hpop.motions import HOLD, Motions, States
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.arcs import blocks
from hpop.planners.graphs.state_graph import ARC, WrappedGraph
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph
from hpop.planners.objectives import motion_quanta, quantised
from hpop.search import Graph
from hpop.trajectories.trajectory import Trajectory

NONE = -1


@dataclass(frozen=True, eq=False)
class TourGraph(WrappedGraph):
    """Graph of a tour: a copy of the inner graph for each layer, and one extra node for each goal.

    If the inner graph has n nodes, its node v has the number l * n + v in layer l. The extra nodes come last. A path
    ends in one of them if it skips optional stops at its end.

    inner    graph of one layer, with start and goals among its nodes
    tour     stops and their order
    members  for each stop: the nodes (c,) of the inner graph at which it can be visited, in ascending order;
             none for a stop that is done, that is, was visited or skipped before (on a drive)
    goals    goal nodes of the inner graph; the extra nodes have the same order
    """

    tour: Tour
    members: tuple[IntArray, ...]
    goals: tuple[int, ...]

    @property
    def tour_layers(self) -> TourGraph:
        """The graph itself."""
        return self

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.tour.layers) * self.inner.size + len(self.goals)

    @property
    def words(self) -> str:
        """Description of the inner graph, the stops and their order, for certificates."""
        return f"{self.inner.words}, {self.tour.words}"

    @property
    def counts(self) -> dict[str, int]:
        """Statistics: sizes of the inner graph, number of layers, and number of states that belong to stops."""
        of_stops = sum(member.size for member in self.members)
        return {**self.inner.counts, "tour_layers": len(self.tour.layers), "stop_states": of_stops}

    @property
    def targets(self) -> list[int]:
        """Nodes at which a path may end: the goals in the last layer and, with optional stops, the extra nodes."""
        last = (len(self.tour.layers) - 1) * self.inner.size
        first = len(self.tour.layers) * self.inner.size
        ends = [last + goal for goal in self.goals]
        return [*ends, *range(first, first + len(self.goals))] if self.tour.optional else ends

    def inside(self, nodes: list[int]) -> list[int]:
        """Return the inner nodes of some nodes, where an added start or goal is replaced by its neighbours.

        Neighbours are the states of the inner graph to which the start or goal is joined.
        """
        return self.inner.inside(list(dict.fromkeys(self._states_of(np.array(nodes, np.int64)).tolist())))

    def _states_of(self, nodes: IntArray) -> IntArray:
        """Return the node of the inner graph for each node (N,) of the tour graph."""
        count, last = self.inner.size, len(self.tour.layers) * self.inner.size
        return np.where(nodes < last, nodes % count, np.array(self.goals)[np.maximum(nodes - last, 0)])

    def states(self, ids: IntArray) -> States:
        """Return the robot states (N,) at some nodes, given by number."""
        return self.inner.states(self._states_of(ids))

    # Arcs: at each node the arcs of the inner graph, then the arcs to other layers, which keep the state

    @cached_property
    def _climbs(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Arcs between layers, sorted by tail, as four arrays (c,): tail, head, visited stop, and row in ``_skips``.

        The stop is NONE for an arc that ends the tour by skipping the remaining stops.
        """
        count, parts = self.inner.size, []
        parts.append(tuple(np.zeros(0, np.int64) for _ in range(4)))  # all stops may be done
        goals = np.unique(self.goals)
        of_goal = np.array([self.goals.index(goal) for goal in goals.tolist()], np.int64)
        for (layer, stop, _, higher), row in self._skips.items():
            if stop == NONE:
                tails, heads = goals, len(self.tour.layers) * count + of_goal
            else:
                tails, heads = self.members[stop], self.members[stop] + higher * count
            parts.append((tails + layer * count, heads, np.full(tails.size, stop), np.full(tails.size, row)))
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        order = np.argsort(columns[0], kind="stable")
        tails, heads, stops, rows = (column[order].astype(np.int64) for column in columns)
        return tails, heads, stops, rows

    @cached_property
    def _skips(self) -> dict[tuple[int, int, tuple[int, ...], int], int]:
        """Index of each kind of arc between layers, to which ``_climbs`` refers.

        A kind is (layer, visited stop, skipped stops, next layer). Stop and next layer are NONE for an arc that ends
        the tour by skipping the remaining stops.
        """
        kinds = [(i, s.stop, s.skipped, s.layer) for i, steps in enumerate(self.tour.steps) for s in steps]
        kinds += [(layer, NONE, skipped, NONE) for layer, skipped in self.tour.endings if skipped]
        return {kind: row for row, kind in enumerate(kinds)}

    @property
    def rows(self) -> IntArray:
        """Row pointers (N + 1,): the arcs that leave node u have the indices rows[u] to rows[u + 1] - 1."""
        degrees = np.tile(np.diff(self.inner.rows), len(self.tour.layers))
        degrees = np.append(degrees, np.zeros(len(self.goals), np.int64))
        return np.append(np.zeros(1, np.int64), np.cumsum(degrees + np.bincount(self._climbs[0], minlength=self.size)))

    @property
    def heads(self) -> NDArray[np.int32]:
        """Head node (m,) of each arc."""
        return self.in_layers(self.inner.heads, self._climbs[1].astype(np.int32), self.inner.size)

    @cached_property
    def _before(self) -> IntArray:
        """For each arc between layers (c,): the number of arcs within layers before it in the list of all arcs."""
        inner, count = self.inner.rows, self.inner.size
        layers, states = np.divmod(self._climbs[0], count)
        return np.asarray(layers * inner[-1] + inner[states + 1])

    def in_layers(self, inner: NDArray[N], climbs: NDArray[N], step: int = 0) -> NDArray[N]:
        """Merge the values of arcs into one array (m, ...), in the order of all arcs of the tour graph.

        inner   values of the arcs of the inner graph, repeated in every layer; layer l gets l * ``step`` more
        climbs  values (c, ...) of the arcs between layers, or one value (1, ...) for all of them
        """
        return inserted_in_layers(inner, len(self.tour.layers), self._before, climbs, step)

    def _origins(self, arcs: IntArray) -> IntArray:
        """Return the index of the inner graph's arc for each arc of the tour graph; NONE for arcs between layers.

        arcs  (N,)  indices of arcs of the tour graph
        """
        climbs = self._before + np.arange(self._before.size)
        passed = np.searchsorted(climbs, arcs, side="right")
        is_climb = (passed > 0) & (climbs[np.maximum(passed - 1, 0)] == arcs) if climbs.size else arcs < 0
        return np.where(is_climb, NONE, (arcs - passed) % max(1, int(self.inner.rows[-1])))

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph: the inner arcs and their costs in every layer, and the arcs between layers.

        Arcs between layers cost what standing at a stop costs and, in the criterion stops_missed, the weights of the
        stops that they skip.
        """
        inner = self.inner.graph(criteria)
        doing = f"the {len(self.tour.layers)} layers of the tour ({self.size:,} nodes) were built"
        self.spending.hold(8 * self.size + self._before.size * (8 * len(criteria) + ARC), doing)
        return self.layered(inner, criteria)

    def layered(self, inner: Graph, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph, given the inner graph with its costs by the criteria.

        All layers share the arcs of the inner graph, see :class:`hpop.search.extended.ExtendedGraph`.
        """
        tails, heads, _, _ = self._climbs
        arcs = tails, heads, self._climb_costs(criteria)
        graph = inner.extended(self.size, *arcs, is_reused=True, layers=len(self.tour.layers))
        return copied(graph, turns=index_of_role("turns", criteria))

    def _climb_costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (c, k), in quanta, of the arcs between layers: standing at stops, and skipping stops."""
        tails, _, stops, rows = self._climbs
        costs = self.missed_costs([kind[2] for kind in self._skips], criteria)[rows]
        states = tails % self.inner.size
        for stop, members in enumerate(self.members):
            own = stops == stop
            costs[own] += self.dwell_costs(stop, criteria)[np.searchsorted(members, states[own])]
        return costs

    def missed_costs(self, skipped: Sequence[Sequence[int]], criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (n, k), in quanta, of skipping each of n lists of stops: their weights in stops_missed."""
        costs = np.zeros((len(skipped), len(criteria)), np.int64)
        missed = index_of_role("stops_missed", criteria)
        if missed is not None:
            weights = missed_weights(criteria)
            weighed = np.array([weight_of(self.tour, each, weights) for each in skipped], float)
            costs[:, missed] = quantised(weighed, criteria[missed])
        return costs

    def dwell_costs(self, stop: int, criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (c, k), in quanta, of standing for a stop's dwell time in each of its member states."""
        members, dwell = self.members[stop], self.tour.stops[stop].dwell
        costs = np.zeros((members.size, len(criteria)), np.int64)
        if not dwell:
            return costs
        for part in blocks(members.size):
            self.spending.check("the costs of standing at stops were computed")
            columns = {name: np.nan_to_num(c) for name, c in self.inner.states(members[part]).__dict__.items()}
            clock = np.zeros(members[part].size)
            start, end = States(**columns, **{CLOCK: clock}), States(**columns, **{CLOCK: clock + dwell})
            motions = Motions(self.world, self.model, HOLD, start, end)
            for j, criterion in enumerate(criteria):
                costs[part, j] = motion_quanta(motions, [criterion])[:, 0]
        return costs

    @property
    def turned(self) -> NDArray[np.int8]:
        """Count (m,) of each arc by which searches break ties: that of the inner graph, 0 for arcs between layers."""
        return self.in_layers(self.inner.turned, np.zeros(1, np.int8))

    # Checks

    def arcs_free(self, arcs: IntArray) -> BoolArray:
        """Return a mask of arcs (N,), given by index: True for those that are free of collision.

        An arc within a layer is checked once for all layers. Arcs between layers are always free.
        """
        origins = self._origins(arcs)
        own, which = np.unique(origins[origins != NONE], return_inverse=True)
        free = np.ones(arcs.size, dtype=np.bool_)
        free[origins != NONE] = self.inner.arcs_free(own)[which]
        return free

    def without(self, arcs: IntArray) -> TrajectoryGraph:
        """Return the tour graph without some blocked arcs (N,), given by index; every layer loses them."""
        origins = self._origins(arcs)
        return replace(self, inner=self.inner.without(np.unique(origins[origins != NONE])))

    # Trajectories

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the motions of n paths, without the holds at stops.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        return self._driven(ids, sizes)[0]

    def trajectories_through(self, ids: IntArray, sizes: IntArray) -> tuple[Trajectory, ...]:
        """Return n trajectories, with a hold at each stop that has a dwell time.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        stretches, holds = self._driven(ids, sizes)
        moving = stretches.trajectories(self.model, self.kinds)
        return tuple(trajectory.with_holds(*held) for trajectory, held in zip(moving, holds, strict=True))

    def _driven(self, ids: IntArray, sizes: IntArray) -> tuple[Stretches, list[tuple[IntArray, Any]]]:
        """Return the motions of n paths, and the holds of each path: indices of its states, and durations in s.

        Arguments as for :meth:`stretches`. Each path is cut into parts where the robot holds, and at states that were
        added to the graph for a stop. The first parts of all paths are computed in one call, then all second parts,
        and so on.
        """
        alone = self.inner.states_alone
        joined = self.inner.size if alone is None else alone.size
        parts: list[list[tuple[int, IntArray]]] = []  # for each part of paths: path, nodes
        holds: list[list[tuple[int, float]]] = []  # for each path: number of parts before the hold, s
        for path, nodes in enumerate(np.split(ids, np.cumsum(sizes)[:-1])):
            kept, cuts, held = self._cut(nodes, joined)
            holds.append(held)
            bounds = [0, *cuts, kept.size - 1]
            for part, (begin, end) in enumerate(pairwise(bounds)):
                if part == len(parts):
                    parts.append([])
                parts[part].append((path, kept[begin : end + 1]))
        made = [self._part(part, sizes.size) for part in parts]
        stretches = Stretches.joined(self.model.space, made)
        motions = np.cumsum([np.maximum(part.sizes - 1, 0) for part in made], axis=0)  # (p, n) up to each part's end
        motions = np.concatenate([np.zeros((1, sizes.size), np.int64), motions])
        return stretches, [
            (np.array([motions[part, i] for part, _ in held], np.int64), np.array([lasts for _, lasts in held]))
            for i, held in enumerate(holds)
        ]

    def _cut(self, nodes: IntArray, joined: int) -> tuple[IntArray, list[int], list[tuple[int, float]]]:
        """Cut a path of the tour graph into parts; return its inner nodes, its cuts and its holds.

        Cuts are indices into the inner nodes. A hold is the number of parts before it, and its duration in s.

        joined  first number of the nodes that were added to the inner graph for ends and stops
        """
        states = self._states_of(nodes)
        layers = np.minimum(nodes // self.inner.size, len(self.tour.layers))
        climbs = np.append(False, (layers[1:] != layers[:-1]) & (states[1:] == states[:-1]))
        kept = states[~climbs]
        at = np.cumsum(~climbs) - 1  # index of each node's state in `kept`
        dwells: list[tuple[int, float]] = []
        for i in np.flatnonzero(climbs).tolist():
            steps = self.tour.steps[layers[i - 1]]
            stop = next((step.stop for step in steps if step.layer == layers[i]), None)
            if stop is not None and self.tour.stops[stop].dwell:
                dwells.append((int(at[i]), self.tour.stops[stop].dwell))
        last, marks = kept.size - 1, self.inner.is_marker(kept)
        inner_ends = [place for place in np.flatnonzero((kept >= joined) & ~marks).tolist() if 0 < place < last]
        cuts = sorted({*inner_ends, *(place for place, _ in dwells if 0 < place < last)})
        number = {0: 0, **{place: part for part, place in enumerate(cuts, 1)}}
        number.setdefault(last, len(cuts) + 1)
        return kept, cuts, [(number[place], lasts) for place, lasts in dwells]

    def _part(self, part: list[tuple[int, IntArray]], paths: int) -> Stretches:
        """Return the motions of one part of some paths; the other paths get a part without states.

        part   for each path that has this part: its index, and the inner nodes of the part
        paths  number of all paths
        """
        lengths = np.array([nodes.size for _, nodes in part], np.int64)
        made = self.inner.stretches(np.concatenate([nodes for _, nodes in part]), lengths)
        sizes = np.zeros(paths, np.int64)
        sizes[[path for path, _ in part]] = made.sizes
        return Stretches(made.states, made.kinds, sizes)

    # Reasons

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason, as text for an error, why no path from the start visits the stops and ends at a goal."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import breadth_first_order

        (begin,), ends = self._states_of(np.array([start])).tolist(), list(dict.fromkeys(self.goals))
        size, heads = self.inner.size, self.inner.heads
        links = csr_array((np.ones(heads.size, np.int8), heads, self.inner.rows), shape=(size, size))
        reached = np.zeros(size, dtype=bool)
        reached[breadth_first_order(links, begin, return_predecessors=False)] = True
        for stop, members in zip(self.tour.stops, self.members, strict=True):
            if not stop.optional and members.size and not reached[members].any():
                why = self.inner.what_separates(begin, self.inner.inside(members.tolist()))
                return f"stop {stop.name!r} cannot be reached from the start; with this stop as the goal: {why}"
        if not reached[ends].any():
            return self.inner.what_separates(begin, ends)
        return (
            "each stop that is not optional can be reached from the start, but no path visits them in an order that "
            "the tour allows and then reaches a goal; change the order, or make a stop optional"
        )
