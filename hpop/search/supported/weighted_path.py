"""Shortest paths for integer weights of the costs, exact for weights of any size.

Dijkstra's algorithm runs on the weighted sums w . c. Weights are determinants and can be large: with three costs of 25
bits the products exceed 64 bits. So a sum is stored in words of 62 bits, most significant first, and added with carry.
Costs are reduced by lower bounds of the remaining costs (Johnson's potentials, one for each cost and so valid for all
weights), which turns Dijkstra's algorithm into A*.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.machinery.kernels import WORD_BITS, drop_first, push

LIMB_BITS = 31
LIMB_MASK = np.int64(2**LIMB_BITS - 1)
WORD_MASK = np.int64(2**WORD_BITS - 1)
UNSEEN = np.int64(-2)


def encoded(weights: Sequence[int], limit: int, largest: Sequence[int]) -> tuple[IntArray, IntArray]:
    """Encode large integers for the kernel: weights (k, L) in L digits of 31 bits, and the limit (W,) in W words.

    Digits are in order from the lowest, words from the highest. W is large enough that no sum overflows; ``largest``
    (k,) is the greatest cost of an arc in each column.

    >>> encoded([1, 2**40], 2**62 + 5, [1, 1])[1].tolist()
    [1, 5]
    """
    arc = sum(w * c for w, c in zip(weights, largest, strict=True))
    words = -(-(limit + arc + 1).bit_length() // WORD_BITS)
    count = -(-max(w.bit_length() for w in weights) // LIMB_BITS)
    limbs = [[(w >> (LIMB_BITS * i)) & int(LIMB_MASK) for i in range(count)] for w in weights]
    top_first = [(limit >> (WORD_BITS * i)) & int(WORD_MASK) for i in reversed(range(words))]
    return np.array(limbs, np.int64), np.array(top_first, np.int64)


@lean
def write_weighted_cost(costs: IntArray, a: int, weights: IntArray, limbs: IntArray, step: IntArray) -> None:
    """Write the weighted sum of the costs of arc a to `step` (W,), in words of 62 bits, most significant first.

    weights  (k, L)      weights in digits of 31 bits, of :func:`encoded`
    limbs    (2 W + 3,)  scratch
    """
    words = len(step)
    k, count = weights.shape
    if words == 1 and count == 1:
        value = np.int64(0)
        for j in range(k):
            value += weights[j, 0] * np.int64(costs[a, j])
        step[0] = value
        return
    for i in range(len(limbs)):
        limbs[i] = 0
    for j in range(k):
        remaining = np.int64(costs[a, j])
        shift = 0
        while remaining > 0:
            digit = remaining & LIMB_MASK
            remaining >>= LIMB_BITS
            for i in range(min(count, 2 * words - shift)):  # higher limbs are zero
                product = weights[j, i] * digit
                limbs[i + shift] += product & LIMB_MASK
                limbs[i + shift + 1] += product >> LIMB_BITS
            shift += 1
    for i in range(2 * words):
        limbs[i + 1] += limbs[i] >> LIMB_BITS
        limbs[i] &= LIMB_MASK
    for w in range(words):
        step[words - 1 - w] = limbs[2 * w] | (limbs[2 * w + 1] << LIMB_BITS)


@lean
def compare(a: IntArray, b: IntArray) -> int:
    """Return -1, 0 or 1, the sign of a - b; both are numbers in words of 62 bits, most significant word first."""
    for w in range(len(a)):
        if a[w] != b[w]:
            return -1 if a[w] < b[w] else 1
    return 0


@kernel
def arcs_onward(indptr: IntArray, heads: NDArray[np.int32], bound: IntArray, unreachable: int) -> IntArray:
    """Count the arcs to nodes that reach a target; return the offsets (n + 1,) of each node if only these are listed.

    indptr, heads  arcs of the graph, see :class:`.Graph`
    bound  (n,)    lower bounds of the remaining costs; `unreachable` if no target is reached
    """
    start = np.zeros(len(indptr), np.int64)
    for u in range(len(indptr) - 1):
        start[u + 1] = start[u]
        for a in range(indptr[u], indptr[u + 1]):
            start[u + 1] += bound[heads[a]] < unreachable
    return start


@kernel
def reduce_costs(
    nodes: tuple[int, int],
    graph: tuple[IntArray, NDArray[np.int32], IntArray],
    h: IntArray,
    unreachable: int,
    start: IntArray,
    origin: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
) -> tuple[IntArray, NDArray[np.float64]]:
    """Write the arcs of a range of nodes, with reduced costs c(u, v) + h(v) - h(u), without arcs that reach no target.

    nodes   the first node, and one past the last node
    graph   indptr, heads and costs
    h       (k, n)  lower bounds of the remaining costs, `unreachable` or more if no target is reached
    start   (n + 1,)  offsets of :func:`arcs_onward`
    origin  (m,)  output: index of each arc in the graph; heads (m,) and costs (m, k): output

    Returns the largest reduced cost of an arc (k,), and upper bounds (k,) on the sums over these nodes along a path
    without cycles.
    """
    indptr, all_heads, all_costs = graph
    k = len(h)
    largest = np.zeros(k, np.int64)
    bound = np.zeros(k, np.float64)
    most = np.empty(k, np.int64)
    for u in range(nodes[0], nodes[1]):
        for j in range(k):
            most[j] = 0
        i = start[u]
        for a in range(indptr[u], indptr[u + 1]):
            v = all_heads[a]
            if h[0, v] >= unreachable:
                continue
            origin[i] = a
            heads[i] = v
            for j in range(k):
                cost = all_costs[a, j] + h[j, v] - h[j, u]
                costs[i, j] = cost
                most[j] = max(most[j], cost)
            i += 1
        for j in range(k):
            largest[j] = max(largest[j], most[j])
            bound[j] += most[j]
    return largest, bound


@kernel
def weighted_path(
    indptr: IntArray,
    heads: NDArray[np.int32],
    costs: IntArray,
    source: int,
    is_target: NDArray[np.uint8],
    weights: IntArray,
    limit: IntArray,
) -> IntArray:
    """Return the arcs of the path from the source to a target with the least weighted sum of costs.

    The result is [-1] if no path is within the limit.

    indptr, heads, costs  arcs in compressed rows, with costs (m, k); the arcs are returned as indices in these
    is_target             (n,)  mask of nodes
    weights, limit        results of :func:`encoded`
    """
    n = len(indptr) - 1
    words = len(limit)
    best = np.empty((n, words), np.int64)
    arc_in = np.full(n, UNSEEN)
    tail_in = np.empty(n, np.int32)
    capacity = 1024
    keys = np.empty(capacity * words, np.int64)
    nodes = np.empty(capacity, np.int64)
    cost = np.zeros(words, np.int64)
    new_cost = np.empty(words, np.int64)
    step = np.empty(words, np.int64)
    limbs = np.empty(2 * words + 3, np.int64)
    for w in range(words):
        best[source, w] = 0
    arc_in[source] = -1
    size = np.int64(0)  # not 0: numba would compile the heap once for that number alone
    push(keys, nodes, size, words, cost, source)
    size += 1
    reached = -1
    while size > 0:
        u = nodes[0]
        for w in range(words):
            cost[w] = keys[w]
        drop_first(keys, nodes, size, words)
        size -= 1
        if compare(cost, best[u]) > 0:
            continue
        if is_target[u]:
            reached = u
            break
        while size + indptr[u + 1] - indptr[u] > capacity:
            keys = np.concatenate((keys, np.empty_like(keys)))
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
            capacity *= 2
        for a in range(indptr[u], indptr[u + 1]):
            head = np.int64(heads[a])
            write_weighted_cost(costs, a, weights, limbs, step)
            carry = np.int64(0)
            for w in range(words - 1, -1, -1):
                total = cost[w] + step[w] + carry
                carry = total >> WORD_BITS
                new_cost[w] = total & WORD_MASK
            if compare(new_cost, limit) > 0 or (arc_in[head] != UNSEEN and compare(new_cost, best[head]) >= 0):
                continue
            for w in range(words):
                best[head, w] = new_cost[w]
            arc_in[head] = a
            tail_in[head] = u
            push(keys, nodes, size, words, new_cost, head)
            size += 1
    if reached < 0:
        return np.full(1, -1, np.int64)
    length = 0
    v = reached
    while arc_in[v] >= 0:
        length += 1
        v = tail_in[v]
    path = np.empty(length, np.int64)
    v = reached
    while arc_in[v] >= 0:
        length -= 1
        path[length] = arc_in[v]
        v = tail_in[v]
    return path
