"""The nodes for rclpy: they parse and use hpop as it is; with the Python of ROS they also run."""

from __future__ import annotations

import ast
import json
import os
import pkgutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
import shapely

from hpop.base.registry import formats
from hpop.export import write
from hpop.ros import GoalPlanner, Interface, PlanarPose
from tests.export.given import robots
from tests.live.conftest import Page, served

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples/ros2"
TREES = {path.name: ast.parse(path.read_text()) for path in FOLDER.glob("*.py")}
ROS = {"nav2_msgs", "rclpy", "std_msgs", "tf2_msgs", "ros_fields"}
NEEDED = "import rclpy, nav2_msgs.action, tf2_msgs.msg, hpop.planners.graph_planners"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
SCENARIO = """\
world: {ros_map: {path: hall.yaml}}
model: {differential_drive: {radius: 0.2}}
start: [1.0, 2.0, 0]
goal: [5.0, 2.0, any]
criteria: [turns, length]
planner: {lattice: {step: 0.5}}
"""
MAP = "image: hall.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def calls(node: str, name: str) -> list[ast.Call]:
    """Return the calls of a function or a method of this name in a node."""
    found = [each for each in ast.walk(TREES[node]) if isinstance(each, ast.Call)]
    return [one for one in found if getattr(one.func, "id", getattr(one.func, "attr", "")) == name]


@pytest.mark.parametrize("name", TREES)
def test_it_imports_what_hpop_has_and_what_ros_brings(name: str) -> None:
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names]
            for module in modules:
                package = module.partition(".")[0]
                assert package in ROS | {"hpop"} | set(sys.stdlib_module_names), module
                for each in node.names if package == "hpop" else []:
                    assert pkgutil.resolve_name(f"{module}.{each.name}") is not None


def test_the_planner_calls_hpop_as_it_can_be_called() -> None:
    (interface,), (answer,), (planning,) = (
        calls("hpop_planner.py", of) for of in ("Interface", "answer", "GoalPlanner")
    )
    assert {word.arg for word in interface.keywords} < {one.name for one in fields(Interface)}
    assert len(answer.args) == len(signature(GoalPlanner.answer).parameters) - 1
    assert len(planning.args) == len(signature(GoalPlanner).parameters)
    assert all(len(call.args) == len(PlanarPose._fields) for call in calls("hpop_planner.py", "PlanarPose"))


def ros_python(*more: str) -> tuple[str, dict[str, str]]:
    """Return the Python of ROS, which also has modules ``more``, and its environment; skip the test without one."""
    python = os.environ.get("HPOP_ROS_PYTHON")
    if not python:
        pytest.skip("HPOP_ROS_PYTHON names no Python with rclpy, nav2_msgs, tf2_msgs and what hpop needs")
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    own = {"PYTHONPATH": path, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": "87"}
    environment = os.environ | own
    there = subprocess.run(
        [python, "-c", ", ".join([NEEDED, *more])], env=environment, capture_output=True, text=True, check=False
    )
    if there.returncode:
        pytest.skip(f"HPOP_ROS_PYTHON lacks something: {there.stderr.splitlines()[-1]}")
    return python, environment


@contextmanager
def running(command: list[str], environment: dict[str, str], log: Path) -> Iterator[None]:
    """Run a program, and end it by Ctrl-C."""
    with log.open("w") as file, subprocess.Popen(command, env=environment, stdout=file, stderr=file) as program:
        try:
            yield
            program.send_signal(signal.SIGINT)
            assert program.wait(30) == 0
        finally:
            program.kill()


def scenario_in(folder: Path) -> Path:
    """Write an empty hall of 6 x 4 m, and return its scenario."""
    (folder / "hall.pgm").write_bytes(b"P5 60 40 255\n" + bytes([254]) * 2400)
    (folder / "hall.yaml").write_text(MAP)
    (folder / "scenario.yaml").write_text(SCENARIO)
    return folder / "scenario.yaml"


def robot_says(what: str, folder: Path) -> Any:
    """Return what a simulated robot in rclpy says about the programs that run."""
    python, environment = ros_python()
    command = [python, str(Path(__file__).with_name("rclpy_robot.py")), what]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    logs = "".join(log.read_text() for log in folder.glob("*.log"))
    assert not done.returncode, done.stderr + logs
    return json.loads(done.stdout)


def said(name: str, what: str, folder: Path) -> Any:
    """Return what the robot says about a node of hpop."""
    python, environment = ros_python()
    command = [python, str(FOLDER / name), "--ros-args", "-p", f"scenario:={scenario_in(folder)}"]
    with running(command, environment, folder / "node.log"):
        return robot_says(what, folder)


def check_drive(found: Any) -> None:
    """Check that it stopped without tf, drove round a new obstacle through two poses, and obeyed a cancellation."""
    assert (found["stopped without tf"], found["stood"]) == (True, True)
    assert found["why"].startswith("the pose of the robot is ")
    assert (found["ended"], found["status"], found["error_msg"]) == (True, SUCCEEDED, "")
    assert found["feedback"] > 10
    assert (found["poses remaining"], found["options"]) == (1, ["turns", "length"])
    assert found["paths"] >= 2  # more on a machine so busy that poses come late
    assert shapely.LineString(found["passed"]).distance(shapely.box(4.0, 1.0, 4.2, 3.1)) >= 0.2
    assert (found["canceled"], found["stands after cancel"]) == (CANCELED, True)
    assert found["wrong frame"] == [ABORTED, "poses of a goal must be in the frame map, got 'odom'"]


@pytest.mark.proof
def test_the_follower_drives_a_robot_in_rclpy(tmp_path: Path) -> None:
    check_drive(said("hpop_follower.py", "drives", tmp_path))


def check_plans(found: Any) -> None:
    assert found["knee"] == [SUCCEEDED, 0, "", [[1.0, 2.0], [5.0, 2.0]]]
    status, code, words, path = found["GridBased"]
    assert (status, code, path) == (ABORTED, 201, [])
    assert "planner_id must be one of knee" in words
    assert found["options"] == ["turns", "length"]


@pytest.mark.proof
def test_the_planner_plans_in_rclpy(tmp_path: Path) -> None:
    found = said("hpop_planner.py", "plans", tmp_path)
    check_plans(found)
    assert found[""] == found["knee"]  # by the pose that tf tells


ARM = robots()["serial arm"]


def exported(folder: Path) -> Path:
    """Write the goal of a short motion of an arm of six joints, and return its file."""
    return write(ARM, folder / f"motion{formats['follow-joint-trajectory'].suffix}", body="joints")


@contextmanager
def controller(folder: Path, goals: int) -> Iterator[Any]:
    """Run a simulated controller, whose arm stands at the start; yield a function that returns what it says."""
    python, environment = ros_python("control_msgs.action")
    command = [python, str(Path(__file__).with_name("rclpy_arm.py")), str(goals), *["0.1"] * 6]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as arm:
        try:
            assert arm.stderr is not None
            assert arm.stderr.readline() == "ready\n"
            yield lambda: json.loads(arm.communicate(timeout=60)[0])
        finally:
            arm.kill()


def check_arm(found: Any, said: list[tuple[int, str]]) -> None:
    """Check that the first goal was driven as exported, and the same goal was then refused with its reason."""
    first, again = found
    assert first["joints"] == list(ARM.model.joints)
    assert (first["rising"], first["ends at rest"]) == (True, True)
    assert first["duration"] == pytest.approx(ARM.execution().duration, abs=1e-6)
    assert first["state"] == pytest.approx([0.2] * 6)
    assert 0.0 < first["fastest"] <= 1.05 * first["planned"]  # positions and velocities fit each other
    assert again["state"] == first["state"]
    assert (said[0][0], said[1][0] != 0) == (0, True)
    assert "the goal was reached" in said[0][1]
    assert "the goal was aborted: it begins 0.10 rad off" in said[1][1]


def runs(command: list[str], environment: Mapping[str, str]) -> tuple[int, str]:
    """Run a command, and return its exit code and what it prints."""
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.proof
def test_the_sender_drives_an_arm_in_rclpy_and_says_why_not(tmp_path: Path) -> None:
    python, environment = ros_python("control_msgs.action")
    command = [python, str(FOLDER / "hpop_send.py"), str(exported(tmp_path))]
    with controller(tmp_path, 2) as goals:
        said = [runs(command, environment) for _ in range(2)]
        check_arm(goals(), said)


@pytest.mark.proof
def test_hpop_ros_send_drives_an_arm_through_the_real_rosbridge(tmp_path: Path) -> None:
    with rosbridge(tmp_path) as url, controller(tmp_path, 2) as goals:
        command = [sys.executable, "-m", "hpop", "ros", "send", str(exported(tmp_path)), "--url", url]
        said = [runs(command, os.environ | {"PYTHONPATH": str(ROOT)}) for _ in range(2)]
        check_arm(goals(), said)


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def rosbridge(folder: Path) -> Iterator[str]:
    """Run the real rosbridge, and yield its address once it listens."""
    python, environment = ros_python()
    script = os.environ.get("HPOP_ROSBRIDGE")
    if not script:
        pytest.skip("HPOP_ROSBRIDGE names no rosbridge_websocket of rosbridge_server")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    bridge = [python, script, "--ros-args", "-p", f"port:={port}", "-p", "address:=127.0.0.1"]
    with running(bridge, environment, folder / "bridge.log"):
        last = time.monotonic() + 60.0
        while not listens(port):
            assert time.monotonic() < last, (folder / "bridge.log").read_text()
            time.sleep(0.2)
        yield f"ws://127.0.0.1:{port}"


@pytest.mark.proof
@pytest.mark.parametrize(
    ("command", "what", "check"), [("plan", "plans", check_plans), ("follow", "drives", check_drive)]
)
def test_hpop_ros_serves_a_robot_through_the_real_rosbridge(command, what, check, tmp_path: Path) -> None:
    with rosbridge(tmp_path) as url:
        serve = [sys.executable, "-m", "hpop", "ros", command, str(scenario_in(tmp_path)), "--url", url]
        with running(serve, os.environ | {"PYTHONPATH": str(ROOT)}, tmp_path / "serve.log"):
            check(robot_says(what, tmp_path))


@pytest.mark.proof
def test_a_viewer_of_a_live_session_drives_a_robot_through_the_real_rosbridge(tmp_path: Path) -> None:
    scenario_in(tmp_path)
    text = SCENARIO.replace("path: hall.yaml", f"path: {tmp_path / 'hall.yaml'}")
    with rosbridge(tmp_path) as url, ThreadPoolExecutor(1) as pool, served(tmp_path, text, robot=url) as server:
        found = pool.submit(robot_says, "obeys", tmp_path)
        page = Page(server.address())
        page.until("note", lambda note: note["words"] == "the map is prepared")
        page.until("state", lambda state: state["braked"] == "" and abs(state["x"] - 1.0) < 0.01)
        page.say("destination", x=5.0, y=2.0)
        page.say("take", option=page.until("options")["cards"][0]["option"])
        page.until("arrived")
        assert found.result(60)["reached"]
        page.close()
