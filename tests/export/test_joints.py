"""Joints for controllers, as foreign readers see them: executed motion by finite differences, limits, types of ROS."""

from __future__ import annotations

import os
import subprocess
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hpop.base.registry import formats
from hpop.errors import OptionError
from hpop.export import write
from hpop.export.base import jerk_limited
from tests.export.given import robots, through
from tests.export.readers import OF_JOINTS
from tests.models.serial_arm.arms import HERE, crane

ARM = robots()["serial arm"]
FOLLOW = """\
trajectory_msgs/JointTrajectory trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
builtin_interfaces/Duration goal_time_tolerance
"""  # goal of control_msgs/action/FollowJointTrajectory without its lists of tolerances, which default to none
ROBOT_TRAJECTORY = """\
trajectory_msgs/JointTrajectory joint_trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory
"""
EXECUTE = "moveit_msgs/RobotTrajectory trajectory\nstring[] controller_names\n"


def written(tmp_path, name, trajectory=ARM, **options):
    return OF_JOINTS[name](write(trajectory, tmp_path / f"any{formats[name].suffix}", body="joints", **options))


def names_of_urdf() -> list[str]:
    """Names of the joints that move, from base to tip, by the links they connect."""
    by_child = {j.find("child").get("link"): j for j in ElementTree.parse(HERE / "arm6.urdf").iter("joint")}
    link, names = "tool", []
    while link in by_child:
        names.append((by_child[link].get("name"), by_child[link].get("type")))
        link = by_child[link].find("parent").get("link")
    return [name for name, kind in reversed(names) if kind != "fixed"]


@pytest.mark.parametrize("name", OF_JOINTS)
def test_every_format_has_the_executed_motion_of_the_joints(name, tmp_path):
    """At 100 Hz: ends at rest at start and goal, rates and accelerations are those of the positions, within limits."""
    found = written(tmp_path, name)
    assert found.names == names_of_urdf()
    np.testing.assert_allclose(np.diff(found.times)[:-1], 0.01, atol=2e-9)
    assert found.times[0] == 0.0
    assert found.times[-1] == pytest.approx(ARM.duration, abs=1e-8)
    ends = np.array([[0.1] * 6, [0.2] * 6])
    np.testing.assert_allclose(found.positions[[0, -1]], ends, atol=1e-9)
    assert np.abs(found.velocities[[0, -1]]).max() < 1e-12  # a controller refuses more than 1e-7 at the end
    step = np.diff(found.times)[:, None]
    mean = np.diff(found.positions, axis=0) / step
    half = 0.5 * (found.velocities[1:] + found.velocities[:-1])
    assert np.abs(mean - half).max() < 6.0 * 0.01  # exact but where the acceleration jumps
    assert np.median(np.abs(mean - half)) < 1e-6
    assert np.median(np.abs(np.diff(found.velocities, axis=0) / step - found.accelerations[:-1])) < 1e-5
    chain = ARM.model.chain
    assert (np.abs(found.velocities) <= chain.speed * (1 + 1e-9)).all()
    assert (np.abs(found.accelerations) <= 6.0 * (1 + 1e-9)).all()
    assert np.abs(found.accelerations).max() > 5.9


def completed(told, kind, store):
    """Return a message of rosbags from a mapping, with 0 and empty lists for fields that are left out, as ros2cli."""
    made = {}
    for name, (form, of) in store.fielddefs[kind][1]:
        value = told.pop(name, None)
        if form.name == "NAME":
            made[name] = completed(value or {}, of, store)
        elif form.name == "SEQUENCE":
            inner = of[0]
            numbers = inner[0].name == "BASE" and inner[1][0] != "string"
            items = [completed(one, inner[1], store) if inner[0].name == "NAME" else one for one in value or []]
            made[name] = np.array(items, inner[1][0]) if numbers else items
        else:
            made[name] = value if value is not None else "" if of[0] == "string" else 0
    assert not told, f"{kind} has no {[*told]}"
    return store.types[kind](**made)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("joint-trajectory", "trajectory_msgs/msg/JointTrajectory"),
        ("follow-joint-trajectory", "control_msgs/msg/FollowJointTrajectoryGoal"),
        ("moveit", "moveit_msgs/msg/ExecuteTrajectoryGoal"),
    ],
)
def test_files_are_messages_of_their_types(name, kind, tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    for text, of in (
        (FOLLOW, "control_msgs/msg/FollowJointTrajectoryGoal"),
        (ROBOT_TRAJECTORY, "moveit_msgs/msg/RobotTrajectory"),
        (EXECUTE, "moveit_msgs/msg/ExecuteTrajectoryGoal"),
    ):
        store.register(get_types_from_msg(text, of))
    told = yaml.safe_load(write(ARM, tmp_path / f"any{formats[name].suffix}", body="joints").read_text())
    message = completed(told, kind, store)
    again = store.deserialize_cdr(store.serialize_cdr(message, kind), kind)
    inner = again
    for field in {"moveit": ("trajectory", "joint_trajectory"), "joint-trajectory": ()}.get(name, ("trajectory",)):
        inner = getattr(inner, field)
    assert inner.points[-1].positions.tolist() == pytest.approx([0.2] * 6)


OF_ROS = """
import sys, yaml
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from builtin_interfaces.msg import Duration
told = yaml.safe_load(sys.stdin)
made = JointTrajectory(joint_names=told["joint_names"])
for point in told["points"]:
    lasts = Duration(**point.pop("time_from_start"))
    made.points.append(JointTrajectoryPoint(**point, time_from_start=lasts))  # asserts types and ranges
print(len(made.points), made.points[-1].positions.tolist(), made.points[-1].time_from_start.nanosec)
"""


def test_the_python_of_ros_builds_the_message(tmp_path):
    """With the wheels ros-jazzy-trajectory-msgs (Python 3.12) and PyYAML in an environment of their own."""
    python = os.environ.get("HPOP_ROS_PYTHON")
    if not python:
        pytest.skip("HPOP_ROS_PYTHON names no Python with trajectory_msgs")
    path = write(ARM, tmp_path / "any.joint_trajectory.yaml", body="joints")
    told = subprocess.run([python, "-c", OF_ROS], input=path.read_text(), capture_output=True, text=True, check=True)
    found = OF_JOINTS["joint-trajectory"](path)
    nanoseconds = round(found.times[-1] % 1.0 * 1e9)
    assert told.stdout.split() == f"{len(found.times)} {found.positions[-1].tolist()} {nanoseconds}".split()


@pytest.mark.parametrize("jerk", [5.0, 60.0, 2000.0])
def test_a_jerk_limit_changes_the_time_and_not_the_path(jerk, tmp_path):
    """By finite differences of what is written, and by ruckig: it is the fastest motion within the three limits."""
    arm = crane(tmp_path)
    rows = [(0.1, 0.2, 0.1, 0.3), (0.4, 2.0, 0.2, -1.0), (0.4, 2.2, 0.2, -1.0), (-0.1, 2.2, 0.0, 1.0)]
    planned = through(arm, *rows).with_hold(at=1, seconds=0.5)
    found = written(tmp_path, "csv", planned, rate=1000.0, jerk=jerk)
    chain, step = arm.chain, 1e-3
    jumps = np.abs(np.diff(found.accelerations[:-1], axis=0)) / step
    assert jumps.max() <= jerk * (1 + 1e-6)
    assert (np.abs(found.velocities) <= chain.speed * (1 + 1e-9)).all()
    assert (np.abs(found.accelerations) <= chain.acceleration * (1 + 1e-9)).all()
    np.testing.assert_allclose(
        np.diff(found.velocities[:-1], axis=0) / step, found.accelerations[1:-1], atol=jerk * step
    )
    made, passed = jerk_limited(planned, jerk)
    assert not list(arm.faults(made))
    corners = np.array([[getattr(made.at(t), name)[0] for name in found.names] for t in passed])
    np.testing.assert_allclose(corners, np.stack([getattr(planned.states, n) for n in found.names], 1), atol=1e-9)
    for start, end in pairwise(corners):  # each row is on one of the straight reaches
        way = end - start
        if way.any():
            along = ((found.positions - start) @ way / (way @ way)).clip(0, 1)
            apart = np.abs(start + along[:, None] * way - found.positions).max(axis=1)
            found = found._replace(times=np.where(apart < 1e-9, -1.0, found.times))
    assert (found.times == -1.0).all()
    ruckig = pytest.importorskip("ruckig", reason="ruckig, the second judge of durations, is not installed")
    for i, way in enumerate(np.abs(np.diff(corners, axis=0))):
        if not way.any():
            assert passed[i + 1] - passed[i] == pytest.approx(0.5)
            continue
        asked = ruckig.InputParameter(1)
        asked.target_position = [1.0]
        some = way > 0
        asked.max_velocity = [float((chain.speed[some] / way[some]).min())]
        asked.max_acceleration = [float((chain.acceleration[some] / way[some]).min())]
        asked.max_jerk = [float((jerk / way[some]).min())]
        fastest = ruckig.Trajectory(1)
        ruckig.Ruckig(1).calculate(asked, fastest)
        assert passed[i + 1] - passed[i] == pytest.approx(fastest.duration, rel=1e-9)


def test_a_jerk_of_each_joint_counts_and_wrong_ones_are_refused(tmp_path):
    names = ARM.model.joints
    slow = jerk_limited(ARM, {name: 10.0 if name == names[3] else 1e4 for name in names})[0]
    assert slow.duration == pytest.approx(jerk_limited(ARM, 10.0)[0].duration)
    for jerk, said in (
        ({"elbow": 3.0}, "jerk names 'elbow', which is no joint that moves"),
        ({names[0]: 3.0}, f"got none for {names[1]}, .*; add them"),
        (-1.0, "jerk must be rad/s³ or m/s³"),
    ):
        with pytest.raises(OptionError, match=said):
            write(ARM, tmp_path / "any.csv", body="joints", jerk=jerk)
    with pytest.raises(
        OptionError, match=r"reaches, .* got spline, whose acceleration jumps .*; export a trajectory of"
    ):
        jerk_limited(slow, 10.0)
    with pytest.raises(OptionError, match="need a serial_arm, got another robot"):
        write(robots()["pan-tilt"], tmp_path / "any.csv", jerk=10.0)
    with pytest.raises(OptionError, match="jerk limits the executed motion, but the planned one is asked for"):
        write(ARM, tmp_path / "any.csv", jerk=10.0, planned=True)
    assert not list(tmp_path.glob("any*"))


def test_robots_with_a_base_say_that_it_is_not_there_and_those_without_joints_are_refused(tmp_path):
    path = write(robots()["pan-tilt"], tmp_path / "any.joint_trajectory.yaml", body="joints", rate=20)
    assert "# the motion of the base is not in this file" in path.read_text().splitlines()
    assert OF_JOINTS["joint-trajectory"](path).names == ["pan", "tilt"]
    with pytest.raises(OptionError, match="joints need a robot with joints, got differential_drive"):
        write(robots()["differential drive"], tmp_path / "any.csv", body="joints")
    with pytest.raises(OptionError, match=r"writes joints: give the body joints \(--body joints\), got camera"):
        write(ARM, tmp_path / "any.moveit.yaml")
    with pytest.raises(OptionError, match="this format writes poses, got the body joints; use csv, joint-trajectory"):
        write(ARM, tmp_path / "any.tum", body="joints")
