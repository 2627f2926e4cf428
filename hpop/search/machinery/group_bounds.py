"""Backward searches over groups of nodes that are joined by turns: least remaining costs, one search for each cost.

A search works on whole groups (positions of a lattice), not on nodes. The queue holds groups, sorted into buckets by
their least new distance. A group that is taken from it first improves its own nodes by turns, then the tails of the
arcs that enter its improved nodes. Distances within a bucket may be improved later in the same bucket; all smaller ones
are final. On a lattice with 8 headings nearly every position is taken once, so the search takes a third of the time of
Dijkstra's algorithm on nodes. Source: Meyer and Sanders, "Delta-stepping: a parallelizable shortest path algorithm",
Journal of Algorithms 2003 (here on one thread).

The arcs that enter a group are stored together, each in one word: its cost, its tail, and the index of its head in the
group. They are sorted once for a graph and its extensions (:meth:`.Graph.extended`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.graph import Graph
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import CACHED, GROUP_COLUMNS, OFFSET, SIZE, TURNS, Groups

UNREACHABLE = np.int64(2**62)
WORD_BITS = 63  # of a packed arc
MEMBERS = 64  # largest number of nodes of a group: a word marks the improved ones, node v by its bit v mod 64
IN_WORD = MEMBERS - 1
BUCKETS = 4096  # largest number of buckets for the cost of one arc
BEGIN, END, SHIFT = range(GROUP_COLUMNS, GROUP_COLUMNS + 3)  # columns of the table of groups for these searches
SLOT, BEFORE, AFTER, MARKS = range(4)  # columns of the queue: bucket or -1, neighbours in its list, improved nodes


class PackedArcs(NamedTuple):
    """Arcs of a graph, or of one layer of it, sorted by the group of their head.

    arcs        (k, m)    for each cost: cost << (node_bits + member_bits) | tail << member_bits
                          | head's index in its group
    begin       (g + 1,)  offsets: the arcs that enter group g are begin[g] : begin[g + 1]
    means       (k,)      mean cost of an arc
    member_bits           bits of an index in a group
    node_bits             bits of a node's number
    """

    arcs: IntArray
    begin: IntArray
    means: IntArray
    member_bits: int
    node_bits: int

    @classmethod
    def of(cls, graph: Graph, groups: Groups, clock: Clock) -> PackedArcs:
        """Return the plain arcs of a graph with the given groups; they are cached with the graph if they are small."""
        name = ("packed arcs", groups.column)
        if name in graph.cache:
            cached: PackedArcs = graph.cache[name]
            return cached
        rows, group = groups.rows, _group_of_nodes(groups)
        begin = np.zeros(len(rows) + 2, np.int64)
        arcs = np.empty((graph.criteria, len(groups.heads)), np.int64)
        bits = _member_bits(groups), graph.nodes.bit_length()
        costs, priced = groups.costs_of_arcs(graph)
        clock.call(pack_arcs, groups.start, groups.heads, priced, costs, group, rows, *bits, begin, arcs)
        means = (arcs >> sum(bits)).sum(axis=1) // max(1, arcs.shape[1])
        packed = cls(arcs, begin[:-1], means, *bits)
        if clock.budget.max_memory is None and arcs.nbytes <= CACHED:
            graph.cache[name] = packed
        return packed


def can_be_packed(graph: Graph, groups: Groups) -> bool:
    """Return whether :class:`GroupSearches` can be used: turns form groups, and an arc fits one word."""
    if groups.column < 0 or int(groups.rows[:, SIZE].max(initial=0)) > MEMBERS:
        return False
    bits = _member_bits(groups) + graph.nodes.bit_length() + int(graph.largest.max(initial=0)).bit_length()
    return bits <= WORD_BITS


def memory_of_group_searches(graph: Graph, groups: Groups) -> int:
    """Return how many bytes the searches of :class:`GroupSearches` need, groups included."""
    n, k, m, g = graph.nodes, graph.criteria, len(groups.heads), len(groups.rows)
    copies = 1 if _keeps_numbers(groups) else 2
    return groups.nbytes + n * (4 + 12 * k * copies) + 8 * (k * m + 5 * k * g)


def _member_bits(groups: Groups) -> int:
    return int(groups.rows[:, SIZE].max(initial=1) - 1).bit_length()


def _group_of_nodes(groups: Groups) -> NDArray[np.int32]:
    return np.repeat(np.arange(len(groups.rows), dtype=np.int32), groups.rows[:, SIZE])


def _keeps_numbers(groups: Groups) -> bool:
    """Return whether the numbers of nodes in the groups are those in the graph."""
    return bool((groups.nodes[:-1] < groups.nodes[1:]).all())


def in_graph_numbers(groups: Groups, h: IntArray, onward: NDArray[np.int32]) -> tuple[IntArray, NDArray[np.int32]]:
    """Return distances and next nodes (k, n) with nodes in the numbering of the graph instead of the groups."""
    if _keeps_numbers(groups):
        return h, onward
    onward = np.where(onward < 0, -1, groups.nodes[onward]).astype(np.int32)
    return h[:, groups.new_number], onward[:, groups.new_number]


class GroupSearches:
    """Backward searches from the targets, one for each cost, that can stop at a distance and continue later."""

    def __init__(self, graph: Graph, targets: IntArray, clock: Clock, groups: Groups) -> None:
        self.clock, self.groups = clock, groups
        n, k, group = graph.nodes, graph.criteria, _group_of_nodes(groups)
        is_extended = graph.base is not None and groups.plain is not None  # then the base has these groups too
        layer, layers = (graph.layer, graph.layers) if is_extended else (graph, 1)
        packed = PackedArcs.of(layer, layer.cache["groups", groups.column] if is_extended else groups, clock)
        rows = np.zeros((len(groups.rows), SHIFT + 1), np.int32)
        rows[:, :GROUP_COLUMNS] = groups.rows
        own = rows[: layers * (len(packed.begin) - 1)].reshape(layers, -1, SHIFT + 1)
        own[..., BEGIN], own[..., END] = packed.begin[:-1], packed.begin[1:]
        own[..., SHIFT] = np.arange(layers)[:, None] * layer.nodes
        added, order = graph.added, np.zeros(0, np.int64)
        heads = groups.new_number[added.heads if is_extended else order]
        order = np.argsort(group[heads], kind="stable")
        entered_from = groups.new_number[np.searchsorted(graph.indptr, added.places[order], side="right") - 1]
        begin_joins = np.append(0, np.cumsum(np.bincount(group[heads], minlength=len(rows)))).astype(np.int32)
        joins = heads[order], entered_from, begin_joins
        self.h, self.onward = np.empty((k, n), np.int64), np.empty((k, n), np.int32)
        dearest, ends = np.ascontiguousarray(groups.dearest.T), groups.new_number[targets]
        shared = (packed.member_bits, packed.node_bits)

        def arguments(j: int) -> tuple[Any, ...]:
            largest = int(graph.largest[j])
            width = max(1, int(packed.means[j]), 2 * largest // BUCKETS)
            turns = (group, rows, dearest[j], bool(groups.alike[j]), groups.turns[j])
            queue = np.zeros((len(rows), 4), np.int64)
            queue[:, SLOT] = -1
            buckets = np.full((1 << (2 * largest // width + 3).bit_length(), 2), -1)
            state = (self.h[j], self.onward[j], queue, buckets, np.array([-1, 0]), width)
            costs = np.ascontiguousarray(added.costs[order, j])
            return (packed.arcs[j], *shared, *joins, costs, graph.aggregates[j] == "max", *turns, ends, *state)

        self._searches = [arguments(j) for j in range(k)]

    def settle(self, source: int, until: IntArray) -> IntArray:
        """Continue each search up to a distance ``until`` (k,), or to the distance of node ``source`` if this is less.

        With a source of -1, only the distance counts. Returns for each search the least distance (k,) beyond ``until``
        that a node has, UNREACHABLE if none has.
        """
        end = source if source < 0 else int(self.groups.new_number[source])
        calls = [(*search, end, distance) for search, distance in zip(self._searches, until.tolist(), strict=True)]
        return np.array(self.clock.call_all(settle_groups, calls), np.int64)

    def distances(self) -> IntArray:
        """Return for each search the least remaining cost (k, n) of each node so far."""
        return self.h if _keeps_numbers(self.groups) else self.h.take(self.groups.new_number, axis=1)

    def results(self) -> tuple[IntArray, NDArray[np.int32]]:
        """Return for each search the least remaining cost (k, n) of each node so far, and its next node (k, n)."""
        return in_graph_numbers(self.groups, self.h, self.onward)


@lean
def pack_arcs(
    start: IntArray,
    heads: NDArray[np.int32],
    origin: NDArray[np.int32],
    costs: IntArray,
    group: NDArray[np.int32],
    rows: IntArray,
    member_bits: int,
    node_bits: int,
    begin: IntArray,
    arcs: IntArray,
) -> None:
    """Sort arcs by the group of their head, by a counting sort, and pack each into one word for each cost.

    start, heads, group, rows  plain arcs and groups, see :class:`.Groups`
    origin (m,), costs         row of each arc in the table of costs, and this table with k columns
    begin (g + 2,)             must be 0; its first g + 1 entries receive the offset of each group
    arcs (k, m)                output, see :class:`PackedArcs`
    """
    for a in range(len(heads)):
        begin[group[heads[a]] + 2] += 1
    for g in range(len(rows)):
        begin[g + 2] += begin[g + 1]
    for u in range(len(group)):
        tail = np.int64(u) << member_bits
        for a in range(start[u], start[u + 1]):
            g = group[heads[a]]
            position = begin[g + 1]
            begin[g + 1] = position + 1
            ends = tail | (heads[a] - rows[g, OFFSET])
            for j in range(costs.shape[1]):
                arcs[j, position] = costs[origin[a], j] << (node_bits + member_bits) | ends


@lean
def append_group(g: int, slot: int, queue: IntArray, buckets: IntArray) -> None:
    """Append group g to the bucket with the number ``slot``, see :func:`settle_groups`."""
    bucket = slot & (len(buckets) - 1)
    last = buckets[bucket, 1]
    queue[g, SLOT], queue[g, BEFORE], queue[g, AFTER] = slot, last, -1
    if last >= 0:
        queue[last, AFTER] = g
    else:
        buckets[bucket, 0] = g
    buckets[bucket, 1] = g


@lean
def remove_group(g: int, queue: IntArray, buckets: IntArray) -> None:
    """Remove group g from its bucket, see :func:`settle_groups`."""
    bucket = queue[g, SLOT] & (len(buckets) - 1)
    before, after = queue[g, BEFORE], queue[g, AFTER]
    if before >= 0:
        queue[before, AFTER] = after
    else:
        buckets[bucket, 0] = after
    if after >= 0:
        queue[after, BEFORE] = before
    else:
        buckets[bucket, 1] = before
    queue[g, SLOT] = -1


@lean
def settle_groups(
    arcs: IntArray,
    member_bits: int,
    node_bits: int,
    joined: IntArray,
    joined_from: IntArray,
    begin_joins: NDArray[np.int32],
    join_costs: IntArray,
    is_max: bool,
    group: NDArray[np.int32],
    rows: NDArray[np.int32],
    dearest: IntArray,
    uniform: bool,
    turns: IntArray,
    targets: IntArray,
    out: IntArray,
    onward: NDArray[np.int32],
    queue: IntArray,
    buckets: IntArray,
    progress: IntArray,
    width: int,
    source: int,
    until: int,
) -> int:
    """Search backward from the targets by one cost; write the least remaining cost of each node and its next node.

    The search stops when all distances up to `until`, or up to that of the source, are final. Returns the least
    distance beyond `until` that a node has, or UNREACHABLE. The next call with equal arrays continues from there.

    arcs (m,), *_bits        arcs of a layer with this cost alone, see :class:`PackedArcs`
    joined, joined_from (j,) further arcs, sorted by the group of the head: heads and tails
    begin_joins (g + 1,)     offsets of the further arcs that enter each group
    join_costs (j,)          their costs
    is_max                   True if the cost of a path is its largest arc cost, False if it is the sum
    group (n,), rows         group of each node, and table of groups, see :class:`.Groups`; more columns: `arcs` of the
                             group are those from BEGIN to END - 1; SHIFT is added to the tail of each, for its layer
    dearest, uniform, turns  this cost of the turns, see :class:`.Groups` (`uniform` is an entry of `alike`)
    targets                  nodes at which paths may end, in the numbering of the groups
    out, onward (n,)         output: least cost, and next node on such a path or -1, in the numbering of the groups
    queue (g, 4)             state: groups with nodes whose arcs must be followed; column SLOT -1 and others 0 at first
    buckets (2^b, 2)         state: first and last group of each bucket; -1 before the first call
    progress (2,)            state: number of the bucket in work, and number of groups in the queue; -1 and 0 at first
    width                    range of distances of a bucket; bucket i has those from i * width on
    source                   node in the numbering of the groups at which the search stops, or -1
    until                    largest distance that must be final
    """
    one = np.int64(1)
    in_group, in_layer = (one << member_bits) - 1, (one << node_bits) - 1
    if progress[0] < 0:
        progress[0] = 0
        for node in range(len(out)):
            out[node], onward[node] = UNREACHABLE, -1
        for v in targets:
            g = np.int64(group[v])
            out[v] = 0
            queue[g, MARKS] |= one << (v & IN_WORD)
            if queue[g, SLOT] < 0:
                append_group(g, np.int64(0), queue, buckets)
                progress[1] += 1
    bucket, waiting = progress[0], progress[1]
    while waiting > 0:
        g = buckets[bucket & (len(buckets) - 1), 0]
        if g < 0:
            bucket += 1
            if bucket * width > until or (source >= 0 and out[source] < bucket * width):
                break
            continue
        remove_group(g, queue, buckets)
        waiting -= 1
        offset, members, marks = np.int64(rows[g, OFFSET]), np.int64(rows[g, SIZE]), queue[g, MARKS]
        queue[g, MARKS] = 0
        entered = marks  # nodes from which turns must be tried; a node improved by a turn needs no second one
        if members > 1 and uniform:  # only turns to the nearest node matter
            nearest = UNREACHABLE
            for i in range(members):
                v = offset + i
                if (marks >> (v & IN_WORD)) & 1 and out[v] < nearest:
                    nearest, entered = out[v], one << (v & IN_WORD)
        for i in range(members if members > 1 else 0):
            v = offset + i
            if not (entered >> (v & IN_WORD)) & 1:
                continue
            d, column = out[v], rows[g, TURNS] + i
            for k in range(members):
                u = offset + k
                w = dearest[g] if uniform else turns[column + k * members]
                cost = max(d, w) if is_max else d + w
                if cost < out[u]:
                    out[u], onward[u] = cost, v
                    marks |= one << (u & IN_WORD)
                    entered &= ~(one << (u & IN_WORD))
        own, end, shift = np.int64(rows[g, BEGIN]), np.int64(rows[g, END]), rows[g, SHIFT]
        for a in range(own, end + begin_joins[g + 1] - begin_joins[g]):
            if a < end:
                word = arcs[a]
                v, u = offset + (word & in_group), shift + ((word >> member_bits) & in_layer)
                w = word >> (member_bits + node_bits)
            else:
                join = begin_joins[g] + a - end
                v, u, w = joined[join], joined_from[join], join_costs[join]
            if not (marks >> (v & IN_WORD)) & 1:
                continue
            d = out[v]
            cost = max(d, w) if is_max else d + w
            if cost >= out[u]:
                continue
            out[u], onward[u] = cost, v
            tail = np.int64(group[u])
            queue[tail, MARKS] |= one << (u & IN_WORD)
            slot, before = cost // width, queue[tail, SLOT]
            if before < 0 or slot < before:
                if before < 0:
                    waiting += 1
                else:
                    remove_group(tail, queue, buckets)
                append_group(tail, slot, queue, buckets)
    progress[0], progress[1] = bucket, waiting
    beyond = UNREACHABLE
    if until < UNREACHABLE:
        for node in range(len(out)):
            if until < out[node] < beyond:
                beyond = out[node]
    return int(beyond)
