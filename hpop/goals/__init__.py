"""Goals of a trajectory (states, or poses of a body such as the camera), and tours (stops to visit on the way)."""

from hpop.goals.base import REACHED, AnyOf, Anywhere, Goal, GoalSet, GoalSpec, checked_goal, goal, is_named
from hpop.goals.bodies import CameraAt, LookAt, ToolAt
from hpop.goals.joints_at import JointsAt
from hpop.goals.region import Region
from hpop.goals.tour import Tour
from hpop.goals.tour_stop import TourStop

__all__ = [
    "REACHED",
    "AnyOf",
    "Anywhere",
    "CameraAt",
    "Goal",
    "GoalSet",
    "GoalSpec",
    "JointsAt",
    "LookAt",
    "Region",
    "ToolAt",
    "Tour",
    "TourStop",
    "checked_goal",
    "goal",
    "is_named",
]
