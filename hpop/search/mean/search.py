"""The search for exact means within limits: its arrays and labels. Its kernel is in :mod:`.mean.kernel`.

A label is a partial walk. The block of a node has the cost vectors of labels closed there, for dominance tests.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.search.general.search import HeapSearch
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.labels import ONE_LAYER, Nodes, Unsound, enter_in_batches, retrace
from hpop.search.machinery.slices import N_FRONT, ROWS, Clock
from hpop.search.mean import MeanLimits
from hpop.search.mean.kernel import advance, checksum_of_blocks, enter_all


class CappedMean(HeapSearch):
    """Search of one query on one graph for the least mean (integral / duration) and other costs, within limits.

    columns  columns of the graph's costs: the duration, the integral, then the other costs
    first    front of an earlier search: rows of costs, solutions, and their number. Its solutions are negative numbers;
             a solution of this search is 1 + the index of a closed label. For each walk within the limits, this front
             must have a row that is nowhere larger in the other costs.
    """

    def __init__(
        self,
        graph: Graph,
        source: int,
        targets: IntArray,
        h: IntArray,
        columns: tuple[int, ...],
        limits: MeanLimits,
        first: tuple[IntArray, IntArray, int],
    ) -> None:
        order = list(columns)
        self.graph, self.source, self.limits, self.order = graph, source, limits, columns
        self.costs = np.ascontiguousarray(graph.costs[:, order])
        self.h = np.ascontiguousarray(h[order].T)
        self.is_max = np.array([graph.aggregates[j] == "max" for j in order])
        self.is_target = np.zeros(graph.nodes, np.uint8)
        self.is_target[targets] = 1
        self.blocks = np.zeros((graph.nodes, 3), np.int64)
        self.vectors = np.zeros((1024, len(order)), np.int64)
        most = self.costs.max(axis=0, initial=0)
        farthest = self.h.max(axis=0, where=self.h < UNREACHABLE, initial=0)
        super().__init__(self.h[source].tolist(), (most + farthest).tolist(), int(np.diff(graph.indptr).max()))
        self.front, self.solutions, self.counters[N_FRONT] = first

    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel for ``work`` elementary steps, and return its code."""
        code = clock.call(
            advance,
            self.counters,
            work,
            self.rise,
            self.fan,
            self.graph.indptr,
            self.graph.heads,
            self.costs,
            self.h,
            self.is_target,
            self.is_max,
            self.limits.most,
            self.limits.rates,
            self.blocks,
            self.vectors,
            self.source,
            self.plan,
            self.keys,
            self.values,
            self.closed,
            self.front,
            self.solutions,
        )
        return int(code)

    def solution_labels(self) -> IntArray:
        """Return no labels: here all solutions are closed partial walks at targets, which a checkpoint has anyway."""
        return self.solutions[:0]

    def retrace(self, values: IntArray, closed: int, at: Nodes, clock: Clock) -> tuple[int, NDArray[Any]]:
        """Write the last nodes of n saved labels (partial paths) to ``at``; return n and their estimates (n, k).

        Estimates and other results are explained at :meth:`.Search.retrace`.
        """
        f = np.zeros((len(values), len(self.order)), np.int64)
        passed = np.zeros_like(self.is_target)  # a walk may go on from a target
        graph = (self.graph.indptr, self.graph.heads, self.costs, self.h, passed, self.is_max)
        return clock.call(retrace, values, closed, *graph, self.source, ONE_LAYER, self.limits.most, at, f), f

    def enter(
        self, nodes: Nodes, closed: NDArray[Any], ends: Nodes, solution_labels: NDArray[Any], clock: Clock
    ) -> None:
        """Fill the blocks (the sets of vectors at nodes) and the front from saved closed labels (partial paths)."""
        if len(ends):
            raise Unsound("solutions are saved in addition to the closed partial paths")

        def enter(begin: int) -> int:
            tables = (self.is_target, self.blocks, self.vectors, self.front, self.solutions, self.counters)
            return int(clock.call(enter_all, nodes, closed, begin, *tables))

        def grow() -> None:
            full = self.counters[N_FRONT] == len(self.solutions)
            (self._grow_front if full else self._grow_rows)()

        enter_in_batches(len(nodes), enter, grow)

    def weight_of_sets(self, clock: Clock) -> int:
        """Return a checksum of the vectors in all blocks."""
        return int(clock.call(checksum_of_blocks, self.blocks, self.vectors))

    def arrays(self) -> list[NDArray[Any]]:
        """Return the tables of the graph, the blocks and the heap, so that their bytes are counted."""
        return [self.costs, self.h, self.is_target, self.blocks, self.vectors, *super().arrays()]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many bytes more are needed, and a function that doubles the rows of blocks or grows the heap.

        ``code`` is the return value of a kernel that ran out of room: ROWS, HEAP or KEYS.
        """
        return (self.vectors.nbytes, self._grow_rows) if code == ROWS else super().growth(code)

    def _grow_rows(self) -> None:
        self.vectors.resize((2 * len(self.vectors), self.vectors.shape[1]), refcheck=False)

    def paths(self, labels: IntArray, clock: Clock) -> list[IntArray]:
        """Return the walk of each solution, as indices of arcs in the graph, from the source on."""
        return [self._path(int(label)) for label in labels]

    def _path(self, label: int) -> IntArray:
        arcs = []
        while label > 0:
            value = int(self.closed[label - 1])
            arcs.append((value & 0xFFFFFFFF) - 1)
            label = value >> 32
        return np.array(arcs[-2::-1], np.int64)  # the source came by no arc
