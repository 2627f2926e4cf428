"""Lower bounds that know how many turns are left: the least rest of the way with at most m of them.

With the number of turns fixed, straight runs are chains: no cycles, so no queue. One sweep along all chains gives
the costs with at most m turns from those with m - 1:
h_m(v) = min(h_{m-1}(v), c + h_m(next of v), min over turns to u of (turn + h_{m-1}(u))).
A plain arc that turns as well, to a goal where nothing leads on, is left out of the layers of fewer turns.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups
from hpop.search.staircase.tables import HEAD, INDEX

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
    begin = np.array([chains.begin(m) for m in range(LAYERS)])
    clock.call(sweep, nodes, chains.tails, chains.places, begin, arcs, *turns, is_target, far, layers)
    return np.ascontiguousarray(layers.T)


class Chains(NamedTuple):
    """Plain arcs (m,), each after those that follow it.

    tails   where they begin
    places  which they are
    late    (l,) by how many turns each of the first l raises the index, falling; nothing leads on from their heads
    """

    tails: IntArray
    places: IntArray
    late: IntArray

    def begin(self, turns: int) -> int:
        """The first arc that a way of at most so many turns can take."""
        return int(np.count_nonzero(self.late > turns))


def chain_order(start: IntArray, arcs: NDArray[Any], clock: Clock) -> Chains | None:
    """Order the plain arcs, each after the one that leads on from its head; None where arcs are no chains."""
    if not len(arcs):
        return None
    tails, places = np.empty(len(arcs), np.int64), np.empty(len(arcs), np.int64)
    last = clock.call(order_chains, start, arcs, tails, places)
    if last < 0:
        return None
    late = arcs[places[:last], INDEX].astype(np.int64)
    order = np.argsort(-late, kind="stable")
    tails[:last], places[:last] = tails[order], places[order]
    return Chains(tails, places, late[order])


@lean
def is_last(start: IntArray, arcs: NDArray[Any], v: int, a: int) -> bool:
    """Tell whether nothing leads on from the head of arc a of node v, and it turns or is one of several."""
    u = np.int64(arcs[a, HEAD])
    return bool(start[u + 1] == start[u] and (arcs[a, INDEX] > 0 or start[v + 1] > start[v] + 1))


@kernel
def order_chains(start: IntArray, arcs: NDArray[Any], tails: IntArray, places: IntArray) -> int:
    """Order arcs along chains (m,) that lead steadily up or down in number; -1 where one does not.

    Those that lead up come first, from the last node on, then those that lead down. So a sweep goes through memory
    twice, whatever the directions of the chains: chain after chain took twice to three times as long. A node may have
    more arcs than one where nothing leads on from their heads, which come first of all, or where nothing leads to it:
    these come last. (A goal and a start beside the chains.) Returns how many of them come first of all.
    """
    n = len(start) - 1
    entered = np.zeros(n, np.bool_)
    for a in range(len(arcs)):
        entered[np.int64(arcs[a, 0])] = True
    chain = np.full(n, np.int64(-1))  # the arc of each node that goes on
    begins = np.zeros(n, np.bool_)  # whether several do
    k = 0
    for v in range(n):
        for a in range(start[v], start[v + 1]):
            if is_last(start, arcs, v, a):
                tails[k], places[k] = v, a
                k += 1
            else:
                begins[v] = chain[v] >= 0 or begins[v]
                chain[v] = a
        if begins[v]:
            if entered[v]:
                return -1
            chain[v] = -1
    first = k
    for v in range(n - 1, -1, -1):
        if chain[v] >= 0 and arcs[chain[v], 0] > v:
            u = np.int64(arcs[chain[v], 0])
            if chain[u] >= 0 and arcs[chain[u], 0] < u:
                return -1
            tails[k], places[k] = v, chain[v]
            k += 1
    for v in range(n):
        if chain[v] >= 0 and arcs[chain[v], 0] < v:
            tails[k], places[k] = v, chain[v]
            k += 1
    for v in range(n):
        for a in range(start[v], start[v + 1] if begins[v] else start[v]):
            if not is_last(start, arcs, v, a):
                tails[k], places[k] = v, a
                k += 1
    return first


@kernel
def sweep(
    nodes: NDArray[Any],
    tails: IntArray,
    places: IntArray,
    begin: IntArray,
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
        for i in range(begin[m], len(places)):
            v, a = tails[i], places[i]
            now[v] = min(np.int64(now[v]), now[np.int64(arcs[a, 0])] + np.int64(arcs[a, 3]))
        for v in range(n):
            layers[m, v] = now[v]
    for v in range(n):
        layers[count - 1, v] = nodes[v, 2]
