"""Checks of saved labels of a staircase search, and the test by joint bounds whether solutions cover a label.

A label is a partial path: an int64 with its parent label and its last arc. Its estimate f (3,) has lower bounds of the
first cost, the index cost (number of turns) and the rest cost of all paths that begin with it. Staircases are the
tables for dominance tests (:mod:`.staircase.tables`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.kernels import least_covered
from hpop.search.machinery.slices import N_ROWS, Clock
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
from hpop.search.staircase.turn_hull import DOWN, FAR, LANES, STEP_BITS, UP, IntLanes, Steps


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
    """Compute the last nodes and the estimates of saved labels (partial paths); write them to `at` (n,) and f (n, 3).

    values       (n,)  labels, closed labels first; `closed` is their number. The last arc of a label is an arc in the
                       order of the search, or m + u for a turn to the target u
    root         (3,)  estimate of the label at the source
    graph, turn        arguments of the search's kernel, :func:`.staircase.kernel.advance`
    tails        (m,)  tails of the arcs
    most         (3,)  largest estimates that fit

    Returns n, or i if label i is invalid, or -1 - i if the costs of label i are too large.
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
        if (of_u >= 0 or not turned) if a >= m_arcs else of_u < 0:  # only turns to a target are separate labels
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
    """Enter saved closed labels, from index `begin` on, into the staircases, as the search did when it closed them.

    at, f  (n,), (n, 3)  nodes and estimates of the labels (partial paths)

    Other arguments are those of :func:`.staircase.kernel.advance`. Returns n, or i if there is too little room for
    label i, or -1 - i if label i is dominated already.
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
    """Enter saved solutions (n, 3) into `goal`, the staircase of the solutions.

    Returns n, or -1 - i if solution i is covered already. `eps` and `tolerance` are the precision of the search.
    """
    end = len(goal) - 1
    for i in range(len(solved)):
        if goal[solved[i, 1] if solved[i, 1] < end else end] <= solved[i, 2]:
            return -1 - i
        first = least_covered(solved[i, 1], eps, tolerance[1])
        lower(goal, first, np.int64(1), len(goal) - first, least_covered(solved[i, 2], eps, tolerance[2]))
    return len(solved)


@kernel
def checksum_of_stairs(stairs: NDArray[Any], groups: NDArray[Any], width: int, empty: int) -> int:
    """Return a checksum of the steps of all staircases that does not depend on their positions and widths.

    stairs, groups, width  staircases of all nodes, see :func:`.staircase.tables.enter_stairs`
    empty                  height of a step without a closed label
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


# This explains the test of :func:`may_improve`. Represent each solution with at most N turns by the least estimate that
# it covers: x in the first cost, y in the rest cost. Sort them by rising x and falling y. The region of vectors (first,
# rest) that none of them covers is bounded by a staircase: each such vector, with N turns or more, is nowhere larger
# than one of the corners (x_i - 1, y_{i-1} - 1), where x or y is infinite at the ends.
#
# Let a label have n turns and costs g, and let m turns and costs c lead from it to a target. If no solution covers the
# whole path, then w.g + w.c <= w.corner for one corner of N = n + m and for all weights w >= 0. H_m is a lower bound of
# w.c, so w.g + H_m <= w.corner as well. If no m and corner satisfy this for all weights of :mod:`.turn_hull`, every
# path that begins with the label is covered, and the label is pruned. H_m is stored as its excess over w.h, with the
# least remaining costs h; w.g + w.h is w.f, with the label's estimate f. Weighted labels are rounded down and corners
# up, so rounding never prunes a label wrongly.


NEVER = 2**31 - 1  # larger than any bound


@dataclass(frozen=True, eq=False)
class UncoveredCorners:
    """Corners of the region of cost vectors that no solution covers, for each number of turns (comment above).

    N is the largest number of turns of a solution, p the number of solutions.

    values  (N + 1, p + 1, LANES)  row n: weighted costs of the corners that are left by solutions with at most n turns,
                                   sorted by rising first cost
    last    (N + 1,)               index of the last corner in each row
    """

    values: IntLanes
    last: IntArray

    @classmethod
    def of(cls, covered: IntArray, weights: FloatArray, clock: Clock) -> UncoveredCorners:
        """Return the corners for p solutions.

        covered  (p, 3)      least estimate that each solution covers: first cost, turns, rest cost
        weights  (LANES, 2)  weights of first and rest cost
        """
        order = np.lexsort((covered[:, 2], covered[:, 0]))
        most = int(covered[:, 1].max(initial=0))
        values = np.empty((most + 1, len(covered) + 1, LANES), np.int32)
        last = np.empty(most + 1, np.int64)
        clock.call(fill_corners, covered[order], weights, values, last)
        return cls(values, last)


def least_estimates(costs: IntArray, eps: float, tolerance: IntArray) -> IntArray:
    """Return the least estimate (n, 3), a lower bound of a path's costs, that each vector (n, 3) covers.

    A vector covers what is at least as large in every cost, within `eps` and `tolerance` (3,).
    """
    within = tolerance.tolist()
    table = [[least_covered(c, float(eps), t) for c, t in zip(row, within, strict=True)] for row in costs.tolist()]
    return np.array(table, np.int64).reshape(-1, 3)


@kernel
def fill_corners(covered: IntArray, weights: FloatArray, values: IntLanes, last: IntArray) -> None:
    """Compute the fields `values` and `last` of :class:`UncoveredCorners`, which are written.

    covered  (p, 3)      least estimate that each solution covers, sorted by first cost, then rest cost
    weights  (LANES, 2)  weights of first and rest cost
    """
    infinite = float(NEVER)
    for n in range(len(last)):
        corner = 0
        above = np.int64(0)  # rest cost of the solution before
        for i in range(len(covered) + 1):
            end = i == len(covered)
            if not end and (covered[i, 1] > n or (corner > 0 and covered[i, 2] >= above)):
                continue
            for k in range(LANES):
                first, rest = weights[k, 0], weights[k, 1]
                x = (infinite if end else first * (covered[i, 0] - 1)) if first > 0 else 0.0
                y = (infinite if corner == 0 else rest * (above - 1)) if rest > 0 else 0.0
                values[n, corner, k] = np.int32(min(infinite, max(0.0, x + y) * UP + 1))
            last[n] = corner
            corner += 1
            if not end:
                above = covered[i, 2]


@lean
def may_improve(
    v: int,
    n: int,
    first: int,
    rest: int,
    fewest: int,
    layers: Steps,
    weights: FloatArray,
    values: IntLanes,
    last: IntArray,
    scratch: IntLanes,
) -> bool:
    """Return False if joint bounds prove that solutions cover every path that begins with a label, else True.

    v, n             last node of the label, and its number of turns so far
    first, rest      the label's estimate: lower bounds of the first and of the third ("rest") cost of all paths to a
                     target that begin with it
    fewest           least number of further turns; may exceed the number of layers
    layers, weights  fields of :class:`.TurnHull`
    values, last     fields of :class:`UncoveredCorners`
    scratch          (2, LANES)
    """
    label, bound = scratch[0], scratch[1]
    node = np.uint64(v)
    for k in range(LANES):
        label[k] = np.int32(min(float(FAR), (weights[k, 0] * first + weights[k, 1] * rest) * DOWN))
    for m in range(min(fewest, len(layers) - 1), len(layers)):
        if m > fewest:
            equal = True
            for k in range(LANES):
                equal &= layers[m, node, k] == layers[m - 1, node, k]
            if equal:  # no better than with one turn less, for which no more solutions are known
                continue
        for k in range(LANES):
            bound[k] = label[k] + (np.int32(layers[m, node, k]) << STEP_BITS)
        most = np.uint64(min(n + max(m, fewest), len(last) - 1))
        low, high = np.int64(0), last[most]
        while low < high:
            middle = (low + high) >> 1
            if values[most, np.uint64(middle), 0] < bound[0]:
                low = middle + 1
            else:
                high = middle
        for i in range(np.uint64(low), np.uint64(last[most] + 1)):
            if values[most, i, 1] < bound[1]:
                break
            inside = True
            for k in range(LANES):
                inside &= values[most, i, k] >= bound[k]
            if inside:
                return True
    return False
