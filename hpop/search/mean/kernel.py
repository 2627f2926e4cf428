"""The kernel of the search for exact means within limits, and the blocks of vectors for its dominance tests.

A label has the duration T, the integral S and the other costs of a walk from the source. A completion is a walk to a
target that begins with it; f = g + h bounds the costs of all completions from below. V = S / T is the mean of a
completion. Labels leave the heap in the order of (f_T, f_S, ...), so labels that were closed before at a node have no
longer duration.

Dominance by a shifted cost. Let lam be a mean that no useful completion of label b exceeds. A closed label a at the
same node prunes b if its other costs are nowhere larger, T_a <= T_b, and S_a - lam T_a <= S_b - lam T_b. Proof:
complete both labels in the same way, to a' and b'. Then S_a' - lam T_a' <= S_b' - lam T_b' = (V_b' - lam) T_b' <=
(V_b' - lam) T_a', as V_b' <= lam and T_b' >= T_a'. Hence V_a' <= V_b'. And a' keeps every limit that b' keeps, as it
lasts no longer and costs no more.

If lam is the largest rate S / T of any arc, this is the componentwise rule with R = S - lam T. A smaller lam prunes
more, and the means found so far give one. For each walk within the limits, the front always has a point that is nowhere
larger in the other costs. If a point is nowhere larger than f_b, a useful completion of b has a smaller mean than this
point; otherwise its mean is no larger than the largest on the front.

Bound. A completion of b has at least the mean f_S / T, where T is the longest duration of b within the limits
(:mod:`hpop.search.mean`). So b is useless if this mean is lam or more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.kernels import drop_first, push
from hpop.search.machinery.slices import (
    CLOSED,
    DONE,
    FRONT,
    HEAP,
    KEYS,
    N_CLOSED,
    N_EXPANDED,
    N_FRONT,
    N_GENERATED,
    N_OPEN,
    N_ROWS,
    ROWS,
    SLICE,
)
from hpop.search.mean import INTEGRAL, OTHERS, TIME

START, SIZE, ROOM = range(3)  # columns of the table of blocks


@lean
def is_nowhere_larger(rows: IntArray, i: int, f: IntArray) -> bool:
    """Return whether row i of rows (n, k) is at most f (k,) in all costs but the duration and the integral."""
    j = OTHERS
    while j < len(f) and rows[i, j] <= f[j]:
        j += 1
    return j >= len(f)


@kernel
def row_to_improve(front: IntArray, size: int, f: IntArray) -> int:
    """Return the row of the front whose mean a label (partial walk) with the estimate f (k,) must improve to be useful.

    It is the first row, in the order of means, that is at most f in all other costs, or else the last row.

    front  (size, k)  sorted by the mean
    """
    for i in range(size - 1):
        if is_nowhere_larger(front, i, f):
            return i
    return size - 1


@kernel
def longest_duration(f: IntArray, h: IntArray, v: int, most: IntArray, rates: FloatArray) -> int:
    """Return the longest duration that a partial walk at node v with the estimate f (k,) can reach within the limits.

    h            (n, k)      lower bounds of the remaining costs
    most, rates  (k,), (k,)  largest costs, and longest duration per unit of each cost, see :class:`.MeanLimits`
    """
    remaining = 0.0
    for j in range(len(f)):
        if rates[j] > 0:  # of a sum
            remaining += rates[j] * (most[j] - (f[j] - h[v, j]))
    return int(f[TIME] - h[v, TIME] + np.int64(remaining))


@kernel
def is_pruned(
    front: IntArray, size: int, longest: int, blocks: IntArray, vectors: IntArray, b: int, f: IntArray
) -> tuple[bool, int]:
    """Return whether a label (partial walk) with estimate f (k,) can be dropped, and the number of rows compared.

    It can if its mean cannot improve the front, or if a label closed at the same node dominates it.

    front      (size, k)  walks found so far, sorted by the mean
    longest    longest duration that the label can reach within the limits
    blocks     (n, 3)     for each node the block of rows in ``vectors``: first row, number of rows, room
    vectors    (r, k)     estimates of closed labels; a row that dominates moves to the end of its block
    b          index of the block, the node of the label
    """
    i = row_to_improve(front, size, f)
    total, time = front[i, INTEGRAL], max(1, front[i, TIME])
    if f[INTEGRAL] * time >= total * longest:
        return True, i + 1
    begin, last = blocks[b, START], blocks[b, START] + blocks[b, SIZE] - 1
    for a in range(last, begin - 1, -1):
        if (vectors[a, INTEGRAL] - f[INTEGRAL]) * time > total * (vectors[a, TIME] - f[TIME]):
            continue
        if is_nowhere_larger(vectors, a, f):  # a row that dominates moves to where the next scan begins
            for j in range(len(f)):
                vectors[a, j], vectors[last, j] = vectors[last, j], vectors[a, j]
            return True, i + 2 + last - a
    return False, i + 2 + last - begin


@kernel
def enter_row(blocks: IntArray, vectors: IntArray, b: int, f: IntArray, used: int) -> int:
    """Add the estimate f (k,) of a closed label to block b, and drop rows that f replaces.

    Returns the new number of rows of `vectors` in use, other blocks and gaps between blocks included.

    A label is a partial walk, and f has lower bounds of the costs of walks that begin with it. A block has the rows of
    `vectors` with the estimates of labels closed at one node (:func:`is_pruned`). `used` is the number of rows in use
    before. A row is replaced if f is at most the row in the integral and the other costs. Durations need no comparison,
    as all later labels last at least as long as both.
    """
    begin = blocks[b, START]
    used_rows = begin
    for i in range(begin, begin + blocks[b, SIZE]):
        covered = True
        for j in range(INTEGRAL, len(f)):
            if vectors[i, j] < f[j]:
                covered = False
                break
        if not covered:
            vectors[used_rows] = vectors[i]
            used_rows += 1
    size = used_rows - begin
    if size == blocks[b, ROOM]:
        for i in range(size):
            vectors[used + i] = vectors[begin + i]
        begin = used
        blocks[b, START] = begin
        blocks[b, ROOM] = max(2 * size, 2)
        used += blocks[b, ROOM]
    vectors[begin + size] = f
    blocks[b, SIZE] = size + 1
    return used


@kernel
def insert(front: IntArray, solutions: IntArray, size: int, f: IntArray, label: int) -> int:
    """Add a walk with costs f (k,) to the front unless it is dominated there, and drop walks that it dominates.

    The mean, integral divided by duration, counts as one cost, and replaces these two in comparisons. Of walks with
    equal means and other costs, the earlier one stays. Returns the new size of the front.

    front, solutions  (size, k), (size,)  costs and labels of the walks, sorted by the mean; changed in place
    label             number that `solutions` stores for the walk
    """
    time = max(1, f[TIME])
    position = 0  # after all rows whose mean is not larger
    while position < size and front[position, INTEGRAL] * time <= f[INTEGRAL] * max(1, front[position, TIME]):
        if is_nowhere_larger(front, position, f):
            return size
        position += 1
    count, behind = 0, position
    for i in range(size):
        covered = f[INTEGRAL] * max(1, front[i, TIME]) <= front[i, INTEGRAL] * time
        for j in range(OTHERS, len(f)):
            covered &= f[j] <= front[i, j]
        if covered:
            position -= i < behind
        else:
            front[count] = front[i]
            solutions[count] = solutions[i]
            count += 1
    for i in range(count, position, -1):
        front[i] = front[i - 1]
        solutions[i] = solutions[i - 1]
    front[position] = f
    solutions[position] = label
    return count + 1


@kernel
def insert_all(walks: IntArray, front: IntArray, solutions: IntArray) -> int:
    """Insert the walks (s, k) of the first search into an empty front; return the size of the front.

    Their labels in `solutions` are -1, -2, ...
    """
    size = 0
    for i in range(len(walks)):
        size = insert(front, solutions, size, walks[i], -1 - i)
    return size


@kernel
def advance(
    counters: IntArray,
    work: int,
    rise: IntArray,
    fan: int,
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    h: IntArray,
    is_target: NDArray[np.uint8],
    is_max: NDArray[np.bool_],
    most: IntArray,
    rates: FloatArray,
    blocks: IntArray,
    vectors: IntArray,
    source: int,
    plan: tuple[IntArray, IntArray, IntArray, int],
    keys: IntArray,
    values: IntArray,
    closed: IntArray,
    front: IntArray,
    solutions: IntArray,
) -> int:
    """Run the search for a slice of `work` steps: take labels (partial walks) from the heap, and extend them.

    It ends early if the heap is empty or an array is full. Returns the code of the reason (:mod:`.machinery.slices`).
    All arrays belong to :class:`.CappedMean`, and are changed in place.

    rise, fan, plan, keys, values       heap, see :class:`.HeapSearch`
    indptr, heads, costs                arcs of the graph, with costs in the order of the search
    is_target, is_max, source           mask of nodes; mask of costs that are maxima; node at which walks begin
    h               (n, k)              lower bounds of the remaining costs
    most, rates                         limits, see :class:`.MeanLimits`
    blocks, vectors                     estimates of closed labels, see :func:`is_pruned`
    counters, closed, front, solutions  labels and front, see :class:`.Search`
    """
    word, shift, limit, words = plan
    k = len(word)
    key = np.zeros(words, np.int64)
    f = np.zeros(k, np.int64)
    g = np.zeros(k, np.int64)
    size = counters[N_OPEN]
    done = counters[N_CLOSED]
    code = SLICE
    while work > 0:
        if size == 0:
            code = DONE
            break
        value = values[0]
        arc = (value & 0xFFFFFFFF) - 1
        v = np.int64(heads[arc]) if arc >= 0 else source
        tight = False
        for j in range(k):
            f[j] = (keys[word[j]] >> shift[j]) & limit[j]
            g[j] = f[j] if is_max[j] else f[j] - h[v, j]
            tight |= g[j] + rise[j] > limit[j]
        longest = longest_duration(f, h, v, most, rates)
        pruned, rows = is_pruned(front, counters[N_FRONT], longest, blocks, vectors, v, f)
        work -= rows
        if pruned:
            drop_first(keys, values, size, words)
            size -= 1
            continue
        if size + fan > len(values):
            code = HEAP
            break
        if done == len(closed):
            code = CLOSED
            break
        if counters[N_FRONT] == len(solutions):
            code = FRONT
            break
        if counters[N_ROWS] + 2 * blocks[v, ROOM] + 2 > len(vectors):
            code = ROWS
            break
        if tight:
            code = KEYS
            break
        drop_first(keys, values, size, words)
        size -= 1
        counters[N_EXPANDED] += 1
        counters[N_ROWS] = enter_row(blocks, vectors, v, f, counters[N_ROWS])
        closed[done] = value
        done += 1
        if is_target[v]:  # a walk may pass a target and return to it with a smaller mean
            counters[N_FRONT] = insert(front, solutions, counters[N_FRONT], f, done)
        for a in range(indptr[v], indptr[v + 1]):
            x = heads[a]
            if h[x, TIME] >= UNREACHABLE:
                continue
            within = True
            for j in range(k):
                f[j] = max(g[j], costs[a, j], h[x, j]) if is_max[j] else g[j] + costs[a, j] + h[x, j]
                within &= f[j] <= most[j]
            if not within:
                continue
            longest = longest_duration(f, h, x, most, rates)
            pruned, rows = is_pruned(front, counters[N_FRONT], longest, blocks, vectors, x, f)
            work -= rows
            if pruned:
                continue
            key[:] = 0
            for j in range(k):
                key[word[j]] |= f[j] << shift[j]
            push(keys, values, size, words, key, (done << 32) | (a + 1))
            size += 1
            counters[N_GENERATED] += 1
    counters[N_OPEN] = size
    counters[N_CLOSED] = done
    return code


@kernel
def enter_all(
    nodes: NDArray[np.int32],
    costs: IntArray,
    begin: int,
    is_target: NDArray[np.uint8],
    blocks: IntArray,
    vectors: IntArray,
    front: IntArray,
    solutions: IntArray,
    counters: IntArray,
) -> int:
    """Enter saved closed labels, from index `begin` on, into blocks and front, as the search did when it closed them.

    nodes, costs  (n,), (n, k)  node and estimate of each label (partial walk)

    Other arguments are those of :func:`advance`. Returns n, or the index of the label for which the blocks or the front
    have too little room.
    """
    for i in range(begin, len(nodes)):
        v = np.int64(nodes[i])
        full = counters[N_FRONT] == len(solutions)
        if full or counters[N_ROWS] + 2 * blocks[v, ROOM] + 2 > len(vectors):
            return i
        counters[N_ROWS] = enter_row(blocks, vectors, v, costs[i], counters[N_ROWS])
        if is_target[v]:
            counters[N_FRONT] = insert(front, solutions, counters[N_FRONT], costs[i], i + 1)
    return len(nodes)


@kernel
def checksum_of_blocks(blocks: IntArray, vectors: IntArray) -> int:
    """Return a checksum of the rows of all blocks (:func:`is_pruned`) that does not depend on their order."""
    total = np.int64(0)
    for b in range(len(blocks)):
        total += (b + 1) * blocks[b, SIZE]
        for i in range(blocks[b, START], blocks[b, START] + blocks[b, SIZE]):
            for j in range(vectors.shape[1]):
                total += (b + 1) * (2 * j + 3) * vectors[i, j]
    return int(total)
