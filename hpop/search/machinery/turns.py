"""Groups of nodes that are joined by turns, which save labels (partial paths) in a search.

An example is the lattice of Becerra et al. 2020 (arXiv 2002.10696): the nodes of a group are the headings at one
position, and the arcs between them are turns in place.

Choose one cost, the index. Arcs with a positive index cost are called turns, other arcs plain. Arcs from a node that no
arc enters, and to a node that no arc leaves, are plain in any case, since arcs from a start and to a goal may turn and
move. Turns form groups if each node of a group is joined to each other one by exactly one turn, if all turns have the
same index cost, and if no turn costs more, in any cost, than two turns in a row between the same nodes. All of this is
checked arc by arc, so nothing is assumed of the graph. Then

- a path never needs two turns in a row. So a label is generated only where a plain arc arrives (or a turn reaches a
  target); its successors are "an arc" and "a turn, then an arc".
- if turns do not raise the first cost of the search, a label g can also be dominated by a closed label at another node
  of its group: if that label, plus the dearest turn of the group, is nowhere larger than g, as it could turn to this
  node. First costs are comparable, because their bound is the same at all nodes of a group.
- a label after a turn likewise counts as closed at its node, as all its successors are generated at once.
- if moreover all turns of a group have equal costs, a label needs no turns if it is no better than a closed label at
  any node of its group: the other label has made these turns. For lower bounds, the best node of a group likewise
  represents all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray, inserted, inserted_in_layers, numbered, tiled
from hpop.runtime.compiled import kernel, lean
from hpop.search.graph import Graph
from hpop.search.machinery.slices import PARTS, Clock
from hpop.search.machinery.turn_costs import (
    GROUP_COLUMNS,
    OFFSET,
    SIZE,
    TURNS,
    NoRoom,
    check_room,
    costs_of_plain_arcs,
    index_costs,
    no_dearer_than_two,
    parts_of_arcs,
    shared_turns,
)

__all__ = ["GROUP_COLUMNS", "OFFSET", "SIZE", "TURNS", "Groups", "NoRoom"]

MOST = 1024  # upper bound of the index cost of a turn
CACHED = 2**26  # bytes: smaller tables are cached with the graph for its next query
ENTERED = -2  # in `number_groups`, marks nodes that some arc enters
NODE, ARC = 24, 8  # bytes that groups need for each node, also while they are searched, and for each plain arc


@dataclass(frozen=True, eq=False)
class Groups:
    """Groups of nodes that are joined by turns, and the plain arcs: all arcs that are no turns.

    Nodes are renumbered so that each group is a range of numbers. A node without turns is a group of its own.

    column      column of the index, the cost that turns raise; -1 if there are no turns
    step        amount by which every turn raises this cost; 0 if there are no turns
    nodes       (n,)      node of the graph at each new number
    new_number  (n,)      new number of each node of the graph
    rows        (g, 3)    for each group: new number of its first node, number of nodes, first column in ``turns``;
                          groups with equal costs may share columns
    dearest     (g, k)    for each group and cost: the largest cost of a turn
    alike       (k,)      for each cost: True if within every group all turns cost the same
    turns       (k, t)    costs of turns, a column for each ordered pair of nodes of a group, then a column of 0; before
                          it, columns may be unused after a change. Empty if all costs are alike
    start       (n + 1,)  the plain arcs of the node with the new number v are start[v] : start[v + 1]
    heads       (m,)      heads of the plain arcs, in new numbers
    origin      (m,)      indices of the plain arcs in the graph
    plain       (p, k)    costs of the plain arcs of a graph without an array of all costs, or None; the layers of a
                          graph share them
    priced      (m,)      row of each plain arc in ``plain``; None if each has its own row, in their order
    """

    column: int
    step: int
    nodes: IntArray
    new_number: IntArray
    rows: IntArray
    dearest: IntArray
    alike: NDArray[np.bool_]
    turns: IntArray
    start: IntArray
    heads: NDArray[np.int32]
    origin: NDArray[np.int32]
    plain: IntArray | None = None
    priced: NDArray[np.int32] | None = None

    @property
    def nbytes(self) -> int:
        """Size of all arrays, bytes."""
        return sum(array.nbytes for array in vars(self).values() if isinstance(array, np.ndarray))

    def costs_of_arcs(self, graph: Graph) -> tuple[IntArray, NDArray[np.int32]]:
        """Return a table of arc costs, and the row of this table for each plain arc (m,)."""
        if self.plain is None:
            return graph.costs, self.origin
        own = np.arange(len(self.plain), dtype=np.int32) if self.priced is None else self.priced
        return self.plain, own

    @classmethod
    def of(cls, graph: Graph, clock: Clock, *, has_arcs: bool = True) -> Self:
        """Return the groups of turns of a graph; if its turns form no groups, each node is a group.

        If not ``has_arcs``, groups of one node each lack the plain arcs of a graph with layers.

        The index is the cost that ``graph.turns`` names, or else the sum whose largest arc cost is smallest.

        Raises NoRoom, before memory is allocated, if the clock's memory limit does not suffice.
        """
        most = graph.largest.tolist()
        sums = [j for j, aggregate in enumerate(graph.aggregates) if aggregate == "sum" and 0 < most[j] < MOST]
        column = graph.turns if graph.turns in sums else min(sums, key=lambda j: most[j], default=-1)
        return (cls.of_turns(graph, column, clock) if column >= 0 else None) or cls.single_nodes(
            graph, clock, has_arcs=has_arcs
        )

    @classmethod
    def of_turns(cls, graph: Graph, column: int, clock: Clock) -> Self | None:
        """Return the groups of turns with ``column`` as index, or None if these turns form no groups."""
        base = graph.base
        if base is not None and (graph.layers > 1 or _keeps_groups(graph, column)):
            name = ("groups", column)
            if name not in base.cache:
                base.cache[name] = cls.of_turns(base, column, clock)
            groups: Self | None = base.cache[name]
            if groups is None:  # then the layers have no groups either
                return None
            if graph.layers == 1 or _keeps_groups(graph, column):
                return groups._extended(graph, base, clock)
        if ("groups", column) in graph.cache:
            known: Self | None = graph.cache["groups", column]
            return known
        own = cls._computed(graph, column, clock)
        if own is None or (clock.budget.max_memory is None and own.nbytes <= CACHED):
            graph.cache["groups", column] = own
        return own

    def _extended(self, graph: Graph, base: Graph, clock: Clock, *, has_arcs: bool = True) -> Self:
        """Return the groups of a graph that repeats and extends ``base``, the graph of these groups.

        Each added node is a group of its own; the groups of the base stay as they are. If not ``has_arcs``, the result
        lacks the plain arcs.
        """
        layers, n, m, added = graph.layers, base.nodes, len(self.heads), graph.added
        name, ends = ("plain arcs", self.column), np.arange(layers * n, graph.nodes)
        copies = 1 if name in base.cache else 2  # one is cached
        shared = self.turns.nbytes + copies * self.origin.size * graph.criteria * base.indptr.itemsize
        check_room(clock, layers * (self.nbytes - self.turns.nbytes) + shared)
        ends_as_groups = np.zeros((len(ends), GROUP_COLUMNS), np.int64)
        ends_as_groups[:, OFFSET], ends_as_groups[:, SIZE] = ends, 1
        ends_as_groups[:, TURNS] = max(0, self.turns.shape[1] - 1)  # they do not turn
        rows = np.concatenate([*[self.rows] * layers, ends_as_groups])
        rows[: layers * len(self.rows), OFFSET] = tiled(self.rows[:, OFFSET], layers, n)
        nodes = np.concatenate([tiled(self.nodes, layers, n), ends])
        is_same = np.array_equal(self.nodes, self.new_number)  # usually the numbers stay: one array, to save memory
        new_number = nodes if is_same else np.concatenate([tiled(self.new_number, layers, n), ends])
        groups = replace(
            self,
            nodes=nodes,
            new_number=new_number,
            rows=rows,
            dearest=np.concatenate([*[self.dearest] * layers, np.zeros((len(ends), graph.criteria), np.int64)]),
        )
        if not has_arcs:
            return replace(groups, start=self.start[:1], heads=self.heads[:0], origin=self.origin[:0])
        if name not in base.cache:
            costs, priced = self.costs_of_arcs(base)
            base.cache[name] = costs if self.plain is not None and self.priced is None else costs[priced]
        tails = np.searchsorted(graph.indptr, added.places, side="right") - 1
        order = np.argsort(new_number[tails], kind="stable")
        at = np.append(tiled(self.start[:-1], layers, m), np.full(len(ends) + 1, layers * m))
        before = at[new_number[tails[order]] + 1]
        shift = graph.indptr[: layers * n].reshape(layers, n) - base.indptr[:-1]  # of the arcs of each node
        origin = (self.origin + np.repeat(shift[:, self.nodes], np.diff(self.start), axis=1).astype(np.int32)).ravel()
        plain = np.concatenate([base.cache[name], added.costs])
        plain.setflags(write=False)  # as the costs of a graph, for which kernels are compiled
        return replace(
            groups,
            start=at + np.append(0, np.cumsum(np.bincount(new_number[tails], minlength=graph.nodes))),
            heads=inserted_in_layers(self.heads, layers, before, new_number[added.heads[order]].astype(np.int32), n),
            origin=inserted(origin, before, added.places[order].astype(np.int32)),
            plain=plain,
            priced=inserted_in_layers(np.arange(m, dtype=np.int32), layers, before, (m + order).astype(np.int32)),
        )

    def unshared(self) -> Self:
        """Return the same groups with their own data only, as some kernels need them.

        Each group gets its own columns of turn costs. Costs of plain arcs are read from the graph's own table.
        """
        if not self.turns.size:
            return replace(self, plain=None, priced=None)
        rows = self.rows.copy()
        group, pair = numbered(self.rows[:, SIZE] ** 2)
        rows[:, TURNS] = np.cumsum(rows[:, SIZE] ** 2) - rows[:, SIZE] ** 2
        turns = self.turns[:, np.append(self.rows[group, TURNS] + pair, self.turns.shape[1] - 1)]
        return replace(self, rows=rows, turns=turns, plain=None, priced=None)

    @classmethod
    def _computed(cls, graph: Graph, column: int, clock: Clock) -> Self | None:
        check_room(clock, graph.nodes * NODE + graph.bytes_to_copy)
        group = np.full(graph.nodes, -1)
        tables = (graph.indptr, graph.heads, *index_costs(graph, column), np.zeros(graph.nodes, np.bool_))
        count, step, turns = clock.call(number_groups, *tables, group, np.zeros_like(group), group.copy())
        if step == 0:
            return None
        nodes = np.argsort(group, kind="stable") if (np.diff(group) < 0).any() else np.arange(graph.nodes)
        rows = np.zeros((count, GROUP_COLUMNS), np.int64)
        rows[:, SIZE] = np.bincount(group, minlength=count)
        rows[1:, OFFSET] = np.cumsum(rows[:-1, SIZE])
        groups = cls._with_arcs(graph, column, step, nodes, rows, graph.arcs - turns, clock)
        worst = np.array([aggregate == "max" for aggregate in graph.aggregates])
        _, distinct = np.unique(rows[:, TURNS], return_index=True)
        checks = [(part, groups.turns, groups.alike, worst) for part in np.array_split(rows[distinct], PARTS)]
        return groups if all(clock.call_all(no_dearer_than_two, checks)) else None

    @classmethod
    def single_nodes(cls, graph: Graph, clock: Clock, *, has_arcs: bool = True) -> Self:
        """Return groups of one node each, so that all arcs are plain; for ``has_arcs`` see :meth:`of`."""
        groups: Self | None = graph.cache.get("single nodes")
        if groups is not None:
            check_room(clock, groups.nbytes)
            return groups
        if graph.layers > 1:
            return cls.single_nodes(graph.layer, clock)._extended(graph, graph.layer, clock, has_arcs=has_arcs)
        rows = np.zeros((graph.nodes, GROUP_COLUMNS), np.int64)
        rows[:, OFFSET], rows[:, SIZE] = np.arange(graph.nodes), 1
        groups = cls._with_arcs(graph, -1, 0, np.arange(graph.nodes), rows, graph.arcs, clock)
        if clock.budget.max_memory is None and groups.nbytes <= CACHED:
            graph.cache["single nodes"] = groups
        return groups

    @classmethod
    def _with_arcs(
        cls, graph: Graph, column: int, step: int, nodes: IntArray, rows: IntArray, plain: int, clock: Clock
    ) -> Self:
        most = graph.nodes * NODE + rows.nbytes + plain * ARC
        check_room(clock, most)
        new_number = nodes  # usually the numbers stay: one array, to save memory
        if (nodes[:-1] > nodes[1:]).any():
            new_number = np.empty(graph.nodes, np.int64)
            new_number[nodes] = np.arange(graph.nodes)
        start = np.empty(graph.nodes + 1, np.int64)
        heads, origin = np.empty(plain, np.int32), np.empty(plain, np.int32)
        dearest = np.zeros((len(rows), graph.criteria), np.int64)
        alike = np.ones(graph.criteria, np.bool_)
        numbers, m = (column, nodes, new_number), 0
        for (first, last), (begin, end), part in parts_of_arcs(graph, nodes, rows):
            own = (*part, *numbers, rows[first:last], start, heads[m:], origin[m:], dearest[first:last], alike)
            moves = clock.call(separate_turns, *own)
            start[begin:end] += m
            origin[m : m + moves] += graph.indptr[begin].astype(np.int32)
            m += moves
        start[-1] = m
        turns = np.zeros((graph.criteria, 0), np.int64)
        if not alike.all():
            parts = (
                (*part, *numbers, rows[first:last]) for (first, last), _, part in parts_of_arcs(graph, nodes, rows)
            )
            turns = shared_turns(graph.criteria, rows, parts, most, clock)
        plain_costs = costs_of_plain_arcs(graph, origin[:m])
        return cls(
            column, step, nodes, new_number, rows, dearest, alike, turns, start, heads[:m], origin[:m], plain_costs
        )


def _keeps_groups(graph: Graph, column: int) -> bool:
    """Return whether the groups of the graph's base, with turns in ``column``, are groups of this graph.

    A turn is an arc with a positive cost in ``column``. An added turn must leave an added node that no added arc
    enters, or enter an added node that no added arc leaves. Of layers, added arcs must leave only nodes that arcs
    leave in the base, and enter only nodes that arcs enter in the base, or added nodes.
    """
    base, added = graph.layer, graph.added
    n = graph.layers * base.nodes
    tails, heads = np.searchsorted(graph.indptr, added.places, side="right") - 1, added.heads
    first, last = (tails >= n) & ~np.isin(tails, heads), (heads >= n) & ~np.isin(heads, tails)
    if not (first | last)[added.costs[:, column] > 0].all():
        return False
    if graph.layers == 1:
        return True
    is_left, is_entered = np.diff(base.indptr) > 0, np.zeros(base.nodes, np.bool_)
    is_entered[base.heads] = True
    return bool(is_left[tails[tails < n] % base.nodes].all() and is_entered[heads[heads < n] % base.nodes].all())


@lean
def number_groups(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    index: int,
    skipped: NDArray[np.bool_],
    group: IntArray,
    size: IntArray,
    last_tail: IntArray,
) -> tuple[int, Any, int]:
    """Find the groups of nodes that turns join, and check that turns join each node of a group to each other one once.

    All turns must have the same index cost. Returns the number of groups, this index cost, and the number of turns; all
    0 if turns form no groups. A graph without turns has a group for each node, and the index cost 0.

    indptr, heads, costs  arcs of the graph, see :class:`.Graph`
    index                 column of the cost that turns raise
    skipped               (n,)  True for nodes whose turns are not followed; changed
    group                 (n,)  output, group of each node; -1 before the call
    size                  (n,)  scratch, number of nodes of each group; 0 before the call
    last_tail             (n,)  scratch; -1 before the call
    """
    count, turns = 0, 0
    step: Any = np.int64(0)
    for a in range(len(heads)):
        last_tail[heads[a]] = ENTERED
    for u in range(len(group)):
        skipped[u] = skipped[u] or last_tail[u] != ENTERED  # turns of nodes that no arc enters do not matter
    for u in range(len(group)):
        new = group[u] < 0
        if new:
            group[u] = count
            size[count] = 1
            count += 1
        joined = 1
        for a in range(indptr[u], indptr[u] if skipped[u] else indptr[u + 1]):
            v = heads[a]
            if costs[a, index] == 0 or v == u or indptr[v] == indptr[v + 1]:
                continue
            if new:
                if group[v] >= 0:
                    return 0, 0, 0
                step = costs[a, index] if step == 0 else step
                group[v] = group[u]
                size[group[u]] += 1
            if costs[a, index] != step or group[v] != group[u] or last_tail[v] == u:
                return 0, 0, 0
            last_tail[v] = u
            joined += 1
        if joined != size[group[u]]:
            return 0, 0, 0
        turns += joined - 1
    return count, step, turns


@kernel
def separate_turns(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    column: int,
    nodes: IntArray,
    new_number: IntArray,
    rows: IntArray,
    start: IntArray,
    plain: NDArray[np.int32],
    origin: NDArray[np.int32],
    dearest: IntArray,
    alike: NDArray[np.bool_],
) -> int:
    """Separate arcs into turns and plain arcs; return the number of plain arcs.

    Loops from a node to itself are neither, and are left out.

    indptr, heads, costs     arcs of the graph, see :class:`.Graph`
    column                   column of the index, the cost that turns raise; -1: all arcs are plain
    nodes, new_number, rows  numbers of nodes and groups, see :class:`Groups`

    Written are `start`, `plain` (heads of the plain arcs), `origin`, `dearest` (0 before the call) and `alike` (True
    before the call), see :class:`Groups`.
    """
    k = costs.shape[1]
    m = 0
    for g in range(len(rows)):
        first = -1
        offset, end = rows[g, OFFSET], rows[g, OFFSET] + rows[g, SIZE]
        for p in range(offset, end):
            start[p] = m
            u = nodes[p]
            for a in range(indptr[u], indptr[u + 1]):
                if heads[a] == u:
                    continue
                to = new_number[heads[a]]
                if column < 0 or costs[a, column] == 0 or not offset <= to < end:
                    plain[m] = to
                    origin[m] = a
                    m += 1
                else:
                    first = a if first < 0 else first
                    for j in range(k):
                        dearest[g, j] = max(dearest[g, j], costs[a, j])
                        alike[j] = alike[j] and costs[a, j] == costs[first, j]
    start[len(nodes)] = m
    return m
