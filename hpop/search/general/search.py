"""Exact search for one to six costs, each a sum or a maximum, on any directed graph.

Accepts: every :class:`~hpop.search.graph.Graph`.

Guarantees: every non-dominated cost vector once, each with one path of this cost.

A label is a partial path with costs g; f = g + h is its estimate, with consistent lower bounds h of the remaining
costs. Labels leave the heap in lexicographic order of f (NAMOA*, Mandow and Perez de la Cruz 2010; for a maximum
f = g = max(g, c, h)). Labels that were closed before at a node have no larger first cost, so the dominance test
compares the other k - 1 costs only (NAMOA*dr, Pulido et al. 2015). It is made when a label is generated and again when
it leaves the heap (the lazy check of BOA*, Hernandez et al. 2023, and of LTMOA*, Hernandez et al. 2023). For k = 1 this
is A*. For k = 2 the set of a node is one number, as in BOA*; for k >= 3 see :mod:`.general.tables`. At one node f
differs from g by a constant, so the sets hold f. The solutions, which are compared with every label, form one more set.

If turns form groups of nodes (:mod:`.machinery.turns`) and do not raise the first cost, a label that leaves the heap is
expanded together with its turns. The labels after the turns enter the sets of their nodes. They need not wait in the
heap, as their first cost is equal, and need not turn again, as no turn costs more than two. On lattices with four to
six costs this leaves a quarter of the labels. Only turns to a target wait in the heap, as solutions must be found in
order.

All open labels are in one heap (:class:`HeapSearch`), as in the search for a mean (:mod:`hpop.search.mean`). It was
measured against the heap of T-MDA (one label per node in the heap, the others at their arcs) and against buckets on the
first cost: see docs/benchmarks.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.search.general.kernel import advance
from hpop.search.general.tables import (
    SET_COLUMNS,
    add_all_to_sets,
    add_to_set,
    build_tables,
    checksum_of_sets,
    trace_paths,
)
from hpop.search.graph import Graph
from hpop.search.machinery import ANYTHING, EXACT, Precision
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.kernels import WORD_BITS, least_covered, plan_keys, repack
from hpop.search.machinery.labels import (
    ONE_LAYER,
    Nodes,
    Unsound,
    check_solutions,
    enter_in_batches,
    is_heap,
    retrace,
)
from hpop.search.machinery.slices import (
    HEAP,
    INT32_LIMIT,
    KEYS,
    N_OPEN,
    N_ROWS,
    ROWS,
    Clock,
    Search,
)
from hpop.search.machinery.turns import CACHED, Groups
from hpop.search.machinery.turns import SIZE as GROUP_SIZE


class HeapSearch(Search):
    """Search with a 4-ary heap of open labels (partial paths), sorted by their estimates (lower bounds of costs).

    keys    (capacity * words,)  estimates, packed into words that sort in lexicographic order
    values  (capacity,)          the labels
    plan    how estimates are packed into keys, of :func:`.plan_keys`
    """

    keys: IntArray
    values: IntArray

    def __init__(self, f: list[int], rise: list[int], fan: int) -> None:
        """Start with one open label (partial path), at the source.

        f     (k,)  estimate of this label
        rise  (k,)  largest growth of an estimate in one expansion
        fan         largest number of new labels that one expansion adds
        """
        super().__init__(len(f), fan)
        self.rise = np.array(rise, np.int64)
        self.plan = plan_keys([2 * (a + b) for a, b in zip(f, rise, strict=True)])
        self.keys = np.zeros(max(1024, 2 * fan) * self.plan[3], np.int64)
        self.values = np.zeros(max(1024, 2 * fan), np.int64)
        for j, value in enumerate(f):
            self.keys[self.plan[0][j]] |= value << int(self.plan[1][j])

    def arrays(self) -> list[np.ndarray[Any, Any]]:
        """Return the arrays of the heap."""
        return [self.keys, self.values]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many bytes more are needed, and a function that doubles the heap or widens its keys.

        ``code`` is the return value of a kernel that ran out of room: HEAP or KEYS.
        """
        if code == HEAP:
            return self.keys.nbytes + self.values.nbytes, self._grow_heap
        if code == KEYS:
            return self.values.nbytes * self._wider_packing()[3], self._widen_keys
        raise AssertionError(f"a kernel returned {code}, which names no array of its search; please report this bug")

    def estimates(self) -> IntArray:
        """Return the estimates (m, k) of all open labels (partial paths), unpacked from the heap's keys."""
        word, shift, limit, words = self.plan
        keys = self.keys[: int(self.counters[N_OPEN]) * words].reshape(-1, words)
        return (keys[:, word] >> shift) & limit

    def open_labels(self) -> tuple[IntArray, IntArray]:
        """Return the open labels (partial paths) in the heap, and an empty array, as this search has no buckets."""
        return self.values[: int(self.counters[N_OPEN])], np.zeros(0, np.int64)

    def reopen(self, heap: IntArray, waiting: IntArray, costs: NDArray[Any], clock: Clock) -> None:
        """Fill the heap with saved labels (h,) and their estimates ``costs`` (h, k); raise Unsound if it is no heap.

        Labels are partial paths; estimates are their costs plus lower bounds of the remaining costs. ``waiting`` must
        be empty: this search has no buckets.
        """
        if len(waiting):
            raise Unsound("saved partial paths are in buckets, which this search does not use")
        n = len(heap)
        while n and (costs.max(axis=0) > self.plan[2]).any():
            self._widen_keys()
        while len(self.values) < n:
            self._grow_heap()
        word, shift, _, words = self.plan
        self.keys[: n * words] = 0
        for j in range(costs.shape[1]):
            self.keys[word[j] : n * words : words] |= costs[:, j].astype(np.int64) << shift[j]
        self.values[:n] = heap
        if not clock.call(is_heap, self.keys, n, words):
            raise Unsound("the saved open partial paths are not in the order of a heap")

    def _grow_heap(self) -> None:
        self.keys.resize(2 * len(self.keys), refcheck=False)
        self.values.resize(2 * len(self.values), refcheck=False)

    def _wider_packing(self) -> tuple[IntArray, IntArray, IntArray, int]:
        return plan_keys([2 * int(limit) for limit in self.plan[2]])

    def _widen_keys(self) -> None:
        new = self._wider_packing()
        keys = np.zeros(len(self.values) * new[3], np.int64)
        repack(self.keys, int(self.counters[N_OPEN]), self.plan, new, keys)
        self.keys, self.plan = keys, new


MAX_KEY = 2**WORD_BITS - 1


class General(HeapSearch):
    """Search of one query on one graph, by the kernel :func:`advance`.

    table   (m + c, 1 + k)  head and costs of each arc of a layer, in the order of the search (:func:`.build_tables`),
                            then of each arc between layers
    nodes   (n, k)          lower bounds of the remaining costs; if there are layers, -1 at nodes that reach no target
    shared                  layers that share the arcs, see :func:`.labels.row_of`
    """

    layered: Graph | None

    def __init__(
        self,
        graph: Graph,
        source: int,
        targets: IntArray,
        h: IntArray,
        order: tuple[int, ...],
        groups: Groups,
        clock: Clock,
        precision: Precision = EXACT,
        at_most: Sequence[int] = (),
    ) -> None:
        self.source, self.order, self.precision = source, order, precision
        reached = h[0] < UNREACHABLE
        k, n = graph.criteria, graph.nodes
        columns = np.array(order, np.int64)
        most = graph.largest[columns]
        farthest = h.max(axis=1, where=reached, initial=0)[columns]
        turn = -1 if groups.dearest[:, order[0]].any() else groups.column
        rise = ((most if turn < 0 else 2 * most) + farthest).tolist()
        f = h[columns, source].tolist()
        small = 4 * (max(f) + max(rise)) < INT32_LIMIT and not any(INT32_LIMIT < b < ANYTHING for b in at_most)
        self.dtype: type[Any] = np.int32 if small else np.int64
        self.is_max = np.array([graph.aggregates[j] == "max" for j in order])
        self.nodes = np.empty((n, k), self.dtype)
        for i, j in enumerate(order):
            self.nodes[:, i] = np.where(h[j] < UNREACHABLE, h[j], 0)
        self.is_target = np.zeros(n, np.uint8)
        self.is_target[targets] = 1
        self._fill_table(graph, columns, reached, turn, groups, clock)
        self.sets = np.zeros((n + 1, SET_COLUMNS), np.int64)
        self.pool = np.zeros(1024, self.dtype)
        turns, plain = self.plain - self.start[:-1], self.start[1:] - self.plain
        most_plain = int(plain.max()) + int(np.diff(self.shared[-1]).max(initial=0))
        super().__init__(f, rise, (1 + int(turns.max())) * most_plain)
        self.most = at_most[order[0]] if at_most else ANYTHING
        for j in range(1, k):  # a bound is represented by a solution that exceeds it by 1 in this cost, 0 in others
            if not at_most or at_most[order[j]] == ANYTHING:
                continue
            beyond = np.zeros(k, self.dtype)
            beyond[j] = at_most[order[j]] + 1
            room = (self.sets, self.pool, n, beyond, int(self.counters[N_ROWS]))
            self.counters[N_ROWS] = clock.call(add_to_set, *room)

    def _fill_table(
        self, graph: Graph, columns: IntArray, reached: BoolArray, turn: int, groups: Groups, clock: Clock
    ) -> None:
        """Fill the table of arcs, with those of one layer if the graph has layers.

        columns  columns of the costs in the order of the search
        reached  (n,)  mask of nodes that reach a target
        turn     column of the cost that turns raise, or -1
        """
        layer, added = graph, None
        is_left_out: BoolArray = ~reached
        is_last: NDArray[np.uint8] = self.is_target
        self.layered, self.shared = None, ONE_LAYER
        if graph.layers > 1:
            self.layered, layer, added = graph, graph.layer, graph.added
            self.nodes[~reached, 0] = -1
            last = graph.layers * layer.nodes
            is_left_out = np.asarray(is_left_out[:last].reshape(graph.layers, -1).all(axis=0))
            is_last = np.asarray(is_last[:last].reshape(graph.layers, -1).max(axis=0))
        key = ("arcs of general", self.order, self.dtype)
        is_for_all = turn < 0 and self.layered is None and not is_left_out.any()  # targets do not matter
        if is_for_all and key in graph.cache:
            self.table, self.origin, self.start, self.plain = graph.cache[key]
            return
        sizes = groups.rows[:, GROUP_SIZE]
        group = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)[groups.new_number[: layer.nodes]]
        self.table = np.empty((layer.arcs + (0 if added is None else len(added.heads)), 1 + len(columns)), self.dtype)
        self.origin = np.empty(layer.arcs, np.int32)
        masks = is_left_out, is_last, turn, group
        arcs = layer.indptr, layer.heads, layer.costs, columns
        self.start, self.plain = clock.call(build_tables, *arcs, *masks, self.table, self.origin)
        if is_for_all and clock.budget.max_memory is None and self.table.nbytes <= CACHED:
            graph.cache[key] = self.table, self.origin, self.start, self.plain
        if self.layered is not None and added is not None:
            m, ends = int(self.start[-1]), graph.nodes - last
            self.table = self.table[: m + len(added.heads)]
            self.table[m:, 0], self.table[m:, 1:] = added.heads, added.costs[:, columns]
            self.start, self.plain = (np.append(offsets, np.full(ends, m)) for offsets in (self.start, self.plain))
            offsets = np.searchsorted(added.places, graph.indptr).astype(np.int32)  # of the added arcs of each node
            self.shared = layer.nodes, m, graph.layers, offsets

    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel for ``work`` elementary steps, and return its code."""
        vectors = tuple(np.zeros(len(self.order), self.dtype) for _ in range(5))
        scratch = (np.zeros(self.plan[3], np.int64), vectors)
        code = clock.call(
            advance,
            self.counters,
            work,
            self.rise,
            self.fan,
            self.start,
            self.plain,
            self.table,
            self.nodes,
            self.is_target,
            self.is_max,
            self.sets,
            self.pool,
            self.source,
            self.plan,
            self.keys,
            self.values,
            self.closed,
            self.front,
            self.solutions,
            float(self.precision.eps),
            self.precision.of(self.order),
            self.most,
            scratch,
            None if self.layered is None else self.shared,
        )
        return int(code)

    def close(self, arcs: BoolArray, groups: BoolArray) -> None:
        """Close the marked arcs (m,) of a graph without layers before a search: they become loops, never used.

        ``groups`` have no effect, as the turns of groups are arcs like all others here.
        """
        assert self.layered is None
        self.table = self.table.copy()  # other searches may use it
        rows = np.flatnonzero(arcs[self.origin[: self.start[-1]]])
        self.table[rows, 0] = np.searchsorted(self.start, rows, side="right") - 1

    def closer_gap(self, front: IntArray, gap: float, estimates: IntArray, least: IntArray, clock: Clock) -> float:
        """Return ``gap``, which is proven already: this search has no tighter bounds than its estimates."""
        return gap

    def retrace(self, values: IntArray, closed: int, at: Nodes, clock: Clock) -> tuple[int, NDArray[Any]]:
        """Find last nodes of a checkpoint's labels, and bounds of whole paths' costs, see :meth:`.Search.retrace`."""
        f = np.zeros((len(values), len(self.order)), self.dtype)
        most = np.full(f.shape[1], INT32_LIMIT if self.dtype is np.int32 else MAX_KEY)
        graph = (self.start, self.table[:, 0], self.table[:, 1:], self.nodes, self.is_target, self.is_max)
        return clock.call(retrace, values, closed, *graph, self.source, self.shared, most, at, f), f

    def widen(self) -> bool:
        """Store costs in 64 bits from now on; return False if they have 64 bits already."""
        narrow = self.dtype is np.int32
        while self.dtype is np.int32:
            self._widen_keys()
        return narrow

    def enter(self, nodes: Nodes, closed: NDArray[Any], ends: Nodes, solved: NDArray[Any], clock: Clock) -> None:
        """Fill the sets of all nodes from closed partial paths, and the set of solutions, see :meth:`.Search.enter`."""
        eps, tolerance = float(self.precision.eps), self.precision.of(self.order)
        reach = np.zeros_like(solved)
        for j in range(solved.shape[1]):
            reach[:, j] = [least_covered(int(cost), eps, int(tolerance[j])) for cost in solved[:, j]]
        check_solutions(self.is_target, nodes, ends, solved[:, :1], self.most)
        self._enter_sets(nodes, closed, closed[:0], clock)
        self._enter_sets(np.full(len(ends), len(self.sets) - 1, np.int32), reach, solved, clock)

    def _enter_sets(self, at: Nodes, vectors: NDArray[Any], tested: NDArray[Any], clock: Clock) -> None:
        def enter(begin: int) -> int:
            new = (at, vectors, tested, begin)
            return int(clock.call(add_all_to_sets, self.sets, self.pool, *new, self.counters, N_ROWS))

        enter_in_batches(len(at), enter, self._grow_pool)

    def weight_of_sets(self, clock: Clock) -> int:
        """Return a checksum of the members of all sets."""
        return int(clock.call(checksum_of_sets, self.sets, self.pool, len(self.order) - 1))

    def arrays(self) -> list[NDArray[Any]]:
        """Return the tables of the graph, the sets and the heap, so that their bytes are counted."""
        tables = [self.table, self.nodes, self.origin, self.start, self.plain, self.is_target, self.shared[-1]]
        return [*tables, self.sets, self.pool, *super().arrays()]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many bytes more are needed, and a function that makes the array larger that was too small.

        ``code`` is the return value of the kernel that ran out of room. ROWS: the pool of the sets is doubled. HEAP:
        the heap is doubled. KEYS: the keys of the heap are widened.
        """
        if code == ROWS:
            return self.pool.nbytes, self._grow_pool
        extra, grow = super().growth(code)
        if code == KEYS and self.dtype is np.int32:  # they may need 64 bits
            extra += 2 * (self.table.nbytes + self.nodes.nbytes + self.pool.nbytes)
        return extra, grow

    def _grow_pool(self) -> None:
        self.pool.resize(2 * len(self.pool), refcheck=False)

    def _widen_keys(self) -> None:
        super()._widen_keys()
        if self.dtype is np.int32 and self.plan[2].max() >= INT32_LIMIT:
            self.dtype = np.int64
            for name in ("table", "nodes", "pool"):
                setattr(self, name, getattr(self, name).astype(np.int64))

    def paths(self, labels: IntArray, clock: Clock) -> list[IntArray]:
        """Return the path of each solution label, as indices of arcs in the graph, from the source on."""
        ends, steps = clock.call(trace_paths, self.closed, labels)
        if self.layered is None:
            steps = self.origin[steps]
        else:
            m, layers = self.shared[1:3]
            within = steps < layers * m
            layer, row = np.divmod(steps[within], max(1, m))
            steps[~within] = self.layered.added.places[steps[~within] - layers * m]
            before_added = layer * self.layered.layer.arcs + self.origin[row]
            steps[within] = before_added + np.searchsorted(self.layered.added.before, before_added, side="right")
        return [part[::-1] for part in np.split(steps, ends)[:-1]]
