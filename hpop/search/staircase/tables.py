"""Tables of the search "staircase": nodes and arcs, staircases, paths of labels, and bounds by remaining turns.

A label is a partial path with a first cost, an index cost n (a small integer, mostly its number of turns) and a rest
cost. A group is a set of nodes joined by turns, and a plain arc is no turn. The staircase of a node has a step for each
n: the least rest cost of labels closed there with an index cost of at most n. A chain is a straight run of plain arcs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.labels import node_of
from hpop.search.machinery.slices import N_ROWS, Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups

HEAD, FIRST, INDEX, REST, ARC_COLUMNS = range(5)
# Columns of the table of nodes: three lower bounds, and the group (~group for a target). Rows have 16 bytes, for speed.
H_FIRST, H_INDEX, H_REST, GROUP, NODE_COLUMNS = range(5)
# Columns of the table of groups: first row of the staircases (-1: none yet), first node, number of nodes, dearest turn.
ROW, BEGIN, SLOTS, DEAREST, GROUP_COLUMNS = range(5)
BELOW = 0x7FFFFFFF  # mask on an index, which shows numba that the index is not negative


class TooWide(Exception):
    """Error raised if costs do not fit a key or staircases do not fit an index; then "general" searches instead."""


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
    """Fill the tables of nodes (n, 4), groups (g, 4) and plain arcs (m, 4), and return m.

    Arcs to nodes that reach no target are left out. Columns are named at the top of this module.

    costs, order         costs of the graph's arcs; columns of first, index and rest cost, -1 for none
    h          (k, n)    lower bounds of the remaining costs
    groups               arrays of :class:`.Groups`: nodes, rows, dearest, start, heads, and rows of the arcs in `costs`
    is_target  (n,)      mask of nodes, in the numbering of the groups
    table, group_table, arcs  output: the three tables
    start      (n + 1,)  output: offsets of the arcs of nodes
    arc_heads, origin    (m,)  output: heads of the arcs, and their indices among the plain arcs of the groups
    """
    nodes, rows, dearest, plain_start, plain_heads, priced = groups
    m = 0
    for g in range(len(rows)):
        group_table[g, ROW] = -1
        group_table[g, BEGIN] = rows[g, OFFSET]
        group_table[g, SLOTS] = rows[g, SIZE]
        group_table[g, DEAREST] = dearest[g, order[2]] if order[2] >= 0 else 0
        for p in range(rows[g, OFFSET], rows[g, OFFSET] + rows[g, SIZE]):
            for j in range(3):
                is_bounded = order[j] >= 0 and h[order[j], nodes[p]] < UNREACHABLE
                table[p, j] = h[order[j], nodes[p]] if is_bounded else 0
            table[p, GROUP] = ~g if is_target[p] else g
            start[p] = m
            for a in range(plain_start[p], plain_start[p + 1]):
                v = plain_heads[a]
                if h[order[0], nodes[v]] >= UNREACHABLE:
                    continue
                arcs[m, HEAD] = v
                arc_heads[m] = v
                origin[m] = a
                for j in range(3):
                    arcs[m, j + 1] = costs[priced[a], order[j]] if order[j] >= 0 else 0
                m += 1
    start[len(nodes)] = m
    return m


@lean
def lower(stairs: NDArray[Any], at: int, slots: int, steps: int, d: int) -> None:
    """Lower a staircase: the steps from position `at` on that are higher than d get the height d.

    A staircase never rises, so this ends at the first step that is low enough. `stairs` has many staircases. Those of a
    group are side by side, so the steps of one are `slots` numbers apart; `steps` of them are left from `at` on.
    """
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
    """Enter a label (partial path) with index cost n and rest cost d into the staircases of its node and of its group.

    Their steps from n on are lowered to d. The node is at position `slot` in its group. Returns the position of the
    group's first step in `stairs`; if the group has no staircases yet, they are added.

    stairs    staircases of all nodes, of `width` steps each, group after group
    share     (g, width)  for each group, one staircase of the labels closed at any of its nodes
    groups    (g, 4)      table of groups
    counters  counters of the search; N_ROWS is the used length of `stairs`
    """
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
def copy_to_double_width(old: NDArray[Any], new: NDArray[Any], groups: NDArray[Any], width: int) -> int:
    """Copy all staircases to `new` with 2 * `width` steps, the last one repeated; return the used length of `new`.

    The new positions of the staircases are written to `groups`, the table of groups.
    """
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
def trace_paths(
    indptr: IntArray,
    heads: NDArray[np.int32],
    is_raised: BoolArray,
    first: IntArray,
    count: int,
    start: IntArray,
    arc_heads: NDArray[np.int32],
    origin: NDArray[np.int32],
    nodes: IntArray,
    closed: IntArray,
    source: int,
    labels: IntArray,
    ends: IntArray,
    steps: IntArray,
) -> int:
    """Follow labels (partial paths, (n,)) back to the source, to find the arcs of their paths, turns included.

    Labels store plain arcs only; a turn is inserted where an arc does not begin at the head of the one before. Writes
    the arcs of all paths to `steps`, path after path, each from its last arc to its first, as far as there is room, and
    the end of each path in this array to `ends` (n,). Returns the length that `steps` needs.

    indptr, heads         arcs of one layer that include the turns of groups
    is_raised             (m,)  mask of those arcs that raise the index cost
    first, count          (n + 1,) offsets of all arcs of all layers, of which a node has these first; nodes of a layer
    start, arc_heads, origin  plain arcs: offsets of those of each node, heads, and indices in the graph
    nodes                 (n,)  node of the graph for each node of the search
    closed, source        closed labels, to which labels refer as parents; node at which paths begin
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
                tail = node_of(a, start)
            label = closed[(label >> 32) - 1]
            at = np.int64(arc_heads[(label & 0xFFFFFFFF) - 1]) if label != 0 else source
            if at != tail:
                u, v = nodes[at] % count, nodes[tail] % count
                for b in range(indptr[u], indptr[u + 1]):
                    if size < len(steps) and heads[b] == v and is_raised[b]:
                        steps[size] = first[nodes[at]] + b - indptr[u]
                size += 1
        ends[i] = size
    return size


# Bounds h_m(v): the least remaining rest cost of node v with at most m turns; a layer is h_m for all nodes. Plain arcs
# one after the other, without turns, form straight chains without cycles, so no queue is needed. One sweep along all
# chains gives the layer for m turns from the one for m - 1: h_m(v) = min(h_{m-1}(v), c + h_m(next node of v), min over
# turns to u of (turn + h_{m-1}(u))). A plain arc that includes turns, to a goal that no arc leaves, is left out of the
# layers of fewer turns.


LAYERS = 32


def costs_by_turns(
    groups: Groups,
    column: int,
    nodes: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    is_target: NDArray[np.uint8],
    clock: Clock,
    count: int = LAYERS,
) -> NDArray[Any] | None:
    """Return lower bounds (n, count) of the remaining rest cost: column m with at most m turns, the last with any.

    Returns None if there is no rest cost, or if the plain arcs form no chains.

    column                          column of the rest cost in the graph
    nodes, start, arcs, is_target   tables of the staircase search
    """
    chains = chain_order(start, arcs, clock) if column >= 0 else None
    if chains is None:
        return None
    infinite = min(np.iinfo(nodes.dtype).max, int(UNREACHABLE))  # the height of an empty staircase
    layers = np.empty((count, len(nodes)), nodes.dtype)
    turns = (
        groups.rows,
        groups.dearest[:, column],
        groups.turns[column],
        bool(groups.alike[column]),
    )
    begin = np.array([chains.begin(m) for m in range(count)])
    clock.call(fill_layers, nodes, chains.tails, chains.indices, begin, arcs, *turns, is_target, infinite, layers)
    return np.ascontiguousarray(layers.T)


class ArcChains(NamedTuple):
    """Plain arcs (no turns) along chains (straight runs), sorted so that each comes after the next arc of its chain.

    A sweep in this order propagates remaining costs backward along all chains.

    tails    (m,)  tails of the arcs
    indices  (m,)  indices of the arcs in the table of arcs
    late     (l,)  numbers of turns, falling, of the first l arcs; these only end chains (:func:`ends_chain`)
    """

    tails: IntArray
    indices: IntArray
    late: IntArray

    def begin(self, turns: int) -> int:
        """Return the index of the first arc that a path with at most ``turns`` turns can use; it can use all later."""
        return int(np.count_nonzero(self.late > turns))


def chain_order(start: IntArray, arcs: NDArray[Any], clock: Clock) -> ArcChains | None:
    """Return the plain arcs sorted along chains, or None if they form no chains."""
    if not len(arcs):
        return None
    tails, indices = np.empty(len(arcs), np.int64), np.empty(len(arcs), np.int64)
    last = clock.call(order_chains, start, arcs, tails, indices)
    if last < 0:
        return None
    late = arcs[indices[:last], INDEX].astype(np.int64)
    order = np.argsort(-late, kind="stable")
    tails[:last], indices[:last] = tails[order], indices[order]
    return ArcChains(tails, indices, late[order])


@lean
def ends_chain(start: IntArray, arcs: NDArray[Any], v: int, a: int) -> bool:
    """Return whether arc a of node v only ends chains (straight runs), such as an arc to a goal.

    This is so if no arc leaves its head, and if it turns as well or is one of several arcs of v.
    """
    u = np.int64(arcs[a, HEAD])
    return bool(start[u + 1] == start[u] and (arcs[a, INDEX] > 0 or start[v + 1] > start[v] + 1))


@kernel
def order_chains(start: IntArray, arcs: NDArray[Any], tails: IntArray, indices: IntArray) -> int:
    """Sort arcs (m,) along chains of nodes; return the number of arcs that only end chains, -1 if there are no chains.

    Each node must have one other arc at most, and node numbers along a chain must not fall after they have risen. Arcs
    that only end chains (to a goal) come first, then rising arcs from the last node on, then falling arcs. So a sweep
    goes through memory twice; chain after chain took two to three times as long. A node that no arc enters (a start)
    may have several arcs; they come last. `tails` and `indices` (m,) are the output.
    """
    n = len(start) - 1
    entered = np.zeros(n, np.bool_)
    for a in range(len(arcs)):
        entered[np.int64(arcs[a, 0])] = True
    chain = np.full(n, np.int64(-1))  # the arc of each node along its chain
    begins = np.zeros(n, np.bool_)  # nodes with several such arcs
    k = 0
    for v in range(n):
        for a in range(start[v], start[v + 1]):
            if ends_chain(start, arcs, v, a):
                tails[k], indices[k] = v, a
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
            tails[k], indices[k] = v, chain[v]
            k += 1
    for v in range(n):
        if chain[v] >= 0 and arcs[chain[v], 0] < v:
            tails[k], indices[k] = v, chain[v]
            k += 1
    for v in range(n):
        for a in range(start[v], start[v + 1] if begins[v] else start[v]):
            if not ends_chain(start, arcs, v, a):
                tails[k], indices[k] = v, a
                k += 1
    return first


@kernel
def fill_layers(
    nodes: NDArray[Any],
    tails: IntArray,
    indices: IntArray,
    begin: IntArray,
    arcs: NDArray[Any],
    groups: IntArray,
    dearest: IntArray,
    turns: IntArray,
    alike: bool,
    is_target: NDArray[np.uint8],
    infinite: int,
    layers: NDArray[Any],
) -> None:
    """Compute the bounds of :func:`costs_by_turns` for 0, 1, ... turns, and write them to `layers` (count, n).

    tails, indices  arcs in the order of :class:`ArcChains`
    begin           (count,)  index of the first arc that each layer (number of turns) may use
    groups, dearest, turns, alike  groups of nodes and rest costs of their turns, see :class:`.Groups`
    infinite        cost of a node without a path
    nodes           (n, 4)  table of nodes; its bound of the rest cost becomes the last layer
    """
    count, n = layers.shape
    now = np.full(n, infinite, layers.dtype)
    for m in range(count - 1):
        if m > 0:
            for g in range(len(groups)):
                offset, size, price = groups[g, OFFSET], groups[g, SIZE], groups[g, TURNS]
                if size == 1:
                    continue
                if alike:
                    least = np.int64(infinite)
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
        for i in range(begin[m], len(indices)):
            v, a = tails[i], indices[i]
            now[v] = min(np.int64(now[v]), now[np.int64(arcs[a, 0])] + np.int64(arcs[a, 3]))
        for v in range(n):
            layers[m, v] = now[v]
    for v in range(n):
        layers[count - 1, v] = nodes[v, 2]
