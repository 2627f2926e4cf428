"""Openness: how much of the space round the camera is open to the eye, as a mean and as an integral that adds up."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.options import LEAST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.camera import rises
from hpop.motions import Motions
from hpop.world.sight import sight_in_space
from hpop.world.sight.visibility import openness


@dataclass(frozen=True)
class _Enclosed:
    """A camera that looks round, up to ``radius`` metres."""

    radius: float = 5.0  # m, how far it looks

    def __post_init__(self) -> None:
        set_reals(self, "radius", least=LEAST, most=999, kind="a length in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the closed share, s."""
        if rises(m.model):
            return m.integrate(lambda s: 1.0 - sight_in_space.openness(m.world, s.camera, s.state.size, self.radius))
        return m.integrate(lambda s: 1.0 - openness(m.world, s.camera, self.radius))


@criterion("enclosure", group="P", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Enclosure(_Enclosed):
    """∫ (1 - A(p(t)) / (pi r²)) dt: the time for which seeing nothing but a wall would be as bad.

    The additive part of :class:`Openness`, so exact searches can minimise it.
    """


@criterion("openness", group="P", unit="1", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class Openness(_Enclosed):
    """1 - (1/T) ∫ A(p(t)) / (pi r²) dt, A = ½ ∫ min(R(θ), r)² dθ the area of the isovist.

    R is the distance to the nearest obstacle that reaches the camera's height. The isovist is Benedikt's (1979), cut
    off at r. 0 in the open. Unlike obstruction, what stands behind a wall does not count, and a thin wall counts as
    much as a thick one. Of a camera whose height changes it is taken by rays at the height at which the camera is.
    """

    @property
    def integral(self) -> Enclosure:
        """What adds up in its place."""
        return Enclosure(self.radius)
