"""The smoothing planner: polylines become curves that a differential drive can follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.programs.smoothing.planner import Smoothing

__all__ = ["Smoothing"]

__getattr__ = on_first_use(__name__, {"Smoothing": "hpop.planners.programs.smoothing.planner"})
