"""Names under which the planner is known in ROS: of the action, frames and topics."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields

from hpop.base.arguments import checked_arguments
from hpop.base.options import one_of
from hpop.base.text import shown
from hpop.errors import OptionError

NAME = re.compile(r"[A-Za-z/][A-Za-z0-9_/]{0,199}")
FRAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_/.-]{0,99}")  # it stands in each pose of a path
POSES = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
)
LONGEST_CHOICE = 200  # characters
FIELDS = {
    "humble": ("path", "planning_time"),
    "iron": ("path", "planning_time", "error_code"),
    "jazzy": ("path", "planning_time", "error_code", "error_msg"),
    "kilted": ("path", "planning_time", "error_code", "error_msg"),
    "rolling": ("path", "planning_time", "error_code", "error_msg"),
}
"""Of the result of nav2_msgs/action/ComputePathToPose by distribution: a bridge drops a result with others."""


@checked_arguments
@dataclass(frozen=True)
class Interface:
    """How the planner appears in ROS.

    action         name of the action, which must be no other server's
    distribution   of ROS 2, whose nav2_msgs the bridge has
    frame_id       frame of the map, in which goals are taken and paths given
    pose_topic     where the robot's pose in that frame is told, for goals with ``use_start`` false
    pose_type      of its messages, one of three
    options_topic  where the front of each plan is told, as JSON in a std_msgs/msg/String
    choice         what an empty planner_id means

    Raises OptionError for a name that is none.
    """

    action: str = "/hpop/compute_path_to_pose"
    distribution: str = "jazzy"
    frame_id: str = "map"
    pose_topic: str = "/amcl_pose"
    pose_type: str = POSES[0]
    options_topic: str = "/hpop/options"
    choice: str = "knee"

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if one.name in ("action", "pose_topic", "options_topic") and (
                not isinstance(value, str) or not NAME.fullmatch(value) or "//" in value or value.endswith("/")
            ):
                raise OptionError(f"{one.name} must be a name of ROS, such as {one.default}, got {shown(value)}")
        one_of("distribution", self.distribution, FIELDS)
        one_of("pose_type", self.pose_type, POSES)
        frame = self.frame_id
        if not isinstance(frame, str) or not FRAME.fullmatch(frame):
            raise OptionError(f"frame_id must be the name of a frame, such as map, got {shown(frame)}")
        if not isinstance(self.choice, str) or not 0 < len(self.choice) <= LONGEST_CHOICE:
            raise OptionError(f"choice must be a name such as knee or 'fewest turns', got {shown(self.choice)}")
