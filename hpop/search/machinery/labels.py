"""The labels (partial paths) of a search as arrays, from which a checkpoint restores the state of the search.

A closed label has been extended by all arcs, an open one waits for it, and a solution is a label at a target. A label
stores its parent label and its last arc. Its costs, its key in the queue and the sets of vectors at its node follow
from the graph. So a label in a file is either a path of this graph with its true costs, or it is refused. No number in
a file is used as an index before it is checked. A resumed search checks that

- the arc of each label leaves the node of its parent, the parent was closed before, and all labels differ;
- labels were closed, and solutions found, in the order of the search, and none is covered by earlier ones;
- the open labels form a heap, and none of them precedes a closed label in the order of the search;
- the checksums of the costs of open labels, of the front, and of the sets are right.

It does not check whether open labels are missing, as that would take as long as the search itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.kernels import precedes

Nodes: TypeAlias = NDArray[np.int32]
GENERATED, EXPANDED, COUNTS = range(3)
OPEN, FRONT, SETS, EVIDENCE = range(4)


class Unsound(ValueError):
    """Error raised for saved labels (partial paths) that do not fit the search that resumes; the message says why."""


@dataclass(frozen=True, eq=False)
class Labels:
    """State of a search: its labels (partial paths), each encoded as one int64 (:mod:`.slices`).

    closed     (c,)  labels that were extended (closed), in order; other labels refer to their parents by index here
    heap       (h,)  open labels in the heap, in its order
    waiting    (w,)  open labels in buckets, not yet in the heap, in the order of their buckets
    solutions  (s,)  labels of the front, in the order in which they were found
    counts     (2,)  numbers of labels generated and expanded
    order      (k,)  columns of the graph's costs, in the order of the search
    evidence   (3,)  checksums of the open labels, the front and the sets
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
        """Return the labels (partial paths) from arrays by names of fields; raise Unsound for invalid arrays."""
        names = [field.name for field in fields(cls)]
        if sorted(arrays) != sorted(names) or any(a.dtype != np.int64 or a.ndim != 1 for a in arrays.values()):
            raise Unsound("the saved arrays have other names or types")
        labels = cls(**arrays)
        if len(labels.counts) != COUNTS or len(labels.evidence) != EVIDENCE:
            raise Unsound("the saved arrays have other sizes")
        if not 0 <= labels.counts[EXPANDED] <= labels.counts[GENERATED] + 1 <= 2**62:
            raise Unsound("the saved counts of partial paths are impossible")
        return labels

    @property
    def all(self) -> IntArray:
        """All labels (partial paths) in one array: closed labels, then open labels, then solutions."""
        return np.concatenate([self.closed, self.heap, self.waiting, self.solutions])


def checksum_of_labels(values: IntArray, costs: IntArray) -> int:
    """Return a checksum of labels (partial paths, (n,)) and their costs (n, k) that does not depend on their order."""
    parts = np.arange(3, 3 + 2 * costs.shape[1], 2, dtype=np.int64)
    return int(((2 * values + 1) * (costs.astype(np.int64) @ parts)).sum(dtype=np.int64))


def check_order(closed: NDArray[Any], opened: NDArray[Any], solved: NDArray[Any]) -> None:
    """Raise Unsound if saved labels (partial paths) are not in the order in which a search takes labels.

    closed, opened, solved  (., k)  estimates of closed labels, open labels and solutions

    Closed labels need to be in order only by the first cost, as some of them come from turns, which are not queued.
    """
    if not (_are_in_order(closed[:, :1]) and _are_in_order(solved)):
        raise Unsound("the saved partial paths are not in the order in which the search takes them")
    if not len(opened):
        return
    for j in range(opened.shape[1]):
        opened = opened[opened[:, j] == opened[:, j].min()]
    first = opened[:1]  # the first open label
    if not (
        _are_in_order(np.concatenate([closed[-1:, :1], first[:, :1]]))
        and _are_in_order(np.concatenate([solved[-1:], first]))
    ):
        raise Unsound("a saved open partial path comes, by its costs, before one that the search has already taken")


def check_solutions(is_target: NDArray[np.uint8], nodes: Nodes, ends: Nodes, first: NDArray[Any], most: int) -> None:
    """Raise Unsound if saved labels (partial paths) do not fit the targets, or the bound on the first cost.

    There are three faults: a closed label is at a target, a solution is not at a target, or a solution's first cost is
    above ``most``. A closed label was extended by all arcs; a search never extends a label at a target.

    is_target     mask of nodes
    nodes (c,)    nodes of closed labels
    ends (s,)     nodes of solutions
    first (s, 1)  first costs of solutions
    most          upper bound on the first cost
    """
    if is_target[nodes].any() or not is_target[ends].all() or (first > most).any():
        raise Unsound("a saved solution is not at a target, or a saved partial path at a target is not a solution")


def enter_in_batches(count: int, enter: Callable[[int], int], grow: Callable[[], None]) -> None:
    """Enter ``count`` saved labels (partial paths) into the sets of their nodes, and grow the sets when they are full.

    ``enter`` calls a kernel: it takes the index of the first label to enter, and returns the index of the first one for
    which there was no room, ``count`` if all are entered, or a negative number for a label that the search would not
    have closed. Then Unsound is raised. ``grow`` enlarges the sets.
    """
    begin = 0
    while begin < count:
        begin = enter(begin)
        if begin < 0:
            raise Unsound("a saved partial path is covered by one before it")
        if begin < count:
            grow()


def _are_in_order(rows: NDArray[Any]) -> bool:
    """Return whether rows (n, k) are in ascending lexicographic order; equal rows may follow each other."""
    before, after = rows[:-1], rows[1:]
    less = np.zeros(len(before), np.bool_)
    equal = np.ones(len(before), np.bool_)
    for j in range(rows.shape[1]):
        less |= equal & (before[:, j] < after[:, j])
        equal &= before[:, j] == after[:, j]
    return bool((less | equal).all())


# The layers of a graph (:class:`hpop.search.extended.ExtendedGraph`) share the table of the m arcs of one layer, of n
# nodes. Further rows of the table are the arcs that lead to other layers; `more` has the offsets of those of each node,
# counted from row m. A label refers to row a of layer l as arc l * m + a, and to row m + i as arc `layers` * m + i. A
# graph without layers is one layer, of which only this count matters.


ONE_LAYER = 0, 0, 1, np.zeros(1, np.int32)


@lean
def row_of(arc: int, shared: Any) -> tuple[int, int]:
    """Return the row of an arc in the table of arcs, and what must be added to the head that is there.

    shared  n, m, layers and more, see above
    """
    n, m, layers, _ = shared
    if layers == 1 or arc < m:
        return arc, 0
    if arc >= layers * m:
        return arc - (layers - 1) * m, 0
    layer = arc // m
    return arc - layer * m, layer * n


@lean
def layer_of(node: int, shared: Any) -> int:
    """Return the layer of a node, the last one for nodes after all layers; for `shared` see :func:`row_of`."""
    n, _, layers, _ = shared
    return 0 if layers == 1 or node < n else min(node // n, layers - 1)


@lean
def node_of(arc: int, start: IntArray) -> np.int64:
    """Return the node that an arc leaves; ``start`` (n + 1,) has the offsets of the arcs of each node."""
    node, beyond = np.int64(0), np.int64(len(start) - 1)
    while beyond - node > 1:
        middle = (node + beyond) >> 1
        if start[middle] <= arc:
            node = middle
        else:
            beyond = middle
    return node


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
    shared: Any,
    most: IntArray,
    at: NDArray[np.int32],
    f: NDArray[Any],
) -> int:
    """Compute the last nodes and the estimates of saved labels (partial paths); write them to `at` (n,) and f (n, k).

    values   (n,)      labels, closed labels first; each is (parent's index + 1) << 32 | (last arc + 1), 0 at the source
    closed             number of closed labels
    start    (v + 1,)  offsets: the arcs that leave node u are start[u] : start[u + 1]
    heads    (m,)      heads of these arcs
    arcs     (m, k)    costs of these arcs
    h        (v, k)    lower bounds of the remaining costs of nodes; an estimate is the cost so far plus this bound, for
                       a maximum the larger of both; negative at nodes that labels do not reach
    is_last  (v,)      nodes at which a path ends: targets
    is_max   (k,)      True for a cost that is a maximum over the arcs
    source             node at which paths begin
    shared             layers that share the arcs, see :func:`row_of`
    most     (k,)      largest estimates that fit

    Returns n, or i if label i is invalid, or -1 - i if the costs of label i are too large.
    """
    n, m, layers, more = shared
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
        if not 0 <= parent < min(i, closed) or not 0 <= a < len(heads) + (layers - 1) * m:
            return i
        arc = a
        a, shift = row_of(arc, shared)
        u, v = np.int64(at[parent]), np.int64(heads[a]) + shift
        layer = layer_of(u, shared)
        if layers > 1 and a >= m:
            leaves = more[u] <= a - m < more[u + 1]
        else:
            leaves = arc - a == layer * m and start[u - layer * n] <= a < start[u - layer * n + 1]
        if is_last[u] > 0 or not leaves or h[v, 0] < 0:
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
    """Return whether `keys` form a 4-ary heap: no entry has a smaller key than its parent.

    `size` is the number of entries, and `words` the number of integers in the key of each.
    """
    sound = True
    for i in range(1, size):
        sound &= not precedes(keys, i, (i - 1) >> 2, words)
    return sound
