"""Command ``hpop retime``, which gives paths of a saved front their own speed profiles."""

from __future__ import annotations

from functools import reduce
from operator import or_
from pathlib import Path
from typing import Any

import click

import hpop
from hpop import cli, problems
from hpop.cli import results
from hpop.cli.results import SAVED, loaded, problem_of
from hpop.cli.terminal import echo, imports_option, rows_option, user_errors
from hpop.runtime.status import Progress, progress_bar


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@rows_option("Paths")
@click.option("--points", type=int, default=12, metavar="N", help="Speed profiles of each path. [12]")
@click.option(
    "--discomfort",
    default="squared_acceleration",
    metavar="NAME",
    show_default=True,
    help="Traded for time: squared_acceleration or peak_optic_flow.",
)
@click.option(
    "--slowest", type=float, default=2.0, metavar="FACTOR", show_default=True, help="Largest duration over the least."
)
@click.option("--jerk", type=float, metavar="J", help="Largest jerk, m/s³, rad/s³; no limit if left out.")
@click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="Folder to write. [FOLDER/retimed]")
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
    out = path.parent / "retimed" if out is None else out
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
