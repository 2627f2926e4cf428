"""Sets of labels at the nodes of a time-dependent graph, by which a search drops superfluous labels.

A label is a partial path with costs g that arrived at node v at tick t. Its sums are stored as gamma = g - Omega(t),
where Omega(t) is the cost of standing at v from tick 0 to t. So gamma stays the same while the label waits: if it
leaves at t', its costs are gamma + Omega(t'). Its maxima are stored as they are now. A label b at v is superfluous if
there is a label a at v with no larger stored number, and one of these holds:

- both arrived at the same tick.
- a arrived earlier by a hold (the least duration of a pause) at least, and the robot could stand at v since. Then a can
  wait for b and go on like b. If b waits, a waits until the same tick, since Omega adds up and two holds are one.
- both arrived after L(v), when nothing changes any more (:mod:`.calm`). Then costs g are compared, at any ticks.

From tick L(v) + 1 on, the set of v holds costs g instead of gamma. Labels that can wait until then, or for a hold if
that is longer, are stored with their costs after this wait, the longest that is of use.

The labels of a node are rows of one block in a pool. First come ripe rows, which arrived at least a hold ago and are
compared with any new label. Then come green rows, which arrived less than a hold ago and are compared only with labels
of the same tick.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean
from hpop.search.timed.tables import NEVER, TimedTables, free_since, omega_at, worst_rate

# Columns of a node: begin and length of its block, number of ripe rows, number of all rows, tick of the last update,
# and whether it is calm (after L(v)).
BEGIN, ROOM, RIPE, SIZE, SEEN, CALM, SET_COLUMNS = range(7)
TICK, OWNER, ROW_COLUMNS = range(3)
LEAST_ROOM = 4


class LabelSets(NamedTuple):
    """Sets of labels (partial paths) of all nodes.

    heads   (n, SET_COLUMNS)  for each node, its block of rows and the numbers of ripe and of all rows
    vectors (r, k)            stored numbers of each row: gamma and maxima, or costs after L(v)
    rows    (r, ROW_COLUMNS)  tick of arrival and index of the closed label of each row
    """

    heads: IntArray
    vectors: IntArray
    rows: IntArray


@lean
def move_row(sets: LabelSets, source: int, target: int) -> None:
    """Copy row `source` of the pool over row `target`."""
    for j in range(sets.vectors.shape[1]):
        sets.vectors[target, j] = sets.vectors[source, j]
    for j in range(ROW_COLUMNS):
        sets.rows[target, j] = sets.rows[source, j]


@lean
def drop_ripe(sets: LabelSets, v: int, i: int) -> None:
    """Remove ripe row i of node v's block: a partial path that arrived at least a hold (shortest pause) ago."""
    begin = sets.heads[v, BEGIN]
    sets.heads[v, RIPE] -= 1
    sets.heads[v, SIZE] -= 1
    move_row(sets, begin + sets.heads[v, RIPE], begin + i)
    move_row(sets, begin + sets.heads[v, SIZE], begin + sets.heads[v, RIPE])


@lean
def drop_green(sets: LabelSets, v: int, i: int) -> None:
    """Remove green row i of node v's block: a partial path that arrived less than a hold (shortest pause) ago."""
    begin = sets.heads[v, BEGIN]
    sets.heads[v, SIZE] -= 1
    move_row(sets, begin + sets.heads[v, SIZE], begin + i)


@lean
def ripen(sets: LabelSets, v: int, i: int) -> int:
    """Turn green row i of node v into a ripe row, and drop rows that are superfluous then, possibly row i itself.

    Returns the index of the next green row to process, given that all rows before i are processed.
    """
    begin = sets.heads[v, BEGIN]
    k = sets.vectors.shape[1]
    for at in range(begin, begin + sets.heads[v, RIPE]):
        if is_at_most(sets.vectors, at, sets.vectors, begin + i, k):
            drop_green(sets, v, i)
            return i
    ripe = sets.heads[v, RIPE]
    for j in range(k):
        a, b = sets.vectors[begin + i, j], sets.vectors[begin + ripe, j]
        sets.vectors[begin + i, j], sets.vectors[begin + ripe, j] = b, a
    for j in range(ROW_COLUMNS):
        a, b = sets.rows[begin + i, j], sets.rows[begin + ripe, j]
        sets.rows[begin + i, j], sets.rows[begin + ripe, j] = b, a
    sets.heads[v, RIPE] = ripe + 1
    own = sets.rows[begin + ripe, OWNER]
    dropped = False
    at = sets.heads[v, RIPE] - 1
    new = at
    while at >= 0:
        if sets.rows[begin + at, OWNER] != own and is_at_most(sets.vectors, begin + new, sets.vectors, begin + at, k):
            if new == sets.heads[v, RIPE] - 1:
                new = at  # where the last ripe row goes
            drop_ripe(sets, v, at)
            dropped = True
        at -= 1
    return int(sets.heads[v, RIPE]) if dropped else i + 1


@lean
def is_at_most(one: IntArray, i: int, other: IntArray, j: int, k: int) -> bool:
    """Return whether row i of `one` is nowhere larger than row j of `other`, in k columns."""
    below = True
    for c in range(k):
        below &= one[i, c] <= other[j, c]
    return below


@lean
def is_superfluous(sets: LabelSets, v: int, t: int, vector: IntArray) -> bool:
    """Return whether the set of node v makes a label (partial path) superfluous, so that it can be dropped.

    t, vector  tick of arrival of the label, and stored numbers (k,): its sums less the cost of standing there since
               tick 0, and its maxima
    """
    head = sets.heads[v]
    begin = head[BEGIN]
    for i in range(begin, begin + head[SIZE]):
        if i >= begin + head[RIPE] and sets.rows[i, TICK] != t:
            continue
        below = True
        for j in range(len(vector)):
            below &= sets.vectors[i, j] <= vector[j]
        if below:
            return True
    return False


@lean
def enter_label(
    sets: LabelSets, v: int, t: int, vector: IntArray, owner: int, first: int, kept: NDArray[np.uint8]
) -> None:
    """Add a label (partial path) to the set of node v, and drop labels that it makes superfluous.

    It must not be superfluous itself, and there must be room. Dropped labels of the same tick are cleared in `kept`.

    t, vector  tick of arrival, and stored numbers (k,)
    owner      index of the closed label
    first      index of the first closed label of tick t
    kept       (f,)  flags of the closed labels of tick t
    """
    head = sets.heads[v]
    begin = head[BEGIN]
    k = len(vector)
    if head[SIZE] == head[ROOM]:
        raise IndexError  # make_room comes first
    i = head[SIZE] - 1
    while i >= 0:
        mine = sets.rows[begin + i, OWNER]
        if mine >= first or (head[CALM] != 0 and i < head[RIPE]):
            above = True
            for j in range(k):
                above &= sets.vectors[begin + i, j] >= vector[j]
            if above:
                if mine >= first:
                    kept[mine - first] = 0
                if i < head[RIPE]:
                    drop_ripe(sets, v, i)
                else:
                    drop_green(sets, v, i)
        i -= 1
    at = begin + head[SIZE]
    tick = t
    if head[CALM] != 0:
        move_row(sets, begin + head[RIPE], at)
        at = begin + head[RIPE]
        head[RIPE] += 1
        tick = -NEVER  # it has no use for a hold
    head[SIZE] += 1
    for j in range(k):
        sets.vectors[at, j] = vector[j]
    sets.rows[at, TICK] = tick
    sets.rows[at, OWNER] = owner


@lean
def make_room(sets: LabelSets, v: int, used: int) -> int:
    """Make room for a row in the block of node v: if it is full, move it to a longer block at the end of the pool.

    `used` is the number of used rows of the pool; the new number is returned.
    """
    head = sets.heads[v]
    if head[SIZE] < head[ROOM]:
        return used
    for i in range(head[SIZE]):
        move_row(sets, head[BEGIN] + i, used + i)
    head[BEGIN] = used
    head[ROOM] = max(LEAST_ROOM, 2 * head[ROOM])
    return int(used + head[ROOM])


@lean
def refresh(tables: TimedTables, calm: NDArray[np.int32], sets: LabelSets, v: int, t: int) -> None:
    """Update the set of node v to tick t, as its labels (partial paths) have waited since the last update.

    Labels that could not wait are dropped, maxima rise by the wait, and green rows become ripe. After L(v), given by
    `calm` (n,), nothing changes any more, and the stored numbers become costs.
    """
    head = sets.heads[v]
    seen, begin = head[SEEN], head[BEGIN]
    if seen == t:
        return
    head[SEEN] = t
    hold = np.int64(tables.hold)
    for_good = t > calm[v]
    if hold == 0:
        if not for_good or head[CALM] == 0:
            head[RIPE] = head[SIZE] = 0
        head[CALM] = for_good
        return
    if head[CALM] == 0:
        p = np.int64(tables.place[v])
        k = sets.vectors.shape[1]
        since = free_since(tables, p, t)
        i = head[SIZE] - 1
        while i >= 0:
            if sets.rows[begin + i, TICK] < since:
                if i < head[RIPE]:
                    drop_ripe(sets, v, i)
                else:
                    drop_green(sets, v, i)
            i -= 1
        for j in range(k):
            if tables.is_max[j] and head[SIZE] > 0:
                worst = worst_rate(tables, p, j, seen, t)
                for i in range(begin, begin + head[SIZE]):
                    sets.vectors[i, j] = max(sets.vectors[i, j], worst)
        if for_good:
            head[CALM] = 1
            i = head[SIZE] - 1
            while i >= 0:
                row = begin + i
                until = max(np.int64(calm[v]) + 1, sets.rows[row, TICK] + hold)
                if free_since(tables, p, until) > sets.rows[row, TICK]:
                    if i < head[RIPE]:
                        drop_ripe(sets, v, i)
                    else:
                        drop_green(sets, v, i)
                else:
                    for j in range(k):
                        if tables.is_max[j]:
                            sets.vectors[row, j] = max(sets.vectors[row, j], worst_rate(tables, p, j, t, until))
                        else:
                            sets.vectors[row, j] += omega_at(tables, p, j, until)
                    sets.rows[row, TICK] = until - hold
                i -= 1
    i = head[RIPE]
    while i < head[SIZE]:
        i = ripen(sets, v, i) if sets.rows[begin + i, TICK] + hold <= t else i + 1


@lean
def waiting(tables: TimedTables, sets: LabelSets, nodes: NDArray[np.int32], owners: IntArray, costs: IntArray) -> None:
    """List partial paths that wait at the given nodes: write their indices to `owners` (r,), costs to `costs` (r, k).

    Both must have room for all rows of these nodes. The costs are those at arrival or, where paths have waited, lower
    bounds of their costs after the wait.
    """
    at = 0
    for v in nodes:
        head = sets.heads[v]
        for i in range(head[BEGIN], head[BEGIN] + head[SIZE]):
            owners[at] = sets.rows[i, OWNER]
            for j in range(costs.shape[1]):
                costs[at, j] = sets.vectors[i, j]
                if head[CALM] == 0 and not tables.is_max[j]:
                    costs[at, j] += omega_at(tables, np.int64(tables.place[v]), j, sets.rows[i, TICK])
            at += 1
