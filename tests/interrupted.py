"""Ctrl-C that comes just as a future's lock has been taken, before anything could give it back."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager

import pytest


class _Condition(threading.Condition):
    """A lock that sends Ctrl-C to the main thread as that takes the nth of all locks."""

    def __init__(self, left: list[int]) -> None:
        super().__init__()
        self.left, self.take = left, self.acquire
        self.acquire = self.__enter__  # type: ignore[method-assign]

    def __enter__(self) -> bool:
        taken = self.take()
        if threading.current_thread() is threading.main_thread():
            self.left[0] -= 1
            if self.left[0] == 0:
                signal.raise_signal(signal.SIGINT)
        return taken


@contextmanager
def interrupted_locks(number: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Futures made in the block have such locks; none may be left taken by this thread."""
    left, locks, plain = [number], list[_Condition](), Future.__init__

    def made(future: Future[object]) -> None:
        plain(future)
        future._condition = _Condition(left)  # type: ignore[attr-defined]
        locks.append(future._condition)  # type: ignore[attr-defined]

    monkeypatch.setattr(Future, "__init__", made)
    try:
        yield
    finally:
        ours = [lock for lock in locks if lock._is_owned()]  # type: ignore[attr-defined]
        for lock in ours:
            lock.release()
    assert ours == []
