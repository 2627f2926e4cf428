"""Gap of a stopped staircase search, proven by bounds for each number of further turns.

An open label (partial path) has one estimate f: the least of each cost alone over all paths that begin with it. The
path with the fewest turns and the path with the least rest cost are mostly different, so no path comes near f, and the
gap to f can be 1 where the true gap is 0.2. The bounds h_m of :func:`.staircase.tables.costs_by_turns` tell more. Let a
label have n turns and the rest cost d so far. A path with m further turns has n + m turns in all, and a rest cost of at
least d + h_m. So one estimate for each m, instead of f, bounds all paths that begin with the label. Estimates that the
staircase of the solutions covers are left out: nothing is missing there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.kernels import excess
from hpop.search.staircase.tables import H_INDEX, H_REST


@lean
def gap_by_turns(
    front: FloatArray,
    labels: IntArray,
    estimates: IntArray,
    heads: NDArray[np.int32],
    source: int,
    nodes: NDArray[Any],
    layers: NDArray[Any],
    goal: NDArray[Any],
    bound: int,
    most: float,
    least: FloatArray,
) -> float:
    """Return the least gap such that each path through an open label has a vector of the front within (1 + gap).

    front              (f, 3)  vectors found: first cost, number of turns, rest cost
    labels, estimates  (m,), (m, 3)  open labels (partial paths) and their estimates
    heads              heads of the plain arcs (no turns), of which labels name the last
    source             node at which paths begin
    nodes, layers      table of nodes, and bounds by remaining turns (:func:`.staircase.tables.costs_by_turns`)
    goal               staircase of the solutions
    bound              upper bound of the first cost
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
        arc = (labels[i] & 0xFFFFFFFF) - 1
        v = np.int64(source)
        if arc >= len(heads):  # a turn to a target
            v = arc - len(heads)
        elif arc >= 0:
            v = np.int64(heads[arc])
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
            if excess(front[last], least) <= gap:
                continue
            best = np.inf
            for r in range(len(front)):
                gap_of_vector = excess(front[r], least)
                if gap_of_vector < best:
                    best = gap_of_vector
                    last = r
                    if best <= gap:
                        break
            gap = max(gap, best)
            if gap >= most:
                return most
    return gap
