"""Time and memory limits of a planning run: how much was spent on reading the map, building the graph and searching.

A graph is built block by block, on all cores, and the limits are checked between blocks. So a limit, or Ctrl-C, stops
building soon, and the size of a block bounds the memory of intermediate arrays. The results of the blocks are joined in
order: the graph is equal, bit for bit, for any number of cores.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import islice
from time import perf_counter
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from hpop.planners.base import Candidates, Planner
from hpop.planners.objectives import Objectives
from hpop.runtime import limits
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import RESERVED, Budget, Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.search.machinery.checkpoint import CheckpointSpec

CORES = os.cpu_count() or 1
LEAST = 1e-3  # s: smallest time limit passed to a search, since a limit must be positive
MORE = 1.25  # of max_memory: growth of the process that is allowed in total
BESIDE, LATER = 250_000_000, 100_000_000  # bytes allowed for libraries, before and after compiled code is loaded
EVERY = 0.02  # s between two measurements of the process's memory

A = TypeVar("A")
B = TypeVar("B")
N = TypeVar("N", int, float)
OPTIONS = {Status.TIME_LIMIT: "time_limit", Status.MEMORY_LIMIT: "max_memory"}


class Exhausted(limits.LimitPassed):
    """Raised when the time or memory limit is passed while a graph is built; planners report this in their result.

    status  which limit was passed
    doing   activity at that moment, as a clause for "while ...": "the lattice of step 0.25 m was built"
    """

    def __init__(self, status: Status, doing: str) -> None:
        super().__init__(f"{status} while {doing}")
        self.status, self.doing = status, doing


@dataclass(frozen=True)
class Limits(Budget):
    """Limits on time, memory and number of partial paths (labels), with a checkpoint file and a progress callback."""

    checkpoint: CheckpointSpec | None = None
    progress: ProgressCallback | None = None

    @classmethod
    def of(cls, budget: Budget | None) -> Limits:
        """Convert a budget to Limits without checkpoint and progress callback.

        None becomes Limits that limit nothing. Limits are returned unchanged.
        """
        if isinstance(budget, Limits):
            return budget
        budget = budget or Budget()
        return cls(budget.time_limit, budget.max_labels, budget.max_memory)


class Spending:
    """Time and memory that a planning run has used so far, checked against its limits.

    Time for compiling code does not count.

    limits  limits of the whole run
    memory  bytes of the parts built so far
    cores   number of threads that build
    """

    def __init__(
        self, limits: Budget | None = None, *, spent: float = 0.0, memory: int = 0, cores: int | None = None
    ) -> None:
        """Begin to count; ``spent`` seconds and ``memory`` bytes were used before, for example to read the map."""
        self.limits, self.cores = Limits.of(limits), cores or CORES
        self.memory = memory
        self._began = perf_counter() - spent
        self._compiled = _compiling_seconds()
        self._beside = LATER if "hpop.runtime.compiled" in sys.modules else BESIDE
        self._resident_bytes, self._looked = _resident_bytes() if self.limits.max_memory is not None else 0, 0.0

    def seconds(self) -> float:
        """Return the seconds since planning started, without the time for compiling and in `paused`."""
        return perf_counter() - self._began - (_compiling_seconds() - self._compiled)

    def until_limit(self) -> float | None:
        """Return the seconds until the time limit, negative after it; None if there is no time limit."""
        return None if self.limits.time_limit is None else self.limits.time_limit - self.seconds()

    def report(self, stage: str) -> None:
        """Tell the progress callback, if there is one, that a stage begins."""
        if self.limits.progress:
            self.limits.progress(Progress(stage))

    def left(self) -> Limits:
        """Return the limits of a search that may use all remaining time and memory; raise Exhausted if none remains.

        A part of the time limit stays reserved for evaluating the candidates.
        """
        self.check("the search was to begin")
        limit, most = self.limits.time_limit, self.limits.max_memory
        return replace(
            self.limits,
            time_limit=None if limit is None else max(LEAST, (1.0 - RESERVED) * limit - self.seconds()),
            max_memory=None if most is None else max(1, most - self.memory),
        )

    def share(self, seconds: float) -> Limits:
        """Return the limits of an early stage of planning, which writes no checkpoint.

        The stage may take ``seconds``, but at most a quarter of the remaining time if there is a time limit. Its other
        limits, and the error if no time or memory remains, are those of :meth:`left`.
        """
        left = replace(self.left(), checkpoint=None)
        return replace(left, time_limit=seconds if left.time_limit is None else min(seconds, left.time_limit / 4))

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Return a context in which time does not count, for example while the caller draws early results."""
        before = self.seconds()
        try:
            yield
        finally:
            self._began += self.seconds() - before  # compiling is not charged anyway

    def check(self, doing: str, memory: int = 0) -> None:
        """Raise Exhausted if a limit is passed, or would be passed with ``memory`` more bytes.

        A part of the time limit is reserved for evaluating the candidates. With a memory limit on Linux, which reports
        the size of the process, Exhausted is also raised if the process has grown by much more than this limit since
        the run began.

        doing  current activity, for the error, as a clause for "while ...": "the search was to begin"
        """
        limit, most = self.limits.time_limit, self.limits.max_memory
        if most is not None and self.memory + memory > most:
            raise Exhausted(Status.MEMORY_LIMIT, f"{doing}, which takes {_megabytes(self.memory + memory)}")
        if most is not None and perf_counter() - self._looked > EVERY:
            grown, self._looked = _resident_bytes() - self._resident_bytes, perf_counter()
            if grown > MORE * most + self._beside:
                activity = f"{doing}, where the process had grown by {_megabytes(grown)}"
                raise Exhausted(Status.MEMORY_LIMIT, activity)
        if limit is not None and self.seconds() >= (1.0 - RESERVED) * limit:
            raise Exhausted(Status.TIME_LIMIT, doing)

    def hold(self, memory: int, doing: str) -> None:
        """Count ``memory`` bytes that will be allocated and stay; raise Exhausted if that would pass the limit."""
        self.check(doing, memory)
        self.memory += memory

    def release(self, memory: int) -> None:
        """Subtract ``memory`` bytes that were counted by :meth:`hold` and are freed now."""
        self.memory -= memory

    def each(self, work: Callable[[A], B], blocks: Iterable[A], doing: str) -> Iterator[B]:
        """Run ``work`` on each block in a pool of threads and yield the results in order.

        Raises Exhausted if a limit is passed between two blocks. The first block runs alone, because it computes the
        distance fields that all blocks read, and compiles code. Fields check the limits themselves; their memory
        counts.
        """
        remaining = iter(blocks)

        def limited(block: A) -> B:
            with limits.within(self):
                return work(block)

        for block in islice(remaining, 1):
            yield limited(block)
            self.check(doing)
        waiting: deque[Future[B]] = deque()

        def first() -> B:
            with interrupts_held():
                return waiting.popleft().result()

        with ThreadPoolExecutor(self.cores) as threads:
            try:
                for block in remaining:
                    with interrupts_held():
                        waiting.append(threads.submit(limited, block))
                    if len(waiting) > self.cores:
                        yield first()
                        self.check(doing)
                while waiting:
                    yield first()
                    self.check(doing)
            finally:  # after Ctrl-C, a limit or an error, blocks that have not begun are dropped
                with interrupts_held():
                    for future in waiting:
                        future.cancel()


def common_spending(planners: Iterable[Planner]) -> Spending:
    """Return the limits for work that several planners share, such as reading a map: the largest of their limits.

    There is no limit of time (memory) if one of the planners has none.
    """
    budgets = [planner.budget() or Budget() for planner in planners]
    seconds, memory = [budget.time_limit for budget in budgets], [budget.max_memory for budget in budgets]
    return Spending(Budget(time_limit=_largest_limit(seconds), max_memory=_largest_limit(memory)))


def _largest_limit(amounts: Sequence[N | None]) -> N | None:
    """Return the largest of some limits, or None (no limit) if one of them is None."""
    limits = [amount for amount in amounts if amount is not None]
    return max(limits) if limits and len(limits) == len(amounts) else None


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB" if size >= 1e7 else f"{size / 1e6:.2g} MB"


def stopped(
    name: str, objectives: Objectives, stop: Exhausted, spending: Spending, first: Candidates | None = None
) -> Candidates:
    """Return the result of the planner ``name`` when a limit stopped it before its search began.

    The result is ``first``, the early result from a part of the graph, or else empty. A note says which limit was
    passed and what to change.
    """
    costs = len(objectives.optimised)
    helps = f"take a larger step, fewer samples or fewer criteria, or raise {OPTIONS[stop.status]}"
    note = f"{stop.status}: it was passed while {stop.doing}; {helps}"
    if first is not None and first.trajectories:
        return replace(
            first,
            status=stop.status,
            certificate=f"{name}: incomplete ({stop.status}): its graph was not built; {first.certificate}",
            notes=(*first.notes, note),
            stats={**first.stats, "build_seconds": spending.seconds()},
        )
    return Candidates(
        objectives=objectives.optimised,
        trajectories=(),
        planned=np.zeros((0, costs)),
        tolerance=np.zeros((0, costs)),
        status=stop.status,
        certificate=f"{name}: incomplete ({stop.status}): its graph was not built, so nothing was searched",
        provenance=(),
        notes=(*objectives.notes, note),
        stats={"build_seconds": spending.seconds()},
        filters=objectives.filters,
    )


def _resident_bytes() -> int:
    """Return the memory in bytes that this process occupies; 0 if the system does not report it."""
    try:
        with open("/proc/self/statm") as sizes:
            return int(sizes.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return 0


def return_freed_memory() -> None:
    """Return memory to the system that threads have freed, of which the C library of Linux keeps some for each."""
    with suppress(OSError, TypeError, AttributeError):  # other C libraries lack the function
        ctypes.CDLL(None).malloc_trim(0)


def _compiling_seconds() -> float:
    """Return the seconds that this process has spent on compiling code with numba; 0 before numba is imported."""
    compiled = sys.modules.get("hpop.runtime.compiled")
    return compiled.compiling_seconds() if compiled else 0.0
