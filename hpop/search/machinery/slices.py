"""Base class of searches in slices: a kernel runs briefly, then Python reports progress, checks limits, grows arrays.

A search has a queue of open labels (partial paths to extend), the closed labels (already extended), and the front. A
label is one int64: (index of its closed parent + 1) << 32 | (last arc + 1), and 0 for the source. Its costs are only in
the keys of the queue, so a closed label takes eight bytes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from os import cpu_count
from time import perf_counter, thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import is_cached
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import Budget, Progress, ProgressCallback, Status
from hpop.search.machinery import beside
from hpop.search.machinery.kernels import is_ready, make_ready
from hpop.search.machinery.labels import Labels, Nodes, Unsound, check_order, checksum_of_labels

# Return values of a kernel: DONE, SLICE (the slice is over), or the array that is too full for the next expansion.
DONE, SLICE, HEAP, CLOSED, FRONT, WIDTH, ROWS, KEYS, CHUNKS, BUCKETS = range(10)
# Indices of the counters that a kernel and Python share.
N_OPEN, N_CLOSED, N_FRONT, N_GENERATED, N_EXPANDED, N_ROWS, COUNTERS = range(7)
PARTS = 8  # number of parts of a table that are computed in parallel
WORK = 2_000_000  # elementary steps per slice: about 20 milliseconds
SMALL = 2**18  # bytes of arrays below which a call is faster than starting a thread
INT32_LIMIT = 2**30  # smaller costs and sums are stored in 32 bits


class Clock:
    """Clock, limits and progress reports of one search. The time for compiling kernels does not count as search time.

    begin     s, time at which the search began
    compiled  s, time spent on compiling kernels
    peak      bytes, largest memory in use so far
    """

    def __init__(self, budget: Budget, progress: ProgressCallback | None) -> None:
        self.budget = budget
        self.progress = progress
        self.begin = perf_counter()
        self.compiled = 0.0
        self.peak = 0

    def silent(self, labels: int, memory: int) -> Clock:
        """Return a clock without progress reports, with limits less the partial paths and bytes in use already."""
        most, room = self.budget.max_labels, self.budget.max_memory
        remaining = replace(
            self.budget,
            max_labels=None if most is None else max(1, most - labels),
            max_memory=None if room is None else max(1, room - memory),
        )
        clock = Clock(remaining, None)
        clock.begin = self.begin + self.compiled
        return clock

    @property
    def work(self) -> int:
        """Number of elementary steps of the next slice."""
        return WORK

    def seconds(self) -> float:
        """Return the seconds since the search began, without the time for compiling."""
        return perf_counter() - self.begin - self.compiled

    def report(self, stage: str, counters: Sequence[int] | IntArray | None = None, memory: int = 0) -> None:
        """Call the progress callback with the name of a stage, counters of the kernel, and bytes in use."""
        if self.progress is None:
            return
        c = [0] * COUNTERS if counters is None else [int(x) for x in counters]
        self.progress(Progress(stage, c[N_GENERATED], c[N_OPEN], c[N_FRONT], memory, self.seconds()))

    def prepare(self, compiled: Any, *arguments: Any) -> None:
        """Compile or load a kernel for arguments of these types if it is not in memory; report and measure that."""
        if is_ready(compiled, *arguments):
            return
        began = perf_counter()
        detail = "" if is_cached(compiled) else beside.description(compiled)

        def report() -> None:
            if self.progress is not None:
                self.progress(Progress("compiling", seconds=self.seconds(), detail=detail))

        report()
        beside.wait_for(compiled, report)
        make_ready(compiled, *arguments)
        self.compiled += perf_counter() - began

    def call(self, compiled: Any, *arguments: Any) -> Any:
        """Call a kernel, after compiling it if necessary, and return its result."""
        self.prepare(compiled, *arguments)
        return compiled(*arguments)

    def call_all(self, compiled: Any, calls: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Call a kernel once for each tuple of arguments, in threads if arrays are large; return the results."""
        self.prepare(compiled, *calls[0])
        with interrupts_held():
            if sum(x.nbytes for x in calls[0] if isinstance(x, np.ndarray)) < SMALL:
                return [compiled(*arguments) for arguments in calls]
            results, waiting = [None] * len(calls), iter(enumerate(calls))

            def work(_: int) -> None:  # kernels run without Python's lock
                for i, arguments in waiting:
                    results[i] = compiled(*arguments)

            helpers = min(len(calls), cpu_count() or 1) - 1  # threads beside this one
            with ThreadPoolExecutor(max(1, helpers)) as threads:
                others = threads.map(work, range(helpers))
                work(helpers)
            list(others)  # raises what they raised
            return results

    def exceeded(self, labels: int, memory: int, *, record: bool = True) -> Status | None:
        """Return the limit that time, labels or memory (bytes) pass, or None; ``record`` the memory in the peak."""
        if record:
            self.peak = max(self.peak, memory)
        limit = self.budget
        if limit.max_memory is not None and memory > limit.max_memory:
            return Status.MEMORY_LIMIT
        if limit.max_labels is not None and labels >= limit.max_labels:
            return Status.LABEL_LIMIT
        if limit.time_limit is not None and self.seconds() >= limit.time_limit:
            return Status.TIME_LIMIT
        return None


class Search(ABC):
    """Search that runs a kernel in slices; a subclass adds the kernel, the queue and the dominance tests.

    counters  numbers that kernel and Python share, at the indices N_OPEN to N_ROWS
    closed    (capacity,) closed labels, in the order of closing
    """

    counters: IntArray
    closed: IntArray
    front: IntArray  # (capacity, k)  costs of solutions, in the order of the search
    solutions: IntArray  # (capacity,)   labels that reached a target
    order: tuple[int, ...]  # (k,)       columns of the graph's costs, in the order of the search

    def __init__(self, costs: int, fan: int) -> None:
        """Start with one open label (partial path); one expansion adds at most `fan` labels."""
        self.fan = fan
        self.counters = np.zeros(COUNTERS, np.int64)
        self.closed = np.zeros(1024, np.int64)
        self.front = np.zeros((64, costs), np.int64)
        self.solutions = np.zeros(64, np.int64)
        self.counters[N_OPEN] = 1

    @abstractmethod
    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel for ``work`` elementary steps; return DONE, SLICE, or the code of a full array."""

    @abstractmethod
    def arrays(self) -> list[np.ndarray[Any, Any]]:
        """Return the arrays that the subclass adds, so that their bytes are counted."""

    @abstractmethod
    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many more bytes the full array of a code (HEAP, ...) needs, and a function that grows it."""

    def run(self, clock: Clock, keep: Callable[[], None] | None = None) -> Status:
        """Run slices until the search is complete or a limit is passed; return the status.

        After Ctrl-C, the front found so far can be read. ``keep`` is called between slices, to save a checkpoint. If it
        is given, Ctrl-C waits for the end of a slice, so that the arrays are consistent.
        """
        guarded = nullcontext if keep is None else interrupts_held
        memory = self.memory()
        status = clock.exceeded(0, memory)
        while status is None:
            with guarded():
                code = self.advance(clock, self.slice_work(clock))
            if code == DONE:
                return Status.COMPLETE if self.counters[N_FRONT] else Status.NO_PATH
            if code != SLICE:
                extra, grow = self._growth_of(code)
                clock.report("search", self.counters, memory)
                status = clock.exceeded(0, memory + extra, record=False)
                if status is not None:
                    break
                with guarded():
                    grow()
            memory = self.memory()
            if code == SLICE:
                clock.report("search", self.counters, memory)
            if keep is not None:
                keep()
            status = clock.exceeded(int(self.counters[N_GENERATED]), memory)
        return status

    def slice_work(self, clock: Clock) -> int:
        """Return the number of steps of the next slice; near the limit of labels (partial paths) fewer, to keep it."""
        limit = clock.budget.max_labels
        return clock.work if limit is None else min(clock.work, max(1, limit - int(self.counters[N_GENERATED])))

    def memory(self) -> int:
        """Return the size of all arrays in bytes."""
        own = (self.closed, self.front, self.solutions)
        return sum(a.nbytes for a in own) + sum(a.nbytes for a in self.arrays())

    def _growth_of(self, code: int) -> tuple[int, Callable[[], None]]:
        if code == CLOSED:
            return self.closed.nbytes, self._grow_closed
        if code == FRONT:
            return self.front.nbytes + self.solutions.nbytes, self._grow_front
        return self.growth(code)

    def _grow_closed(self) -> None:
        self.closed.resize(2 * len(self.closed), refcheck=False)

    def _grow_front(self) -> None:
        self.front.resize((2 * len(self.front), self.front.shape[1]), refcheck=False)
        self.solutions.resize(2 * len(self.solutions), refcheck=False)

    def results(self) -> tuple[IntArray, IntArray, int, int, int]:
        """Return costs (n, k) and labels (n,) of the front so far, and numbers of generated, expanded, open labels."""
        n = int(self.counters[N_FRONT])
        generated, expanded, waiting = (int(self.counters[c]) for c in (N_GENERATED, N_EXPANDED, N_OPEN))
        return self.front[:n], self.solutions[:n], generated, expanded, waiting

    @abstractmethod
    def estimates(self) -> IntArray:
        """Return lower bounds (m, k) of the costs of all paths by open labels, ordered as by :meth:`open_labels`."""

    @abstractmethod
    def open_labels(self) -> tuple[IntArray, IntArray]:
        """Return open labels (partial paths): those in the heap (h,), in its order, and those in buckets (w,)."""

    @abstractmethod
    def weight_of_sets(self, clock: Clock) -> int:
        """Return a checksum of the sets of vectors for dominance tests, whatever their order in memory."""

    def solution_labels(self) -> IntArray:
        """Return the labels of the solutions, for a checkpoint; a subclass leaves out those that are closed labels."""
        return self.solutions[: int(self.counters[N_FRONT])]

    def labels(self, clock: Clock) -> Labels:
        """Return the state of the search as labels with checksums, from which a new search can resume."""
        heap, waiting = self.open_labels()
        counts = self.counters[[N_GENERATED, N_EXPANDED]]
        closed = self.closed[: int(self.counters[N_CLOSED])]
        return Labels(
            closed, heap, waiting, self.solution_labels(), counts, np.array(self.order), self._checksums(clock)
        )

    def resume(self, labels: Labels, clock: Clock) -> None:
        """Put this new search into the state saved as labels (partial paths); raise Unsound if they are invalid.

        All labels are checked before any is taken over.
        """
        if labels.order.tolist() != list(self.order):
            raise Unsound("the saved search compares the costs in another order")
        values, c, o = labels.all, len(labels.closed), len(labels.heap) + len(labels.waiting)
        if not len(values) or (np.diff(np.sort(values)) == 0).any() or (c > 0 and labels.closed[0] != 0):
            raise Unsound("a saved partial path occurs twice, or the first is missing")
        nodes, costs = self._nodes_and_estimates(values, c, clock)
        closed, open_labels, solution_labels = costs[:c], costs[c : c + o], costs[c + o :]
        check_order(closed, open_labels, solution_labels)
        self.enter(nodes[:c], closed, nodes[c + o :], solution_labels, clock)
        self.reopen(labels.heap, labels.waiting, open_labels, clock)
        capacity = len(self.closed)
        while capacity < c:
            capacity *= 2
        closed_labels = np.zeros(capacity, np.int64)
        closed_labels[:c] = labels.closed
        count = len(solution_labels)
        if len(labels.solutions):
            while len(self.solutions) < count:
                self._grow_front()
            self.front[:count], self.solutions[:count] = solution_labels, labels.solutions
        with interrupts_held():
            self.closed = closed_labels
            if len(labels.solutions):
                self.counters[N_FRONT] = count
            self.counters[[N_OPEN, N_CLOSED, N_GENERATED, N_EXPANDED]] = o, c, *labels.counts
        if self._checksums(clock).tolist() != labels.evidence.tolist():
            raise Unsound("the saved partial paths do not match their checksums")

    def _checksums(self, clock: Clock) -> IntArray:
        n = int(self.counters[N_FRONT])
        open_labels = checksum_of_labels(np.concatenate(self.open_labels()), self.estimates())
        front = checksum_of_labels(self.solutions[:n], self.front[:n])
        return np.array([open_labels, front, self.weight_of_sets(clock)], np.int64)

    def _nodes_and_estimates(self, values: IntArray, closed: int, clock: Clock) -> tuple[Nodes, NDArray[Any]]:
        """Return the last nodes (n,) and estimates (n, k) of the n labels in ``values``; see :meth:`retrace`."""
        at = np.zeros(len(values), np.int32)
        while True:
            reached, f = self.retrace(values, closed, at, clock)
            if reached == len(values):
                return at, f
            if reached >= 0 or not self.widen():
                raise Unsound("a partial path saved in the checkpoint is no path of this graph")

    @abstractmethod
    def retrace(self, values: IntArray, closed: int, at: Nodes, clock: Clock) -> tuple[int, NDArray[Any]]:
        """Write the last nodes of n labels (partial paths) to ``at`` (n,); return n and their estimates (n, k).

        ``values`` has the labels, the first ``closed`` ones closed. Estimates: lower bounds of the costs of all paths
        that begin with a label. Instead of n, i is returned if label i is invalid, and -1 - i if its costs do not fit.
        """

    def widen(self) -> bool:
        """Store costs in wider integers from now on; return False if the search cannot do so."""
        return False

    @abstractmethod
    def enter(
        self, nodes: Nodes, closed: NDArray[Any], ends: Nodes, solution_labels: NDArray[Any], clock: Clock
    ) -> None:
        """Fill the sets of vectors for dominance tests; raise Unsound for labels that the search would not have closed.

        nodes, closed          (c,), (c, k)  nodes and estimates of closed labels
        ends, solution_labels  (s,), (s, k)  nodes and estimates of solutions
        """

    @abstractmethod
    def reopen(self, heap: IntArray, waiting: IntArray, costs: NDArray[Any], clock: Clock) -> None:
        """Fill the queue with saved open labels (partial paths); raise Unsound if they are not in the queue's order.

        heap, waiting  (h,), (w,)  labels in the heap, and labels in buckets
        costs          (h + w, k)  their estimates: costs plus lower bounds of the remaining costs
        """

    @abstractmethod
    def paths(self, labels: IntArray, clock: Clock) -> list[IntArray]:
        """Return the whole path of each of n labels, as indices of arcs in the graph, from the source on."""


STEPS = 6e6  # steps per second at least; it depends on the speed of the memory
SHORT_SLICE, LEAST = 120_000, 2_000  # steps of a slice, 2 to 20 ms, and the fewest that are worth a call
END, LABEL = 1.5e-3, 16e-9  # s for preparing a result, and in addition per label, for its gap and paths
ROOM = 1.2e-9  # s per byte for copying an array that grows


class DeadlineClock(Clock):
    """Clock that stops a search early, so that its result (with gap and paths) is ready at a deadline.

    Time is processor time of this thread. Compiling does not count.

    share   share of the limits of time and labels that the search may use for now, from 0 to 1
    labels  number of labels that other searches of this query generated
    memory  bytes that other searches of this query use
    """

    def __init__(self, seconds: float | None, budget: Budget, progress: ProgressCallback | None) -> None:
        super().__init__(budget, progress)
        self.deadline = seconds
        self.started = thread_time()
        self.share = 1.0
        self.labels = self.memory = 0
        self._answer, self._taken = END, 0  # s for the result, bytes in use

    @property
    def is_limited(self) -> bool:
        """True if the query has a deadline, a time limit or a limit of labels (partial paths)."""
        limits = self.deadline, self.budget.time_limit, self.budget.max_labels
        return any(limit is not None for limit in limits)

    @property
    def remaining(self) -> float:
        """Seconds until ``share`` of the deadline's time is used; negative after that, inf without a deadline."""
        if self.deadline is None:
            return float("inf")
        return self.share * self.deadline - (thread_time() - self.started)

    @property
    def work(self) -> int:
        """Number of elementary steps of the next slice, few enough to meet the deadline on a slow machine."""
        if self.deadline is None:
            return super().work
        return int(min(SHORT_SLICE, max(LEAST, (self.remaining - self._answer) * STEPS)))

    def silent(self, labels: int, memory: int) -> DeadlineClock:
        """Return a clock without progress reports for a part of the search, with the same deadline."""
        plain = super().silent(self.labels + labels, self.memory + memory)
        clock = DeadlineClock(self.deadline, plain.budget, None)
        clock.begin, clock.started, clock.share = plain.begin, self.started, self.share
        return clock

    def prepare(self, compiled: Any, *arguments: Any) -> None:
        """Compile or load a kernel; the deadline is moved by the time for this."""
        before, spent = thread_time(), self.compiled
        super().prepare(compiled, *arguments)
        if self.compiled > spent:
            self.started += thread_time() - before

    def exceeded(self, labels: int, memory: int, *, record: bool = True) -> Status | None:
        """Return the limit that is passed, or None; TIME_LIMIT also if only the time to prepare the result is left."""
        labels += self.labels
        status = super().exceeded(labels, memory + self.memory, record=record)
        if status is not None:
            return status
        limit = self.budget
        if limit.max_labels is not None and labels >= self.share * limit.max_labels:
            return Status.LABEL_LIMIT
        if limit.time_limit is not None and self.seconds() >= self.share * limit.time_limit:
            return Status.TIME_LIMIT
        needed = self._answer = END + LABEL * labels if record else self._answer
        if record:
            self._taken = memory
        else:
            needed += ROOM * (memory - self._taken)
        return Status.TIME_LIMIT if self.remaining <= needed else None
