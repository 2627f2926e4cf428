"""The spline planner: paths of a robot with joints become smooth splines."""

from hpop.planners.programs.spline.planner import Spline

__all__ = ["Spline"]
