"""Gap of a stopped staircase search: a proven bound on how far its front is from the exact front.

Vectors have three costs: the first cost, the number of turns, and the rest cost. A gap is relative, and one number for
the whole search: for each path, the front has a vector that is at most 1 + gap times the path's vector in every cost.

An open label (partial path) has one estimate f: the least of each cost alone over all paths that begin with it. The
path with the fewest turns and the path with the least rest cost are mostly different, so no path comes near f, and the
gap to f can be 1 where the true gap is 0.2. The bounds h_m of :func:`.staircase.tables.costs_by_turns` tell more. Let a
label have n turns and the rest cost d so far. A path with m further turns has n + m turns in all, and a rest cost of at
least d + h_m. So one estimate for each m, instead of f, bounds all paths that begin with the label. The gap is the
largest that any of these estimates leaves. Estimates that the staircase of the solutions covers are left out: there the
front lacks nothing.

A search within a precision has other bounds (:mod:`.turn_hull`), on weighted sums of the first and the rest cost. They
give no estimate of each cost, so the gap cannot be read from them, but a given gap can be tested: divide each vector of
the front by 1 + gap. If the result covers all paths through open labels (:func:`.staircase.labels.may_improve`), the
gap is proven. The least gap that passes this test is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.kernels import excess, nearest
from hpop.search.machinery.slices import Clock
from hpop.search.staircase.labels import least_estimates, may_improve
from hpop.search.staircase.tables import H_INDEX, H_REST
from hpop.search.staircase.turn_hull import HullBounds

CLOSE = 0.01  # a gap of joint bounds is at most this part larger than the least that they prove
LARGEST = 2.0**20  # a gap that is not shown to be smaller counts as infinite


@lean
def last_node(label: int, heads: NDArray[np.int32], source: int) -> int:
    """Return the last node of a label (partial path); arguments as in :func:`gap_by_turns`."""
    arc = (label & 0xFFFFFFFF) - 1
    if arc >= len(heads):  # a turn to a target
        return arc - len(heads)
    return np.int64(heads[arc]) if arc >= 0 else np.int64(source)  # type: ignore[return-value]  # as all kernels' indices


@lean
def gap_by_turns(
    front: FloatArray,
    labels: IntArray,
    estimates: IntArray,
    heads: NDArray[np.int32],
    source: int,
    nodes: NDArray[Any],
    bound: int,
    layers: NDArray[Any],
    goal: NDArray[Any],
    most: float,
    least: FloatArray,
) -> float:
    """Return the least gap such that each path through an open label has a vector of the front within (1 + gap).

    front              (f, 3)  vectors found: first cost, number of turns, rest cost
    labels, estimates  (m,), (m, 3)  open labels (partial paths) and their estimates
    heads              heads of the plain arcs (no turns), of which labels name the last
    source             node at which paths begin
    nodes, bound       table of nodes, and upper bound of the first cost
    layers             bounds by remaining turns (:func:`.staircase.tables.costs_by_turns`)
    goal               staircase of the solutions
    most               gap that is proven already; the computation stops when it is reached
    least              (3,)  scratch
    """
    end, n_layers = len(goal) - 1, layers.shape[1]
    gap = 0.0
    last = 0  # neighbouring estimates are similar, so the vector nearest to one is tried first for the next
    for i in range(len(labels)):
        least[0], least[1], least[2] = estimates[i, 0], estimates[i, 1], estimates[i, 2]
        if estimates[i, 0] > bound or excess(front[last], least) <= gap:
            continue
        v = last_node(labels[i], heads, source)
        fewest = np.int64(nodes[v, H_INDEX])
        n, d = estimates[i, 1] - fewest, estimates[i, 2] - nodes[v, H_REST]
        before = np.int64(-1)
        for m in range(min(fewest, n_layers - 1), n_layers):
            rest = max(estimates[i, 2], d + layers[v, m])
            if rest == before:  # a path with fewer turns may cost as little
                continue
            before = rest
            turns = n + max(m, fewest)
            if goal[min(turns, end)] <= rest:
                continue
            least[1], least[2] = turns, rest
            best, last = nearest(front, least, last, gap)
            gap = max(gap, best)
            if gap >= most:
                return most
    return gap


@lean
def first_uncovered(
    begin: int,
    labels: IntArray,
    estimates: IntArray,
    heads: NDArray[np.int32],
    source: int,
    nodes: NDArray[Any],
    bound: int,
    hull: Any,
) -> int:
    """Return the first label, from `begin` on, that may lead to a path that no solution covers; m if there is none.

    hull  fields of :class:`.HullBounds`, with the corners of the region that is not covered

    Other arguments as in :func:`gap_by_turns`.
    """
    layers, weights, corners, last, _, _, scratch = hull
    for i in range(begin, len(labels)):
        f0, f1, f2 = estimates[i, 0], estimates[i, 1], estimates[i, 2]
        v = last_node(labels[i], heads, source)
        fewest = np.int64(nodes[v, H_INDEX])
        if f0 <= bound and may_improve(v, f1 - fewest, f0, f2, fewest, layers, weights, corners, last, scratch):
            return i
    return len(labels)


def gap_by_joint_bounds(
    front: IntArray,
    with_corners: Callable[[IntArray, Clock], HullBounds],
    tables: tuple[Any, ...],
    least: float,
    gap: float,
    clock: Clock,
) -> float:
    """Return a gap that joint bounds prove for a front (n, 3), from `least` to `gap`; `gap` must be proven already.

    with_corners  function of the least vectors (n, 3) that the front covers within a gap, and of a clock; it returns
                  joint bounds with the corners of the region that these vectors do not cover
    tables        the arguments (labels, ..., bound) of :func:`first_uncovered`, in its order
    """
    low = middle = least
    begin, exactly = 0, np.zeros(3, np.int64)
    while low < LARGEST and gap - low > CLOSE * low:
        hull = with_corners(least_estimates(front, middle, exactly), clock)
        uncovered = int(clock.call(first_uncovered, begin, *tables, tuple(hull)))
        if uncovered == len(tables[0]):
            gap = middle
        else:  # labels before this one are covered within every larger gap
            low, begin = middle, uncovered
        middle = (low + gap) / 2 if np.isfinite(gap) else 2 * low + 1
    return gap
