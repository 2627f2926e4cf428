"""Kernels of a corridor: layers of least weighted costs by number of turns, from the targets and from the source.

A lane is a weighted sum of the two costs besides turns. :mod:`hpop.search.corridor` explains what is computed here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.staircase.turn_hull import FAR

LANES = 4
DEGREE = 15  # a state has fewer arcs, so that four bits name each, or
ADDED = 15  # an added arc
BLOCK_BITS, BASE_BITS, CODE_BITS = 3, 12, 15  # 8 states have one base; units of a base and of a code
REACHED = np.int32(FAR - 1)  # larger weighted costs of a state that is reached count as this
MOST_BASE, MOST_CODE = 2**16 - 1, 2**8 - 1

Lanes = NDArray[np.int32]


class RunArcs(NamedTuple):
    """Arcs of the base of a graph, with the costs of the search, and arcs that only a query has (:class:`.AddedArcs`).

    indptr, heads       arcs of the base
    first, turns, rest  their costs; a turn counts 1, other arcs 0
    plain               (n,)  the arc of each state that is no turn, or -1
    """

    indptr: IntArray
    heads: NDArray[np.int32]
    first: NDArray[Any]
    turns: NDArray[Any]
    rest: NDArray[Any]
    plain: NDArray[np.int32]


@kernel
def find_plain(indptr: IntArray, heads: NDArray[np.int32], turns: NDArray[Any], plain: NDArray[np.int32]) -> bool:
    """Write to `plain` (n,) the arc of each state that is no turn; return whether these form straight runs.

    A run leads through rising numbers of states, or through falling ones, so that two sweeps go through all runs.
    """
    for v in range(len(plain)):
        for a in range(indptr[v], indptr[v + 1]):
            if turns[a] == 0:
                if plain[v] >= 0 or heads[a] == v:
                    return False
                plain[v] = a
    for v in range(len(plain)):
        if plain[v] >= 0:
            u = np.int64(heads[plain[v]])
            if plain[u] >= 0 and (np.int64(heads[plain[u]]) > u) != (u > v):
                return False
    return True


@lean
def pull_turns(
    begin: int,
    end: int,
    before: Lanes,
    changed: NDArray[np.uint8],
    arcs: Any,
    weights: NDArray[np.float32],
    now: Lanes,
    better: NDArray[np.uint8],
    choice: NDArray[np.uint16],
) -> None:
    """Write to `now` (n, LANES) the remaining costs of the states from `begin` to `end` after at most one turn.

    before, changed  (n, LANES) and (n,)  costs with one turn less, and a mask of the states where these became less
    arcs, weights    fields of :class:`RunArcs`; (LANES, 2)
    better, choice   (n,)  written: whether a cost became less, and 1 + the arc of the state that did it, 4 bits a lane
    """
    indptr, heads, first, turns, rest, _ = arcs
    for v in range(np.uint64(begin), np.uint64(end)):
        for k in range(LANES):
            now[v, k] = before[v, k]
        chosen = np.int32(0)
        for a in range(np.uint64(indptr[v]), np.uint64(indptr[v + np.uint64(1)])):
            u = np.uint64(heads[a])
            if turns[a] == 0 or changed[u] == 0:
                continue
            x, y = np.float32(first[a]), np.float32(rest[a])
            name = np.int32(a - np.uint64(indptr[v])) + np.int32(1)
            for k in range(LANES):
                cost = min(REACHED, np.int32(before[u, k] + np.int32(weights[k, 0] * x + weights[k, 1] * y)))
                if cost < now[v, k]:
                    now[v, k] = cost
                    chosen = np.int32((chosen & ~(15 << (4 * k))) | (name << (4 * k)))
        choice[v] = np.uint16(chosen)
        better[v] = 1 if chosen != 0 else 0


@lean
def pull_plain(
    rising: bool,
    arcs: Any,
    weights: NDArray[np.float32],
    now: Lanes,
    better: NDArray[np.uint8],
    choice: NDArray[np.uint16],
) -> None:
    """Lower the remaining costs `now` (n, LANES) by the arcs that are no turns and lead to larger or smaller numbers.

    Other arguments as in :func:`pull_turns`; `better` and `choice` are updated.
    """
    indptr, heads, first, _, rest, plain = arcs
    n = len(plain)
    for i in range(n):
        v = n - 1 - i if rising else i
        a = np.int64(plain[v])
        if a < 0:
            continue
        u = np.int64(heads[a])
        if (u > v) != rising or better[u] == 0:
            continue
        x, y = np.float32(first[a]), np.float32(rest[a])
        name = np.int32(a - indptr[v] + 1)
        chosen = np.int32(choice[v])
        for k in range(LANES):
            cost = min(REACHED, np.int32(now[u, k] + np.int32(weights[k, 0] * x + weights[k, 1] * y)))
            if cost < now[v, k]:
                now[v, k] = cost
                chosen = np.int32((chosen & ~(15 << (4 * k))) | (name << (4 * k)))
                better[v] = 1
        choice[v] = np.uint16(chosen)


@lean
def encode(now: Lanes, row: int, bases: NDArray[np.uint16], codes: NDArray[np.uint8]) -> None:
    """Store a layer (n, LANES) as row `row` of `bases` (rows, blocks, LANES) and `codes` (rows, n, LANES)."""
    for block in range(bases.shape[1]):
        begin, end = block << BLOCK_BITS, min(len(now), (block + 1) << BLOCK_BITS)
        for k in range(LANES):
            least = np.int64(now[begin, k])
            for v in range(begin, end):
                least = np.int64(min(least, now[v, k]))
            base: Any = min(least >> BASE_BITS, MOST_BASE)
            bases[row, block, k] = base
            for v in range(begin, end):
                code: Any = min(MOST_CODE, (np.int64(now[v, k]) - (base << BASE_BITS)) >> CODE_BITS)
                codes[row, v, k] = code


@lean
def is_in_corridor(v: int, turns: int, forward: Lanes, layers: Any, corners: Any, bound: IntArray, first: int) -> int:
    """Return a row of layers by which a path through state v, with `turns` turns before it, may be uncovered; else -1.

    forward  (n, LANES)  least weighted cost to each state with these turns
    layers   bases, codes, first number of turns of each row, number of rows, least number of further turns (n,)
    corners  fields of :class:`.UncoveredCorners`
    bound    (LANES,)  scratch
    first    row that is tried first
    """
    bases, codes, begins, fewest = layers
    values, last = corners
    for i_row in range(-1, len(begins) - 1):
        row = np.int64(first if i_row < 0 else i_row)
        if begins[row + 1] <= fewest[v]:
            continue
        for k in range(LANES):
            excess = (np.int64(bases[row, v >> BLOCK_BITS, k]) << BASE_BITS) + (np.int64(codes[row, v, k]) << CODE_BITS)
            bound[k] = np.int64(forward[v, k]) + excess
        if i_row > 0 and begins[row] > fewest[v]:
            equal = True
            for k in range(LANES):
                equal &= codes[row, v, k] == codes[row - 1, v, k]
                equal &= bases[row, v >> BLOCK_BITS, k] == bases[row - 1, v >> BLOCK_BITS, k]
            if equal:  # no better than with fewer turns
                continue
        n = min(turns + max(begins[row], np.int64(fewest[v])), len(last) - 1)
        low, high = np.int64(0), last[n]
        while low < high:
            middle = (low + high) >> 1
            if values[n, middle, 0] < bound[0]:
                low = middle + 1
            else:
                high = middle
        for i in range(low, last[n] + 1):
            if values[n, i, 1] < bound[1]:
                break
            inside = True
            for k in range(LANES):
                inside &= values[n, i, k] >= bound[k]
            if inside:
                return int(row)
    return -1


@lean
def push(
    states: NDArray[np.int32],
    before: Lanes,
    turns: int,
    arcs: Any,
    weights: NDArray[np.float32],
    layers: Any,
    corners: Any,
    forward: Lanes,
    mark: NDArray[np.uint8],
    waiting: NDArray[np.int32],
    count: int,
    bound: IntArray,
    after: NDArray[np.int32],
) -> int:
    """Sweep one layer onward: turn at `states` (s,), of costs `before` (s, LANES), then go on along plain arcs.

    Returns how many states of the corridor became less; they are written to `after` (n,). Marks are bits: a state
    waits, is in `after`, is in the corridor.

    turns           number of turns of the paths to the states that are reached now
    forward         (n, LANES)  changed: least weighted costs to each state
    mark            (n,)  changed
    waiting, count  (n,)  changed: states that wait to be tested, and the number of them at first

    Other arguments as in :func:`is_in_corridor` and :func:`pull_turns`.
    """
    indptr, heads, first, is_turn, rest, plain = arcs
    reached, last = 0, np.int64(0)
    for i in range(len(states)):
        v = np.int64(states[i])
        for a in range(indptr[v], indptr[v + 1]):
            if is_turn[a] == 0:
                continue
            u, better = np.int64(heads[a]), False
            x, y = np.float32(first[a]), np.float32(rest[a])
            for k in range(LANES):
                cost = min(REACHED, np.int32(before[i, k] + np.int32(weights[k, 0] * x + weights[k, 1] * y)))
                if cost < forward[u, k]:
                    forward[u, k] = cost
                    better = True
            if better and mark[u] & 1 == 0:
                mark[u] |= 1
                waiting[count] = u
                count += 1
    while count > 0:
        count -= 1
        v = np.int64(waiting[count])
        mark[v] &= 0xFE
        row = is_in_corridor(v, turns, forward, layers, corners, bound, last)
        if row < 0:
            continue
        last = row
        if mark[v] & 2 == 0:
            after[reached] = v
            reached += 1
        mark[v] |= 6
        onward = np.int64(plain[v])
        if onward < 0:
            continue
        u, better = np.int64(heads[onward]), False
        x, y = np.float32(first[onward]), np.float32(rest[onward])
        for k in range(LANES):
            cost = min(REACHED, np.int32(forward[v, k] + np.int32(weights[k, 0] * x + weights[k, 1] * y)))
            if cost < forward[u, k]:
                forward[u, k] = cost
                better = True
        if better and mark[u] & 1 == 0:
            mark[u] |= 1
            waiting[count] = u
            count += 1
    for i in range(reached):
        mark[after[i]] &= 0xFD
    return reached


@lean
def follow(
    layer: int,
    lane: int,
    v: int,
    choice: NDArray[np.uint16],
    arcs: Any,
    passed: NDArray[np.uint8],
) -> int:
    """Mark in `passed` (n,) the states of a best path from v in one lane, up to a turn or a layer with fewer turns.

    Returns v << 5 | choice for the last state. `choice` (n,) is that of :func:`pull_turns` for this `layer`.
    """
    indptr, heads, _, turns, _, _ = arcs
    at = np.int64(v)
    while True:
        passed[at] = 1
        name = (np.int64(choice[at]) >> (4 * lane)) & 15
        if name == 0 or name == ADDED or turns[indptr[at] + name - 1] > 0:
            return int((at << 5) | name)
        at = np.int64(heads[indptr[at] + name - 1])
