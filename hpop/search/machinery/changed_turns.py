"""Update of the groups of turns after a local change of a graph: only groups with changed arcs are computed again.

A group is a set of nodes that are joined by turns, such as the headings at one position (:mod:`.machinery.turns`).
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, numbered
from hpop.runtime.compiled import lean
from hpop.runtime.limits import Budget
from hpop.search.graph import Graph
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turn_costs import (
    GROUP_COLUMNS,
    OFFSET,
    SIZE,
    SLOTS,
    TURNS,
    costs_of_plain_arcs,
    index_costs,
    no_dearer_than_two,
    write_turn_costs,
)
from hpop.search.machinery.turns import Groups, number_groups, separate_turns

MOST_UNUSED = 2  # size of a table of turns relative to what its groups need, above which it is made anew
# The groups before and after a change share a table: new turns are written to its spare columns. FREE in the first row
# marks a spare column, so that two changes of the same graph do not write to one.
FREE = -1
_writing = threading.Lock()


def take_over_groups(before: Graph, graph: Graph, nodes: IntArray) -> None:
    """Derive the groups of turns of a graph from those of the graph ``before`` a local change, and cache them.

    They are equal to groups computed from scratch. Nothing is cached if only a computation from scratch can find them,
    for example because the change splits a group.

    nodes  (n,)  for each node of ``graph``, the node of ``before`` with the same arcs, or -1 if its arcs changed;
                 the heads of the arcs may have other numbers
    """
    for key, groups in list(before.cache.items()):
        if isinstance(groups, Groups) and key == ("groups", groups.column):
            changed = _updated(groups, before, graph, nodes)
            if changed is not None:
                graph.cache[key] = changed


def _updated(groups: Groups, before: Graph, graph: Graph, nodes: IntArray) -> Groups | None:
    """Return the groups of the changed graph; None if they must be computed from scratch.

    The arguments are those of :func:`take_over_groups`, and the groups of the graph ``before`` the change.
    """
    clock, n = Clock(Budget(), None), graph.nodes
    raised = index_costs(graph, groups.column)
    whole, new_sizes = _whole_groups(groups, nodes), _sizes_of_changed_groups(groups, graph, nodes, raised, clock)
    if whole is None or new_sizes is None:
        return None
    kept, changed, old_sizes = np.flatnonzero(nodes >= 0), np.flatnonzero(nodes < 0), groups.rows[whole, SIZE]
    first = [of[np.cumsum(sizes) - sizes] for of, sizes in ((kept, old_sizes), (changed, new_sizes))]
    order = np.argsort(np.concatenate(first))
    is_new = order >= whole.size
    rows = np.zeros((order.size, GROUP_COLUMNS), np.int64)
    rows[:, OFFSET], rows[:, SIZE] = np.concatenate(first)[order], np.concatenate([old_sizes, new_sizes])[order]

    # Arcs of the changed nodes are separated into turns and plain arcs; the others keep their plain arcs.
    degrees = np.diff(graph.indptr)
    arcs = np.flatnonzero(np.repeat(nodes < 0, degrees))
    own = np.append(0, np.cumsum(np.where(nodes < 0, degrees, 0))), *graph.ends_and_costs(arcs)
    for array in own:
        array.setflags(write=False)  # as the arrays of a graph, for which kernels are compiled
    tables = (*own, groups.column, np.arange(n), np.arange(n), rows[is_new])
    start, heads, plain = np.empty(n + 1, np.int64), np.empty(arcs.size, np.int32), np.empty(arcs.size, np.int32)
    new_dearest, alike = np.zeros((new_sizes.size, graph.criteria), np.int64), np.ones(graph.criteria, np.bool_)
    m = clock.call(separate_turns, *tables, start, heads, plain, new_dearest, alike)
    dearest = np.empty((order.size, graph.criteria), np.int64)
    dearest[is_new], dearest[~is_new] = new_dearest, groups.dearest[whole]
    start[changed + 1] = np.append(start[changed[1:]], m)[: changed.size]
    ends, (origin, joined) = np.zeros(n + 1, np.int64), np.empty((2, groups.origin.size + m), np.int32)
    old, now = (groups.start, groups.origin, before.indptr), (graph.indptr, graph.heads, *raised)
    size = clock.call(join_plain_arcs, nodes, *old, start, arcs[plain[:m]].astype(np.int32), *now, ends, joined, origin)
    if size < 0:
        return None

    turns = np.zeros((graph.criteria, 0), np.int64)
    if groups.turns.size:
        turns = _written_turns(groups, whole, rows, is_new, tables, clock)
        for j in np.flatnonzero(alike & ~groups.alike).tolist():  # groups that differed may be gone
            alike[j] = not clock.call(turns_differ, rows, dearest, turns, j)
    elif not alike.all():
        return None
    worst = np.array([aggregate == "max" for aggregate in graph.aggregates])
    if turns.size and not clock.call(no_dearer_than_two, rows[is_new], turns, alike, worst):
        return None
    turns = turns[:, :0].copy() if alike.all() else turns
    numbers, (joined, origin) = np.arange(n), (joined[:size], origin[:size])
    ends_and_costs = joined, origin, costs_of_plain_arcs(graph, origin)
    return Groups(groups.column, groups.step, numbers, numbers, rows, dearest, alike, turns, ends, *ends_and_costs)


def _whole_groups(groups: Groups, nodes: IntArray) -> IntArray | None:
    """Return the indices of the groups whose nodes are all unchanged, in order.

    The result is None if only a part of a group is unchanged, or if the order of nodes changed.

    nodes  (n,)  for each node of the changed graph, the node before the change with the same arcs, or -1
    """
    kept = np.flatnonzero(nodes >= 0)
    old = nodes[kept]
    number = np.repeat(np.arange(len(groups.rows)), groups.rows[:, SIZE])[old]
    is_first = groups.rows[number, OFFSET] == old
    whole: IntArray = number[is_first]
    sizes = groups.rows[whole, SIZE]
    if int(sizes.sum()) != old.size or (np.diff(groups.nodes) != 1).any() or (np.diff(old) <= 0).any():
        return None
    together = np.array_equal(np.repeat(whole, sizes), number)
    return whole if together and np.array_equal(np.repeat((kept - old)[is_first], sizes), kept - old) else None


def _sizes_of_changed_groups(
    groups: Groups, graph: Graph, nodes: IntArray, raised: tuple[IntArray, int], clock: Clock
) -> IntArray | None:
    """Return the sizes of the groups that the changed nodes form, in order of their nodes.

    The result is None if their turns form no groups, or groups whose nodes are not consecutive numbers.

    groups  groups before the change
    nodes   (n,)  for each node of ``graph``, the node before the change with the same arcs, or -1 if its arcs changed
    raised  table of index costs, see :func:`.index_costs`
    """
    changed, group = np.flatnonzero(nodes < 0), np.full(graph.nodes, -1)
    tables = (graph.indptr, graph.heads, *raised, nodes >= 0)  # follow turns of changed nodes only
    count, step, _ = clock.call(number_groups, *tables, group, np.zeros_like(group), group.copy())
    if count == 0 or step not in (0, groups.step):
        return None
    begins = np.flatnonzero(np.append(True, np.diff(group[changed]) != 0)[: changed.size])
    sizes: IntArray = np.diff(np.append(begins, changed.size))
    offset = changed - np.arange(changed.size)  # constant within a range of nodes
    are_ranges = np.unique(group[changed]).size == sizes.size and np.array_equal(
        np.repeat(offset[begins], sizes), offset
    )
    return sizes if are_ranges else None


def _written_turns(
    groups: Groups, whole: IntArray, rows: IntArray, is_new: BoolArray, tables: tuple[Any, ...], clock: Clock
) -> IntArray:
    """Return the turn costs of unchanged and new groups in one table, and write each group's offset in it to ``rows``.

    If the spare columns of the old table suffice, they are filled in place, and the old table is returned.

    groups  groups before the change, with the old table
    whole   indices of the groups that are unchanged
    rows    (g, 3)  all groups after the change, see :class:`.Groups`
    is_new  (g,)  True for groups that changed
    tables  first arguments of :func:`write_turn_costs`, with the rows of the new groups
    """
    new, table, begins = tables[-1], groups.turns, groups.rows[whole, TURNS]
    used = int((groups.rows[:, TURNS] + groups.rows[:, SIZE] ** 2).max())
    own = np.empty((len(table), int((new[:, SIZE] ** 2).sum())), np.int64)
    _, size = clock.call(write_turn_costs, *tables, 0, 0, own, np.zeros((SLOTS, 3), np.int64))
    with _writing:
        if has_room := used + size < table.shape[1] and table[0, used] == FREE and table.flags.writeable:
            table[:, used : used + size] = own[:, :size]
    if not has_room:
        offsets, first, which = np.unique(begins, return_index=True, return_inverse=True)
        pairs = groups.rows[whole[first], SIZE] ** 2
        if used > MOST_UNUSED * pairs.sum():  # without the turns of groups that are gone
            group, pair = numbered(pairs)
            table, begins = table[:, offsets[group] + pair], (np.cumsum(pairs) - pairs)[which]
            used = table.shape[1]
        larger = np.empty((len(table), MOST_UNUSED * (int(pairs.sum()) + size) + 1), np.int64)
        larger[:, :used], larger[:, used : used + size] = table[:, :used], own[:, :size]
        larger[0, used + size :], larger[:, -1] = FREE, 0
        table = larger
    new[:, TURNS] += used
    rows[~is_new, TURNS], rows[is_new] = begins, new
    return table


@lean
def join_plain_arcs(
    nodes: IntArray,
    old_start: IntArray,
    old_origin: NDArray[np.int32],
    old_indptr: IntArray,
    start: IntArray,
    plain: NDArray[np.int32],
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    column: int,
    ends: IntArray,
    joined: NDArray[np.int32],
    origin: NDArray[np.int32],
) -> int:
    """Join the plain arcs of unchanged and changed nodes; return their number.

    The result is -1 if an arc raises the cost of ``column``: then other arcs may decide whether it is a turn.

    nodes (n,)                          node before the change, or -1, of each node, see :func:`take_over_groups`
    old_start, old_origin, old_indptr   plain arcs and offsets of arcs before the change
    start, plain                        the plain arcs of a changed node v are plain[start[v] : start[v + 1]]
    indptr, heads, costs                arcs of the changed graph, see :class:`.Graph`
    ends, joined, origin                output: the table ``start`` of :class:`.Groups`, 0 before the call, heads, arcs
    """
    m = 0
    for v in range(len(nodes)):
        u = nodes[v]
        for i in range(old_start[u], old_start[u + 1]) if u >= 0 else range(start[v], start[v + 1]):
            a = old_origin[i] + indptr[v] - old_indptr[u] if u >= 0 else np.int64(plain[i])
            if costs[a, column] != 0:
                return -1
            origin[m], joined[m] = a, heads[a]
            m += 1
        ends[v + 1] = m
    return m


@lean
def turns_differ(rows: IntArray, dearest: IntArray, turns: IntArray, column: int) -> bool:
    """Return whether in any group two turns differ in the cost of a column.

    rows, dearest, turns  groups and costs of their turns, see :class:`.Groups`
    column                column of the cost
    """
    for g in range(len(rows)):
        size = rows[g, SIZE]
        for u in range(size):
            for v in range(size):
                if u != v and turns[column, rows[g, TURNS] + u * size + v] != dearest[g, column]:
                    return True
    return False
