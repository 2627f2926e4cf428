"""Openness: which share of the space round the camera is visible, as a mean over time and as an integral."""

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
        """Return the time integral (M,), s, of the share of the surroundings that the camera cannot see."""
        if height_varies(m.model):
            return m.integrate(lambda s: 1.0 - sight_in_space.openness(m.world, s.camera, s.state.size, self.radius))
        return m.integrate(lambda s: 1.0 - openness(m.world, s.camera, self.radius))


@criterion("enclosure", group="P", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Enclosure(_Enclosed):
    """Time spent in enclosed surroundings: ∫ (1 - A(p(t)) / (pi r²)) dt, where A is the visible area.

    A second in which the camera sees nothing but a wall at the lens costs 1 s, a second in the open costs nothing. Unit
    s; a sum over motions. Searches minimise it in place of the mean, :class:`Openness`, which defines A.
    """


@criterion("openness", group="P", unit="1", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class Openness(_Enclosed):
    """Share of the surroundings that the camera cannot see, as a mean over time: 1 - (1/T) ∫ A(p(t)) / (pi r²) dt.

    A = ½ ∫ min(R(θ), r)² dθ is the area of the isovist, the area that is visible from p. R(θ) is the distance to the
    nearest obstacle in direction θ that reaches the camera's height, and r is the ``radius``. The cost is 0 in the
    open. Unlike in ``obstruction``, objects behind a wall do not count, and a thin wall counts as much as a thick one.
    Unit 1; a mean over time.

    Source: isovists of Benedikt (1979). If the camera's height changes, R is found by rays at its current height.
    """

    @property
    def integral(self) -> Enclosure:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return Enclosure(self.radius)
