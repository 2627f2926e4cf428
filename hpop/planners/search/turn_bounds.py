"""Lower bounds that know how many turns are left: the least rest of the way with at most m of them.

With the number of turns fixed, straight runs are chains: no cycles, so no queue. One sweep along all chains gives
the costs with at most m turns from those with m - 1:
h_m(v) = min(h_{m-1}(v), c + h_m(next of v), min over turns to u of (turn + h_{m-1}(u))).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import IntArray
from hpop.compiled import kernel
from hpop.planners.search.bounds import UNREACHABLE
from hpop.planners.search.slices import Clock
from hpop.planners.search.turns import OFFSET, SIZE, TURNS, Groups

LAYERS = 32


def costs_by_turns(
    groups: Groups,
    column: int,
    nodes: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    is_target: NDArray[np.uint8],
    clock: Clock,
) -> NDArray[Any] | None:
    """Least rest (n, LAYERS) from each node with at most m turns, in column m; the last one with any number.

    None where plain arcs are no chains in order. The tables are the staircase search's, the column is of the rest cost.
    """
    order = chain_order(start, arcs, clock) if column >= 0 else None
    if order is None:
        return None
    far = min(np.iinfo(nodes.dtype).max, int(UNREACHABLE))  # as an empty staircase says
    layers = np.empty((LAYERS, len(nodes)), nodes.dtype)
    turns = (
        groups.rows,
        groups.dearest[:, column],
        groups.turns[column],
        bool(groups.alike[column]),
    )
    clock.call(sweep, nodes, start, arcs, *turns, is_target, order, far, layers)
    return np.ascontiguousarray(layers.T)


def chain_order(start: IntArray, arcs: NDArray[Any], clock: Clock) -> IntArray | None:
    """Order the nodes that have a plain arc, each after the one that it leads to; None where arcs are no chains."""
    if not len(arcs) or np.diff(start).max() > 1:
        return None
    order = np.empty(len(arcs), np.int64)
    return order if clock.call(order_chains, start, arcs, order) else None


@kernel
def order_chains(start: IntArray, arcs: NDArray[Any], order: IntArray) -> bool:
    """Order nodes along chains (m,) that lead steadily up or down in number; False where one does not.

    Those with arcs that lead up come first, from the last one on, then those with arcs that lead down. So a sweep goes
    through memory twice, whatever the directions of the chains: chain after chain took twice to three times as long.
    """
    n = len(start) - 1
    k = 0
    for v in range(n - 1, -1, -1):
        if start[v + 1] > start[v] and arcs[start[v], 0] > v:
            u = np.int64(arcs[start[v], 0])
            if start[u + 1] > start[u] and arcs[start[u], 0] < u:
                return False
            order[k] = v
            k += 1
    for v in range(n):
        if start[v + 1] > start[v] and arcs[start[v], 0] < v:
            order[k] = v
            k += 1
    return True


@kernel
def sweep(
    nodes: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    groups: IntArray,
    dearest: IntArray,
    turns: IntArray,
    alike: bool,
    is_target: NDArray[np.uint8],
    order: IntArray,
    far: int,
    layers: NDArray[Any],
) -> None:
    """Fill the layers one after the other."""
    count, n = layers.shape
    now = np.full(n, far, layers.dtype)
    for m in range(count - 1):
        if m > 0:
            for g in range(len(groups)):
                offset, size, price = groups[g, OFFSET], groups[g, SIZE], groups[g, TURNS]
                if size == 1:
                    continue
                if alike:
                    least = np.int64(far)
                    for u in range(offset, offset + size):
                        least = np.int64(min(least, now[u]))
                    for u in range(offset, offset + size):
                        now[u] = min(np.int64(now[u]), least + dearest[g])
                else:
                    for u in range(offset, offset + size):
                        least = np.int64(layers[m - 1, u])
                        for v in range(offset, offset + size):
                            at = price + (u - offset) * size + v - offset
                            least = np.int64(min(least, layers[m - 1, v] + turns[at]))
                        now[u] = least
        else:
            for v in range(n):
                if is_target[v]:
                    now[v] = 0
        for v in order:
            a = start[v]
            now[v] = min(np.int64(now[v]), now[np.int64(arcs[a, 0])] + np.int64(arcs[a, 3]))
        layers[m] = now
    layers[count - 1] = nodes[:, 2]
