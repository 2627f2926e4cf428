"""Joint limits: how near the joints are to their stops."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Instants, Motions


@criterion("joint_limits", group="R", unit="s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointLimits:
    """Nearness of the joints to their stops, over time: ∫ mean over joints of ((q - middle) / (half the range))² dt.

    The integrand is 0 where all joints are in the middle of their ranges and 1 where every joint is at a stop. Unit s;
    a sum over motions. Joints that turn without end and fixed joints have no stops and do not count; a robot that has
    only such joints pays nothing.

    Source: Liégeois, "Automatic supervisory control of the configuration and behavior of multibody mechanisms", IEEE
    Trans. SMC 7(12), 1977. The square acts on all joints, and most on those near their stops.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), s."""
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
