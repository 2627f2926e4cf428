"""The arcs of a graph of states in the order that searches take, and their costs, made block by block.

Nothing is as large as the arcs but what stays: where they lead, whether they turn, and a column of small integers for
each cost.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import BoolArray, IntArray

Counts: TypeAlias = NDArray[np.unsignedinteger[Any]]
BLOCK = 1 << 16  # arcs worked on together: their columns stay in the processor's cache, and every core gets some


class Arcs(NamedTuple):
    """Arcs sorted by tail, the turns of a state before its moves.

    start  (n + 1,)  the arcs that leave state u are start[u] : start[u + 1]
    heads  (m,)      int32
    turns  (m,)      whether an arc is a turn; else it is a move
    """

    start: IntArray
    heads: NDArray[np.int32]
    turns: BoolArray

    @classmethod
    def sorted(cls, size: int, turns: tuple[IntArray, IntArray], moves: tuple[IntArray, IntArray]) -> Arcs:
        """From tails and heads of all turns and moves between so many states."""
        tails = np.concatenate([turns[0], moves[0]])
        order = np.argsort(tails, kind="stable")
        start = np.zeros(size + 1, np.int64)
        np.cumsum(np.bincount(tails, minlength=size), out=start[1:])
        heads = np.concatenate([turns[1], moves[1]])[order].astype(np.int32)
        return cls(start, heads, order < turns[0].size).frozen()

    def frozen(self) -> Arcs:
        """These, read-only, so that a graph takes them as they are."""
        for array in self:
            array.setflags(write=False)
        return self

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.start.nbytes + self.heads.nbytes + self.turns.nbytes

    def ends(self, part: slice) -> tuple[IntArray, IntArray]:
        """Tails and heads of a range of arcs."""
        first = int(np.searchsorted(self.start, part.start, side="right")) - 1
        last = int(np.searchsorted(self.start, part.stop, side="left"))
        bounds = np.clip(self.start[first : last + 1], part.start, part.stop)
        return np.repeat(np.arange(first, last), bounds[1:] - bounds[:-1]), self.heads[part].astype(np.int64)

    def of(self, turns: bool) -> tuple[IntArray, IntArray]:
        """Tails and heads of all turns, or of all moves."""
        kind = self.turns if turns else ~self.turns
        tails = np.repeat(np.arange(self.start.size - 1), np.diff(self.start))
        return tails[kind], self.heads[kind].astype(np.int64)


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
