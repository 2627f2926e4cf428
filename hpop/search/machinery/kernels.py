"""Kernels that searches share, and their compilation: a 4-ary heap, coverage of vectors, the gap of a front."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import is_cached, kernel, lean, numba
from hpop.runtime.interrupts import interrupts_held

# Imported on first use only, because importing numba takes half a second.


WORD_BITS = 62  # bits used of each key word, so that it is non-negative as int64


# Kernels assign arrays element by element. If they assigned whole arrays, numba would also compile the error message
# for different shapes, which takes two seconds.


def signature(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the numba type of each argument, by which numba finds the compiled version of a kernel."""
    typeof: Callable[[Any], Any] = numba.typeof
    return tuple(typeof(a) for a in arguments)


def is_ready(compiled: Any, *arguments: Any) -> bool:
    """Return whether a kernel is compiled and in memory for arguments of these types.

    numba takes a third of a millisecond to find the types of a search's arguments, which is long for a slice. So the
    layouts of arguments are remembered for which a kernel is ready.
    """
    key = compiled, _argument_layout(arguments)
    if key in _ready:
        return True
    if signature(arguments) not in compiled.overloads:
        return False
    _ready.add(key)
    return True


_ready: set[tuple[Any, Any]] = set()


def _argument_layout(argument: Any) -> Any:
    if isinstance(argument, tuple):
        return tuple(map(_argument_layout, argument))
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)


def make_ready(compiled: Any, *arguments: Any) -> None:
    """Compile a kernel for these arguments, or load it from the cache.

    During a load Ctrl-C is delayed, because llvmlite drops exceptions that are raised in it; a load is short.
    """
    with interrupts_held() if is_cached(compiled) else nullcontext():
        compiled.compile(signature(arguments))


@lean
def push(keys: IntArray, values: IntArray, size: int, words: int, key: IntArray, value: int) -> None:
    """Add an entry, with a `key` (words,) and a `value`, to a 4-ary heap of `size` entries.

    keys    (capacity * words,)  keys of the entries, compared lexicographically; the heap's first entry is the least
    values  (capacity,)          numbers that belong to the keys
    words   number of integers in a key

    Both arrays are changed; the caller counts the entries.
    """
    i = size
    if words == 1:
        first = key[0]
        while i > 0:
            p = (i - 1) >> 2
            if keys[p] <= first:
                break
            keys[i] = keys[p]
            values[i] = values[p]
            i = p
        keys[i] = first
        values[i] = value
        return
    while i > 0:
        p = (i - 1) >> 2
        smaller = False
        for w in range(words):
            if key[w] != keys[p * words + w]:
                smaller = key[w] < keys[p * words + w]
                break
        if not smaller:
            break
        for w in range(words):
            keys[i * words + w] = keys[p * words + w]
        values[i] = values[p]
        i = p
    for w in range(words):
        keys[i * words + w] = key[w]
    values[i] = value


@lean
def drop_first(keys: IntArray, values: IntArray, size: int, words: int) -> None:
    """Remove the first (least) entry of a heap of `size` entries, in place; arguments as in :func:`push`."""
    n = size - 1
    value = values[n]
    i = 0
    if words == 1:
        last = keys[n]
        while True:
            child = 4 * i + 1
            if child >= n:
                break
            least = keys[child]
            best = child
            for j in range(child + 1, min(child + 4, n)):
                if keys[j] < least:
                    least = keys[j]
                    best = j
            if least >= last:
                break
            keys[i] = least
            values[i] = values[best]
            i = best
        keys[i] = last
        values[i] = value
        return
    while True:
        child = 4 * i + 1
        if child >= n:
            break
        best = child
        for j in range(child + 1, min(child + 4, n)):
            if precedes(keys, j, best, words):
                best = j
        if not precedes(keys, best, n, words):
            break
        for w in range(words):
            keys[i * words + w] = keys[best * words + w]
        values[i] = values[best]
        i = best
    for w in range(words):
        keys[i * words + w] = keys[n * words + w]
    values[i] = value


@lean
def precedes(keys: IntArray, i: int, j: int, words: int) -> bool:
    """Return whether the key of entry i of a heap is lexicographically less than that of entry j.

    keys, words  keys of all entries, and number of integers in each, see :func:`push`
    """
    for w in range(words):
        a, b = keys[i * words + w], keys[j * words + w]
        if a != b:
            return bool(a < b)
    return False


def plan_keys(largest: list[int]) -> tuple[IntArray, IntArray, IntArray, int]:
    """Plan how to pack columns of non-negative integers into few 62-bit words that sort in the same order.

    ``largest`` has the largest value of each column. Returns three arrays, with an entry for each column: its word, its
    bit shift in this word, and the largest value that fits. The fourth value is the number of words.

    >>> word, shift, limit, words = plan_keys([1000, 63, 5])
    >>> words, shift.tolist(), limit.tolist()
    (1, [9, 3, 0], [1023, 63, 7])
    """
    bits = [min(WORD_BITS, max(1, value.bit_length())) for value in largest]
    word = np.zeros(len(bits), np.int64)
    shift = np.zeros(len(bits), np.int64)
    used = 0
    for j, width in enumerate(bits):
        if j and used + width > WORD_BITS:
            word[j:] += 1
            used = 0
        used += width
        for i in range(j):
            if word[i] == word[j]:
                shift[i] += width
    limit = np.array([2**width - 1 for width in bits], np.int64)
    return word, shift, limit, int(word[-1]) + 1


@kernel
def repack(
    keys: IntArray,
    size: int,
    old: tuple[IntArray, IntArray, IntArray, int],
    new: tuple[IntArray, IntArray, IntArray, int],
    out: IntArray,
) -> None:
    """Pack the keys of a heap anew, when their columns have become wider; write them to `out`, which is 0 before.

    keys, size  keys of the heap, and its number of entries
    old, new    plans of :func:`plan_keys` by which `keys` are packed, and by which `out` is to be packed
    """
    for i in range(size):
        for j in range(len(old[0])):
            value = (keys[i * old[3] + old[0][j]] >> old[1][j]) & old[2][j]
            out[i * new[3] + new[0][j]] |= value << new[1][j]


@lean
def excess(vector: FloatArray, least: FloatArray) -> float:
    """Return the largest relative excess, over all costs, of a vector (k,) over an estimate `least` (k,); at least 0.

    The result is infinite if the vector has a positive cost where the estimate is 0.
    """
    worst = 0.0
    for j in range(len(vector)):
        if least[j] > 0:
            worst = max(worst, vector[j] / least[j] - 1.0)
        elif vector[j] > 0:
            return np.inf
    return worst


@lean
def nearest(front: FloatArray, least: FloatArray, first: int, enough: float) -> tuple[float, int]:
    """Return the least excess of a vector of the front (n, k) over an estimate `least` (k,), and the vector's index.

    Vector `first` is tried before all others. The first one whose excess is at most `enough` is returned.
    """
    best, at = excess(front[first], least), first
    if best > enough:
        for r in range(len(front)):
            gap_of_vector = excess(front[r], least)
            if gap_of_vector < best:
                best, at = gap_of_vector, r
                if best <= enough:
                    break
    return best, at


@lean
def largest_gap(front: FloatArray, estimates: FloatArray, most: float) -> float:
    """Return the least gap such that each estimate (m, k) has a vector of the front (n, k) within (1 + gap) times it.

    The computation stops as soon as the gap reaches `most`. Neighbouring estimates are similar, so the vector that was
    nearest to one estimate is tried first for the next.
    """
    gap = 0.0
    last = 0
    for i in range(len(estimates)):
        best, last = nearest(front, estimates[i], last, gap)
        gap = max(gap, best)
        if gap >= most:
            break
    return gap


def proven_gap(front: IntArray, estimates: IntArray, most: float) -> float:
    """Return the gap of a front (n, k) to estimates (m, k), like :func:`hpop.search.machinery.proven_gap`, but faster.

    As soon as the gap reaches `most`, the computation stops and returns the gap found by then.
    """
    if not len(estimates):
        return 0.0
    if not len(front):
        return float("inf")
    return float(largest_gap(front.astype(np.float64), np.ascontiguousarray(estimates, np.float64), most))


@kernel
def least_covered(cost: int, eps: float, tolerance: int) -> int:
    """Return the least estimate that a cost of a known solution covers within a precision (`eps`, `tolerance`).

    This is the smallest f >= 0 with f + floor(eps f) + tolerance >= cost. A path whose estimated cost is f or more is
    not needed beside that solution.
    """
    if cost <= tolerance:
        return 0
    rounding = 2 + (cost >> 50)  # bound on the rounding of the quotient
    f = max(np.int64(0), np.int64((cost - tolerance) / (1.0 + eps)) - rounding)
    while f + np.int64(f * eps) + tolerance < cost:
        f += 1
    return int(f)
