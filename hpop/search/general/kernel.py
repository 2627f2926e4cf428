"""The inner loop of the general search: labels leave the heap and are tested, and their successors enter it.

A label is a partial path with costs g; f is its estimate, costs with lower bounds of the remaining costs. The search is
explained in :mod:`.general.search`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.general.tables import SIZE, add_to_set, is_covered, numbers_needed
from hpop.search.machinery.kernels import drop_first, least_covered, push
from hpop.search.machinery.labels import layer_of, row_of
from hpop.search.machinery.slices import (
    CLOSED,
    DONE,
    FRONT,
    HEAP,
    KEYS,
    N_CLOSED,
    N_EXPANDED,
    N_FRONT,
    N_GENERATED,
    N_OPEN,
    N_ROWS,
    ROWS,
    SLICE,
)

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

    arcs, nodes  tables of arcs and nodes, see :class:`General`
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
    shared: Any,
) -> int:
    """Run the search for a slice of `work` steps: take labels (partial paths) from the heap, and extend them.

    It ends early if the heap is empty, if all its labels exceed `bound`, or if an array is full. Returns the code of
    the reason (:mod:`.machinery.slices`).
    All arrays belong to :class:`General`, and are changed in place.

    start, plain, arcs, nodes           tables of arcs and nodes, see :class:`General`
    shared                              layers that share the arcs, see :func:`.labels.row_of`; None if there are none
    is_target, is_max, source           mask of nodes; mask of costs that are maxima; node at which paths begin
    sets, pool                          sets of vectors (:mod:`.general.tables`), the last for the front
    rise, fan, plan, keys, values       heap, see :class:`.HeapSearch`
    counters, closed, front, solutions  labels and front, see :class:`.Search`
    eps, tolerance, bound               precision of the front, and upper bound of the first cost
    scratch                             a key and five vectors (k,)
    """
    word, bits, limit, words = plan
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
        v = np.int64(source)
        own, shift, number = v, np.int64(0), np.int64(0)
        if shared is None:  # numba compiles one of these branches
            v = np.int64(arcs[arc, 0]) if arc >= 0 else v
            own = v
        else:
            n, m, layers, more = shared
            if arc >= 0:
                row, onward = row_of(arc, shared)
                v = np.int64(arcs[row, 0]) + onward
            layer = layer_of(v, shared)
            own, shift, number = v - layer * n, layer * n, layer * m
        tight = False
        for j in range(k):
            f[j] = (keys[word[j]] >> bits[j]) & limit[j]
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
        if done + plain[own] - start[own] >= len(closed):
            code = CLOSED
            break
        if counters[N_FRONT] == len(solutions):
            code = FRONT
            break
        room = numbers_needed(sets, goal if is_target[v] else v, k)
        for a in range(start[own], plain[own]):
            room += numbers_needed(sets, np.int64(arcs[a, 0]) + shift, k)
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
        for b in range(start[own] - 1, plain[own]):  # the label itself, and after each turn
            u, now = v, g
            if b >= start[own]:
                u, now = np.int64(arcs[b, 0]) + shift, turned
                if shared is not None and nodes[u, 0] < 0:
                    continue
                extend_label(g, arcs, b, nodes, u, is_max, turned, f)
                work -= 1 + (at_goal + sets[u, SIZE]) // per_step
                if is_covered(sets, pool, u, f) or is_covered(sets, pool, goal, f):
                    continue
                counters[N_ROWS] = add_to_set(sets, pool, u, f, counters[N_ROWS])
                closed[done] = (parent << 32) | (number + b + 1)
                done += 1
            first, last = plain[u - shift], start[u - shift + 1]
            end = last
            if shared is not None:
                end += more[u + 1] - more[u]
            for i in range(first, end):
                a, onward, of_label = i, shift, number + i
                if shared is not None:
                    if i >= last:  # an arc to another layer
                        a, onward = m + more[u] + i - last, np.int64(0)
                        of_label = (layers - 1) * m + a
                    if nodes[np.int64(arcs[a, 0]) + onward, 0] < 0:
                        continue
                x = np.int64(arcs[a, 0]) + onward
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
                    key[word[j]] |= np.int64(f[j]) << bits[j]
                push(keys, values, size, words, key, (done << 32) | (of_label + 1))
                size += 1
                counters[N_GENERATED] += 1
    counters[N_OPEN] = size
    counters[N_CLOSED] = done
    return code
