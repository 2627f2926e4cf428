"""`hpop ros`: the planner of a scenario over a bridge, until Ctrl-C; mistakes end in one message, and early."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from hpop.ros import plain, planar_pose, pose_message
from tests.ros.bridge import SUCCEEDED, FakeBridge, fake_bridge

Run = Callable[..., Result]

PRESSED = """\
from dataclasses import dataclass

from hpop.planners import planner


@planner("pressed")
@dataclass(frozen=True)
class Pressed:
    needs = frozenset()

    def solve(self, problem, progress=None):
        raise KeyboardInterrupt
"""


def test_it_plans_goals_until_ctrl_c(run: Run, room: Path) -> None:
    main = threading.main_thread().ident
    assert main is not None

    def ask(bridge: FakeBridge) -> Any:
        """Send a goal while the command runs in the main thread, which receives the signal."""
        try:
            poses = {"start": pose_message(0.5, 1.5, 0), "goal": pose_message(3.5, 1.5, 0)}
            goal = bridge.send_goal("/way", {**poses, "planner_id": "", "use_start": True})
            return bridge.ended(goal)
        finally:
            signal.pthread_kill(main, signal.SIGINT)

    with fake_bridge("iron") as bridge, ThreadPoolExecutor() as pool:
        asked = pool.submit(ask, bridge)
        options = ["--action", "/way", "--distro", "iron", "--choice", "fewest turns"]
        result = run("ros", room / "room.yaml", "--url", bridge.url, *options)
        goal = asked.result()
        assert bridge.log == []
        bridge.until(lambda: not bridge.clients)
    assert goal.status == SUCCEEDED
    assert planar_pose(plain(goal.result.path.poses[-1])) == pytest.approx((3.5, 1.5, 0, "map"))
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith(f"planned {room / 'room.yaml'}: ")
    assert lines[0].endswith(" trajectories, complete")
    assert lines[1] == f"connected to {bridge.url}: goals of /way are planned"
    assert lines[2].startswith("goal action_goal:/way:1: succeeded after 0.")
    assert "(least turns)" in lines[2] or "(knee)" in lines[2]
    assert lines[-1].endswith("is no longer offered")


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--url", "localhost:9090"], 10, "url must be the address of a bridge, such as ws://localhost:9090"),
        (["--url", "ws://a", "--distro", "jazy"], 10, "got 'jazy'. Did you mean 'jazzy'"),
        (["--url", "ws://a", "--action", "a b"], 10, "action must be a name of ROS"),
        (["--url", "ws://a", "--pose-type", "Pose"], 10, "pose_type must be one of geometry_msgs/msg/Pose"),
        (["--url", "ws://a", "--choice", "turnes"], 7, "choice must be one of knee, least turns"),
    ],
)
def test_a_mistake_ends_in_one_message(
    run: Run, room: Path, refused: Callable[..., None], options: list[str], code: int, said: str
) -> None:
    refused(run("ros", room / "room.yaml", *options), code, said)


def test_without_an_address_it_says_what_one_is(run: Run, room: Path) -> None:
    result = run("ros", room / "room.yaml")
    assert result.exit_code == 2
    assert "Missing option '--url'" in result.output


def test_without_the_extra_it_says_how_to_install_it(
    run: Run, room: Path, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "websockets.sync.client", None)
    refused(run("ros", room / "room.yaml", "--url", "ws://localhost:9090"), 12, "pip install 'hpop[ros]'")


def test_a_start_that_is_blocked_is_told_at_once(
    run: Run, room: Path, write: Callable[..., None], refused: Callable[..., None]
) -> None:
    write(room, ("start: [0.5, 0.5, 0]", "start: [2.0, 0.5, 0]"))
    refused(run("ros", room / "room.yaml", "--url", "ws://localhost:9090"), 5, "start")


@pytest.mark.usefixtures("registered_as_before")
def test_ctrl_c_while_the_scenario_is_planned_ends_it(run: Run, room: Path, write: Callable[..., None]) -> None:
    (room / "pressed.py").write_text(PRESSED)
    write(room, ("lattice: {step: 0.5}", "- lattice: {step: 0.5}\n  - pressed: {}"))
    result = run("ros", room / "room.yaml", "--url", "ws://localhost:9", "--import", room / "pressed.py")
    assert (result.exit_code, result.stderr) == (130, "error: interrupted\n")


def test_follow_offers_navigation_until_ctrl_c(run: Run, room: Path) -> None:
    def wait(bridge: FakeBridge) -> set[str]:
        """Press Ctrl-C in this thread: the main thread learns of it only when it wakes, as if just before a wait."""
        try:
            return set(bridge.offered("/go/navigate_through_poses").actions)
        finally:
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)

    with fake_bridge() as bridge, ThreadPoolExecutor() as pool:
        offered = pool.submit(wait, bridge)
        result = run("ros", "follow", room / "room.yaml", "--url", bridge.url, "--prefix", "/go", "--people-topic", "")
        assert offered.result() == {"/go/navigate_to_pose", "/go/navigate_through_poses"}
        bridge.until(lambda: not bridge.clients)
        assert bridge.log == []
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[-1] == "goals are no longer driven"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rate", "1"], "rate must be a number of commands a second"),
        (["--late", "-1"], "late must be a number of at least 0"),
        (["--people-type", "Person"], "people_type must be one of"),
        (["--cmd-topic", ""], "cmd_topic must be a name of ROS"),
        (["--choice", ""], "choice must be a name such as knee"),
    ],
)
def test_follow_refuses_what_makes_no_sense_at_once(run: Run, room: Path, options: list[str], said: str) -> None:
    result = run("ros", "follow", room / "room.yaml", "--url", "ws://localhost:9", *options)
    assert result.exit_code == 10
    assert said in result.output
