"""Send an arm's trajectory to its controller, or to MoveIt, in ROS 2, and wait for the result.

It is `hpop ros send` without rosbridge. It needs the messages of the action (control_msgs, moveit_msgs), and hpop in
the same Python:

    hpop export out/arm --body joints --format follow-joint-trajectory,moveit
    source /opt/ros/jazzy/setup.bash
    python examples/ros2/hpop_send.py out/export/knee_70.follow.yaml --ros-args -p action:=/arm/follow_joint_trajectory

The parameter action is the name of the action; without it, the usual one of the file's type. Ctrl-C cancels the goal.
The arm must stand at the start of the trajectory.
"""

from __future__ import annotations

import sys
from pathlib import Path

import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from ros_fields import fields_of, filled, type_of

from hpop.ros.sending import ArmGoal, outcome

WAIT = 10.0  # s, for the action


def sent(node: Node, goal: ArmGoal) -> str:
    """Send a goal, and return "" if it was reached, else the reason why not."""
    kind = type_of(goal.kind)
    client = ActionClient(node, kind, goal.action)
    if not client.wait_for_server(timeout_sec=WAIT):
        return f"no server offers the action {goal.action}; start the controller, or give the parameter action"
    accepted = client.send_goal_async(filled(kind.Goal(), goal.fields))
    rclpy.spin_until_future_complete(node, accepted)
    handle = accepted.result()
    if not handle.accepted:
        return f"the server of {goal.action} refused the goal"
    ended = handle.get_result_async()
    try:
        rclpy.spin_until_future_complete(node, ended)
    except KeyboardInterrupt:
        handle.cancel_goal_async()
        rclpy.spin_until_future_complete(node, ended, timeout_sec=WAIT)
    if not ended.done():
        return "the server did not confirm that it stops; it is not known whether the arm moves on"
    return outcome(ended.result().status, fields_of(ended.result().result))


def main() -> None:
    """Send the goal of a file; the exit code is 1 if it was not reached."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C must leave time to cancel the goal
    node = Node("hpop_send")
    files = remove_ros_args(sys.argv)[1:]
    if len(files) != 1:
        sys.exit(f"expected one file, NAME.follow.yaml or NAME.moveit.yaml, got {len(files)}")
    why = sent(node, ArmGoal.from_file(Path(files[0]), node.declare_parameter("action", "").value))
    rclpy.shutdown()
    if why:
        sys.exit(why)
    print("the goal was reached")


if __name__ == "__main__":
    main()
