"""``hpop drive``: simulate a drive along a trajectory of a saved front, with doors that close, people, and wishes."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hpop.base.text import counted
from hpop.cli import results
from hpop.cli.results import loaded, problem_of
from hpop.cli.terminal import echo, imports_option, user_errors
from hpop.runtime.status import Status, no_path_note

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

if TYPE_CHECKING:
    from hpop.drive import Execution, Options
    from hpop.drive.script import Happening

DEADLINE = 0.2
DPI = 150
PICTURE, RECORD = "drive.png", "drive.json"


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--events", type=click.Path(path_type=Path), required=True, metavar="YAML", help="Events of the drive.")
@click.option("--row", metavar="ROW", help="Row to drive: a number, knee, or least NAME. [the events' row, or knee]")
@click.option(
    "--deadline",
    type=click.FloatRange(0),
    default=DEADLINE,
    metavar="S",
    show_default=True,
    help="Seconds of processor time to search for options.",
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
    events: Path,
    row: str | None,
    deadline: float,
    speed: float | None,
    out: Path | None,
    imports: tuple[str, ...],
) -> None:
    """Simulate a drive along a plan of the front in a FOLDER that `hpop plan` wrote, with events on its way.

    After each event the options are printed: the front of the remaining paths. The robot changes its plan by itself if
    its path is closed, or if another path is better by a margin and announced in time. Writes a picture, drive.png, and
    a record that can be replayed, drive.json.
    """
    from hpop.cli import user_code
    from hpop.drive import follow
    from hpop.drive.script import performed
    from hpop.problems.named_rows import named_rows
    from hpop.scenario.events import load_events

    user_code.register(imports)
    path, front = loaded(folder)
    problem = problem_of(path, front)
    script = load_events(events, problem, front.names)
    (chosen,) = named_rows(front, [script.choice if row is None else row])
    target = out or path.with_name("drive")
    results.check_writable(target)
    driven = follow(problem, front, chosen.point)
    for note in script.notes:
        echo(f"note: {note}")
    echo(f"driving {chosen}, {driven.plan.duration:.1f} s")
    begin, happened = time.monotonic(), []
    try:
        for happening in performed(driven, script.events, deadline=deadline):
            if speed is not None:
                time.sleep(max(0.0, happening.event.at / speed - (time.monotonic() - begin)))
            _print(happening, driven)
            happened.append(happening)
    finally:
        if driven.record:
            _write(driven, happened, target)
    _print_end(driven)


def _print(happening: Happening, driven: Execution) -> None:
    """Print an event, its effect on the plan, the options, and the option that is taken."""
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
        waits = "no option can be taken: it waits before the closed part of its path"
        echo(f"  {'it keeps its plan' if open_ahead else waits}")
    else:
        echo(f"  {'taken' if happening.asked else 'the robot takes by itself'}: number {happening.taken.index}")


def _consequences(happening: Happening) -> list[str]:
    change = happening.change
    assert change is not None
    if change.safe_until is None:
        return ["the plan stays open"]
    stops = "" if change.stops_at is None else f"; it would stand from {change.stops_at:.1f} s on"
    return [f"the plan is closed ahead: safe until {change.safe_until:.1f} s{stops}{', braking' * change.brakes}"]


def _print_options(options: Options, happening: Happening) -> None:
    """Print a table of options: the present plan, the option taken, the knee, and the least of each cost."""
    from rich.console import Console

    from hpop.cli.report import header, plain_table, print_wide

    if not len(options):
        reason = no_path_note(options.front.notes) or f"{options.certificate}; give a later --deadline"
        echo(f"  no options: {reason.removeprefix(f'{Status.NO_PATH}: ')}")
        return
    echo(
        f"  {counted(len(options), 'option')} from {options.commit.time:.1f} s on, {options.status}{_how_far(options)}:"
    )
    names = _named(options, happening)
    table, front = plain_table(), options.front
    table.add_column("number", justify="right")
    for name, unit in zip(front.names, front.units, strict=True):
        table.add_column(header(name, unit), justify="right")
    table.add_column(header("leaves at", "s"), justify="right")
    table.add_column(header("next turn", "s from now"), justify="right")
    table.add_column("same side")
    table.add_column("")
    for number, words in sorted(names.items()):
        option = options[number]
        sides = {None: "-", True: "yes", False: "no"}[option.same_side]
        leaves, turn = ("-" if t is None else f"{t:.1f}" for t in (option.leaves_at, option.next_turn))
        table.add_row(
            str(number), *(f"{value:.5g}" for value in option.costs.values()), leaves, turn, sides, ", ".join(words)
        )
    print_wide(Console(), table)


def _how_far(options: Options) -> str:
    """Return in words how much better than these options a missing one may be, with advice; "" if none is missing."""
    if options.gap == 0:
        return ""
    if math.isfinite(options.gap):
        return f", at most {options.gap:.1%} worse than missing options"
    return ", better options may be missing: give a later --deadline"


def _named(options: Options, happening: Happening) -> dict[int, list[str]]:
    """Return the indices of the options to print, each with its labels, such as "knee"."""
    names: dict[int, list[str]] = {}
    if options.keep_on is not None:
        names.setdefault(options.keep_on, []).append("present plan")
    if happening.taken is not None:
        names.setdefault(happening.taken.index, []).append("taken")
    for words, point in options.front.named().items():
        names.setdefault(point.index, []).append(words)
    return names


def _write(driven: Execution, happened: list[Happening], target: Path) -> None:
    """Write the record and the picture of a drive, also after an error."""
    from hpop.view.moments import draw_drive
    from hpop.view.save import save_figure

    with results.output_errors(f"cannot write to {target}", "choose another --out"):
        target.mkdir(parents=True, exist_ok=True)
        driven.save(target / RECORD)
        if happened:
            save_figure(draw_drive(driven, happened), target / PICTURE, DPI)
    echo(f"\nwritten to {target}: {', '.join([RECORD, *[PICTURE] * bool(happened)])}")


def _print_end(driven: Execution) -> None:
    moment = driven.at(max(driven.begin + driven.plan.duration, driven.record[-1]["now"]))
    costs = ", ".join(
        f"{name} {value:.5g}" + f" {criterion.unit}" * (criterion.unit != "1")
        for (name, value), criterion in zip(moment.past.items(), driven.problem.criteria, strict=True)
    )
    where = "it arrives" if moment.arrived else "it stands before the closed part of its path"
    echo(f"{where} after {moment.planned:.1f} s; the drive cost {costs}")
