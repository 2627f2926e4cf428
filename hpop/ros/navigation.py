"""Navigation of a robot by ROS messages: names of topics and actions, and the messages of Nav2's navigation actions.

The server over rosbridge (:mod:`hpop.ros.follow_server`) and the node for rclpy share all of this.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

from hpop.base.arguments import checked_arguments
from hpop.base.options import one_of, real
from hpop.base.text import shown
from hpop.errors import OptionError, RosError
from hpop.ros.follow_plans import Ended
from hpop.ros.messages import SECOND, Message, PlanarPose, header, mapping, planar_pose, pose_message, stamp, time_of
from hpop.ros.observations import FilterScale, MessageAge, OccupancyGrid, PeopleSeen, Transforms
from hpop.ros.protocol import FIELDS, FRAME, NAME, POSES, TEXT
from hpop.simulation.tracking import Command
from hpop.world import Person

TF = "tf2_msgs/msg/TFMessage"
COMMANDS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
PEOPLE = ("people_msgs/msg/People", "geometry_msgs/msg/PoseArray")
GRID, UPDATE, FILTER = (
    "nav_msgs/msg/OccupancyGrid",
    "map_msgs/msg/OccupancyGridUpdate",
    "nav2_msgs/msg/CostmapFilterInfo",
)
LOST = 0.5  # m, standard deviation of a pose from which the robot counts as lost


@checked_arguments
@dataclass(frozen=True)
class FollowInterface:
    """Names of actions, topics and frames by which ROS reaches a follower; a topic "" is left out.

    prefix        before the names of actions and of hpop's own topics: navigate_to_pose, navigate_through_poses, stop,
                  take, state, options, path
    distribution  distribution of ROS 2 with the nav2_msgs of the bridge, a key of `FIELDS`
    frame_id      frame of the map, of goals and of people
    base_frame    frame of the robot, whose pose tf tells
    pose_topic    topic of the robot's pose in the frame of the map, instead of tf
    pose_type     type of its messages, one of `POSES`
    cmd_topic     topic of velocity commands, and their type, one of `COMMANDS`
    map_topic     topic of maps; its updates come on the topic with _updates after it
    people_topic  topic of people, and the type of its messages, one of `PEOPLE`
    mask_topic    topic of a costmap filter's mask, and info_topic of its nav2_msgs/CostmapFilterInfo; without that
                  topic, cells of 100 are closed
    rate          commands a second

    Raises OptionError for an invalid name.
    """

    prefix: str = "/hpop"
    distribution: str = "jazzy"
    frame_id: str = "map"
    base_frame: str = "base_link"
    pose_topic: str = ""
    pose_type: str = POSES[0]
    cmd_topic: str = "/cmd_vel"
    cmd_type: str = COMMANDS[0]
    map_topic: str = "/map"
    people_topic: str = "/people"
    people_type: str = PEOPLE[0]
    mask_topic: str = ""
    info_topic: str = ""
    rate: float = 20.0

    def __post_init__(self) -> None:
        for option in fields(self):
            value = getattr(self, option.name)
            if option.name == "prefix" or option.name.endswith("_topic"):
                optional = option.name != "cmd_topic"
                valid = isinstance(value, str) and NAME.fullmatch(value) and "//" not in value
                if not (value == "" and optional) and (not valid or value.endswith("/")):
                    raise OptionError(f"{option.name} must be a name of ROS, such as /map, got {shown(value)}")
            if option.name in ("frame_id", "base_frame") and not (isinstance(value, str) and FRAME.fullmatch(value)):
                raise OptionError(f"{option.name} must be the name of a frame, such as map, got {shown(value)}")
        one_of("distribution", self.distribution, FIELDS)
        one_of("pose_type", self.pose_type, POSES)
        one_of("cmd_type", self.cmd_type, COMMANDS)
        one_of("people_type", self.people_type, PEOPLE)
        real("rate", self.rate, 10, 200, "a number of commands a second")

    def own(self, name: str) -> str:
        """Return the whole name of an action or topic of hpop's own."""
        return f"{self.prefix}/{name}"

    @property
    def action(self) -> str:
        """The action that drives to one pose."""
        return self.own("navigate_to_pose")

    @property
    def actions(self) -> dict[str, str]:
        """Actions with their types."""
        return {
            self.action: "nav2_msgs/action/NavigateToPose",
            self.own("navigate_through_poses"): "nav2_msgs/action/NavigateThroughPoses",
        }

    @property
    def heard(self) -> dict[str, str]:
        """Topics that are subscribed to, with their types."""
        poses = {self.pose_topic: self.pose_type} if self.pose_topic else {}
        updates = {f"{self.map_topic}_updates": UPDATE} if self.map_topic else {}
        topics = {
            "/tf": TF,
            "/tf_static": TF,
            **poses,
            self.map_topic: GRID,
            **updates,
            self.people_topic: self.people_type,
            self.mask_topic: GRID,
            self.info_topic: FILTER,
            self.own("stop"): "std_msgs/msg/Bool",
            self.own("take"): TEXT,
        }
        return {topic: kind for topic, kind in topics.items() if topic}

    @property
    def told(self) -> dict[str, str]:
        """Topics that are published, with their types."""
        own = {self.own(name): TEXT for name in ("state", "options")}
        return {self.cmd_topic: self.cmd_type, self.own("path"): "nav_msgs/msg/Path", **own}

    def goal_poses(self, goal: Any) -> tuple[PlanarPose, ...]:
        """Return the poses of a goal of NavigateToPose or NavigateThroughPoses; RosError for an invalid one."""
        told = mapping(goal, "the goal")
        rows = [told["pose"]] if "pose" in told else told.get("poses")
        if isinstance(rows, Mapping):  # nav_msgs/Goals, since Kilted
            rows = rows.get("goals")
        if not isinstance(rows, Sequence) or isinstance(rows, str) or not 0 < len(rows) <= 60:
            raise RosError(f"a goal must have a pose, or 1 to 60 poses, got {shown(rows)}")
        poses = [planar_pose(row, f"pose {i} of the goal") for i, row in enumerate(rows, 1)]
        for pose in poses:
            if pose.frame != self.frame_id:
                raise RosError(f"poses of a goal must be in the frame {self.frame_id}, got {shown(pose.frame)}")
        return tuple(poses)

    def result(self, action: str, ended: Ended) -> Message:
        """Return the fields of the result of a navigation action, as the distribution has them."""
        several = action != self.action
        code = 0 if ended.reached or ended.canceled else 9100 if several else 9000  # UNKNOWN, since Kilted
        whole = {
            "result": {},
            "error_code": code,
            "error_msg": "" if ended.reached else ended.words,
            "waypoint_statuses": [],
        }
        names = {"humble": ("result",), "iron": ("error_code",), "jazzy": ("error_code", "error_msg")}.get(
            self.distribution, ("error_code", "error_msg", *(("waypoint_statuses",) if several else ()))
        )
        return {name: whole[name] for name in names}

    def feedback(self, action: str, state: Mapping[str, Any]) -> Message:
        """Return the feedback of a navigation action, given :meth:`.Follower.state`."""
        pose = state["pose"] or (0.0, 0.0, 0.0)
        told = {
            "current_pose": pose_message(*pose, frame_id=self.frame_id),
            "navigation_time": stamp(round(state["elapsed"] * SECOND)),
            "estimated_time_remaining": stamp(round(state["remaining_time"] * SECOND)),
            "number_of_recoveries": 0,
            "distance_remaining": state["remaining_length"],
        }
        return told | ({"number_of_poses_remaining": state["poses_remaining"]} if action != self.action else {})

    def twist(self, command: Command, now: int) -> Message:
        """Return a command as a Twist, or as a TwistStamped with a time in ns."""
        told = {"linear": {"x": command.v, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": command.w}}
        stamped = self.cmd_type == COMMANDS[1]
        return {"header": header(now, self.base_frame), "twist": told} if stamped else told


class Listener(Protocol):
    """Follower as far as :class:`Hearing` tells it what ROS says; see :class:`.Follower`. Times are in s."""

    def located(self, pose: PlanarPose, at: float) -> None:
        """Take the pose of the robot."""

    def saw(self, people: Sequence[Person], at: float) -> None:
        """Take all people who are seen."""

    def mapped(self, grid: OccupancyGrid) -> None:
        """Take a map."""

    def filtered(self, mask: OccupancyGrid, scale: FilterScale) -> None:
        """Take the mask of a costmap filter."""

    def halt(self, stopped: bool) -> None:
        """Stop the robot, or let it go again."""

    def take(self, option: str, now: float) -> None:
        """Take an option."""


@checked_arguments
class Hearing:
    """Receiver of ROS messages, which passes each to a follower by its topic; used with rosbridge and rclpy."""

    def __init__(self, follower: Listener, known: FollowInterface) -> None:
        self.follower, self.known = follower, known
        self.reset()

    def reset(self) -> None:
        """Forget the transforms, maps, masks and people that were heard; the follower keeps its world."""
        self.transforms, self._people, self._age = Transforms(), PeopleSeen(), MessageAge()
        self._grid: OccupancyGrid | None = None
        self._mask: OccupancyGrid | None = None
        self._scale: FilterScale | None = None if self.known.info_topic else FilterScale()

    def forget_times(self) -> None:
        """Forget the people, the ages of messages and all transforms that are not static; maps and masks stay."""
        self.transforms.forget_moving()
        self._people, self._age = PeopleSeen(), MessageAge()

    def hear(self, topic: str, message: Any, now: float) -> None:
        """Take the message of a topic; RosError for an invalid one."""
        known = self.known
        if topic in ("/tf", "/tf_static"):
            self.transforms.hear(message, now, static=topic == "/tf_static")
            found = None if known.pose_topic else self.transforms.pose(known.frame_id, known.base_frame)
            if found is not None:
                self.follower.located(found[0], min(found[1], now))
        elif topic == known.pose_topic:
            self._located(message, now)
        elif topic == known.map_topic:
            self._grid = OccupancyGrid.of(message, known.frame_id)
            self.follower.mapped(self._grid)
        elif known.map_topic and topic == f"{known.map_topic}_updates":
            if self._grid is None:
                raise RosError(f"a map update before any map on {known.map_topic}")
            self._grid = self._grid.updated(message)
            self.follower.mapped(self._grid)
        elif topic == known.people_topic:
            self.follower.saw(self._people.heard(message, known.frame_id, self.transforms, now), now)
        elif topic in (known.mask_topic, known.info_topic):
            if topic == known.mask_topic:
                self._mask = OccupancyGrid.of(message, known.frame_id)
            else:
                self._scale = FilterScale.of(message)
            if self._mask is not None and self._scale is not None:
                self.follower.filtered(self._mask, self._scale)
        elif topic == known.own("stop"):
            stops = mapping(message, "a stop").get("data")
            if not isinstance(stops, bool):
                raise RosError(f"data of a stop must be true or false, got {shown(stops)}")
            self.follower.halt(stops)
        elif topic == known.own("take"):
            self.follower.take(mapping(message, "an option").get("data"), now)  # type: ignore[arg-type]
        else:
            raise RosError(f"a message of topic {shown(topic)}, which was not subscribed to")

    def _located(self, message: Any, now: float) -> None:
        """Take the pose of the robot, unless its covariance says that the robot is lost."""
        pose = planar_pose(message, "the robot's pose")
        if pose.frame != self.known.frame_id:
            raise RosError(f"a pose of the robot in the frame {shown(pose.frame)}, expected {self.known.frame_id}")
        age = self._age.of(now, time_of(message, "the robot's pose"))
        spread = mapping(mapping(message, "the pose").get("pose"), "the pose").get("covariance")
        if isinstance(spread, Sequence) and len(spread) == 36:
            variance = max(value for value in (spread[0], spread[7]) if isinstance(value, int | float))
            if not variance < LOST**2:
                return  # too uncertain to drive by
        self.follower.located(pose, now - age)
