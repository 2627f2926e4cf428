"""hpop: human perception-optimized planning, the whole Pareto front of a robot's motions seen through its camera.

Names are imported when they are first used, so that ``import hpop`` and ``hpop --help`` stay light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import find_former_names, on_first_use

if TYPE_CHECKING:
    from hpop import drive as drive
    from hpop import errors as errors
    from hpop import examples as examples
    from hpop import export as export
    from hpop import frontier as frontier
    from hpop import search as search
    from hpop import study as study
    from hpop import testing as testing
    from hpop import view as view
    from hpop.criteria.base import Criterion, criterion
    from hpop.drive.start import follow
    from hpop.models import DifferentialDrive, MobileArm, PanTilt, SerialArm
    from hpop.models.base import model
    from hpop.motions import Motions
    from hpop.planners import Lattice
    from hpop.problems.front import Front
    from hpop.problems.planning import Planning
    from hpop.problems.problem import Problem
    from hpop.runtime.status import Status
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import Person, Track, World, read_tracks

__version__ = "0.1.0"

_HOMES = {
    "Criterion": "hpop.criteria.base",
    "DifferentialDrive": "hpop.models",
    "Front": "hpop.problems.front",
    "Lattice": "hpop.planners",
    "MobileArm": "hpop.models",
    "Motions": "hpop.motions",
    "PanTilt": "hpop.models",
    "Person": "hpop.world",
    "Planning": "hpop.problems.planning",
    "Problem": "hpop.problems.problem",
    "SerialArm": "hpop.models",
    "Status": "hpop.runtime.status",
    "Track": "hpop.world",
    "Trajectory": "hpop.trajectories.trajectory",
    "World": "hpop.world",
    "criterion": "hpop.criteria.base",
    "follow": "hpop.drive.start",
    "model": "hpop.models.base",
    "read_tracks": "hpop.world",
}

_MODULES = (
    "drive",
    "errors",
    "examples",
    "export",
    "frontier",
    "search",
    "study",
    "testing",
    "view",
)  # each after ``import hpop`` alone

__all__ = [
    "Criterion",
    "DifferentialDrive",
    "Front",
    "Lattice",
    "MobileArm",
    "Motions",
    "PanTilt",
    "Person",
    "Planning",
    "Problem",
    "SerialArm",
    "Status",
    "Track",
    "Trajectory",
    "World",
    "criterion",
    "follow",
    "model",
    "read_tracks",
]

__getattr__ = on_first_use(__name__, _HOMES, _MODULES)
find_former_names()


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_MODULES})
