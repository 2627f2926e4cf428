"""Goals of a trajectory: a state, any of several states, or any state in which a body is at a wanted pose."""

from hpop.goals.base import REACHED, AnyOf, Goal, GoalSet, GoalSpec, checked_goal, goal, is_named
from hpop.goals.bodies import CameraAt, LookAt, ToolAt
from hpop.goals.region import Region

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
