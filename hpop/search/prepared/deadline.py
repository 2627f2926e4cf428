"""A deadline, counted by the processor time of the thread that searches, and slices so short that it is kept."""

from __future__ import annotations

from time import thread_time
from typing import Any

from hpop.search.machinery.slices import Clock
from hpop.status import Budget, ProgressCallback, Status

STEPS = 25e6  # a second, at the least: slices are meant to be too short
SLICE, LEAST = 500_000, 2_000  # steps of a slice: 5 to 20 ms, and what is not worth a call
END, LABEL = 0.5e-3, 12e-9  # s that an answer takes, and for each label: its gap is proven, its paths are told


class Deadline(Clock):
    """A clock that ends a search so early that its answer, gap and paths included, is there in time.

    Compiling is not charged, as always.
    """

    def __init__(self, seconds: float | None, budget: Budget, progress: ProgressCallback | None) -> None:
        super().__init__(budget, progress)
        self.deadline = seconds
        self.started = thread_time()

    @property
    def left(self) -> float:
        """Seconds that are left; infinitely many without a deadline."""
        return float("inf") if self.deadline is None else self.deadline - (thread_time() - self.started)

    @property
    def work(self) -> int:
        """As much as there is time for, less and less towards the end."""
        return int(min(SLICE, max(LEAST, self.left * STEPS / 2)))

    def prepare(self, compiled: Any, *arguments: Any) -> None:
        """Compile a kernel, or load it."""
        before, spent = thread_time(), self.compiled
        super().prepare(compiled, *arguments)
        if self.compiled > spent:
            self.started += thread_time() - before

    def exceeded(self, labels: int, memory: int, *, record: bool = True) -> Status | None:
        """Return the limit that is passed, or None; the deadline is passed when the answer's share of it begins."""
        status = super().exceeded(labels, memory, record=record)
        if status is None and self.left <= END + LABEL * labels:
            return Status.TIME_LIMIT
        return status
