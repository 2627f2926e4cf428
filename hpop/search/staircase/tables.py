"""Tables of the staircase search: nodes and arcs, growing staircases, the way back, and bounds by the turns left."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import N_ROWS, Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups

HEAD, FIRST, INDEX, REST, ARC_COLUMNS = range(5)
# Columns of the table of nodes: lower bounds, and the group, ~group for a target. (16 bytes, as memory is what a
# search waits for.)
H_FIRST, H_INDEX, H_REST, GROUP, NODE_COLUMNS = range(5)
# Columns of the table of groups: where the staircases begin (-1: nowhere yet), first node, nodes, dearest turn.
ROW, BEGIN, SLOTS, DEAREST, GROUP_COLUMNS = range(5)
BELOW = 0x7FFFFFFF  # an index masked with this is not negative: numba then leaves out wrapping


class TooWide(Exception):
    """Costs of a label no longer fit a key, or staircases an index: the general search has to take over."""


@kernel
def fill_tables(
    costs: IntArray,
    order: IntArray,
    h: IntArray,
    groups: Any,
    is_target: NDArray[np.uint8],
    table: NDArray[Any],
    group_table: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    arc_heads: NDArray[np.int32],
    origin: NDArray[np.int32],
) -> int:
    """Fill the tables of nodes (n, 4), of groups (g, 4) and of the plain arcs (m, 4) that lead somewhere; returns m.

    start (n + 1,) receives where the arcs of a node begin, arc_heads (m,) where they lead, origin (m,) which they are.
    """
    nodes, rows, dearest, plain_start, plain_heads, plain_origin = groups
    m = 0
    for g in range(len(rows)):
        group_table[g, ROW] = -1
        group_table[g, BEGIN] = rows[g, OFFSET]
        group_table[g, SLOTS] = rows[g, SIZE]
        group_table[g, DEAREST] = dearest[g, order[2]] if order[2] >= 0 else 0
        for p in range(rows[g, OFFSET], rows[g, OFFSET] + rows[g, SIZE]):
            for j in range(3):
                known = order[j] >= 0 and h[order[j], nodes[p]] < UNREACHABLE
                table[p, j] = h[order[j], nodes[p]] if known else 0
            table[p, GROUP] = ~g if is_target[p] else g
            start[p] = m
            for a in range(plain_start[p], plain_start[p + 1]):
                v = plain_heads[a]
                if h[order[0], nodes[v]] >= UNREACHABLE:
                    continue
                arcs[m, HEAD] = v
                arc_heads[m] = v
                origin[m] = plain_origin[a]
                for j in range(3):
                    arcs[m, j + 1] = costs[plain_origin[a], order[j]] if order[j] >= 0 else 0
                m += 1
    start[len(nodes)] = m
    return m


@lean
def lower(stairs: NDArray[Any], at: int, slots: int, steps: int, d: int) -> None:
    """Lower a staircase to d from one of its steps on."""
    at &= BELOW
    for _ in range(steps):
        if stairs[at] <= d:
            break
        stairs[at] = d
        at += slots


@lean
def enter_stairs(
    stairs: NDArray[Any],
    share: NDArray[Any],
    groups: NDArray[Any],
    counters: IntArray,
    group: int,
    slot: int,
    n: int,
    d: int,
    width: int,
) -> int:
    """Lower the staircase of a node, and what its group shares, to d from n on; where the group's staircases begin."""
    group, n = group & BELOW, n & BELOW
    slots = np.int64(groups[group, SLOTS]) & BELOW
    base = np.int64(groups[group, ROW])
    if base < 0:
        base = counters[N_ROWS]
        counters[N_ROWS] = base + width * slots
        groups[group, ROW] = base
    lower(stairs, base + n * slots + slot, slots, width - n, d)
    for i in range(n, width):
        if share[group, i] <= d:
            break
        share[group, i] = d
    return int(base)


@kernel
def widen(old: NDArray[Any], new: NDArray[Any], groups: NDArray[Any], width: int) -> int:
    """Copy the staircases to twice their width; beyond it one goes on as it ends. Returns how much is used."""
    used = np.int64(0)
    for g in range(len(groups)):
        row, slots = np.int64(groups[g, ROW]), np.int64(groups[g, SLOTS])
        if row < 0:
            continue
        for i in range(2 * width):
            for j in range(slots):
                new[used + i * slots + j] = old[row + min(i, width - 1) * slots + j]
        groups[g, ROW] = used
        used += 2 * width * slots
    return int(used)


@lean
def trace(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    index: int,
    arc_tails: NDArray[np.int32],
    arc_heads: NDArray[np.int32],
    origin: NDArray[np.int32],
    nodes: IntArray,
    closed: IntArray,
    source: int,
    labels: IntArray,
    ends: IntArray,
    steps: IntArray,
) -> int:
    """Follow labels back to the source; where the arcs do not join, the turn between them is put in.

    Writes where each path ends (n,) in the arcs of all of them, one after the other, each from its last arc on, and
    these arcs as far as there is room; returns how many they are.
    """
    size = 0
    for i in range(len(labels)):
        label = labels[i]
        while label != 0:
            a = (label & 0xFFFFFFFF) - 1
            if a >= len(arc_heads):
                tail = a - len(arc_heads)
            else:
                if size < len(steps):
                    steps[size] = origin[a]
                size += 1
                tail = np.int64(arc_tails[a])
            label = closed[(label >> 32) - 1]
            at = np.int64(arc_heads[(label & 0xFFFFFFFF) - 1]) if label != 0 else source
            if at != tail:
                u, v = nodes[at], nodes[tail]
                for b in range(indptr[u], indptr[u + 1]):
                    if size < len(steps) and heads[b] == v and costs[b, index] > 0:
                        steps[size] = b
                size += 1
        ends[i] = size
    return size


# With the number of turns fixed, straight runs are chains: no cycles, so no queue. One sweep along all chains gives the
# costs with at most m turns from those with m - 1: h_m(v) = min(h_{m-1}(v), c + h_m(next of v), min over turns to u of
# (turn + h_{m-1}(u))). A plain arc that turns as well, to a goal where nothing leads on, is left out of the layers of
# fewer turns.


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
