"""hpop as a node of ROS 2: the action ComputePathToPose, and the front of each plan on a topic.

It is `hpop ros plan` without rosbridge; both share `hpop.ros.GoalPlanner`. It needs ROS 2 Jazzy or later with Nav2's
messages, and hpop in the same Python:

    source /opt/ros/jazzy/setup.bash
    python examples/ros2/hpop_planner.py --ros-args -p scenario:=examples/museum.yaml -p choice:="fewest turns"

Parameters: scenario, choice (knee), frame_id (map), base_frame (base_link), action (/hpop/compute_path_to_pose).
"""

from __future__ import annotations

import json
import threading
from contextlib import suppress

import rclpy
from nav2_msgs.action import ComputePathToPose
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_fields import fields_of, filled
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from hpop.errors import RosError
from hpop.ros import GoalPlanner, Interface, PlanarPose, Transforms
from hpop.scenario import load_scenario


class GivenUp(Exception):
    """Planning whose goal was canceled."""


class Planner(Node):
    """Plans one goal at a time; the others wait."""

    def __init__(self) -> None:
        super().__init__("hpop_planner")
        self.base_frame = self._given("base_frame", "base_link")
        scenario = load_scenario(self._given("scenario", ""))
        known = Interface(
            action=self._given("action", "/hpop/compute_path_to_pose"),
            frame_id=self._given("frame_id", "map"),
            choice=self._given("choice", "knee"),
        )
        self.planning = GoalPlanner(scenario.problem, scenario.planners, known)
        front = self.planning.rehearsed()
        self.get_logger().info(f"planned the scenario's own question: {len(front)} trajectories, {front.status}")
        self.one = threading.Lock()
        self.transforms = Transforms()
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TFMessage, "/tf", lambda message: self.hear(message, static=False), 100)
        self.create_subscription(TFMessage, "/tf_static", lambda message: self.hear(message, static=True), kept)
        self.options = self.create_publisher(String, known.options_topic, kept)
        self.create_timer(0.5, lambda: None)  # wakes the executor, so that Ctrl-C is seen
        self.server = ActionServer(
            self,
            ComputePathToPose,
            known.action,
            self.plan,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),  # so that a goal can be canceled while it is planned
        )

    def plan(self, goal):
        """Return the result of an accepted goal."""

        def follow(progress) -> None:
            if goal.is_cancel_requested:
                raise GivenUp

        result = ComputePathToPose.Result()
        try:
            with self.one:
                follow(None)
                answer = self.planning.answer(fields_of(goal.request), self.robot(), follow)
        except GivenUp:
            goal.canceled()
            return result
        filled(result, answer.values)
        if answer.options is None:
            self.get_logger().warning(result.error_msg)
            goal.abort()
        else:
            self.options.publish(String(data=json.dumps(answer.options)))
            goal.succeed()
        return result

    def hear(self, message: TFMessage, *, static: bool) -> None:
        """Take transforms."""
        try:
            self.transforms.hear(fields_of(message), 1e-9 * self.get_clock().now().nanoseconds, static=static)
        except RosError as error:
            self.get_logger().warning(f"ignored {error}", throttle_duration_sec=1.0)

    def robot(self) -> PlanarPose | None:
        """Return the robot's pose by tf; None where it is unknown."""
        found = self.transforms.pose(self.planning.known.frame_id, self.base_frame)
        return None if found is None else found[0]

    def _given(self, name: str, default: str) -> str:
        return self.declare_parameter(name, default).value


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Planner(), executor=MultiThreadedExecutor())


if __name__ == "__main__":
    main()
