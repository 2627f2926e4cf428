"""Limits and progress reports of a search, the progress line on the terminal, and the log."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field

from hpop.base.options import MOST_COUNTED, real
from hpop.base.status import Status as Status
from hpop.base.text import set_python_values

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
