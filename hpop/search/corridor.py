"""Corridor of a large graph: the states that a path can pass which no known path covers within the precision.

A search within a precision on a floor of millions of states does not fit memory: its tables and its joint bounds have
rows for all states. Few of these states matter. Let the costs be a first cost, the number of turns and a rest cost, and
let a lane be a weighted sum of first and rest cost. Then

- B_k(v) is the least weighted remaining cost from state v with at most k turns, for each lane: a layer for each k.
  Layers are swept one after the other on the arrays of the graph, until nothing changes: the last holds for any k.
- The states on the best paths of these layers are few. The front of the paths among them is searched within a quarter
  of the precision. These are the known paths.
- F_j(v) is the least weighted cost from the source to v with j turns. It is swept onward from the source, and only
  through pairs (v, j) for which some k has F_j(v) + B_k(v) in the region of costs with j + k turns that no known path
  covers (:mod:`.staircase.labels`). These states v are the corridor.

Every path that the known paths do not cover stays in the corridor, since each of its states passes the test: both sums
are lower bounds. So the front of the corridor and the known paths together are a front of the whole graph within the
precision.

All rounding is down. A lane counts in 32 bits; B_k is stored in 8 bits a lane, above the least value of 8 neighbours,
for each k below EACH, then for every second k.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.frontier import is_nondominated
from hpop.runtime.limits import Status
from hpop.search.graph import Graph
from hpop.search.machinery import Precision, thin_front
from hpop.search.machinery.slices import Clock
from hpop.search.queries import ParetoPaths, SearchStats, query_text
from hpop.search.staircase.labels import UncoveredCorners, least_estimates
from hpop.search.staircase.turn_hull import FAR, UNIT
from hpop.search.staircase.two_sided import (
    ADDED,
    BLOCK_BITS,
    DEGREE,
    LANES,
    REACHED,
    RunArcs,
    encode,
    find_plain,
    follow,
    pull_plain,
    pull_turns,
    push,
)

RATIOS = (0.15, 6.0)  # weights of the rest cost in the two mixed lanes, for costs of 1 of the whole path
NEAR, THIN = 4, 6  # known paths have the precision eps / NEAR; a part of them covers them within eps / THIN
MOST = 32  # layers whose choices are stored
EACH = 8  # first layers, all of which are stored; of later layers, every second one
ROWS = EACH + (MOST - EACH) // 2 + 2
NEVER = 2**16 - 1  # more turns than any path has
SETTLED = 4  # choices are stored until this many layers in a row hardly improve the costs at the source
SAMPLE = 97  # the first guess averages the costs of every 97th move
CLOSE, LARGEST = 0.001, 2.0**20  # precision of a proven gap; a larger gap counts as infinite
DOWN = 1 - 2.0**-20  # factor beyond the rounding of a product and a sum in 32 bits
BYTES = 2 * (MOST - 5) + 4 * (ROWS + ROWS // 4) + 3 * 4 * LANES + 40  # for each state, while a corridor is computed

Search: TypeAlias = Callable[[Graph, int, IntArray, Precision, Clock], ParetoPaths]
"""Search of a graph from a source to targets within a precision."""


class EndArcs(NamedTuple):
    """Arcs that a graph adds to its base: from a start without entering arcs, or to a goal without leaving arcs.

    tails, heads  (j,)    nodes
    costs         (j, 3)  first cost, turns and rest cost
    onward        (j,)    True for arcs from a start to a state of the base, False for arcs to a goal
    """

    tails: IntArray
    heads: IntArray
    costs: IntArray
    onward: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LargeQuery:
    """Query of a large graph in which each arc has one turn or none, and arcs without a turn form straight runs.

    columns  columns of the first cost, the turns and the rest cost
    """

    graph: Graph
    source: int
    targets: IntArray
    columns: tuple[int, int, int]
    arcs: RunArcs
    added: EndArcs
    clock: Clock

    @classmethod
    def of(cls, graph: Graph, source: int, targets: IntArray, clock: Clock) -> Self | None:
        """Return the query, or None if the graph has other costs or arcs than a corridor needs, or memory is short."""
        base = graph.layer
        limit = clock.budget.max_memory
        if graph.layers > 1 or graph.aggregates != ("sum",) * 3 or (limit and BYTES * base.nodes > limit):
            return None
        counted = [j for j in range(3) if base.largest[j] == 1] if graph.turns is None else [graph.turns]
        if len(counted) != 1 or base.largest[counted[0]] != 1 or int(np.diff(base.indptr).max(initial=0)) >= DEGREE:
            return None
        first, rest = (j for j in range(3) if j != counted[0])
        columns = first, counted[0], rest
        plain = np.full(base.nodes, -1, np.int32)
        costs = [np.ascontiguousarray(base.cost(j)) for j in columns]
        if not clock.call(find_plain, base.indptr, base.heads, costs[1], plain):
            return None
        arcs = RunArcs(base.indptr, base.heads, costs[0], costs[1], costs[2], plain)
        more = graph.added
        tails = np.searchsorted(graph.indptr, more.places, side="right") - 1
        added = EndArcs(tails, more.heads.astype(np.int64), more.costs[:, list(columns)], more.heads < base.nodes)
        starts, goals = tails[added.onward], more.heads[~added.onward]
        if (starts < base.nodes).any() or np.isin(starts, more.heads).any() or np.isin(goals, tails).any():
            return None
        return cls(graph, source, targets, columns, arcs, added, clock)

    def sweep(self, eps: float) -> LayerSweep | Status | None:
        """Return the sweep of all layers from the targets, or the status of a limit that passed meanwhile.

        Returns None if there is no path, or if weighted costs could exceed 32 bits.

        The weights are those of a whole path with the fewest turns, which a first sweep with guessed weights finds.
        """
        moves = self.arcs.plain[self.arcs.plain >= 0][::SAMPLE]
        steps = 2 * math.sqrt(len(self.arcs.plain))
        typical = [float(costs[moves].mean()) * steps if len(moves) else 1.0 for costs in self._costs]
        for is_first in (True, False):
            scale = [UNIT / max(1.0, cost) for cost in typical]
            mixed = [(scale[0] / (1 + r), scale[1] * r / (1 + r)) for r in RATIOS]
            weights = np.array([(scale[0], 0.0), (0.0, scale[1]), *mixed])
            if (weights @ self.graph.largest[[self.columns[0], self.columns[2]]] >= FAR).any():
                return None
            sweep = LayerSweep(self, weights, eps)
            if (status := sweep.run(is_first=is_first)) is not None:
                return status
            if sweep.best[0] >= FAR:
                return None
            typical = [cost / UNIT * old for cost, old in zip(sweep.best[:2].tolist(), typical, strict=True)]
        return sweep

    @property
    def _costs(self) -> tuple[NDArray[Any], NDArray[Any]]:
        return self.arcs.first, self.arcs.rest

    def corners(self, sweep: LayerSweep, known: IntArray, precision: Precision) -> tuple[NDArray[np.int32], IntArray]:
        """Return the corners of the region that the costs ``known`` (p, 3) leave (:class:`.UncoveredCorners`)."""
        covered = least_estimates(known[:, list(self.columns)], precision.eps, precision.of(self.columns))
        corners = UncoveredCorners.of(covered, np.tile(sweep.weights, (2, 1)), self.clock)  # a corner has 8 lanes
        return corners.values[:, :, :LANES].copy(), corners.last

    def gap(self, sweep: LayerSweep, known: IntArray, precision: Precision) -> float:
        """Return a gap of the costs ``known`` (p, 3) to those of all paths, as the layers at the source prove it.

        Returns inf for a gap above LARGEST.
        """
        low, high = precision.eps, math.inf
        gap = max(low, CLOSE)
        while gap < LARGEST and high - low > CLOSE:
            values, last = self.corners(sweep, known, replace(precision, eps=gap))
            rows = [min(n, len(last) - 1) for n in range(len(sweep.bests))]
            is_proven = not any(
                best[0] < FAR and (values[row, : last[row] + 1] >= best).all(axis=1).any()
                for row, best in zip(rows, sweep.bests, strict=True)
            )
            low, high = (low, gap) if is_proven else (gap, high)
            gap = (low + high) / 2 if math.isfinite(high) else 2 * gap
        return high

    def corridor(self, sweep: LayerSweep, known: IntArray, precision: Precision) -> IntArray | Status:
        """Return the states of the base through which a path may lead that the costs ``known`` (p, 3) do not cover.

        Returns the status of a limit that passed, instead of the states.
        """
        tables = (self.arcs, sweep.narrow, sweep.stored(), self.corners(sweep, known, precision))
        n = len(self.arcs.plain)
        forward, mark = np.full((n, LANES), FAR, np.int32), np.zeros(n, np.uint8)
        waiting, after, bound = np.empty(n, np.int32), np.empty(n, np.int32), np.zeros(LANES, np.int64)
        leave = self.added.onward & (self.added.tails == self.source)
        starts = self.added.heads[leave], self.added.costs[leave, 1], sweep.price[leave]
        if self.source < n:
            starts = np.array([self.source]), np.zeros(1, np.int64), np.zeros((1, LANES), np.int64)
        turns = reached = 0
        while reached or turns <= starts[1].max(initial=0):
            states = after[:reached].copy()
            before = forward[states]
            count = 0
            for state, cost in zip(starts[0][starts[1] == turns], starts[2][starts[1] == turns], strict=True):
                forward[state] = np.minimum(forward[state], cost)
                if not mark[state] & 1:
                    waiting[count], mark[state] = state, mark[state] | 1
                    count += 1
            search = (forward, mark, waiting, count, bound, after)
            reached = self.clock.call(push, states, before, turns, *tables, *search)
            turns += 1
            if (status := self.clock.exceeded(0, 0)) is not None:
                return status
        return np.flatnonzero(mark & 4)

    def front(self, states: IntArray, precision: Precision, search: Search) -> ParetoPaths:
        """Return the front of the paths through some states of the base, the source and the targets."""
        nodes = np.union1d(states, np.append(self.targets, self.source))
        part = self.graph.among(nodes)
        clock = self.clock.silent(0, 0)
        found = search(
            part, int(np.searchsorted(nodes, self.source)), np.searchsorted(nodes, self.targets), precision, clock
        )
        self.clock.compiled += clock.compiled
        self.clock.peak = max(self.clock.peak, clock.peak)
        return replace(found.on(self.graph), _source=self.source)


class LayerSweep:
    """Sweep of all layers of a query, with the lanes of ``weights`` (LANES, 2).

    best  (LANES,)  weighted costs of the best paths from the source in the newest layer
    """

    def __init__(self, query: LargeQuery, weights: FloatArray, eps: float) -> None:
        self.query, self.weights, self.near = query, weights, eps / (2 * NEAR)
        self.narrow = (weights * DOWN).astype(np.float32)
        n = len(query.arcs.plain)
        self.now, self.before = np.full((n, LANES), FAR, np.int32), np.full((n, LANES), FAR, np.int32)
        self.better, self.changed = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
        self.choices = np.zeros((MOST, n), np.uint16)  # memory is taken when a layer is written
        self.bases = np.zeros((ROWS, (n - 1 >> BLOCK_BITS) + 1, LANES), np.uint16)
        self.codes = np.zeros((ROWS, n, LANES), np.uint8)
        self.begins = [0]
        self.fewest = np.full(n, NEVER, np.uint16)
        price = (query.added.costs[:, [0, 2]] @ (weights * DOWN).T).astype(np.int64)  # (j, LANES)
        self.price = np.minimum(price, REACHED)
        self.history: list[IntArray] = []  # remaining costs at the heads of added arcs, layer by layer
        self.bests: list[IntArray] = []
        self.last = 0  # number of layers whose choices are stored

    @property
    def best(self) -> IntArray:
        """Weighted costs (LANES,) of the best paths from the source in the newest layer."""
        return self.bests[-1]

    def run(self, *, is_first: bool) -> Status | None:
        """Sweep until nothing changes (a first sweep: until the source is reached); return a passed limit, or None."""
        query, turns, is_stored = self.query, 0, not is_first
        arcs, clock, n = query.arcs, query.clock, len(query.arcs.plain)
        at = query.targets[query.targets < n]
        self.now[at], self.better[at] = 0, 1
        unused = np.zeros(n, np.uint16)
        while True:
            choice = self.choices[turns] if is_stored else unused
            if turns:
                self.now, self.before, self.better, self.changed = self.before, self.now, self.changed, self.better
                parts = [(0, n // 2), (n // 2, n)]
                tables = (self.before, self.changed, arcs, self.narrow, self.now, self.better, choice)
                clock.call_all(pull_turns, [(*part, *tables) for part in parts])
            entered = self._enter_goals(turns, choice)
            clock.call_all(
                pull_plain, [(rising, arcs, self.narrow, self.now, self.better, choice) for rising in (True, False)]
            )
            self.fewest[(self.better > 0) & (self.fewest == NEVER)] = turns
            self._look_at_source(turns)
            is_end = not (self.better.any() or entered)
            if is_stored:
                self.last = turns + 1
            if is_end or (is_stored and (turns < EACH or turns % 2 == 0)):
                clock.call(encode, self.now, len(self.begins) - 1, self.bases, self.codes)
                self.begins.append(NEVER if is_end else turns + 1)
            if is_end and query.source >= n:  # a last entry, for any number of turns
                self.bests.append(self._best_by_arcs(dict.fromkeys(self.starts(NEVER), -1)))
            if is_end or (is_first and self.best[0] < FAR):
                return None
            clock.report("bounds")
            if (status := clock.exceeded(0, BYTES * n)) is not None:
                return status
            reached = [best for best in self.bests if best[0] < FAR]
            settled = len(reached) > SETTLED and (reached[-SETTLED - 1] <= self.best * (1 + self.near)).all()
            turns += 1
            is_stored &= not settled and turns < MOST

    def _enter_goals(self, turns: int, choice: NDArray[np.uint16]) -> bool:
        """Lower states from which an added arc with this number of turns leads to a goal; return if more come later."""
        added = self.query.added
        goals = ~added.onward & np.isin(added.heads, self.query.targets) & (added.tails < len(self.now))
        for j in np.flatnonzero(goals & (added.costs[:, 1] == turns)):
            v = int(added.tails[j])
            for k in np.flatnonzero(self.price[j] < self.now[v]).tolist():
                self.now[v, k], self.better[v] = self.price[j, k], 1
                choice[v] = (int(choice[v]) & ~(15 << 4 * k)) | ADDED << 4 * k
        return bool((added.costs[goals, 1] > turns).any())

    def _look_at_source(self, turns: int) -> None:
        """Add the newest layer's values at the source, and at the heads of added arcs."""
        query = self.query
        self.history.append(self.now[np.where(query.added.onward, query.added.heads, 0)].astype(np.int64))
        if query.source < len(self.now):
            self.bests.append(self.now[query.source].astype(np.int64))
            return
        self.bests.append(self._best_by_arcs({j: turns - int(query.added.costs[j, 1]) for j in self.starts(turns)}))

    def _best_by_arcs(self, layers: Mapping[int, int]) -> IntArray:
        """Return the least costs (LANES,) from the source by added arcs; ``layers`` has the layer after each arc."""
        rows = [np.full(LANES, FAR)]
        for j, layer in layers.items():
            remaining = self.history[layer][j]
            rows.append(np.where(remaining < FAR, np.minimum(remaining + self.price[j], REACHED), FAR))
        return np.asarray(np.min(rows, axis=0))

    def starts(self, turns: int) -> list[int]:
        """Return the added arcs, by index, from the source to the base that have at most ``turns`` turns."""
        added = self.query.added
        leave = added.onward & (added.tails == self.query.source) & (added.costs[:, 1] <= turns)
        return [int(j) for j in np.flatnonzero(leave)]

    def states_on_best_paths(self) -> IntArray:
        """Return the states of the base on best paths from the source, for each lane and number of turns."""
        arcs, added, source = self.query.arcs, self.query.added, self.query.source
        passed = np.zeros(len(self.now), np.uint8)
        open_paths: list[set[tuple[int, int]]] = [set() for _ in range(self.last)]
        for m in range(self.last):
            for k in range(LANES):
                if self.bests[m][k] >= FAR:
                    continue
                if source < len(self.now):
                    open_paths[m].add((k, source))
                    continue
                used = added.costs[:, 1]
                j = min(self.starts(m), key=lambda j: self.history[m - int(used[j])][j, k] + self.price[j, k])
                open_paths[m - int(used[j])].add((k, int(added.heads[j])))
        for m in range(self.last - 1, -1, -1):
            for k, v in open_paths[m]:
                u, name = divmod(self.query.clock.call(follow, m, k, v, self.choices[m], arcs, passed), 32)
                if m > 0 and name != ADDED:
                    open_paths[m - 1].add((k, u if name == 0 else int(arcs.heads[arcs.indptr[u] + name - 1])))
        return np.flatnonzero(passed)

    def stored(self) -> tuple[Any, ...]:
        """Return the stored layers as arguments of :func:`is_in_corridor`."""
        return self.bases, self.codes, np.array(self.begins), self.fewest


def search_in_corridor(
    graph: Graph, source: int, targets: IntArray, precision: Precision, search: Search, clock: Clock
) -> ParetoPaths | None:
    """Search a large graph within a precision, in a corridor.

    Returns None if the graph has other costs or arcs than a corridor needs, if there is no path, or if memory is short;
    then another search is needed. ``search`` searches a part of the graph.
    """
    query = LargeQuery.of(graph, source, targets, clock)
    if query is None:
        return None
    clock.report("bounds")
    known = ParetoPaths(np.zeros((0, 3), np.int64), Status.INTERRUPTED, SearchStats("staircase"), graph, source, ())
    gap = math.inf
    try:
        sweep = query.sweep(precision.eps)
        if sweep is None:
            return None
        if isinstance(sweep, Status):
            return replace(known, status=sweep, gap=gap)
        states = sweep.states_on_best_paths()
        del sweep.choices, sweep.now, sweep.before
        near = Precision(precision.eps / NEAR, tuple(t // NEAR for t in precision.tolerance))
        first = query.front(states, near, search)
        if not len(first) and first.status.is_final:  # best paths have more turns than layers are stored
            return None
        rows = thin_front(first.costs, first.costs[:0], precision.eps / THIN, near.of(range(3)))
        known = replace(
            first.select(first.costs, rows), status=Status.INTERRUPTED, asked=query_text(graph, precision, ())
        )
        if first.status.is_final:
            gap = query.gap(sweep, known.costs, precision)
            corridor = query.corridor(sweep, known.costs, precision)
            if not isinstance(corridor, Status):
                del sweep
                return _joined(known, gap, query.front(corridor, precision, search))
            known = replace(known, status=corridor)
        else:
            known = replace(known, status=first.status)
    except KeyboardInterrupt:
        pass
    return replace(known, gap=gap)


def _joined(known: ParetoPaths, gap: float, found: ParetoPaths) -> ParetoPaths:
    """Return the front of the known paths, whose gap is given, and of the paths found in the corridor."""
    both = found.and_those_of(known)
    rows = np.flatnonzero(is_nondominated(both.costs))
    rows = rows[np.lexsort(both.costs[rows].T[::-1])]
    status = Status.COMPLETE if found.status is Status.NO_PATH else found.status
    counts = {
        name: getattr(found.stats, name) + getattr(known.stats, name)
        for name in ("labels_generated", "labels_expanded")
    }
    both = replace(both, status=status, stats=replace(found.stats, **counts), gap=min(gap, found.gap))
    return both.select(both.costs, rows)
