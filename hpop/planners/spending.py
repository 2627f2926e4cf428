"""Limits of planning: one account of time and memory for reading, building and searching, and work in blocks under it.

Building goes block by block, on all cores, and between blocks the limits are checked. So a limit, or Ctrl-C, ends it
soon, and memory for intermediate arrays is bounded by the size of a block. Blocks are put together in order: the result
is the same, bit for bit, whatever the number of cores.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from time import perf_counter
from typing import TYPE_CHECKING, Protocol, TypeVar, runtime_checkable

import numpy as np

from hpop.planners.base import Candidates
from hpop.planners.objectives import Objectives
from hpop.runtime import limits
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.status import RESERVED, Budget, Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.search.machinery.checkpoint import CheckpointSpec

CORES = os.cpu_count() or 1
LEAST = 1e-3  # s, bytes: a budget that is left is positive, or it would be no budget
MORE = 1.25  # of max_memory that the process may grow by, all in all
BESIDE, LATER = 250_000_000, 100_000_000  # bytes of libraries beside, until kernels are loaded and from then on
EVERY = 0.02  # s between two looks at how large the process is

A = TypeVar("A")
B = TypeVar("B")
N = TypeVar("N", int, float)
OPTIONS = {Status.TIME_LIMIT: "time_limit", Status.MEMORY_LIMIT: "max_memory"}


class Exhausted(limits.LimitPassed):
    """A limit was passed while something was built. Planners catch it and say so in what they return.

    status  the limit
    doing   what was being built, in words
    """

    def __init__(self, status: Status, doing: str) -> None:
        super().__init__(f"{status} while {doing}")
        self.status, self.doing = status, doing


@dataclass(frozen=True)
class Limits(Budget):
    """Time, labels and memory of a search, the file in which it keeps its state, and its progress callback."""

    checkpoint: CheckpointSpec | None = None
    progress: ProgressCallback | None = None

    @classmethod
    def of(cls, budget: Budget | None) -> Limits:
        """Return limits themselves, or those of a budget; None is no limit."""
        if isinstance(budget, Limits):
            return budget
        budget = budget or Budget()
        return cls(budget.time_limit, budget.max_labels, budget.max_memory)


class Spending:
    """The account of a planning run: its limits, and the time and memory spent so far. Compiling is not charged.

    limits  of the whole run
    memory  bytes held by what was built so far
    cores   on which it is built at once
    """

    def __init__(
        self, limits: Budget | None = None, *, spent: float = 0.0, memory: int = 0, cores: int | None = None
    ) -> None:
        """Open the account; ``spent`` seconds and some bytes are gone already, such as for reading the map."""
        self.limits, self.cores = Limits.of(limits), cores or CORES
        self.memory = memory
        self._began = perf_counter() - spent
        self._compiled = _compiling()
        self._beside = LATER if "hpop.runtime.compiled" in sys.modules else BESIDE
        self._resident, self._looked = _resident() if self.limits.max_memory is not None else 0, 0.0

    def seconds(self) -> float:
        """Seconds since planning started, without compiling."""
        return perf_counter() - self._began - (_compiling() - self._compiled)

    def until_limit(self) -> float | None:
        """Return the seconds until the time limit, negative after it; None without one."""
        return None if self.limits.time_limit is None else self.limits.time_limit - self.seconds()

    def report(self, stage: str) -> None:
        """Tell the progress callback, if there is one, which stage begins."""
        if self.limits.progress:
            self.limits.progress(Progress(stage))

    def left(self) -> Limits:
        """Return the limits of a search that takes all that is left; raises Exhausted where that is nothing."""
        self.check("the search was to begin")
        limit, most = self.limits.time_limit, self.limits.max_memory
        return replace(
            self.limits,
            time_limit=None if limit is None else max(LEAST, (1.0 - RESERVED) * limit - self.seconds()),
            max_memory=None if most is None else max(1, most - self.memory),
        )

    def share(self, seconds: float) -> Limits:
        """Return the limits of an early stage: some seconds, at most a quarter of the rest, and no checkpoint."""
        left = replace(self.left(), checkpoint=None)
        return replace(left, time_limit=seconds if left.time_limit is None else min(seconds, left.time_limit / 4))

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Time that others take, such as to draw what a stage found, is not charged."""
        before = self.seconds()
        try:
            yield
        finally:
            self._began += self.seconds() - before  # compiling meanwhile is not charged anyway

    def check(self, doing: str, memory: int = 0) -> None:
        """Raise Exhausted where a limit is passed, or would be with so many bytes more.

        A part of the time limit stays for the evaluation of what is found.
        What is not counted shows in the size of the process, where the system tells it (Linux).
        """
        limit, most = self.limits.time_limit, self.limits.max_memory
        if most is not None and self.memory + memory > most:
            raise Exhausted(Status.MEMORY_LIMIT, f"{doing}, which takes {_megabytes(self.memory + memory)}")
        if most is not None and perf_counter() - self._looked > EVERY:
            grown, self._looked = _resident() - self._resident, perf_counter()
            if grown > MORE * most + self._beside:
                what = f"{doing}, where the process had grown by {_megabytes(grown)}"
                raise Exhausted(Status.MEMORY_LIMIT, what)
        if limit is not None and self.seconds() >= (1.0 - RESERVED) * limit:
            raise Exhausted(Status.TIME_LIMIT, doing)

    def hold(self, memory: int, doing: str) -> None:
        """Charge bytes that stay, before they are taken."""
        self.check(doing, memory)
        self.memory += memory

    def release(self, memory: int) -> None:
        """Bytes that were held are free again."""
        self.memory -= memory

    def each(self, work: Callable[[A], B], blocks: Iterable[A], doing: str) -> Iterator[B]:
        """The results of ``work`` on each block, in order; raises Exhausted between blocks.

        The first is done alone: it makes the fields that all read, and compiles. Fields keep the limits themselves, and
        count as memory.
        """
        rest = iter(blocks)

        def limited(block: A) -> B:
            with limits.within(self):
                return work(block)

        for block in islice(rest, 1):
            yield limited(block)
            self.check(doing)
        waiting: deque[Future[B]] = deque()

        def first() -> B:
            with interrupts_held():
                return waiting.popleft().result()

        with ThreadPoolExecutor(self.cores) as threads:
            try:
                for block in rest:
                    with interrupts_held():
                        waiting.append(threads.submit(limited, block))
                    if len(waiting) > self.cores:
                        yield first()
                        self.check(doing)
                while waiting:
                    yield first()
                    self.check(doing)
            finally:  # after Ctrl-C, a limit or an error nobody waits for blocks that have not begun
                with interrupts_held():
                    for future in waiting:
                        future.cancel()


@runtime_checkable
class Limited(Protocol):
    """A planner whose limits cover reading the map as well."""

    def budget(self) -> Budget:
        """Its limits."""


def common_spending(planners: Iterable[object]) -> Spending:
    """What is done for several planners, such as to read a map, may spend as much as the one that may spend most.

    That one cannot plan any more where reading takes more, and so none can.
    """
    budgets = [planner.budget() if isinstance(planner, Limited) else Budget() for planner in planners]
    seconds, memory = [each.time_limit for each in budgets], [each.max_memory for each in budgets]
    return Spending(Budget(time_limit=_most(seconds), max_memory=_most(memory)))


def _most(amounts: Sequence[N | None]) -> N | None:
    """The largest of some limits, of which None is no limit."""
    known = [amount for amount in amounts if amount is not None]
    return max(known) if known and len(known) == len(amounts) else None


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB" if size >= 1e7 else f"{size / 1e6:.2g} MB"


def stopped(
    name: str, objectives: Objectives, stop: Exhausted, spending: Spending, first: Candidates | None = None
) -> Candidates:
    """What the planner ``name`` returns when a limit was passed before it could search, and what helps.

    That is the ``first`` answer, found before on a part of its graph; nothing without one.
    """
    costs = len(objectives.optimised)
    helps = f"take a larger step or fewer samples, fewer criteria, or raise {OPTIONS[stop.status]}"
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


def _resident() -> int:
    """Bytes of memory that this process has; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm") as sizes:
            return int(sizes.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return 0


def _compiling() -> float:
    """Seconds that this process has spent on compiling kernels so far; none before numba is imported."""
    compiled = sys.modules.get("hpop.runtime.compiled")
    return compiled.compiling_seconds() if compiled else 0.0
