"""Lower bounds that know how many turns are left: the least rest of the way with at most m of them.

With the number of turns fixed, straight runs are chains: no cycles, so no queue. One sweep along all chains gives
the costs with at most m turns from those with m - 1:
h_m(v) = min(h_{m-1}(v), c + h_m(next of v), min over turns to u of (turn + h_{m-1}(u))).
Where a plain arc turns as well (one that joins a start or a goal) that is not counted, which bounds the less.
"""

from __future__ import annotations

from typing import Any, NamedTuple

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
    chains = chain_order(start, arcs, clock) if column >= 0 else None
    if chains is None:
        return None
    far = min(np.iinfo(nodes.dtype).max, int(UNREACHABLE))  # as an empty staircase says
    layers = np.empty((LAYERS, len(nodes)), nodes.dtype)
    turns = (
        groups.rows,
        groups.dearest[:, column],
        groups.turns[column],
        bool(groups.alike[column]),
    )
    clock.call(sweep, nodes, *chains, arcs, *turns, is_target, far, layers)
    return np.ascontiguousarray(layers.T)


class Chains(NamedTuple):
    """Plain arcs (m,), each after those that follow it.

    tails   where they begin
    places  which they are
    """

    tails: IntArray
    places: IntArray


def chain_order(start: IntArray, arcs: NDArray[Any], clock: Clock) -> Chains | None:
    """Order the plain arcs, each after the one that leads on from its head; None where arcs are no chains."""
    if not len(arcs):
        return None
    chains = Chains(np.empty(len(arcs), np.int64), np.empty(len(arcs), np.int64))
    return chains if clock.call(order_chains, start, arcs, *chains) else None


@kernel
def order_chains(start: IntArray, arcs: NDArray[Any], tails: IntArray, places: IntArray) -> bool:
    """Order arcs along chains (m,) that lead steadily up or down in number; False where one does not.

    Those that lead up come first, from the last node on, then those that lead down. So a sweep goes through memory
    twice, whatever the directions of the chains: chain after chain took twice to three times as long. A node may have
    more arcs than one where nothing leads on from their heads, which come first of all, or where nothing leads to it:
    these come last. (A goal and a start beside the chains.)
    """
    n = len(start) - 1
    entered = np.zeros(n, np.bool_)
    for a in range(len(arcs)):
        entered[np.int64(arcs[a, 0])] = True
    chain = np.full(n, np.int64(-1))  # the arc of each node that goes on
    k = 0
    for v in range(n):
        several = start[v + 1] > start[v] + 1
        if several and not entered[v]:
            continue
        for a in range(start[v], start[v + 1]):
            u = np.int64(arcs[a, 0])
            if several and start[u + 1] == start[u]:
                tails[k], places[k] = v, a
                k += 1
            elif chain[v] >= 0:
                return False
            else:
                chain[v] = a
    for v in range(n - 1, -1, -1):
        if chain[v] >= 0 and arcs[chain[v], 0] > v:
            u = np.int64(arcs[chain[v], 0])
            if chain[u] >= 0 and arcs[chain[u], 0] < u:
                return False
            tails[k], places[k] = v, chain[v]
            k += 1
    for v in range(n):
        if chain[v] >= 0 and arcs[chain[v], 0] < v:
            tails[k], places[k] = v, chain[v]
            k += 1
    for v in range(n):
        if start[v + 1] > start[v] + 1 and not entered[v]:
            for a in range(start[v], start[v + 1]):
                tails[k], places[k] = v, a
                k += 1
    return True


@kernel
def sweep(
    nodes: NDArray[Any],
    tails: IntArray,
    places: IntArray,
    arcs: NDArray[Any],
    groups: IntArray,
    dearest: IntArray,
    turns: IntArray,
    alike: bool,
    is_target: NDArray[np.uint8],
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
        for i in range(len(places)):
            v, a = tails[i], places[i]
            now[v] = min(np.int64(now[v]), now[np.int64(arcs[a, 0])] + np.int64(arcs[a, 3]))
        for v in range(n):
            layers[m, v] = now[v]
    for v in range(n):
        layers[count - 1, v] = nodes[v, 2]
