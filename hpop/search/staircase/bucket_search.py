"""A search whose open labels wait in buckets of their first cost; the lowest is a heap by the rest: :mod:`.buckets`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.search.machinery.labels import Unsound, is_heap
from hpop.search.machinery.slices import Clock, Search
from hpop.search.staircase.buckets import CHUNK, FREE, IN_HEAP, N_FREE, OPEN, QUEUE, USED, fill, waiting

MOST_BUCKETS = 2**24  # that labels of a checkpoint may need


class BucketSearch(Search):
    """The queue of a search with three costs.

    packing  (5,)  of keys: bits of the first cost within a bucket, bits of the last, where those of the first begin;
                   the first cost's least bucket; the largest last cost
    rise     (3,)  what an estimate may grow by in one expansion
    """

    packing: IntArray
    rise: IntArray

    def _make_queue(self, f: list[int], packing: IntArray) -> None:
        """The queue with one label of estimate f (3,)."""
        self.packing = packing
        shift, bits, top = packing[:3].tolist()
        buckets = 2 * ((int(self.rise[0]) >> shift) + 2)
        self.queue = np.zeros(QUEUE, np.int64)
        self.queue[[IN_HEAP, FREE]] = 1, -1
        self.tops = np.full((buckets, 2), -1, np.int32)
        chunks = max(64, 2 * self.fan)
        self.below = np.zeros(chunks, np.int32)
        self.entries = np.zeros((chunks * CHUNK, 2), np.int64)
        self.keys, self.values = (np.zeros(max(1024, 2 * self.fan), np.int64) for _ in range(2))
        self.keys[0] = ((f[0] & ((1 << shift) - 1)) << top) | (f[1] << bits) | f[2]

    def estimates(self) -> IntArray:
        """Estimates (m, 3) of the labels still open."""
        shift, bits, top, origin, _ = self.packing.tolist()
        entries, buckets = waiting(self.tops, self.below, self.entries)
        key = np.concatenate([self.keys[: self.queue[IN_HEAP]], entries[:, 0]])
        bucket = np.concatenate([np.full(self.queue[IN_HEAP], self.queue[OPEN]), buckets])
        first = ((bucket + origin) << shift) | (key >> top)
        return np.stack([first, (key >> bits) & ((1 << (top - bits)) - 1), key & ((1 << bits) - 1)], axis=1)

    def opened(self) -> tuple[IntArray, IntArray]:
        """The labels still open: in the heap, and in the buckets, the lowest first."""
        entries, _ = waiting(self.tops, self.below, self.entries)
        return self.values[: self.queue[IN_HEAP]], entries[:, 1]

    def reopen(self, heap: IntArray, waiting: IntArray, costs: NDArray[Any], clock: Clock) -> None:
        """Fill the heap and the buckets with labels, and their estimates."""
        shift, bits, top, origin, _ = self.packing.tolist()
        n = len(heap)
        buckets = (costs[:, 0] >> shift) - origin
        opened, later = int(buckets[0]) if n else 0, buckets[n:]
        sound = (buckets[:n] == opened).all() and (np.diff(later, prepend=opened) >= 0).all()
        if not sound or opened < 0 or (n > 0 and opened in later[:1]) or buckets.max(initial=0) > MOST_BUCKETS:
            raise Unsound("its open labels are in no queue")
        while buckets.max(initial=0) >= len(self.tops):
            self._grow_buckets()
        while len(self.values) < n:
            self._grow_heap()
        keys = ((costs[:, 0] & ((1 << shift) - 1)) << top) | (costs[:, 1] << bits) | costs[:, 2]
        self.keys[:n], self.values[:n] = keys[:n], heap
        if not clock.call(is_heap, self.keys, n, 1):
            raise Unsound("its open labels are no heap")
        used = -(-np.bincount(later) // CHUNK).sum()
        while len(self.below) < used:
            self._grow_chunks()
        fill(self.tops, self.below, self.entries, later, np.stack([keys[n:], waiting], axis=1))
        self.queue[[OPEN, IN_HEAP, FREE, N_FREE, USED]] = opened, n, -1, 0, used

    def _grow_heap(self) -> None:
        self.keys, self.values = (np.resize(a, 2 * len(a)) for a in (self.keys, self.values))

    def _grow_chunks(self) -> None:
        self.below.resize(2 * len(self.below), refcheck=False)
        self.entries.resize((2 * len(self.entries), 2), refcheck=False)

    def _grow_buckets(self) -> None:
        self.tops = np.concatenate([self.tops, np.full_like(self.tops, -1)])
