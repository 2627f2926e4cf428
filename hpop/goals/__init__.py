"""Where a trajectory shall end: at a state, at any of several, or wherever a body is where it shall be."""

from hpop.goals.base import REACHED, Goal, goal
from hpop.goals.given import GoalSpec, checked_goal, is_named
from hpop.goals.look_at import LookAt
from hpop.goals.pose_at import CameraAt, ToolAt
from hpop.goals.region import Region
from hpop.goals.sets import AnyOf, GoalSet

__all__ = [
    "REACHED",
    "AnyOf",
    "CameraAt",
    "Goal",
    "GoalSet",
    "GoalSpec",
    "LookAt",
    "Region",
    "ToolAt",
    "checked_goal",
    "goal",
    "is_named",
]
