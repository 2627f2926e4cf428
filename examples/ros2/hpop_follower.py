"""hpop as a node of ROS 2 that drives a robot: NavigateToPose and NavigateThroughPoses, commands on /cmd_vel.

It is `hpop ros follow` without rosbridge; both share `hpop.ros.Follower`. It needs ROS 2 Jazzy or later with Nav2's
messages, and hpop in the same Python:

    source /opt/ros/jazzy/setup.bash
    python examples/ros2/hpop_follower.py --ros-args -p scenario:=examples/museum.yaml -p choice:="fewest turns"

Parameters: scenario, and all fields of `hpop.ros.FollowInterface` and `hpop.ros.FollowSettings`, such as map_topic and
late. With use_sim_time it follows the clock of a simulation.
"""

from __future__ import annotations

import json
import uuid
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, fields
from threading import Event
from typing import Any

import rclpy
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_fields import fields_of, filled, type_of

from hpop.errors import RosError
from hpop.ros import Ended, Follower, FollowInterface, FollowPlanner, FollowSettings, Hearing, Interface
from hpop.scenario import load_scenario

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FED_BACK = 0.2  # s between messages of the state, and of feedback


@dataclass
class Open:
    """A goal whose end is awaited."""

    over: Event = field(default_factory=Event)
    end: Ended | None = None


class HpopFollower(Node):
    """Follows one goal at a time; a new one takes the place of the one before."""

    def __init__(self) -> None:
        super().__init__("hpop_follower")
        scenario = load_scenario(self.declare_parameter("scenario", "").value)
        self.known: FollowInterface = self._given(FollowInterface)
        settings: FollowSettings = self._given(FollowSettings)
        interface = Interface(frame_id=self.known.frame_id, choice=settings.choice)
        planner = FollowPlanner(scenario.problem, scenario.planners, interface, near=settings.near + 0.05)
        front = planner.rehearsed()
        say = self.get_logger().info
        say(f"planned the scenario's own question: {len(front)} trajectories, {front.status}")
        self.follower = Follower(planner, settings, ThreadPoolExecutor(1), say=say)
        self.hearing = Hearing(self.follower, self.known)
        self.goals: dict[str, Open] = {}
        self.told = -1e9
        self.talk = {topic: self._publisher(topic, kind) for topic, kind in self.known.told.items()}
        group = MutuallyExclusiveCallbackGroup()
        for topic, kind in self.known.heard.items():
            self._listen(topic, kind, group)
        reentrant = ReentrantCallbackGroup()
        self.servers = [
            ActionServer(
                self,
                type_of(kind),
                action,
                lambda goal, action=action: self.drive(action, goal),
                cancel_callback=lambda goal: CancelResponse.ACCEPT,
                callback_group=reentrant,  # so that a goal can be canceled while it is driven
            )
            for action, kind in self.known.actions.items()
        ]
        self.create_timer(1.0 / self.known.rate, self.step, callback_group=MutuallyExclusiveCallbackGroup())

    def now(self) -> float:
        """Return the time of the node's clock, s."""
        return 1e-9 * self.get_clock().now().nanoseconds

    def step(self) -> None:
        """Publish the command for now, and what has happened."""
        now = self.now()
        step = self.follower.step(now)
        if step.command is not None:
            self._publish(self.known.cmd_topic, self.known.twist(step.command, self.get_clock().now().nanoseconds))
        for event in step.events:
            if isinstance(event, Ended):
                goal = self.goals.get(event.goal)
                if goal is not None:
                    goal.end = event
                    goal.over.set()
                continue
            self._publish(self.known.own("options"), {"data": json.dumps(event.options)})
            if event.path is not None:
                self._publish(self.known.own("path"), event.path)
        if now - self.told >= FED_BACK:
            self.told = now
            self._publish(self.known.own("state"), {"data": json.dumps(self.follower.state(now))})

    def drive(self, action: str, handle: Any) -> Any:
        """Return the result of an accepted goal, when it has ended."""
        kind = type_of(self.known.actions[action])
        name, goal = uuid.uuid4().hex, Open()
        self.goals[name] = goal
        try:
            self.follower.follow(name, self.known.goal_poses(fields_of(handle.request)), self.now())
        except RosError as error:
            goal.end = Ended(name, False, str(error))
            goal.over.set()
        while not goal.over.wait(FED_BACK):
            if handle.is_cancel_requested:
                with suppress(RosError):  # it has just ended
                    self.follower.cancel(name)
            told = self.known.feedback(action, self.follower.state(self.now()))
            handle.publish_feedback(filled(kind.Feedback(), told))
        del self.goals[name]
        assert goal.end is not None
        if goal.end.reached:
            handle.succeed()
        elif goal.end.canceled:
            handle.canceled()
        else:
            handle.abort()
        return filled(kind.Result(), self.known.result(action, goal.end))

    def _listen(self, topic: str, kind: str, group: Any) -> None:
        try:
            found = type_of(kind)
        except ImportError:
            self.get_logger().warning(f"{kind} is not installed, so {topic} is not heard")
            return

        def hear(message: Any) -> None:
            try:
                self.hearing.hear(topic, fields_of(message), self.now())
            except RosError as error:
                self.get_logger().warning(f"ignored {error}", throttle_duration_sec=1.0)

        latched = topic in ("/tf_static", self.known.map_topic, self.known.mask_topic, self.known.info_topic)
        self.create_subscription(found, topic, hear, LATCHED if latched else 100, callback_group=group)

    def _publisher(self, topic: str, kind: str) -> tuple[Any, Any]:
        of_plan = topic in (self.known.own("options"), self.known.own("path"))
        found = type_of(kind)
        return found, self.create_publisher(found, topic, LATCHED if of_plan else 10)

    def _publish(self, topic: str, message: dict[str, Any]) -> None:
        kind, publisher = self.talk[topic]
        publisher.publish(filled(kind(), message))

    def _given(self, kind: Any) -> Any:
        """Return an object whose fields are parameters of the node."""
        return kind(**{each.name: self.declare_parameter(each.name, each.default).value for each in fields(kind)})


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(HpopFollower(), executor=MultiThreadedExecutor(8))


if __name__ == "__main__":
    main()
