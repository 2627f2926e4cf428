"""Base classes of the staircase search: a queue with a bucket for each range of first costs, and joint bounds.

An entry of the queue is an open label (partial path) with its key. A bucket is the list of entries whose first cost is
in one range; it is stored in chunks of CHUNK entries.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.search.graph import Graph
from hpop.search.machinery import ANYTHING, Precision, thin_front
from hpop.search.machinery.bounds import UNREACHABLE, lower_bounds
from hpop.search.machinery.labels import Unsound, is_heap
from hpop.search.machinery.slices import N_EXPANDED, N_FRONT, N_GENERATED, Clock, Search
from hpop.search.machinery.turns import Groups, NoRoom
from hpop.search.staircase.labels import UncoveredCorners, least_estimates
from hpop.search.staircase.tables import H_FIRST, H_REST
from hpop.search.staircase.turn_hull import LANES, ROOM, HullBounds, IntLanes, TurnHull, directions, turn_hull

# Nearly all labels wait long before they are expanded, and most successive labels have equal first costs. So a new
# label is only appended to the bucket of its first cost, 16 bytes for each entry. When the search reaches a bucket, its
# entries become a heap, which is small and stays in the processor's cache (Dial 1969; Barrett, Maristany and others use
# buckets on the first cost in NWMOA*, 2023). Entries leave in lexicographic order, as from one heap.


CHUNK = 32  # number of entries in a chunk; a bucket is a linked list of chunks
# State of the queue: open bucket, entries in its heap, first free chunk, number of free chunks, chunks ever used.
OPEN, IN_HEAP, FREE, N_FREE, USED, QUEUE = range(6)
Waiting = tuple[NDArray[np.int32], NDArray[np.int32], IntArray]
Heap = tuple[IntArray, IntArray]


@kernel
def open_next(queue: IntArray, waiting: Waiting, heap: Heap) -> int:
    """Move the entries of the next non-empty bucket into the empty heap; return the number of entries.

    queue    state of the queue, with indices OPEN to USED
    waiting  tops (b, 2): top chunk of each bucket, or -1, and the number of entries in it; below (c,): next chunk
             below each chunk; entries (e, 2): key and label
    heap     keys and labels of the heap

    Returns 0 if all buckets are empty. If the heap has too little room, nothing is moved, and minus the number of
    entries is returned.
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
    """Move entry i of a 4-ary heap of `size` entries down to its position by its key."""
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


def waiting_entries(tops: NDArray[np.int32], below: NDArray[np.int32], entries: IntArray) -> tuple[IntArray, IntArray]:
    """Return all entries (n, 2) that wait in buckets, key and label, and the bucket (n,) of each.

    They are sorted by bucket, and in a bucket by age, the oldest first. Arguments as in :func:`open_next`.
    """
    counts = np.zeros(len(tops), np.int64)
    n = int(count_entries(tops, below, counts))
    out, buckets = np.empty((n, 2), np.int64), np.repeat(np.arange(len(tops)), counts)
    copy_entries(tops, below, entries, counts, out)
    return out, buckets


@lean
def count_entries(tops: NDArray[np.int32], below: NDArray[np.int32], counts: IntArray) -> int:
    """Count the entries of each bucket, write the numbers to `counts` (b,), which is 0 before, and return their sum."""
    total = np.int64(0)
    for bucket in range(len(tops)):
        chunk, filled = np.int64(tops[bucket, 0]), np.int64(tops[bucket, 1])
        while chunk >= 0:
            counts[bucket] += filled
            chunk, filled = np.int64(below[chunk]), np.int64(CHUNK)
        total += counts[bucket]
    return int(total)


@lean
def copy_entries(
    tops: NDArray[np.int32], below: NDArray[np.int32], entries: IntArray, counts: IntArray, out: IntArray
) -> None:
    """Copy the entries of all buckets to `out` (n, 2), bucket after bucket, in each the oldest entries first.

    `counts` (b,) has the number of entries of each bucket.
    """
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


def fill_buckets(
    tops: NDArray[np.int32], below: NDArray[np.int32], entries: IntArray, buckets: IntArray, waiting: IntArray
) -> None:
    """Fill empty buckets (see :func:`open_next`) with saved entries `waiting` (n, 2), sorted by `buckets` (n,)."""
    which, first, counts = np.unique(buckets, return_index=True, return_counts=True)
    chunks = -(-counts // CHUNK)
    begin = np.cumsum(chunks) - chunks
    used = int(chunks.sum())
    entries[np.repeat(begin * CHUNK - first, counts) + np.arange(len(waiting))] = waiting
    below[:used] = np.arange(used) - 1
    below[begin] = -1
    tops[which, 0] = begin + chunks - 1
    tops[which, 1] = counts - (chunks - 1) * CHUNK


MOST_BUCKETS = 2**24  # largest number of buckets for labels of a checkpoint


class BucketSearch(Search):
    """Search with three costs whose open labels (partial paths) wait in buckets by first cost; the lowest is a heap.

    packing  (5,)  how estimates are packed into keys: bits of the first cost within a bucket, bits of the last cost,
                   bit position of the first cost, first cost of bucket 0 without its bits within, largest last cost
    rise     (3,)  largest growth of an estimate in one expansion
    """

    packing: IntArray
    rise: IntArray

    def _make_queue(self, f: list[int], packing: IntArray) -> None:
        """Set up the queue with one label (partial path) of the estimate f (3,), at the source."""
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
        """Return the estimates (m, 3) of all open labels (partial paths), unpacked from their keys."""
        shift, bits, top, origin, _ = self.packing.tolist()
        entries, buckets = waiting_entries(self.tops, self.below, self.entries)
        key = np.concatenate([self.keys[: self.queue[IN_HEAP]], entries[:, 0]])
        bucket = np.concatenate([np.full(self.queue[IN_HEAP], self.queue[OPEN]), buckets])
        first = ((bucket + origin) << shift) | (key >> top)
        return np.stack([first, (key >> bits) & ((1 << (top - bits)) - 1), key & ((1 << bits) - 1)], axis=1)

    def open_labels(self) -> tuple[IntArray, IntArray]:
        """Return the open labels (partial paths) in the heap, and those in buckets, lowest bucket first."""
        entries, _ = waiting_entries(self.tops, self.below, self.entries)
        return self.values[: self.queue[IN_HEAP]], entries[:, 1]

    def reopen(self, heap: IntArray, waiting: IntArray, costs: NDArray[Any], clock: Clock) -> None:
        """Fill the heap and the buckets with saved labels (partial paths) and estimates, see :meth:`.Search.reopen`."""
        shift, bits, top, origin, _ = self.packing.tolist()
        n = len(heap)
        buckets = (costs[:, 0] >> shift) - origin
        open_labels, later = int(buckets[0]) if n else 0, buckets[n:]
        sound = (buckets[:n] == open_labels).all() and (np.diff(later, prepend=open_labels) >= 0).all()
        if (
            not sound
            or open_labels < 0
            or (n > 0 and open_labels in later[:1])
            or buckets.max(initial=0) > MOST_BUCKETS
        ):
            raise Unsound("the saved open partial paths are not sorted by their first cost")
        while buckets.max(initial=0) >= len(self.tops):
            self._grow_buckets()
        while len(self.values) < n:
            self._grow_heap()
        keys = ((costs[:, 0] & ((1 << shift) - 1)) << top) | (costs[:, 1] << bits) | costs[:, 2]
        self.keys[:n], self.values[:n] = keys[:n], heap
        if not clock.call(is_heap, self.keys, n, 1):
            raise Unsound("the saved open partial paths are not in the order of a heap")
        used = -(-np.bincount(later) // CHUNK).sum()
        while len(self.below) < used:
            self._grow_chunks()
        fill_buckets(self.tops, self.below, self.entries, later, np.stack([keys[n:], waiting], axis=1))
        self.queue[[OPEN, IN_HEAP, FREE, N_FREE, USED]] = open_labels, n, -1, 0, used

    def _grow_heap(self) -> None:
        self.keys, self.values = (np.resize(a, 2 * len(a)) for a in (self.keys, self.values))

    def _grow_chunks(self) -> None:
        self.below.resize(2 * len(self.below), refcheck=False)
        self.entries.resize((2 * len(self.entries), 2), refcheck=False)

    def _grow_buckets(self) -> None:
        self.tops = np.concatenate([self.tops, np.full_like(self.tops, -1)])


# Joint bounds are explained in :mod:`.turn_hull`, and pruning by them in :mod:`.labels`.


NEAR = 4  # the first front, of paths on the best paths of joint bounds, and these bounds have the precision eps / NEAR
THIN = 3  # a part of the first front, which covers it within eps / THIN, becomes solutions


class JointSearch(BucketSearch):
    """Part of the staircase search that prunes by joint bounds: lower bounds of first and rest cost together.

    has_tried_bounds  whether further bounds were computed, or were found not to be possible
    hull              joint bounds in use, or None
    corners_size      size of the front when the corners of the uncovered region were last updated
    hull_paths        arcs of the first solutions, which come with joint bounds and have no labels (partial paths)
    closed_arcs       (m,) mask of closed arcs of the graph, or None
    """

    graph: Graph
    source: int
    precision: Precision
    tolerance: IntArray
    at_most: tuple[int, ...]
    groups: Groups
    order: tuple[int, int, int]
    nodes: NDArray[Any]
    start: IntArray
    arcs: NDArray[Any]
    is_target: NDArray[np.uint8]
    has_tried_bounds: bool
    hull: HullBounds | None = None
    corners_size: int = 0
    hull_paths: tuple[IntArray, ...] = ()
    closed_arcs: BoolArray | None = None

    @abstractmethod
    def _search_on(
        self, part: Graph, source: int, targets: IntArray, h: IntArray, groups: Groups, clock: Clock, near: Precision
    ) -> BucketSearch:
        """Return a new search with the precision ``near`` on a part of the graph."""

    def _compute_joint_bounds(self, clock: Clock) -> bool:
        """Compute joint bounds and first solutions, and use them from now on.

        Returns False if the graph does not allow joint bounds, or memory or time do not suffice.
        """
        limit = clock.budget.max_memory
        room = ROOM if limit is None else limit - self.memory()
        columns = (self.order[0], self.order[2])
        weights = directions((int(self.nodes[:, H_FIRST].max()), int(self.nodes[:, H_REST].max())))
        best = self.nodes[self.source, [H_FIRST, H_REST]]
        enough = best * (1 + self.precision.eps / NEAR) + self.tolerance[[0, 2]] // NEAR
        near = enough[0] * weights[0, 0], enough[1] * weights[1, 1]

        def is_enough(now: IntLanes) -> bool:
            return not (now[self.source, :2] > near).any()

        tables = (self.nodes, self.start, self.arcs)
        hull = turn_hull(self.groups, columns, weights, *tables, self.is_target, is_enough, room, clock)
        if hull is None:
            return False
        self.take_joint_bounds(hull, *self.front_near_hull(hull, clock), clock)
        return True

    def front_near_hull(self, hull: TurnHull, clock: Clock) -> tuple[IntArray, list[IntArray]]:
        """Return a first approximate front (n, 3), columns in the order of the search, and the arcs of its paths.

        It is the front of the paths that use only nodes on best paths of joint bounds.
        """
        columns = (self.order[0], self.order[2])
        nodes_on_best_paths = hull.nodes_on_best_paths(
            self.groups, columns, self.nodes, self.start, self.arcs, self.source, clock
        )
        return self._front_through(nodes_on_best_paths, clock)

    def take_joint_bounds(self, hull: TurnHull, costs: IntArray, paths: Sequence[IntArray], clock: Clock) -> None:
        """Add known paths to the solutions, and prune labels (partial paths) by these and by joint bounds from now on.

        costs  (n, 3)    costs of the paths, columns in the order of the search, rows in lexicographic order
        paths  n arrays  indices of the arcs of each path in the graph
        """
        self.has_tried_bounds = True
        size = int(self.counters[N_FRONT])
        rows = thin_front(costs, self.front[:size], self.precision.eps / THIN, self.tolerance // THIN)
        self.hull_paths = tuple(paths[row] for row in rows)
        self.front = np.concatenate([self.front[:size], costs[rows], np.zeros((64, 3), np.int64)])
        self.solutions = np.concatenate([self.solutions[:size], -1 - np.arange(len(rows)), np.zeros(64, np.int64)])
        self.counters[N_FRONT] += len(rows)
        ahead = least_estimates(costs[rows], self.precision.eps, self.tolerance)
        ahead = ahead[ahead[:, 0].argsort()]
        no_corners = np.zeros((0, 0, LANES), np.int32), np.zeros(0, np.int64)
        reached, scratch = np.zeros(1, np.int64), np.zeros((2, LANES), np.int32)
        self._update_corners(HullBounds(hull.layers, hull.weights, *no_corners, ahead, reached, scratch), clock)

    def _front_through(self, nodes_on_best_paths: IntArray, clock: Clock) -> tuple[IntArray, list[IntArray]]:
        """Search the part of the graph with the given nodes only; return its front (n, 3), and the paths' arcs.

        The front has the precision eps / NEAR. It is empty if a limit came too early.
        """
        nodes = np.sort(self.groups.nodes[nodes_on_best_paths])
        part = self.graph.among(nodes)
        if self.closed_arcs is not None:
            free = part.without(self.closed_arcs[part.arc])
            part = replace(free, arc=part.arc[free.arc])
        source = int(np.searchsorted(nodes, self.groups.nodes[self.source]))
        targets = np.flatnonzero(self.is_target[self.groups.new_number[nodes]])
        memory = self.memory()
        silent = clock.silent(int(self.counters[N_GENERATED]), memory)
        try:
            groups = Groups.of_turns(part, self.order[1], silent) or Groups.single_nodes(part, silent)
        except NoRoom:
            return np.zeros((0, 3), np.int64), []
        h, _, _ = lower_bounds(part, source, targets, silent, groups)
        if not h.size or h[0, source] >= UNREACHABLE:  # too little memory, or too coarse steps of the bounds
            return np.zeros((0, 3), np.int64), []
        near = Precision(self.precision.eps / NEAR, tuple(t // NEAR for t in self.precision.tolerance))
        search = self._search_on(part, source, targets, h, groups, silent, near)
        search.run(silent)
        costs, labels, generated, expanded, _ = search.results()
        self.counters[N_GENERATED] += generated
        self.counters[N_EXPANDED] += expanded
        hull_paths = [part.arc[path].astype(np.int64) for path in search.paths(labels, silent)]
        clock.compiled += silent.compiled
        clock.peak = max(clock.peak, memory + silent.peak)
        return costs, hull_paths

    def _update_corners(self, hull: HullBounds, clock: Clock) -> None:
        """Compute the corners of the region of costs that the front does not cover within the precision."""
        self.corners_size = int(self.counters[N_FRONT])
        covered = least_estimates(self.front[: self.corners_size], self.precision.eps, self.tolerance)
        self.hull = hull
        self.hull = self.with_corners(covered, clock)

    def with_corners(self, covered: IntArray, clock: Clock) -> HullBounds:
        """Return the joint bounds with the corners of the region that solutions and the query's bounds leave uncovered.

        covered  (p, 3)  least estimate that each solution covers, see :func:`.least_estimates`
        """
        if self.at_most:
            beyond = np.diag([self.at_most[j] + 1 for j in self.order])
            covered = np.concatenate([covered, beyond[beyond.max(axis=1) <= ANYTHING]])
        assert self.hull is not None
        corners = UncoveredCorners.of(covered, self.hull.weights, clock)
        return self.hull._replace(corners=corners.values, last=corners.last)
