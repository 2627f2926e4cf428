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

One heap with all open labels was measured against that of T-MDA (one label per node in the heap, the others at their
arcs) and against buckets on the first cost: see docs/benchmarks.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.general.tables import (
    SET_COLUMNS,
    SIZE,
    add_all_to_sets,
    add_to_set,
    build_tables,
    checksum_of_sets,
    is_covered,
    numbers_needed,
    trace_paths,
)
from hpop.search.graph import Graph
from hpop.search.machinery.approximation import ANYTHING, EXACT, Precision
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.heap_search import HeapSearch
from hpop.search.machinery.kernels import WORD_BITS, drop_first, least_covered, push
from hpop.search.machinery.labels import Nodes, check_solutions, enter_in_batches, retrace
from hpop.search.machinery.slices import (
    CLOSED,
    DONE,
    FRONT,
    HEAP,
    INT32_LIMIT,
    KEYS,
    N_CLOSED,
    N_EXPANDED,
    N_FRONT,
    N_GENERATED,
    N_OPEN,
    N_ROWS,
    ROWS,
    SLICE,
    Clock,
)
from hpop.search.machinery.turns import SIZE as GROUP_SIZE
from hpop.search.machinery.turns import Groups

MAX_KEY = 2**WORD_BITS - 1
WORD, SORTED = 8, 256  # numbers of members that count as one elementary step, in a plain and in a sorted set


@lean
def extend_label(
    g: NDArray[Any],
    arcs: NDArray[Any],
    a: int,
    nodes: NDArray[Any],
    x: int,
    is_max: NDArray[np.bool_],
    after: NDArray[Any],
    f: NDArray[Any],
) -> None:
    """Extend a label (partial path) with costs g (k,) by arc a to node x; write new costs to `after`, estimate to f.

    arcs, nodes  tables of :func:`.general.tables.build_tables`
    is_max       (k,)  True for a cost that is a maximum
    after, f     (k,)  output: costs, and costs with the lower bounds of the remaining costs
    """
    for j in range(len(g)):
        if is_max[j]:
            after[j] = max(g[j], arcs[a, j + 1], nodes[x, j])
            f[j] = after[j]
        else:
            after[j] = g[j] + arcs[a, j + 1]
            f[j] = after[j] + nodes[x, j]


@lean
def advance(
    counters: IntArray,
    work: int,
    rise: IntArray,
    fan: int,
    start: IntArray,
    plain: IntArray,
    arcs: NDArray[Any],
    nodes: NDArray[Any],
    is_target: NDArray[np.uint8],
    is_max: NDArray[np.bool_],
    sets: IntArray,
    pool: NDArray[Any],
    source: int,
    plan: tuple[IntArray, IntArray, IntArray, int],
    keys: IntArray,
    values: IntArray,
    closed: IntArray,
    front: IntArray,
    solutions: IntArray,
    eps: float,
    tolerance: IntArray,
    bound: int,
    scratch: tuple[IntArray, tuple[NDArray[Any], ...]],
) -> int:
    """Run the search for a slice of `work` steps: take labels (partial paths) from the heap, and extend them.

    It ends early if the heap is empty, if all its labels exceed `bound`, or if an array is full. Returns the code of
    the reason (:mod:`.machinery.slices`).
    All arrays belong to :class:`General`, and are changed in place.

    start, plain, arcs, nodes           tables of :func:`.general.tables.build_tables`
    is_target, is_max, source           mask of nodes; mask of costs that are maxima; node at which paths begin
    sets, pool                          sets of vectors (:mod:`.general.tables`), the last for the front
    rise, fan, plan, keys, values       heap, see :class:`.HeapSearch`
    counters, closed, front, solutions  labels and front, see :class:`.Search`
    eps, tolerance, bound               precision of the front, and upper bound of the first cost
    scratch                             a key and five vectors (k,)
    """
    word, shift, limit, words = plan
    key, (f, g, turned, moved, reach) = scratch
    k = len(word)
    per_step = SORTED if k == 3 else WORD
    size = counters[N_OPEN]
    done = counters[N_CLOSED]
    goal = len(sets) - 1
    code = SLICE
    while work > 0:
        if size == 0:
            code = DONE
            break
        value = values[0]
        arc = (value & 0xFFFFFFFF) - 1
        v = np.int64(arcs[arc, 0]) if arc >= 0 else source
        tight = False
        for j in range(k):
            f[j] = (keys[word[j]] >> shift[j]) & limit[j]
            g[j] = f[j] if is_max[j] else f[j] - nodes[v, j]
            tight |= g[j] + rise[j] > limit[j]
        if f[0] > bound:  # as are all later labels
            code = DONE
            break
        at_goal = sets[goal, SIZE]
        work -= 1 + (at_goal + sets[v, SIZE]) // per_step
        if is_covered(sets, pool, goal, f) or is_covered(sets, pool, v, f):
            drop_first(keys, values, size, words)
            size -= 1
            continue
        if size + fan > len(values):
            code = HEAP
            break
        if done + plain[v] - start[v] >= len(closed):
            code = CLOSED
            break
        if counters[N_FRONT] == len(solutions):
            code = FRONT
            break
        room = numbers_needed(sets, goal if is_target[v] else v, k)
        for a in range(start[v], plain[v]):
            room += numbers_needed(sets, np.int64(arcs[a, 0]), k)
        if counters[N_ROWS] + room > len(pool):
            code = ROWS
            break
        if tight:
            code = KEYS
            break
        drop_first(keys, values, size, words)
        size -= 1
        counters[N_EXPANDED] += 1
        if is_target[v]:
            for j in range(k):
                reach[j] = least_covered(f[j], eps, tolerance[j])
            counters[N_ROWS] = add_to_set(sets, pool, goal, reach, counters[N_ROWS])
            at = counters[N_FRONT]
            for j in range(k):
                front[at, j] = f[j]
            solutions[at] = value
            counters[N_FRONT] = at + 1
            continue
        counters[N_ROWS] = add_to_set(sets, pool, v, f, counters[N_ROWS])
        closed[done] = value
        done += 1
        parent = done
        for b in range(start[v] - 1, plain[v]):  # the label itself, and after each turn
            u, now = v, g
            if b >= start[v]:
                u, now = np.int64(arcs[b, 0]), turned
                extend_label(g, arcs, b, nodes, u, is_max, turned, f)
                work -= 1 + (at_goal + sets[u, SIZE]) // per_step
                if is_covered(sets, pool, u, f) or is_covered(sets, pool, goal, f):
                    continue
                counters[N_ROWS] = add_to_set(sets, pool, u, f, counters[N_ROWS])
                closed[done] = (parent << 32) | (b + 1)
                done += 1
            for a in range(plain[u], start[u + 1]):
                x = np.int64(arcs[a, 0])
                extend_label(now, arcs, a, nodes, x, is_max, moved, f)
                work -= 1 + sets[x, SIZE] // per_step
                if is_covered(sets, pool, x, f):
                    continue
                work -= at_goal // per_step
                if is_covered(sets, pool, goal, f):
                    continue
                for w in range(words):
                    key[w] = 0
                for j in range(k):
                    key[word[j]] |= np.int64(f[j]) << shift[j]
                push(keys, values, size, words, key, (done << 32) | (a + 1))
                size += 1
                counters[N_GENERATED] += 1
    counters[N_OPEN] = size
    counters[N_CLOSED] = done
    return code


class General(HeapSearch):
    """Search of one query on one graph, by the kernel :func:`advance`.

    Its tables are those of :func:`.general.tables.build_tables`, with costs in the order of the search.
    """

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
        k, n, m = graph.criteria, graph.nodes, graph.arcs
        columns = np.array(order, np.int64)
        most = graph.largest[columns]
        farthest = h.max(axis=1, where=reached, initial=0)[columns]
        turn = -1 if groups.dearest[:, order[0]].any() else groups.column
        rise = ((most if turn < 0 else 2 * most) + farthest).tolist()
        f = h[columns, source].tolist()
        small = 4 * (max(f) + max(rise)) < INT32_LIMIT and not any(INT32_LIMIT < b < ANYTHING for b in at_most)
        self.dtype: type[Any] = np.int32 if small else np.int64
        self.is_max = np.array([graph.aggregates[j] == "max" for j in order])
        self.table = np.empty((m, 1 + k), self.dtype)
        self.nodes = np.empty((n, k), self.dtype)
        self.origin = np.empty(m, np.int32)
        self.is_target = np.zeros(n, np.uint8)
        self.is_target[targets] = 1
        sizes = groups.rows[:, GROUP_SIZE]
        group = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)[groups.new_number]
        tables = (columns, h, self.is_target, turn, group, self.table, self.nodes, self.origin)
        self.start, self.plain = clock.call(build_tables, graph.indptr, graph.heads, graph.costs, *tables)
        self.sets = np.zeros((n + 1, SET_COLUMNS), np.int64)
        self.pool = np.zeros(1024, self.dtype)
        turns, plain = self.plain - self.start[:-1], self.start[1:] - self.plain
        super().__init__(f, rise, (1 + int(turns.max())) * int(plain.max()))
        self.most = at_most[order[0]] if at_most else ANYTHING
        for j in range(1, k):  # a bound is represented by a solution that exceeds it by 1 in this cost, 0 in others
            if not at_most or at_most[order[j]] == ANYTHING:
                continue
            beyond = np.zeros(k, self.dtype)
            beyond[j] = at_most[order[j]] + 1
            room = (self.sets, self.pool, n, beyond, int(self.counters[N_ROWS]))
            self.counters[N_ROWS] = clock.call(add_to_set, *room)

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
        )
        return int(code)

    def close(self, arcs: BoolArray) -> None:
        """Close the marked arcs (m,) of the graph before a search: they become loops, which no path uses."""
        rows = np.flatnonzero(arcs[self.origin[: self.start[-1]]])
        self.table[rows, 0] = np.searchsorted(self.start, rows, side="right") - 1

    def retrace(self, values: IntArray, closed: int, at: Nodes, clock: Clock) -> tuple[int, NDArray[Any]]:
        """Compute the last nodes and the estimates of saved labels (partial paths), see :meth:`.Search.retrace`."""
        f = np.zeros((len(values), len(self.order)), self.dtype)
        most = np.full(f.shape[1], INT32_LIMIT if self.dtype is np.int32 else MAX_KEY)
        graph = (self.start, self.table[:, 0], self.table[:, 1:], self.nodes, self.is_target, self.is_max)
        return clock.call(retrace, values, closed, *graph, self.source, most, at, f), f

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
        tables = [self.table, self.nodes, self.origin, self.start, self.plain, self.is_target]
        return [*tables, self.sets, self.pool, *super().arrays()]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many bytes more are needed, and a function that doubles the pool of the sets or grows the heap.

        ``code`` is the return value of a kernel that ran out of room: ROWS, HEAP or KEYS.
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
        ends, steps = clock.call(trace_paths, self.origin, self.closed, labels)
        return [part[::-1] for part in np.split(steps, ends)[:-1]]
