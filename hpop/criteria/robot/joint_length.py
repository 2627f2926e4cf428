"""Joint length: how far the joints move."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import norm
from hpop.criteria.base import criterion
from hpop.criteria.robot import joint_rates
from hpop.motions import Motions


@criterion("joint_length", group="R", unit="rad", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointLength:
    """Length of the path in the space of the joints q: ∫ |q'| dt.

    Unit rad; a sum over motions. All joints have equal weight; a metre of a sliding joint counts as a radian. For a
    robot that also drives, only the joints of its arm or head count; ``length`` measures the path of the base.

    Source: planners for arms minimise it by default, and studies compare paths of arms by it (path length in
    MotionBenchMaker and OMPL, Chamzas et al., RA-L 2022).
    """

    def cost(self, m: Motions) -> Column:
        """Return the length (M,), rad."""
        return m.integrate(lambda s: norm(joint_rates(m, s)))
