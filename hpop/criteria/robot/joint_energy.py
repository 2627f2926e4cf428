"""Joint energy: the squared speeds of the joints, over time."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.robot import joint_rates
from hpop.motions import Motions


@criterion("joint_energy", group="R", unit="rad²/s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointEnergy:
    """Effort of the joints: Σ ∫ q'² dt over the joints q.

    Unit rad²/s; a sum over motions. One fast joint costs more than several slow ones, and a fast motion more than a
    slow one: a joint that moves by the angle θ from rest to rest in the time T costs at least θ²/T. This is not an
    energy in joules, since it ignores masses and gravity. A metre of a sliding joint counts as a radian.

    Source: the usual quadratic effort of trajectories (the velocity term of RelaxedIK, Rakita, Mutlu and Gleicher, RSS
    2018; of CHOMP, Zucker et al., IJRR 2013).
    """

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,), rad²/s."""
        return m.integrate(lambda s: sum(rate * rate for rate in joint_rates(m, s)))
