"""Goals of arms through a bridge: what was exported arrives with ROS's types, and the end is said as it is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any

import numpy as np
import pytest

from hpop.base.registry import formats
from hpop.errors import OptionError
from hpop.export import write
from hpop.ros import Bridge
from hpop.ros.sending import ArmGoal, GoalSender
from tests.export.given import robots
from tests.ros.bridge import ABORTED, PATIENCE, SUCCEEDED, FakeBridge, fake_bridge

ARM = robots()["serial arm"]
FOLLOW, MOVEIT = "follow-joint-trajectory", "moveit"


@pytest.fixture
def bridge() -> Iterator[FakeBridge]:
    with fake_bridge() as made:
        yield made


def goal_of(folder: Path, name: str) -> ArmGoal:
    return ArmGoal.from_file(write(ARM, folder / f"any{formats[name].suffix}", body="joints"))


def ended(bridge: FakeBridge, goal: ArmGoal, answers: Callable[[Any, str], None]) -> str:
    """Send a goal, let a controller answer it with its connection and id, and return how the goal ended."""
    ends = Queue[str]()

    def over(why: str) -> None:
        ends.put(why)
        client.stop()

    client = Bridge(bridge.url, GoalSender(goal, over, say=lambda line: None), say=lambda line: None, delays=(60, 60))
    thread = Thread(target=client.run)
    thread.start()
    (_, message), *_ = bridge.until(lambda: bridge.sent)
    answers(bridge.clients[0].connection, message["id"])
    why = ends.get(timeout=PATIENCE)
    thread.join()
    return why


def answer(status: int, values: Any, *, result: bool = True) -> Callable[[Any, str], None]:
    def send(connection: Any, goal: str) -> None:
        message = {"op": "action_result", "id": goal, "action": "any", "values": values, "status": status}
        connection.send(json.dumps({**message, "result": result}))

    return send


@pytest.mark.parametrize("name", [FOLLOW, MOVEIT])
def test_the_exported_motion_arrives_with_the_types_of_ros(bridge: FakeBridge, tmp_path: Path, name: str) -> None:
    assert ended(bridge, goal_of(tmp_path, name), answer(SUCCEEDED, {"error_code": 0})) == ""
    ((op, message),) = bridge.sent
    assert (op, message["action"], message["action_type"]) == (
        "send_action_goal",
        *{
            FOLLOW: (
                "/joint_trajectory_controller/follow_joint_trajectory",
                "control_msgs/action/FollowJointTrajectory",
            ),
            MOVEIT: ("/execute_trajectory", "moveit_msgs/action/ExecuteTrajectory"),
        }[name],
    )
    told = message["args"].trajectory
    points = getattr(told, "joint_trajectory", told).points
    ends = [points[0].positions, points[-1].positions]
    np.testing.assert_allclose(ends, [[0.1] * 6, [0.2] * 6], atol=1e-9)
    assert bridge.log == []


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        (answer(ABORTED, {"error_code": -5, "error_string": "tolerance violated"}), "aborted: tolerance violated"),
        (answer(SUCCEEDED, {"error_code": {"val": -4}}), "ended with the error code -4"),
        (answer(ABORTED, "no such action", result=False), "the goal failed: no such action"),
        (lambda connection, goal: connection.close(), "the connection was lost"),
    ],
)
def test_a_goal_that_was_not_reached_says_why(
    bridge: FakeBridge, tmp_path: Path, answers: Callable[[Any, str], None], words: str
) -> None:
    assert words in ended(bridge, goal_of(tmp_path, FOLLOW), answers)
    assert len(bridge.sent) == 1  # it is not sent again


def test_a_goal_that_is_given_up_is_canceled(bridge: FakeBridge, tmp_path: Path) -> None:
    client = Bridge(bridge.url, GoalSender(goal_of(tmp_path, FOLLOW), lambda why: None, say=print), say=print)
    thread = Thread(target=client.run)
    thread.start()
    bridge.until(lambda: bridge.sent)
    client.stop()
    thread.join()
    bridge.until(lambda: len(bridge.sent) == 2)
    assert bridge.sent[1] == ("cancel_action_goal", {k: bridge.sent[0][1][k] for k in ("id", "action")})


def test_other_files_are_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "a.follow.yaml").write_text("positions: []")
    for name, words in (("a.csv", "expected a file that ends in"), ("a.follow.yaml", "has no trajectory")):
        with pytest.raises(OptionError, match=words):
            ArmGoal.from_file(tmp_path / name)
    with pytest.raises(OptionError, match="cannot be read"):
        ArmGoal.from_file(tmp_path / "b.moveit.yaml")
    with pytest.raises(OptionError, match="action must be a name"):
        ArmGoal.from_file(tmp_path / "a.follow.yaml", "arm controller")
