"""The spline planner: paths of joints become splines."""

from hpop.planners.programs.spline.planner import Spline

__all__ = ["Spline"]
