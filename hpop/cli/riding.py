"""``hpop ride``: what the viewer would see along trajectories of a front."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from hpop.cli.command import imports_option, user_errors
from hpop.cli.filming import film, video_options
from hpop.cli.front_file import loaded, problem_of


def _rows(context: click.Context, option: click.Parameter, given: Sequence[str]) -> list[str]:
    """Rows of several options, each with some between commas."""
    rows = [row.strip() for text in given for row in text.split(",")]
    if not all(rows):
        raise click.BadParameter("expected ROW or ROW,ROW, such as knee,3", context, option)
    return rows


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--rows",
    multiple=True,
    callback=_rows,
    metavar="ROW,ROW",
    help="Numbers, knee, or least NAME; the knee by default.",
)
@video_options
@imports_option
@user_errors
def ride(
    folder: Path,
    rows: list[str],
    video: Path | None,
    frames: Path | None,
    fps: float,
    width: int,
    imports: tuple[str, ...],
) -> None:
    """Show what the viewer would see along a trajectory of the front in a FOLDER that `hpop plan` wrote."""
    from hpop.cli import user_code

    if video is None and frames is None:
        raise click.UsageError("give --video FILE.mp4, or --frames FOLDER")
    user_code.register(imports)
    path, front = loaded(folder)
    film(problem_of(path, front), front, rows, video=video, frames=frames, fps=fps, width=width)
