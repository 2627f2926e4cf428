"""Commands ``hpop export``, which writes trajectories to files, and ``hpop ros``, which serves a planner to ROS 2."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import click
from click.core import ParameterSource

import hpop
from hpop import cli
from hpop.cli.results import loaded, problem_of
from hpop.cli.terminal import echo, imports_option, listed, points_option, rows_option, user_errors
from hpop.errors import HpopError, OutputError
from hpop.runtime.status import Status, progress_bar

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


@click.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--url", required=True, metavar="URL", help="Websocket of rosbridge, such as ws://localhost:9090.")
@click.option("--action", default="/hpop/compute_path_to_pose", metavar="NAME", show_default=True, help="The action.")
@click.option(
    "--distro",
    default="jazzy",
    metavar="NAME",
    show_default=True,
    help="Distribution of ROS 2, which decides the fields of a result: humble, iron, jazzy, kilted or rolling.",
)
@click.option(
    "--choice",
    default="knee",
    metavar="NAME",
    show_default=True,
    help="Trajectory for an empty planner_id: knee, or a criterion, such as 'fewest turns', for its least value.",
)
@click.option("--frame-id", default="map", metavar="NAME", show_default=True, help="Frame of goals and paths.")
@click.option(
    "--pose-topic", default="/amcl_pose", metavar="NAME", show_default=True, help="Topic of the robot's pose."
)
@click.option(
    "--pose-type",
    default="geometry_msgs/msg/PoseWithCovarianceStamped",
    metavar="TYPE",
    show_default=True,
    help="Type of these messages; also geometry_msgs/msg/PoseStamped or nav_msgs/msg/Odometry.",
)
@click.option(
    "--options-topic",
    default="/hpop/options",
    metavar="NAME",
    show_default=True,
    help="Topic for the front of each plan, as JSON.",
)
@imports_option
@user_errors
def ros(
    scenario: Path,
    url: str,
    action: str,
    distro: str,
    choice: str,
    frame_id: str,
    pose_topic: str,
    pose_type: str,
    options_topic: str,
    imports: tuple[str, ...],
) -> None:
    """Offer the planner of a scenario to ROS 2 as an action.

    Connects to rosbridge and offers ComputePathToPose until Ctrl-C. The SCENARIO gives world, robot, criteria and
    planner; each ROS goal gives start and goal. The scenario itself is planned first, so that code is compiled and
    errors are reported before a robot waits for a path.
    """
    cli.user_code.register(imports)
    known = hpop.ros.Interface(action, distro, frame_id, pose_topic, pose_type, options_topic, choice)
    hpop.ros.bridge.checked_url(url)
    loaded = hpop.scenario.load_scenario(scenario)
    planning = hpop.ros.GoalPlanner(loaded.problem, loaded.planners, known)
    with progress_bar() as progress:
        front = planning.rehearsed(progress)
    if Status.INTERRUPTED in front.status:  # Ctrl-C before the action was offered
        raise KeyboardInterrupt
    echo(f"planned {scenario}: {len(front):,} trajectories, {front.status}")
    server = hpop.ros.PathServer(planning, say=echo)
    try:
        with suppress(KeyboardInterrupt):
            hpop.ros.Bridge(url, server, say=echo).run()
    except ImportError as error:
        raise OutputError(str(error)) from None
    finally:
        server.close()
    echo(f"the action {action} is no longer offered")
