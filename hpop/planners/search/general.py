"""Exact search for one to six costs, each a sum or a maximum, on any directed graph.

Accepts: every :class:`~hpop.planners.search.graph.Graph`.

Guarantees: every non-dominated cost vector once, each with one path that has it.

Label setting in lexicographic order of f = g + h with consistent h (NAMOA*, Mandow and Perez de la Cruz 2010;
for a maximum f = max(g, c, h), g the same). What was closed at a node before a label has no larger first
cost, so the test compares the other k - 1 only (NAMOA*dr, Pulido et al. 2015), and is asked when a label is
made and again when it leaves the heap (the lazy check of BOA*, Hernandez et al. 2023, and of LTMOA*,
Hernandez et al. 2023). k = 1 is A*, and for k = 2 the set of a node is one number, as in BOA*. For k >= 3 it
is a block of mutually non-dominated vectors, scanned newest first; one that dominates moves to the end, where
the next scan begins. At one node f differs from g by a constant, so the sets hold f, and the set of the
targets, which is asked about every label, is one more block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.planners.search.approximation import ANYTHING, EXACT, Precision
from hpop.planners.search.bounds import UNREACHABLE
from hpop.planners.search.covered import least_covered
from hpop.planners.search.graph import Graph
from hpop.planners.search.heap_search import HeapSearch
from hpop.planners.search.kernels import drop_first, kernel, push
from hpop.planners.search.slices import (
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
from hpop.planners.search.tables import build, trace

START, SIZE, ROOM = range(3)  # columns of the table of blocks


@kernel
def covering(vectors: NDArray[Any], begin: int, size: int, f: IntArray) -> int:
    """Find a vector of a block that is nowhere larger than f without its first cost; -1 if there is none."""
    rest = len(f) - 1
    for i in range(begin + size - 1, begin - 1, -1):
        covers = True
        for j in range(rest):
            if vectors[i, j] > f[j + 1]:
                covers = False
                break
        if covers:
            return int(i)
    return -1


@kernel
def enter(blocks: IntArray, vectors: NDArray[Any], b: int, f: IntArray, used: int) -> int:
    """Add f without its first cost to block b and drop what it covers; return how many rows are in use."""
    rest = len(f) - 1
    begin = blocks[b, START]
    kept = begin
    for i in range(begin, begin + blocks[b, SIZE]):
        covered = True
        for j in range(rest):
            if vectors[i, j] < f[j + 1]:
                covered = False
                break
        if not covered:
            for j in range(rest):
                vectors[kept, j] = vectors[i, j]
            kept += 1
    size = kept - begin
    if size == blocks[b, ROOM]:
        for i in range(size):
            for j in range(rest):
                vectors[used + i, j] = vectors[begin + i, j]
        begin = used
        blocks[b, START] = begin
        blocks[b, ROOM] = max(2 * size, 1)
        used += blocks[b, ROOM]
    for j in range(rest):
        vectors[begin + size, j] = f[j + 1]
    blocks[b, SIZE] = size + 1
    return used


@kernel
def advance(
    counters: IntArray,
    work: int,
    rise: IntArray,
    fan: int,
    start: IntArray,
    arcs: NDArray[Any],
    nodes: NDArray[Any],
    is_target: NDArray[np.uint8],
    is_max: NDArray[np.bool_],
    blocks: IntArray,
    vectors: NDArray[Any],
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
) -> int:
    """Expand labels until the work is done or an array is full; return why."""
    word, shift, limit, words = plan
    k = len(word)
    key = np.zeros(words, np.int64)
    f = np.zeros(k, np.int64)
    g = np.zeros(k, np.int64)
    reach = np.zeros(k, np.int64)
    size = counters[N_OPEN]
    done = counters[N_CLOSED]
    goal = len(blocks) - 1
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
        if f[0] > bound:  # and so are all that follow
            code = DONE
            break
        at_goal, here = blocks[goal, SIZE], blocks[v, SIZE]
        work -= 1 + here
        if covering(vectors, blocks[goal, START], at_goal, f) >= 0 or covering(vectors, blocks[v, START], here, f) >= 0:
            drop_first(keys, values, size, words)
            size -= 1
            work -= at_goal
            continue
        b = goal if is_target[v] else v
        if size + fan > len(values):
            code = HEAP
            break
        if done == len(closed):
            code = CLOSED
            break
        if counters[N_FRONT] == len(solutions):
            code = FRONT
            break
        if counters[N_ROWS] + max(1, 2 * blocks[b, ROOM]) > len(vectors):
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
            counters[N_ROWS] = enter(blocks, vectors, goal, reach, counters[N_ROWS])
            at = counters[N_FRONT]
            front[at] = f
            solutions[at] = value
            counters[N_FRONT] = at + 1
            continue
        counters[N_ROWS] = enter(blocks, vectors, v, f, counters[N_ROWS])
        closed[done] = value
        done += 1
        for a in range(start[v], start[v + 1]):
            x = np.int64(arcs[a, 0])
            for j in range(k):
                if is_max[j]:
                    f[j] = max(g[j], arcs[a, j + 1], nodes[x, j])
                else:
                    f[j] = g[j] + arcs[a, j + 1] + nodes[x, j]
            begin, here = blocks[x, START], blocks[x, SIZE]
            work -= 1 + here
            i = covering(vectors, begin, here, f)
            if i < 0:
                begin, here = blocks[goal, START], at_goal
                work -= here
                i = covering(vectors, begin, here, f)
            if i >= 0:
                last = begin + here - 1
                for j in range(k - 1):
                    vectors[i, j], vectors[last, j] = vectors[last, j], vectors[i, j]
                continue
            key[:] = 0
            for j in range(k):
                key[word[j]] |= f[j] << shift[j]
            push(keys, values, size, words, key, (done << 32) | (a + 1))
            size += 1
            counters[N_GENERATED] += 1
    counters[N_OPEN] = size
    counters[N_CLOSED] = done
    return code


class General(HeapSearch):
    """The search on one graph for one query, costs taken in the given order."""

    def __init__(
        self,
        graph: Graph,
        source: int,
        targets: IntArray,
        h: IntArray,
        order: tuple[int, ...],
        clock: Clock,
        precision: Precision = EXACT,
        at_most: Sequence[int] = (),
    ) -> None:
        self.source, self.order, self.precision = source, order, precision
        reached = h[0] < UNREACHABLE
        k, n, m = graph.criteria, graph.nodes, graph.arcs
        columns = np.array(order, np.int64)
        most = graph.costs.max(axis=0, initial=0)[columns]
        far = h.max(axis=1, where=reached, initial=0)[columns]
        rise = (most + far).tolist()
        f = h[columns, source].tolist()
        small = 4 * (max(f) + max(rise)) < INT32_LIMIT and not any(INT32_LIMIT < b < ANYTHING for b in at_most)
        self.dtype: type[Any] = np.int32 if small else np.int64
        self.is_max = np.array([graph.aggregates[j] == "max" for j in order])
        self.table = np.empty((m, 1 + k), self.dtype)
        self.nodes = np.empty((n, k), self.dtype)
        self.origin = np.empty(m, np.int32)
        tables = (columns, -1, h, self.table, self.nodes, self.origin)
        self.start, self.split = clock.call(build, graph.indptr, graph.heads, graph.costs, *tables)
        self.is_target = np.zeros(n, np.uint8)
        self.is_target[targets] = 1
        self.blocks = np.zeros((n + 1, 3), np.int64)
        self.vectors = np.zeros((1024, max(1, k - 1)), self.dtype)
        super().__init__(f, rise, int(np.diff(self.start).max()))
        self.most = at_most[order[0]] if at_most else ANYTHING
        for j in range(1, k):  # as if a solution were known that only exceeds the bound
            if not at_most or at_most[order[j]] == ANYTHING:
                continue
            beyond = np.zeros(k, np.int64)
            beyond[j] = at_most[order[j]] + 1
            room = (self.blocks, self.vectors, n, beyond, int(self.counters[N_ROWS]))
            self.counters[N_ROWS] = clock.call(enter, *room)

    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel."""
        code = clock.call(
            advance,
            self.counters,
            work,
            self.rise,
            self.fan,
            self.start,
            self.table,
            self.nodes,
            self.is_target,
            self.is_max,
            self.blocks,
            self.vectors,
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
        )
        return int(code)

    def arrays(self) -> list[NDArray[Any]]:
        """List the tables of the graph, the sets and the heap."""
        tables = [self.table, self.nodes, self.origin, self.start, self.split, self.is_target]
        return [*tables, self.blocks, self.vectors, *super().arrays()]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Double the rows of the sets."""
        return (self.vectors.nbytes, self._grow_rows) if code == ROWS else super().growth(code)

    def _grow_rows(self) -> None:
        self.vectors.resize((2 * len(self.vectors), self.vectors.shape[1]), refcheck=False)

    def _widen_keys(self) -> None:
        super()._widen_keys()
        if self.dtype is np.int32 and self.plan[2].max() >= INT32_LIMIT:
            self.dtype = np.int64
            for name in ("table", "nodes", "vectors"):
                setattr(self, name, getattr(self, name).astype(np.int64))

    def paths(self, labels: IntArray, clock: Clock) -> list[IntArray]:
        """Places of the arcs of solutions in the graph, from the source on."""
        arrays = (self.start, self.split, self.table, self.origin, self.closed)
        return [clock.call(trace, *arrays, self.source, int(label)) for label in labels]
