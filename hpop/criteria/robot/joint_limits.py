"""Joint limits: how near the joints are to their end stops."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Instants, Motions


@criterion("joint_limits", group="R", unit="s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointLimits:
    """Nearness of the joints to their end stops, over time: ∫ mean over joints of ((q - middle) / (half range))² dt.

    The integrand is 0 if all joints are in the middle of their ranges, and 1 if every joint is at a stop. Unit s; a sum
    over motions. Joints that turn without end and fixed joints have no stops and do not count. For a robot with such
    joints only, the cost is 0.

    Source: Liégeois, "Automatic supervisory control of the configuration and behavior of multibody mechanisms", IEEE
    Trans. SMC 7(12), 1977. The square involves all joints, but most of all those near their stops.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), s, of the nearness to stops, 0 to 1, averaged over the joints with stops."""
        space = m.model.space
        stops = [(name, space.low[i], space.high[i]) for i, name in enumerate(space.names) if name not in space.turning]
        ranges = [
            (name, 0.5 * (low + high), 0.5 * (high - low))
            for name, low, high in stops
            if name in m.model.joints and low < high
        ]
        if not ranges:
            return 0.0 * m.duration

        def nearness(s: Instants) -> Column:
            return sum(((getattr(s.state, name) - middle) / half) ** 2 for name, middle, half in ranges) / len(ranges)

        return m.integrate(nearness)
