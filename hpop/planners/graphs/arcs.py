"""The arcs of a graph of states in the order that searches take, and their costs, made block by block.

Nothing is as large as the arcs but what stays: where they lead, whether they turn, and a column of small integers for
each cost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray

Counts: TypeAlias = NDArray[np.unsignedinteger[Any]]
MOVE = 0  # the kind of moves; all others are made in place
BLOCK = 1 << 16  # arcs worked on together: their columns stay in the processor's cache, and every core gets some


class Arcs(NamedTuple):
    """Arcs sorted by tail, of a state those of motions in place before its moves.

    start  (n + 1,)  the arcs that leave state u are start[u] : start[u + 1]
    heads  (m,)      int32
    kinds  (m,)      uint8, the kind of each arc's motion, as its place among those of the graph; 0 is a move
    """

    start: IntArray
    heads: NDArray[np.int32]
    kinds: NDArray[np.uint8]

    @classmethod
    def sorted(cls, size: int, edges: Sequence[tuple[IntArray, IntArray]]) -> Arcs:
        """From tails and heads of the edges of each kind, moves first, between so many states."""
        kinds = [*range(1, len(edges)), MOVE]
        tails, heads = (np.concatenate([edges[kind][side] for kind in kinds]) for side in (0, 1))
        order = np.argsort(tails, kind="stable")
        start = np.zeros(size + 1, np.int64)
        np.cumsum(np.bincount(tails, minlength=size), out=start[1:])
        of_kind = np.repeat(np.array(kinds, np.uint8), [edges[kind][0].size for kind in kinds])
        return cls(start, heads[order].astype(np.int32), of_kind[order]).frozen()

    def frozen(self) -> Arcs:
        """These, read-only, so that a graph takes them as they are."""
        for array in self:
            array.setflags(write=False)
        return self

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.start.nbytes + self.heads.nbytes + self.kinds.nbytes

    def ends(self, part: slice) -> tuple[IntArray, IntArray]:
        """Tails and heads of a range of arcs."""
        first = int(np.searchsorted(self.start, part.start, side="right")) - 1
        last = int(np.searchsorted(self.start, part.stop, side="left"))
        bounds = np.clip(self.start[first : last + 1], part.start, part.stop)
        return np.repeat(np.arange(first, last), bounds[1:] - bounds[:-1]), self.heads[part].astype(np.int64)

    def of(self, kind: int) -> tuple[IntArray, IntArray]:
        """Tails and heads of all arcs of one kind."""
        own = self.kinds == kind
        tails = np.repeat(np.arange(self.start.size - 1), np.diff(self.start))
        return tails[own], self.heads[own].astype(np.int64)


def blocks(size: int, each: int = 1) -> Iterator[slice]:
    """Ranges of so many things, each as much work as some arcs, bounded in arcs."""
    step = max(1, BLOCK // each)
    return (slice(begin, min(begin + step, size)) for begin in range(0, size, step))


class Quanta:
    """A column of costs in quanta that are not known yet, in the smallest integers that hold them."""

    def __init__(self, size: int) -> None:
        self.counts: Counts = np.zeros(size, np.uint16)

    def write(self, part: slice, counts: IntArray) -> None:
        """Take the costs of a range of arcs."""
        needed = np.min_scalar_type(int(counts.max(initial=0)))
        if needed.itemsize > self.counts.itemsize:
            self.counts = self.counts.astype(needed)
        self.counts[part] = counts


def table(columns: list[Counts], size: int) -> IntArray:
    """Columns (m,) side by side, (m, k)."""
    costs = np.empty((size, len(columns)), np.int64)
    for part in blocks(size):
        for j, column in enumerate(columns):
            costs[part, j] = column[part]
    costs.setflags(write=False)
    return costs
