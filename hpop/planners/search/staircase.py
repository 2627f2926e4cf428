"""Exact search where one cost is a small integer (turns): a staircase a node makes dominance one look-up.

Accepts: two or three costs, one of them (the index, a sum) small along good paths; the others sum or max.

Guarantees: every non-dominated cost vector once, each with one path that has it.

Labels leave the heap in lexicographic order of f = g + h (for a maximum f = g, with h taken into g), so the
first cost of whatever was closed at a node is never larger and drops out of the dominance test (Pulido,
Mandow, Perez de la Cruz, "Dimensionality reduction in multiobjective shortest path search", 2015). Of the two
costs (n, d) left, n is a small integer. So keep, at each node, best[n] = the least d closed with at most n:
a label is dominated iff best[n] <= d. The same staircase over f at the targets prunes what cannot be a
solution. Both are asked at generation and again at expansion ("lazy", as in BOA*, Hernandez et al. 2023).

Where the arcs that raise the index make groups of nodes (turns in place, see :mod:`.turns`), labels are made
only where other arcs arrive, and one staircase a group tells what any of its nodes could turn into.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.planners.search.bounds import UNREACHABLE
from hpop.planners.search.graph import Graph
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
    WIDTH,
    Clock,
    Search,
)
from hpop.planners.search.tables import build, trace
from hpop.planners.search.turns import find_groups, most_successors

# Columns of the table of nodes: lower bounds, row of best and group (-1: none), dearest turn of the group.
H_FIRST, H_INDEX, H_REST, ROW, GROUP, DEAREST, NODE_COLUMNS = range(7)
HEAD, FIRST, INDEX, REST, ARC_COLUMNS = range(5)


@kernel
def advance(
    counters: IntArray,
    work: int,
    rise: IntArray,
    fan: int,
    start: IntArray,
    split: IntArray,
    arcs: NDArray[Any],
    nodes: NDArray[Any],
    is_target: NDArray[np.uint8],
    best: NDArray[Any],
    group_best: NDArray[Any],
    goal: NDArray[Any],
    turn: int,
    is_max: tuple[bool, bool],
    source: int,
    plan: tuple[IntArray, IntArray, IntArray, int],
    keys: IntArray,
    values: IntArray,
    closed: IntArray,
    front: IntArray,
    solutions: IntArray,
) -> int:
    """Expand labels until the work is done or an array is full; return why."""
    max_first, max_rest = is_max
    word, shift, limit, words = plan
    w0, w1, w2 = word
    s0, s1, s2 = shift
    m0, m1, m2 = limit
    key = np.zeros(words, np.int64)
    size = counters[N_OPEN]
    done = counters[N_CLOSED]
    width = best.shape[1]
    last = width - 1
    code = SLICE
    while work > 0:
        if size == 0:
            code = DONE
            break
        f0 = (keys[w0] >> s0) & m0
        f1 = (keys[w1] >> s1) & m1
        f2 = (keys[w2] >> s2) & m2
        value = values[0]
        arc = (value & 0xFFFFFFFF) - 1
        v = np.int64(arcs[arc, HEAD]) if arc >= 0 else source
        g0 = f0 if max_first else f0 - nodes[v, H_FIRST]
        n = f1 - nodes[v, H_INDEX]
        d = f2 if max_rest else f2 - nodes[v, H_REST]
        if n >= width:
            code = WIDTH
            break
        row = np.int64(nodes[v, ROW])
        group = np.int64(nodes[v, GROUP])
        dominated = goal[min(f1, last)] <= f2 or (row >= 0 and best[row, n] <= d)
        if not dominated and group >= 0 and n >= turn and not is_target[v]:
            e = np.int64(group_best[group, n - turn])
            dearest = np.int64(nodes[v, DEAREST])
            dominated = (max(e, dearest) if max_rest else e + dearest) <= d
        if dominated:
            drop_first(keys, values, size, words)
            size -= 1
            work -= 1
            continue
        if size + fan > len(values):
            code = HEAP
            break
        if done == len(closed):
            code = CLOSED
            break
        if counters[N_FRONT] == len(solutions):
            code = FRONT
            break
        if row < 0 and counters[N_ROWS] == len(best):
            code = ROWS
            break
        if g0 + rise[0] > m0 or n + rise[1] > m1 or d + rise[2] > m2:
            code = KEYS
            break
        drop_first(keys, values, size, words)
        size -= 1
        counters[N_EXPANDED] += 1
        if is_target[v]:
            for i in range(n, width):
                if goal[i] <= d:
                    break
                goal[i] = d
            at = counters[N_FRONT]
            front[at, 0] = f0
            front[at, 1] = f1
            front[at, 2] = f2
            solutions[at] = value
            counters[N_FRONT] = at + 1
            continue
        if row < 0:
            row = counters[N_ROWS]
            counters[N_ROWS] = row + 1
            nodes[v, ROW] = row
        for i in range(n, width):
            if best[row, i] <= d:
                break
            best[row, i] = d
        if group >= 0:
            for i in range(n, width):
                if group_best[group, i] <= d:
                    break
                group_best[group, i] = d
        closed[done] = value
        done += 1
        for t in range(split[v] - 1, start[v + 1]):  # first without a turn, then each turn
            u, u0, un, ud = v, g0, n, d
            if t >= split[v]:
                u = np.int64(arcs[t, HEAD])
                u0 = max(g0, arcs[t, FIRST], nodes[u, H_FIRST]) if max_first else g0 + arcs[t, FIRST]
                un = n + arcs[t, INDEX]
                ud = max(d, arcs[t, REST], nodes[u, H_REST]) if max_rest else d + arcs[t, REST]
                row = np.int64(nodes[u, ROW])
                f1 = un + nodes[u, H_INDEX]
                f2 = ud if max_rest else ud + nodes[u, H_REST]
                work -= 1
                if goal[min(f1, last)] <= f2 or (row >= 0 and best[row, min(un, last)] <= ud):
                    continue
                if is_target[u]:
                    key[:] = 0
                    key[w0] |= (u0 if max_first else u0 + nodes[u, H_FIRST]) << s0
                    key[w1] |= f1 << s1
                    key[w2] |= f2 << s2
                    push(keys, values, size, words, key, (done << 32) | (t + 1))
                    size += 1
                    counters[N_GENERATED] += 1
                    continue
            for a in range(start[u], split[u]):
                work -= 1
                x = np.int64(arcs[a, HEAD])
                xn = un + arcs[a, INDEX]
                f1 = xn + nodes[x, H_INDEX]
                xd = max(ud, arcs[a, REST], nodes[x, H_REST]) if max_rest else ud + arcs[a, REST]
                f2 = xd if max_rest else xd + nodes[x, H_REST]
                if goal[min(f1, last)] <= f2:
                    continue
                row = np.int64(nodes[x, ROW])
                if row >= 0 and best[row, min(xn, last)] <= xd:
                    continue
                group = np.int64(nodes[x, GROUP])
                if group >= 0 and xn >= turn:
                    e = np.int64(group_best[group, min(xn - turn, last)])
                    dearest = np.int64(nodes[x, DEAREST])
                    if (max(e, dearest) if max_rest else e + dearest) <= xd:
                        continue
                h0 = np.int64(nodes[x, H_FIRST])
                x0 = max(u0, arcs[a, FIRST], h0) if max_first else u0 + arcs[a, FIRST] + h0
                key[:] = 0
                key[w0] |= x0 << s0
                key[w1] |= f1 << s1
                key[w2] |= f2 << s2
                push(keys, values, size, words, key, (done << 32) | (a + 1))
                size += 1
                counters[N_GENERATED] += 1
    counters[N_OPEN] = size
    counters[N_CLOSED] = done
    return code


class Staircase(Search):
    """The search on one graph for one query, costs taken in the given order: first, index, rest (or -1)."""

    def __init__(
        self,
        graph: Graph,
        source: int,
        targets: IntArray,
        h: IntArray,
        order: tuple[int, int, int],
        clock: Clock,
        width: int = 16,
    ) -> None:
        self.source = source
        reached = h[0] < UNREACHABLE
        most = [int(graph.costs[:, j].max(initial=0)) if j >= 0 else 0 for j in order]
        far = [int(h[j].max(where=reached, initial=0)) if j >= 0 else 0 for j in order]
        rise = [2 * c + b for c, b in zip(most, far, strict=True)]
        f = [int(h[j, source]) if j >= 0 else 0 for j in order]
        is_max = np.array([j >= 0 and graph.aggregates[j] == "max" for j in order])
        self.is_max = (bool(is_max[0]), bool(is_max[2]))
        self.dtype: type[Any] = np.int32 if 4 * (max(f) + max(rise)) < INT32_LIMIT else np.int64
        self.table = np.empty((graph.arcs, ARC_COLUMNS), self.dtype)
        self.nodes = np.empty((graph.nodes, NODE_COLUMNS), self.dtype)
        self.origin = np.empty(graph.arcs, np.int32)
        tables = (np.array(order, np.int64), order[1], h, self.table, self.nodes, self.origin)
        self.start, self.split = clock.call(build, graph.indptr, graph.heads, graph.costs, *tables)
        group = np.empty(graph.nodes, np.int64)
        dearest = clock.call(find_groups, self.start, self.split, self.table, is_max, group)
        self.shared = bool(len(dearest) and not dearest[:, 0].any())
        self.turn = int(dearest[:, 1].max(initial=0))
        self.nodes[:, ROW] = self.nodes[:, GROUP] = -1
        self.nodes[:, DEAREST] = 0
        if self.shared:
            self.nodes[:, GROUP] = group
            self.nodes[:, DEAREST] = np.where(group >= 0, dearest[group, 2], 0)
        if not len(dearest):
            self.split = self.start[1:].copy()
        self.is_target = np.zeros(graph.nodes, np.uint8)
        self.is_target[targets] = 1
        self.best = self._empty(64, width)
        self.group_best = self._empty(len(dearest) if self.shared else 1, width)
        self.goal = self._empty(1, width)[0]
        fan = int(clock.call(most_successors, self.start, self.split, self.table))
        super().__init__(f, rise, fan)

    def _empty(self, rows: int, width: int) -> NDArray[Any]:
        return np.full((rows, width), min(np.iinfo(self.dtype).max, int(UNREACHABLE)), self.dtype)

    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel."""
        code = clock.call(
            advance,
            self.counters,
            work,
            np.array(self.rise, np.int64),
            self.fan,
            self.start,
            self.split,
            self.table,
            self.nodes,
            self.is_target,
            self.best,
            self.group_best,
            self.goal,
            self.turn,
            self.is_max,
            self.source,
            self.plan,
            self.keys,
            self.values,
            self.closed,
            self.front,
            self.solutions,
        )
        return int(code)

    def arrays(self) -> list[NDArray[Any]]:
        """List the tables of the graph and the staircases."""
        tables = [self.table, self.nodes, self.origin, self.start, self.split, self.is_target]
        return [*tables, self.best, self.group_best, self.goal]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Double the rows, or the width, of the staircases."""
        if code == ROWS:
            return self.best.nbytes, self._grow_rows
        return self.best.nbytes + self.group_best.nbytes + self.goal.nbytes, self._grow_width

    def _grow_rows(self) -> None:
        rows, width = self.best.shape
        self.best.resize((2 * rows, width), refcheck=False)
        self.best[rows:] = self._empty(1, 1)[0, 0]

    def _grow_width(self) -> None:
        self.best = _wider(self.best)
        self.group_best = _wider(self.group_best)
        self.goal = _wider(self.goal[None, :])[0]

    def _widen_keys(self) -> None:
        super()._widen_keys()
        if self.dtype is np.int32 and self.plan[2].max() >= INT32_LIMIT:
            old = np.iinfo(self.dtype).max
            self.dtype = np.int64
            self.table, self.nodes = self.table.astype(np.int64), self.nodes.astype(np.int64)
            for name in ("best", "group_best", "goal"):
                array = getattr(self, name).astype(np.int64)
                array[array == old] = UNREACHABLE
                setattr(self, name, array)

    def path(self, label: int, clock: Clock) -> IntArray:
        """Places of the arcs of a solution in the graph, from the source on."""
        arrays = (self.start, self.split, self.table, self.origin, self.closed)
        return cast(IntArray, clock.call(trace, *arrays, self.source, label))


def _wider(staircases: NDArray[Any]) -> NDArray[Any]:
    """Double the width; beyond it a staircase goes on as it ends."""
    return np.concatenate([staircases, np.repeat(staircases[:, -1:], staircases.shape[1], axis=1)], axis=1)
