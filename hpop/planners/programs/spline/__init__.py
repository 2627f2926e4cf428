"""Paths of joints become splines: the planner, and what it works with."""

from hpop.planners.programs.spline.planner import Spline

__all__ = ["Spline"]
