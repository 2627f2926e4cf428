"""A deadline, counted by the processor time of the thread that searches, and slices so short that it is kept."""

from __future__ import annotations

from time import thread_time
from typing import Any

from hpop.runtime.status import Budget, ProgressCallback, Status
from hpop.search.machinery.slices import Clock

STEPS = 6e6  # a second, at the least: what a step takes depends on the memory that it waits for
SLICE, LEAST = 120_000, 2_000  # steps of a slice: 2 to 20 ms, and what is not worth a call
END, LABEL = 1.5e-3, 16e-9  # s that an answer takes, and for each label: its gap is proven, its paths are told
ROOM = 1.2e-9  # s for each byte of an array that grows: it is copied, and the rest of it is filled


class Deadline(Clock):
    """A clock that ends a search so early that its answer, gap and paths included, is there in time.

    Compiling is not charged, as always.

    share   of all limits that the search may spend for now
    labels  count  that other searches of the same question have generated
    memory  bytes  that these hold
    """

    def __init__(self, seconds: float | None, budget: Budget, progress: ProgressCallback | None) -> None:
        super().__init__(budget, progress)
        self.deadline = seconds
        self.started = thread_time()
        self.share = 1.0
        self.labels = self.memory = 0
        self._answer, self._taken = END, 0  # s that the answer will take, bytes that are taken

    @property
    def is_limited(self) -> bool:
        """Whether the search may have to end before it is complete."""
        limits = self.deadline, self.budget.time_limit, self.budget.max_labels
        return any(limit is not None for limit in limits)

    @property
    def left(self) -> float:
        """Seconds that are left; infinitely many without a deadline."""
        if self.deadline is None:
            return float("inf")
        return self.share * self.deadline - (thread_time() - self.started)

    @property
    def work(self) -> int:
        """What there is time for, however slow steps are: less and less towards the end."""
        if self.deadline is None:
            return super().work
        return int(min(SLICE, max(LEAST, (self.left - self._answer) * STEPS)))

    def silent(self, labels: int, memory: int) -> Deadline:
        """As of any clock; of the same deadline."""
        plain = super().silent(self.labels + labels, self.memory + memory)
        clock = Deadline(self.deadline, plain.budget, None)
        clock.begin, clock.started, clock.share = plain.begin, self.started, self.share
        return clock

    def prepare(self, compiled: Any, *arguments: Any) -> None:
        """Compile a kernel, or load it."""
        before, spent = thread_time(), self.compiled
        super().prepare(compiled, *arguments)
        if self.compiled > spent:
            self.started += thread_time() - before

    def exceeded(self, labels: int, memory: int, *, record: bool = True) -> Status | None:
        """Return the limit that is passed, or None; the deadline is passed when the answer's share of it begins."""
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
        return Status.TIME_LIMIT if self.left <= needed else None
