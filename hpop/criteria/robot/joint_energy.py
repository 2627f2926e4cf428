"""Joint energy: how fast the joints go, squared."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.robot import joint_rates
from hpop.motions import Motions


@criterion("joint_energy", group="R", unit="rad²/s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointEnergy:
    """Σ ∫ q'² dt over the joints q: twice the kinetic energy of joints of one unit of inertia each, over time.

    The usual quadratic effort of trajectories (the velocity term of RelaxedIK, Rakita, Mutlu and Gleicher, RSS 2018; of
    CHOMP, Zucker et al., IJRR 2013). It knows no masses and no gravity, so it is no energy in joules: what it says is
    that one fast joint is worse than several slow ones, and a hurried motion worse than a calm one. A joint that goes
    the angle θ from rest to rest in the time T costs at least θ²/T. A metre of a joint that slides counts as a radian.
    """

    def cost(self, m: Motions) -> Column:
        """Integral (M,), rad²/s."""
        return m.integrate(lambda s: sum(rate * rate for rate in joint_rates(m, s)))
