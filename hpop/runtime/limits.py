"""Limits, status and progress of work: time and memory of a block of code, of a search, and the progress line.

A map is read before there is a problem to plan. Distance grids and integrals are computed when a criterion first needs
them, by code that does not know the planner's limits. Long work is therefore done in parts, and between two parts it
checks the limits of the surrounding block (:func:`within`). Outside of such a block there are no limits.

Also here: the memory of this process, and a limit of the threads of linear algebra.
"""

from __future__ import annotations

import ctypes
import logging
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any, Protocol

from hpop.base.options import MOST_COUNTED, real
from hpop.base.status import Status as Status
from hpop.base.text import set_python_values

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


LIMITS = {"time_limit": "seconds", "max_labels": "labels", "max_memory": "bytes"}  # units of the limits
NO_LIMIT = "leave it out for no limit"


def no_path_note(notes: Iterable[str]) -> str | None:
    """Return the first of a search's notes that explains why there is no path ("no path: ..."); None without one."""
    return next((note for note in notes if note.startswith(Status.NO_PATH)), None)


@dataclass(frozen=True)
class Budget:
    """Limits of time and memory of a planner or a search; None means no limit.

    time_limit  s      wall-clock time without compilation. For a planner it includes reading the map, building its
                       graph and searching; for a search alone it begins with the search
    max_labels  count  number of labels (partial paths in memory) that a search generates
    max_memory  bytes  memory of the map, and of the planner's distance grids, graph and search
    """

    time_limit: float | None = None
    max_labels: int | None = None
    max_memory: int | None = None

    def __post_init__(self) -> None:
        set_python_values(self)
        for name, least in (("time_limit", 1e-9), ("max_labels", 1), ("max_memory", 1)):
            if (value := getattr(self, name)) is not None:
                real(name, value, least, MOST_COUNTED, f"a positive number, in {LIMITS[name]},", hint=NO_LIMIT)


@dataclass(frozen=True)
class Progress:
    """Progress report of a running search.

    stage             current work in words ("compiling", "bounds", "search")
    labels     count  labels (partial paths) generated so far
    open       count  labels that still have to be extended
    front      count  solutions found so far
    memory     bytes  memory allocated by the search so far
    seconds    s      time since the search began
    detail            current part of the stage, in words
    """

    stage: str
    labels: int = 0
    open: int = 0
    front: int = 0
    memory: int = 0
    seconds: float = 0.0
    detail: str = ""


ProgressCallback = Callable[[Progress], None]
RESERVED = 0.1  # share of a time limit that is reserved for the evaluation of results


@dataclass(frozen=True)
class Watch:
    """Clock of a planner that runs many jobs; it tells when to stop and reports progress.

    Jobs stop a little before the time limit, to leave time for the evaluation of their results.

    stage       current work in words
    time_limit  s, or None for no limit
    progress    callback for progress reports, or None
    began       s, time at which planning began, on the clock of :func:`time.perf_counter`
    """

    stage: str
    time_limit: float | None = None
    progress: ProgressCallback | None = None
    began: float = field(default_factory=lambda: time.perf_counter())

    @property
    def seconds(self) -> float:
        """Time since planning began, s."""
        return time.perf_counter() - self.began

    @property
    def left(self) -> float | None:
        """Time until jobs must stop, s, a little before the time limit; negative after that, None without a limit."""
        return None if self.time_limit is None else (1.0 - RESERVED) * self.time_limit - self.seconds

    def is_late(self) -> bool:
        """Return whether the time for jobs is over."""
        return self.left is not None and self.left < 0.0

    def report(self, done: int, left: int, found: int) -> None:
        """Report progress: the numbers of finished jobs, of remaining jobs, and of results so far."""
        if self.progress is not None:
            self.progress(Progress(self.stage, done, left, found, seconds=self.seconds))


log = logging.getLogger("hpop")


@contextmanager
def progress_bar() -> Iterator[ProgressCallback]:
    """Yield a progress callback that shows the progress on one line of the terminal, if there is a terminal."""
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    console = Console(stderr=True)
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda progress: bar.update(task, description=described(progress))


@contextmanager
def progress_callback(progress: ProgressCallback | bool | None) -> Iterator[ProgressCallback | None]:
    """Yield the progress callback to use: ``progress`` itself or, for True, one that shows a line on the terminal.

    If the logger "hpop" has the level DEBUG, the callback also logs each stage. Without logging, it is None if
    ``progress`` is None or False.
    """
    with progress_bar() if progress is True else nullcontext(progress or None) as callback:
        yield _with_log(callback) if log.isEnabledFor(logging.DEBUG) else callback


def _with_log(callback: ProgressCallback | None) -> ProgressCallback:
    """Return a progress callback that logs the beginning of each stage, and then calls ``callback``, if given."""
    last = ""

    def report(progress: Progress) -> None:
        nonlocal last
        if progress.stage != last:
            log.debug("%s", described(progress))
            last = progress.stage
        if callback is not None:
            callback(progress)

    return report


def described(progress: Progress) -> str:
    """Return the progress of a search in words.

    >>> described(Progress("search", labels=1_234_567, open=89, front=12, memory=345_000_000))
    'search  1,234,567 labels, 89 open, front 12, 345 MB'
    >>> described(Progress("compiling", detail="advance, 9 of 10 parts of the search (once)"))
    'compiling advance, 9 of 10 parts of the search (once)'
    """
    if not progress.labels:
        return f"{progress.stage} {progress.detail}".strip()
    counts = f"{progress.labels:,} labels, {progress.open:,} open, front {progress.front:,}"
    return f"{progress.stage}  {counts}, {progress.memory / 1e6:,.0f} MB"
