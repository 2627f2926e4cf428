"""Connection to ROS 2 without installing ROS: paths as messages, and the planner as an action server over rosbridge.

``path_message(trajectory)`` returns a nav_msgs/Path as a dictionary, and ``trajectory_of(path, model)`` reads it back.
``typed(message, "nav_msgs/msg/Path", store)`` converts it to rosbags' types, and ``plain`` back to a dictionary.
``Bridge(url, PathServer(GoalPlanner(problem, planners, Interface())))`` serves the action ComputePathToPose, as ``hpop
ros scenario.yaml --url ws://localhost:9090`` does (extra ``ros``). ``FollowServer`` in its place also drives the robot,
as ``hpop ros follow`` does; ``Follower`` is its core, whatever carries the messages.
"""

from __future__ import annotations

from hpop.base.lazy import on_first_use
from hpop.ros.bridge import Bridge, PathServer
from hpop.ros.follow_plans import Ended, FollowPlanner, FollowSettings, Planned
from hpop.ros.follow_server import FollowServer, SimulatedClock
from hpop.ros.following import Follower
from hpop.ros.messages import PlanarPose, plain, planar_pose, pose_message, typed
from hpop.ros.navigation import FollowInterface, Hearing
from hpop.ros.observations import Transforms
from hpop.ros.paths import path_message, trajectory_of
from hpop.ros.planning import GoalPlanner
from hpop.ros.protocol import Interface

__all__ = [
    "Bridge",
    "Ended",
    "FollowInterface",
    "FollowPlanner",
    "FollowServer",
    "FollowSettings",
    "Follower",
    "GoalPlanner",
    "Hearing",
    "Interface",
    "PathServer",
    "PlanarPose",
    "Planned",
    "SimulatedClock",
    "Transforms",
    "path_message",
    "plain",
    "planar_pose",
    "pose_message",
    "trajectory_of",
    "typed",
]

__getattr__ = on_first_use(__name__, {}, former={"Planning": "GoalPlanner"})
