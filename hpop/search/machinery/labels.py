"""The labels of a search, which is all that a checkpoint holds of it: the rest is made of them again.

A label names its parent and the arc that it came by, so its costs, its key in the queue and what the sets of its node
hold follow from the graph. What a file says is therefore a path of this graph with its true costs, or it is refused:
no kernel ever sees a number from a file that is no place in its tables. A search that goes on from labels asks that

- each label comes by an arc that leaves its parent's node, its parent was closed before it, and no two are the same;
- labels were closed, and solutions found, in the order of the search, none covered by those before;
- the labels still open make a heap, and none of them should have come before one that is closed;
- the evidence is right: sums over the costs of the open labels, the front, and what the sets hold.

What is not asked, for it would be to search again, is whether labels are missing that should be open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel
from hpop.search.machinery.kernels import precedes

Nodes: TypeAlias = NDArray[np.int32]
GENERATED, EXPANDED, COUNTS = range(3)
OPEN, FRONT, SETS, EVIDENCE = range(4)


class Unsound(ValueError):
    """Labels are not those of the search that shall go on from them; the message says why."""


@dataclass(frozen=True, eq=False)
class Labels:
    """What a search knows.

    closed     (c,)  in the order in which they were closed; a parent is 1 + its place here
    heap       (h,)  open, in the order of the heap
    waiting    (w,)  open, and not yet in the heap, in the order of their buckets
    solutions  (s,)  in the order in which they were found
    counts     (2,)  labels generated and expanded
    order      (k,)  columns of the costs, in the order of the search
    evidence   (3,)  sums that tell whether these labels were the ones: of the open ones, the front, the sets
    """

    closed: IntArray
    heap: IntArray
    waiting: IntArray
    solutions: IntArray
    counts: IntArray
    order: IntArray
    evidence: IntArray

    @classmethod
    def of(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Labels from arrays by name."""
        names = [field.name for field in fields(cls)]
        if sorted(arrays) != sorted(names) or any(a.dtype != np.int64 or a.ndim != 1 for a in arrays.values()):
            raise Unsound("its arrays are other ones")
        made = cls(**arrays)
        if len(made.counts) != COUNTS or len(made.evidence) != EVIDENCE:
            raise Unsound("its arrays are other ones")
        if not 0 <= made.counts[EXPANDED] <= made.counts[GENERATED] + 1 <= 2**62:
            raise Unsound("its counts of labels are none")
        return made

    @property
    def all(self) -> IntArray:
        """The closed ones, the open ones and the solutions."""
        return np.concatenate([self.closed, self.heap, self.waiting, self.solutions])


def weight(values: IntArray, costs: IntArray) -> int:
    """A sum over labels (n,) and their costs (n, k) that tells whether they are the same; overflow is part of it."""
    parts = np.arange(3, 3 + 2 * costs.shape[1], 2, dtype=np.int64)
    return int(((2 * values + 1) * (costs.astype(np.int64) @ parts)).sum(dtype=np.int64))


def check_order(closed: NDArray[Any], opened: NDArray[Any], solved: NDArray[Any]) -> None:
    """Raise Unsound where labels of these estimates (n, k) did not come in the order of the search.

    The closed ones, among them some that come of turns taken at once, are ordered by the first cost alone.
    """
    if not (_ordered(closed[:, :1]) and _ordered(solved)):
        raise Unsound("its labels are not in the order of the search")
    if not len(opened):
        return
    for j in range(opened.shape[1]):
        opened = opened[opened[:, j] == opened[:, j].min()]
    first = opened[:1]  # of the open ones
    if not (
        _ordered(np.concatenate([closed[-1:, :1], first[:, :1]])) and _ordered(np.concatenate([solved[-1:], first]))
    ):
        raise Unsound("an open label should have come before those that have")


def check_solutions(is_target: NDArray[np.uint8], nodes: Nodes, ends: Nodes, first: NDArray[Any], most: int) -> None:
    """Raise Unsound where closed labels are at targets, or solutions are not, or exceed the bound on the first cost."""
    if is_target[nodes].any() or not is_target[ends].all() or (first > most).any():
        raise Unsound("a solution is none")


def enter_each(count: int, enter: Callable[[int], int], grow: Callable[[], None]) -> None:
    """Let a kernel enter so many labels into sets, from a place on until there is no more room, which is then made.

    Raises Unsound where the kernel returns what is negative: a label that would not have been closed.
    """
    begin = 0
    while begin < count:
        begin = enter(begin)
        if begin < 0:
            raise Unsound("a label is covered by one before it")
        if begin < count:
            grow()


def _ordered(rows: NDArray[Any]) -> bool:
    """Whether rows (n, k) are in lexicographic order."""
    before, after = rows[:-1], rows[1:]
    less = np.zeros(len(before), np.bool_)
    same = np.ones(len(before), np.bool_)
    for j in range(rows.shape[1]):
        less |= same & (before[:, j] < after[:, j])
        same &= before[:, j] == after[:, j]
    return bool((less | same).all())


@kernel
def retrace(
    values: IntArray,
    closed: int,
    start: IntArray,
    heads: NDArray[Any],
    arcs: NDArray[Any],
    h: NDArray[Any],
    is_last: NDArray[np.uint8],
    is_max: NDArray[np.bool_],
    source: int,
    most: IntArray,
    at: NDArray[np.int32],
    f: NDArray[Any],
) -> int:
    """Find the node (n,) and the estimate (n, k) of labels (n,), the closed ones first.

    start    (n + 1,)  where the arcs of a node begin; heads (m,), arcs (m, k) their costs
    h        (n, k)    lower bounds
    is_last  (n,)      nodes whose labels are not followed
    most     (k,)      of estimates

    Returns n, or the place of a label that is none; minus one and its place where its costs are too large.
    """
    for i in range(len(values)):
        value = values[i]
        if value == 0:  # the source
            at[i] = source
            for j in range(len(is_max)):
                f[i, j] = h[source, j]
                if h[source, j] > most[j]:
                    return -1 - i
            continue
        parent, a = (value >> 32) - 1, (value & 0xFFFFFFFF) - 1
        if not 0 <= parent < min(i, closed) or not 0 <= a < len(heads):
            return i
        u, v = np.int64(at[parent]), np.int64(heads[a])
        if is_last[u] > 0 or not start[u] <= a < start[u + 1]:
            return i
        at[i] = v
        for j in range(len(is_max)):
            if is_max[j]:
                new = max(np.int64(f[parent, j]), np.int64(arcs[a, j]), np.int64(h[v, j]))
            else:
                new = np.int64(f[parent, j]) - np.int64(h[u, j]) + np.int64(arcs[a, j]) + np.int64(h[v, j])
            if not 0 <= new <= most[j]:
                return -1 - i
            f[i, j] = new
    return len(values)


@kernel
def is_heap(keys: IntArray, size: int, words: int) -> bool:
    """Whether no entry of a 4-ary heap precedes the one above it."""
    sound = True
    for i in range(1, size):
        sound &= not precedes(keys, i, (i - 1) >> 2, words)
    return sound
