"""What ``hpop ride --video`` and ``--frames`` do: a video all round of one trajectory of a saved front."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hpop.cli.terminal import echo

if TYPE_CHECKING:
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem

FPS, WIDTH = 30.0, 2048


def video_options(command: Any) -> Any:
    """The options of a command that also makes videos."""
    for option in (
        click.option("--width", type=int, default=WIDTH, metavar="N", help=f"Pixels of a video's width. [{WIDTH}]"),
        click.option("--fps", type=float, default=FPS, metavar="N", help=f"Frames a second. [{FPS:g}]"),
        click.option("--frames", type=click.Path(path_type=Path), metavar="FOLDER", help="Its frames as PNG files."),
        click.option(
            "--video", type=click.Path(path_type=Path), metavar="MP4", help="Write a video all round of one row."
        ),
    ):
        command = option(command)
    return command


def film(
    problem: Problem,
    front: Front,
    rows: Sequence[str],
    *,
    video: Path | None,
    frames: Path | None,
    fps: float,
    width: int,
) -> None:
    """Make the video, or its frames, or both, of the one row that is asked for, the knee by default; say what it is."""
    from hpop.problems.named_rows import named_rows
    from hpop.runtime import status
    from hpop.view import save_frames, save_video
    from hpop.view.ride.scene import Scene

    if len(rows) > 1:
        raise click.UsageError(f"a video is of one row, got {len(rows)}: {', '.join(rows)}; make one of each")
    (row,) = named_rows(front, rows or ["knee"])
    for note in Scene.of(problem).notes:
        echo(f"note: {note}")
    for save, target in ((save_video, video), (save_frames, frames)):
        if target is None:
            continue
        with status.progress_bar() as progress:
            written = save(problem, front, target, row=row.number, fps=fps, width=width, progress=progress)
        echo(f"written to {written}: {row} as executed, {width} x {width // 2} pixels, {fps:g} frames a second")
