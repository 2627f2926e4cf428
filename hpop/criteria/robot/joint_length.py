"""Joint length: how far the joints go."""

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
    """∫ |q'| dt, the length of the path in the space of the joints q: what planners of arms minimise by default.

    All joints count alike, as they do where paths of arms are compared (path length in MotionBenchMaker and OMPL,
    Chamzas et al., RA-L 2022); a metre of a joint that slides counts as a radian. The joints of a robot that also
    drives are those of its arm or head alone: its way is ``length``.
    """

    def cost(self, m: Motions) -> Column:
        """Length (M,), rad."""
        return m.integrate(lambda s: norm(joint_rates(m, s)))
