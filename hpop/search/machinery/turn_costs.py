"""Table of the costs of turns within groups of nodes (:mod:`.machinery.turns`); equal groups share its columns.

A group is a set of nodes of which each is joined to each other one by a turn (headings at one position of a lattice).
On a lattice most positions have the same turns, so the table is small and stays in the processor's cache. A group is a
row of ``rows`` (g, 3): its first node (OFFSET), number of nodes (SIZE) and first column in the table (TURNS).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel
from hpop.runtime.limits import Status
from hpop.search.graph import Graph
from hpop.search.machinery.slices import Clock

OFFSET, SIZE, TURNS, GROUP_COLUMNS = range(4)
FEW_PAIRS = 2**16  # number of columns of the table at first; as groups share them, they suffice for most graphs
SLOTS, PROBES = 2**12, 8  # size of the hash table of groups, and number of slots that are tried for a group
CHECKSUM = 2**40 - 1
PART = 2**19  # number of arcs whose costs are copied at a time


class NoRoom(Exception):
    """Error raised if tables of groups need more memory than the search's limit allows."""


def check_room(clock: Clock, memory: int) -> None:
    """Raise NoRoom if ``memory`` bytes exceed the memory limit of the clock."""
    if clock.exceeded(0, memory, record=False) is Status.MEMORY_LIMIT:
        raise NoRoom


def index_costs(graph: Graph, column: int) -> tuple[IntArray, int]:
    """Return a table with the index costs of all arcs in a column, and this column."""
    return (graph.costs, column) if graph.has_costs else (graph.cost(column).astype(np.int64)[:, None], 0)


def costs_of_plain_arcs(graph: Graph, origin: NDArray[np.int32]) -> IntArray | None:
    """Return the costs (m, k) of plain arcs (arcs that are no turns); None if the graph stores the costs of all arcs.

    origin  (m,)  indices of the plain arcs in the graph
    """
    if graph.has_costs:
        return None
    costs = graph.ends_and_costs(origin)[1]
    costs.setflags(write=False)  # as the costs of a graph, for which kernels are compiled
    return costs


def parts_of_arcs(
    graph: Graph, nodes: IntArray, rows: IntArray
) -> Iterator[tuple[tuple[int, int], tuple[int, int], tuple[Any, ...]]]:
    """Yield ranges of groups, the ranges of their nodes, and arcs: offsets of all nodes, and heads and costs.

    Without an array of all costs, the costs of one range are copied at a time, and the offsets of its nodes count from
    its first arc.

    nodes, rows  numbers of nodes and groups, see :class:`.Groups`
    """
    whole = (0, len(rows)), (0, graph.nodes)
    if graph.has_costs or graph.base is not None:
        yield *whole, (graph.indptr, graph.heads, graph.costs)
        return
    ends, offsets = np.append(rows[:, OFFSET], graph.nodes), np.empty_like(graph.indptr)
    closed = np.maximum.accumulate(nodes)[ends[1:] - 1] < ends[1:]  # groups whose nodes and those before are a range
    last_groups, step = np.flatnonzero(closed) + 1, max(1, len(rows) * PART // max(1, graph.arcs))
    last = 0
    while last < len(rows):
        first, last = last, int(last_groups[np.searchsorted(last_groups, min(last + step, len(rows)))])
        begin, end = ends[[first, last]].tolist()
        arcs = slice(int(graph.indptr[begin]), int(graph.indptr[end]))
        offsets[begin : end + 1] = graph.indptr[begin : end + 1] - arcs.start
        yield (first, last), (begin, end), (offsets, *graph.ends_and_costs(arcs))


def shared_turns(
    criteria: int, rows: IntArray, parts: Iterable[tuple[Any, ...]], memory: int, clock: Clock
) -> IntArray:
    """Return the table (k, t) of turn costs of all groups, and write each group's first column in it to ``rows``.

    Groups with equal costs share their columns.

    criteria  number of costs, k
    rows      (g, 3)  all groups
    parts     first arguments of :func:`write_turn_costs`, up to ``rows``, for each range of groups
    memory    bytes in use already
    clock     its memory limit applies; NoRoom is raised if the table does not fit
    """
    pairs = int((rows[:, SIZE] ** 2).sum())
    turns = np.zeros((criteria, min(pairs, FEW_PAIRS)), np.int64)
    slots, used = np.zeros((SLOTS, 3), np.int64), 0
    for tables in parts:
        done = 0
        while True:
            done, used = clock.call(write_turn_costs, *tables, done, used, turns, slots)
            if done == len(tables[-1]):
                break
            columns = min(pairs, 4 * turns.shape[1])
            check_room(clock, memory + (columns + turns.shape[1]) * criteria * turns.itemsize)
            larger = np.zeros((criteria, columns), np.int64)
            larger[:, :used] = turns[:, :used]
            turns = larger
    return np.concatenate([turns[:, :used], np.zeros((criteria, 1), np.int64)], axis=1)  # single nodes do not turn


@kernel
def write_turn_costs(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    column: int,
    nodes: IntArray,
    new_number: IntArray,
    rows: IntArray,
    first: int,
    used: int,
    turns: IntArray,
    slots: IntArray,
) -> tuple[int, int]:
    """Copy the costs of turns to the table `turns` (k, t): a row for each cost, a block of columns for each group.

    A turn is an arc between two nodes of a group that has a positive cost in `column`. A group of size s has s * s
    columns; the turn from its i-th to its j-th node is in column i * s + j of them. The first column of each group is
    written to `rows`. Groups with equal costs share their columns, if an equal group is found within PROBES slots of a
    hash table. Returns the number of groups that are done, fewer than all if the table is full, and the number of
    columns in use. If groups are left, call again with a larger table.

    indptr, heads, costs  arcs of the graph, see :class:`.Graph`
    column                column of `costs` that tells turns from other arcs
    nodes, new_number     numbers of nodes, see :class:`.Groups`
    rows                  (g, 3)  groups; the column TURNS is written
    first                 group to begin with
    used                  number of columns of `turns` in use already
    slots                 (SLOTS, 3)  hash table of groups: checksum + 1, first column in `turns`, size; filled with
                          0 by the caller before the first call
    """
    for g in range(first, len(rows)):
        offset, size = rows[g, OFFSET], rows[g, SIZE]
        end = used + size * size
        if end > turns.shape[1]:
            return g, used
        turns[:, used:end] = 0
        for p in range(offset, offset + size):
            u = nodes[p]
            for a in range(indptr[u], indptr[u + 1]):
                to = new_number[heads[a]] - offset
                if costs[a, column] > 0 and heads[a] != u and 0 <= to < size:
                    for j in range(len(turns)):
                        turns[j, used + (p - offset) * size + to] = costs[a, j]
        checksum = np.int64(size)
        for j in range(len(turns)):
            for i in range(used, end):
                checksum = ((checksum << 5) ^ (checksum >> 13) ^ turns[j, i]) & CHECKSUM
        rows[g, TURNS] = used
        for probe in range(PROBES):
            slot = (checksum + probe) % SLOTS
            if slots[slot, 0] == 0:
                slots[slot, 0], slots[slot, 1], slots[slot, 2] = checksum + 1, used, size
                break
            other = slots[slot, 1]
            same = slots[slot, 0] == checksum + 1 and slots[slot, 2] == size
            for j in range(len(turns) if same else 0):
                for i in range(size * size):
                    same = same and turns[j, other + i] == turns[j, used + i]
            if same:
                rows[g, TURNS] = other
                break
        if rows[g, TURNS] == used:
            used = end
    return len(rows), used


@kernel
def no_dearer_than_two(rows: IntArray, turns: IntArray, alike: NDArray[np.bool_], worst: NDArray[np.bool_]) -> bool:
    """Return whether no turn costs more, in any cost, than two turns in a row between the same nodes.

    rows, turns, alike  groups and costs of their turns, see :class:`.Groups`
    worst               (k,)  True for a cost of which a path has the maximum over its arcs, not the sum
    """
    dearer = False
    for j in range(len(alike)):
        if alike[j]:
            continue
        for g in range(len(rows)):
            size = rows[g, SIZE]
            for u in range(size):
                ahead = rows[g, TURNS] + u * size
                for v in range(size):
                    first, after = turns[j, ahead + v], rows[g, TURNS] + v * size
                    for w in range(size):
                        second = turns[j, after + w]
                        dearer |= turns[j, ahead + w] > (max(first, second) if worst[j] else first + second)
    return not dearer
