"""Limits of time and memory for all work within a block of code, in this thread.

A map is read before there is a problem to plan. Distance grids and integrals are computed when a criterion first needs
them, by code that does not know the planner's limits. Long work is therefore done in parts, and between two parts it
checks the limits of the surrounding block (:func:`within`). Outside of such a block there are no limits.

Also here: the memory of this process, and a limit of the threads of linear algebra.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any, Protocol

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

READING = "the map was read"


class LimitPassed(Exception):
    """Signal that work was stopped because it exceeded a limit of time or memory.

    Callers turn it into a result with a status, not into an error.
    """


class Account(Protocol):
    """Account of the time and memory that were used; each method raises LimitPassed if a limit is exceeded."""

    def check(self, doing: str, memory: int = 0) -> None:
        """Check the time limit, and whether ``memory`` more bytes are allowed.

        ``doing`` completes the note on an exceeded limit, "it was passed while DOING": for example "the map was read".
        """

    def hold(self, memory: int, doing: str) -> None:
        """Count ``memory`` bytes that are about to be allocated and will stay allocated."""


_LIMITS: ContextVar[Account | None] = ContextVar("limits", default=None)


@contextmanager
def within(limits: Account) -> Iterator[None]:
    """Apply the limits of an account to all work in the block."""
    token = _LIMITS.set(limits)
    try:
        yield
    finally:
        _LIMITS.reset(token)


def hold(doing: str, stays: int, beside: int = 0) -> None:
    """Check that an object may be made within the memory limit, and count its memory.

    doing   the work in words, for the note on an exceeded limit: "zones were sampled"
    stays   bytes of the object itself
    beside  bytes that are needed only while the object is being made
    """
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing, stays + beside)
        limits.hold(stays, doing)


def check(doing: str) -> None:
    """Check the limits between two parts of a long computation; ``doing`` says which: "zones were sampled".

    If a limit is exceeded, LimitPassed is raised, with a note that contains ``doing``.
    """
    if (limits := _LIMITS.get()) is not None:
        limits.check(doing)


SET_THREADS, GET_THREADS = (
    f"scipy_openblas_{verb}_num_threads64_" for verb in ("set", "get")
)  # functions of the OpenBLAS in NumPy's wheels
_ALONE = Lock()
_inside = [0, 0]  # blocks of one_numpy_thread that are running, and the number of threads before the first of them


@contextmanager
def one_numpy_thread() -> Iterator[None]:
    """Limit NumPy's own OpenBLAS to one thread within a block of code; do nothing if NumPy has no OpenBLAS of its own.

    For small matrices, a second thread is busy with waiting for longer than the work takes.
    """
    openblas = _openblas()
    if openblas is None:
        yield
        return
    with _ALONE:
        if not _inside[0]:
            _inside[1] = getattr(openblas, GET_THREADS)()
            getattr(openblas, SET_THREADS)(1)
        _inside[0] += 1
    try:
        yield
    finally:
        with _ALONE:
            _inside[0] -= 1
            if not _inside[0]:
                getattr(openblas, SET_THREADS)(_inside[1])


@cache
def _openblas() -> Any:
    """Return the OpenBLAS library in NumPy's wheel; None if NumPy uses another library of linear algebra."""
    try:
        found = ctypes.CDLL(import_module("numpy.linalg._umath_linalg").__file__)
    except (ImportError, OSError):
        return None
    return found if hasattr(found, SET_THREADS) and hasattr(found, GET_THREADS) else None


def peak_memory() -> int | None:
    """Return the peak memory of this process in bytes; None if the system does not report it."""
    if resource is None:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
