"""Base class of searches that keep all open labels (partial paths) in one heap, ordered by all their costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.search.machinery.kernels import plan_keys, repack
from hpop.search.machinery.labels import Unsound, is_heap
from hpop.search.machinery.slices import HEAP, KEYS, N_OPEN, Clock, Search


class HeapSearch(Search):
    """Search with a 4-ary heap of open labels (partial paths), sorted by their estimates (lower bounds of costs).

    keys    (capacity * words,)  estimates, packed into words that sort in lexicographic order
    values  (capacity,)          the labels
    plan    how estimates are packed into keys, of :func:`.plan_keys`
    """

    keys: IntArray
    values: IntArray

    def __init__(self, f: list[int], rise: list[int], fan: int) -> None:
        """Start with one open label (partial path), at the source.

        f     (k,)  estimate of this label
        rise  (k,)  largest growth of an estimate in one expansion
        fan         largest number of new labels that one expansion adds
        """
        super().__init__(len(f), fan)
        self.rise = np.array(rise, np.int64)
        self.plan = plan_keys([2 * (a + b) for a, b in zip(f, rise, strict=True)])
        self.keys = np.zeros(max(1024, 2 * fan) * self.plan[3], np.int64)
        self.values = np.zeros(max(1024, 2 * fan), np.int64)
        for j, value in enumerate(f):
            self.keys[self.plan[0][j]] |= value << int(self.plan[1][j])

    def arrays(self) -> list[np.ndarray[Any, Any]]:
        """Return the arrays of the heap."""
        return [self.keys, self.values]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many bytes more are needed, and a function that doubles the heap or widens its keys.

        ``code`` is the return value of a kernel that ran out of room: HEAP or KEYS.
        """
        if code == HEAP:
            return self.keys.nbytes + self.values.nbytes, self._grow_heap
        if code == KEYS:
            return self.values.nbytes * self._wider_packing()[3], self._widen_keys
        raise AssertionError(f"a kernel returned {code}, which names no array of its search; please report this bug")

    def estimates(self) -> IntArray:
        """Return the estimates (m, k) of all open labels (partial paths), unpacked from the heap's keys."""
        word, shift, limit, words = self.plan
        keys = self.keys[: int(self.counters[N_OPEN]) * words].reshape(-1, words)
        return (keys[:, word] >> shift) & limit

    def open_labels(self) -> tuple[IntArray, IntArray]:
        """Return the open labels (partial paths) in the heap, and an empty array, as this search has no buckets."""
        return self.values[: int(self.counters[N_OPEN])], np.zeros(0, np.int64)

    def reopen(self, heap: IntArray, waiting: IntArray, costs: NDArray[Any], clock: Clock) -> None:
        """Fill the heap with saved labels (h,) and their estimates ``costs`` (h, k); raise Unsound if it is no heap.

        Labels are partial paths; estimates are their costs plus lower bounds of the remaining costs. ``waiting`` must
        be empty: this search has no buckets.
        """
        if len(waiting):
            raise Unsound("saved partial paths are in buckets, which this search does not use")
        n = len(heap)
        while n and (costs.max(axis=0) > self.plan[2]).any():
            self._widen_keys()
        while len(self.values) < n:
            self._grow_heap()
        word, shift, _, words = self.plan
        self.keys[: n * words] = 0
        for j in range(costs.shape[1]):
            self.keys[word[j] : n * words : words] |= costs[:, j].astype(np.int64) << shift[j]
        self.values[:n] = heap
        if not clock.call(is_heap, self.keys, n, words):
            raise Unsound("the saved open partial paths are not in the order of a heap")

    def _grow_heap(self) -> None:
        self.keys.resize(2 * len(self.keys), refcheck=False)
        self.values.resize(2 * len(self.values), refcheck=False)

    def _wider_packing(self) -> tuple[IntArray, IntArray, IntArray, int]:
        return plan_keys([2 * int(limit) for limit in self.plan[2]])

    def _widen_keys(self) -> None:
        new = self._wider_packing()
        keys = np.zeros(len(self.values) * new[3], np.int64)
        repack(self.keys, int(self.counters[N_OPEN]), self.plan, new, keys)
        self.keys, self.plan = keys, new
