"""Openness: the share of the space round the camera that is open to view, as a mean over time and as its integral."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.options import LEAST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.models.camera import height_varies
from hpop.motions import Motions
from hpop.world.sight import sight_in_space
from hpop.world.sight.visibility import openness


@dataclass(frozen=True)
class _Enclosed:
    """Share of the surroundings, up to ``radius`` metres, that the camera cannot see."""

    radius: float = 5.0  # m, range of sight

    def __post_init__(self) -> None:
        set_reals(self, "radius", least=LEAST, most=999, kind="a length in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the closed share (M,), s."""
        if height_varies(m.model):
            return m.integrate(lambda s: 1.0 - sight_in_space.openness(m.world, s.camera, s.state.size, self.radius))
        return m.integrate(lambda s: 1.0 - openness(m.world, s.camera, self.radius))


@criterion("enclosure", group="P", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Enclosure(_Enclosed):
    """Time spent in enclosed surroundings: ∫ (1 - A(p(t)) / (pi r²)) dt, A the visible area.

    A second with a wall in front of the lens costs 1 s, a second in the open nothing. Unit s; a sum over motions.
    Searches minimise it in place of :class:`Openness`, the mean, which defines A.
    """


@criterion("openness", group="P", unit="1", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class Openness(_Enclosed):
    """Share of the surroundings that the camera cannot see, as a mean over time: 1 - (1/T) ∫ A(p(t)) / (pi r²) dt.

    A = ½ ∫ min(R(θ), r)² dθ is the area of the isovist: R(θ) is the distance to the nearest obstacle that reaches the
    camera's height, cut off at the ``radius`` r. The cost is 0 in the open. Unlike for ``obstruction``, objects behind
    a wall do not count, and a thin wall counts as much as a thick one. Unit 1; a mean over time.

    Source: isovists of Benedikt (1979). Where the camera's height changes, R is found by rays at the camera's current
    height.
    """

    @property
    def integral(self) -> Enclosure:
        """Time integral, which searches minimise in place of the mean."""
        return Enclosure(self.radius)
