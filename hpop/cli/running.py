"""Commands that run plans: ``hpop batch`` solves many problems, and ``hpop drive`` simulates a drive along a plan."""

from __future__ import annotations

import math
import os
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

import hpop
from hpop import cli, problems, runtime
from hpop.base.lazy import library
from hpop.base.options import MOST_WORKERS
from hpop.base.text import argument, counted
from hpop.cli import results
from hpop.cli.results import loaded, problem_of
from hpop.cli.terminal import INTERRUPTED, echo, imports_option, user_errors
from hpop.errors import OutputError
from hpop.runtime import limits
from hpop.runtime.limits import Status, no_path_note

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

if TYPE_CHECKING:
    from hpop.batches.results import Results
    from hpop.batches.running import BatchProgress
    from hpop.drive import Execution, Moment, Options
    from hpop.drive.script import Happening

FIGURE = "summary.png"
NO_EVENTS = (
    "give --events YAML, a file of what happens on the way, such as\n  events:\n    - {at: 3, wish: fewer turns}\n"
    "docs/drive.md lists the events"
)


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
        bar = stack.enter_context(limits.progress_bar())

        def tell(progress: BatchProgress) -> None:
            nonlocal last
            if last is None and progress.done:
                echo(f"continuing: {out} has {progress.done:,} of {progress.count:,} cases")
            last = progress
            failures = f", {progress.failed:,} with an error" if progress.failed else ""
            remaining = hpop.batches.remaining_text(progress.left)
            detail = f"{progress.done:,} of {progress.count:,} cases{failures}{remaining}"
            bar(limits.Progress("solved", detail=detail))

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


DPI = 150
PICTURE, RECORD = "drive.png", "drive.json"


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--events", type=click.Path(path_type=Path), metavar="YAML", help="File of what happens on the way.")
@click.option(
    "--row",
    metavar="ROW",
    help="Trajectory to drive: a row number, knee, or least NAME. [that of the events file, or knee]",
)
@click.option(
    "--deadline",
    type=click.FloatRange(0),
    metavar="S",
    help="Processor time of the search for options after an event, s. [0.2, with a tour 2]",
)
@click.option(
    "--speed",
    type=click.FloatRange(0, min_open=True),
    metavar="N",
    help="Multiple of real time; as fast as possible by default.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="PATH", help="Folder for the results. [FOLDER/drive]")
@imports_option
@user_errors
def drive(
    folder: Path,
    events: Path | None,
    row: str | None,
    deadline: float | None,
    speed: float | None,
    out: Path | None,
    imports: tuple[str, ...],
) -> None:
    """Simulate a drive along a trajectory, with events.

    FOLDER holds the front that `hpop plan` wrote. After each event the options are printed: the front of
    trajectories from the robot to the goal. The robot changes its plan by itself if its path is closed, or if
    another path is better by a margin and can be announced in time. Writes a picture, drive.png, and a record that
    can be replayed, drive.json.
    """
    if events is None:
        raise click.UsageError(NO_EVENTS)
    cli.user_code.register(imports)
    path, front = loaded(folder)
    problem = problem_of(path, front)
    script = hpop.scenario.events.load_events(events, problem, front.names)
    (chosen,) = problems.named_rows.named_rows(front, [script.choice if row is None else row])
    target = out or path.with_name("drive")
    results.check_writable(target)
    driven = hpop.follow(problem, front, chosen.point)
    for note in script.notes:
        echo(f"note: {note}")
    echo(f"driving {chosen}, {driven.plan.duration:.1f} s")
    begin, happened = time.monotonic(), []
    try:
        for happening in hpop.drive.performed(driven, script.events, deadline=deadline):
            if speed is not None:
                time.sleep(max(0.0, happening.event.at / speed - (time.monotonic() - begin)))
            _print(happening, driven)
            happened.append(happening)
    finally:
        if driven.record:
            _write(driven, happened, target)
    _print_end(driven)


def _print(happening: Happening, driven: Execution) -> None:
    """Print an event, its effect on the robot's plan, the options, and the option that the robot takes."""
    x, y = (float(getattr(happening.driven.states, name)[-1]) for name in ("x", "y"))
    echo(f"\n{happening.event.at:.1f} s, at ({x:.2f}, {y:.2f}): {happening.event}")
    if happening.change is not None:
        for line in _consequences(happening):
            echo(f"  {line}")
    _print_options(happening.options, happening)
    if happening.words:
        echo(f"  {happening.words}")
    if happening.taken is None:
        open_ahead = driven.plan.duration >= driven.announced.duration
        waits = "no option can be taken: the robot waits before the closed part of its path"
        echo(f"  {'the robot keeps its plan' if open_ahead else waits}")
    else:
        echo(
            f"  {'taken as asked' if happening.asked else 'the robot takes by itself'}: option {happening.taken.index}"
        )


def _consequences(happening: Happening) -> list[str]:
    """Return lines that say how a change of the world (``happening.change``, not None) affects the present plan."""
    change = happening.change
    assert change is not None
    if change.safe_until is None:
        return ["the plan stays open"]
    stops = "" if change.stops_at is None else f"; the robot would stand from {change.stops_at:.1f} s on"
    return [f"the plan is closed ahead: safe until {change.safe_until:.1f} s{stops}{', braking' * change.brakes}"]


def _print_options(options: Options, happening: Happening) -> None:
    """Print a table of important options: the present plan, the option taken, the knee, and the least of each cost."""
    from rich.console import Console

    if not len(options):
        reason = no_path_note(options.front.notes) or f"{options.certificate}; give a later --deadline"
        for name in options.unreachable:  # the note names the method of Python
            reason = reason.replace(f"drive.skip({name!r})", f"the event `skip: {name}`")
        echo(f"  no options: {reason.removeprefix(f'{Status.NO_PATH}: ')}")
        return
    echo(
        f"  {counted(len(options), 'option')} from {options.commit.time:.1f} s on, {options.status}{_how_far(options)}:"
    )
    names = _named(options, happening)
    table, front = cli.report.plain_table(), options.front
    table.add_column("number", justify="right")
    for column in cli.report.headers(front):
        table.add_column(column, justify="right")
    table.add_column(cli.report.header("leaves at", "s"), justify="right")
    table.add_column(cli.report.header("next turn", "s from now"), justify="right")
    table.add_column("same side")
    numbers = problems.named_rows.stop_numbers(options.front)
    if numbers:
        table.add_column("stops")
    table.add_column("")
    for number, words in sorted(names.items()):
        option = options[number]
        sides = {None: "-", True: "yes", False: "no"}[option.same_side]
        leaves, turn = ("-" if t is None else f"{t:.1f}" for t in (option.leaves_at, option.next_turn))
        stops = [" ".join(str(numbers[name]) for name in option.stops) or "-"] if numbers else []
        costs = (f"{value:.5g}" for value in option.costs.values())
        table.add_row(str(number), *costs, leaves, turn, sides, *stops, ", ".join(words))
    cli.report.print_wide(Console(), table)
    if numbers:
        echo(f"  stops: {', '.join(f'{number} {name}' for name, number in numbers.items())}")


def _how_far(options: Options) -> str:
    """Return the end of a sentence: how much better than these options a missing one may be. "" if none is missing."""
    if options.gap == 0:
        return ""
    if math.isfinite(options.gap):
        return f", at most {options.gap:.1%} worse than missing options; a later --deadline finds more"
    return ", better options may be missing: give a later --deadline"


def _named(options: Options, happening: Happening) -> dict[int, list[str]]:
    """Return the labels of the options to print, such as "knee" or "taken", by index of the option."""
    names: dict[int, list[str]] = {}
    if options.keep_on is not None:
        names.setdefault(options.keep_on, []).append("present plan")
    if happening.taken is not None:
        names.setdefault(happening.taken.index, []).append("taken")
    for words, point in options.front.named().items():
        names.setdefault(point.index, []).append(words)
    return names


def _write(driven: Execution, happened: list[Happening], target: Path) -> None:
    """Write the record of a drive, and its picture if an event happened. Called also after an error."""
    with results.output_errors(f"cannot write to {target}", "choose another --out"):
        target.mkdir(parents=True, exist_ok=True)
        driven.save(target / RECORD)
        if happened:
            hpop.view.save.save_figure(hpop.view.draw_drive(driven, happened), target / PICTURE, DPI)
    echo(f"\nwritten to {target}: {', '.join([RECORD, *[PICTURE] * bool(happened)])}")


def _print_end(driven: Execution) -> None:
    """Print when the robot arrived, or stopped before a closed part of its path, and the costs of the whole drive."""
    moment = driven.at(max(driven.begin + driven.plan.duration, driven.record[-1]["now"]))
    costs = ", ".join(
        f"{name} {value:.5g}" + f" {criterion.unit}" * (criterion.unit != "1")
        for (name, value), criterion in zip(moment.past.items(), driven.problem.criteria, strict=True)
    )
    if moment.stops is not None:
        echo(_visits(moment))
    stands = "goal not reached: the robot stands before the closed part of its path"
    where = "the robot arrives" if moment.arrived else stands
    echo(f"{where} after {moment.planned:.1f} s; the drive cost {costs}")


def _visits(moment: Moment) -> str:
    """Return a line with the visits of a drive along a tour, and the stops that it skipped or did not visit."""
    progress = moment.stops
    assert progress is not None
    optional = {name for name, stop in zip(progress.tour.names, progress.tour.stops, strict=True) if stop.optional}
    visits = ", ".join(f"{visit.name} ({visit.begin:.1f} to {visit.end:.1f} s)" for visit in moment.visits)
    line = f"visited: {visits or 'none'}"
    for words, names in (("skipped", progress.skipped), ("not visited", progress.remaining + progress.passed_over)):
        if names:
            kinds = (f"{name} ({'optional' if name in optional else 'required'})" for name in names)
            line += f"; {words}: {', '.join(kinds)}"
    return line
