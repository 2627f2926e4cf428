"""The lattice planner: every optimal trade-off on an SE(2) lattice, exactly."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.lazy import on_first_use

if TYPE_CHECKING:
    from hpop.planners.lattice.planner import Lattice

__all__ = ["Lattice"]

__getattr__ = on_first_use(__name__, {"Lattice": "hpop.planners.lattice.planner"})
