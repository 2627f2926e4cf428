"""Commands for a saved front: ``hpop show`` prints and checks it, ``pick`` chooses, ``retime`` sets speeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from itertools import chain, count
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import hpop
from hpop import cli, problems
from hpop.base.text import counted
from hpop.cli import results
from hpop.cli.results import PAGE, SAVED, loaded, problem_of
from hpop.cli.running import is_batch, print_summary
from hpop.cli.terminal import (
    echo,
    imports_option,
    open_page,
    points_option,
    preference_option,
    rows_option,
    user_errors,
    verbose_option,
)
from hpop.errors import OutputError
from hpop.runtime import limits
from hpop.runtime.limits import Progress, progress_bar

if TYPE_CHECKING:
    from hpop.base.arrays import IntArray
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem


# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

MOST_FAULTS = 20
MOST_CHECKED = 10_000  # trajectories, which take some 2 s and 100 MB
PAIR = "NAME=NUMBER"


def _numbers(context: click.Context, option: click.Parameter, given: Sequence[str]) -> dict[str, float]:
    """Parse the values NAME=NUMBER of a repeated option, such as turns=5, into a dictionary."""
    found: dict[str, float] = {}
    for text in given:
        name, _, number = text.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            raise click.BadParameter(f"expected {PAIR}, such as turns=5, got {text!r}", context, option) from None
        if name.strip().endswith(("<", ">")):
            raise click.BadParameter(f"expected {PAIR}, such as turns=5 without < or >, got {text!r}", context, option)
        if name.strip() in found:
            raise click.BadParameter(f"give each name once, got {name.strip()!r} twice", context, option)
        found[name.strip()] = value
    return found


def _names(context: click.Context, option: click.Parameter, given: Sequence[str]) -> list[str]:
    """Split the values of a repeated option at commas; return all names in one list."""
    names = [name.strip() for text in given for name in text.split(",")]
    if not all(names):
        raise click.BadParameter(
            "expected names separated by commas, none empty, such as sickness,rotation", context, option
        )
    return names


also_option = click.option(
    "--also",
    metavar="NAME,NAME",
    multiple=True,
    callback=_names,
    help="Further criteria to evaluate on these trajectories (`hpop criteria` lists them). Repeatable.",
)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@also_option
@preference_option
@click.option(
    "--rows", type=click.IntRange(1), metavar="N", help="Rows of the table, with all marked ones; 20 if left out."
)
@points_option("Rows of the table, chosen to represent the front (largest hypervolume), with all marked ones.")
@click.option(
    "--all", "every", is_flag=True, help=f"Check all trajectories, even if there are more than {MOST_CHECKED:,}."
)
@click.option(
    "--judge",
    "library",
    type=click.Choice(["fcl", "coal"]),
    default="fcl",
    help="Library that tests collisions: fcl (python-fcl), or for arms coal (hpop[coal]).",
)
@click.option("--web", is_flag=True, help=f"Write {PAGE} beside the front, a page to choose a trajectory in a browser.")
@click.option("--open", "opens", is_flag=True, help="Write this page and open it in a browser.")
@verbose_option
@imports_option
@user_errors
def show(
    folder: Path,
    also: list[str],
    person: Path | None,
    rows: int | None,
    points: int | None,
    every: bool,
    library: str,
    web: bool,
    opens: bool,
    verbose: bool,
    imports: tuple[str, ...],
) -> None:
    """Print and check the front that `hpop plan` wrote.

    Its costs are evaluated again, and its trajectories are checked for collisions. If the front in FOLDER has more than
    10,000 trajectories, those of the table and 10,000 others, spread over the front, are checked; --all checks all. For
    a FOLDER that `hpop batch` wrote, the summary is printed.
    """
    if rows is not None and points is not None:
        raise click.UsageError("give --rows or --points, not both")
    cli.user_code.register(imports)
    if is_batch(folder):
        print_summary(hpop.batches.Results(folder))
        return
    path, front = loaded(folder)
    preference = cli.picking.loaded_preference(person)
    problem = problem_of(path, front)
    most, checked = cli.report.MostRows(points or rows or cli.report.MOST_ROWS, represent=points is not None), None
    if len(front) > MOST_CHECKED and not every:
        checked = _spread(front, cli.report.shown_rows(front, most, cli.report.marks(front, preference)))
    _refuse_faults(path, problems.verify.lost_trajectories(problem, front, None if also else checked))
    echo(f"as saved in {path}, not yet checked:")
    more = _with_further(problem, front, also)
    cli.report.print_front(problem, more, saved=path, verbose=verbose, preference=preference, most=most)
    if preference is not None and len(front):
        cli.picking.print_preference(preference, more)
    checks = "ends and collisions" if problem.tour is None else "ends, stops and collisions"
    echo(f"checking costs, {checks}")
    with limits.progress_bar() as progress:
        faults = problems.verify.verify(
            problem,
            front,
            rows=checked,
            library=library,
            say=lambda doing: progress(Progress(f"checking: {doing}")),
        )
    _refuse_faults(path, faults)
    number = cli.report.how_many(front) if checked is None else f"{checked.size:,} of {cli.report.how_many(front)}"
    echo(f"verified: costs re-evaluated, {checks} checked for {number}")
    if checked is not None:
        echo("note: checked were the table and trajectories spread over the front; --all checks all trajectories")
    if web or opens:
        page = results.save_page(problem, more, path, preference)
        echo(f"written: {page}, to choose from in a browser")
        if opens:
            open_page(page)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--at-most",
    metavar=PAIR,
    multiple=True,
    callback=_numbers,
    help="Only trajectories with at most this cost, such as turns=5. Repeatable.",
)
@click.option(
    "--least",
    metavar="NAME",
    multiple=True,
    callback=_names,
    help="The trajectory with the least of this cost; further names break ties. Repeatable.",
)
@click.option(
    "--wish",
    metavar=PAIR,
    multiple=True,
    callback=_numbers,
    help="The trajectory nearest to this cost, such as turns=3. Repeatable.",
)
@click.option("--row", metavar="ROW", help="The trajectory of this number in `hpop show`; or knee, or least NAME.")
@click.option(
    "--knee", is_flag=True, help="The knee: the compromise farthest below the plane through the extremes. [default]"
)
@preference_option
@click.option("--csv", type=click.Path(path_type=Path), metavar="FILE", help="Write the motion of a body, as executed.")
@click.option("--body", metavar="NAME", help="Body of --csv: camera, base, tool or joints. [camera]")
@also_option
@imports_option
@user_errors
def pick(
    folder: Path,
    at_most: dict[str, float],
    least: list[str],
    wish: dict[str, float],
    row: str | None,
    knee: bool,
    person: Path | None,
    csv: Path | None,
    body: str | None,
    also: list[str],
    imports: tuple[str, ...],
) -> None:
    """Pick one trajectory of a front, and give the reason.

    FOLDER holds the front that `hpop plan` wrote. Give one of --least, --wish, --row, --knee and --preference;
    --at-most limits the choice. --at-most and --wish may name criteria added by --also.
    """
    ways = {"--least": bool(least), "--wish": bool(wish), "--row": row is not None, "--knee": knee}
    ways["--preference"] = person is not None
    given = [name for name, is_given in ways.items() if is_given]
    if len(given) > 1:
        raise click.UsageError(f"give one of {', '.join(ways)}, got {' and '.join(given)}")
    if row is not None and at_most:
        raise click.UsageError("--row names one trajectory, so --at-most has no effect: give only one of these options")
    if body is not None and csv is None:
        raise click.UsageError("--body says whose motion --csv writes: give --csv FILE too, or leave it out")
    cli.user_code.register(imports)
    path, front = loaded(folder)
    if also:
        front = _with_further(problem_of(path, front), front, also)
    preference = cli.picking.loaded_preference(person)
    number = None if row is None else problems.named_rows.named_rows(front, [row])[0].number
    picked = cli.picking.picked(front, at_most, least=least, wish=wish, row=number, preference=preference)
    cli.picking.print_picked(front, picked, saved=path)
    if csv is not None:
        body = body or "camera"
        table = picked.point.trajectory.table(body=body)
        table.to_csv(csv)
        echo(f"written to {csv}: the {body} every 0.1 s of the executed trajectory, {len(table):,} rows of")
        echo(f"  {', '.join(table.headings)}")


def _spread(front: Front, shown: Iterable[int]) -> IntArray:
    """Return the rows of a large front to verify: those of the table, and others evenly spread over the front."""
    import numpy as np

    return np.unique([*np.linspace(0, len(front) - 1, MOST_CHECKED).round().astype(np.int64), *shown])


def _refuse_faults(path: Path, faults: list[str]) -> None:
    """Print the faults of a saved front to standard error, and raise OutputError if there are any."""
    for fault in faults[:MOST_FAULTS]:
        echo(f"fault: {fault}", err=True)
    if faults:
        more = f", {MOST_FAULTS} of them listed" if len(faults) > MOST_FAULTS else ""
        raise OutputError(f"the front saved in {path} is wrong ({counted(len(faults), 'fault')}{more}); plan again")


def _with_further(problem: Problem, front: Front, also: Sequence[str]) -> Front:
    """Return the front with the criteria ``also`` evaluated on its trajectories, as reported values."""
    with limits.progress_bar() as progress:
        return problems.evaluation.evaluated(
            problem, front, also, lambda done: progress(Progress("evaluation", detail=done))
        )


def _new_folder(folder: Path) -> Path:
    """Return a folder, or the first of folder_2, folder_3, ... without a saved front if it holds one."""
    numbered = (folder.with_name(f"{folder.name}_{number}") for number in count(2))
    return next(each for each in chain([folder], numbered) if not (each / SAVED).exists())


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@rows_option("Paths")
@click.option("--points", type=int, default=12, metavar="N", help="Speed profiles of each path. [12]")
@click.option(
    "--discomfort",
    default="squared_acceleration",
    metavar="NAME",
    show_default=True,
    help="Traded for time: squared_acceleration, peak_optic_flow or felt_msdv.",
)
@click.option(
    "--slowest", type=float, default=2.0, metavar="FACTOR", show_default=True, help="Largest duration over the least."
)
@click.option("--jerk", type=float, metavar="J", help="Largest jerk, m/s³, rad/s³; no limit if left out.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Folder to write. [FOLDER/retimed, or retimed_2 and so on if that holds a front]",
)
@imports_option
@user_errors
def retime(
    folder: Path,
    rows: list[str],
    points: int,
    discomfort: str,
    slowest: float,
    jerk: float | None,
    out: Path | None,
    imports: tuple[str, ...],
) -> None:
    """Choose speed profiles along paths of a front.

    FOLDER holds the front that `hpop plan` wrote. The paths stay. Each point of the new front is the gentlest profile
    for its duration; it is written to a folder that `hpop show` and other commands can read.
    """
    cli.user_code.register(imports)
    path, front = loaded(folder)
    problem, chosen = problem_of(path, front), problems.named_rows.named_rows(front, rows)
    out = _new_folder(path.parent / "retimed") if out is None else out
    results.check_writable(out)
    click.get_current_context().with_resource(results.held(out))
    fronts = []
    with progress_bar() as progress:
        for row in chosen:
            progress(Progress(f"speed profiles of {row}"))
            options: dict[str, Any] = {"discomfort": discomfort, "points": points, "slowest": slowest, "jerk": jerk}
            fronts.append(hpop.retime(problem, row.point.trajectory, **options))
    found = reduce(or_, fronts)
    results.save(found, out)
    again = hpop.Problem.from_description(found.problem or {})
    cli.report.print_front(again, found, saved=out / SAVED)
    drawn = results.draw(again, found, out)
    echo(f"written to {out}: {', '.join([SAVED, *drawn])}")
