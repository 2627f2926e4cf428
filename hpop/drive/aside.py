"""Work in a thread beside the drive's own, one task at a time: the latest that was asked for."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from threading import Lock, Thread
from typing import Any, TypeVar

T = TypeVar("T")


class Aside:
    """Tasks in another thread, one after another. What waits is canceled where something later is asked for.

    The thread ends with its last task, and with the process, whatever it does then.
    """

    def __init__(self) -> None:
        """With nothing to do."""
        self._lock, self._busy = Lock(), False
        self._next: tuple[Future[Any], Callable[[], Any]] | None = None

    def begin(self, task: Callable[[], T]) -> Future[T]:
        """Begin a task as soon as the one that is under way is done."""
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
                except BaseException as error:  # whoever asks for the result hears of it
                    future.set_exception(error)
