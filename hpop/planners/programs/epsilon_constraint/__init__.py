"""The epsilon-constraint planner: any-angle polylines that minimise one cost while the others are bounded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.programs.epsilon_constraint.planner import EpsilonConstraint

__all__ = ["EpsilonConstraint"]

__getattr__ = on_first_use(__name__, {"EpsilonConstraint": "hpop.planners.programs.epsilon_constraint.planner"})
