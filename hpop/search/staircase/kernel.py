"""The inner loop of the staircase search: labels leave the queue and are tested, and their successors enter it.

A label is a partial path. Its costs are the first cost, the index cost (a small integer, mostly the number of turns)
and the rest cost; f is its estimate, costs plus lower bounds of the remaining costs. A staircase is a table for
dominance tests at a node (:mod:`.staircase.search`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.kernels import least_covered
from hpop.search.machinery.slices import (
    BUCKETS,
    CHUNKS,
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
    WIDTH,
)
from hpop.search.machinery.turns import TURNS
from hpop.search.staircase.buckets import CHUNK, FREE, IN_HEAP, N_FREE, OPEN, USED, open_next, sift_down
from hpop.search.staircase.labels import may_improve
from hpop.search.staircase.tables import (
    BEGIN,
    BELOW,
    DEAREST,
    FIRST,
    GROUP,
    H_FIRST,
    H_INDEX,
    H_REST,
    HEAD,
    INDEX,
    REST,
    ROW,
    SLOTS,
    enter_stairs,
    lower,
)


@lean
def advance(
    counters: IntArray,
    work: int,
    fan: int,
    rise: IntArray,
    packing: IntArray,
    graph: Any,
    turn: tuple[int, bool, bool, bool, bool],
    stairs: NDArray[Any],
    share: NDArray[Any],
    goal: NDArray[Any],
    width: int,
    layers: NDArray[Any],
    hull: Any,
    queue: IntArray,
    waiting: Any,
    heap: tuple[IntArray, IntArray],
    closed: IntArray,
    front: IntArray,
    solutions: IntArray,
    fresh: IntArray,
    eps: float,
    tolerance: IntArray,
    bound: int,
) -> int:
    """Run the search for a slice of `work` steps: take labels (partial paths) from the queue, and extend them.

    It ends early if the queue is empty, if all its labels exceed `bound`, or if an array is full. Returns the code of
    the reason (:mod:`.machinery.slices`).
    All arrays belong to :class:`.Staircase`, and are changed in place.

    counters, closed, front, solutions  labels and front, see :class:`.Search`
    fan          largest number of labels that one expansion adds
    rise         (3,)  largest growth of an estimate in one expansion
    packing      (5,)  how estimates are packed into keys, see :class:`.BucketSearch`
    graph        tables of nodes, arcs and groups; node of the source; columns of first and rest cost
    turn         amount by which a turn raises the index; whether turns leave the first cost unchanged; whether all
                 turns of a group cost the same; whether the first and the rest cost are maxima
    stairs, share, width  staircases of nodes and groups, see :func:`.staircase.tables.enter_stairs`
    goal         staircase of the solutions
    layers       (n, LAYERS)  bounds by remaining turns, see :func:`.costs_by_turns`; (1, 0) without them
    hull         joint bounds: the fields of :class:`.HullBounds`, or None
    queue, waiting, heap  the queue, see :func:`.open_next`
    fresh        (fan, 3)  scratch
    eps, tolerance        precision of the front
    bound        upper bound of the first cost
    """
    nodes, start, arcs, arc_heads, groups, rows, dearest, turns, source, first, rest = graph
    step, shared, alike, max_first, max_rest = turn
    tops, below, entries = waiting
    keys, values = heap
    shift, bits, top, origin, limit = packing
    last = width - 1
    end = len(goal) - 1
    m_arcs = len(arc_heads)
    n_layers = layers.shape[1]
    low = (np.int64(1) << shift) - 1
    most_index = (np.int64(1) << (top - bits)) - 1
    most_rest = (np.int64(1) << bits) - 1
    opened = queue[OPEN]
    size = queue[IN_HEAP]
    count = counters[N_OPEN]
    done = counters[N_CLOSED]
    code = SLICE
    while work > 0:
        if size == 0:
            size = open_next(queue, waiting, heap)
            opened = queue[OPEN]
            if size <= 0:
                code = HEAP if size < 0 else DONE
                size = 0
                break
        key = keys[0]
        f0 = ((opened + origin) << shift) | (key >> top)
        f1 = (key >> bits) & most_index
        f2 = key & most_rest
        if f0 > bound:  # as are all later labels
            code = DONE
            break
        # Room for everything that this label may need, before any change.
        if size + fan > len(values):
            code = HEAP
        elif queue[USED] + fan > len(below) + queue[N_FREE]:
            code = CHUNKS
        elif ((f0 + rise[0]) >> shift) - origin >= len(tops):
            code = BUCKETS
        elif f1 + rise[1] > most_index or f2 + rise[2] > limit:
            code = KEYS
        elif f1 >= width:
            code = WIDTH
        elif done == len(closed):
            code = CLOSED
        elif counters[N_FRONT] == len(solutions):
            code = FRONT
        elif counters[N_ROWS] + width * fan > len(stairs):
            code = ROWS
        if code != SLICE:
            break
        work -= 1
        count -= 1
        value = values[0]
        size -= 1
        keys[0], values[0] = keys[size], values[size]
        sift_down(keys, values, np.int64(0), size)  # numba compiles an extra variant for a literal
        if hull is not None:  # numba drops this branch for None
            h_layers, h_weights, corners, last_corner, ahead, reached, scratch = hull
            while reached[0] < len(ahead) and ahead[reached[0], 0] <= f0:
                for m in range(ahead[reached[0], 1], len(goal)):
                    goal[m] = min(np.int64(goal[m]), ahead[reached[0], 2])
                reached[0] += 1
        if goal[(f1 if f1 < end else end) & BELOW] <= f2:
            continue
        arc = (value & 0xFFFFFFFF) - 1
        if arc < 0:
            v = np.int64(source)
        elif arc >= m_arcs:
            v = arc - m_arcs
        else:
            v = np.int64(arc_heads[arc]) & BELOW
        n = (f1 - nodes[v, H_INDEX]) & BELOW
        d = f2 if max_rest else f2 - nodes[v, H_REST]
        group = np.int64(nodes[v, GROUP])
        final = group < 0
        group = (~group if final else group) & BELOW
        base = np.int64(groups[group, ROW])
        slots = np.int64(groups[group, SLOTS]) & BELOW
        slot = (v - np.int64(groups[group, BEGIN])) & BELOW
        crowded = False
        if base >= 0:
            crowded = share[group, n] <= d
            if shared and n >= step and not final:
                e = np.int64(share[group, (n - step) & BELOW])
                most = np.int64(groups[group, DEAREST])
                if (max(e, most) if max_rest else e + most) <= d:
                    continue
            if stairs[(base + n * slots + slot) & BELOW] <= d:
                continue
        if n_layers > 0 and not final:
            alive = False
            for m in range(n_layers):
                alive |= goal[n + m] > layers[v, m] + d
            if not alive:
                continue
        if hull is not None and not final:
            work -= 8 * len(h_layers)
            fewest = np.int64(nodes[v, H_INDEX])
            if not may_improve(v, n, f0, f2, fewest, h_layers, h_weights, corners, last_corner, scratch):
                continue
        counters[N_EXPANDED] += 1
        if final:
            first_covered = least_covered(f1, eps, tolerance[1])
            lower(goal, first_covered, np.int64(1), len(goal) - first_covered, least_covered(f2, eps, tolerance[2]))
            at = counters[N_FRONT]
            front[at, 0] = f0
            front[at, 1] = f1
            front[at, 2] = f2
            solutions[at] = value
            counters[N_FRONT] = at + 1
            continue
        base = enter_stairs(stairs, share, groups, counters, group, slot, n, d, width)
        closed[done] = value
        done += 1

        count_fresh = 0
        g0 = f0 if max_first else f0 - nodes[v, H_FIRST]
        above = base + min(n + step, last) * slots
        begin, over = v - slot, v - slot + slots
        if crowded and shared and alike:  # another label of the group has made the turns
            begin, over = v, v + 1
        for u in range(begin, over):
            u0, un, ud = g0, n, d
            if u != v:
                un = n + step
                turn_first = dearest[group, first]
                turn_rest = np.int64(groups[group, DEAREST])
                if not alike:
                    price = rows[group, TURNS] + slot * slots + slot + u - v
                    turn_first = turns[first, price]
                    turn_rest = turns[rest, price] if rest >= 0 else np.int64(0)
                u0 = max(g0, turn_first, nodes[u, H_FIRST]) if max_first else g0 + turn_first
                ud = max(d, turn_rest, nodes[u, H_REST]) if max_rest else d + turn_rest
                if stairs[(above + slot + u - v) & BELOW] <= ud:
                    continue
                if nodes[u, GROUP] < 0:
                    f1 = un + nodes[u, H_INDEX]
                    f2 = ud if max_rest else ud + nodes[u, H_REST]
                    if goal[f1 if f1 < end else end] > f2:
                        fresh[count_fresh, 0] = u0 if max_first else u0 + nodes[u, H_FIRST]
                        fresh[count_fresh, 1] = (f1 << bits) | f2
                        fresh[count_fresh, 2] = m_arcs + u
                        count_fresh += 1
                    continue
                if (
                    shared and not alike
                ):  # later labels that are no better here are useless: all successors are generated now
                    lower(stairs, above + slot + u - v, slots, width - un, ud)
            for a in range(start[u], start[u + 1]):
                work -= 1
                x = np.int64(arcs[a, HEAD]) & BELOW
                xn = un + arcs[a, INDEX]
                xd = max(ud, arcs[a, REST], nodes[x, H_REST]) if max_rest else ud + arcs[a, REST]
                f1 = xn + nodes[x, H_INDEX]
                f2 = xd if max_rest else xd + nodes[x, H_REST]
                if goal[(f1 if f1 < end else end) & BELOW] <= f2:
                    continue
                at_x = np.int64(nodes[x, GROUP])
                tested = shared and xn >= step and at_x >= 0
                if tested:
                    e = np.int64(share[at_x & BELOW, min(xn - step, last) & BELOW])
                    most = np.int64(groups[at_x & BELOW, DEAREST])
                    if (max(e, most) if max_rest else e + most) <= xd:
                        continue
                if not (tested and alike):  # if all turns are alike, the test of the group covers its nodes
                    at_x = (~at_x if at_x < 0 else at_x) & BELOW
                    row = np.int64(groups[at_x, ROW])
                    own = x - np.int64(groups[at_x, BEGIN])
                    if row >= 0 and stairs[row + min(xn, last) * groups[at_x, SLOTS] + own] <= xd:
                        continue
                h0 = np.int64(nodes[x, H_FIRST])
                fresh[count_fresh, 0] = max(u0, arcs[a, FIRST], h0) if max_first else u0 + arcs[a, FIRST] + h0
                fresh[count_fresh, 1] = (f1 << bits) | f2
                fresh[count_fresh, 2] = a
                count_fresh += 1
        counters[N_GENERATED] += count_fresh
        count += count_fresh
        for i in range(count_fresh):
            f0 = fresh[i, 0]
            key = ((f0 & low) << top) | fresh[i, 1]
            value = (done << 32) | (fresh[i, 2] + 1)
            bucket = ((f0 >> shift) - origin) & BELOW
            if bucket == opened:
                at = size
                size += 1
                while at > 0:
                    above = ((at - 1) >> 2) & BELOW
                    if keys[above] <= key:
                        break
                    keys[at] = keys[above]
                    values[at] = values[above]
                    at = above
                keys[at] = key
                values[at] = value
                continue
            chunk = np.int64(tops[bucket, 0])
            filled = np.int64(tops[bucket, 1]) & BELOW
            if chunk < 0 or filled == CHUNK:
                new = queue[FREE]
                if new >= 0:
                    queue[FREE] = below[new]
                    queue[N_FREE] -= 1
                else:
                    new = queue[USED]
                    queue[USED] = new + 1
                below[new] = chunk
                tops[bucket, 0] = new
                chunk, filled = new, np.int64(0)
            at = (chunk * CHUNK + filled) & BELOW
            entries[at, 0] = key
            entries[at, 1] = value
            tops[bucket, 1] = filled + 1
    queue[IN_HEAP] = size
    counters[N_CLOSED] = done
    counters[N_OPEN] = count
    return code
