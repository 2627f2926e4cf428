"""A simulated controller of an arm in rclpy, run by tests in the Python of ROS; prints JSON about its goals.

It does what ros2_control's joint_trajectory_controller does: it interpolates by positions and velocities, aborts a goal
that does not begin at its state, and stops where it is when it is canceled.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

ACTION, TOLERANCE = "/joint_trajectory_controller/follow_joint_trajectory", 0.01
most, state = int(sys.argv[1]), [float(value) for value in sys.argv[2:]]
goals: list[dict[str, Any]] = []
over = threading.Event()
rclpy.init()
node = Node("arm")


def seconds(point: Any) -> float:
    return point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec


def between(a: Any, b: Any, t: float) -> list[float]:
    """Return the positions at a time between two points, by cubic polynomials."""
    lasts = seconds(b) - seconds(a)
    u = (t - seconds(a)) / lasts
    rows = zip(a.positions, a.velocities, b.positions, b.velocities, strict=True)
    return [
        (1 + 2 * u) * (1 - u) ** 2 * p
        + u * (1 - u) ** 2 * lasts * v
        + u**2 * (3 - 2 * u) * q
        + u**2 * (u - 1) * lasts * w
        for p, v, q, w in rows
    ]


def run(handle: Any) -> Any:
    told, result = handle.request.trajectory, FollowJointTrajectory.Result()
    points, begin, fastest, last = list(told.points), time.monotonic(), 0.0, 0.0
    times = [seconds(point) for point in points]
    said = {"joints": list(told.joint_names), "points": len(points), "rising": times == sorted(set(times))}
    said |= {"ends at rest": not any([*points[0].velocities, *points[-1].velocities]), "duration": times[-1]}
    goals.append(said)
    off = max(abs(a - b) for a, b in zip(points[0].positions, state, strict=True))
    if off > TOLERANCE:
        result.error_code, result.error_string = result.PATH_TOLERANCE_VIOLATED, f"it begins {off:.2f} rad off"
        handle.abort()
    else:
        while (now := time.monotonic() - begin) < times[-1] and not handle.is_cancel_requested:
            i = max(k for k, t in enumerate(times) if t <= now)
            place = between(points[i], points[i + 1], now)
            if i:  # the first command also makes up for the tolerance
                fastest = max(fastest, *(abs(p - q) / (now - last) for p, q in zip(place, state, strict=True)))
            state[:], last = place, now
            feedback = FollowJointTrajectory.Feedback(joint_names=told.joint_names)
            feedback.actual.positions = list(state)
            handle.publish_feedback(feedback)
            time.sleep(0.01)
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            state[:] = list(points[-1].positions)
            handle.succeed()
    planned = max(abs(v) for point in points for v in point.velocities)
    said |= {"state": list(state), "fastest": fastest, "planned": planned}
    if len(goals) == most:
        threading.Timer(0.5, over.set).start()  # the result is sent first
    return result


server = ActionServer(
    node,
    FollowJointTrajectory,
    ACTION,
    run,
    cancel_callback=lambda goal: CancelResponse.ACCEPT,
    callback_group=ReentrantCallbackGroup(),
)
executor = MultiThreadedExecutor(4)
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
print("ready", file=sys.stderr, flush=True)
over.wait(120.0)
json.dump(goals, sys.stdout)
sys.stdout.flush()
rclpy.shutdown()
