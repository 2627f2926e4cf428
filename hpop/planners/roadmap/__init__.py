"""The roadmap planner: every optimal trade-off on a probabilistic roadmap, exactly."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.roadmap.planner import Roadmap

__all__ = ["Roadmap"]

__getattr__ = on_first_use(__name__, {"Roadmap": "hpop.planners.roadmap.planner"})
