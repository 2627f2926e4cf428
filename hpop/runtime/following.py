"""How a run is followed: a line on the terminal, and what the logger ``hpop`` is told.

``problem.solve(progress=True)`` shows the line that ``hpop plan`` shows. The logger is told each stage at level DEBUG,
and what each planner has found at level INFO; who has not turned it on pays nothing for it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

from hpop.runtime.status import Progress, ProgressCallback

log = logging.getLogger("hpop")


@contextmanager
def progress_bar() -> Iterator[ProgressCallback]:
    """A line on the terminal that follows a search: stage, labels, front, memory, time; nothing where there is none."""
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    console = Console(stderr=True)
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda progress: bar.update(task, description=described(progress))


@contextmanager
def followed(progress: ProgressCallback | bool | None) -> Iterator[ProgressCallback | None]:
    """Whom a run tells how far it is: a function, True for a line on the terminal; and the logger, if it listens."""
    with progress_bar() if progress is True else nullcontext(progress or None) as told:
        yield _logged(told) if log.isEnabledFor(logging.DEBUG) else told


def _logged(told: ProgressCallback | None) -> ProgressCallback:
    """The same, and a line in the log for each stage as it begins."""
    last = ""

    def tell(progress: Progress) -> None:
        nonlocal last
        if progress.stage != last:
            log.debug("%s", described(progress))
            last = progress.stage
        if told is not None:
            told(progress)

    return tell


def described(progress: Progress) -> str:
    """What a search reports, in words.

    >>> described(Progress("search", labels=1_234_567, open=89, front=12, memory=345_000_000))
    'search  1,234,567 labels, 89 open, front 12, 345 MB'
    >>> described(Progress("compiling", detail="advance, 9 of 10 parts of the search (once)"))
    'compiling advance, 9 of 10 parts of the search (once)'
    """
    if not progress.labels:
        return f"{progress.stage} {progress.detail}".strip()
    counts = f"{progress.labels:,} labels, {progress.open:,} open, front {progress.front:,}"
    return f"{progress.stage}  {counts}, {progress.memory / 1e6:,.0f} MB"
