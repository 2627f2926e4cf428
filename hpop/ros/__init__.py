"""ROS 2 without ROS: paths as messages and back, and the planner as an action server over rosbridge.

``path_message(trajectory)`` is a nav_msgs/Path as a dictionary, ``trajectory_of(path, model)`` the way back,
``typed(message, "nav_msgs/msg/Path", store)`` an instance of rosbags' types, and ``plain`` again a dictionary.
``Bridge(url, PathServer(Planning(problem, planners, Interface())))`` serves the action ComputePathToPose, as
``hpop ros scenario.yaml --url ws://localhost:9090`` does (extra ``ros``).
"""

from __future__ import annotations

from hpop.ros.bridge import Bridge
from hpop.ros.messages import PlanarPose, plain, planar_pose, pose_message, typed
from hpop.ros.path_server import PathServer
from hpop.ros.paths import path_message, trajectory_of
from hpop.ros.planning import Planning
from hpop.ros.protocol import Interface

__all__ = [
    "Bridge",
    "Interface",
    "PathServer",
    "PlanarPose",
    "Planning",
    "path_message",
    "plain",
    "planar_pose",
    "pose_message",
    "trajectory_of",
    "typed",
]
