"""A worker thread that keeps only its newest waiting task."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from threading import Lock, Thread
from typing import Any, TypeVar

T = TypeVar("T")


class LatestOnlyWorker:
    """A worker thread that keeps only the newest waiting task; an older waiting task is cancelled.

    The thread ends after its last task, or when the process ends.
    """

    def __init__(self) -> None:
        """Make a worker without tasks."""
        self._lock, self._busy = Lock(), False
        self._next: tuple[Future[Any], Callable[[], Any]] | None = None

    def begin(self, task: Callable[[], T]) -> Future[T]:
        """Submit a task, to be run when the present one is done."""
        future: Future[T] = Future()
        with self._lock:
            if self._next is not None:
                self._next[0].cancel()
            self._next = future, task
            if not self._busy:
                self._busy = True
                Thread(target=self._work, name="hpop drive", daemon=True).start()
        return future

    def _work(self) -> None:
        while True:
            with self._lock:
                if self._next is None:
                    self._busy = False
                    return
                future, task = self._next
                self._next = None
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(task())
                except BaseException as error:  # raised again by future.result()
                    future.set_exception(error)
