"""Command ``hpop live``: a page on which a viewer chooses where the robot goes, and drives."""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hpop import cli
from hpop.base.text import counted
from hpop.cli.robots import robot_options
from hpop.cli.terminal import echo, imports_option, user_errors
from hpop.errors import OptionError

if TYPE_CHECKING:
    from hpop.live.server import LiveServer
    from hpop.live.simulator import LiveRobot
    from hpop.problems.problem import Problem
    from hpop.simulation import Pedestrians

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

PORT = 8020


@click.command()
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--replay", is_flag=True, help="SCENARIO is the record of a session: show that session again.")
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, metavar="N", help=f"Port to serve on. [{PORT}]")
@click.option("--network", is_flag=True, help="Serve other machines in the network too, over https: needs hpop[serve].")
@click.option(
    "--token",
    envvar="HPOP_LIVE_TOKEN",
    metavar="TEXT",
    help="Secret part of the addresses, to keep them over a restart; also from HPOP_LIVE_TOKEN. [random]",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="Folder of the record. [out/SCENARIO]")
@click.option(
    "--delay",
    type=click.FloatRange(0, 1),
    default=0.0,
    metavar="S",
    help="Time after which a command takes effect, s. [0]",
)
@click.option("--slip", type=click.FloatRange(0, 0.5), default=0.0, metavar="SHARE", help="Slip of the wheels. [0]")
@click.option("--noise", type=click.FloatRange(0, 1), default=0.0, metavar="M", help="Noise of the position, m. [0]")
@click.option(
    "--crowd",
    type=click.IntRange(0, 1000),
    default=0,
    metavar="N",
    help="People who walk about and avoid the robot, in place of those of the scenario: needs hpop[crowd]. [0]",
)
@click.option(
    "--video",
    metavar="URL",
    default="",
    help="MJPEG stream of the robot's camera, to show as the view; or whep+URL, an address of WHEP (WebRTC).",
)
@click.option(
    "--robot", metavar="URL", help="Drive a robot through rosbridge, such as ws://localhost:9090. [a simulated robot]"
)
@robot_options
@imports_option
@user_errors
def live(
    scenario: Path,
    replay: bool = False,
    port: int = PORT,
    network: bool = False,
    token: str | None = None,
    out: Path | None = None,
    imports: Sequence[str] = (),
    video: str = "",
    **robot: Any,
) -> None:
    """Serve a live session: choose a destination, be offered ways, drive.

    SCENARIO is a YAML file; a simulated robot begins at its start. One viewer drives, others watch. Each event is
    recorded at once. Runs until Ctrl-C.

    With --robot, a real one is driven by velocity commands. Stop its other controllers before. The options of topics,
    types and frames are for such a robot.
    """
    serving = cli.serving
    here = serving.own_address() if network else serving.LOCAL
    certificate = serving.certificate_for(here) if network else None
    options: dict[str, Any] = {
        "port": port,
        "host": serving.EVERYWHERE if network else serving.LOCAL,
        "names": [here],
        "secured": None if certificate is None else serving.context_of(certificate),
        **_tokens_of(token),
    }
    if replay:
        server = replay_of(scenario, **options)
    else:
        server = server_of(scenario, out or Path("out", scenario.stem), imports, robot, video=video, **options)
    with server:
        if not replay:
            echo(f"drive: {server.address(here)}")
        echo(f"watch: {server.address(here, drives=False)}")
        if certificate is not None:
            echo(f"the browser warns of the certificate, whose SHA-256 fingerprint is {certificate.fingerprint}")
        if (record := server.session.record_path) is not None:
            echo(f"record: {record}")
        server.serve_forever()


TOKEN = re.compile(r"[A-Za-z0-9_-]{12,100}")


def _tokens_of(token: str | None) -> dict[str, str]:
    """Return the tokens "driving" and "watching"; that for driving cannot be computed from that for watching.

    Without a token, return {}.
    """
    if token is None:
        return {}
    if not TOKEN.fullmatch(token):
        wrong = len(re.sub("[A-Za-z0-9_-]", "", token))
        raise OptionError(
            f"--token must have 12 to 100 letters (a to z, A to Z), digits, - and _, got "
            f"{counted(len(token), 'character')}{f', {wrong} of them not allowed' * bool(wrong)}; choose a random one"
        )
    return {"driving": token, "watching": hashlib.sha256(f"watch {token}".encode()).hexdigest()[:16]}


def server_of(
    scenario: Path,
    out: Path,
    imports: Sequence[str] = (),
    robot: Mapping[str, Any] = {},  # not changed
    *,
    name: str = "",
    video: str = "",
    **options: Any,
) -> LiveServer:
    """Return the server of a live session, and create its record: a new file in the folder ``out``.

    robot    options of :class:`hpop.live.simulator.SimulatorOptions`, or ``robot``, the address of rosbridge, and
             fields of :class:`hpop.ros.FollowInterface`
    video    address of the robot's camera (:func:`hpop.live.scene.video_origin`)
    name     of the record; default: one from the present time
    options  arguments of :class:`.LiveServer`
    """
    from hpop.live.process import PlannerProcess
    from hpop.live.record import Record
    from hpop.live.scene import scene_of, video_origin
    from hpop.live.server import LiveServer
    from hpop.live.session import LiveSession
    from hpop.scenario import load_scenario

    cli.user_code.register(imports)
    problem = load_scenario(scenario).problem
    video_origin(video)
    driven, people, about = _robot_of(problem, robot)
    scene = scene_of(problem, scenario.stem)
    name = name or time.strftime("live-%Y%m%dT%H%M%SZ.jsonl", time.gmtime())
    record = Record(out / name, {"scenario": str(scenario), "simulator": about, "scene": scene})
    scene["video"] = video  # not recorded: the address may be a secret
    planner, told = partial(PlannerProcess, scenario, imports), problem.world.content.people
    radii = () if robot.get("robot") or robot.get("crowd") else tuple(person.radius for person in told)
    session = LiveSession(problem, scene, record, planner, driven, people, radii)
    return LiveServer(session, **options)


def _robot_of(problem: Problem, options: Mapping[str, Any]) -> tuple[LiveRobot, Pedestrians, dict[str, Any]]:
    """Return the robot of a session, the people around it, and its options for the record."""
    from hpop.live.bridged import RosRobot, SeenPeople
    from hpop.live.simulator import LiveRobot, SimulatorOptions, people_of
    from hpop.ros import FollowInterface

    given = {key: value for key, value in options.items() if value is not None}
    known, url = {field.name for field in fields(SimulatorOptions)}, given.pop("robot", None)
    simulated = {key: given.pop(key) for key in known & given.keys()}
    if url is None:
        if given:
            option = f"--{next(iter(given)).replace('_', '-')}"
            raise OptionError(f"{option} is for a robot over rosbridge; give its address with --robot, or leave it out")
        made = SimulatorOptions(**simulated)
        values = dict(zip(problem.model.space.names, problem.start, strict=True))
        pose = (values["x"], values["y"], values["yaw"])
        return LiveRobot.simulated(problem.model, pose, made), people_of(problem, pose, made), vars(made)
    delay = simulated.pop("delay", 0.0)
    if wrong := next((key for key, value in simulated.items() if value), None):
        raise OptionError(f"--{wrong} is for the simulated robot; leave it out with --robot")
    robot = RosRobot(problem, url, FollowInterface(**given), delay=delay, say=echo)
    return robot, SeenPeople(robot.base), {"robot": url, "delay": delay, **given}


def replay_of(record: Path, **options: Any) -> LiveServer:
    """Return the server that shows a recorded session again."""
    from hpop.live.record import read_record
    from hpop.live.server import LiveServer
    from hpop.live.viewer import Replay

    return LiveServer(Replay(read_record(record)), **options)
