"""Export formats as text: poses along a trajectory (CSV, JSON, EuRoC, TUM, Unity, Unreal Engine), and joints.

Values of a robot's joints are for controllers of ROS 2 and for MoveIt.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.export.base import PROGRAM, Exported, export_format, pitch_of, roll_of, rows_of_text
from hpop.frontier import strict_json
from hpop.motions.bodies import JOINTS
from hpop.ros.messages import Message, header, stamp
from hpop.trajectories.poses import JointRows, nanoseconds

CSV_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion x, y, z, w of the body (x ahead, y left, z up); "
    "v m/s forward, yaw_rate rad/s counter-clockwise; t in s from the start"
)


@export_format("csv", suffix=".csv", axes=CSV_AXES)
def pose_csv(given: Exported) -> bytes:
    """Return a table of poses in the world's frame, or of joints, for spreadsheets and scripts.

    Columns for poses:

    - ``t``: time from the start, s
    - ``x``, ``y``, ``z``: position, m; axes are right-handed with z up (REP-103)
    - ``qx``, ``qy``, ``qz``, ``qw``: unit quaternion that turns the world's axes to those of the body (x ahead, y left,
      z up); its sign is chosen so that interpolation takes the shorter way
    - ``v``: velocity along the direction ahead, m/s
    - ``yaw_rate``: rate of turning about the vertical, rad/s, counter-clockwise

    Columns for the body "joints", from base to tip: ``t``; the value of each joint, rad or m; ``<joint>_rate``, rad/s
    or m/s; ``<joint>_acceleration``, rad/s² or m/s².

    Lines that begin with ``#`` state the axes and the costs, so read it with ``pandas.read_csv(file, comment="#")``.
    Numbers read back as equal float64.
    """
    if given.body == JOINTS:
        return joint_csv(given)
    seen = given.poses
    table = np.column_stack([seen.times, seen.positions, seen.quaternions, seen.speeds, seen.yaw_rates])
    said = "".join(f"# {line}\n" for line in given.statement(CSV_AXES))
    return (said + "t,x,y,z,qx,qy,qz,qw,v,yaw_rate\n" + rows_of_text(table, ",")).encode()


JSON_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternions x, y, z, w of the body (x ahead, y left); "
    "speeds m/s forward, yaws rad and yaw_rates rad/s counter-clockwise; times in s from the start"
)


@export_format("json", suffix=".json", axes=JSON_AXES)
def pose_json(given: Exported) -> bytes:
    """Return a JSON object of poses, in the world's frame, with its costs, for web pages and scripts.

    These keys have one entry for each pose:

    - ``times``: s, from the start
    - ``positions``: [x, y, z] in m; axes are right-handed with z up (REP-103)
    - ``quaternions``: [x, y, z, w], unit quaternions that turn the world's axes to those of the body (x ahead, y left,
      z up)
    - ``yaws``: rad, without jumps at a full turn
    - ``speeds``: m/s, along the direction ahead
    - ``yaw_rates``: rad/s, counter-clockwise

    The key ``axes`` states this in words. The file is strict JSON in UTF-8. Numbers read back as equal float64.
    """
    seen = given.poses
    told = {
        "schema": "hpop-poses",
        "version": 1,
        "program": PROGRAM,
        "axes": JSON_AXES,
        "frame": given.frames.world,
        "body": given.body,
        "planned": given.planned,
        "rate": float(given.rate),
        "row": given.row,
        "name": given.name,
        "costs": dict(given.costs),
        "units": dict(given.units),
        "times": seen.times.tolist(),
        "positions": seen.positions.tolist(),
        "quaternions": seen.quaternions.tolist(),
        "yaws": seen.yaws.tolist(),
        "speeds": seen.speeds.tolist(),
        "yaw_rates": seen.yaw_rates.tolist(),
    }
    return "".join([*strict_json.pieces(told), "\n"]).encode()


EUROC_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion w, x, y, z of the body (x ahead, y left, z up); "
    "timestamp in whole ns from the start"
)
HEAD = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"


@export_format("euroc", suffix=".euroc.csv", axes=EUROC_AXES)
def euroc(given: Exported) -> bytes:
    """Return a ground truth table as in the EuRoC MAV data sets, for evo and visual-inertial tools.

    After one line of headings, the columns are: time from the start in whole nanoseconds, position in m, and unit
    quaternion with w first. Axes are right-handed with z up (REP-103). The axes of the body are x ahead, y left, z up.

    Source: Burri et al. 2016, The EuRoC micro aerial vehicle datasets, IJRR 35(10).
    """
    seen = given.poses
    lines = [HEAD]
    for time, place, (x, y, z, w) in zip(
        nanoseconds(seen.times).tolist(), seen.positions.tolist(), seen.quaternions.tolist(), strict=True
    ):
        lines.append(",".join(map(repr, (time, *place, w, x, y, z))))
    return ("\n".join(lines) + "\n").encode()


TUM_AXES = (
    "right-handed, x and y on the floor, z up (REP-103), m; quaternion x, y, z, w of the body (x ahead, y left, z up); "
    "timestamp in s from the start"
)


@export_format("tum", suffix=".tum", axes=TUM_AXES)
def tum(given: Exported) -> bytes:
    """Return lines ``timestamp tx ty tz qx qy qz qw`` of the TUM RGB-D benchmark, for evo and SLAM tools.

    Each line has the time from the start in s, the position in m, and a unit quaternion. Axes are right-handed with z
    up (REP-103). The axes of the body are x ahead, y left, z up. Some SLAM systems write other axes of the camera, with
    z ahead. Lines that begin with ``#`` state the axes and the costs.

    Source: Sturm et al. 2012, A benchmark for the evaluation of RGB-D SLAM systems, IROS.
    """
    seen = given.poses
    said = "".join(f"# {line}\n" for line in [*given.statement(TUM_AXES), "timestamp tx ty tz qx qy qz qw"])
    return (said + rows_of_text(np.column_stack([seen.times, seen.positions, seen.quaternions]), " ")).encode()


UNITY_AXES = (
    "left-handed, x right, y up, z ahead (Unity), m; quaternion x, y, z, w; "
    "a heading of 0 (the world's x) looks along +z; t in s from the start"
)


@export_format("unity-csv", suffix=".unity.csv", axes=UNITY_AXES)
def unity_csv(given: Exported) -> bytes:
    """Return a table for Unity: left-handed, x right, y up, z ahead, m.

    Columns are ``t`` (s, from the start), ``x``, ``y``, ``z`` (m), and ``qx``, ``qy``, ``qz``, ``qw``. Assign them to
    the ``position`` and ``rotation`` of a transform. A point (x, y, z) of the world becomes (-y, z, x). A quaternion
    becomes (q_y, -q_z, -q_x, q_w). Unity's ROS-TCP-Connector converts in this way, too (FLU to RUF). A heading of 0,
    along the world's x, looks along +z. Lines that begin with ``#`` state the axes and the costs.
    """
    seen = given.poses
    x, y, z = seen.positions.T
    qx, qy, qz, qw = seen.quaternions.T
    table = np.column_stack([seen.times, -y, z, x, qy, -qz, -qx, qw]) + 0.0  # no -0.0
    said = "".join(f"# {line}\n" for line in given.statement(UNITY_AXES))
    return (said + "t,x,y,z,qx,qy,qz,qw\n" + rows_of_text(table, ",")).encode()


UNREAL_AXES = (
    "left-handed, x ahead at heading 0, y right, z up (Unreal), cm; "
    "pitch up, yaw clockwise from above, roll to the right, degrees; t in s from the start"
)


@export_format("unreal-csv", suffix=".unreal.csv", axes=UNREAL_AXES)
def unreal_csv(given: Exported) -> bytes:
    """Return a table for Unreal Engine: left-handed, x along the world's x, y to its right, z up, cm.

    Columns are ``t`` (s, from the start), ``x``, ``y``, ``z`` (cm), and ``pitch``, ``yaw``, ``roll`` (degrees). Angles
    are those of an FRotator: pitch up, yaw clockwise from above, roll to the right. A point (x, y, z) of the world, in
    m, becomes (100 x, -100 y, 100 z). Yaw changes its sign. It does not jump at a full turn, so it may exceed 180.
    Lines that begin with ``#`` state the axes and the costs.
    """
    seen = given.poses
    angles = [pitch_of(seen.quaternions), -seen.yaws, roll_of(seen.quaternions)]
    table = np.column_stack([seen.times, seen.positions * [100.0, -100.0, 100.0], np.degrees(angles).T]) + 0.0
    said = "".join(f"# {line}\n" for line in given.statement(UNREAL_AXES))
    return (said + "t,x,y,z,pitch,yaw,roll\n" + rows_of_text(table, ",")).encode()


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
