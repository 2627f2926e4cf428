"""Commands ``hpop ros``: the planner of a scenario, and a follower of its plans, for a robot with ROS 2."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import hpop
from hpop import cli
from hpop.cli.terminal import Commands, echo, imports_option, user_errors
from hpop.errors import OutputError
from hpop.runtime.limits import Status, progress_bar

if TYPE_CHECKING:
    from hpop.ros import GoalPlanner
    from hpop.ros.protocol import MessageServer

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

HELP = {"--help", "-h"}


class WithDefault(Commands):
    """Group of commands of which ``plan`` needs no name: ``hpop ros SCENARIO`` is ``hpop ros plan SCENARIO``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in HELP:
            args = ["plan", *args]
        return super().parse_args(ctx, args)


@click.group(cls=WithDefault)
def ros() -> None:
    """Serve a robot with ROS 2 through rosbridge: plan its goals, or drive it.

    `hpop ros SCENARIO` is short for `hpop ros plan SCENARIO`.
    """


@ros.command("plan")
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
def plan(
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
    _rehearse(planning, scenario)
    _serve(url, hpop.ros.PathServer(planning, say=echo))
    echo(f"the action {action} is no longer offered")


TOPICS = {
    "cmd": "Topic of velocity commands.",
    "pose": "Topic of the robot's pose in the frame of the map, instead of tf.",
    "map": "Topic of the map; '' for none.",
    "people": "Topic of people; '' for none.",
    "mask": "Topic of a costmap filter's mask: areas to keep out of, or speed limits.",
    "info": "Topic of the filter's CostmapFilterInfo; without it, cells of 100 are closed.",
}
TYPES = {
    "cmd": "geometry_msgs/msg/Twist or geometry_msgs/msg/TwistStamped.",
    "pose": "geometry_msgs/msg/PoseWithCovarianceStamped, geometry_msgs/msg/PoseStamped or nav_msgs/msg/Odometry.",
    "people": "people_msgs/msg/People, or geometry_msgs/msg/PoseArray, whose indices are ids.",
}
NUMBERS = {
    "late": ("S", "Age from which a pose is too old to drive by."),
    "off": ("M", "Distance from the plan from which the robot stops and plans again."),
    "near": ("M", "Gap to people below which it stops."),
    "within": ("M", "Distance at which a pose on the way counts as visited."),
    "delay": ("S", "Time after which a command takes effect on the robot."),
    "offers": ("S", "Time between options that are published while the robot drives; 0 for none. [0]"),
    "patience": ("S", "Time to wait for a way before a goal is aborted."),
}


FRAMES = {
    "frame-id": "Frame of the map and of goals. [map]",
    "base-frame": "Frame of the robot, whose pose tf tells. [base_link]",
}


def robot_options(command: Any) -> Any:
    """Add the options of frames, topics and their types to a command; defaults are those of the library."""
    for name, words in reversed(TYPES.items()):
        command = click.option(f"--{name}-type", metavar="TYPE", help=words)(command)
    for name, words in reversed(TOPICS.items()):
        command = click.option(f"--{name}-topic", metavar="NAME", help=words)(command)
    for name, words in reversed(FRAMES.items()):
        command = click.option(f"--{name}", metavar="NAME", help=words)(command)
    return command


def limit_options(command: Any) -> Any:
    """Add the options of a follower's limits to a command; defaults are those of the library."""
    for name, (unit, words) in reversed(NUMBERS.items()):
        command = click.option(f"--{name}", type=float, metavar=unit, help=words)(command)
    return command


@ros.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--url", required=True, metavar="URL", help="Websocket of rosbridge, such as ws://localhost:9090.")
@click.option("--prefix", metavar="NAME", help="Before the names of actions and of hpop's own topics. [/hpop]")
@click.option("--distro", "distribution", metavar="NAME", help="humble, iron, jazzy, kilted or rolling. [jazzy]")
@click.option(
    "--choice", metavar="NAME", help="Trajectory to take: knee, or a criterion, such as 'fewest turns'. [knee]"
)
@click.option("--asks", is_flag=True, help="After a stop, wait until an option is taken on the topic take.")
@click.option("--rate", type=float, metavar="HZ", help="Commands a second. [20]")
@click.option("--sim-time", is_flag=True, help="Take the time from the topic /clock, as nodes with use_sim_time do.")
@robot_options
@limit_options
@imports_option
@user_errors
def follow(scenario: Path, url: str, imports: tuple[str, ...], asks: bool, sim_time: bool, **given: Any) -> None:
    """Drive a robot to goals of Nav2's navigation actions.

    Connects to rosbridge and offers NavigateToPose and NavigateThroughPoses until Ctrl-C: each goal is planned from
    where the robot is, and driven by velocity commands. The SCENARIO gives world, robot, criteria and planner. The
    robot stops when its pose is lost, something is in the way, or it is told to; then it plans again. Stop other
    controllers of the robot before: hpop sends commands while it has a goal.
    """
    cli.user_code.register(imports)
    given = {name: value for name, value in given.items() if value is not None}
    settings = hpop.ros.FollowSettings(
        asks=asks, **{name: given.pop(name) for name in (*NUMBERS, "choice") if name in given}
    )
    known = hpop.ros.FollowInterface(**given)
    hpop.ros.bridge.checked_url(url)
    loaded = hpop.scenario.load_scenario(scenario)
    interface = hpop.ros.Interface(frame_id=known.frame_id, choice=settings.choice)
    planner = hpop.ros.FollowPlanner(loaded.problem, loaded.planners, interface, near=settings.near + 0.05)
    _rehearse(planner, scenario)
    clock = hpop.ros.SimulatedClock() if sim_time else None
    _serve(url, hpop.ros.FollowServer(planner, settings, known, say=echo, clock=clock))
    echo("goals are no longer driven")


@ros.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--url", required=True, metavar="URL", help="Websocket of rosbridge, such as ws://localhost:9090.")
@click.option("--action", default="", metavar="NAME", help="Action of the controller. [the usual one of its type]")
@user_errors
def send(file: Path, url: str, action: str) -> None:
    """Send an arm's trajectory to its controller or to MoveIt, and wait for the result.

    FILE is a goal that `hpop export --body joints` wrote: NAME.follow.yaml for FollowJointTrajectory, NAME.moveit.yaml
    for ExecuteTrajectory. Ctrl-C cancels the goal. The arm must stand at the start of the trajectory.
    """
    from hpop.ros.sending import ArmGoal, GoalSender

    ends: list[str] = []

    def ended(why: str) -> None:
        ends.append(why)
        bridge.stop()

    sender = GoalSender(ArmGoal.from_file(file, action), ended, say=echo)
    bridge = hpop.ros.Bridge(url, sender, say=echo)
    bridge.run()
    if ends[0]:
        raise OutputError(ends[0])
    echo("the goal was reached")


def _rehearse(planning: GoalPlanner, scenario: Path) -> None:
    """Plan the scenario, so that code is compiled and errors are reported before a robot waits."""
    with progress_bar() as progress:
        front = planning.rehearsed(progress)
    if Status.INTERRUPTED in front.status:  # Ctrl-C before anything was offered
        raise KeyboardInterrupt
    echo(f"planned {scenario}: {len(front):,} trajectories, {front.status}")


def _serve(url: str, server: MessageServer) -> None:
    """Connect a server to rosbridge until Ctrl-C."""
    try:
        with suppress(KeyboardInterrupt):
            hpop.ros.Bridge(url, server, say=echo).run()
    except ImportError as error:
        raise OutputError(str(error)) from None
    finally:
        server.close()
