"""The search on a time-dependent graph for one query: its arrays, and the loop that calls the kernel in slices.

A label is a partial path with its tick of arrival. A lane is one weight vector of the joint bounds (:mod:`.joint`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.limits import Status
from hpop.search.machinery import ANYTHING, Precision
from hpop.search.machinery.slices import (
    CLOSED,
    COUNTERS,
    DONE,
    FRONT,
    HEAP,
    N_CLOSED,
    N_EXPANDED,
    N_FRONT,
    N_GENERATED,
    N_OPEN,
    ROWS,
    SLICE,
    Clock,
)
from hpop.search.timed.bounds import Seed, TimedJointBounds
from hpop.search.timed.calm import RemainingBounds
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.joint import LANES, JointTables
from hpop.search.timed.kernel import (
    FIRST,
    FREE,
    LEAVE,
    NEXT,
    NOW,
    SOLVED,
    STAGE,
    STATE,
    USED,
    WAITING,
    ClosedLabels,
    PruningBounds,
    Queue,
    advance,
    under_way,
)
from hpop.search.timed.sets import ROW_COLUMNS, SEEN, SET_COLUMNS, SIZE, LabelSets, waiting
from hpop.search.timed.solutions import (
    MOST_CORNERS,
    SolutionSet,
    cut_corners,
    insert_solution,
    is_covered,
    weighed_corners,
)
from hpop.search.timed.tables import NEVER, TimedTables

FOLLOWED = 32  # number of labels that are completed by best paths after each slice
BLOCK = 1 << 16  # number of labels whose estimates are computed at once
Labels = tuple[IntArray, IntArray, IntArray]  # values, ticks of arrival, costs


class TimedSearch:
    """Search of one query on a time-dependent graph: arrays of the kernel, and the loop over slices of work."""

    def __init__(
        self,
        graph: TimedGraph,
        tables: TimedTables,
        rest: RemainingBounds,
        source: int,
        targets: IntArray,
        precision: Precision,
        at_most: Sequence[int],
        bounds: TimedJointBounds,
        joint: JointTables,
        seeds: Sequence[Seed],
        before: tuple[int, int] = (0, 0),
        begin: int = 0,
    ) -> None:
        """Set up the arrays for paths that leave the source at tick ``begin``.

        rest, joint  lower bounds of the remaining costs, and joint bounds
        precision    error that the front may have
        at_most      (k,)  upper bounds on the costs, or ()
        bounds       object that computed the joint bounds; it also traces best paths
        seeds        solutions known before the search
        before       numbers of labels generated and expanded by earlier searches of this query
        """
        self.bounds, self.joint = bounds, joint
        self.lane = 0  # of the next best path that is followed
        self.graph, self.tables, self.rest, self.source = graph, tables, rest, source
        n, k = graph.graph.nodes, graph.graph.criteria
        self.eps, self.tolerance = float(precision.eps), precision.of(range(k))
        self.most = np.array(at_most or [ANYTHING] * k, np.int64)
        self.arrive_by = NEVER if graph.arrive_by is None else graph.arrive_by
        self.is_target = np.zeros(n, np.uint8)
        self.is_target[targets] = 1
        self.counters, self.state = np.zeros(COUNTERS, np.int64), np.zeros(STATE, np.int64)
        self.front, self.reach = np.zeros((64, k), np.int64), np.zeros((64, k), np.int64)
        self.solutions, self.leaves = np.zeros(64, np.int64), np.zeros(64, np.int64)
        ring = 1 << int(graph.durations.max(initial=1)).bit_length()
        self.tops = np.full(ring, -1, np.int32)
        self.below, self.values, self.costs = np.zeros(1024, np.int32), np.zeros(1024, np.int64), _zeros(1024, k)
        self.closed, self.ticks = np.zeros(1024, np.int64), np.zeros(1024, np.int32)
        self.fresh, self.kept = _zeros(1024, k), np.zeros(1024, np.uint8)
        self.nodes, self.waits = np.zeros(n, np.int32), np.zeros(n, np.uint8)
        self.heads = np.zeros((n, SET_COLUMNS), np.int64)
        self.heads[:, SEEN] = -1
        self.vectors, self.rows = _zeros(1024, k), _zeros(1024, ROW_COLUMNS)
        self.scratch = np.zeros((4, k), np.int64)
        self.state[FREE] = -1
        self.corners = np.minimum(self.most, ANYTHING)[None]
        self.lanes = weighed_corners(self.corners, joint.weights)
        self.corners_size = 0
        self.hint, self.weighed = np.zeros(1, np.int64), np.zeros(joint.weights.shape[:2], np.int32)
        self.cut: set[tuple[int, ...]] = set()
        self.seeds: list[Seed] = []
        for seed in seeds:
            self.add_solution(seed)
        self.tops[begin & (ring - 1)], self.state[NOW] = 0, begin
        self.below[0], self.state[USED], self.counters[N_OPEN] = -1, 1, 1
        self.counters[[N_GENERATED, N_EXPANDED]] = before

    def add_solution(self, seed: Seed) -> None:
        """Add a known solution, unless another solution covers it."""
        if self.counters[N_FRONT] == len(self.solutions):
            self._growth_of(FRONT)[1]()
        goal = self._goal()
        if not is_covered(goal, int(self.counters[N_FRONT]), seed.costs):
            self.seeds.append(seed)
            insert_solution(goal, self.counters, seed.costs, -len(self.seeds), 0)
            self.state[SOLVED] += 1

    def _add_best_completions(self, clock: Clock) -> None:
        """Complete some labels (partial paths) of this tick by best paths to a target, to find solutions early.

        The labels were not pruned, so many of these paths are solutions that no other solution covers.
        """
        tables, first = len(self.bounds.sweeps), int(self.state[FIRST])
        fresh = np.flatnonzero(self.kept[: int(self.counters[N_CLOSED]) - first])
        fresh = fresh[np.linspace(0, len(fresh) - 1, min(FOLLOWED, len(fresh))).astype(np.int64)]
        if not tables or not len(fresh):
            return
        turns = (self.lane + 1 + np.arange(len(fresh))) % (tables * LANES)
        self.lane = int(turns[-1])
        values = self.closed[first + fresh]
        arcs = (values & 0xFFFFFFFF) - 1
        nodes = np.where(arcs >= 0, self.graph.graph.heads[arcs], self.source)
        for table in range(tables):
            of = np.flatnonzero(turns // LANES == table)
            starts = turns[of] % LANES, nodes[of], int(self.state[NOW]), self.fresh[fresh[of]]
            for i, end in zip(of, self.bounds.best_completions(table, *starts, clock), strict=True):
                if end is not None and not is_covered(self._goal(), int(self.counters[N_FRONT]), end.costs):
                    path, leaves = self._arcs(int(values[i]), int(self.state[NOW]) - int(self.graph.durations[arcs[i]]))
                    path, leaves = np.concatenate([path, end.arcs]), np.concatenate([leaves, end.leaves])
                    self.add_solution(Seed(end.costs, path, leaves))

    def _update_corners(self) -> None:
        """Update the corners of the region that solutions leave uncovered, after new solutions."""
        self.corners_size = int(self.state[SOLVED])
        reach = self.reach[: int(self.counters[N_FRONT])]
        for row in reach[np.argsort(reach.sum(axis=1))]:
            if tuple(row) not in self.cut and len(self.corners) < MOST_CORNERS:
                self.cut.add(tuple(row))
                self.corners = cut_corners(self.corners, row)
        self.lanes = weighed_corners(self.corners, self.joint.weights)

    def _goal(self) -> SolutionSet:
        return SolutionSet(
            self.front, self.reach, self.solutions, self.leaves, self.most, self.arrive_by, self.is_target,
            self.eps, self.tolerance,
        )  # fmt: skip

    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel for at most ``work`` elementary steps; return the reason why it ended, as a code.

        It also ends when the search is complete or an array is full. The codes are those of :mod:`.machinery.slices`.
        """
        if self.corners_size < self.state[SOLVED]:
            self._update_corners()
        goal, bounds = self._goal(), PruningBounds(self.joint, self.corners, self.lanes, self.hint, self.weighed)
        queue = Queue(self.tops, self.below, self.values, self.costs)
        labels = ClosedLabels(self.closed, self.ticks, self.fresh, self.kept, self.nodes, self.waits)
        sets = LabelSets(self.heads, self.vectors, self.rows)
        arguments = (self.tables, self.rest, goal, bounds, queue, labels, sets, self.source, self.scratch)
        return int(clock.call(advance, self.counters, self.state, work, *arguments))

    def run(self, clock: Clock, keep: Callable[[], None], enough: int | None = None) -> Status | None:
        """Run slices until the search is complete, a limit is passed, or ``enough`` partial paths are generated.

        Returns the status, None in the last case. ``keep`` is called between slices, to save a checkpoint.
        """
        status = clock.exceeded(0, self.memory())
        while status is None:
            generated = int(self.counters[N_GENERATED])
            if enough is not None and generated >= enough:
                return None
            limits = [limit - generated for limit in (clock.budget.max_labels, enough) if limit is not None]
            code = self.advance(clock, max(1, min([clock.work, *limits])))
            if code == DONE:
                return Status.COMPLETE if self.counters[N_FRONT] else Status.NO_PATH
            clock.report("search", self.counters, self.memory())
            if code != SLICE:
                extra, grow = self._growth_of(code)
                status = clock.exceeded(0, self.memory() + extra, record=False)
                if status is Status.MEMORY_LIMIT:
                    break
                grow()
            self._add_best_completions(clock)
            keep()
            status = clock.exceeded(int(self.counters[N_GENERATED]), self.memory())
        return status

    def arrays(self) -> list[NDArray[Any]]:
        """Return all arrays of the search and of its bounds, without those of the graph."""
        own: list[NDArray[Any]] = [self.below, self.values, self.costs, self.closed, self.ticks, self.fresh, self.kept]
        own += [
            self.vectors,
            self.rows,
            self.heads,
            self.nodes,
            self.waits,
            self.corners,
            self.lanes,
            self.front,
            self.reach,
            self.solutions,
            self.leaves,
        ]
        rest: list[NDArray[Any]] = [self.rest.least, self.rest.gain, self.rest.calm, self.rest.until]
        joint = [self.joint.rows] if len(self.joint.rows) > 1 else []  # a single table belongs to its sweep
        return [*own, *rest, *self.tables.own_arrays, *joint, *self.bounds.arrays]

    def memory(self) -> int:
        """Return the size of all arrays in bytes, each counted once."""
        return sum({id(array): array.nbytes for array in self.arrays()}.values())

    def _growth_of(self, code: int) -> tuple[int, Callable[[], None]]:
        names: tuple[str, ...] = {
            CLOSED: ("closed", "ticks", "fresh", "kept"),
            FRONT: ("front", "reach", "solutions", "leaves"),
            HEAP: ("below", "values", "costs"),
            ROWS: ("vectors", "rows"),
        }[code]

        def grow() -> None:
            for name in names:
                array = getattr(self, name)
                array.resize((2 * len(array), *array.shape[1:]), refcheck=False)

        return sum(getattr(self, name).nbytes for name in names), grow

    def counts(self) -> dict[str, int]:
        """Return the numbers of labels generated, expanded and open, by their names in :class:`.SearchStats`."""
        names = {"labels_generated": N_GENERATED, "labels_expanded": N_EXPANDED, "labels_open": N_OPEN}
        return {name: int(self.counters[column]) for name, column in names.items()}

    @property
    def label_counts(self) -> tuple[int, int]:
        """Numbers of labels (partial paths) generated and expanded."""
        return int(self.counters[N_GENERATED]), int(self.counters[N_EXPANDED])

    def solutions_found(self) -> list[Seed]:
        """Return the solutions so far, for another search to begin with."""
        costs, paths = self.costs_and_paths()
        return [Seed(row.copy(), *path) for row, path in zip(costs, paths, strict=True)]

    def costs_and_paths(self) -> tuple[IntArray, list[tuple[IntArray, IntArray]]]:
        """Return the solutions so far: costs (s, k) in lexicographic order, and arcs and departures of each path."""
        count = int(self.counters[N_FRONT])
        order = np.lexsort(self.front[:count].T[::-1])
        return self.front[:count][order], [self._path(i) for i in order.tolist()]

    def _path(self, i: int) -> tuple[IntArray, IntArray]:
        value, leaves = int(self.solutions[i]), int(self.leaves[i])
        if value < 0:
            seed = self.seeds[-1 - value]
            return seed.arcs, seed.leaves
        return self._arcs(value, leaves)

    def _arcs(self, value: int, leaves: int) -> tuple[IntArray, IntArray]:
        """Return the arcs of a label (partial path) and the ticks of their departures.

        value   the label, of which the parents are closed labels
        leaves  tick of departure by its last arc
        """
        arcs, departures = [], []
        while value > 0:
            arc = (value & 0xFFFFFFFF) - 1
            arcs.append(arc)
            departures.append(leaves)
            label = (value >> 32) - 1
            value = int(self.closed[label])
            leaves = int(self.ticks[label]) - int(self.graph.durations[(value & 0xFFFFFFFF) - 1])
        return np.array(arcs[::-1], np.int64), np.array(departures[::-1], np.int64)

    def estimates(self) -> Iterator[IntArray]:
        """Yield lower bounds (m, k) of the costs of further solutions, one row for each open label (partial path).

        They come in blocks, as one block for all would take more memory than the labels.

        Open labels are on their way along an arc, have just arrived, or wait at a node.
        """
        for values, ticks, g in chain(self._labels_under_way(), self._arrived_labels(), self._waiting_labels()):
            yield self._least_total_costs(values, ticks, g)

    def _least_total_costs(self, values: IntArray, ticks: IntArray, g: IntArray) -> IntArray:
        """Return lower bounds (m, k) of the costs of solutions that continue labels (partial paths).

        values  (m,)    the labels
        ticks   (m,)    their ticks of arrival
        g       (m, k)  their costs
        """
        arcs = (values & 0xFFFFFFFF) - 1
        nodes = np.full(len(arcs), self.source)
        nodes[arcs >= 0] = self.graph.graph.heads[arcs[arcs >= 0]]
        h = self.rest.least[:, nodes]
        joint = self.joint
        rows = np.where(ticks > joint.calm[nodes], nodes, joint.offset[nodes] + ticks)
        for j in np.flatnonzero(joint.alone >= 0):
            h[j] = np.maximum(h[j], joint.rows[0, rows, joint.alone[j]].astype(np.int64) << joint.shift[j])
        return np.where(self.tables.is_max, np.maximum(g, h.T), g + h.T)

    def _labels_under_way(self) -> Iterator[Labels]:
        position = np.full(2, -1, np.int64)
        while True:
            rows, ticks = np.empty(BLOCK, np.int32), np.empty(BLOCK, np.int64)
            count = under_way(self.tops, self.below, int(self.state[NOW]), position, rows, ticks)
            yield self.values[rows[:count]], ticks[:count], self.costs[rows[:count]]
            if count < BLOCK:
                return

    def _arrived_labels(self) -> Iterator[Labels]:
        first, done = int(self.state[FIRST]), int(self.counters[N_CLOSED])
        begin = int(self.state[NEXT]) if self.state[STAGE] == LEAVE else 0
        end = done - first if self.state[STAGE] <= LEAVE else begin
        for at in range(begin, end, BLOCK):
            rows = at + np.flatnonzero(self.kept[at : min(at + BLOCK, end)])
            yield self.closed[first + rows], np.full(len(rows), self.state[NOW]), self.fresh[rows]

    def _waiting_labels(self) -> Iterator[Labels]:
        """Yield labels (partial paths) that wait at nodes, with the lower bounds of costs of :func:`.sets.waiting`."""
        nodes = self.nodes[: int(self.state[WAITING])]
        sizes = self.heads[nodes, SIZE]
        block = np.cumsum(sizes) // BLOCK
        for some in np.split(np.arange(len(nodes)), np.flatnonzero(np.diff(block)) + 1):
            count = int(sizes[some].sum())
            owners, costs = np.empty(count, np.int64), _zeros(count, len(self.most))
            waiting(self.tables, LabelSets(self.heads, self.vectors, self.rows), nodes[some], owners, costs)
            yield self.closed[owners], self.ticks[owners].astype(np.int64), costs


def _zeros(count: int, k: int) -> IntArray:
    return np.zeros((count, k), np.int64)
