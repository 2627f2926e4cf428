"""hpop: human perception-optimized planning, the whole Pareto front of a robot's motions seen through its camera.

Names are imported when they are first used, so that ``import hpop`` and ``hpop --help`` are fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import find_former_names, homes_of, on_first_use

if TYPE_CHECKING:
    from hpop import batches as batches
    from hpop import drive as drive
    from hpop import errors as errors
    from hpop import examples as examples
    from hpop import export as export
    from hpop import frontier as frontier
    from hpop import ros as ros
    from hpop import scenario as scenario
    from hpop import search as search
    from hpop import simulation as simulation
    from hpop import study as study
    from hpop import testing as testing
    from hpop import view as view
    from hpop.batches.running import batch as batch
    from hpop.criteria.base import Criterion as Criterion
    from hpop.criteria.base import criterion as criterion
    from hpop.drive.script import follow as follow
    from hpop.goals.tour import Tour as Tour
    from hpop.models import Ackermann as Ackermann
    from hpop.models import DifferentialDrive as DifferentialDrive
    from hpop.models import MobileArm as MobileArm
    from hpop.models import PanTilt as PanTilt
    from hpop.models import SerialArm as SerialArm
    from hpop.models import TwoArms as TwoArms
    from hpop.models import ViewModel as ViewModel
    from hpop.models.base import model as model
    from hpop.motions import Motions as Motions
    from hpop.planners import Lattice as Lattice
    from hpop.problems.front import Front as Front
    from hpop.problems.problem import Planning as Planning
    from hpop.problems.problem import Problem as Problem
    from hpop.problems.retiming import retime as retime
    from hpop.problems.why import WhyNot as WhyNot
    from hpop.problems.why import why_not as why_not
    from hpop.runtime.limits import Status as Status
    from hpop.simulation import simulate as simulate
    from hpop.trajectories.trajectory import Trajectory as Trajectory
    from hpop.world import Person as Person
    from hpop.world import Track as Track
    from hpop.world import World as World
    from hpop.world import read_tracks as read_tracks

__version__ = "0.1.0"

_HOMES = homes_of(__name__)
__all__ = [name for name, home in _HOMES.items() if home]
__getattr__ = on_first_use(__name__, _HOMES)
find_former_names()


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
