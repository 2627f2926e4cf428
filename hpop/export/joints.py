"""Export formats with the values of a robot's joints, for controllers of ROS 2 and for MoveIt."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.export.base import Exported, export_format, rows_of_text
from hpop.ros.messages import Message, header, stamp
from hpop.trajectories.joint_rows import JointRows
from hpop.trajectories.poses import nanoseconds

TABLE_AXES = (
    "joints of the robot, from base to tip, rad or m; <joint>_rate rad/s or m/s, <joint>_acceleration rad/s² or m/s²; "
    "t in s from the start"
)
AXES = (
    "joints of the robot, from base to tip, with their names in the URDF; positions rad or m, velocities rad/s or m/s, "
    "accelerations rad/s² or m/s²; time_from_start in s and ns from the start"
)
DIGITS = 9  # behind the point: 1e-9 rad, without exponents, which YAML 1.1 reads as text


def joint_csv(given: Exported) -> bytes:
    """Return a table of the joints: time, and value, rate and acceleration of each."""
    rows = given.joints
    heads = [f"{name}{end}" for end in ("", "_rate", "_acceleration") for name in rows.names]
    table = np.column_stack([rows.times, rows.positions, rows.velocities, rows.accelerations])
    said = "".join(f"# {line}\n" for line in given.statement(TABLE_AXES))
    return (said + ",".join(["t", *heads]) + "\n" + rows_of_text(table, ",")).encode()


def joint_trajectory_message(rows: JointRows) -> Message:
    """Return joints as a trajectory_msgs/JointTrajectory with time stamp 0, at which a controller starts at once."""
    points = [
        {
            "positions": positions,
            "velocities": velocities,
            "accelerations": accelerations,
            "effort": [],
            "time_from_start": stamp(time),
        }
        for time, positions, velocities, accelerations in zip(
            nanoseconds(rows.times).tolist(),
            *map(_rounded, (rows.positions, rows.velocities, rows.accelerations)),
            strict=True,
        )
    ]
    return {"header": header(0, ""), "joint_names": list(rows.names), "points": points}


def joint_states(rows: JointRows) -> Iterator[tuple[int, Message]]:
    """Yield the times, ns, and the messages sensor_msgs/JointState along the motion of joints."""
    for time, place, speed in zip(nanoseconds(rows.times).tolist(), rows.positions, rows.velocities, strict=True):
        at = {"name": list(rows.names), "position": place.tolist(), "velocity": speed.tolist(), "effort": []}
        yield time, {"header": header(time, ""), **at}


@export_format("joint-trajectory", suffix=".joint_trajectory.yaml", axes=AXES)
def joint_trajectory(given: Exported) -> bytes:
    """Return a trajectory_msgs/JointTrajectory as YAML, for the topic of a joint trajectory controller.

    Send it with ``ros2 topic pub --once /joint_trajectory_controller/joint_trajectory
    trajectory_msgs/msg/JointTrajectory "$(cat knee_70.joint_trajectory.yaml)"``.

    Joints are named as in the URDF, from base to tip. Each point has positions (rad or m), velocities, accelerations
    and the time from the start. The first point is the start, the last the goal. If the motion of joints starts or
    stops between points, the controller rounds the corner; so use a rate of at least 100 Hz.

    Raises OptionError unless the body is "joints".
    """
    return _yaml(given, "")


@export_format("follow-joint-trajectory", suffix=".follow.yaml", axes=AXES)
def follow_joint_trajectory(given: Exported) -> bytes:
    """Return the goal of the action control_msgs/FollowJointTrajectory as YAML, ready to be sent to a controller.

    Send it with ``ros2 action send_goal --stdin /joint_trajectory_controller/follow_joint_trajectory
    control_msgs/action/FollowJointTrajectory < knee_70.follow.yaml``.

    Its ``trajectory`` is that of the format ``joint-trajectory``. Tolerances are left out, so those of the controller
    apply. Raises OptionError unless the body is "joints".
    """
    return _yaml(given, "trajectory", end="goal_time_tolerance: {sec: 0, nanosec: 0}\n")


@export_format("moveit", suffix=".moveit.yaml", axes=AXES)
def moveit(given: Exported) -> bytes:
    """Return the goal of MoveIt's action ExecuteTrajectory as YAML, with a moveit_msgs/RobotTrajectory.

    Send it with ``ros2 action send_goal --stdin /execute_trajectory moveit_msgs/action/ExecuteTrajectory <
    knee_70.moveit.yaml``.

    Its ``trajectory.joint_trajectory`` is that of the format ``joint-trajectory``. MoveIt compares the start with the
    present state of the arm. Raises OptionError unless the body is "joints".
    """
    return _yaml(given, "trajectory: joint_trajectory")


def _yaml(given: Exported, within: str, *, end: str = "") -> bytes:
    """Return the exported joints as a JointTrajectory in YAML.

    within  names of the fields that enclose it, from the outermost, separated by ": "; "" for none
    end     lines of YAML to write after it
    """
    message = joint_trajectory_message(given.joints)
    lines = [f"# {line}" for line in given.statement(AXES)]
    indent = ""
    for name in filter(None, within.split(": ")):
        lines.append(f"{indent}{name}:")
        indent += "  "
    lines.append(f"{indent}header: {{stamp: {{sec: 0, nanosec: 0}}, frame_id: ''}}")
    lines.append(f"{indent}joint_names: [{', '.join(map(_quoted, message['joint_names']))}]")
    lines.append(f"{indent}points:")
    for point in message["points"]:
        numbers = (
            f"{name}: [{', '.join(f'{value:.{DIGITS}f}' for value in point[name])}]"
            for name in ("positions", "velocities", "accelerations")
        )
        sec, nanosec = point["time_from_start"].values()
        lines.append(f"{indent}- {{{', '.join(numbers)}, time_from_start: {{sec: {sec}, nanosec: {nanosec}}}}}")
    return ("\n".join(lines) + "\n" + end).encode()


def _rounded(numbers: FloatArray) -> list[list[float]]:
    """Return numbers, rounded to the digits that the formats write, so that speeds at rest are 0; -0.0 becomes 0.0."""
    rounded: list[list[float]] = (np.round(numbers, DIGITS) + 0.0).tolist()
    return rounded


def _quoted(name: str) -> str:
    return "'" + printable(name).replace("'", "''") + "'"
