"""Criteria in four groups; importing this package registers those that come with hpop."""

from hpop.criteria.base import Criterion, criterion, make_criterion, motion_costs, trajectory_cost
from hpop.criteria.comfort.length import Length
from hpop.criteria.comfort.rotation import Rotation
from hpop.criteria.comfort.turns import Turns
from hpop.criteria.performance.obstruction import Exposure, Obstruction
from hpop.criteria.robot.clearance import Clearance
from hpop.criteria.robot.duration import Duration

__all__ = [
    "Clearance",
    "Criterion",
    "Duration",
    "Exposure",
    "Length",
    "Obstruction",
    "Rotation",
    "Turns",
    "criterion",
    "make_criterion",
    "motion_costs",
    "trajectory_cost",
]
