"""What a staircase search makes of its labels again: costs, staircases of nodes; see :mod:`.machinery.labels`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel
from hpop.search.machinery.covered import least_covered
from hpop.search.machinery.slices import N_ROWS
from hpop.search.machinery.turns import TURNS
from hpop.search.staircase.tables import (
    BEGIN,
    DEAREST,
    FIRST,
    GROUP,
    H_FIRST,
    H_INDEX,
    H_REST,
    INDEX,
    REST,
    ROW,
    SLOTS,
    enter_stairs,
    lower,
)


@kernel
def retrace(
    values: IntArray,
    closed: int,
    root: IntArray,
    graph: Any,
    turn: tuple[int, bool, bool, bool, bool],
    tails: NDArray[np.int32],
    most: IntArray,
    at: NDArray[np.int32],
    f: NDArray[Any],
) -> int:
    """Find the node (n,) and the estimate (n, 3) of labels (n,), the closed ones first.

    The graph, its turns and their tables are those of the search's own kernel.


    root   (3,)  estimate of the source
    tails  (m,)  where the arcs begin
    most   (3,)  of estimates

    Returns n, or the place of a label that is none; minus one and its place where its costs are too large.
    """
    nodes, _, arcs, arc_heads, groups, rows, dearest, turns, source, first, rest = graph
    step, _, alike, max_first, max_rest = turn
    m_arcs = len(arc_heads)
    for i in range(len(values)):
        value = values[i]
        if value == 0:  # the source
            at[i] = source
            for j in range(3):
                f[i, j] = root[j]
                if root[j] > most[j]:
                    return -1 - i
            continue
        parent, a = (value >> 32) - 1, (value & 0xFFFFFFFF) - 1
        if not 0 <= parent < min(i, closed) or not 0 <= a < m_arcs + len(nodes):
            return i
        v = np.int64(at[parent])
        u = np.int64(tails[a]) if a < m_arcs else a - m_arcs
        group = np.int64(nodes[v, GROUP])
        of_u = np.int64(nodes[u, GROUP])
        turned = u != v
        if group < 0 or (turned and (step == 0 or (~of_u if of_u < 0 else of_u) != group)):
            return i
        if (of_u >= 0 or not turned) if a >= m_arcs else of_u < 0:  # only turns to a target are labels of their own
            return i
        u0 = np.int64(f[parent, 0]) - (0 if max_first else np.int64(nodes[v, H_FIRST]))
        n = np.int64(f[parent, 1]) - np.int64(nodes[v, H_INDEX])
        d = np.int64(f[parent, 2]) - (0 if max_rest else np.int64(nodes[v, H_REST]))
        if turned:
            turn_first, turn_rest = dearest[group, first], np.int64(groups[group, DEAREST])
            if not alike:
                begin = np.int64(groups[group, BEGIN])
                price = rows[group, TURNS] + (v - begin) * np.int64(groups[group, SLOTS]) + u - begin
                turn_first = turns[first, price]
                turn_rest = turns[rest, price] if rest >= 0 else np.int64(0)
            n += step
            u0 = max(u0, turn_first, np.int64(nodes[u, H_FIRST])) if max_first else u0 + turn_first
            d = max(d, turn_rest, np.int64(nodes[u, H_REST])) if max_rest else d + turn_rest
        x = u
        if a < m_arcs:
            x = np.int64(arc_heads[a])
            n += np.int64(arcs[a, INDEX])
            u0 = max(u0, np.int64(arcs[a, FIRST]), np.int64(nodes[x, H_FIRST])) if max_first else u0 + arcs[a, FIRST]
            d = max(d, np.int64(arcs[a, REST]), np.int64(nodes[x, H_REST])) if max_rest else d + arcs[a, REST]
        at[i] = x
        f0 = u0 if max_first else u0 + nodes[x, H_FIRST]
        f1 = n + nodes[x, H_INDEX]
        f2 = d if max_rest else d + nodes[x, H_REST]
        if f0 > most[0] or f1 > most[1] or f2 > most[2]:
            return -1 - i
        f[i, 0], f[i, 1], f[i, 2] = f0, f1, f2
    return len(values)


@kernel
def enter_all(
    at: NDArray[np.int32],
    f: NDArray[Any],
    begin: int,
    counters: IntArray,
    graph: Any,
    turn: tuple[int, bool, bool, bool, bool],
    stairs: NDArray[Any],
    share: NDArray[Any],
    width: int,
) -> int:
    """Enter closed labels (n,) with their estimates (n, 3), from `begin` on, as the search did when it closed them.

    Returns n, the place where there is no room for more rows, or minus one and the place of a label that is covered.
    """
    nodes, _, _, _, groups, rows, _, turns, _, _, rest = graph
    step, shared, alike, _, max_rest = turn
    last = width - 1
    for i in range(begin, len(at)):
        v = np.int64(at[i])
        group = np.int64(nodes[v, GROUP])
        n = np.int64(f[i, 1]) - np.int64(nodes[v, H_INDEX])
        d = np.int64(f[i, 2]) - (0 if max_rest else np.int64(nodes[v, H_REST]))
        base: Any = np.int64(groups[group, ROW])
        slots = np.int64(groups[group, SLOTS])
        slot = v - np.int64(groups[group, BEGIN])
        if base >= 0 and stairs[base + n * slots + slot] <= d:
            return -1 - i
        if base < 0 and counters[N_ROWS] + width * slots > len(stairs):
            return i
        base = enter_stairs(stairs, share, groups, counters, group, slot, n, d, width)
        if not shared or alike:
            continue
        above = base + (n + step if n + step < last else last) * slots
        for u in range(v - slot, v - slot + slots):
            if u == v or nodes[u, GROUP] < 0:
                continue
            price = rows[group, TURNS] + slot * slots + slot + u - v
            turn_rest = turns[rest, price] if rest >= 0 else np.int64(0)
            ud = max(d, turn_rest, np.int64(nodes[u, H_REST])) if max_rest else d + turn_rest
            if stairs[above + slot + u - v] > ud:
                lower(stairs, above + slot + u - v, slots, width - n - step, ud)
    return len(at)


@kernel
def enter_goal(goal: NDArray[Any], solved: NDArray[Any], eps: float, tolerance: IntArray) -> int:
    """Lower the staircase of the targets by solutions (n, 3); minus one and the place of one that it covers, or n."""
    end = len(goal) - 1
    for i in range(len(solved)):
        if goal[solved[i, 1] if solved[i, 1] < end else end] <= solved[i, 2]:
            return -1 - i
        first = least_covered(solved[i, 1], eps, tolerance[1])
        lower(goal, first, np.int64(1), len(goal) - first, least_covered(solved[i, 2], eps, tolerance[2]))
    return len(solved)


@kernel
def weigh(stairs: NDArray[Any], groups: NDArray[Any], width: int, empty: int) -> int:
    """A sum over the steps of all staircases, wherever they lie and however wide they are; it may overflow.

    empty  what no step is lower than where nothing was closed
    """
    total = np.int64(0)
    for g in range(len(groups)):
        row, slots = np.int64(groups[g, ROW]), np.int64(groups[g, SLOTS])
        if row < 0:
            continue
        for s in range(slots):
            node = np.int64(groups[g, BEGIN]) + s + 1
            for n in range(width):
                d = stairs[row + n * slots + s]
                if d < (stairs[row + (n - 1) * slots + s] if n > 0 else empty):
                    total += node * (2 * n + 3) * np.int64(d)
    return int(total)
