"""A simulated robot and a client of Nav2's actions in rclpy, run by tests in the Python of ROS; prints JSON."""

from __future__ import annotations

import json
import math
import sys
import time
from types import SimpleNamespace
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist
from nav2_msgs.action import ComputePathToPose, NavigateThroughPoses, NavigateToPose
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

robot = SimpleNamespace(x=1.0, y=2.0, yaw=0.0, v=0.0, w=0.0, last=0.0, moment=time.monotonic(), passed=[], blind=False)
rclpy.init()
node = Node("robot")
tf = node.create_publisher(TFMessage, "/tf", 10)
maps = node.create_publisher(OccupancyGrid, "/map", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
heard: dict[str, list[Any]] = {"path": [], "options": [], "state": []}


def obey(message: Twist) -> None:
    robot.v, robot.w, robot.last = message.linear.x, message.angular.z, time.monotonic()


def live() -> None:
    now = time.monotonic()
    seconds, robot.moment = now - robot.moment, now
    if now - robot.last > 0.5:
        robot.v = robot.w = 0.0
    middle = robot.yaw + 0.5 * seconds * robot.w
    robot.x += seconds * robot.v * math.cos(middle)
    robot.y += seconds * robot.v * math.sin(middle)
    robot.yaw += seconds * robot.w
    robot.passed.append((robot.x, robot.y))
    if robot.blind:
        return
    link = TransformStamped()
    link.header.stamp = node.get_clock().now().to_msg()
    link.header.frame_id, link.child_frame_id = "map", "base_link"
    link.transform.translation.x, link.transform.translation.y = robot.x, robot.y
    link.transform.rotation.z, link.transform.rotation.w = math.sin(0.5 * robot.yaw), math.cos(0.5 * robot.yaw)
    tf.publish(TFMessage(transforms=[link]))


def publish_map(boxes: list[tuple[int, int, int, int]]) -> None:
    grid = OccupancyGrid()
    grid.header.frame_id = "map"
    grid.info.resolution, grid.info.width, grid.info.height = 0.1, 60, 40
    grid.info.origin.orientation.w = 1.0
    inside = {(x, y) for left, low, right, high in boxes for x in range(left, right) for y in range(low, high)}
    grid.data = [100 if (x, y) in inside else 0 for y in range(40) for x in range(60)]
    maps.publish(grid)


def pose(x: float, y: float) -> PoseStamped:
    made = PoseStamped()
    made.header.frame_id, made.pose.position.x, made.pose.position.y = "map", x, y
    made.pose.orientation.w = 1.0
    return made


def until(what: Any, seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.02)
        if what():
            return True
    return False


def send(client: Any, goal: Any) -> tuple[Any, Any, list[Any]]:
    fed_back: list[Any] = []
    accepted = client.send_goal_async(goal, lambda message: fed_back.append(message.feedback))
    assert until(accepted.done)
    return accepted.result(), accepted.result().get_result_async(), fed_back


node.create_subscription(Twist, "/cmd_vel", obey, 10)
node.create_timer(0.02, live)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(Path, "/hpop/path", heard["path"].append, latched)
node.create_subscription(String, "/hpop/options", heard["options"].append, latched)
node.create_subscription(String, "/hpop/state", heard["state"].append, 10)
to_pose = ActionClient(node, NavigateToPose, "/hpop/navigate_to_pose")
through = ActionClient(node, NavigateThroughPoses, "/hpop/navigate_through_poses")
plan = ActionClient(node, ComputePathToPose, "/hpop/compute_path_to_pose")
said: dict[str, Any] = {}


def drives() -> None:
    """Drive through poses, lose tf, meet an obstacle; then cancel a goal, and send one in another frame."""
    assert to_pose.wait_for_server(timeout_sec=300.0), "the node offers no action"
    publish_map([])
    _, ends, fed_back = send(through, NavigateThroughPoses.Goal(poses=[pose(2.0, 2.0), pose(5.0, 2.0)]))
    assert until(lambda: robot.v > 0.7), "it never drove"
    robot.blind = True
    said["stopped without tf"] = until(lambda: robot.v == 0.0, 5.0)
    place = robot.x
    said["stood"] = not until(lambda: robot.x != place, 1.0)
    said["why"] = json.loads(heard["state"][-1].data)["why"]
    publish_map([(40, 10, 42, 31)])
    robot.blind = False
    said["ended"] = until(ends.done)
    said["status"], said["error_msg"] = ends.result().status, ends.result().result.error_msg
    said["feedback"], said["poses remaining"] = len(fed_back), fed_back[-1].number_of_poses_remaining
    said["paths"], said["passed"] = len(heard["path"]), robot.passed
    said["options"] = json.loads(heard["options"][-1].data)["names"]

    handle, ends, _ = send(to_pose, NavigateToPose.Goal(pose=pose(1.0, 1.0)))
    assert until(lambda: abs(robot.v) + abs(robot.w) > 0.2), "it never drove back"
    handle.cancel_goal_async()
    said["canceled"] = until(ends.done) and ends.result().status
    said["stands after cancel"] = until(lambda: robot.v == robot.w == 0.0, 5.0)
    wrong = pose(1.0, 1.0)
    wrong.header.frame_id = "odom"
    _, ends, _ = send(to_pose, NavigateToPose.Goal(pose=wrong))
    said["wrong frame"] = until(ends.done) and (ends.result().status, ends.result().result.error_msg)


def plans() -> None:
    """Plan from a pose, then from the pose that tf tells, and with a planner_id that there is not."""
    assert plan.wait_for_server(timeout_sec=300.0), "the node offers no action"
    until(lambda: False, 1.0)
    start = {"start": pose(1.0, 2.0), "use_start": True}
    for name, more in (("knee", start), ("", {}), ("GridBased", start)):
        _, ends, _ = send(plan, ComputePathToPose.Goal(goal=pose(5.0, 2.0), planner_id=name, **more))
        assert until(ends.done)
        made = ends.result().result
        ends_at = [(one.pose.position.x, one.pose.position.y) for one in (*made.path.poses[:1], *made.path.poses[-1:])]
        said[name] = (ends.result().status, made.error_code, made.error_msg, ends_at)
    said["options"] = until(lambda: heard["options"]) and json.loads(heard["options"][-1].data)["names"]


def obeys() -> None:
    """Obey commands until the robot stands at (5, 2)."""
    publish_map([])
    said["reached"] = until(lambda: math.dist((robot.x, robot.y), (5.0, 2.0)) < 0.1 and robot.v == robot.w == 0.0)
    said["last"] = (robot.x, robot.y)


{"drives": drives, "plans": plans, "obeys": obeys}[sys.argv[1]]()
json.dump(said, sys.stdout)
rclpy.shutdown()
