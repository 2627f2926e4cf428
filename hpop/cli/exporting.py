"""Commands ``hpop export`` and ``ride``: trajectories for other programs, and for viewers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

import hpop
from hpop import cli, problems
from hpop.cli.results import RIDE, loaded, problem_of
from hpop.cli.terminal import echo, imports_option, listed, open_page, points_option, rows_option, user_errors
from hpop.errors import HpopError
from hpop.runtime import limits

if TYPE_CHECKING:
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem


# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@rows_option("Trajectories")
@points_option("Trajectories that represent the front (largest hypervolume), instead of --rows or beside them.")
@click.option(
    "--format",
    "formats",
    metavar="NAME,NAME",
    multiple=True,
    callback=listed,
    default=["csv"],
    help="Formats, such as tum,unity-csv,mcap,glb; `hpop formats` lists them. [csv]",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="Folder for the files. [FOLDER/export]")
@click.option("--rate", type=float, metavar="HZ", help="Poses a second. [20; 100 for joints]")
@click.option(
    "--planned", is_flag=True, help="Write the planned motion instead of the executed one (with speed ramps)."
)
@click.option("--body", default="camera", metavar="NAME", help="camera, base, tool or joints. [camera]")
@click.option(
    "--jerk", type=float, metavar="MOST", help="Largest jerk of an arm's joints, rad/s³ or m/s³; none by default."
)
@click.option("--frame-id", default="map", metavar="NAME", help="Frame of the world, in ROS and Nav2. [map]")
@click.option("--base-frame", default="base_link", metavar="NAME", help="Frame of the base. [base_link]")
@click.option("--camera-frame", default="camera_link", metavar="NAME", help="Frame of the camera. [camera_link]")
@imports_option
@user_errors
def export(
    folder: Path,
    rows: list[str],
    points: int | None,
    formats: list[str],
    out: Path | None,
    rate: float | None,
    planned: bool,
    body: str,
    jerk: float | None,
    frame_id: str,
    base_frame: str,
    camera_frame: str,
    imports: tuple[str, ...],
) -> None:
    """Write trajectories of a front to files for other programs.

    FOLDER holds the front that `hpop plan` wrote. Files are named after the rows, such as knee_70.tum;
    knee_70.about.json has the costs and the axes of each file. Existing files are replaced. If one format is unknown
    or cannot be written, the others still are, and the exit code is not 0. `--body joints` writes joint values, speeds
    and accelerations for controllers: csv, joint-trajectory, moveit, follow-joint-trajectory, mcap or bag.
    """
    from hpop.base.registry import formats as registered
    from hpop.export.writing import named_format

    cli.user_code.register(imports)
    frames = hpop.export.Frames(frame_id, base_frame, camera_frame)
    of_world = [name for name in formats if name in registered and named_format(name).world]
    path, front = loaded(folder)
    if points is not None:
        is_default = click.get_current_context().get_parameter_source("rows") is ParameterSource.DEFAULT
        few = hpop.frontier.representative(front.integers, points).tolist()
        rows = [*([] if is_default else rows), *map(str, few)]
    problem, no_world = None, None
    if of_world:
        try:
            problem = problem_of(path, front)
        except HpopError as error:  # the map is missing: formats without the world are still written
            formats = [name for name in formats if name not in of_world]
            if not formats:
                raise
            no_world = error  # raised at the end
    out = path.parent / "export" if out is None else out
    if no_world is not None:
        no_world.add_note(f"so {', '.join(of_world)}, which needs the map, is not written")
    try:
        written = hpop.export.save(
            problem,
            front,
            out,
            rows=rows,
            formats=formats,
            rate=rate,
            body=body,
            planned=planned,
            jerk=jerk,
            frames=frames,
        )
    except HpopError as error:
        if no_world is not None:
            error.add_note("\n".join([str(no_world), *no_world.__notes__]))
        raise
    echo(f"written to {out}: {', '.join(file.name for file in written)}")
    if no_world is not None:
        raise no_world


FPS, WIDTH = 30.0, 2048


def video_options(command: Any) -> Any:
    """Add the options for videos to a command."""
    for option in (
        click.option("--width", type=int, default=WIDTH, metavar="N", help=f"Pixels of a video's width. [{WIDTH}]"),
        click.option("--fps", type=float, default=FPS, metavar="N", help=f"Frames a second. [{FPS:g}]"),
        click.option(
            "--frames", type=click.Path(path_type=Path), metavar="FOLDER", help="Write its frames as PNG files."
        ),
        click.option(
            "--video", type=click.Path(path_type=Path), metavar="MP4", help="Write a 360 degree video of one row."
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
    """Write a 360 degree video of one row (by default the knee), its frames as PNG files, or both; print the names."""
    if len(rows) > 1:
        raise click.UsageError(f"a video shows one row, got {len(rows)}: {', '.join(rows)}; run the command for each")
    (row,) = problems.named_rows.named_rows(front, rows or ["knee"])
    for note in hpop.view.ride.scene.ViewScene.of(problem).notes:
        echo(f"note: {note}")
    for save, target in ((hpop.view.save_video, video), (hpop.view.save_frames, frames)):
        if target is None:
            continue
        with limits.progress_bar() as progress:
            written = save(problem, front, target, row=row.number, fps=fps, width=width, progress=progress)
        echo(f"written to {written}: {row} as executed, {width} x {width // 2} pixels, {fps:g} frames a second")


PORT = 8000
KNEE = ["knee"]


def _rows(context: click.Context, option: click.Parameter, given: Sequence[str]) -> list[str]:
    """Split the values of the repeated option --rows at commas; return all rows in one list."""
    rows = [row.strip() for text in given for row in text.split(",")]
    if not all(rows):
        raise click.BadParameter("expected ROW or ROW,ROW, such as knee,3", context, option)
    return rows


def _page_options(command: Any) -> Any:
    """Add the options for writing the page, and for serving it to a headset, to a command."""
    for option in (
        click.option(
            "--port", type=click.IntRange(0, 65535), default=PORT, metavar="N", help=f"Port to serve on. [{PORT}]"
        ),
        click.option(
            "--cable", is_flag=True, help="Serve the page to this machine, and to a headset on its cable (adb)."
        ),
        click.option(
            "--serve", is_flag=True, help="Serve the page to headsets in the network, over https (hpop[serve])."
        ),
        click.option("--open", "opens", is_flag=True, help="Write the page and open it in a browser."),
        click.option("--blind", is_flag=True, help="Leave costs and names of criteria out of the page."),
        click.option("--out", type=click.Path(path_type=Path), metavar="HTML", help=f"[FOLDER/{RIDE}]"),
    ):
        command = option(command)
    return command


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--rows",
    multiple=True,
    callback=_rows,
    metavar="ROW,ROW",
    help="Numbers, knee, or least NAME; the knee by default. On the page they are A, B, ...",
)
@_page_options
@video_options
@imports_option
@user_errors
def ride(
    folder: Path,
    rows: list[str],
    out: Path | None,
    blind: bool,
    opens: bool,
    serve: bool,
    cable: bool,
    port: int,
    video: Path | None,
    frames: Path | None,
    fps: float,
    width: int,
    imports: tuple[str, ...],
) -> None:
    """Show the viewer's view along trajectories of a front.

    FOLDER holds the front that `hpop plan` wrote. Writes a page, one file that needs no network, to ride along
    trajectories and compare them. With --serve or --cable the page is served until Ctrl-C instead. With --video or
    --frames a 360 degree video of one row is made.
    """
    filmed, served = video is not None or frames is not None, serve or cable
    if filmed and (served or out is not None or blind or opens):
        raise click.UsageError(
            "--video and --frames make no page: leave out --serve, --cable, --out, --blind and --open"
        )
    if served and (out is not None or opens or (serve and cable)):
        raise click.UsageError("give only one of --serve and --cable; a served page has no --out and no --open")
    cli.user_code.register(imports)
    path, front = loaded(folder)
    problem = problem_of(path, front)
    if filmed:
        film(problem, front, rows, video=video, frames=frames, fps=fps, width=width)
    elif served:
        _serve(problem, front, rows or KNEE, blind=blind, cable=cable, port=port)
    else:
        _write(problem, front, rows or KNEE, out or path.with_name(RIDE), blind=blind, opens=opens)


def _say(problem: Problem, front: Front, rows: Sequence[str]) -> str:
    """Print the letter of each trajectory on the page, and notes on inexact drawings.

    Returns the number of trajectories as text, such as "2 trajectories".
    """
    chosen = problems.named_rows.named_rows(front, rows)
    for note in hpop.view.ride.scene.ViewScene.of(problem).notes:
        echo(f"note: {note}")
    for name, row in zip("ABCDEFGH", chosen, strict=False):
        echo(f"{name} is {row}")
    return "1 trajectory" if len(chosen) == 1 else f"{len(chosen)} trajectories"


def _write(problem: Problem, front: Front, rows: Sequence[str], out: Path, *, blind: bool, opens: bool) -> None:

    written = hpop.view.save_ride(problem, front, out, rows=rows, blind=blind)
    echo(f"written: {written}, to ride along {_say(problem, front, rows)} in a browser")
    if opens:
        open_page(written)


def _serve(problem: Problem, front: Front, rows: Sequence[str], *, blind: bool, cable: bool, port: int) -> None:
    """Serve the page until Ctrl-C, and print how to open it in a headset."""
    serving = cli.serving
    page = hpop.view.ride.page.ride_page(problem, front, rows=rows, blind=blind).encode()
    if cable:
        host, certificate = serving.LOCAL, None
    else:
        host, certificate = serving.own_address(), serving.certificate_for(serving.own_address())
    everywhere = serving.LOCAL if cable else serving.EVERYWHERE
    with serving.OnePage(page, host=everywhere, port=port, names=[host], certificate=certificate) as server:
        _say(problem, front, rows)
        serving.serve_headsets(server, certificate, f"served until Ctrl-C: {server.address(host)}")
        echo("no longer served")
