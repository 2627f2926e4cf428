"""Command ``hpop batch``: solve many problems with several planners, and summarise the results."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

import hpop
from hpop import cli, runtime
from hpop.base.lazy import library
from hpop.base.options import MOST_WORKERS
from hpop.base.text import argument
from hpop.cli import results
from hpop.cli.terminal import INTERRUPTED, echo, imports_option, user_errors
from hpop.errors import OutputError
from hpop.runtime import status

if TYPE_CHECKING:
    from hpop.batches.results import Results
    from hpop.batches.running import BatchProgress

FIGURE = "summary.png"


@click.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the results; out/SPEC by default.")
@click.option("--workers", type=click.IntRange(1, MOST_WORKERS), help="Processes on this machine; 1 by default.")
@click.option("--dask", metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786.")
@click.option("--ray", metavar="ADDRESS", help="Ray cluster, such as host:6379, or auto for one on this machine.")
@click.option("--again", is_flag=True, help="Also solve again the cases that ended with an error.")
@imports_option
@user_errors
def batch(
    spec: Path,
    out: Path | None,
    workers: int | None,
    dask: str | None,
    ray: str | None,
    again: bool,
    imports: tuple[str, ...],
) -> None:
    """Solve many variants of a scenario, and summarise them.

    SPEC is a scenario file in which some keys have several values; every combination of these values is a case. Each
    result is saved at once. After Ctrl-C or a crash, run the same command again, and it continues.
    """
    if sum(given is not None for given in (workers, dask, ray)) > 1:
        raise click.UsageError("give only one of --workers, --dask and --ray")
    _need_tables()
    cli.user_code.register(imports)
    out = out or Path("out", spec.stem)
    results.check_writable(out)
    cases = hpop.batches.cases.Specification.load(spec)
    last: BatchProgress | None = None
    with ExitStack() as stack:
        stack.enter_context(results.held(out))
        executor = None
        if dask is not None:
            executor = stack.enter_context(runtime.sweep.dask(dask))
        elif ray is not None:
            executor = stack.enter_context(runtime.sweep.ray(ray))
        bar = stack.enter_context(status.progress_bar())

        def tell(progress: BatchProgress) -> None:
            nonlocal last
            if last is None and progress.done:
                echo(f"continuing: {out} has {progress.done:,} of {progress.count:,} cases")
            last = progress
            failures = f", {progress.failed:,} with an error" if progress.failed else ""
            remaining = hpop.batches.summary.remaining_text(progress.left)
            detail = f"{progress.done:,} of {progress.count:,} cases{failures}{remaining}"
            bar(status.Progress("solved", detail=detail))

        try:
            hpop.batches.running.run_cases(cases, out, workers=workers, executor=executor, progress=tell, again=again)
        except KeyboardInterrupt:
            done = f"{last.done:,} of {last.count:,} cases are" if last is not None else "all finished cases are"
            echo(f"interrupted: {done} saved in {out}; run the same command again to continue", err=True)
            sys.exit(INTERRUPTED)
    errors = print_summary(hpop.batches.Results(out))
    if errors:
        echo(
            f"note: {errors:,} of {len(cases):,} cases ended with an error, see the column `error`; "
            f"`hpop batch {argument(spec)} --out {argument(out)} --again` solves them again",
            err=True,
        )


def is_batch(folder: Path) -> bool:
    """Return whether a folder was written by ``hpop batch`` (many results) rather than ``hpop plan`` (one front)."""
    return os.path.isdir(folder / "results") and not os.path.exists(folder / results.SAVED)


def print_summary(found: Results) -> int:
    """Print the summary of a batch, save its figure beside the results, and return the number of failed cases."""
    _need_tables()
    summary = hpop.batches.summaries(found)
    if not summary:
        raise OutputError(f"{found.folder} holds no results yet; run `hpop batch` again to continue")
    for line in hpop.batches.summary_lines(summary):
        echo(line)
    with results.output_errors(f"cannot write to {found.folder}", "choose another --out"):
        hpop.view.draw_batch(summary, found.folder / FIGURE)
    echo(f"written to {found.folder}: {hpop.batches.results.FOLDER}/*.parquet, {FIGURE}")
    return sum(each.counts.get("error", 0) for each in summary)


def _need_tables() -> None:
    """Raise OutputError if the library that reads and writes the tables of results is not installed."""
    try:
        library("pyarrow.parquet", "a batch")
    except ImportError as error:
        raise OutputError(str(error)) from None
