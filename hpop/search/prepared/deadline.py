"""A deadline, counted by the processor time of the thread that searches, and slices so short that it is kept."""

from __future__ import annotations

from time import thread_time
from typing import Any

from hpop.search.machinery.slices import Clock
from hpop.status import Budget, ProgressCallback, Status

STEPS = 25e6  # a second, before it is known
SLICE, LEAST = 500_000, 2_000  # steps of a slice: 5 to 20 ms, and what is not worth a call
END, LABEL = 1e-3, 12e-9  # s that an answer takes, and for each label: its gap is proven, its paths are told


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
        self._sliced, self._steps, self._pace, self._answer = 0.0, 0, STEPS, END

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
        """Half of what there is time for at the pace of the last slice: less and less towards the end."""
        now = thread_time()
        if self._steps:
            self._pace = self._steps / max(now - self._sliced, 1e-9)
        steps = (self.left - self._answer) * min(STEPS, self._pace) / 2
        self._sliced, self._steps = now, int(min(SLICE, max(LEAST, steps)))
        return self._steps

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
        self._answer = END + LABEL * labels
        return Status.TIME_LIMIT if self.left <= self._answer else None
