"""Tables of nodes and arcs that the staircase search reads, staircases that get wider, and the way back from labels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import N_ROWS
from hpop.search.machinery.turns import OFFSET, SIZE

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
