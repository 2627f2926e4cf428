"""A queue of labels by their first cost: chunks of entries a bucket; the lowest bucket is a heap by the rest.

Nearly all labels wait long before they are looked at, and most of those that leave in succession tie in the first
cost. So what waits is only appended to its bucket, 16 bytes an entry, and a bucket is put in order when it opens:
that heap is small and stays in the processor's cache (Dial 1969; Barrett, Maristany and others use buckets on the
first cost in NWMOA*, 2023). Entries leave in lexicographic order, as from one heap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import kernel, lean

CHUNK = 32  # entries
# State of the queue: bucket that is open, entries in its heap, first free chunk, how many are free, chunks ever used.
OPEN, IN_HEAP, FREE, N_FREE, USED, QUEUE = range(6)
Waiting = tuple[NDArray[np.int32], NDArray[np.int32], IntArray]
Heap = tuple[IntArray, IntArray]


@kernel
def open_next(queue: IntArray, waiting: Waiting, heap: Heap) -> int:
    """Move the entries of the next bucket that has any into the empty heap.

    waiting  top chunk of each bucket, -1 for none, and entries in it (b, 2); chunk (c,) below each; entries (e, 2)

    Returns their number, 0 if there are none; if the heap has too little room, minus their number, and moves none.
    """
    tops, below, entries = waiting
    heap_keys, heap_values = heap
    bucket = queue[OPEN]
    while bucket < len(tops) and tops[bucket, 0] < 0:
        bucket += 1
    if bucket == len(tops):
        return 0
    queue[OPEN] = bucket
    count = np.int64(tops[bucket, 1])
    chunk = below[tops[bucket, 0]]
    while chunk >= 0:
        count += CHUNK
        chunk = below[chunk]
    if count > len(heap_keys):
        return int(-count)
    size = np.int64(0)
    chunk = tops[bucket, 0]
    filled = np.int64(tops[bucket, 1])
    while chunk >= 0:
        begin = np.int64(chunk) * CHUNK
        for i in range(begin, begin + filled):
            heap_keys[size] = entries[i, 0]
            heap_values[size] = entries[i, 1]
            size += 1
        after = below[chunk]
        below[chunk] = queue[FREE]
        queue[FREE] = chunk
        queue[N_FREE] += 1
        chunk = after
        filled = np.int64(CHUNK)
    tops[bucket, 0] = -1
    for i in range((size - 2) // 4, -1, -1):
        sift_down(heap_keys, heap_values, i, size)
    return int(size)


@lean
def sift_down(keys: IntArray, values: IntArray, i: int, size: int) -> None:
    """Let entry i of a 4-ary heap sink to its place."""
    key, value = keys[i], values[i]
    while True:
        child = 4 * i + 1
        if child >= size:
            break
        least = keys[child]
        best = child
        for j in range(child + 1, min(child + 4, size)):
            if keys[j] < least:
                least = keys[j]
                best = j
        if least >= key:
            break
        keys[i] = least
        values[i] = values[best]
        i = best
    keys[i] = key
    values[i] = value


def waiting(tops: NDArray[np.int32], below: NDArray[np.int32], entries: IntArray) -> tuple[IntArray, IntArray]:
    """The entries (n, 2) that wait, and their buckets (n,): the lowest first, each as it was filled."""
    counts = np.zeros(len(tops), np.int64)
    n = int(count_waiting(tops, below, counts))
    out, buckets = np.empty((n, 2), np.int64), np.repeat(np.arange(len(tops)), counts)
    copy_waiting(tops, below, entries, counts, out)
    return out, buckets


@lean
def count_waiting(tops: NDArray[np.int32], below: NDArray[np.int32], counts: IntArray) -> int:
    """Count the entries of each bucket (b,); returns their sum."""
    total = np.int64(0)
    for bucket in range(len(tops)):
        chunk, filled = np.int64(tops[bucket, 0]), np.int64(tops[bucket, 1])
        while chunk >= 0:
            counts[bucket] += filled
            chunk, filled = np.int64(below[chunk]), np.int64(CHUNK)
        total += counts[bucket]
    return int(total)


@lean
def copy_waiting(
    tops: NDArray[np.int32], below: NDArray[np.int32], entries: IntArray, counts: IntArray, out: IntArray
) -> None:
    """Copy the entries of all buckets, of each the chunk on top last."""
    end = np.int64(0)
    for bucket in range(len(tops)):
        end += counts[bucket]
        at = end
        chunk, filled = np.int64(tops[bucket, 0]), np.int64(tops[bucket, 1])
        while chunk >= 0:
            at -= filled
            for i in range(filled):
                out[at + i, 0] = entries[chunk * CHUNK + i, 0]
                out[at + i, 1] = entries[chunk * CHUNK + i, 1]
            chunk, filled = np.int64(below[chunk]), np.int64(CHUNK)


def fill(
    tops: NDArray[np.int32], below: NDArray[np.int32], entries: IntArray, buckets: IntArray, waiting: IntArray
) -> None:
    """Fill empty buckets with entries (n, 2), whose buckets (n,) are in order, from the first chunk on."""
    which, first, counts = np.unique(buckets, return_index=True, return_counts=True)
    chunks = -(-counts // CHUNK)
    begin = np.cumsum(chunks) - chunks
    used = int(chunks.sum())
    entries[np.repeat(begin * CHUNK - first, counts) + np.arange(len(waiting))] = waiting
    below[:used] = np.arange(used) - 1
    below[begin] = -1
    tops[which, 0] = begin + chunks - 1
    tops[which, 1] = counts - (chunks - 1) * CHUNK
