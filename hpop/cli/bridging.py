"""``hpop ros``: the planner of a scenario as an action server of ROS 2, over rosbridge."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import click

from hpop.cli.command import imports_option, user_errors
from hpop.cli.terminal import echo


@click.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--url", required=True, metavar="URL", help="Websocket of rosbridge, such as ws://localhost:9090.")
@click.option("--action", default="/hpop/compute_path_to_pose", metavar="NAME", show_default=True, help="The action.")
@click.option(
    "--distro",
    default="jazzy",
    metavar="NAME",
    show_default=True,
    help="Distribution of ROS 2, which says the fields of a result: humble, iron, jazzy, kilted or rolling.",
)
@click.option(
    "--choice",
    default="knee",
    metavar="NAME",
    show_default=True,
    help="What an empty planner_id means: knee, or a criterion, such as 'fewest turns', for the least in it.",
)
@click.option("--frame-id", default="map", metavar="NAME", show_default=True, help="Frame of goals and paths.")
@click.option(
    "--pose-topic", default="/amcl_pose", metavar="NAME", show_default=True, help="Where the robot's pose is told."
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
    help="Where the front of each plan is told, as JSON.",
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
    """Offer the planner of a SCENARIO to ROS 2, as the action ComputePathToPose over rosbridge, until Ctrl-C.

    World, robot, criteria and planner are the scenario's; start and goal come with each goal. The scenario's own
    question is planned first: what that takes is compiled then, and its mistakes are told before a robot waits.
    """
    from hpop.cli import user_code
    from hpop.errors import OutputError
    from hpop.ros.bridge import Bridge, checked_url
    from hpop.ros.interface import Interface
    from hpop.ros.path_server import PathServer
    from hpop.ros.planning import Planning
    from hpop.runtime.status import Status, progress_bar
    from hpop.scenario import load_scenario

    user_code.register(imports)
    known = Interface(action, distro, frame_id, pose_topic, pose_type, options_topic, choice)
    checked_url(url)
    loaded = load_scenario(scenario)
    planning = Planning(loaded.problem, loaded.planners, known)
    with progress_bar() as progress:
        front = planning.rehearsed(progress)
    if Status.INTERRUPTED in front.status:  # nobody waits for a goal yet
        raise KeyboardInterrupt
    echo(f"planned {scenario}: {len(front):,} trajectories, {front.status}")
    server = PathServer(planning, say=echo)
    try:
        with suppress(KeyboardInterrupt):
            Bridge(url, server, say=echo).run()
    except ImportError as error:
        raise OutputError(str(error)) from None
    finally:
        server.close()
    echo("no longer offered")
