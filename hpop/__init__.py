"""hpop: human perception-optimized planning, the whole Pareto front of a robot's motions seen through its camera.

Names are imported when they are first used, so that ``import hpop`` and ``hpop --help`` stay light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpop.criteria.base import Criterion, criterion
    from hpop.front import Front
    from hpop.models import DifferentialDrive
    from hpop.models.base import model
    from hpop.motions import Motions
    from hpop.planners import Lattice
    from hpop.problem import Problem
    from hpop.status import Status
    from hpop.trajectory import Trajectory
    from hpop.world import World

__version__ = "0.1.0"

_HOMES = {
    "Criterion": "hpop.criteria.base",
    "DifferentialDrive": "hpop.models",
    "Front": "hpop.front",
    "Lattice": "hpop.planners",
    "Motions": "hpop.motions",
    "Problem": "hpop.problem",
    "Status": "hpop.status",
    "Trajectory": "hpop.trajectory",
    "World": "hpop.world",
    "criterion": "hpop.criteria.base",
    "model": "hpop.models.base",
}

__all__ = [
    "Criterion",
    "DifferentialDrive",
    "Front",
    "Lattice",
    "Motions",
    "Problem",
    "Status",
    "Trajectory",
    "World",
    "criterion",
    "model",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'hpop' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
