"""Joint limits: how near to their stops the joints are."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Instants, Motions


@criterion("joint_limits", group="R", unit="s", aggregate="sum", requires=("joints",))
@dataclass(frozen=True)
class JointLimits:
    """∫ mean over joints of ((q - middle) / (half the range))² dt: the time for which all at their stops is as bad.

    Liégeois, "Automatic supervisory control of the configuration and behavior of multibody mechanisms", IEEE Trans.
    SMC 7(12), 1977: the square keeps all joints away from their stops, the far ones more than the near. It is 0 in the
    middle of all ranges and 1 where every joint is at a stop. Joints that turn without end, and those that are fixed,
    have no stops and are not among the mean; nothing is to pay where none has.
    """

    def cost(self, m: Motions) -> Column:
        """Time integral (M,), s."""
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
